// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSurrogate.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnAdapt.H"
#include "m4gnContactProjection.H"
#include "m4gnControl.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnElasticSmoothing.H"
#include "m4gnHandBack.H"
#include "m4gnObserve.H"
#include "m4gnOthers.H"
#include "m4gnReplace.H"
#include "m4gnRestart.H"
#include "m4gnRun.H"
#include "m4gnSession.H"
#include "m4gnSettling.H"
#include "m4gnSolverState.H"
#include "m4gnFluxProjection.H"

namespace Foam
{
namespace functionObjects
{
    defineTypeNameAndDebug(m4gnSurrogate, 0);
    addToRunTimeSelectionTable(functionObject, m4gnSurrogate, dictionary);
}
}

const Foam::Enum<Foam::functionObjects::m4gnSurrogate::modeType>
Foam::functionObjects::m4gnSurrogate::modeNames_
({
    { modeType::OBSERVE, "observe" },
    { modeType::REPLACE, "replace" },
});

bool Foam::functionObjects::m4gnSurrogate::jumping_ = false;

void Foam::functionObjects::m4gnSurrogate::checkOthers() const
{
    const bool replaces = mode_ == modeType::REPLACE;
    const word other(m4gnReplacer::before(replaces ? VGREAT : timeEnd_, this));

    if (other.size() && replaces)
    {
        FatalErrorInFunction
            << "Both function objects " << name() << " and " << other
            << " replace the solver: one would jump right"
            << " after the other, without a step of the solver between" << nl
            << "    Have one of mode replace in a run"
            << exit(FatalError);
    }

    if (other.size())
    {
        FatalErrorInFunction
            << "Function object " << name() << " of mode "
            << modeNames_[mode_] << " stands beside a solver that "
            << other << " replaces" << nl
            << "    Have it in a run without mode replace, or give "
            << name() << " a timeEnd that is not later than the timeStart"
            << " of " << other << exit(FatalError);
    }
}

void Foam::functionObjects::m4gnSurrogate::load()
{
    if (!session_)
    {
        session_.reset(new m4gnSession(mesh_, dict_, ownKeys_));
        if (mode_ == modeType::REPLACE)
        {
            state_ = m4gnSolverState::New(mesh_, dict_, *session_);
            digest_ = m4gnRestart::digest(session_->model());
        }
    }
}

bool Foam::functionObjects::m4gnSurrogate::adapts()
{
    const scalar half = 0.5*time_.deltaTValue();

    if (!m4gnAdapt::wanted(dict_) || time_.value() > timeEnd_ + half)
    {
        return false;
    }

    if (!adapt_)
    {
        // A run that is carried on goes on with its frames
        if (time_.value() < adaptStart_ - half && !m4gnAdapt::stored(name(), time_))
        {
            return false;
        }

        load();
        adapt_.reset(new m4gnAdapt(name(), mesh_, dict_, *session_));
    }

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::controls()
{
    if (mode_ != modeType::REPLACE || !m4gnEstimate::wanted(dict_))
    {
        return false;
    }

    load();

    if (!control_)
    {
        control_.reset(new m4gnControl(mesh_, dict_, *session_));
    }

    // From early enough before the first jump for a stride
    const scalar half = 0.5*time_.deltaTValue();

    return
        time_.value() > timeStart_ - 1.5*session_->stride() - half
     && time_.value() < timeEnd_ + half;
}

bool Foam::functionObjects::m4gnSurrogate::jump(const label nSteps, const bool carriedOn)
{
    if (!nSteps && !carriedOn)
    {
        return false;
    }

    solverDeltaT_ = time_.deltaTValue();
    jumping_ = true;
    const bool done =
        !nSteps
     || replace_->jump
        (
            timeEnd_,
            nSteps,
            carriedOn,
            adapt_ ? adapt_->ahead(replace_->jumps() > carriedOn) : 0,
            control_.get(),
            [this](const label left) { save(left); }
        );
    jumping_ = false;

    if (done)
    {
        handedBack_ = time_.timeIndex();
        handBack_->handedBack(replace_->stepsDone());
    }

    return done;
}

bool Foam::functionObjects::m4gnSurrogate::jumped()
{
    const scalar half = 0.5*time_.deltaTValue();
    const bool over = time_.value() > timeEnd_ + half;

    // What does not fit is said now, and not after the hours to timeStart
    if (!over)
    {
        load();
    }

    if (over || time_.value() < timeStart_ - half)
    {
        return false;
    }

    if (mode_ == modeType::OBSERVE)
    {
        if (!observe_)
        {
            if (adapt_)
            {
                adapt_->run(dict_.getOrDefault<label>("rolloutSteps", 50));
            }
            observe_.reset(new m4gnObserve(name(), mesh_, dict_, *session_));
        }
        observe_->execute();
        return false;
    }

    if (!replace_)
    {
        replace_.reset(new m4gnReplace(name(), mesh_, dict_, *session_, std::move(state_)));
    }

    if
    (
        time_.timeIndex() - handedBack_ < replace_->solverSteps(solverSteps_)
     || (control_ && !control_->fresh())
    )
    {
        return false;
    }

    const label most = handBack_->most(dict_.get<label>("surrogateSteps"));

    if (!most)
    {
        return false;
    }

    if (adapt_ && replace_->fits(timeEnd_, time_.deltaTValue()))
    {
        adapt_->run(most);
    }

    return jump(control_ ? control_->steps(most) : most, false);
}

void Foam::functionObjects::m4gnSurrogate::advance(const label left)
{
    const bool inJump = left >= 0;

    if (adapts() && !inJump)
    {
        adapt_->frame(false);
    }

    const bool controlled = controls();

    if (controlled && !inJump)
    {
        control_->measure();
    }

    const bool handedBack = inJump ? jump(left, true) : jumped();

    if (handedBack && adapt_)
    {
        adapt_->frame(true);
    }

    if (controlled)
    {
        control_->begin(handedBack);
    }
}

Foam::functionObjects::m4gnSurrogate::m4gnSurrogate
(
    const word& name,
    const Time& runTime,
    const dictionary& dict
)
:
    fvMeshFunctionObject(name, runTime, dict),
    m4gnReplacer(name),
    mode_(modeType::OBSERVE),
    solverSteps_(1),
    timeStart_(-VGREAT),
    timeEnd_(VGREAT),
    handedBack_(runTime.startTimeIndex()),
    solverDeltaT_(0),
    started_(false),
    adaptStart_(-VGREAT)
{
    read(dict);

    // The dictionary is that of Foam::functionObjects::timeControl, which
    // reads it when this object is made, and then does not execute it before
    // timeStart. The model learns and is measured before, the state of the
    // run is written before, and timeStart is heeded here.
    const_cast<dictionary&>(dict).remove("timeStart");
}

Foam::functionObjects::m4gnSurrogate::~m4gnSurrogate() = default;

Foam::scalar Foam::functionObjects::m4gnSurrogate::replacesFrom() const
{
    return mode_ == modeType::REPLACE ? timeStart_ : VGREAT;
}

Foam::m4gnReplacer::state
Foam::functionObjects::m4gnSurrogate::lastState(const fvMesh& mesh) const
{
    if (&mesh != &mesh_ || !replace_)
    {
        return {-1, false, 0};
    }

    return {replace_->lastIndex(), replace_->handedOver(), solverDeltaT_};
}

bool Foam::functionObjects::m4gnSurrogate::read(const dictionary& dict)
{
    if (session_)
    {
        Log << type() << ' ' << name() << ": goes on as it was begun; changes"
            << " to the dictionary take effect in the next run" << endl;
        return true;
    }

    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);
    m4gn::checkStatic(mesh_, dict);

    ownKeys_ =
    {
        "mode", "solverSteps", "surrogateSteps", "rolloutSteps", "writeErrors",
        "phi", "state", "executeOthers", "adapt", "control", "writePrecision", "writeToFile",
        "useUserTime"
    };
    ownKeys_.append(m4gnSolverState::keys(dict));
    m4gn::checkDictionaries(dict, {"nodeTypes", "segments", "projection", "adapt", "control"});
    m4gnOthers::checkDictionary(dict);

    const word mode(dict.get<word>("mode"));
    if (!modeNames_.found(mode))
    {
        FatalIOErrorInFunction(dict)
            << "Entry mode is " << mode << "; expected "
            << m4gn::join(modeNames_.sortedToc())
            << exit(FatalIOError);
    }
    mode_ = modeNames_.get(mode);

    m4gnSession::checkDictionary(dict, time_.globalPath(), ownKeys_);
    m4gnAdapt::checkDictionary(dict);
    m4gnEstimate::checkDictionary(dict);

    if (mode_ == modeType::REPLACE)
    {
        solverSteps_ = dict.get<label>("solverSteps");
        m4gn::checkAtLeast(dict, "solverSteps", solverSteps_, 1);
        m4gn::checkAtLeast(dict, "surrogateSteps", dict.get<label>("surrogateSteps"), 1);
        const m4gnFluxProjection checked(mesh_, dict);
        m4gnElasticSmoothing::checkDictionary(dict);
        m4gnSettling::checkDictionary(dict);
        m4gnContactProjection::checkDictionary(dict);
    }
    else
    {
        if (m4gnNodes::atPoints(dict))
        {
            FatalIOErrorInFunction(dict)
                << "Entry location is points, which is for mode replace; mode "
                << mode << " works with fields of cells"
                << exit(FatalIOError);
        }
        m4gn::checkAtLeast(dict, "rolloutSteps", dict.getOrDefault<label>("rolloutSteps", 50), 1);
    }

    timeStart_ = dict.getOrDefault<scalar>("timeStart", -VGREAT);
    timeEnd_ = dict.getOrDefault<scalar>("timeEnd", VGREAT);

    if (m4gnAdapt::wanted(dict))
    {
        adaptStart_ = m4gnAdapt::start(dict, time_, timeStart_);
    }

    dict_ = dict;

    if (mode_ == modeType::REPLACE)
    {
        handBack_.reset(new m4gnHandBack(mesh_, dict.getOrDefault<word>("D", "D")));
    }

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::execute()
{
    m4gn::checkSolver(*this);

    if (!session_)
    {
        checkOthers();
    }

    // Foam::functionObjects::timeControl executes again what has led to
    // another time: there the solver has not made a step
    if (jumping_ || time_.timeIndex() == handedBack_)
    {
        return true;
    }

    if (handBack_)
    {
        handBack_->stepped();
    }
    if (replace_ && replace_->jumps())
    {
        replace_->solved(time_.timeIndex() - handedBack_);
    }

    // What a run that is carried on from here begins with
    if (time_.writeTime())
    {
        save(-1);
    }

    advance(-1);

    return true;
}

bool Foam::functionObjects::m4gnSurrogate::write()
{
    return true;
}

bool Foam::functionObjects::m4gnSurrogate::end()
{
    if (observe_)
    {
        observe_->end();
    }
    if (replace_)
    {
        replace_->end(adapt_.get(), control_.get(), *handBack_);
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
