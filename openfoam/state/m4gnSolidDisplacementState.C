/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSolidDisplacementState.H"
#include "m4gnSolverStateType.H"
#include "fvcDiv.H"
#include "fvcGrad.H"
#include "fvcLaplacian.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

addM4gnSolverState(m4gnSolidDisplacementState, solidDisplacement)

const char* const Foam::m4gnSolidDisplacementState::needs =
    "a displacement (name: D), sigmaD, divSigmaExp, and E, nu and rho"
    " (solidDisplacementFoam)";

namespace
{

//- Most sweeps over sigmaD and the boundary, and the relative change of the
//  boundary values at which they end
const Foam::label maxSweeps = 50;
const Foam::scalar sweepTolerance = 1e-10;

} // End anonymous namespace


// * * * * * * * * * * * * Protected Member Functions  * * * * * * * * * * * //

void Foam::m4gnSolidDisplacementState::update()
{
    const volScalarField& mu = *mu_;
    const volScalarField& lambda = *lambda_;

    volSymmTensorField& sigmaD =
        mesh_.lookupObjectRef<volSymmTensorField>("sigmaD");
    volVectorField& divSigmaExp =
        mesh_.lookupObjectRef<volVectorField>("divSigmaExp");

    const scalar size = max(gMax(mag(D().primitiveField())()), VSMALL);

    for (label sweep = 0; sweep < maxSweeps; ++sweep)
    {
        // sigmaD still has the values of the state before
        const volVectorField::Boundary before(D().boundaryField());
        D().correctBoundaryConditions();

        const volTensorField gradD(fvc::grad(D()));
        sigmaD = mu*twoSymm(gradD) + (lambda*I)*tr(gradD);

        scalar change = 0;
        forAll(before, patchi)
        {
            if (before[patchi].size())
            {
                change = max
                (
                    change,
                    max(mag(D().boundaryField()[patchi] - before[patchi]))
                );
            }
        }

        if (sweep && returnReduce(change, maxOp<scalar>()) < sweepTolerance*size)
        {
            break;
        }
    }

    if (compactNormalStress_)
    {
        divSigmaExp = fvc::div
        (
            sigmaD - (2*mu + lambda)*fvc::grad(D()),
            "div(sigmaD)"
        );
    }
    else
    {
        divSigmaExp =
            fvc::div(sigmaD)
          - fvc::laplacian(2*mu + lambda, D(), "laplacian(DD,D)");
    }
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

bool Foam::m4gnSolidDisplacementState::applies
(
    const fvMesh& mesh,
    const dictionary& dict
)
{
    return
        mesh.foundObject<volVectorField>(displacementName(dict))
     && mesh.foundObject<volSymmTensorField>("sigmaD")
     && mesh.foundObject<volVectorField>("divSigmaExp")
     && mesh.foundObject<volScalarField>("E")
     && mesh.foundObject<volScalarField>("nu")
     && mesh.foundObject<volScalarField>("rho")
     && mesh.foundObject<IOdictionary>("mechanicalProperties");
}


Foam::m4gnSolidDisplacementState::m4gnSolidDisplacementState
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
:
    m4gnDisplacementState(mesh, dict, session),
    compactNormalStress_
    (
        mesh.solutionDict().subDict("stressAnalysis")
       .get<bool>("compactNormalStress")
    )
{
    const volScalarField& nu = mesh_.lookupObject<volScalarField>("nu");
    const volScalarField E
    (
        mesh_.lookupObject<volScalarField>("E")
       /mesh_.lookupObject<volScalarField>("rho")
    );

    const bool planeStress =
        mesh_.lookupObject<IOdictionary>("mechanicalProperties")
       .get<bool>("planeStress");

    // Not to be found in the registry in place of the solver's
    mu_.reset(new volScalarField("m4gnMu", E/(2*(1 + nu))));
    lambda_.reset
    (
        planeStress
      ? new volScalarField("m4gnLambda", nu*E/((1 + nu)*(1 - nu)))
      : new volScalarField("m4gnLambda", nu*E/((1 + nu)*(1 - 2*nu)))
    );
}


// ************************************************************************* //
