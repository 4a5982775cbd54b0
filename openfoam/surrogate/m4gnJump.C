// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnJump.H"
#include "m4gnCaseChecks.H"
#include "m4gnSolidDisplacement.H"
#include "m4gnLastStep.H"
#include "m4gnOwnFields.H"
#include "m4gnClock.H"
#include "m4gnVersion.H"
#include "functionObjectList.H"
#include "surfaceFields.H"
#include "Time.H"
#include "timeControlFunctionObject.H"

namespace
{
using namespace Foam;

//- Does it run at times, or at the run's end, of which those less than half a
//  time step ahead count as come?
bool atTimes(const timeControl& control)
{
    return control.control() == timeControl::ocRunTime
           || control.control() == timeControl::ocAdjustableRunTime
           || control.control() == timeControl::ocOnEnd;
}

//- Entries of its controls, by their present names: OpenFOAM takes outputControl as well, and warns of it each time
dictionary entriesOf(const functionObjects::timeControl& controls)
{
    dictionary entries(controls.dict());
    // With it OpenFOAM reads no writeInterval, and without it no outputInterval
    if (entries.found("outputControl")) {
        entries.remove("writeControl");
        entries.remove("writeInterval");
        entries.changeKeyword("outputControl", "writeControl");
        entries.changeKeyword("outputInterval", "writeInterval");
    }
    return entries;
}

//- Do to both controls of each function object that count times from the run's start
template <class Action> void eachAtTimes(functionObjectList& list, const Action& action)
{
    forAll(list, i) {
        const auto* controls = isA<functionObjects::timeControl>(list[i]);
        for (const word what : {"execute", "write"}) {
            if (controls) {
                auto& control = const_cast<timeControl&>(
                    what == "write" ? controls->writeControl() : controls->executeControl());
                if (atTimes(control) && control.control() != timeControl::ocOnEnd) {
                    action(control, entriesOf(*controls), word(what + "Interval"));
                }
            }
        }
    }
}

//- Execute or write the function object at a state of a jump. One whose
//  control counts times by deltaT is given no more than the solver's, so that
//  times up to half a stride ahead are not taken for done; one that tells of
//  the solver's step is given that; one that is due at each n-th step is so
//  where the stride passes such steps, with the time of these.
void runAt(functionObject& object, Time& time, const scalar deltaT, const bool writes)
{
    const scalar stride = time.deltaTValue();
    const auto* controls = isA<functionObjects::timeControl>(object);
    auto* control =
        controls ? &const_cast<timeControl&>(writes ? controls->writeControl() : controls->executeControl())
                 : nullptr;

    const bool counts = control && control->control() == timeControl::ocTimeStep;
    const label each = counts ? max(label(1), label(control->interval())) : 1;
    const label steps = max(label(1), label(stride / deltaT + 0.5));
    const label passed = time.timeIndex() / each - (time.timeIndex() - steps) / each;
    const bool courant = m4gnFunctionObjects::typeOf(object, time) == "CourantNo";
    const scalar seen = courant ? deltaT : stride * (scalar(max(label(1), passed)) / steps);
    // The stride need not end at one
    const bool within = each > 1 && passed > 0;

    time.setDeltaT(control && atTimes(*control) ? min(deltaT, stride) : seen, false);
    if (within) {
        dictionary here(entriesOf(*controls));
        here.set(writes ? "writeInterval" : "executeInterval", label(1));
        control->read(here);
    }
    writes ? object.write() : object.execute();
    if (within) {
        control->read(entriesOf(*controls));
    }
    time.setDeltaT(stride, false);
}

//- What function objects keep for a restart, as the run's own list of them
//  writes it after a step of the solver
void writeProperties(Time& time)
{
    const unsigned int precision = IOstream::precision_;
    IOstream::precision_ = 16;
    m4gn::writeObject(
        m4gn::properties(time.functionObjects()), IOstreamOption(IOstream::ASCII, time.writeCompression()));
    IOstream::precision_ = precision;
}

} // End anonymous namespace

void Foam::m4gnJump::executeOthers(const scalar deltaT)
{
    functionObjectList& list = time_.functionObjects();
    const wordHashSet executed(others());
    // In a run that is carried on within a jump
    const bool solved = !m4gn::solverPerformance(mesh_).empty();

    forAll(list, i) {
        const bool reports = solved || !m4gnFunctionObjects::reportsSolves(list[i], time_);
        if (reports && list[i].name() != name_ && executed.found(list[i].name())) {
            runAt(list[i], time_, deltaT, false);
            runAt(list[i], time_, deltaT, true);
            // OpenFOAM asks it behind a step of the solver alone
            const bool updates = m4gnFunctionObjects::typeOf(list[i], time_) == "timeActivatedFileUpdate";
            filesModified_ = (updates && list[i].filesModified()) || filesModified_;
        }
    }
}

void Foam::m4gnJump::writeOthers(const wordHashSet& executed) const
{
    functionObjectList& list = time_.functionObjects();

    forAll(list, i) {
        const auto* controls = isA<functionObjects::timeControl>(list[i]);
        const bool keeps = m4gnFunctionObjects::typeOf(list[i], time_) == "m4gnAverages"
                           || (controls && controls->writeControl().control() == timeControl::ocWriteTime);
        if (keeps && list[i].name() != name_ && executed.found(list[i].name())) {
            list[i].write();
        }
    }
}

Foam::scalar Foam::m4gnJump::within() const
{
    // Within a jump Time has its own deltaT
    const scalar deltaT = jumping_ ? last_.solverDeltaT : time_.deltaTValue();
    // Solvers such as icoFoam do not heed adjustTimeStep
    const bool adjusts =
        time_.isAdjustTimeStep() && (jumping_ ? last_.changed : m4gnClockwork::changed(time_));
    const scalar next = adjusts ? m4gnClockwork::adjusted(time_, deltaT, writesFrom_) : deltaT;
    const label steps =
        min(others().size() ? interval_ : labelMax, m4gnClockwork::toWrite(time_, next, writesFrom_));

    return steps == labelMax ? 0 : steps * next;
}

void Foam::m4gnJump::carryOnWriting(const scalar from) { writesFrom_ = m4gnClockwork::carryOn(time_, from); }

void Foam::m4gnJump::toNextOfOthers(const scalar deltaT)
{
    const scalar start = m4gnClockwork::start(time_);
    if (writesFrom_ == start) {
        return;
    }
    eachAtTimes(time_.functionObjects(), [&](timeControl& control, dictionary dict, const word& entry) {
        control.read(dict);
        const scalar interval = control.interval();
        const label passed = label((time_.value() - writesFrom_ + 0.5 * deltaT) / interval);
        const scalar next = writesFrom_ + (passed + 1) * interval;
        // One interval from the start of Time
        dict.set(entry, time_.timeToUserTime(next - start));
        control.clear();
        control.read(dict);
    });
}

void Foam::m4gnJump::beforeFirstStep()
{
    if (writesFrom_ != m4gnClockwork::start(time_)) {
        toNextOfOthers(time_.deltaTValue());
        usual_ = m4gnClockwork::toNext(time_, writesFrom_);
    }
}

void Foam::m4gnJump::afterFirstStep()
{
    if (writesFrom_ != m4gnClockwork::start(time_)) {
        m4gnClockwork::countFrom(time_, writesFrom_, usual_);
        // Those up to here are done
        eachAtTimes(time_.functionObjects(), [](timeControl& control, const dictionary& dict, const word&) {
            control.clear();
            control.read(dict);
            control.execute();
        });
    }
}

Foam::m4gnJump::m4gnJump(
    const word& name, const fvMesh& mesh, const dictionary& dict, m4gnHybridRun& run, m4gnState& state,
    PtrList<m4gnCompletion>& completions)
    : mesh_(mesh), time_(const_cast<Time&>(mesh.time())), run_(run), state_(state), completions_(completions),
      completion_(of(0)), name_(name), dict_(dict), interval_(m4gnFunctionObjects::interval(dict)),
      writes_(dict.getOrDefault<bool>("writeJumps", false)), stale_(mesh),
      jumping_(false), last_{false, 0, false}, writesFrom_(mesh.time().startTime().value()), usual_{0, 0, 0}
{
    if (mesh_.moving() || mesh_.changing()) {
        FatalErrorInFunction << "mode replace does not handle a mesh that moves or changes"
                             << exit(FatalError);
    }
    m4gnFunctionObjects::check(name_, time_, dict_);
    run_.checkQuantities(others());
    run_.setWithin([this] { return within(); });

    if (m4gnHybridRun::has(dict_, "dmd") && !m4gn::solidModel(mesh_).empty()) {
        string why;
        law_ = m4gnSolidLaw::New(mesh_, &why);
        if (!law_) {
            Info << "m4gn: what solids4foam makes of a state when it writes it (sigmaEq, epsilon, stresses of"
                 << " points) is not written in jumps: " << why.c_str() << nl
                 << "    To build what makes it: setup/solids4foam.sh, or openfoam/solids4foam" << endl;
        }
    }
}

void Foam::m4gnJump::advance(const m4gn_ride_answer& answer)
{
    if (completion_) {
        completion_->beforeStride();
    }
    toNextOfOthers(last_.solverDeltaT);
    m4gnClockwork::count(time_, answer.solver_steps);
    m4gnClockwork::advance(time_, answer.duration, last_.solverDeltaT, writesFrom_);
    if (completion_) {
        completion_->advance(state_, answer.duration);
    } else if (answer.whole) {
        state_.put();
    } else {
        FatalErrorInFunction << "The surrogate predicts a part of the state alone, and nothing"
                             << " makes the others of it" << exit(FatalError);
    }
    last_.handedOver = false;
    m4gnClockwork::passed(time_, answer.solver_steps);
}

Foam::List<Foam::m4gnHybridRun::quantity> Foam::m4gnJump::quantities() const
{
    if (completion_) {
        return completion_->quantities();
    }
    const auto* phi = mesh_.findObject<surfaceScalarField>("phi");
    if (!phi || phi->dimensions() != dimVelocity * dimArea) {
        return {};
    }
    return {m4gnHybridRun::quantity("maxDivAfter", m4gnCompletion::maxDiv(*phi))};
}

void Foam::m4gnJump::writeState()
{
    if (law_) {
        law_->write();
        return;
    }
    time_.write();
    if (m4gnSolidDisplacement::registered(mesh_)) {
        // solidDisplacementFoam makes it of sigmaD when it writes
        m4gnSolidDisplacement::write(mesh_);
    }
}

void Foam::m4gnJump::write(const word& since)
{
    stale_.write(advanced(), since, [&] { completion_ ? completion_->write() : writeState(); });
    run_.writeFields();
}

void Foam::m4gnJump::keep()
{
    writeProperties(time_);
    run_.save();
}

void Foam::m4gnJump::begin()
{
    // In a run that is carried on from here it has been written
    if (writes_ && !time_.writeTime() && time_.timeIndex() != time_.startTimeIndex()) {
        m4gnClockwork::write(time_);
        writeState();
        // All that look have seen the solver's step
        writeOthers(m4gnFunctionObjects::chosen(name_, time_, dictionary::null));
        keep();
    }
}

bool Foam::m4gnJump::run(m4gn_ride_answer answer, const functionObjects::stateFunctionObject& results)
{
    // Between its steps time has the surrogate's deltaT
    const scalar deltaT = time_.deltaTValue();
    const word lastSolved(time_.timeName());

    {
        const m4gnOwnFields::heldTimeStep solverStep(mesh_, state_.fields());
        m4gnClock timer;
        scalar surrogate = 0, handOver = 0;
        completion_ = of(answer.surrogate);
        last_ = {false, deltaT, m4gnClockwork::changed(time_)};
        jumping_ = true;

        const auto complete = [&](const bool last) {
            timer.increment();
            if (completion_) {
                completion_->complete(deltaT, last);
            } else if (run_.setOldLevels(deltaT)) {
                m4gnLastStep::of(time_) = deltaT;
            }
            last_.handedOver = last;
            handOver += timer.increment();
        };
        const auto told = [&]() {
            run_.spent(surrogate, handOver);
            surrogate = handOver = 0;
        };

        while (answer.action == M4GN_RIDE_STRIDE) {
            timer.increment();
            answer = run_.stride();
            if (answer.action != M4GN_RIDE_ADVANCE) {
                break;
            }
            advance(answer);
            surrogate += timer.increment();

            const bool forModel = completion_ && completion_->completeForModel();
            if (forModel) {
                complete(!answer.strides);
            }
            answer = run_.advanced(answer);
            if (time_.value() > time_.endTime().value() - 0.5 * deltaT) {
                // Stopped from outside (stopAt, a signal): Time ends a run in an orderly way only after a step
                // of the solver. To other function objects that is the end.
                time_.setEndTime(time_.value() + deltaT);
            }
            surrogate += timer.increment();
            // Strides that are left: the run is stopped, and one that is
            // carried on takes them
            const bool last = answer.action == M4GN_RIDE_HAND_BACK && !answer.strides;
            if (last && writes_) {
                m4gnClockwork::write(time_);
            }

            const bool seen = time_.writeTime()
                              || (completion_
                                  && ((answer.last_but_one && completion_->completeLastTwo())
                                      || (completion_->completeForOthers() && others().size())));
            if (forModel ? last && !last_.handedOver : last || seen) {
                complete(last);
            }

            write(lastSolved);
            executeOthers(deltaT);
            run_.reported(results);

            if (time_.writeTime()) {
                told();
                keep();
            }
        }

        if (answer.action != M4GN_RIDE_SOLVE && !last_.handedOver) {
            // The jump ended early
            complete(true);
            if (writes_) {
                const bool written = time_.writeTime();
                m4gnClockwork::write(time_);
                write(lastSolved);
                if (!written) {
                    writeOthers(others());
                }
                keep();
            }
        }
        told();
    }

    jumping_ = false;
    time_.setDeltaT(deltaT, false);
    m4gnClockwork::changed(time_) = last_.changed;

    if (answer.action != M4GN_RIDE_HAND_BACK) {
        return false;
    }

    run_.handedBack(answer, quantities());
    return true;
}
