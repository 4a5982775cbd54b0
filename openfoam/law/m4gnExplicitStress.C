// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnExplicitStress.H"
#include "fvcDiv.H"
#include "fvcGrad.H"
#include "fvcLaplacian.H"

namespace
{
//- Most sweeps
const Foam::label maxSweeps = 50;
}

Foam::m4gnExplicitStress::m4gnExplicitStress(const fvMesh& mesh)
    : mesh_(mesh),
      compactNormalStress_(mesh.solutionDict().subDict("stressAnalysis").get<bool>("compactNormalStress"))
{
    const volScalarField& nu = mesh_.lookupObject<volScalarField>("nu");
    const volScalarField E(
        mesh_.lookupObject<volScalarField>("E") / mesh_.lookupObject<volScalarField>("rho"));

    const bool planeStress =
        mesh_.lookupObject<IOdictionary>("mechanicalProperties").get<bool>("planeStress");

    // Not to be found in the registry in place of the solver's
    mu_.reset(new volScalarField("m4gnMu", E / (2 * (1 + nu))));
    lambda_.reset(
        new volScalarField("m4gnLambda", nu * E / ((1 + nu) * (planeStress ? 1 - nu : 1 - 2 * nu))));
}

bool Foam::m4gnExplicitStress::registered(const fvMesh& mesh)
{
    return mesh.foundObject<volSymmTensorField>("sigmaD") && mesh.foundObject<volVectorField>("divSigmaExp")
           && mesh.foundObject<volScalarField>("E") && mesh.foundObject<volScalarField>("nu")
           && mesh.foundObject<volScalarField>("rho")
           && mesh.foundObject<IOdictionary>("mechanicalProperties");
}

Foam::scalar Foam::m4gnExplicitStress::change(const volVectorField::Boundary& before, const volVectorField& D)
{
    scalar largest = 0;
    forAll(before, patchi) {
        if (before[patchi].size()) {
            largest = max(largest, max(mag(D.boundaryField()[patchi] - before[patchi])));
        }
    }

    return returnReduce(largest, maxOp<scalar>());
}

void Foam::m4gnExplicitStress::update(volVectorField& D, const scalar tolerance) const
{
    volSymmTensorField& sigmaD = mesh_.lookupObjectRef<volSymmTensorField>("sigmaD");
    volVectorField& divSigmaExp = mesh_.lookupObjectRef<volVectorField>("divSigmaExp");

    const scalar size = max(gMax(mag(D.primitiveField())()), VSMALL);

    for (label sweep = 0; sweep < maxSweeps; ++sweep) {
        // sigmaD still has the values of the state before
        const volVectorField::Boundary before(D.boundaryField());
        D.correctBoundaryConditions();

        const volTensorField gradD(fvc::grad(D));
        sigmaD = *mu_ * twoSymm(gradD) + (*lambda_ * I) * tr(gradD);

        if (sweep && change(before, D) < tolerance * size) {
            break;
        }
    }

    if (compactNormalStress_) {
        const volTensorField gradD(fvc::grad(D));
        divSigmaExp = fvc::div(sigmaD - stiffness() * gradD, "div(sigmaD)");
    } else {
        divSigmaExp = fvc::div(sigmaD) - fvc::laplacian(stiffness(), D, "laplacian(DD,D)");
    }
}

void Foam::m4gnExplicitStress::write(const fvMesh& mesh)
{
    const auto object = [&](const word& name) {
        // Not registered: the solver registers its own
        return IOobject(name, mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE, false);
    };
    const volScalarField& rho = mesh.lookupObject<volScalarField>("rho");

    volSymmTensorField sigma(object("sigma"), rho * mesh.lookupObject<volSymmTensorField>("sigmaD"));
    if (mesh.lookupObject<IOdictionary>("thermalProperties").get<bool>("thermalStress")) {
        sigma = sigma
                - I
                      * (rho * mesh.lookupObject<volScalarField>("threeKalpha")
                         * mesh.lookupObject<volScalarField>("T"));
    }
    sigma.write();

    volScalarField(object("sigmaEq"), sqrt(1.5 * magSqr(dev(sigma)))).write();
}
