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
    const dimensionSet& dimensions,
    const Field<Type>& boundary
)
{
    components_[fieldi] = pTraits<Type>::nComponents;
    dimensions_[fieldi] = exponents(names_[fieldi], dimensions);

    const auto* flat = reinterpret_cast<const scalar*>(boundary.cdata());
    boundary_[fieldi].resize(boundary.size()*components_[fieldi]);
    std::copy(flat, flat + boundary_[fieldi].size(), boundary_[fieldi].begin());

    m4gn_field& view = view_[fieldi];
    view.name = names_[fieldi].c_str();
    view.components = components_[fieldi];
    view.boundary = boundary_[fieldi].cdata();
}


template<class Type>
void Foam::m4gnFieldSet::keep(const label fieldi, const UList<Type>& values)
{
    const auto* flat = reinterpret_cast<const scalar*>(values.cdata());

    scalarField& kept = values_[fieldi];
    kept.resize(values.size()*components_[fieldi]);
    std::copy(flat, flat + kept.size(), kept.begin());
    view_[fieldi].cells = kept.cdata();
}


Foam::IOobject Foam::m4gnFieldSet::stored(const word& name) const
{
    return IOobject
    (
        name,
        mesh_.time().timeName(),
        mesh_,
        IOobject::MUST_READ,
        IOobject::NO_WRITE,
        false
    );
}


template<class Type>
bool Foam::m4gnFieldSet::gatherCells
(
    const label fieldi,
    const m4gnMeshAdapter& nodes
)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    const word& name = names_[fieldi];
    Field<Type> boundary;

    if (const auto* field = mesh_.findObject<fieldType>(name))
    {
        nodes.boundaryValues(*field, boundary);
        set(fieldi, field->dimensions(), boundary);
        view_[fieldi].cells =
            reinterpret_cast<const double*>(field->primitiveField().cdata());
        return true;
    }

    IOobject io(stored(name));

    if
    (
        mesh_.foundObject<regIOobject>(name)
     || !io.typeHeaderOk<fieldType>(true)
    )
    {
        return false;
    }

    const fieldType field(io, mesh_);
    nodes.boundaryValues(field, boundary);
    set(fieldi, field.dimensions(), boundary);
    keep(fieldi, field.primitiveField());

    return true;
}


template<class Type>
bool Foam::m4gnFieldSet::gatherPoints
(
    const label fieldi,
    const m4gnPointAdapter& nodes
)
{
    typedef GeometricField<Type, pointPatchField, pointMesh> fieldType;

    const word& name = names_[fieldi];

    const auto take = [&](const fieldType& field)
    {
        const Field<Type>& all = field.primitiveField();
        set
        (
            fieldi,
            field.dimensions(),
            Field<Type>(all, nodes.boundaryPoints())
        );
        keep(fieldi, Field<Type>(all, nodes.points()));
    };

    if (const auto* field = mesh_.findObject<fieldType>(name))
    {
        take(*field);
        return true;
    }

    IOobject io(stored(name));

    if
    (
        mesh_.foundObject<regIOobject>(name)
     || !io.typeHeaderOk<fieldType>(true)
    )
    {
        return false;
    }

    take(fieldType(io, pointMesh::New(mesh_)));

    return true;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnFieldSet::m4gnFieldSet(const fvMesh& mesh, const wordList& names)
:
    mesh_(mesh),
    names_(names),
    components_(names.size(), Zero),
    dimensions_(names.size(), FixedList<int32_t, 7>(0)),
    values_(names.size()),
    boundary_(names.size()),
    view_(names.size())
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnFieldSet::gather(const m4gnNodes& nodes)
{
    const bool points = nodes.atPoints();

    forAll(names_, fieldi)
    {
        bool found = false;

        if (points)
        {
            const auto& at = static_cast<const m4gnPointAdapter&>(nodes);
            found =
                gatherPoints<scalar>(fieldi, at)
             || gatherPoints<vector>(fieldi, at);
        }
        else
        {
            const auto& at = static_cast<const m4gnMeshAdapter&>(nodes);
            m4gnRate::provide(mesh_, names_[fieldi]);
            found =
                gatherCells<scalar>(fieldi, at)
             || gatherCells<vector>(fieldi, at);
        }

        if (!found)
        {
            FatalErrorInFunction
                << "Field " << names_[fieldi] << " is neither registered with"
                << " the solver nor stored at time " << mesh_.time().timeName()
                << " as a "
                << (points ? "pointScalarField or pointVectorField."
                           : "volScalarField or volVectorField.") << nl
                << "    Registered: " << names(mesh_, points).c_str()
                << exit(FatalError);
        }
    }
}


bool Foam::m4gnFieldSet::registered
(
    const fvMesh& mesh,
    const word& name,
    const bool atPoints
)
{
    if (atPoints)
    {
        return
            mesh.foundObject<pointScalarField>(name)
         || mesh.foundObject<pointVectorField>(name);
    }

    m4gnRate::provide(mesh, name);

    return
        mesh.foundObject<volScalarField>(name)
     || mesh.foundObject<volVectorField>(name);
}


Foam::string Foam::m4gnFieldSet::names(const fvMesh& mesh, const bool atPoints)
{
    std::string cells(m4gn::join(mesh.sortedNames<volScalarField>()));
    cells += ", " + m4gn::join(mesh.sortedNames<volVectorField>());

    wordList ofPoints(mesh.sortedNames<pointScalarField>());
    ofPoints.append(mesh.sortedNames<pointVectorField>());
    const std::string points(m4gn::join(ofPoints));

    if (atPoints)
    {
        return
            (points.empty() ? "no field of points" : points)
          + "; with location cells: " + cells;
    }

    return points.empty() ? cells : cells + "; with location points: " + points;
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
