// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnOwnField.H"
#include "volFields.H"

template<class Type>
Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>*
Foam::m4gnOwnField::get
(
    const fvMesh& mesh,
    const word& name,
    const dimensionSet& dimensions,
    const string& mark,
    const word& patchType
)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    auto* field = mesh.getObjectPtr<fieldType>(name);

    if (!field)
    {
        field = new fieldType
        (
            IOobject(name, mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE),
            mesh,
            dimensioned<Type>(name, dimensions, Zero),
            patchType
        );
        field->note() = mark;
        mesh.objectRegistry::store(field);
    }

    return field->note() == mark ? field : nullptr;
}

#define makeOwnField(Type)                                                     \
    template Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>*    \
    Foam::m4gnOwnField::get<Type>                                              \
    (                                                                          \
        const fvMesh&,                                                         \
        const word&,                                                           \
        const dimensionSet&,                                                   \
        const string&,                                                         \
        const word&                                                            \
    );

makeOwnField(Foam::scalar)
makeOwnField(Foam::vector)

#undef makeOwnField
