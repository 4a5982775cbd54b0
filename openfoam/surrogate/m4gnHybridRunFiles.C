// SPDX-License-Identifier: GPL-3.0-or-later

// The run's files: what a run is carried on from, tables, totals, fields of errors; and its log

#include "m4gnHybridRun.H"
#include "m4gnClockwork.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnFieldFiles.H"
#include "m4gnNodeTypes.H"
#include "m4gnSegmentField.H"
#include "m4gnCaseChecks.H"
#include "m4gnVersion.H"
#include "OSspecific.H"
#include "StringStream.H"
#include "Time.H"
#include "writeFile.H"

#include <cstring>

std::string Foam::m4gnHybridRun::types() const
{
    const m4gn_mesh_data& data = session_->nodes().data();
    labelList types(mesh_.boundaryMesh().nNonProcessor(), -1);
    for (label facei = 0; facei < data.n_boundary; ++facei) {
        const word name(data.patch_names[data.boundary_patch[facei]]);
        types[mesh_.boundaryMesh().findPatchID(name)] = data.boundary_type[facei];
    }
    Pstream::listCombineGather(types, maxEqOp<label>());

    std::string text;
    forAll(types, patchi) {
        if (types[patchi] >= 0) {
            text += m4gn::quoted(mesh_.boundaryMesh()[patchi].name()) + ' '
                    + m4gnNodeTypes::names.get(types[patchi]) + "; ";
        }
    }
    return text;
}

void Foam::m4gnHybridRun::listen()
{
    static const std::pair<int32_t, const char*> files[] = {
        {M4GN_RIDE_JUMPS, "surrogate"},
        {M4GN_RIDE_STRIDES, "strides"},
        {M4GN_RIDE_ERRORS, "surrogateError"},
        {M4GN_RIDE_SEGMENT_ERRORS, "surrogateSegmentError"},
        {M4GN_RIDE_MODES, "modes"}};

    for (label i = 0; i < tables_.size(); ++i) {
        const std::string rows(m4gn_ride_text(ride_, files[i].first));
        if (rows.size()) {
            if (!tables_.set(i)) {
                // In the folder of the run's start, whatever Time counts from now
                scalar& counted = m4gnClockwork::start(const_cast<Time&>(mesh_.time()));
                const scalar later = counted;
                counted = start_;
                tables_.set(i, new functionObjects::writeFile(mesh_, name_, files[i].second, dict_));
                counted = later;
            }
            if (Pstream::master() && tables_[i].writeToFile()) {
                tables_[i].file() << rows.c_str() << flush;
            }
        }
    }

    const std::string text(m4gn_ride_text(ride_, M4GN_RIDE_LOG));
    if (text.size()) {
        Info << text.c_str() << flush;
    }

    std::string warning;
    while ((warning = m4gn_ride_text(ride_, M4GN_RIDE_WARNING)).size()) {
        WarningInFunction << warning.c_str() << endl;
    }
}

Foam::fileName Foam::m4gnHybridRun::stateFile(const word& name, const Time& time, const word& at)
{
    // A file handler that collates has the times of all ranks in one folder
    const fileName ranks(fileHandler().filePath(time.path() / at));

    return (ranks.empty() ? time.path() / at : ranks) / "uniform" / (name + ".state");
}

bool Foam::m4gnHybridRun::stored(const word& name, const Time& time)
{
    const fileName path(stateFile(name, time, time.timeName()));
    // What is no plain file is refused when it is taken up
    bool found = Pstream::master() && Foam::mode(path) != 0;
    reduce(found, orOp<bool>());
    return found;
}

Foam::dictionary Foam::m4gnHybridRun::storedTypes(const word& name, const Time& time)
{
    const fileName path(stateFile(name, time, time.timeName()));
    string text;
    if (Pstream::master()) {
        // What is damaged is refused when it is taken up. A text that fills its room is longer.
        List<char> room;
        do {
            room.resize(max(label(4096), 2 * room.size()), '\0');
        } while (m4gn_ride_host(path.c_str(), room.data(), room.size()) == M4GN_OK
                 && label(std::strlen(room.cdata())) == room.size() - 1);
        text = room.cdata();
    }
    m4gn::broadcast(text);

    IStringStream stream(text);
    return dictionary(stream);
}

void Foam::m4gnHybridRun::save()
{
    if (observes_) {
        return;
    }

    // The first rank writes when the fields of all ranks are there
    const fileName path(stateFile(name_, mesh_.time(), mesh_.time().timeName()));
    if (Pstream::master()) {
        mkDir(path.path());
    }
    returnReduce(true, andOp<bool>());
    m4gn::check(
        m4gn_ride_conditions(ride_, conditions_.now(state_.fields()).c_str()),
        "m4gnSurrogate cannot write its state");
    m4gn::check(m4gn_ride_save(ride_, path.c_str()), "m4gnSurrogate cannot write its state");
}

bool Foam::m4gnHybridRun::load(const std::string& conditions, m4gn_ride_answer& answer)
{
    m4gn::check(m4gn_ride_conditions(ride_, conditions.c_str()), "m4gnSurrogate cannot carry on");
    const m4gn_ride_step step(now());
    const fileName path(stateFile(name_, mesh_.time(), mesh_.time().timeName()));
    const std::vector<const double*> state(state_.gather());
    const int32_t status = m4gn_ride_load(ride_, path.c_str(), &step, state.data(), &answer);

    if (status == M4GN_ERROR_MODEL) {
        WarningInFunction << m4gn_last_error() << ": the schedule of " << name_ << " begins anew" << endl;
        return false;
    }
    m4gn::check(status, "m4gnSurrogate cannot carry on");
    listen();
    return true;
}

void Foam::m4gnHybridRun::end()
{
    const std::string summary(m4gn_ride_text(ride_, M4GN_RIDE_SUMMARY));
    listen();

    if (summary.empty() || !Pstream::master()) {
        return;
    }

    m4gnFieldFiles files;
    files.write(
        mesh_.time(), dir_ / "summary.json", [&](Ostream& os) { os << summary.c_str(); }, true);
    files.rename();
}

template <class Type>
void Foam::m4gnHybridRun::writeLike(
    const word& like, const word& name, const std::string& note,
    const std::function<int32_t(double*)>& values) const
{
    tmp<GeometricField<Type, fvPatchField, volMesh>> tfield(
        m4gn::cellField<Type>(mesh_, name, mesh_.time().timeName()));
    auto& field = tfield.ref();

    if (values(reinterpret_cast<scalar*>(field.primitiveFieldRef().data())) != M4GN_OK) {
        return;
    }
    field.correctBoundaryConditions();
    field.dimensions().reset(
        mesh_.lookupObject<GeometricField<Type, fvPatchField, volMesh>>(like).dimensions());
    field.note() = note;
    field.write();
}

void Foam::m4gnHybridRun::writeParts(const label surrogatei, const label nWaves) const
{
    for (size_t arrayi = 0; arrayi < state_.arrays().size(); ++arrayi) {
        const m4gn_array& array = state_.arrays()[arrayi];
        // Those of points are no fields of cells
        const bool measured = array.role == M4GN_SOLVED || array.role == M4GN_FOLLOWS;
        if (!measured || array.place != M4GN_CELLS) {
            continue;
        }
        const word name(array.name);
        const word of(kinds_.size() > 1 ? word(kinds_[surrogatei] + ':' + name, false) : name);
        const auto write = [&](const word& what, const std::string& note,
                               const std::function<int32_t(double*)>& values) {
            const word field(what + '(' + of + ')', false);
            array.components == 1 ? writeLike<scalar>(name, field, note, values)
                                  : writeLike<vector>(name, field, note, values);
        };

        if (observes_) {
            // What it does not advance, or has not been compared yet, is not written
            write(
                "error",
                "m4gn: the surrogate's " + name + " at time "
                    + std::string(m4gn_ride_text(ride_, M4GN_RIDE_DIFFERENCE_TIME)) + " minus the solver's",
                [&](double* to) { return m4gn_ride_difference(ride_, surrogatei, arrayi, to); });
        }
        for (label wavei = 0; wavei < nWaves; ++wavei) {
            const std::string wave("mode" + std::to_string(wavei + 1));
            const word names[] = {"modeMean", wave + "Real", wave + "Imaginary", "modeRms"};
            for (label part = wavei ? 1 : 0; part < (wavei ? 3 : 4); ++part) {
                write(names[part], "m4gn: of the fit in use", [&](double* to) {
                    return m4gn_ride_wave(ride_, surrogatei, wavei, part, arrayi, to);
                });
            }
        }
    }
}

void Foam::m4gnHybridRun::writeFields() const
{
    const dictionary dmd(dict_.subOrEmptyDict("dmd"));
    const label nWaves = observes_ ? 0 : dmd.getOrDefault<label>("writeModes", 0);

    if (mesh_.time().writeTime() && (nWaves || dict_.getOrDefault<bool>("writeErrors", false))) {
        forAll(kinds_, surrogatei) {
            writeParts(surrogatei, nWaves);
        }
    }
}
