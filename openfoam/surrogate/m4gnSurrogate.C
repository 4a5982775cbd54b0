// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSurrogate.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnCheck.H"
#include "m4gnDictionary.H"
#include "m4gnElasticSmoothing.H"
#include "m4gnFluxProjection.H"
#include "m4gnJump.H"
#include "m4gnOthers.H"
#include "m4gnRide.H"
#include "m4gnRun.H"
#include "m4gnSettling.H"
#include "m4gnVersion.H"
#include "Time.H"

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnSurrogate, 0);
addToRunTimeSelectionTable(functionObject, m4gnSurrogate, dictionary);
}
}

bool Foam::functionObjects::m4gnSurrogate::jumping_ = false;

//- Property that is kept for a restart: the time that write times count from
static const Foam::word writesFrom("writesFrom");

void Foam::functionObjects::m4gnSurrogate::checkOthers() const
{
    const word other(m4gnReplacer::before(replaces_ ? VGREAT : timeEnd_, this));

    if (other.size() && replaces_) {
        FatalErrorInFunction << "Both function objects " << name() << " and " << other
                             << " replace the solver: one would jump right"
                             << " after the other, without a step of the solver between" << nl
                             << "    Have one of mode replace in a run" << exit(FatalError);
    }

    if (other.size()) {
        FatalErrorInFunction << "Function object " << name() << " of mode observe stands beside"
                             << " a solver that " << other << " replaces" << nl
                             << "    Have it in a run without mode replace, or give " << name()
                             << " a timeEnd that is not later than the timeStart"
                             << " of " << other << exit(FatalError);
    }
}

void Foam::functionObjects::m4gnSurrogate::load()
{
    if (ride_) {
        return;
    }

    checkOthers();
    if (check_) {
        check_->setInterval(dict_);
    }
    m4gnRunState* run = nullptr;
    const wordList kinds(m4gnRide::kinds(dict_));
    states_.resize(kinds.size());
    forAll(kinds, i) {
        if (kinds[i] == "linear") {
            run = new m4gnRunState(mesh_);
            states_.set(i, run);
            continue;
        }
        session_.reset(new m4gnSession(mesh_, dict_, ownKeys_));
        if (replaces_) {
            states_.set(i, m4gnSolverState::New(mesh_, dict_, *session_));
        }
    }
    ride_.reset(new m4gnRide(name(), mesh_, dict_, session_.get(), run));
    if (replaces_) {
        jump_.reset(new m4gnJump(name(), mesh_, dict_, *ride_, states_));
        setProperty(writesFrom, time_.startTime().value());
    }
    if (check_) {
        check_->made(run, states_.first(), jump_->frozen());
    }
}

void Foam::functionObjects::m4gnSurrogate::follow(const m4gn_ride_answer& answer)
{
    if (jump_ && answer.since >= 0) {
        jump_->solved(answer.since);
    }

    pending_ = answer.action == M4GN_RIDE_DECIDE      ? ride_->decide(answer)
               : answer.action == M4GN_RIDE_HAND_BACK ? ride_->handedBack(answer, List<m4gnRide::quantity>())
                                                      : answer;
}

void Foam::functionObjects::m4gnSurrogate::jump()
{
    if (pending_.action != M4GN_RIDE_STRIDE) {
        return;
    }

    jumping_ = true;
    const bool jumped = jump_->run(pending_, *this);
    jumping_ = false;
    if (jumped && check_) {
        check_->jumped();
    }
    pending_.action = M4GN_RIDE_SOLVE;
}

void Foam::functionObjects::m4gnSurrogate::resume()
{
    if (!m4gnRide::stored(name(), time_)) {
        word last;
        for (const instant& at : time_.times()) {
            const fileName file(m4gnRide::stateFile(name(), time_, at.name()));
            if (replaces_ && Pstream::master() && at.value() < time_.value() && isFile(file)) {
                last = at.name();
            }
        }
        m4gn::broadcast(last);

        if (last.size()) {
            WarningInFunction << "There is no state of " << name() << " at time " << time_.timeName()
                              << ": its schedule begins anew" << nl << "    The last one is at time " << last
                              << ". What was written later may not be whole" << endl;
        }
        return;
    }

    // Where a type was told by the flow, it stays that of the run's start
    dictionary types(dict_.subOrEmptyDict("nodeTypes"));
    for (const entry& stored : m4gnRide::storedTypes(name(), time_)) {
        if (!types.found(stored.keyword(), keyType::REGEX)) {
            types.add(stored);
        }
    }
    dict_.set("nodeTypes", types);
    scalar from = time_.startTime().value();
    getProperty(writesFrom, from);
    load();

    m4gn_ride_answer answer{};
    if (!ride_->load(answer)) {
        return;
    }
    if (answer.delta_t > 0 && time_.isAdjustTimeStep()) {
        // Time was written with the surrogate's
        const_cast<Time&>(time_).setDeltaT(answer.delta_t, false);
    }
    if (replaces_) {
        m4gnJump::carryOnWriting(const_cast<Time&>(time_), from);
        setProperty(writesFrom, time_.startTime().value());
    }
    follow(answer);
    jump();
}

Foam::functionObjects::m4gnSurrogate::m4gnSurrogate(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), m4gnReplacer(name), replaces_(false), timeStart_(-VGREAT),
      timeEnd_(VGREAT), executed_(runTime.startTimeIndex()), started_(false), pending_()
{
    read(dict);

    // The dictionary is that of Foam::functionObjects::timeControl, which
    // reads it when this object is made, and then executes and ends it from
    // timeStart to timeEnd alone. The model learns and is measured before,
    // the state of the run is written always, and the totals are told at its
    // end: both are heeded by the ride.
    const_cast<dictionary&>(dict).remove("timeStart");
    const_cast<dictionary&>(dict).remove("timeEnd");
}

Foam::functionObjects::m4gnSurrogate::~m4gnSurrogate() = default;

Foam::scalar Foam::functionObjects::m4gnSurrogate::replacesFrom() const
{
    return replaces_ ? timeStart_ : VGREAT;
}

Foam::m4gnReplacer::state Foam::functionObjects::m4gnSurrogate::lastState(const fvMesh& mesh) const
{
    if (&mesh != &mesh_ || !jump_) {
        return {-1, false, 0};
    }

    return jump_->last();
}

bool Foam::functionObjects::m4gnSurrogate::read(const dictionary& dict)
{
    if (ride_) {
        Log << type() << ' ' << name() << ": goes on as it was begun; changes"
            << " to the dictionary take effect in the next run" << endl;
        return true;
    }

    if (m4gnCheck::asked(dict)) {
        check_.reset(new m4gnCheck(mesh_, dict));
        return read(check_->jumping());
    }

    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);
    m4gn::checkStatic(mesh_, dict);

    ownKeys_ = m4gnRide::keys();
    ownKeys_.append(wordList({"phi", "state", "frozen", "executeOthers", "writeToFile", "useUserTime"}));
    ownKeys_.append(m4gnSolverState::keys(dict));
    m4gn::checkDictionaries(dict, {"nodeTypes", "segments", "projection", "adapt", "control", "linear"});
    m4gnOthers::checkDictionary(dict);
    m4gnRide::checkDictionary(dict);
    if (m4gnRide::has(dict, "network")) {
        m4gnSession::checkDictionary(dict, time_.globalPath(), ownKeys_);
    }
    replaces_ = dict.get<word>("mode") == "replace";

    if (replaces_) {
        const m4gnFluxProjection checked(mesh_, dict);
        m4gnElasticSmoothing::checkDictionary(dict);
        m4gnSettling::checkDictionary(dict);
    } else if (m4gnNodes::atPoints(dict)) {
        FatalIOErrorInFunction(dict) << "Entry location is points, which is for mode replace; mode"
                                     << " observe works with fields of cells" << exit(FatalIOError);
    }

    timeStart_ = dict.getOrDefault<scalar>("timeStart", -VGREAT);
    timeEnd_ = dict.getOrDefault<scalar>("timeEnd", VGREAT);
    dict_ = dict;

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::execute()
{
    m4gn::checkSolver(*this);

    // Foam::functionObjects::timeControl executes again at a time that
    // was met already: there the solver has not made a step
    if (jumping_ || time_.timeIndex() == executed_) {
        return true;
    }
    executed_ = time_.timeIndex();

    if (check_ && check_->isOver()) {
        check_->solved();
        return true;
    }

    if (!ride_ && time_.value() > timeEnd_ + 0.5 * time_.deltaTValue()) {
        return true;
    }

    // What does not fit is said now, and not after the hours to timeStart
    load();

    const m4gn_ride_answer answer = ride_->solved();

    // What a run that is carried on from here begins with
    if (time_.writeTime()) {
        ride_->save();
    }

    follow(answer);

    if (check_) {
        check_->solved();
    }

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::filesModified() const
{
    auto& own = const_cast<m4gnSurrogate&>(*this);

    if (!started_) {
        started_ = true;

        if (!postProcess && time_.timeIndex() == time_.startTimeIndex()) {
            own.resume();
        }
    }

    // All function objects have seen the solver's step
    if (ride_ && time_.timeIndex() != time_.startTimeIndex()) {
        own.ride_->reported(*this);
    }
    own.jump();
    own.executed_ = time_.timeIndex();

    return false;
}

bool Foam::functionObjects::m4gnSurrogate::write() { return true; }

bool Foam::functionObjects::m4gnSurrogate::end()
{
    if (ride_) {
        ride_->end();
    }
    if (check_) {
        check_->write();
    }

    return true;
}

void Foam::functionObjects::m4gnSurrogate::updateMesh(const mapPolyMesh&)
{
    m4gn::refuseChange(*this, "a surrogate");
}

void Foam::functionObjects::m4gnSurrogate::movePoints(const polyMesh&)
{
    m4gn::refuseMotion(*this, mesh_, "a surrogate");
}
