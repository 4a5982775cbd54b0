// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "m4gnMixing.H"
#include "solidModel.H"

namespace
{
using namespace Foam;

//- Most sweeps, the change of a boundary value at which they end, relative to
//  the largest displacement, and that which is enough where they do not
const label maxSweeps = 300;
const scalar sweepTolerance = 1e-10;
const scalar enough = 1e-5;

//- Sweeps that the mixing remembers
const label sweepDepth = 8;

} // End anonymous namespace

Foam::labelList Foam::m4gnSolids4FoamLaw::tractions(const bool mixed) const
{
    DynamicList<label> found;
    const volVectorField& u = solid_->solutionD();

    forAll(u.boundaryField(), patchi) {
        const fvPatchVectorField& patch = u.boundaryField()[patchi];
        if (isA<fixedGradientFvPatchVectorField>(patch)
            || (mixed && isA<directionMixedFvPatchVectorField>(patch))) {
            found.append(patchi);
        }
    }

    return labelList(std::move(found));
}

Foam::vectorField& Foam::m4gnSolids4FoamLaw::gradient(fvPatchVectorField& patch)
{
    return isA<fixedGradientFvPatchVectorField>(patch)
               ? refCast<fixedGradientFvPatchVectorField>(patch).gradient()
               : refCast<directionMixedFvPatchVectorField>(patch).refGrad();
}

Foam::tmp<Foam::vectorField> Foam::m4gnSolids4FoamLaw::freeGradient(fvPatchVectorField& patch)
{
    if (isA<fixedGradientFvPatchVectorField>(patch)) {
        return gradient(patch);
    }
    return transform(I - refCast<directionMixedFvPatchVectorField>(patch).valueFraction(), gradient(patch));
}

void Foam::m4gnSolids4FoamLaw::presentGradients(const labelList& patches)
{
    auto& boundary = solid_->solutionD().boundaryFieldRef();

    for (const label patchi : patches) {
        fvPatchVectorField& patch = boundary[patchi];
        if (isA<directionMixedFvPatchVectorField>(patch)) {
            // Of this time: the values that it fixes
            patch.updateCoeffs();
        }
        gradient(patch) = patch.patch().deltaCoeffs() * (patch - patch.patchInternalField());
    }
}

void Foam::m4gnSolids4FoamLaw::evaluateBoundary(const labelList& patches)
{
    volVectorField& u = solid_->solutionD();

    for (const label patchi : patches) {
        // They count as updated, so that their gradient stays
        u.boundaryFieldRef()[patchi].fvPatchVectorField::updateCoeffs();
    }
    u.correctBoundaryConditions();
}

bool Foam::m4gnSolids4FoamLaw::agree(const bool mixed)
{
    volVectorField& u = solid_->solutionD();
    auto& boundary = u.boundaryFieldRef();
    const labelList patches(tractions(false));

    label n = 0;
    for (const label patchi : patches) {
        n += boundary[patchi].size();
    }

    const auto gather = [&](vectorField& gradients) {
        label facei = 0;
        for (const label patchi : patches) {
            const tmp<vectorField> present(freeGradient(boundary[patchi]));
            for (const vector& g : present()) {
                gradients[facei++] = g;
            }
        }
    };
    const auto scatter = [&](const vectorField& gradients) {
        label facei = 0;
        for (const label patchi : patches) {
            for (vector& g : gradient(boundary[patchi])) {
                g = gradients[facei++];
            }
        }
    };

    const scalar size = max(gMax(mag(solid_->D().primitiveField())()), VSMALL);
    m4gnMixing mixing(sweepDepth);
    vectorField now(n), next(n);

    presentGradients(patches);
    gather(now);

    scalar change = GREAT;
    for (label sweep = 0; sweep < maxSweeps && change > sweepTolerance * size; ++sweep) {
        scatter(now);
        const volVectorField::Boundary before(boundary);
        evaluateBoundary(patches);

        if (!stress()) {
            return false;
        }

        change = 0;
        forAll(boundary, patchi) {
            const fvPatchVectorField& patch = boundary[patchi];
            if (patch.size() && !patch.coupled() && !patches.found(patchi)) {
                change = max(change, max(mag(patch - before[patchi])));
            }
        }

        for (const label patchi : patches) {
            fvPatchVectorField& patch = boundary[patchi];
            const vectorField last(freeGradient(patch));
            patch.updateCoeffs();
            if (last.size()) {
                change = max(change, max(mag(freeGradient(patch) - last) / patch.patch().deltaCoeffs()));
            }
        }
        reduce(change, maxOp<scalar>());

        gather(next);
        now = mixed ? mixing.next(now, next) : tmp<vectorField>::New(next);
    }

    // Conditions that are updated still have the last gradient
    u.correctBoundaryConditions();

    return stress() && change < enough * size;
}

bool Foam::m4gnSolids4FoamLaw::agree()
{
    volVectorField& u = solid_->solutionD();
    const volVectorField before("before", u);
    const volSymmTensorField stressBefore("stressBefore", solid_->sigma());

    // Mixing can lead astray where the stress is far from linear
    for (const bool mixed : {true, false}) {
        if (agree(mixed)) {
            return true;
        }
        u == before;
        solid_->sigma() == stressBefore;
    }

    strain();

    return false;
}
