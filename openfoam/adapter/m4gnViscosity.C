// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnViscosity.H"
#include "m4gnOwnField.H"
#include "volFields.H"

namespace Foam
{
namespace m4gnViscosity
{
static const word fieldName("nu");

//- In the header's note: whose field it is
static const char* const mark = "viscosity of transportProperties, by m4gn";

} // End namespace m4gnViscosity
} // End namespace Foam

void Foam::m4gnViscosity::provide(const fvMesh& mesh, const word& name)
{
    if (name != fieldName)
    {
        return;
    }

    const auto* properties = mesh.findObject<dictionary>("transportProperties");

    if (!properties || !properties->found(fieldName))
    {
        return;
    }

    const dimensionedScalar nu(fieldName, dimViscosity, *properties);

    if (auto* field = m4gnOwnField::get<scalar>(mesh, fieldName, dimViscosity, mark))
    {
        *field == nu;
    }
}
