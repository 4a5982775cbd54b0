// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnContactProjection.H"
#include "m4gnObstacles.H"
#include "volFields.H"

namespace
{
//- Stiffness of the supports over that of the contact
const Foam::scalar push = 100;

//- A push may bring other faces in
const Foam::label maxPushes = 5;

//- Penetration that is let pass, over the mean size of a cell
const Foam::scalar tolerance = 1e-3;
}

Foam::m4gnContactProjection::m4gnContactProjection(
    const fvMesh& mesh, const dictionary& dict, const m4gnExplicitStress& law)
    : obstacles_(m4gnObstacles::present(mesh) ? &m4gnObstacles::of(mesh) : nullptr),
      response_(mesh, law, "contact", lengthOf(dict))
{}

Foam::scalar Foam::m4gnContactProjection::project(volVectorField& D) const
{
    const scalar before = obstacles_->smallestGap(D, true);

    if (!response_.active()) {
        return before;
    }

    // Distances of neighbours are the reciprocal of deltaCoeffs
    const scalar allowed = -tolerance / gAverage(D.mesh().deltaCoeffs().primitiveField());
    const volVectorField::Internal force(response_.inertia() * dimensionedVector(dimLength, Zero));

    scalar gap = before;
    for (label i = 0; i < maxPushes && gap < allowed; ++i) {
        const auto r = response_.respond(
            D, force, gMax(mag(D.primitiveField())()), m4gnElasticResponse::touching(D, push));

        D.primitiveFieldRef() += r().primitiveField();
        gap = obstacles_->smallestGap(D, true);
    }

    return before;
}
