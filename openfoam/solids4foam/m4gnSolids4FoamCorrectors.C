// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "fvc.H"
#include "fvm.H"
#include "m4gnMixing.H"
#include "m4gnVersion.H"
#include "solidModel.H"
#include "solidTractionFvPatchVectorField.H"

namespace
{
using namespace Foam;

//- Correctors that the mixing remembers
const label correctorDepth = 20;

//- Most sweeps over the boundary in a corrector, and the change at which they
//  end: of that of the first one, and of that at which the correctors end
const label maxConditionSweeps = 10;
const scalar conditionTolerance = 0.01;

//- Correctors whose change is this much of the first one's lead nowhere
const scalar diverged = 1e6;

//- What the model hands out to its own classes only
struct protectedParts : public solidModel
{
    static const momentumStabilisation& stabilisationOf(const solidModel& solid)
    {
        return (solid.*(&protectedParts::stabilisation))();
    }

    //- The entry cellDisplacements
    static void setCells(solidModel& solid, fvVectorMatrix& equation)
    {
        void (solidModel::*const member)(fvVectorMatrix&) = &protectedParts::setCellDisps;
        (solid.*member)(equation);
    }
};

//- The patch's condition, if it is one of contact, which relaxes its traction
//  from corrector to corrector. Prescribed tractions stay to the bit.
solidTractionFvPatchVectorField* loaded(fvPatchVectorField& patch)
{
    return patch.type() == "rigidCylinderContact" ? &refCast<solidTractionFvPatchVectorField>(patch)
                                                  : nullptr;
}

//- Largest change of a field's boundary values over all ranks
scalar boundaryChange(const volVectorField::Boundary& before, const volVectorField& u)
{
    scalar largest = 0;
    forAll(before, patchi) {
        if (before[patchi].size()) {
            largest = max(largest, max(mag(u.boundaryField()[patchi] - before[patchi])));
        }
    }

    return returnReduce(largest, maxOp<scalar>());
}

} // End anonymous namespace

Foam::tmp<Foam::vectorField> Foam::m4gnSolids4FoamLaw::unknowns(const volScalarField& impK) const
{
    volVectorField& u = solid_->solutionD();
    auto& boundary = u.boundaryFieldRef();
    DynamicList<vector> all(u.primitiveField());

    for (const label patchi : tractions(true)) {
        fvPatchVectorField& patch = boundary[patchi];
        const auto* condition = loaded(patch);
        const tmp<vectorField> gradients(freeGradient(patch));

        forAll(patch, facei) {
            const scalar distance = 1 / patch.patch().deltaCoeffs()[facei];
            all.append(distance * gradients()[facei]);
            if (condition) {
                all.append(distance / impK.boundaryField()[patchi][facei] * condition->traction()[facei]);
            }
        }
    }

    return tmp<vectorField>::New(std::move(all));
}

bool Foam::m4gnSolids4FoamLaw::take(
    const vectorField& unknowns, const volScalarField& impK, const scalar tolerance)
{
    volVectorField& u = solid_->solutionD();
    auto& boundary = u.boundaryFieldRef();
    label i = 0;

    for (vector& value : u.primitiveFieldRef()) {
        value = unknowns[i++];
    }
    for (const label patchi : tractions(true)) {
        fvPatchVectorField& patch = boundary[patchi];
        auto* condition = loaded(patch);

        forAll(patch, facei) {
            const scalar coeff = patch.patch().deltaCoeffs()[facei];
            gradient(patch)[facei] = coeff * unknowns[i++];
            if (condition) {
                condition->traction()[facei] = coeff * impK.boundaryField()[patchi][facei] * unknowns[i++];
            }
        }
    }

    // Where cells are not orthogonal to the boundary its values take part of
    // the last gradient, which takes part of them
    scalar first = 0;
    bool graded = true;
    for (label sweep = 0; sweep < maxConditionSweeps; ++sweep) {
        const volVectorField::Boundary before(boundary);
        evaluateBoundary(tractions(true));

        const scalar change = boundaryChange(before, u);
        first = max(first, change);
        if (sweep && change <= max(tolerance, conditionTolerance * first)) {
            // Where cells are orthogonal to the boundary nothing has changed
            graded = change <= conditionTolerance * tolerance;
            break;
        }
        mechanical().grad(u, solid_->incremental() ? solid_->gradDD() : solid_->gradD());
    }

    return stress(graded);
}

Foam::tmp<Foam::volVectorField> Foam::m4gnSolids4FoamLaw::force() const
{
    const volSymmTensorField& sigma = const_cast<const solidModel&>(*solid_).sigma();

    if (solid_->nonLinGeom() == nonLinearGeometry::LINEAR_GEOMETRY) {
        return fvc::div(sigma, "div(sigma)");
    }

    const bool moving = solid_->movingMesh();

    return fvc::div(
        mesh_.lookupObject<volScalarField>(moving ? "relJ" : "J")
                * mesh_.lookupObject<volTensorField>(moving ? "relFinv" : "Finv")
            & sigma,
        "div(sigma)");
}

Foam::label Foam::m4gnSolids4FoamLaw::correct(
    const std::function<tmp<fvVectorMatrix>()>& inertiaAndWeight, const std::function<scalar()>& largest,
    const label most)
{
    solidModel& solid = *solid_;
    const solidModel& model = solid;
    volVectorField& u = solid.solutionD();
    const word scheme(solid.incremental() ? "laplacian(DDD,DD)" : "laplacian(DD,D)");
    const volVectorField before("before", u);
    const volScalarField& impK = mesh_.lookupObject<volScalarField>("impK");
    const surfaceScalarField impKf(mechanical().impKf());

    const dictionary controls(m4gnMixing::linearControls(mesh_.solverDict(u.name())));

    // What an attempt in vain leaves as it was: with others than these the solver's time step would begin far from its end
    const volSymmTensorField stressBefore("stressBefore", solid.sigma());
    const labelList patches(tractions(true));
    List<vectorField> gradients(patches.size()), loads(patches.size());
    forAll(patches, i) {
        fvPatchVectorField& patch = u.boundaryFieldRef()[patches[i]];
        gradients[i] = gradient(patch);
        if (loaded(patch)) {
            loads[i] = loaded(patch)->traction();
        }
    }
    presentGradients(patches);

    // The solver prints the residuals of none of its correctors either
    const label debug = SolverPerformance<vector>::debug;
    SolverPerformance<vector>::debug = 0;

    m4gnMixing mixing(correctorDepth);
    tmp<vectorField> now(unknowns(impK));
    label nCorrectors = 0;
    bool converged = false;
    bool valid = true;
    scalar first = 0;
    scalar limit = largest();

    while (valid && !converged && nCorrectors < most) {
        valid = take(now(), impK, conditionTolerance * limit);
        if (!valid) {
            break;
        }

        fvVectorMatrix equation(
            inertiaAndWeight()
            == fvm::laplacian(impKf, u, scheme) - fvc::laplacian(impKf, u, scheme) + force()
                   + protectedParts::stabilisationOf(model).stabilisation(
                       u, solid.incremental() ? solid.gradDD() : solid.gradD(), impK));
        protectedParts::setCells(solid, equation);
        equation.solve(controls);
        ++nCorrectors;

        // The list of a time step's solves becomes text with each of them
        const_cast<dictionary&>(m4gn::solverPerformance(mesh_)).clear();

        const tmp<vectorField> next(unknowns(impK));
        const scalar change = gMax(mag(next() - now())());
        limit = largest();
        converged = change <= limit;
        if (nCorrectors == 1) {
            first = change;
        }
        valid = change <= diverged * max(first, limit);
        now = mixing.next(now(), next());
    }
    SolverPerformance<vector>::debug = debug;

    if (!valid || !converged || !take(now(), impK, conditionTolerance * limit)) {
        u == before;
        forAll(patches, i) {
            fvPatchVectorField& patch = u.boundaryFieldRef()[patches[i]];
            gradient(patch) = gradients[i];
            if (loaded(patch)) {
                loaded(patch)->traction() = loads[i];
            }
        }
        stress();
        solid.sigma() == stressBefore;
        return -1;
    }

    return nCorrectors;
}
