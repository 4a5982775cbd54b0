/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnFieldSet.H"
#include "m4gnDictionary.H"
#include "m4gnRate.H"

// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

template<class Type>
void Foam::m4gnFieldSet::set
(
    const label fieldi,
    const GeometricField<Type, fvPatchField, volMesh>& field,
    const m4gnMeshAdapter& adapter
)
{
    components_[fieldi] = pTraits<Type>::nComponents;
    dimensions_[fieldi] = exponents(field.name(), field.dimensions());

    Field<Type> values;
    adapter.boundaryValues(field, values);

    const auto* flat = reinterpret_cast<const scalar*>(values.cdata());
    scalarField& boundary = boundary_[fieldi];
    boundary.resize(values.size()*components_[fieldi]);
    std::copy(flat, flat + boundary.size(), boundary.begin());

    m4gn_field& view = view_[fieldi];
    view.name = names_[fieldi].c_str();
    view.components = components_[fieldi];
    view.cells =
        reinterpret_cast<const double*>(field.primitiveField().cdata());
    view.boundary = boundary.cdata();
}


template<class Type>
bool Foam::m4gnFieldSet::gather
(
    const label fieldi,
    const m4gnMeshAdapter& adapter
)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    const word& name = names_[fieldi];

    if (const auto* field = mesh_.findObject<fieldType>(name))
    {
        set(fieldi, *field, adapter);
        return true;
    }

    if (mesh_.foundObject<regIOobject>(name))
    {
        return false;
    }

    IOobject io
    (
        name,
        mesh_.time().timeName(),
        mesh_,
        IOobject::MUST_READ,
        IOobject::NO_WRITE,
        false
    );

    if (!io.typeHeaderOk<fieldType>(true))
    {
        return false;
    }

    const fieldType field(io, mesh_);
    set(fieldi, field, adapter);

    // The field ends here: keep its values
    m4gn_field& view = view_[fieldi];
    scalarField& cells = cells_[fieldi];
    cells.resize(field.size()*components_[fieldi]);
    std::copy(view.cells, view.cells + cells.size(), cells.begin());
    view.cells = cells.cdata();

    return true;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnFieldSet::m4gnFieldSet(const fvMesh& mesh, const wordList& names)
:
    mesh_(mesh),
    names_(names),
    components_(names.size(), Zero),
    dimensions_(names.size(), FixedList<int32_t, 7>(0)),
    cells_(names.size()),
    boundary_(names.size()),
    view_(names.size())
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnFieldSet::gather(const m4gnMeshAdapter& adapter)
{
    forAll(names_, fieldi)
    {
        m4gnRate::provide(mesh_, names_[fieldi]);

        if
        (
            !gather<scalar>(fieldi, adapter)
         && !gather<vector>(fieldi, adapter)
        )
        {
            FatalErrorInFunction
                << "Field " << names_[fieldi] << " is neither registered with"
                << " the solver nor stored at time " << mesh_.time().timeName()
                << " as a volScalarField or volVectorField." << nl
                << "    Registered: "
                << m4gn::join(mesh_.sortedNames<volScalarField>()) << ", "
                << m4gn::join(mesh_.sortedNames<volVectorField>())
                << exit(FatalError);
        }
    }
}


Foam::FixedList<int32_t, 7> Foam::m4gnFieldSet::exponents
(
    const word& name,
    const dimensionSet& dimensions
)
{
    FixedList<int32_t, 7> integers(0);

    for (int i = 0; i < dimensionSet::nDimensions; ++i)
    {
        const scalar exponent = dimensions[dimensionSet::dimensionType(i)];

        integers[i] = int32_t(std::lround(exponent));

        if (mag(exponent - integers[i]) > 1e-10)
        {
            FatalErrorInFunction
                << "Field " << name << " has the dimensions " << dimensions
                << ", and m4gn handles only whole exponents"
                << exit(FatalError);
        }
    }

    return integers;
}


// ************************************************************************* //
