// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSchemeFields.H"
#include "fvcDdt.H"
#include "IOobjectList.H"
#include "surfaceFields.H"
#include "Time.H"
#include "volFields.H"

namespace
{
using namespace Foam;

const char* const ofFlux = "ddtCorrDdt0(";

//- The field that it is of
word fieldOf(const word& name)
{
    const auto begin = name.find('(') + 1;
    return word(name.substr(begin, name.size() - begin - 1), false);
}

//- Ask the scheme for the change of a field, if it is of this type
template <class FieldType> void ask(const fvMesh& mesh, const word& name)
{
    if (const auto* field = mesh.findObject<FieldType>(name)) {
        fvc::ddt(*field);
    }
}

} // End anonymous namespace

bool Foam::m4gn::isOfScheme(const word& name)
{
    return name.starts_with("ddt0(") || name.starts_with(ofFlux);
}

void Foam::m4gn::readSchemeFields(const fvMesh& mesh)
{
    DynamicList<word> names;
    for (const word& name : IOobjectList(mesh, mesh.time().timeName()).sortedNames()) {
        if (isOfScheme(name) && !mesh.thisDb().found(name)) {
            names.append(name);
        }
    }
    for (const word& name : names) {
        if (!name.starts_with(ofFlux)) {
            ask<volScalarField>(mesh, fieldOf(name));
            ask<volVectorField>(mesh, fieldOf(name));
            ask<volSymmTensorField>(mesh, fieldOf(name));
            continue;
        }
        const auto* U = mesh.findObject<volVectorField>(fieldOf(name));
        for (const word& flux : names) {
            const auto* phi = mesh.findObject<surfaceScalarField>(fieldOf(flux));
            if (U && phi && flux.starts_with(ofFlux)) {
                fvc::ddtCorr(*U, *phi);
            }
        }
    }
}
