// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnReplace.H"
#include "m4gnAdapt.H"
#include "m4gnControl.H"
#include "m4gnRun.H"
#include "m4gnHandBack.H"
#include "m4gnOthers.H"
#include "m4gnTimeStep.H"
#include "clockTime.H"
#include "functionObjectList.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "Time.H"
#include "timeControlFunctionObject.H"
#include <cmath>

namespace
{
//- Which times are written, by the steps of the solver
class writing
:
    public Foam::Time
{
public:
    //- The next step of the surrogate counts as the solver's steps that it
    //  stands for: writeControl timeStep, of the run and of function objects,
    //  goes on at the times at which it would without jumps
    static void count(Foam::Time& time, const Foam::label nSteps)
    {
        time.*(&writing::timeIndex_) += nSteps - 1;
    }

    //- A step of the surrogate passes multiples of writeInterval without
    //  ending there: write then, as at run times that it passes
    static void passed(Foam::Time& time, const Foam::label nSteps)
    {
        if (time.*(&writing::writeControl_) == Foam::Time::wcTimeStep)
        {
            const Foam::label interval = Foam::max
            (
                Foam::label(1),
                Foam::label(time.*(&writing::writeInterval_))
            );
            const Foam::label index = time.timeIndex();

            if (index/interval > (index - nSteps)/interval)
            {
                time.*(&writing::writeTime_) = true;
            }
        }
    }

    //- A time that is a multiple of the write interval and less than half a
    //  time step ahead counts as written, so that the solver's own steps meet
    //  it. After a step as long as the surrogate's that would be times that
    //  the solver has yet to come to: count again with the solver's deltaT.
    static void restore(Foam::Time& time)
    {
        const auto control = time.*(&writing::writeControl_);

        if (control == Foam::Time::wcRunTime || control == Foam::Time::wcAdjustableRunTime)
        {
            Foam::label& index = time.*(&writing::writeTimeIndex_);
            const Foam::scalar passed =
                time.value() - time.startTime().value()
              + 0.5*time.deltaTValue();

            index = Foam::min(index, Foam::label(passed/(time.*(&writing::writeInterval_))));
        }
    }
};

//- Does it run at times, of which those less than half a time step ahead count
//  as come?
bool atTimes(const Foam::timeControl& control)
{
    return
        control.control() == Foam::timeControl::ocRunTime
     || control.control() == Foam::timeControl::ocAdjustableRunTime;
}

//- Execute and write the function object; with deltaT where its control counts
//  times by it, so that times up to half a stride ahead are not taken for done
void runAt(Foam::functionObject& object, Foam::Time& time, const Foam::scalar deltaT)
{
    const Foam::scalar own = time.deltaTValue();
    const auto* controls =
        Foam::isA<Foam::functionObjects::timeControl>(object);

    const auto run = [&](const bool counted, const std::function<void()>& call)
    {
        if (counted)
        {
            time.setDeltaT(deltaT, false);
        }
        call();
        time.setDeltaT(own, false);
    };

    run
    (
        controls && atTimes(controls->executeControl()),
        [&]() { object.execute(); }
    );
    run
    (
        controls && atTimes(controls->writeControl()),
        [&]() { object.write(); }
    );
}

} // End anonymous namespace

bool Foam::m4gnReplace::predict()
{
    state_->beforeStride();
    inputs_.gather(session_.nodes());
    old_ = outputs_.values(session_.nodes());
    predicted_ = old_;

    return session_.step(inputs_.view(), predicted_);
}

void Foam::m4gnReplace::executeOthers
(
    const bool before,
    const bool after,
    const scalar deltaT
) const
{
    if (others_.empty())
    {
        return;
    }

    functionObjectList& list = time_.functionObjects();

    bool behind = false;
    forAll(list, i)
    {
        if (list[i].name() == name_)
        {
            behind = true;
        }
        else if ((behind ? after : before) && others_.found(list[i].name()))
        {
            runAt(list[i], time_, deltaT);
        }
    }
}

void Foam::m4gnReplace::writeLine
(
    const label nSteps,
    const scalar surrogateSeconds,
    const scalar handOverSeconds,
    const m4gnControl* control
)
{
    const List<m4gnSolverState::quantity> quantities(state_->quantities());

    Info<< "m4gn: jumped " << nSteps << " steps of " << session_.stride()
        << " s to time " << time_.timeName() << " in "
        << surrogateSeconds + handOverSeconds << " s";
    for (const m4gnSolverState::quantity& q : quantities)
    {
        Info<< "; " << q.first() << ' ' << q.second();
    }
    if (control)
    {
        Info<< "; a stride beside the solver was off by " << control->error()
            << ", " << control->estimate() << " is expected of the jump";
    }
    Info<< nl << endl;

    if (!Pstream::master() || !writeToFile())
    {
        return;
    }

    Ostream& os = file();

    if (!writtenHeader_)
    {
        writeHeader(os, "Jumps of the surrogate " + session_.model());
        writeHeaderValue(os, "stride (s)", session_.stride());
        writeCommented(os, "Time");
        writeTabbed(os, "steps");
        writeTabbed(os, "surrogate(s)");
        writeTabbed(os, "handOver(s)");
        for (const m4gnSolverState::quantity& q : quantities)
        {
            writeTabbed(os, q.first());
        }
        if (control)
        {
            writeTabbed(os, "strideError");
            writeTabbed(os, "estimate");
        }
        os  << endl;
        writtenHeader_ = true;
    }

    os  << time_.timeOutputValue()
        << tab << nSteps
        << tab << surrogateSeconds
        << tab << handOverSeconds;
    for (const m4gnSolverState::quantity& q : quantities)
    {
        os  << tab << q.second();
    }
    if (control)
    {
        os  << tab << control->error() << tab << control->estimate();
    }
    os  << endl;
}

Foam::m4gnReplace::m4gnReplace
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession& session,
    autoPtr<m4gnSolverState>&& state
)
:
    writeFile(mesh, name, "surrogate", dict),
    name_(name),
    mesh_(mesh),
    time_(const_cast<Time&>(mesh.time())),
    others_(m4gnOthers::chosen(name, mesh.time(), dict)),
    session_(session),
    state_(std::move(state)),
    stale_(mesh),
    inputs_(mesh, session.inputs()),
    outputs_(mesh, session.outputs()),
    replacedTime_(0),
    firstTime_(mesh.time().value()),
    takeoverTime_(mesh.time().value()),
    ahead_(0),
    surrogateSeconds_(0),
    handOverSeconds_(0),
    nStepsDone_(0),
    nJumps_(0),
    lastIndex_(-1),
    handedOver_(false),
    nRefused_(0)
{}

bool Foam::m4gnReplace::fits(const scalar endTime, const scalar deltaT, const scalar nStrides) const
{
    return
        time_.value() + nStrides*session_.stride()
      < min(endTime + deltaT, time_.endTime().value()) - 0.5*deltaT;
}

void Foam::m4gnReplace::solved(const label nSteps)
{
    state_->beforeStep(nSteps);
}

Foam::label Foam::m4gnReplace::extraSteps(const scalar deltaT) const
{
    const label most = std::lround(0.5*session_.stride()/deltaT);

    return min(max(label(std::lround(ahead_/deltaT)), -most), most);
}

Foam::label Foam::m4gnReplace::solverSteps(const label nSteps) const
{
    return max(nSteps - extraSteps(time_.deltaTValue()), (nSteps + 1)/2);
}

bool Foam::m4gnReplace::jump
(
    const scalar endTime,
    const label nSteps,
    const bool carriedOn,
    const scalar ahead,
    const m4gnControl* control,
    const std::function<void(label)>& written
)
{
    // Between its steps time has the surrogate's deltaT
    const scalar deltaT = time_.deltaTValue();
    const m4gnTimeStep::held solverStep(mesh_, inputs_);
    const auto fits = [&](const scalar nStrides)
    {
        return this->fits(endTime, deltaT, nStrides);
    };

    const label nSolverSteps =
        max(label(1), label(std::lround(session_.stride()/deltaT)));

    const word lastSolved(time_.timeName());

    clockTime timer;
    const scalar surrogateBefore = surrogateSeconds_;
    const scalar handOverBefore = handOverSeconds_;
    label stepi = 0;

    const auto complete = [&](const bool handOver)
    {
        timer.timeIncrement();
        state_->complete(deltaT, handOver);
        if (handOver)
        {
            state_->beforeStep(0);
        }
        handedOver_ = handOver;
        handOverSeconds_ += timer.timeIncrement();
    };

    for (; stepi < nSteps && fits(1); ++stepi)
    {
        timer.timeIncrement();
        if (!predict() || (control && !control->accepts(old_, predicted_)))
        {
            ++nRefused_;
            break;
        }
        surrogateSeconds_ += timer.timeIncrement();

        if (!stepi && !carriedOn && !nJumps_++)
        {
            takeoverTime_ = time_.value();
        }
        ++nStepsDone_;

        // The first step makes up for the clock of those before
        label nExtra = 0;
        if (!stepi && !carriedOn)
        {
            nExtra = extraSteps(deltaT);
            while (nExtra > 0 && !fits(1 + nExtra*deltaT/session_.stride()))
            {
                --nExtra;
            }
        }
        ahead_ += ahead - nExtra*deltaT;
        const scalar duration = session_.stride() + nExtra*deltaT;
        replacedTime_ += duration;

        // Function objects behind this one have not seen this time yet; in
        // front of it they have not if it is the surrogate's.
        executeOthers(stepi > 0, true, time_.deltaTValue());

        timer.timeIncrement();
        writing::count(time_, nSolverSteps + nExtra);
        state_->advance(predicted_, duration);
        lastIndex_ = time_.timeIndex();
        writing::passed(time_, nSolverSteps + nExtra);
        surrogateSeconds_ += timer.timeIncrement();

        const bool last = stepi + 1 == nSteps || !fits(1);
        const bool lastButOne = stepi + 2 == nSteps || !fits(2);
        handedOver_ = false;

        if
        (
            last || state_->completeEach() || time_.writeTime()
         || (lastButOne && state_->completeLastTwo())
         || (others_.size() && state_->completeForOthers())
        )
        {
            complete(last);
        }

        stale_.write(*state_, lastSolved);

        if (time_.writeTime())
        {
            written(last ? 0 : nSteps - stepi - 1);
        }
    }

    if (!stepi && !carriedOn)
    {
        return false;
    }

    if (!handedOver_)
    {
        // The jump ended early
        complete(true);
    }

    // Those behind this one follow when it returns
    executeOthers(true, false, deltaT);

    time_.setDeltaT(deltaT, false);
    writing::restore(time_);

    if (time_.value() > time_.endTime().value() - 0.5*deltaT)
    {
        // Stopped from outside (stopAt, a signal): Time ends a run in an
        // orderly way only after a step of the solver
        time_.setEndTime(time_.value() + deltaT);
    }

    writeLine
    (
        stepi,
        surrogateSeconds_ - surrogateBefore,
        handOverSeconds_ - handOverBefore,
        control
    );

    return true;
}

void Foam::m4gnReplace::writeState(Ostream& os) const
{
    const List<scalar> times
    ({
        firstTime_, takeoverTime_, replacedTime_,
        surrogateSeconds_, handOverSeconds_
    });

    os.beginBlock("totals");
    times.writeEntry("times", os);
    List<scalar>(1, ahead_).writeEntry("ahead", os);
    os.writeEntry("jumps", nJumps_);
    os.writeEntry("endedEarly", nRefused_);
    os.writeEntry("steps", nStepsDone_);
    os.endBlock();
}

void Foam::m4gnReplace::restore(const dictionary& state)
{
    const FixedList<scalar, 5> times(state.get<List<scalar>>("times"));

    firstTime_ = times[0];
    takeoverTime_ = times[1];
    replacedTime_ = times[2];
    surrogateSeconds_ = times[3];
    handOverSeconds_ = times[4];
    ahead_ = state.get<List<scalar>>("ahead").first();
    nJumps_ = state.get<label>("jumps");
    nRefused_ = state.get<label>("endedEarly");
    nStepsDone_ = state.get<label>("steps");
}

void Foam::m4gnReplace::end
(
    const m4gnAdapt* adapt,
    const m4gnControl* control,
    const m4gnHandBack& handBack
) const
{
    const scalar total = max(time_.value() - firstTime_, VSMALL);
    const scalar fraction = replacedTime_/total;

    Info<< "m4gn: replacedFraction = " << fraction << " (" << replacedTime_
        << " s of " << total << " s in " << nJumps_ << " jumps, "
        << nStepsDone_ << " surrogate steps; " << nRefused_
        << " jumps ended early), surrogate " << surrogateSeconds_
        << " s, hand-over " << handOverSeconds_ << " s, setup "
        << session_.setupSeconds() << " s" << nl << endl;

    if (!Pstream::master())
    {
        return;
    }

    const fileName dir(m4gn::outputDir(name_, mesh_));
    mkDir(dir);
    OFstream os(dir/"summary.json");

    os  << "{\n";
    if (adapt)
    {
        adapt->writeSummary(os);
    }
    if (control)
    {
        control->writeSummary(os);
    }
    handBack.writeSummary(os);
    os  << "  \"replaced_time\": " << replacedTime_ << ",\n"
        << "  \"solver_time\": " << total - replacedTime_ << ",\n"
        << "  \"replaced_fraction\": " << fraction << ",\n"
        << "  \"takeover_time\": " << takeoverTime_ << ",\n"
        << "  \"jumps\": " << nJumps_ << ",\n"
        << "  \"jumps_ended_early\": " << nRefused_ << ",\n"
        << "  \"surrogate_steps\": " << nStepsDone_ << ",\n"
        << "  \"stride\": " << session_.stride() << ",\n"
        << "  \"surrogate_seconds\": " << surrogateSeconds_ << ",\n"
        << "  \"hand_over_seconds\": " << handOverSeconds_ << ",\n"
        << "  \"setup_seconds\": " << session_.setupSeconds() << "\n"
        << "}\n";

    if (!os.good())
    {
        FatalErrorInFunction
            << "Cannot write " << os.name() << exit(FatalError);
    }
}
