// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnTotalDisplacementCompletion.H"
#include "m4gnCompletionType.H"
#include "m4gnCaseChecks.H"
#include "fixedGradientFvPatchFields.H"
#include "fvcGrad.H"
#include "pointFields.H"
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
    : m4gnDisplacementCompletion(mesh, dict, session), followed_(false)
{
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

    m4gnDisplacementCompletion::complete(deltaT, handOver);

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
    wordList names(m4gnDisplacementCompletion::advanced());
    names.append("point" + DName_);
    if (dynamic_) {
        names.append("U");
    }
    if (followed_) {
        names.append(m4gnSolidLaw::fields());
    }
    return names;
}
