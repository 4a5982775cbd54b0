// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnHandOver.H"
#include "m4gnDictionary.H"
#include "StringStream.H"
#include "surfaceFields.H"
#include "volFields.H"

namespace
{
using namespace Foam;

//- Has a boundary patch of the field values that are computed, and no others?
bool computed(const volScalarField& field)
{
    bool some = false;
    for (const fvPatchScalarField& patch : field.boundaryField())
    {
        if (!polyPatch::constraintType(patch.patch().type()))
        {
            if (patch.type() != calculatedFvPatchScalarField::typeName)
            {
                return false;
            }
            some = true;
        }
    }
    return some;
}

} // End anonymous namespace

Foam::string Foam::m4gn::notHandedOver
(
    const fvMesh& mesh,
    const wordList& fields,
    const word& UName,
    const word& pName,
    const word& phiName
)
{
    OStringStream why;

    const auto* U = mesh.findObject<volVectorField>(UName);
    const auto* phi = mesh.findObject<surfaceScalarField>(phiName);
    if (U && phi && phi->dimensions() != U->dimensions()*dimArea)
    {
        why << "the flux " << phiName << " has the dimensions " << phi->dimensions()
            << "; expected a volumetric flux " << U->dimensions()*dimArea
            << " (incompressible solvers)";
        return why.str();
    }

    const auto* p = mesh.findObject<volScalarField>(pName);
    if (p && phi && p->dimensions() == dimPressure)
    {
        why << "the pressure " << pName << " is not divided by the density: several phases, or a"
            << " density that varies, go with this flow (interFoam), and their state is none of"
            << " the surrogate's";
        return why.str();
    }
    if (p && phi && pName != "p_rgh" && computed(*p) && mesh.foundObject<volScalarField>("p_rgh"))
    {
        why << "the pressure " << pName << " has no boundary conditions of its own, the solver"
            << " solves for p_rgh: give p p_rgh; and a model that predicts p_rgh";
        return why.str();
    }

    for (const word& name : fields)
    {
        const auto* field = mesh.findObject<volScalarField>(name);
        if (!field)
        {
            continue;
        }
        for (const fvPatchScalarField& patch : field->boundaryField())
        {
            if (patch.type().find("WallFunction") != std::string::npos)
            {
                why << "the field " << name << " has the condition " << patch.type()
                    << " at the patch " << patch.patch().name()
                    << ", which the turbulence model alone can evaluate";
                return why.str();
            }
        }
    }

    return string();
}

Foam::string Foam::m4gn::sources(const fvMesh& mesh)
{
    DynamicList<word> names;
    for (const word file : {"fvOptions", "MRFProperties"})
    {
        const auto* dict = mesh.findObject<dictionary>(file);
        if (!dict)
        {
            continue;
        }
        for (const entry& e : *dict)
        {
            if (e.isDict() && e.keyword() != "FoamFile" && e.dict().getOrDefault<bool>("active", true))
            {
                names.append(word(file + ' ' + e.keyword(), false));
            }
        }
    }
    return names.empty() ? string() : string(join(wordList(names)));
}
