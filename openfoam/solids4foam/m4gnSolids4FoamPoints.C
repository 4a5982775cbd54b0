// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "m4gnSetFields.H"
#include "pointFields.H"
#include "solidModel.H"
#include "vfvcCellPoint.H"
#include <cfenv>

namespace
{
using namespace Foam;

//- Most of Newton's iterations
const label maxIterations = 30;

//- The change of an iteration with which they have gone astray, over the size
//  of the displacement
const scalar farOff = 10;

//- While it lives, this time scheme of the mesh is another one. The solver reads
//  its schemes anew in each step.
class otherScheme
{
    ITstream& scheme_;
    const ITstream before_;

public:
    otherScheme(ITstream& scheme, const tokenList& tokens) : scheme_(scheme), before_(scheme)
    {
        scheme_ = ITstream(before_.name(), tokens);
    }

    ~otherScheme() { scheme_ = before_; }

    otherScheme(const otherScheme&) = delete;
    void operator=(const otherScheme&) = delete;
};

//- The tolerance at which the solver's Newton iterations end, which it has from
//  its start on and to itself. A pointer to it can be had where a template is
//  instantiated.
struct solverTolerance
{
    typedef const scalar solidModel::*type;
    friend type member(solverTolerance);
};

template <class Tag, typename Tag::type pointer> struct privateMember
{
    friend typename Tag::type member(Tag) { return pointer; }
};

template struct privateMember<solverTolerance, &solidModel::solutionTol_>;

//- While it lives, each step of the solver is one of Newton's iterations, of
//  half the length where the forces would be larger after the whole one
class oneIteration
{
    scalar& tolerance_;
    const scalar toleranceBefore_;

    dictionary& controls_;
    const Switch searchBefore_;

public:
    explicit oneIteration(const solidModel& model)
        : tolerance_(const_cast<scalar&>(model.*member(solverTolerance()))), toleranceBefore_(tolerance_),
          controls_(const_cast<dictionary&>(model.solidModelDict())),
          searchBefore_(controls_.getOrDefault<Switch>("lineSearch", false))
    {
        tolerance_ = GREAT;
        controls_.set("lineSearch", Switch(true));
    }

    ~oneIteration()
    {
        tolerance_ = toleranceBefore_;
        controls_.set("lineSearch", searchBefore_);
    }

    oneIteration(const oneIteration&) = delete;
    void operator=(const oneIteration&) = delete;
};

//- While it lives, the solver says nothing, and what is no number stops nothing
class unseen
{
    const int level_;
    fenv_t traps_;

public:
    unseen() : level_(messageStream::level)
    {
        messageStream::level = 0;
        ::feholdexcept(&traps_);
    }

    ~unseen()
    {
        ::feclearexcept(FE_ALL_EXCEPT);
        ::fesetenv(&traps_);
        messageStream::level = level_;
    }

    unseen(const unseen&) = delete;
    void operator=(const unseen&) = delete;
};

} // End anonymous namespace

bool Foam::m4gnSolids4FoamLaw::atPoints() const { return solid_->type().starts_with("vertexCentred"); }

Foam::tmp<Foam::surfaceTensorField> Foam::m4gnSolids4FoamLaw::dualGradient() const
{
    const solidModel& model = *solid_;

#if __has_include("meshDual.H")
    const dualMeshToMeshMap& map = model.dualMesh().dualMeshMap();
#else
    const dualMeshToMeshMap& map = model.dualMeshMap();
#endif

    return vfvc::fGrad(
        solid_->pointD(), mesh_, model.dualMesh(), map.dualFaceToCell(), map.dualCellToPoint(),
        model.solidModelDict().getOrDefault<scalar>("zeta", 0.1), false);
}

Foam::scalar Foam::m4gnSolids4FoamLaw::smallestJacobian() const
{
    if (solid_->nonLinGeom() == nonLinearGeometry::LINEAR_GEOMETRY) {
        return 1;
    }

    return gMin(det(tensor::I + dualGradient()().primitiveField().T())());
}

bool Foam::m4gnSolids4FoamLaw::followPoints()
{
    solid_->gradD() = vfvc::grad(solid_->pointD(), solid_->mesh());

    auto* F = mesh_.getObjectPtr<volTensorField>("F");
    if (F && solid_->nonLinGeom() != nonLinearGeometry::LINEAR_GEOMETRY) {
        volScalarField& J = mesh_.lookupObjectRef<volScalarField>("J");
        m4gn::set(*F, dimensionedTensor("one", dimless, tensor::I) + solid_->gradD().T());
        m4gn::set(J, det(*F));
        if (min(J).value() <= SMALL) {
            return false;
        }
        m4gn::setIfFound(mesh_, "Finv", inv(*F));
    }
    mechanical().correct(solid_->sigma());

    return true;
}

bool Foam::m4gnSolids4FoamLaw::newton(const scalar duration, const scalar tolerance, const scalar size)
{
    const solidModel& model = *solid_;
    const pointVectorField& D = solid_->pointD();

    // Newmark's scheme, with beta (duration/deltaT)^2, from a state at rest: the
    // displacement after the solver's time step is the old one and duration^2 f/rho
    const scalar beta = sqr(duration / mesh_.time().deltaTValue());
    const tokenList newmark({token(word("NewmarkBeta")), token(beta), token(scalar(0.5))});
    const otherScheme ofD(mesh_.d2dt2Scheme("d2dt2(pointD)"), newmark);
    const otherScheme ofU(mesh_.ddtScheme("ddt(pointD)"), newmark);
    const otherScheme ofA(mesh_.ddtScheme("ddt(pointU)"), newmark);
    const oneIteration each(model);
    const unseen whileItSolves;

    for (label i = 0; i < maxIterations; ++i) {
        // Of dual cells that are inside out the law makes no numbers, of which
        // the solver of the linear system makes addresses
        if (smallestJacobian() <= SMALL) {
            return false;
        }

        const vectorField before(D.primitiveField());
        solid_->evolve();

        const scalar change = gMax(mag(D.primitiveField() - before)());
        if (!(change <= farOff * size)) {
            return false;
        }
        if (change <= tolerance * size) {
            return true;
        }
    }

    return false;
}

bool Foam::m4gnSolids4FoamLaw::relaxPoints(
    const vectorField& free, const scalar duration, const scalar tolerance)
{
    pointVectorField& D = solid_->pointD();
    auto& U = mesh_.lookupObjectRef<pointVectorField>("pointU");
    auto& A = mesh_.lookupObjectRef<pointVectorField>("pointA");

    // What a step changes, besides what follow() makes
    const volVectorField cells("cells", solid_->D());
    const List<pointVectorField*> fields({&D, &U, &A});
    List<vectorField> before, old;
    for (pointVectorField* field : fields) {
        old.append(field->oldTime().primitiveField());
        before.append(field->primitiveField());
    }

    D.oldTime().primitiveFieldRef() = free;
    U.oldTime().primitiveFieldRef() = Zero;
    A.oldTime().primitiveFieldRef() = Zero;

    const scalar size = max(gMax(mag(before[0])()), gMax(mag(free)()));
    const bool done = newton(duration, tolerance, size) && smallestJacobian() > SMALL
                      && gMax(mag(D.primitiveField())()) <= 2 * size;

    forAll(fields, i) {
        fields[i]->oldTime().primitiveFieldRef() = old[i];
        if (i || !done) {
            fields[i]->primitiveFieldRef() = before[i];
        }
    }
    if (!done) {
        D.correctBoundaryConditions();
        solid_->D() == cells;

        // The solver's next step begins with it
        const solidModel& model = *solid_;
        model.dualMesh().lookupObjectRef<surfaceTensorField>("grad(D)f") = dualGradient();
    }

    return done;
}
