// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnJump.H"
#include "m4gnExplicitStress.H"
#include "m4gnFunctionObjects.H"
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

//- What Time does not let others do
class clockwork : public Time
{
public:
    //- The next step of the surrogate counts as the solver's steps that it
    //  stands for: writeControl timeStep, of the run and of function objects,
    //  goes on at the times at which it would without jumps
    static void count(Time& time, const label nSteps) { time.*(&clockwork::timeIndex_) += nSteps - 1; }

    //- A step of the surrogate passes multiples of writeInterval without
    //  ending there: write then, as at run times that it passes
    static void passed(Time& time, const label nSteps)
    {
        if (time.*(&clockwork::writeControl_) == Time::wcTimeStep) {
            const label interval = max(label(1), label(time.*(&clockwork::writeInterval_)));
            const label index = time.timeIndex();

            if (index / interval > (index - nSteps) / interval) {
                time.*(&clockwork::writeTime_) = true;
            }
        }
    }

    //- Go on by a time (s), where the solver's step is deltaT and times to write
    //  are counted from `from`. One that is less than half a time step ahead
    //  counts as come, so that the solver's own steps meet it. Of a step as long
    //  as the surrogate's that would be times that are yet to come.
    static void advance(Time& time, const scalar duration, const scalar deltaT, const scalar from)
    {
        time.setDeltaT(duration, false);
        const auto control = time.*(&clockwork::writeControl_);

        if (control == Time::wcRunTime || control == Time::wcAdjustableRunTime) {
            label& index = time.*(&clockwork::writeTimeIndex_);
            const label last = index;
            const label next = writesPassed(time, from, duration + 0.5 * deltaT);
            scalar& counted = time.*(&clockwork::startTime_);
            const scalar start = counted;

            counted = from;
            index = next > last ? last : labelMax;
            ++time;
            index = max(last, next);
            counted = start;
        } else {
            ++time;
        }
    }

    //- Times are written at the run's start plus multiples of the write
    //  interval. A run that is carried on between two of them, where a stride
    //  ended, goes on with those of the run before: they began at `from`. The
    //  last of them; the run's start, where it is one.
    static scalar carryOn(Time& time, const scalar from)
    {
        const auto control = time.*(&clockwork::writeControl_);

        if (control == Time::wcRunTime || control == Time::wcAdjustableRunTime) {
            const scalar interval = time.*(&clockwork::writeInterval_);
            const scalar passed = (time.value() - from) / interval;
            const scalar last = from + std::floor(passed + 1e-6) * interval;

            if (time.value() - last > 1e-6 * interval) {
                time.*(&clockwork::writeTimeIndex_) = writesPassed(time, last, 0.5 * time.deltaTValue());
                return last;
            }
        }
        return time.startTime().value();
    }

    //- Write times from `from` to a time that is ahead (s)
    static label writesPassed(const Time& time, const scalar from, const scalar ahead)
    {
        return label((time.value() - from + ahead) / (time.*(&clockwork::writeInterval_)));
    }

    static scalar& start(Time& time) { return time.*(&clockwork::startTime_); }

    static label& written(Time& time) { return time.*(&clockwork::writeTimeIndex_); }

    //- Steps of this length to the next time to write; labelMax: who knows
    static label toWrite(const Time& time, const scalar deltaT, const scalar from)
    {
        const scalar interval = time.*(&clockwork::writeInterval_);

        switch (time.*(&clockwork::writeControl_)) {
        case Time::wcTimeStep: {
            const label each = max(label(1), label(interval));
            return each - time.timeIndex() % each;
        }
        case Time::wcRunTime:
        case Time::wcAdjustableRunTime: {
            // Half a step before it counts as come
            const scalar next = (time.*(&clockwork::writeTimeIndex_) + 1) * interval;
            const scalar steps = std::ceil((next - (time.value() - from)) / deltaT - 0.5 - 1e-6);
            return steps < labelMax ? max(label(1), label(steps)) : labelMax;
        }
        default:
            return labelMax;
        }
    }

    //- The solver's next step, where one of deltaT would come and steps are
    //  adjusted to times to write
    static scalar adjusted(Time& time, const scalar deltaT)
    {
        const scalar present = time.deltaTValue();
        const bool edited = changed(time);
        time.setDeltaT(deltaT, true);
        const scalar next = time.deltaTValue();
        time.setDeltaT(present, false);
        changed(time) = edited;
        return next;
    }

    //- The old levels are those of a step of this length: that is what
    //  deltaT0 will be in the next one
    static void precede(Time& time, const scalar deltaT) { time.*(&clockwork::deltaTSave_) = deltaT; }

    //- Does deltaT differ from controlDict's, so that an edited one is not
    //  heeded?
    static bool& changed(Time& time) { return time.*(&clockwork::deltaTchanged_); }
};

//- Does it run at times, of which those less than half a time step ahead count
//  as come?
bool atTimes(const timeControl& control)
{
    return control.control() == timeControl::ocRunTime
           || control.control() == timeControl::ocAdjustableRunTime;
}

//- Execute and write the function object at a state of a jump. One whose
//  control counts times by deltaT is given the solver's, so that times up to
//  half a stride ahead are not taken for done, and so is one that tells of the
//  solver's step; one that sees each n-th step has 1/n of the time since the
//  state before.
void runAt(functionObject& object, Time& time, const scalar deltaT)
{
    const scalar stride = time.deltaTValue();
    const auto* controls = isA<functionObjects::timeControl>(object);

    scalar seen = stride;
    if (m4gnFunctionObjects::typeOf(object, time) == "CourantNo") {
        seen = deltaT;
    } else if (controls && controls->executeControl().control() == timeControl::ocTimeStep) {
        const scalar each = max(scalar(1), controls->executeControl().interval());
        seen = max(seen / each, min(seen, deltaT));
    }

    time.setDeltaT(controls && atTimes(controls->executeControl()) ? deltaT : seen, false);
    object.execute();
    time.setDeltaT(controls && atTimes(controls->writeControl()) ? deltaT : seen, false);
    object.write();
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

void Foam::m4gnJump::executeOthers(const scalar deltaT) const
{
    functionObjectList& list = time_.functionObjects();
    // In a run that is carried on within a jump
    const bool solved = !m4gn::solverPerformance(mesh_).empty();

    forAll(list, i) {
        const bool reports = solved || !m4gnFunctionObjects::reportsSolves(list[i], time_);
        if (reports && list[i].name() != name_ && others_.found(list[i].name())) {
            runAt(list[i], time_, deltaT);
        }
    }
}

Foam::scalar Foam::m4gnJump::within() const
{
    // Within a jump Time has its own deltaT
    const scalar deltaT = jumping_ ? last_.solverDeltaT : time_.deltaTValue();
    const scalar next = time_.isAdjustTimeStep() ? clockwork::adjusted(time_, deltaT) : deltaT;
    const label steps =
        min(others_.size() ? interval_ : labelMax, clockwork::toWrite(time_, next, writesFrom_));

    return steps == labelMax ? 0 : steps * next;
}

void Foam::m4gnJump::carryOnWriting(const scalar from) { writesFrom_ = clockwork::carryOn(time_, from); }

void Foam::m4gnJump::beforeFirstStep()
{
    if (writesFrom_ != clockwork::start(time_)
        && clockwork::writesPassed(time_, writesFrom_, 1.5 * time_.deltaTValue()) > clockwork::written(time_))
    {
        time_.writeOnce();
    }
}

void Foam::m4gnJump::afterFirstStep()
{
    if (writesFrom_ != clockwork::start(time_)) {
        clockwork::start(time_) = writesFrom_;
        clockwork::written(time_) =
            max(clockwork::written(time_),
                clockwork::writesPassed(time_, writesFrom_, 0.5 * time_.deltaTValue()));
    }
}

void Foam::m4gnJump::precede(Time& time, const scalar deltaT) { clockwork::precede(time, deltaT); }

Foam::m4gnJump::m4gnJump(
    const word& name, const fvMesh& mesh, const dictionary& dict, m4gnHybridRun& run, m4gnState& state,
    PtrList<m4gnCompletion>& completions)
    : mesh_(mesh), time_(const_cast<Time&>(mesh.time())), run_(run), state_(state), completions_(completions),
      completion_(of(0)), name_(name), others_(m4gnFunctionObjects::chosen(name, mesh.time(), dict)),
      interval_(m4gnFunctionObjects::interval(dict)), stale_(mesh), jumping_(false), last_({-1, false, 0}),
      writesFrom_(mesh.time().startTime().value())
{
    if (mesh_.moving() || mesh_.changing()) {
        FatalErrorInFunction << "mode replace does not handle a mesh that moves or changes"
                             << exit(FatalError);
    }
    run_.checkQuantities(others_);
    run_.setWithin([this] { return within(); });
}

void Foam::m4gnJump::advance(const m4gn_ride_answer& answer)
{
    if (completion_) {
        completion_->beforeStride();
    }
    clockwork::count(time_, answer.solver_steps);
    clockwork::advance(time_, answer.duration, last_.solverDeltaT, writesFrom_);
    if (completion_) {
        completion_->advance(state_, answer.duration);
    } else if (answer.whole) {
        state_.put();
    } else {
        FatalErrorInFunction << "The surrogate predicts a part of the state alone, and nothing"
                             << " makes the others of it" << exit(FatalError);
    }
    last_.timeIndex = time_.timeIndex();
    last_.handedOver = false;
    clockwork::passed(time_, answer.solver_steps);
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

bool Foam::m4gnJump::run(m4gn_ride_answer answer, const functionObjects::stateFunctionObject& results)
{
    // Between its steps time has the surrogate's deltaT
    const scalar deltaT = time_.deltaTValue();
    const bool changed = clockwork::changed(time_);
    const word lastSolved(time_.timeName());

    {
        const m4gnOwnFields::heldTimeStep solverStep(mesh_, state_.fields());
        m4gnClock timer;
        scalar surrogate = 0, handOver = 0;
        const m4gnActiveSurrogate::state before(last_);
        completion_ = of(answer.surrogate);
        last_ = {last_.timeIndex, false, deltaT};
        jumping_ = true;

        const auto complete = [&](const bool last) {
            timer.increment();
            if (completion_) {
                completion_->complete(deltaT, last);
            } else if (run_.setOldLevels(deltaT)) {
                clockwork::precede(time_, deltaT);
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
            surrogate += timer.increment();
            // Strides that are left: the run is stopped, and one that is
            // carried on takes them
            const bool last = answer.action == M4GN_RIDE_HAND_BACK && !answer.strides;

            const bool seen =
                time_.writeTime()
                || (completion_
                    && (completion_->completeEach() || (answer.last_but_one && completion_->completeLastTwo())
                        || (others_.size() && completion_->completeForOthers())));
            if (forModel ? last && !last_.handedOver : last || seen) {
                complete(last);
            }

            stale_.write(advanced(), lastSolved, [&] {
                if (completion_) {
                    completion_->write();
                } else {
                    time_.write();
                    if (m4gnExplicitStress::registered(mesh_)) {
                        // solidDisplacementFoam makes it of sigmaD when it writes
                        m4gnExplicitStress::write(mesh_);
                    }
                }
            });
            executeOthers(deltaT);
            run_.reported(results);

            if (time_.writeTime()) {
                told();
                writeProperties(time_);
                run_.save();
            }
        }

        if (answer.action == M4GN_RIDE_SOLVE) {
            last_ = before;
        } else if (!last_.handedOver) {
            // The jump ended early
            complete(true);
        }
        told();
    }

    jumping_ = false;
    time_.setDeltaT(deltaT, false);
    clockwork::changed(time_) = changed;

    if (answer.action != M4GN_RIDE_HAND_BACK) {
        return false;
    }

    if (time_.value() > time_.endTime().value() - 0.5 * deltaT) {
        // Stopped from outside (stopAt, a signal): Time ends a run in an
        // orderly way only after a step of the solver
        time_.setEndTime(time_.value() + deltaT);
    }

    run_.handedBack(answer, quantities());
    return true;
}
