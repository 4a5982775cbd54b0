// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolidDisplacementState.H"
#include "m4gnObstacles.H"
#include "m4gnSolverStateType.H"
#include "Time.H"

addM4gnSolverState(m4gnSolidDisplacementState, solidDisplacement)

    const char* const Foam::m4gnSolidDisplacementState::needs =
        "a displacement (name: D), sigmaD, divSigmaExp, and E, nu and rho"
        " (solidDisplacementFoam; the times of solidEquilibriumDisplacementFoam are"
        " iterations to one equilibrium, not time steps)";

void Foam::m4gnSolidDisplacementState::update() { stress_.update(D(), 1e-10); }

void Foam::m4gnSolidDisplacementState::smooth()
{
    if (contact_.active()) {
        gapBefore_ = contact_.project(D());
        update();
    }

    if (!smoothing_.active()) {
        return;
    }

    const scalar size = max(gMax(mag(D().primitiveField())()), VSMALL);

    smoothed_ = smoothing_.smoothDisplacement(D()) / size;
    if (dynamic_) {
        smoothing_.smoothRate(D(), rate());
    }
    update();
}

bool Foam::m4gnSolidDisplacementState::applies(const fvMesh& mesh, const dictionary& dict)
{
    return mesh.foundObject<volVectorField>(displacementName(dict)) && m4gnExplicitStress::registered(mesh);
}

Foam::m4gnSolidDisplacementState::m4gnSolidDisplacementState(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnDisplacementState(mesh, dict, session), stress_(mesh), smoothing_(mesh, dict, stress_),
      contact_(mesh, dict, stress_), gapBefore_(0), smoothed_(0)
{
    // Displacements and what follows from them are handed over here
    refuseFrozen(mesh_.sortedNames<volVectorField>());
}

void Foam::m4gnSolidDisplacementState::complete(const scalar deltaT, const bool handOver)
{
    m4gnDisplacementState::complete(deltaT, handOver);

    if (time_.writeTime()) {
        stress_.write();
    }
}

Foam::List<Foam::m4gnSolverState::quantity> Foam::m4gnSolidDisplacementState::quantities() const
{
    List<quantity> all(m4gnDisplacementState::quantities());
    if (contact_.active()) {
        all.append(quantity("gapBefore", gapBefore_));
        all.append(quantity("gap", m4gnObstacles::of(mesh_).smallestGap(D())));
    }
    if (smoothing_.active()) {
        all.append(quantity("smoothed", smoothed_));
    }
    return all;
}
