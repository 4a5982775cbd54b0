// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnNodeTypes.H"
#include "m4gn.h"
#include "m4gnDictionary.H"
#include "m4gnNodes.H"
#include "volFields.H"
#include "directionMixedFvPatchFields.H"
#include "mixedFvPatchFields.H"
#include "surfaceFields.H"
#include "StringStream.H"
#include "emptyFvPatch.H"
#include "slipFvPatchFields.H"
#include "symmetryFvPatch.H"
#include "symmetryPlaneFvPatch.H"
#include "wallFvPatch.H"

const Foam::Enum<int> Foam::m4gnNodeTypes::names({
    {M4GN_WALL, "wall"},
    {M4GN_INLET, "inlet"},
    {M4GN_OUTLET, "outlet"},
    {M4GN_SYMMETRY, "symmetry"},
    {M4GN_OBSTACLE, "obstacle"},
    {M4GN_HANDLE, "handle"},
    {M4GN_FREE, "free"},
});

namespace Foam
{
//- Does the displacement fix its value there? A condition whose library is not
//  loaded, as in post-processing, does not know: its name does.
static bool fixes(const fvPatchVectorField& pD)
{
    if (pD.type() != "generic") {
        return pD.fixesValue();
    }

    OStringStream os;
    pD.write(os);
    IStringStream is(os.str());
    const word actual(dictionary(is).get<word>("type"));

    if (actual.ends_with("ZeroShear") || actual == "displacementOrTraction") {
        // A directionMixed one
        return true;
    }
    const bool free = actual.find("raction") != string::npos || actual.find("ontact") != string::npos
                      || actual.find("orce") != string::npos;

    if (!free && !actual.starts_with("fixed") && !actual.ends_with("Displacement")) {
        FatalErrorInFunction << "Whether the condition " << actual << " at patch " << pD.patch().name()
                             << " fixes the displacement is not known: its"
                             << " library is not loaded." << nl
                             << "    Load it (libs in controlDict), or give nodeTypes { " << pD.patch().name()
                             << " free; } or handle" << exit(FatalError);
    }

    return !free;
}

//- Has the field boundary conditions, and not computed values alone?
static bool conditioned(const volVectorField& field)
{
    for (const fvPatchVectorField& patch : field.boundaryField()) {
        if (!polyPatch::constraintType(patch.patch().type())
            && patch.type() != calculatedFvPatchVectorField::typeName)
        {
            return true;
        }
    }

    return false;
}

//- Does it hold its value or let go of it, as the flow goes?
static bool isMixed(const fvPatchVectorField& pU)
{
    return isA<mixedFvPatchVectorField>(pU) || isA<directionMixedFvPatchVectorField>(pU);
}

//- Does the flow leave through the patch (1), enter (-1), or neither (0)?
//  Collective.
static label through(const fvPatchVectorField& pU, const surfaceScalarField* phi)
{
    const fvPatch& patch = pU.patch();
    const scalarField flux(
        phi ? scalarField(phi->boundaryField()[patch.index()]) : scalarField(pU & patch.Sf()));
    const scalar net = gSum(flux);
    const scalar size = gSum(mag(flux)());

    return mag(net) <= 0.01 * size ? 0 : net > 0 ? 1 : -1;
}

} // End namespace Foam

Foam::label Foam::m4gnNodeTypes::guess(
    const fvPatch& patch, const volVectorField* U, const volScalarField* p, const volVectorField* D,
    const surfaceScalarField* phi, string& why)
{
    const bool symmetric = isA<symmetryFvPatch>(patch) || isA<symmetryPlaneFvPatch>(patch);

    why = "patch type " + patch.type();

    if (D) {
        why = symmetric ? why : string(D->name() + ' ' + D->boundaryField()[patch.index()].type());

        return symmetric ? M4GN_SYMMETRY : fixes(D->boundaryField()[patch.index()]) ? M4GN_HANDLE : M4GN_FREE;
    }

    if (isA<wallFvPatch>(patch)) {
        return M4GN_WALL;
    }

    if (symmetric) {
        return M4GN_SYMMETRY;
    }

    if (U) {
        const fvPatchVectorField& pU = U->boundaryField()[patch.index()];
        why = U->name() + ' ' + pU.type();

        if (pU.type() == "noSlip") {
            return M4GN_WALL;
        }
        if (isA<slipFvPatchVectorField>(pU)) {
            return M4GN_SYMMETRY;
        }
        if (isMixed(pU)) {
            const label direction = through(pU, phi);
            if (direction) {
                why += direction > 0 ? ", flow leaves" : ", flow enters";
                return direction > 0 ? M4GN_OUTLET : M4GN_INLET;
            }

            why += ", nothing flows yet";
            if (pU.type().find("nletOutlet") != string::npos) {
                return M4GN_OUTLET;
            }
        } else if (pU.fixesValue()) {
            // Walls of meshes whose patches all have the type patch
            if (pU.type() == "fixedValue" && gMax(mag(pU)()) == 0) {
                why += " of zero";
                return M4GN_WALL;
            }
            return M4GN_INLET;
        }
    }

    if (p && p->boundaryField()[patch.index()].fixesValue()) {
        why += ", " + p->name() + ' ' + p->boundaryField()[patch.index()].type();
        return M4GN_OUTLET;
    }
    return -1;
}

Foam::m4gnNodeTypes::m4gnNodeTypes(
    const fvMesh& mesh, const dictionary& dict, const word& velocityName, const word& pressureName,
    const word& displacementName)
    : types_(mesh.boundary().size(), -1), why_(mesh.boundary().size())
{
    const dictionary entries(dict.subOrEmptyDict("nodeTypes"));
    wordHashSet unused(entries.toc());

    autoPtr<volVectorField> storedU;
    autoPtr<volScalarField> storedP;
    const volVectorField* U = m4gnNodes::find(mesh, velocityName, storedU);
    const volScalarField* p = m4gnNodes::find(mesh, pressureName, storedP);

    // solids4foam registers a velocity and a pressure as well
    autoPtr<volVectorField> storedD;
    const volVectorField* D = m4gnNodes::find(mesh, displacementName, storedD);

    // solids4foam's incremental models have the conditions at the increment
    autoPtr<volVectorField> storedDD;
    const volVectorField* DD =
        D && !conditioned(*D) ? m4gnNodes::find(mesh, "D" + displacementName, storedDD) : nullptr;
    if (DD && conditioned(*DD)) {
        D = DD;
    }

    autoPtr<surfaceScalarField> storedPhi;
    const surfaceScalarField* phi = m4gnNodes::find(mesh, dict.getOrDefault<word>("phi", "phi"), storedPhi);

    forAll(mesh.boundary(), patchi) {
        const fvPatch& patch = mesh.boundary()[patchi];

        if (!carriesValues(patch)) {
            continue;
        }

        // A name goes before a group, and a group before what is guessed
        wordList keys(1, patch.name());
        keys.append(patch.patch().inGroups());

        label& type = types_[patchi];

        for (const word& key : keys) {
            const entry* e = entries.findEntry(key, keyType::REGEX);

            if (e) {
                unused.erase(e->keyword());

                const word value(entries.get<word>(key));

                if (!names.found(value)) {
                    FatalErrorInFunction
                        << dict.name() << ": nodeTypes gives patch " << patch.name() << " the type " << value
                        << nl << "    Valid types: " << m4gn::join(names.sortedToc()) << exit(FatalError);
                }
                type = names.get(value);
                why_[patchi] = "entry nodeTypes";
                break;
            }
        }

        if (type < 0) {
            type = guess(patch, U, p, D, phi, why_[patchi]);
        }

        if (type < 0 && !handles(patch)) {
            // No node type helps
            refuse(patch);
        }
        if (type < 0) {
            FatalErrorInFunction << dict.name() << ": what is patch " << patch.name() << " (type "
                                 << patch.type() << ")? Neither does " << velocityName
                                 << " fix its value there (inlet) nor " << pressureName
                                 << " (outlet). Found: " << why_[patchi].c_str() << nl
                                 << "    Say so in the function object's dictionary,"
                                 << " nodeTypes { " << patch.name() << " outlet; }, or to 'm4gn"
                                 << " segment', --node-type " << patch.name() << "=outlet" << nl
                                 << "    Valid types: " << m4gn::join(names.sortedToc()) << exit(FatalError);
        }
    }

    if (unused.size()) {
        FatalErrorInFunction << dict.name() << ": nodeTypes has entries that fit no patch with values and no"
                             << " group of such patches: " << m4gn::join(unused.sortedToc()) << nl
                             << "    Patches: " << m4gn::join(mesh.boundaryMesh().names())
                             << exit(FatalError);
    }
}

bool Foam::m4gnNodeTypes::handles(const fvPatch& patch)
{
    static const wordList types({"patch", "wall", "symmetry", "symmetryPlane"});

    return types.found(patch.type());
}

void Foam::m4gnNodeTypes::refuse(const fvPatch& patch)
{
    FatalErrorInFunction << "Patch " << patch.name() << " is of type " << patch.type()
                         << ", which m4gn does not handle." << nl
                         << "    Handled: patch, wall, symmetry, symmetryPlane, empty,"
                         << " cyclic (translational), processor, processorCyclic." << exit(FatalError);
}

void Foam::m4gnNodeTypes::print(const fvMesh& mesh) const
{
    Info << "m4gn: node types of the patches" << nl;

    forAll(types_, patchi) {
        if (types_[patchi] >= 0) {
            Info << "    " << mesh.boundary()[patchi].name() << ": " << names[types_[patchi]] << " ("
                 << why_[patchi].c_str() << ')' << nl;
        }
    }

    Info << endl;
}

bool Foam::m4gnNodeTypes::carriesValues(const fvPatch& patch)
{
    return !patch.coupled() && !isA<emptyFvPatch>(patch);
}
