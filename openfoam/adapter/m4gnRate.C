// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRate.H"
#include "calculatedFvPatchField.H"
#include "Time.H"
#include "volFields.H"
#include "zeroGradientFvPatchField.H"

namespace Foam
{
namespace m4gnRate
{
//- In the header's note: whose field it is
static const char* const mark = "rate of change, by m4gn";

template<class Type>
static bool provide(const fvMesh& mesh, const word& name, const word& rateName)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    const auto* field = mesh.findObject<fieldType>(name);

    if (!field)
    {
        return false;
    }

    auto* rate = mesh.getObjectPtr<fieldType>(rateName);

    if (!rate)
    {
        wordList types(mesh.boundary().size(), zeroGradientFvPatchField<Type>::typeName);

        forAll(types, patchi)
        {
            const fvPatchField<Type>& patch = field->boundaryField()[patchi];

            if (patch.patch().coupled() || patch.type() == "empty")
            {
                types[patchi] = patch.type();
            }
            else if (patch.fixesValue())
            {
                types[patchi] = calculatedFvPatchField<Type>::typeName;
            }
        }

        rate = new fieldType
        (
            IOobject(rateName, mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE),
            mesh,
            dimensioned<Type>(field->dimensions()/dimTime, Zero),
            types
        );
        rate->note() = mark;
        mesh.objectRegistry::store(rate);
    }
    else if(rate->note() != mark || rate->timeIndex() == mesh.time().timeIndex())
    {
        return true;
    }

    rate->timeIndex() = mesh.time().timeIndex();

    const scalar rDeltaT = 1/mesh.time().deltaTValue();
    const fieldType& old = field->oldTime();

    rate->primitiveFieldRef() =
        rDeltaT*(field->primitiveField() - old.primitiveField());

    auto& boundary = rate->boundaryFieldRef();
    forAll(boundary, patchi)
    {
        boundary[patchi] ==
            rDeltaT
           *(field->boundaryField()[patchi] - old.boundaryField()[patchi]);
    }
    rate->correctBoundaryConditions();

    return true;
}

} // End namespace m4gnRate
} // End namespace Foam

Foam::word Foam::m4gnRate::nameOf(const word& name)
{
    return "ddt(" + name + ')';
}

void Foam::m4gnRate::provide(const fvMesh& mesh, const word& rateName)
{
    if (!rateName.starts_with("ddt(") || !rateName.ends_with(")"))
    {
        return;
    }

    const word name(rateName.substr(4, rateName.size() - 5), false);

    if (!provide<vector>(mesh, name, rateName))
    {
        provide<scalar>(mesh, name, rateName);
    }
}
