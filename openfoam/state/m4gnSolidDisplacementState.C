/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSolidDisplacementState.H"
#include "m4gnSolverStateType.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

addM4gnSolverState(m4gnSolidDisplacementState, solidDisplacement)

const char* const Foam::m4gnSolidDisplacementState::needs =
    "a displacement (name: D), sigmaD, divSigmaExp, and E, nu and rho"
    " (solidDisplacementFoam)";

// * * * * * * * * * * * * Protected Member Functions  * * * * * * * * * * * //

void Foam::m4gnSolidDisplacementState::update()
{
    stress_.update(D(), 1e-10);
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
     && m4gnExplicitStress::registered(mesh);
}


Foam::m4gnSolidDisplacementState::m4gnSolidDisplacementState
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
:
    m4gnDisplacementState(mesh, dict, session),
    stress_(mesh)
{}


// ************************************************************************* //
