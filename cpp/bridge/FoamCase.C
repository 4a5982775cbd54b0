// SPDX-License-Identifier: GPL-3.0-or-later
// Opening a case, its description and its mesh.

#include "FoamData.H"

#include "emptyPolyPatch.H"
#include "m4gnDictionary.H"
#include "messageStream.H"

#include <string>
#include <vector>

namespace
{
std::string text(rust::Str s) { return std::string(s.data(), s.size()); }

// OpenFOAM prints progress on the standard output, which belongs to the command line; errors are thrown.
void be_a_library()
{
    Foam::FatalError.throwExceptions();
    Foam::FatalIOError.throwExceptions();
    Foam::messageStream::level = 0;
}

Foam::fileName control_dict(const Foam::fileName& path)
{
    return path / "system" / Foam::Time::controlDictName;
}

// Stored times without "constant".
Foam::instantList stored(const Foam::Time& time)
{
    Foam::instantList all(time.times());
    Foam::instantList result(all.size());
    Foam::label n = 0;
    for (const Foam::instant& t : all) {
        if (t.name() != time.constant()) {
            result[n++] = t;
        }
    }
    result.resize(n);
    return result;
}

Foam::label processor_folders(const Foam::fileName& path)
{
    Foam::label n = 0;
    while (Foam::isDir(path / ("processor" + Foam::name(n)))) {
        ++n;
    }
    return n;
}

} // End anonymous namespace

m4gn::FoamCase::Data::Data(const Foam::fileName& path)
    : path(path), time(
                      Foam::Time::controlDictName, path.path(), path.name(), "system", "constant",
                      false, // function objects belong to the solver's run
                      true   // user libraries may hold boundary conditions
                  )
{
    times = stored(time);
    const Foam::label n = processor_folders(path);
    if (n > 0) {
        for (Foam::label proc = 0; proc < n; ++proc) {
            databases.append(new Foam::Time(
                Foam::Time::controlDictName, path.path(), path.name() / ("processor" + Foam::name(proc)),
                "system", "constant", false, false));
        }
        const Foam::instantList distributed(stored(databases[0]));
        // Solvers in parallel write to the processor folders only; after reconstructPar both hold the same times.
        if (distributed.size() && (times.empty() || distributed.last().value() > times.last().value())) {
            times = distributed;
        } else {
            databases.clear();
        }
    }
    mesh.reset(new Foam::fvMesh(
        Foam::IOobject(Foam::fvMesh::defaultRegion, time.constant(), time, Foam::IOobject::MUST_READ)));
    if (databases.size()) {
        processors.reset(new Foam::processorMeshes(databases, Foam::fvMesh::defaultRegion));
        reconstructor.reset(new Foam::fvFieldReconstructor(
            *mesh, processors->meshes(), processors->faceProcAddressing(), processors->cellProcAddressing(),
            processors->boundaryProcAddressing()));
    }
}

void m4gn::FoamCase::Data::set_time(std::size_t index)
{
    if (index >= std::size_t(times.size())) {
        FatalErrorInFunction << "time index " << Foam::label(index) << " of " << path << ": there are "
                             << times.size() << " times" << Foam::exit(Foam::FatalError);
    }
    const Foam::label i = Foam::label(index);
    time.setTime(times[i], i);
    forAll(databases, proc) {
        databases[proc].setTime(times[i], i);
    }
    if (current != i) {
        forget();
        current = i;
    }
}

void m4gn::FoamCase::Data::forget()
{
    scalars.clear();
    vectors.clear();
    symmTensors.clear();
    tensors.clear();
    current = -1;
}

const Foam::polyPatch& m4gn::FoamCase::Data::patch(rust::Str name) const
{
    const Foam::polyBoundaryMesh& patches = mesh->boundaryMesh();
    const Foam::label i = patches.findPatchID(text(name));
    if (i < 0) {
        FatalErrorInFunction << "patch " << text(name).c_str() << " is not in " << path
                             << ": its patches are " << patches.names() << Foam::exit(Foam::FatalError);
    }
    return patches[i];
}

m4gn::FoamCase::FoamCase(const std::string& path)
{
    Foam::fileName folder(path);
    folder.toAbsolute();
    folder.clean();
    if (!Foam::isFile(control_dict(folder))) {
        FatalErrorInFunction << folder << " is not an OpenFOAM case: " << control_dict(folder)
                             << " does not exist" << Foam::exit(Foam::FatalError);
    }
    if (Foam::isFile(folder / "constant" / "regionProperties")) {
        FatalErrorInFunction << folder << " is a case of regions (constant/regionProperties):"
                             << " expected a case of one mesh" << Foam::exit(Foam::FatalError);
    }
    if (!Foam::isFile(folder / "constant" / "polyMesh" / "faces")) {
        FatalErrorInFunction
            << folder << " has no mesh: " << folder / "constant" / "polyMesh" / "faces"
            << " does not exist."
            << " Make the mesh, or for a case that was decomposed elsewhere type reconstructParMesh"
            << Foam::exit(Foam::FatalError);
    }
    data_.reset(new Data(folder));
}

m4gn::FoamCase::~FoamCase() = default;

std::unique_ptr<m4gn::FoamCase> m4gn::open_case(rust::Str path)
{
    be_a_library();
    return std::unique_ptr<FoamCase>(new FoamCase(text(path)));
}

rust::String m4gn::FoamCase::describe() const
{
    using Foam::m4gn::quoted;
    using Foam::m4gn::text;

    const auto list = [](const auto& values, const auto& item) {
        std::string all;
        for (const auto& value : values) {
            all += (all.empty() ? "" : ", ") + item(value);
        }
        return '[' + all + ']';
    };
    const auto vector = [&](const Foam::vector& v) {
        return '[' + text(v[0]) + ", " + text(v[1]) + ", " + text(v[2]) + ']';
    };
    const auto patch = [&](const Foam::polyPatch& p) {
        const Foam::boundBox box(p.localPoints(), false);
        const Foam::vector none(Foam::Zero);
        return "{\"name\": " + quoted(p.name()) + ", \"kind\": " + quoted(p.type())
               + ", \"lower\": " + vector(p.size() ? box.min() : none)
               + ", \"upper\": " + vector(p.size() ? box.max() : none) + '}';
    };

    const Foam::fvMesh& mesh = *data_->mesh;
    const Foam::dictionary& control = data_->time.controlDict();
    std::vector<int> directions;
    for (int d = 0; d < 3; ++d) {
        if (mesh.solutionD()[d] == 1) {
            directions.push_back(d);
        }
    }
    // Those of a list, without names, have no tables of their own
    const Foam::dictionary functions(control.subOrEmptyDict("functions"));
    Foam::DynamicList<const Foam::dictionary*> objects;
    for (const Foam::entry& e : functions) {
        if (e.isDict() && e.dict().found("type")) {
            objects.append(&e.dict());
        }
    }
    const auto object = [&](const Foam::dictionary* dict) {
        const Foam::word type(dict->lookupOrDefault<Foam::word>("type", Foam::word::null));
        Foam::labelHashSet patches;
        std::string density("null");
        // Other types have entries of these names that are something else
        if (type == "forceCoeffs" || type == "forces") {
            patches = mesh.boundaryMesh().patchSet(Foam::wordReList(dict->lookup("patches")));
            if (dict->lookupOrDefault<Foam::word>("rho", "rho") == "rhoInf") {
                density = text(dict->lookupOrDefault<Foam::scalar>("rhoInf", 1));
            }
        }
        const auto named = [&](const Foam::label patchi) {
            return quoted(mesh.boundaryMesh()[patchi].name());
        };
        return "{\"name\": " + quoted(dict->dictName()) + ", \"type\": " + quoted(type)
               + ", \"patches\": " + list(patches.sortedToc(), named) + ", \"density\": " + density + '}';
    };
    const auto application = control.lookupOrDefault<Foam::word>("application", Foam::word::null);

    return rust::String(
        "{\"path\": " + quoted(data_->path) + ", \"application\": " + quoted(application)
        + ", \"delta_t\": " + text(control.lookupOrDefault<Foam::scalar>("deltaT", 0)) + ", \"processors\": "
        + std::to_string(data_->databases.size()) + ", \"start\": " + quoted(data_->start_name())
        + ", \"function_object\": " + Foam::m4gn::json(data_->function_object())
        + ", \"functions\": " + list(objects, object)
        + ", \"times\": " + list(data_->times, [](const Foam::instant& t) { return text(t.value()); })
        + ", \"cells\": " + std::to_string(mesh.nCells())
        + ", \"directions\": " + list(directions, [](const int d) { return std::to_string(d); })
        + ", \"patches\": " + list(mesh.boundaryMesh(), patch) + '}');
}

rust::Vec<double> m4gn::FoamCase::cell_centres() const { return flat(data_->mesh->cellCentres()); }

rust::Vec<double> m4gn::FoamCase::polygons() const
{
    const Foam::fvMesh& mesh = *data_->mesh;
    const Foam::Vector<Foam::label>& solved = mesh.solutionD();
    Foam::label flat = -1, axes[2] = {0, 0}, n_axes = 0;
    for (Foam::direction d = 0; d < 3; ++d) {
        if (solved[d] != 1) {
            flat = d;
        } else if (n_axes < 2) {
            axes[n_axes++] = d;
        }
    }
    rust::Vec<double> result;
    if (mesh.nSolutionD() != 2) {
        return result;
    }

    Foam::labelList face_of_cell(mesh.nCells(), -1);
    for (const Foam::polyPatch& patch : mesh.boundaryMesh()) {
        if (!Foam::isA<Foam::emptyPolyPatch>(patch)) {
            continue;
        }
        forAll(patch, i) {
            if (patch.faceAreas()[i][flat] > 0) {
                face_of_cell[patch.faceCells()[i]] = patch.start() + i;
            }
        }
    }
    Foam::label start = 0;
    result.push_back(start);
    for (const Foam::label face : face_of_cell) {
        start += face >= 0 ? mesh.faces()[face].size() : 0;
        result.push_back(start);
    }
    for (const Foam::label face : face_of_cell) {
        if (face < 0) {
            continue;
        }
        for (const Foam::label point : mesh.faces()[face]) {
            for (const Foam::label axis : axes) {
                result.push_back(mesh.points()[point][axis]);
            }
        }
    }
    return result;
}
