// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnHandOver.H"
#include "m4gnDictionary.H"
#include "m4gnCaseChecks.H"
#include "m4gnMechanicalProperties.H"
#include "m4gnPrescribed.H"
#include "StringStream.H"
#include "cloud.H"
#include "pointFields.H"
#include "surfaceFields.H"
#include "Time.H"
#include "volFields.H"

namespace
{
using namespace Foam;

//- Has a boundary patch of the field values that are computed, and no others?
bool computed(const volScalarField& field)
{
    bool some = false;
    for (const fvPatchScalarField& patch : field.boundaryField()) {
        if (!polyPatch::constraintType(patch.patch().type())) {
            if (patch.type() != calculatedFvPatchScalarField::typeName) {
                return false;
            }
            some = true;
        }
    }
    return some;
}

//- Does a source begin or end between the start and the end of the run?
bool isForAWhile(const dictionary& dict, const Time& time, const word& beginName = "timeStart")
{
    const scalar begin = dict.getOrDefault<scalar>(beginName, -1);
    const scalar end = begin + dict.getOrDefault<scalar>("duration", 0);
    const scalar from = time.startTime().value();
    // With another stopAt Time has no end
    const scalar to = time.stopAt() == Time::stopAtControls::saEndTime
                          ? time.endTime().value()
                          : time.controlDict().getOrDefault<scalar>("endTime", VGREAT);
    // One that has ended before, or begins after, does not act in this run
    return begin >= 0 && begin < to && end > from && (begin > from || end < to);
}

//- Names that function objects of a type have in an entry
wordList namedBy(const Time& time, const word& type, const word& key, const word& usual)
{
    DynamicList<word> names;
    if (const dictionary* functions = time.controlDict().findDict("functions")) {
        for (const entry& e : *functions) {
            if (e.isDict() && e.dict().getOrDefault<word>("type", word::null) == type) {
                names.append(e.dict().getOrDefault<word>(key, usual));
            }
        }
    }
    return wordList(names);
}

//- Meshes on which somebody solves, this one among them
wordHashSet solvedMeshes(const fvMesh& mesh)
{
    wordHashSet meshes(mesh.time().names<fvMesh>());
    // That of solids4foam's vertex-centred models has no state of its own, but for the history of laws
    meshes.erase("dualMesh");
    // Nobody solves on a mesh that fields are mapped to
    meshes -= wordHashSet(namedBy(mesh.time(), "mapFields", "mapRegion", word::null));
    return meshes;
}

//- Particles that the solver moves, for people; empty: there are none. Those of a function object are its business.
string particles(const fvMesh& mesh)
{
    wordHashSet clouds(mesh.names<cloud>());
    const word usual("kinematicCloud");
    clouds -= wordHashSet(namedBy(mesh.time(), "icoUncoupledKinematicCloud", usual, usual));
    const word names(m4gn::join(clouds.sortedToc()));

    return clouds.empty() ? string() : string("particles go with the flow (" + names + ')');
}

} // End anonymous namespace

Foam::string Foam::m4gn::notHandedOver(
    const fvMesh& mesh, const word& UName, const word& pName, const word& phiName)
{
    const string moved(particles(mesh));
    if (moved.size()) {
        return moved;
    }

    OStringStream why;
    const auto* U = mesh.findObject<volVectorField>(UName);
    const auto* phi = mesh.findObject<surfaceScalarField>(phiName);
    if (U && phi && phi->dimensions() != U->dimensions() * dimArea) {
        why << "the flux " << phiName << " has the dimensions " << phi->dimensions()
            << "; expected a volumetric flux " << U->dimensions() * dimArea << " (incompressible solvers)";
        return why.str();
    }

    const auto* p = mesh.findObject<volScalarField>(pName);
    if (p && phi && p->dimensions() == dimPressure) {
        why << "the pressure " << pName << " is not divided by the density: several phases, or a"
            << " density that varies, go with this flow (interFoam), and their state is none of"
            << " the surrogate's";
        return why.str();
    }
    if (p && phi && pName != "p_rgh" && computed(*p) && mesh.foundObject<volScalarField>("p_rgh")) {
        why << "the pressure " << pName << " has no boundary conditions of its own, the solver"
            << " solves for p_rgh: give p p_rgh; and a model that predicts p_rgh";
        return why.str();
    }

    return string();
}

Foam::wordList Foam::m4gn::otherMeshes(const fvMesh& mesh)
{
    // Those of solids4foam's materials too: their interface goes on from its last displacement
    wordHashSet others(solvedMeshes(mesh));
    others.erase(mesh.name());
    return others.sortedToc();
}

Foam::string Foam::m4gn::unsupported(const fvMesh& mesh)
{
    OStringStream why;

    const wordHashSet meshes(solvedMeshes(mesh));
    if (meshes.size() > 1) {
        why << "there are several meshes (" << join(meshes.sortedToc()).c_str() << "), which go on in step";
        return why.str();
    }
    if (meshFollowsBody(mesh)) {
        return "the mesh moves with the body (solidModel " + solidModel(mesh) + ')';
    }
    if (mesh.time().foundObject<fvMesh>("dualMesh")) {
        const wordList laws(m4gnMechanicalProperties(mesh).lawsWithHistory());
        if (laws.size()) {
            why << "the history of " << join(laws).c_str() << " is kept at the faces of dualMesh";
            return why.str();
        }
    }
    const string moved(particles(mesh));
    if (moved.size()) {
        return moved;
    }
    for (const word& name : mesh.sortedNames<volScalarField>()) {
        if (name.starts_with("alpha.")) {
            why << "there are several phases (" << name << ")";
            return why.str();
        }
    }
    const wordHashSet contacts({"solidContact", "solidRigidContact", "pointSolidContact"});
    const auto touches = [&](const auto& field) {
        for (const auto& patch : field.boundaryField()) {
            if (contacts.found(patch.type())) {
                why << patch.type() << " at the patch " << patch.patch().name()
                    << " relaxes tractions that are no fields";
                return true;
            }
        }
        return false;
    };
    for (const word& name : mesh.sortedNames<volVectorField>()) {
        if (touches(mesh.lookupObject<volVectorField>(name))) {
            return why.str();
        }
    }
    for (const word& name : mesh.sortedNames<pointVectorField>()) {
        if (touches(mesh.lookupObject<pointVectorField>(name))) {
            return why.str();
        }
    }
    const wordHashSet handled({"pointScalarField", "pointVectorField"});
    for (const word& name : mesh.sortedNames()) {
        const auto* object = mesh.findObject<regIOobject>(name);
        const word kind(object ? object->type() : word::null);
        if (((kind.starts_with("point") && !handled.found(kind)) || kind.starts_with("area")
             || kind.starts_with("edge"))
            && kind.ends_with("Field") && object->readOpt() != IOobject::NO_READ
            && object->writeOpt() == IOobject::AUTO_WRITE)
        {
            why << "the field " << name << " is a " << kind
                << "; expected fields of cells and of faces, scalars and vectors of points";
            return why.str();
        }
    }
    if (const auto* dict = mesh.findObject<dictionary>("fvOptions")) {
        for (const entry& e : *dict) {
            if (!e.isDict() || !e.dict().getOrDefault<bool>("active", true)) {
                continue;
            }
            bool timed = isForAWhile(e.dict(), mesh.time());
            for (const entry& own : e.dict()) {
                timed = timed || (own.isDict() && isForAWhile(own.dict(), mesh.time()));
            }
            if (timed) {
                why << "the source " << e.keyword()
                    << " of fvOptions begins or ends in the run (timeStart, duration)";
                return why.str();
            }
        }
    }
    const auto* combustion = mesh.findObject<dictionary>("combustionProperties");
    if (combustion && combustion->getOrDefault<bool>("ignite", false)) {
        for (const dictionary& site : List<dictionary>(combustion->lookup("ignitionSites"))) {
            if (isForAWhile(site, mesh.time(), "start")) {
                return "one of the ignitionSites of combustionProperties begins or ends in the run"
                       " (start, duration)";
            }
        }
    }
    return string();
}

Foam::string Foam::m4gn::changingSources(const fvMesh& mesh)
{
    const auto asksForTime = [](const dictionary& dict) {
        // The sun goes round: sunDirTracking, tracking in later versions
        if (dict.getOrDefault<word>("sunDirectionModel", word::null).ends_with("racking")) {
            return true;
        }
        for (const entry& e : dict) {
            OStringStream code;
            if (e.isStream() && e.keyword().starts_with("code")) {
                for (const token& t : e.stream()) {
                    code << t;
                }
            }
            const std::string text(code.str());
            if (text.find("time()") != std::string::npos || text.find("deltaT") != std::string::npos) {
                return true;
            }
        }
        return false;
    };
    // Functions of a flow rate or of a temperature
    static const wordHashSet others({"fanMomentumSource", "jouleHeatingSource"});
    for (const word file : {"fvOptions", "MRFProperties", "porosityProperties", "radiationProperties"}) {
        const auto* dict = mesh.findObject<dictionary>(file);
        for (const entry& e : dict ? *dict : dictionary()) {
            if (!e.isDict() || !e.dict().getOrDefault<bool>("active", true)) {
                continue;
            }
            const word type(e.dict().getOrDefault<word>("type", word::null));
            bool changes = (m4gnPrescribed::hasFunction(e.dict()) && !others.found(type))
                           || asksForTime(e.dict()) || type.starts_with("tabulated");
            for (const entry& own : e.dict()) {
                changes = changes || (own.isDict() && asksForTime(own.dict()));
            }
            if (changes) {
                return string(e.keyword() + " of " + file);
            }
        }
    }
    const word model(solidModel(mesh));
    const auto* solid = model.empty() ? nullptr : mesh.time().findObject<IOdictionary>("solidProperties");
    if (solid
        && m4gnPrescribed::hasFunction(
            solid->subOrEmptyDict(model + "Coeffs").subOrEmptyDict("cellDisplacements")))
    {
        return "cellDisplacements of solidProperties";
    }
    return string();
}

Foam::label Foam::m4gn::oldLevels(const fvMesh& mesh)
{
    label levels = 0;
    for (const word group : {"ddtSchemes", "d2dt2Schemes"}) {
        const wordHashSet handled(
            group == "ddtSchemes" ? wordHashSet({"Euler", "backward", "CrankNicolson", "NewmarkBeta", "none"})
                                  : wordHashSet({"Euler", "NewmarkBeta", "steadyState", "none"}));

        for (const entry& e : mesh.schemesDict().subOrEmptyDict(group)) {
            const word used(m4gn::scheme(mesh.schemesDict(), group, e.keyword()));

            if (!handled.found(used)) {
                FatalErrorInFunction << "The dmd surrogate does not handle the time scheme " << used << " of "
                                     << group << " (" << e.keyword() << ')' << nl
                                     << "    Handled: " << m4gn::join(handled.sortedToc())
                                     << exit(FatalError);
            }
            // solids4foam's models of increments go on from two levels of the displacement
            const bool second = group == "d2dt2Schemes" && used == "Euler";
            levels = max(levels, label(second ? 2 : used == "backward" || used == "CrankNicolson"));
        }
    }
    return levels;
}

Foam::string Foam::m4gn::sources(const fvMesh& mesh)
{
    DynamicList<word> names;
    for (const word file : {"fvOptions", "MRFProperties"}) {
        const auto* dict = mesh.findObject<dictionary>(file);
        if (!dict) {
            continue;
        }
        for (const entry& e : *dict) {
            if (e.isDict() && e.keyword() != "FoamFile" && e.dict().getOrDefault<bool>("active", true)) {
                names.append(word(file + ' ' + e.keyword(), false));
            }
        }
    }
    return names.empty() ? string() : string(join(wordList(names)));
}
