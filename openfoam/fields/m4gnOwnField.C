/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnOwnField.H"
#include "volFields.H"
#include "zeroGradientFvPatchFields.H"

// * * * * * * * * * * * * * * * Global Functions  * * * * * * * * * * * * * //

Foam::volScalarField* Foam::m4gnOwnField::get
(
    const fvMesh& mesh,
    const word& name,
    const dimensionSet& dimensions,
    const string& mark
)
{
    auto* field = mesh.getObjectPtr<volScalarField>(name);

    if (!field)
    {
        field = new volScalarField
        (
            IOobject
            (
                name,
                mesh.time().timeName(),
                mesh,
                IOobject::NO_READ,
                IOobject::NO_WRITE
            ),
            mesh,
            dimensionedScalar(name, dimensions, 0),
            zeroGradientFvPatchScalarField::typeName
        );
        field->note() = mark;
        mesh.objectRegistry::store(field);
    }

    return field->note() == mark ? field : nullptr;
}


// ************************************************************************* //
