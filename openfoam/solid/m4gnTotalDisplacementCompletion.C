// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnTotalDisplacementCompletion.H"
#include "m4gnCompletionType.H"
#include "m4gnCaseChecks.H"
#include "m4gnDictionary.H"
#include "m4gnLastStep.H"
#include "m4gnOwnFields.H"
#include "fixedGradientFvPatchFields.H"
#include "fvcGrad.H"
#include "pointFields.H"
#include "Time.H"
#include "volPointInterpolation.H"

addM4gnCompletion(m4gnTotalDisplacementCompletion, totalDisplacement)

    const char* const Foam::m4gnTotalDisplacementCompletion::needs =
        "a displacement (name: D) and solidProperties with solidModel"
        " linearGeometryTotalDisplacement or"
        " nonLinearGeometryTotalLagrangianTotalDisplacement (solids4foam)";

namespace
{
//- Most sweeps over the gradient and the boundary, and the relative change of
//  the boundary values at which they end
const Foam::label maxSweeps = 50;
const Foam::scalar sweepTolerance = 1e-10;

} // End anonymous namespace

Foam::volVectorField& Foam::m4gnTotalDisplacementCompletion::D() const
{
    return mesh_.lookupObjectRef<volVectorField>(DName_);
}

Foam::volVectorField& Foam::m4gnTotalDisplacementCompletion::rate() const
{
    return mesh_.lookupObjectRef<volVectorField>(m4gnOwnFields::rateOf(DName_));
}

Foam::word Foam::m4gnTotalDisplacementCompletion::displacementName(const dictionary& dict)
{
    return dict.getOrDefault<word>("D", "D");
}

void Foam::m4gnTotalDisplacementCompletion::checkSolver() const
{
    refuseHistory();

    if (scheme_ != "Euler" && dynamic_) {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << scheme_ << nl << "    Handled: Euler, steadyState"
                             << exit(FatalError);
    }

    wordList needed(1, DName_);
    if (dynamic_) {
        needed.append(m4gnOwnFields::rateOf(DName_));
    }
    checkAdvanced(needed, scheme_);
}

void Foam::m4gnTotalDisplacementCompletion::update()
{
    followed_ = false;
    D().correctBoundaryConditions();

    const scalar size = max(gMax(mag(D().primitiveField())()), VSMALL);
    auto& boundary = D().boundaryFieldRef();

    for (label sweep = 0; sweep < maxSweeps; ++sweep) {
        const volTensorField gradD(fvc::grad(D()));
        scalar change = 0;

        forAll(boundary, patchi) {
            fvPatchVectorField& patch = boundary[patchi];

            // Of traction, and what derives from it
            if (isA<fixedGradientFvPatchVectorField>(patch) && patch.size()) {
                const labelUList& cells = patch.patch().faceCells();
                const vectorField extrapolated(
                    vectorField(D().primitiveField(), cells)
                    + (patch.patch().delta() & tensorField(gradD.primitiveField(), cells)));
                change = max(change, max(mag(extrapolated - patch)));
                patch == extrapolated;
            }
        }

        if (returnReduce(change, maxOp<scalar>()) < sweepTolerance * size) {
            break;
        }
    }
}

void Foam::m4gnTotalDisplacementCompletion::setVelocity()
{
    auto* U = mesh_.getObjectPtr<volVectorField>("U");
    if (dynamic_ && U) {
        U->primitiveFieldRef() = rate().primitiveField();

        forAll(U->boundaryFieldRef(), patchi) {
            U->boundaryFieldRef()[patchi] == rate().boundaryField()[patchi];
        }
    }
}

void Foam::m4gnTotalDisplacementCompletion::follow()
{
    followed_ = law_ && law_->follow();

    auto* points = mesh_.getObjectPtr<pointVectorField>("point" + DName_);
    if (points && !followed_) {
        volPointInterpolation::New(mesh_).interpolate(D(), *points);
    }
}

void Foam::m4gnTotalDisplacementCompletion::refuseContact() const
{
    for (const fvPatchVectorField& patch : D().boundaryField()) {
        if (patch.type() == "solidContact" || patch.type() == "solidRigidContact") {
            FatalErrorInFunction << "mode replace does not hand over the tractions that " << patch.type()
                                 << " relaxes from corrector to corrector (patch " << patch.patch().name()
                                 << " of " << DName_ << ')' << nl
                                 << "    Use rigidCylinderContact, or mode observe" << exit(FatalError);
        }
    }
}

bool Foam::m4gnTotalDisplacementCompletion::applies(const fvMesh& mesh, const dictionary& dict)
{
    const word model(m4gn::solidModel(mesh));

    return mesh.foundObject<volVectorField>(displacementName(dict))
           && (model == "linearGeometryTotalDisplacement"
               || model == "nonLinearGeometryTotalLagrangianTotalDisplacement");
}

Foam::m4gnTotalDisplacementCompletion::m4gnTotalDisplacementCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnCompletion(mesh, session), DName_(displacementName(dict)),
      scheme_(m4gn::scheme(mesh.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName_ + ')')),
      dynamic_(scheme_ != "steadyState"), followed_(false)
{
    checkSolver();
    refuseContact();

    // What follows from the displacement is made here, or by the solver's next
    // corrector where the law cannot be asked
    wordList made(mesh_.sortedNames<volVectorField>());
    made.append(m4gnSolidLaw::fields());
    refuseLeftBehind(made);

    law_ = m4gnSolidLaw::New(mesh_);
    relaxation_ = m4gnRelaxation::New(mesh_, dict, session_.stride(), law_, dynamic_);
}

bool Foam::m4gnTotalDisplacementCompletion::beforeStride()
{
    if (!relaxation_ || !relaxation_->restore(D().primitiveFieldRef(), rate().primitiveFieldRef())) {
        return false;
    }
    update();
    return true;
}

void Foam::m4gnTotalDisplacementCompletion::advance(const m4gnState& predicted, const scalar duration)
{
    predicted.impose();
    update();

    if (dynamic_) {
        const volVectorField& old = D().oldTime();
        const scalar rDuration = 1 / duration;

        // Predicted, and not to be computed from D anew
        rate().timeIndex() = time_.timeIndex();

        auto& boundary = rate().boundaryFieldRef();
        forAll(boundary, patchi) {
            boundary[patchi] == rDuration*(D().boundaryField()[patchi] - old.boundaryField()[patchi]);
        }
        rate().correctBoundaryConditions();
    }
}

void Foam::m4gnTotalDisplacementCompletion::complete(const scalar deltaT, const bool handOver)
{
    if (completeLastTwo()) {
        if (!relaxation_->relax(*law_, D().primitiveFieldRef(), rate().primitiveFieldRef(), deltaT)) {
            D().correctBoundaryConditions();
        }
        if (handOver) {
            relaxation_->end();
        }
    }

    if (dynamic_) {
        D().oldTime().primitiveFieldRef() = D().primitiveField() - deltaT * rate().primitiveField();
        // A stride is no step of the solver
        m4gnLastStep::of(time_) = deltaT;
    }

    setVelocity();
    follow();

    auto* DD = mesh_.getObjectPtr<volVectorField>("DD");
    if (dynamic_ && followed_ && DD) {
        // Of the solver's time step, at the boundary too
        *DD == dimensionedScalar("deltaT", dimTime, deltaT) * rate();
        D().oldTime().boundaryFieldRef() == D().boundaryField() - DD->boundaryField();
    }
}

void Foam::m4gnTotalDisplacementCompletion::write() const
{
    if (relaxation_) {
        relaxation_->write();
    }
    if (followed_) {
        law_->write();
    } else {
        m4gnCompletion::write();
    }
}

Foam::wordList Foam::m4gnTotalDisplacementCompletion::advanced() const
{
    wordList names(m4gnCompletion::advanced());
    names.append(wordList({DName_, m4gnOwnFields::rateOf(DName_), word("point" + DName_)}));
    if (dynamic_) {
        names.append("U");
    }
    if (followed_) {
        names.append(m4gnSolidLaw::fields());
    }
    return names;
}

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnTotalDisplacementCompletion::quantities() const
{
    const tmp<scalarField> magD(mag(D().primitiveField()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
