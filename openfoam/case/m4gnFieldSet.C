// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnFieldSet.H"
#include "m4gnOwnFields.H"

Foam::m4gnFieldSet::m4gnFieldSet(const fvMesh& mesh, const wordList& names)
    : mesh_(mesh), names_(names), dimensions_(names.size(), FixedList<int32_t, 7>(0)), values_(names.size())
{}

void Foam::m4gnFieldSet::gather(const m4gnNodes& nodes)
{
    forAll(names_, fieldi) {
        const word& name = names_[fieldi];
        m4gnNodes::values& values = values_[fieldi];

        m4gnOwnFields::provide(mesh_, name);

        if (!nodes.gather(name, values)) {
            FatalErrorInFunction << "Field " << name << " is neither registered with"
                                 << " the solver nor stored at time " << mesh_.time().timeName() << " as a "
                                 << nodes.fieldTypes().c_str() << '.' << nl
                                 << "    Registered: " << nodes.registered().c_str() << exit(FatalError);
        }

        dimensions_[fieldi] = exponents(name, values.dimensions);
    }
}

std::vector<const double*> Foam::m4gnFieldSet::cells() const
{
    std::vector<const double*> all;
    for (const m4gnNodes::values& values : values_) {
        all.push_back(values.cells);
    }
    return all;
}

std::vector<const double*> Foam::m4gnFieldSet::boundary() const
{
    std::vector<const double*> all;
    for (const m4gnNodes::values& values : values_) {
        all.push_back(values.boundary.cdata());
    }
    return all;
}

bool Foam::m4gnFieldSet::registered(const fvMesh& mesh, const m4gnNodes& nodes, const word& name)
{
    m4gnOwnFields::provide(mesh, name);

    return nodes.registered(name);
}

Foam::FixedList<int32_t, 7> Foam::m4gnFieldSet::exponents(const word& name, const dimensionSet& dimensions)
{
    FixedList<int32_t, 7> integers(0);

    for (int i = 0; i < dimensionSet::nDimensions; ++i) {
        const scalar exponent = dimensions[dimensionSet::dimensionType(i)];

        integers[i] = int32_t(std::lround(exponent));

        if (mag(exponent - integers[i]) > 1e-10) {
            FatalErrorInFunction << "Field " << name << " has the dimensions " << dimensions
                                 << ", and m4gn handles only whole exponents" << exit(FatalError);
        }
    }

    return integers;
}
