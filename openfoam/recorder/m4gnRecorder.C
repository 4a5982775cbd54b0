// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRecorder.H"
#include "addToRunTimeSelectionTable.H"
#include "foamVersion.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnElasticModes.H"
#include "m4gnHandOver.H"
#include "m4gnMechanicalProperties.H"
#include "m4gnOwnFields.H"
#include "m4gnActiveSurrogate.H"
#include "m4gnCaseChecks.H"
#include "OSspecific.H"

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnRecorder, 0);
addToRunTimeSelectionTable(functionObject, m4gnRecorder, dictionary);
}
}

//- The name that a recording which was killed gets: the first of
//  NAME-killed.h5, NAME-killed-2.h5, ... that is free
static Foam::fileName nameOfKilled(const Foam::fileName& path)
{
    Foam::fileName name(path.lessExt() + "-killed.h5");
    for (Foam::label i = 2; Foam::isFile(name, false); ++i) {
        name = path.lessExt() + "-killed-" + Foam::name(i) + ".h5";
    }
    return name;
}

//- Modes of an elastic body that are recorded, twice as many as segments take
//  by default
static const Foam::label defaultModes = 12;

void Foam::functionObjects::m4gnRecorder::start()
{
    m4gn::checkAbi();
    checkSource();

    nodes_ = m4gnNodes::New(mesh_, dict_);
    values_.resize(fieldNames_.size());

    const string why(m4gn::notHandedOver(
        mesh_, dict_.getOrDefault<word>("U", "U"), dict_.getOrDefault<word>("p", "p"),
        dict_.getOrDefault<word>("phi", "phi")));
    if (why.size()) {
        WarningInFunction << "A model of this recording can be observed, and not take the"
                          << " solver's place (mode replace): " << why.c_str() << endl;
    }
}

void Foam::functionObjects::m4gnRecorder::open()
{
    std::vector<m4gn_field_info> recorded(values_.size(), m4gn_field_info{});
    forAll(fieldNames_, i) {
        const FixedList<int32_t, 7> exponents(values_[i].exponents(fieldNames_[i]));
        recorded[i].name = fieldNames_[i].c_str();
        recorded[i].components = values_[i].components;
        std::copy(exponents.begin(), exponents.end(), recorded[i].dimensions);
    }

    path_ = file_;
    if (path_.empty()) {
        path_ = m4gn::outputDir(name(), mesh_) / "trajectory.h5";
    }
    path_.expand();
    if (!path_.isAbsolute()) {
        path_ = time_.globalPath() / path_;
    }
    if (Pstream::master()) {
        mkDir(path_.path());
        if (file_.empty()) {
            tellOfKilled();
        }
    }

    // A run that was killed has left its recording beside the final name
    const bool killed = isFile(path_.path() / ('.' + path_.name() + ".partial"), false);
    const fileName remains(nameOfKilled(path_));

    const std::string settings(options(dict_, path_));

    // The recorder keeps what it needs of them
    autoPtr<m4gnElasticModes> modes;
    const label nModes = dict_.getOrDefault<label>("modes", defaultModes);
    if (nModes > 0 && m4gnElasticModes::wanted(mesh_, dict_)) {
        modes.reset(new m4gnElasticModes(mesh_, dict_, nModes));
        nodes_->setModes(modes->eigenvalues(), modes->cells());
    }
    m4gn::check(
        m4gn_recorder_new(
            m4gn::communicator(), &nodes_->data(), settings.c_str(), recorded.data(), recorded.size(),
            &recorder_),
        "m4gnRecorder cannot record");
    if (Pstream::master() && killed) {
        WarningInFunction << "An earlier recording of " << path_ << " was killed: "
                          << (isFile(remains, false) ? "its whole frames are kept in " + remains
                                                     : fileName("it had no whole frame, and nothing is kept"))
                          << endl;
    }
    nodes_->clearModes();

    Log << type() << ' ' << name() << ": recording " << m4gn::join(fieldNames_) << " to " << path_ << endl;
}

void Foam::functionObjects::m4gnRecorder::tellOfKilled() const
{
    const fileName runs(path_.path().path());
    for (const fileName& start : readDir(runs, fileName::DIRECTORY)) {
        const fileName killed(runs / start / ('.' + path_.name() + ".partial"));
        if (start != path_.path().name() && isFile(killed, false)) {
            WarningInFunction << "A run that was killed has left " << killed << nl << "    A run with file \""
                              << runs / start / path_.name() << "\" keeps its whole frames as ...-killed.h5"
                              << endl;
        }
    }
}

void Foam::functionObjects::m4gnRecorder::checkSource() const
{
    const scalar last = Foam::min(dict_.getOrDefault<scalar>("timeEnd", VGREAT), time_.endTime().value());
    const word replacer(postProcess ? word::null : m4gnActiveSurrogate::before(last));

    if (replacer.size()) {
        FatalErrorInFunction << "Function object " << name() << " would record states of the"
                             << " surrogate " << replacer << " as if they were the solver's" << nl
                             << "    Record a run without mode replace, or give " << name()
                             << " a timeEnd that is not later than the timeStart of " << replacer
                             << exit(FatalError);
    }
}

void Foam::functionObjects::m4gnRecorder::finish()
{
    const bool before = finished_;
    finished_ = true;
    if (!recorder_) {
        if (!before) {
            Info << "m4gn: " << name() << " has recorded no frame and leaves no file: none of its times"
                 << " (writeControl, writeInterval, timeStart, timeEnd) was in the run" << nl << endl;
        }
        return;
    }

    const label nFrames = m4gn_recorder_n_frames(recorder_);
    m4gn::check(m4gn_recorder_finish(recorder_), "m4gnRecorder cannot finish");
    Log << type() << ' ' << name() << ": " << nFrames << " frames in " << path_ << nl << endl;

    m4gn_recorder_free(recorder_);
    recorder_ = nullptr;
}

Foam::wordList Foam::functionObjects::m4gnRecorder::ownKeys()
{
    wordList keys({"fields", "file", "nodeTypes", "U", "p", "phi", "D", "modes"});
    keys.append(m4gnElasticModes::keys());
    return keys;
}

std::string Foam::functionObjects::m4gnRecorder::options(const dictionary& dict, const fileName& path) const
{
    dictionary settings(m4gn::without(dict, m4gn::commonKeys()));
    settings = m4gn::without(settings, ownKeys());
    settings.set("path", string(path));
    settings.set("provenance", provenance(dict));
    return m4gn::json(settings);
}

Foam::dictionary Foam::functionObjects::m4gnRecorder::provenance(const dictionary& dict) const
{
    dictionary about;
    about.add("application", string(time_.controlDict().getOrDefault<word>("application", "unknown")));
    about.add("case", string(time_.globalCaseName()));
    about.add("openfoam", label(OPENFOAM));
    about.add("m4gn", string(m4gn_version()));
    about.add("ranks", Pstream::nProcs());
    const string acting(m4gn::sources(mesh_));
    if (acting.size()) {
        about.add("sources", acting);
    }
    about.add("deltaT", time_.deltaTValue());
    const dictionary solid(m4gnMechanicalProperties(mesh_).description(dict.getOrDefault<word>("D", "D")));
    if (solid.size()) {
        about.add("solid", solid);
    }
    about.merge(dict.subOrEmptyDict("provenance"));

    return about;
}

bool Foam::functionObjects::m4gnRecorder::runComplete() const
{
    const scalar half = 0.5 * time_.deltaTValue();
    if (postProcess) {
        // end() is called after the last time, but by timeControl not after a
        // timeEnd, nor where executeControl is for times to write; or an error came
        // before that time was recorded
        return time_.value() <= lastTime_
               || time_.value() > dict_.getOrDefault<scalar>("timeEnd", VGREAT) + half;
    }
    return time_.value() >= time_.endTime().value() - half;
}

Foam::functionObjects::m4gnRecorder::m4gnRecorder(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), recorder_(nullptr), lastTime_(-VGREAT), finished_(false)
{
    read(dict);
}

Foam::functionObjects::m4gnRecorder::~m4gnRecorder()
{
    // Taken out of controlDict while the solver runs: the mesh is still there
    const bool takenOut = recorder_ && !postProcess && !runComplete() && time_.names<fvMesh>().size();
    if (takenOut) {
        Info << "m4gn: " << name() << " is taken out of the run; its recording ends here" << nl << endl;
    }
    if (takenOut || runComplete()) {
        finish();
    }
    m4gn_recorder_free(recorder_);
}

bool Foam::functionObjects::m4gnRecorder::read(const dictionary& dict)
{
    if (nodes_) {
        // A change of controlDict while recording
        Log << type() << ' ' << name() << ": recording goes on as it was"
            << " begun; changes to the dictionary take effect in the next run" << endl;
        return true;
    }

    fvMeshFunctionObject::read(dict);
    m4gn::checkStatic(mesh_, dict);

    m4gn::checkDictionaries(dict, {"nodeTypes", "provenance"});
    m4gnElasticModes::checkDictionary(dict);
    m4gn::checkOptions(dict, "recorder", options(dict, "file"), ownKeys());
    m4gn::checkAtLeast(dict, "modes", dict.getOrDefault<label>("modes", defaultModes), 0);

    dict_ = dict;
    fieldNames_ = dict.getOrDefault<wordList>("fields", wordList({"U", "p"}));
    file_ = dict.getOrDefault<fileName>("file", fileName());

    if (fieldNames_.empty()) {
        FatalIOErrorInFunction(dict) << "Entry fields is empty; expected names such as (U p)"
                                     << exit(FatalIOError);
    }

    return true;
}

bool Foam::functionObjects::m4gnRecorder::execute() { return true; }

bool Foam::functionObjects::m4gnRecorder::write()
{
    // The last time is executed twice if the run stops there (Time::run)
    if (finished_ || time_.value() <= lastTime_) {
        return true;
    }

    if (!nodes_) {
        start();
    }

    std::vector<const double*> cells, boundary;
    forAll(fieldNames_, i) {
        const word& name = fieldNames_[i];
        const label components = values_[i].components;
        m4gnOwnFields::provide(mesh_, name);
        if (!nodes_->gather(name, values_[i])) {
            FatalErrorInFunction << "Field " << name << " is neither registered with"
                                 << " the solver nor stored at time " << time_.timeName() << " as a "
                                 << nodes_->fieldTypes().c_str() << '.' << nl
                                 << "    Registered: " << nodes_->registered().c_str() << exit(FatalError);
        }
        if (recorder_ && values_[i].components != components) {
            FatalErrorInFunction << "Field " << name << " has " << values_[i].components
                                 << " components at time " << time_.timeName() << " and had " << components
                                 << " before" << nl << "    Record times at which it is of one class"
                                 << exit(FatalError);
        }
        cells.push_back(values_[i].cells);
        boundary.push_back(values_[i].boundary.cdata());
    }
    if (!recorder_) {
        open();
    }

    m4gn::check(
        m4gn_recorder_append(recorder_, time_.value(), cells.data(), boundary.data()),
        "m4gnRecorder cannot record a frame");

    lastTime_ = time_.value();

    return true;
}

bool Foam::functionObjects::m4gnRecorder::end()
{
    finish();

    return true;
}

void Foam::functionObjects::m4gnRecorder::updateMesh(const mapPolyMesh&)
{
    m4gn::refuseChange(*this, "a trajectory");
}

void Foam::functionObjects::m4gnRecorder::movePoints(const polyMesh&)
{
    m4gn::refuseMotion(*this, mesh_, "a trajectory");
}
