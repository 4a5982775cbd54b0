/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnTotalDisplacementState.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

const char* const Foam::m4gnTotalDisplacementState::needs =
    "a displacement (name: D) and solidProperties with solidModel"
    " linearGeometryTotalDisplacement or"
    " nonLinearGeometryTotalLagrangianTotalDisplacement (solids4foam)";


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::word Foam::m4gnTotalDisplacementState::solidModel(const fvMesh& mesh)
{
    const auto* properties =
        mesh.time().findObject<IOdictionary>("solidProperties");

    return
        properties
      ? properties->getOrDefault<word>("solidModel", word::null)
      : word::null;
}


bool Foam::m4gnTotalDisplacementState::applies
(
    const fvMesh& mesh,
    const dictionary& dict
)
{
    const word model(solidModel(mesh));

    return
        mesh.foundObject<volVectorField>(displacementName(dict))
     && (
            model == "linearGeometryTotalDisplacement"
         || model == "nonLinearGeometryTotalLagrangianTotalDisplacement"
        );
}


Foam::m4gnTotalDisplacementState::m4gnTotalDisplacementState
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
:
    m4gnDisplacementState(mesh, dict, session)
{}


// ************************************************************************* //
