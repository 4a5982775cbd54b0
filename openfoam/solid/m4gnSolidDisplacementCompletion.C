// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolidDisplacementCompletion.H"
#include "m4gnCompletionType.H"
#include "Time.H"

addM4gnCompletion(m4gnSolidDisplacementCompletion, solidDisplacement)

    const char* const Foam::m4gnSolidDisplacementCompletion::needs =
        "a displacement (name: D), sigmaD, divSigmaExp, and E, nu and rho"
        " (solidDisplacementFoam; the times of solidEquilibriumDisplacementFoam are"
        " iterations to one equilibrium, not time steps)";

void Foam::m4gnSolidDisplacementCompletion::update() { stress_.update(D(), 1e-10); }

void Foam::m4gnSolidDisplacementCompletion::smooth()
{
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

bool Foam::m4gnSolidDisplacementCompletion::applies(const fvMesh& mesh, const dictionary& dict)
{
    return mesh.foundObject<volVectorField>(displacementName(dict)) && m4gnExplicitStress::registered(mesh);
}

Foam::m4gnSolidDisplacementCompletion::m4gnSolidDisplacementCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnDisplacementCompletion(mesh, dict, session), stress_(mesh), smoothing_(mesh, dict, stress_),
      smoothed_(0)
{
    // Displacements and what follows from them are handed over here
    refuseLeftBehind(mesh_.sortedNames<volVectorField>());
}

void Foam::m4gnSolidDisplacementCompletion::complete(const scalar deltaT, const bool handOver)
{
    if (handOver) {
        smooth();
    }
    m4gnDisplacementCompletion::complete(deltaT, handOver);

    if (time_.writeTime()) {
        m4gnExplicitStress::write(mesh_);
    }
}

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnSolidDisplacementCompletion::quantities() const
{
    List<quantity> all(m4gnDisplacementCompletion::quantities());
    if (smoothing_.active()) {
        all.append(quantity("smoothed", smoothed_));
    }
    return all;
}
