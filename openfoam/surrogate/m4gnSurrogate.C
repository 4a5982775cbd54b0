// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSurrogate.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnCaseChecks.H"
#include "m4gnCheck.H"
#include "m4gnDictionary.H"
#include "m4gnFluxProjection.H"
#include "m4gnFunctionObjects.H"
#include "m4gnHandOver.H"
#include "m4gnHybridRun.H"
#include "m4gnJump.H"
#include "m4gnLastStep.H"
#include "m4gnRelaxation.H"
#include "m4gnSchemeFields.H"
#include "m4gnVersion.H"
#include "Time.H"
#include "timeControlFunctionObject.H"

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnSurrogate, 0);
addToRunTimeSelectionTable(functionObject, m4gnSurrogate, dictionary);
}
}

bool Foam::functionObjects::m4gnSurrogate::jumping_ = false;

//- Properties that are kept for a restart: the time that write times count from, and the solver's time step (s) within a jump,
//  in which Time has that of the surrogate; 0: outside of one; whether it was set by anybody; the step before the state that is
//  handed back (s)
static const Foam::word writesFrom("writesFrom"), solverDeltaT("solverDeltaT"),
    deltaTChanged("deltaTChanged"), stepBefore("stepBefore");

void Foam::functionObjects::m4gnSurrogate::checkOthers() const
{
    const word other(m4gnActiveSurrogate::before(replaces_ ? VGREAT : timeEnd_, this));

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
    if (run_) {
        return;
    }

    checkOthers();
    auto& list = const_cast<Time&>(time_).functionObjects();
    const label own = list.findObjectID(name());
    control_ = own < 0 ? nullptr : dynamic_cast<functionObjects::timeControl*>(&list[own]);
    if (check_) {
        check_->setInterval(dict_);
    }
    const wordList kinds(m4gnHybridRun::kinds(dict_));
    completions_.resize(kinds.size());
    bool fitted = false;
    forAll(kinds, i) {
        if (kinds[i] != "network") {
            fitted = true;
            continue;
        }
        session_.reset(new m4gnSession(mesh_, dict_, ownKeys_));
        if (replaces_) {
            completions_.set(i, m4gnCompletion::New(mesh_, dict_, *session_));
        }
    }
    if (session_) {
        state_.reset(new m4gnState(
            mesh_, atStart_, fitted, !replaces_, &session_->nodes(), session_->inputs(),
            session_->outputs()));
    } else {
        state_.reset(new m4gnState(mesh_, atStart_, fitted, !replaces_));
    }
    if (!conditions_) {
        conditions_.reset(new m4gnConditions(mesh_, m4gnHybridRun::has(dict_, "dmd")));
    }
    run_.reset(new m4gnHybridRun(name(), mesh_, dict_, session_.get(), *state_, *conditions_));
    if (replaces_) {
        const string changing(m4gn::changingSources(mesh_));
        if (changing.size()) {
            FatalErrorInFunction << "mode replace cannot jump over what changes in time by itself: "
                                 << changing.c_str() << nl
                                 << "    Expected sources and zones that stay as they are;"
                                 << " use mode observe" << exit(FatalError);
        }
        // A fit has refused them with what else is not in its state
        const wordList others(session_ ? m4gn::otherMeshes(mesh_) : wordList());
        if (others.size()) {
            FatalErrorInFunction << "mode replace cannot jump on the mesh " << mesh_.name()
                                 << " alone: the run solves on " << m4gn::join(others)
                                 << " too, which would stay behind in time" << nl
                                 << "    Expected one mesh; use mode observe" << exit(FatalError);
        }
        refuseMemory();
        jump_.reset(new m4gnJump(name(), mesh_, dict_, *run_, *state_, completions_));
        setProperty(writesFrom, time_.startTime().value());
    }
    if (check_) {
        check_->made(*state_, completions_.set(0) ? &completions_[0] : nullptr, jump_->frozen());
    }
}

void Foam::functionObjects::m4gnSurrogate::follow(const m4gn_ride_answer& answer)
{
    pending_ = answer.action == M4GN_RIDE_HAND_BACK
                   ? run_->handedBack(answer, List<m4gnHybridRun::quantity>())
                   : answer;
}

void Foam::functionObjects::m4gnSurrogate::refuseMemory()
{
    // A solid's tractions follow from the stress that is made of a network's displacement
    if (m4gnHybridRun::has(dict_, "dmd") || m4gn::solidModel(mesh_).empty()) {
        conditions_->refuseMemory();
    }
}

void Foam::functionObjects::m4gnSurrogate::jump()
{
    if (pending_.action != M4GN_RIDE_STRIDE) {
        return;
    }

    refuseMemory();
    jump_->begin();
    jumping_ = true;
    const scalar deltaT = time_.deltaTValue();
    setProperty(solverDeltaT, deltaT);
    setProperty(deltaTChanged, m4gnClockwork::changed(const_cast<Time&>(time_)));
    // A fit hands back old levels of the solver's own step
    const label i = pending_.surrogate;
    setProperty(stepBefore, completions_.set(i) ? completions_[i].stepBefore(deltaT) : deltaT);
    const bool jumped = jump_->run(pending_, *this);
    setProperty(solverDeltaT, scalar(0));
    jumping_ = false;
    if (jumped && check_) {
        check_->jumped();
    }
    pending_.action = M4GN_RIDE_SOLVE;
}

void Foam::functionObjects::m4gnSurrogate::resume()
{
    scalar deltaT = 0;
    getProperty(solverDeltaT, deltaT);
    Time& time = const_cast<Time&>(time_);
    if (deltaT > 0) {
        if (time_.isAdjustTimeStep()) {
            // Time was written with the surrogate's
            time.setDeltaT(deltaT, false);
            getProperty(deltaTChanged, m4gnClockwork::changed(time));
        }
        scalar before = deltaT;
        getProperty(stepBefore, before);
        m4gnLastStep::of(time) = before;
        // A jump that goes on says it again
        setProperty(solverDeltaT, scalar(0));
    }

    if (!m4gnHybridRun::stored(name(), time_)) {
        word last;
        for (const instant& at : time_.times()) {
            const fileName file(m4gnHybridRun::stateFile(name(), time_, at.name()));
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
    if (!replaces_) {
        Log << type() << ' ' << name() << ": begins to observe at time " << time_.timeName()
            << "; what it kept as it replaced the solver is not taken up" << endl;
        return;
    }

    // Where a type was told by the flow, it stays that of the run's start
    dictionary types(dict_.subOrEmptyDict("nodeTypes"));
    for (const entry& stored : m4gnHybridRun::storedTypes(name(), time_)) {
        if (!types.found(stored.keyword(), keyType::REGEX)) {
            types.add(stored);
        }
    }
    dict_.set("nodeTypes", types);
    scalar from = time_.startTime().value();
    getProperty(writesFrom, from);
    m4gn::readSchemeFields(mesh_);
    load();
    // Before the ride is told when the next state is wanted
    jump_->carryOnWriting(from);
    setProperty(writesFrom, jump_->writesFrom());
    const std::string conditions(conditions_->now(state_->fields()));

    // The surrogate goes on from what it has predicted
    bool restored = false;
    forAll(completions_, i) {
        restored = (completions_.set(i) && completions_[i].beforeStride()) || restored;
    }
    m4gn_ride_answer answer{};
    const bool loaded = run_->load(conditions, answer);
    if (answer.action == M4GN_RIDE_SOLVE) {
        forAll(completions_, i) {
            if (restored && completions_.set(i)) {
                completions_[i].complete(time_.deltaTValue(), true);
            }
        }
    } else if (answer.stepped && !completions_.set(answer.surrogate)) {
        // What the solver's models have made anew at their start is that of the jump again
        run_->putPresent();
    }
    if (loaded) {
        follow(answer);
        if (!answer.stepped) {
            // A state of the solver's was written before its results were told
            run_->reported(*this);
        }
        jump();
    }
    jump_->beforeFirstStep();
}

Foam::functionObjects::m4gnSurrogate::m4gnSurrogate(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), m4gnActiveSurrogate(name), replaces_(false),
      timeStart_(-VGREAT), timeEnd_(VGREAT), executed_(runTime.startTimeIndex()), steps_(0), due_(false),
      started_(false), ended_(false), control_(nullptr), pending_()
{
    read(dict);

    // The dictionary is that of Foam::functionObjects::timeControl, which
    // reads it when this object is made, and then executes and ends it from
    // timeStart to timeEnd alone. The model is measured before, the state of
    // the run is written always, and the totals are told at its end: both are
    // heeded by the ride.
    const_cast<dictionary&>(dict).remove("timeStart");
    const_cast<dictionary&>(dict).remove("timeEnd");
}

Foam::functionObjects::m4gnSurrogate::~m4gnSurrogate()
{
    // Taken out of controlDict while the solver runs: the mesh is still there
    if (run_ && !ended_ && time_.names<fvMesh>().size()) {
        Info << "m4gn: " << name() << " is taken out of the run; its totals are those up to here" << nl
             << endl;
        run_->end();
    }
}

Foam::scalar Foam::functionObjects::m4gnSurrogate::replacesFrom() const
{
    return replaces_ ? timeStart_ : VGREAT;
}

bool Foam::functionObjects::m4gnSurrogate::read(const dictionary& dict)
{
    if (run_) {
        const bool limited = dict.getOrDefault<scalar>("timeStart", -VGREAT) > -VGREAT
                             || dict.getOrDefault<scalar>("timeEnd", VGREAT) < VGREAT;
        if (control_ && limited) {
            // Foam::functionObjects::timeControl has read them again, and keeps
            // what an entry that is not there had before. It comes back here.
            dictionary unlimited(dict);
            unlimited.set("timeStart", -VGREAT);
            unlimited.set("timeEnd", VGREAT);
            return control_->read(unlimited);
        }
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

    ownKeys_ = m4gnHybridRun::keys();
    ownKeys_.append(wordList(
        {"phi", "state", "executeOthers", "othersInterval", "writeJumps", "writeToFile", "useUserTime"}));
    ownKeys_.append(m4gnCompletion::keys(dict));
    m4gn::checkDictionaries(dict, {"nodeTypes", "segments", "projection", "control", "dmd"});
    m4gnFunctionObjects::checkDictionary(dict);
    m4gnSession::checkEntries(dict, ownKeys_);
    m4gnHybridRun::checkDictionary(dict);
    if (m4gnHybridRun::has(dict, "network")) {
        m4gnSession::checkDictionary(dict, time_.globalPath());
    }
    replaces_ = dict.get<word>("mode") == "replace";

    if (replaces_) {
        const m4gnFluxProjection checked(mesh_, dict);
        m4gnRelaxation::checkDictionary(dict);
    }

    timeStart_ = dict.getOrDefault<scalar>("timeStart", -VGREAT);
    timeEnd_ = dict.getOrDefault<scalar>("timeEnd", VGREAT);
    dict_ = dict;

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::execute()
{
    if (m4gn::onStoredTimes(*this)) {
        return true;
    }

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

    if (!run_ && time_.value() > timeEnd_ + 0.5 * time_.deltaTValue()) {
        return true;
    }

    // What does not fit is said now, and not after the hours to timeStart
    load();

    // A condition with a state of its own shows in two steps
    if (replaces_ && ++steps_ == 2) {
        refuseMemory();
    }

    // Those that stand behind it may change the state. At the run's end nothing is called after this.
    due_ = true;
    if (time_.value() > time_.endTime().value() - 0.5 * time_.deltaTValue()) {
        solved();
    }

    return true;
}

void Foam::functionObjects::m4gnSurrogate::solved()
{
    due_ = false;
    const m4gn_ride_answer answer = run_->solved();

    // What a run that is carried on from here begins with
    if (time_.writeTime()) {
        run_->save();
    }

    follow(answer);

    if (check_) {
        check_->solved();
    }
}

bool Foam::functionObjects::m4gnSurrogate::filesModified() const
{
    auto& own = const_cast<m4gnSurrogate&>(*this);

    if (!started_) {
        started_ = true;

        if (!postProcess && time_.timeIndex() == time_.startTimeIndex()) {
            own.atStart_ = wordHashSet(mesh_.thisDb().names());
            own.conditions_.reset(new m4gnConditions(mesh_, m4gnHybridRun::has(dict_, "dmd")));
            own.resume();
        }
    } else if (jump_) {
        own.jump_->afterFirstStep();
    }

    // All function objects have seen the solver's step
    if (due_) {
        own.solved();
        own.run_->reported(*this);
    }
    own.jump();
    own.executed_ = time_.timeIndex();

    return jump_ && own.jump_->filesModified();
}

bool Foam::functionObjects::m4gnSurrogate::write() { return true; }

bool Foam::functionObjects::m4gnSurrogate::end()
{
    ended_ = true;
    if (run_) {
        run_->end();
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
