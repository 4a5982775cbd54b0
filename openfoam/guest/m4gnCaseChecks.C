// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnCaseChecks.H"
#include "m4gnFunctionObjects.H"
#include "functionObject.H"
#include "fvMesh.H"
#include "HashSet.H"
#include "IOdictionary.H"
#include "OSspecific.H"
#include "Time.H"

#include <dlfcn.h>

#include <climits>
#include <cstdlib>

Foam::fileName Foam::m4gn::home()
{
    const fileName named(getEnv("M4GN_HOME"));

    // Beside the folder of this library
    Dl_info info;
    if (named.empty() && dladdr(reinterpret_cast<const void*>(&Foam::m4gn::home), &info) && info.dli_fname) {
        char path[PATH_MAX];
        return realpath(info.dli_fname, path) ? fileName(path).path().path() : fileName();
    }

    return named;
}

Foam::fileName Foam::m4gn::resolve(const fileName& path, const fileName& casePath)
{
    fileName expanded(path);
    expanded.expand();

    if (expanded.isAbsolute()) {
        return expanded;
    }

    const fileName inCase(casePath / expanded);

    if (isFile(inCase, false)) {
        return inCase;
    }

    const fileName home(m4gn::home());

    if (isFile(home / "models" / expanded, false)) {
        return home / "models" / expanded;
    }

    if (isFile(home / expanded, false)) {
        return home / expanded;
    }

    return inCase;
}

void Foam::m4gn::checkStatic(const polyMesh& mesh, const dictionary& dict)
{
    // dynamicMotionSolverFvMesh, dynamicRefineFvMesh, solidBodyMotionFvMesh,
    // movingConeTopoFvMesh ...: their base class is in a library of its own
    const word& type = mesh.type();

    if (type.starts_with("dynamic") || type.find("Motion") != std::string::npos
        || type.find("Topo") != std::string::npos)
    {
        FatalIOErrorInFunction(dict) << "The mesh is a " << type << ", which moves or changes;"
                                     << " recordings and surrogates have one mesh" << nl
                                     << "    Remove the function object " << dict.dictName()
                                     << ", or run on a static mesh" << exit(FatalIOError);
    }
}

void Foam::m4gn::refuseChange(const functionObject& object, const char* what)
{
    FatalErrorInFunction << "Function object " << object.name() << " of type " << object.type()
                         << ": the mesh has changed, and " << what << " has one mesh" << nl
                         << "    Remove the function object, or run on a fixed mesh" << exit(FatalError);
}

void Foam::m4gn::refuseMotion(const functionObject& object, const fvMesh& mesh, const char* what)
{
    if (!meshFollowsBody(mesh)) {
        FatalErrorInFunction << "Function object " << object.name() << " of type " << object.type()
                             << ": the mesh has moved, and " << what << " has one mesh" << nl
                             << "    Remove the function object, or run on a fixed mesh" << exit(FatalError);
    }
}

Foam::word Foam::m4gn::solidModel(const fvMesh& mesh)
{
    // Beside a fluid its properties are registered for all meshes
    if (!mesh.time().foundObject<regIOobject>("solidModel_" + mesh.name())) {
        return word::null;
    }
    const auto* properties = mesh.time().findObject<IOdictionary>("solidProperties");

    return properties ? properties->getOrDefault<word>("solidModel", word::null) : word::null;
}

bool Foam::m4gn::meshFollowsBody(const fvMesh& mesh)
{
    // With gradients at faces too (uns)
    return solidModel(mesh).ends_with("GeometryUpdatedLagrangian");
}

bool Foam::m4gn::onStoredTimes(const functionObject& object)
{
    static wordHashSet told;

    if (functionObject::postProcess && told.insert(object.name())) {
        Info << "m4gn: " << object.name() << " does nothing on stored times: a " << object.type()
             << " needs a running solver" << nl << endl;
    }
    return functionObject::postProcess;
}

void Foam::m4gn::checkLast(const functionObject& object, const Time& time, const char* what, const word& type)
{
    const functionObjectList& all = time.functionObjects();

    for (label i = all.findObjectID(object.name()) + 1; i < all.size(); ++i) {
        if (type.empty() || m4gnFunctionObjects::typeOf(all[i], time) == type) {
            FatalErrorInFunction << "Function object " << all[i].name() << " comes after " << object.name()
                                 << " of type " << object.type() << ", and would look at " << what << nl
                                 << "    Have " << object.name()
                                 << (type.empty() ? " as the last one" : " behind it") << " in functions"
                                 << exit(FatalError);
        }
    }
}

Foam::fileName Foam::m4gn::outputDir(const word& name, const polyMesh& mesh)
{
    const Time& time = mesh.time();

    fileName dir(time.globalPath() / functionObject::outputPrefix);

    if (mesh.name() != polyMesh::defaultRegion) {
        dir /= mesh.name();
    }

    return dir / name / Time::timeName(time.startTime().value());
}
