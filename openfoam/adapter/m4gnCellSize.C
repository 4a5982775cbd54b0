// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnCellSize.H"
#include "m4gnOwnField.H"
#include "surfaceFields.H"
#include "volFields.H"

namespace Foam
{
namespace m4gnCellSize
{
static const word fieldName("cellSize");

//- In the header's note: whose field it is
static const char* const mark = "mean distance of neighbouring cells, by m4gn";

static void add(scalarField& sum, labelList& n, label celli, scalar distance)
{
    sum[celli] += distance;
    ++n[celli];
}

} // End namespace m4gnCellSize
} // End namespace Foam

void Foam::m4gnCellSize::provide(const fvMesh& mesh, const word& name)
{
    // It stays while the mesh does
    if (name != fieldName || (mesh.foundObject<volScalarField>(fieldName) && !mesh.changing()))
    {
        return;
    }

    volScalarField* field =
        m4gnOwnField::get<scalar>(mesh, fieldName, dimLength, mark);

    if (!field)
    {
        return;
    }

    scalarField sum(mesh.nCells(), Zero);
    labelList n(mesh.nCells(), Zero);
    const surfaceScalarField distance(mag(mesh.delta()));

    forAll(mesh.neighbour(), facei)
    {
        add(sum, n, mesh.owner()[facei], distance[facei]);
        add(sum, n, mesh.neighbour()[facei], distance[facei]);
    }

    for (const fvsPatchScalarField& patch : distance.boundaryField())
    {
        if (!patch.coupled())
        {
            continue;
        }

        forAll(patch, facei)
        {
            add(sum, n, patch.patch().faceCells()[facei], patch[facei]);
        }
    }

    forAll(sum, celli)
    {
        field->primitiveFieldRef()[celli] = sum[celli]/max(n[celli], 1);
    }
    field->correctBoundaryConditions();
}
