// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnAnderson.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnCaseChecks.H"
#include "m4gnDictionary.H"
#include "m4gnFieldFiles.H"
#include "m4gnLastStep.H"
#include "m4gnSolidDisplacement.H"
#include "m4gnSolidLaw.H"
#include "pointFields.H"
#include "surfaceFields.H"
#include "volFields.H"
#include <ctime>

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnAnderson, 0);
addToRunTimeSelectionTable(functionObject, m4gnAnderson, dictionary);
}
}

namespace
{
//- Most correctors of a time step
const Foam::label maxCorrectors = 500;

//- Of the time of steps that are left to the solver, what is spent on others that may not pay
const Foam::scalar allowed = 0.02;

//- Most that counts as saved, in time steps of the solver
const Foam::scalar maxSaved = 20;

//- Time steps that are solved before one is left to the solver to compare with, where so many are to come, or so few
//  correctors were needed that the solver may need no more; later ones are so many times what was gained by then
const Foam::label firstCompared = 3;
const Foam::label manySteps = 32;
const Foam::label fewCorrectors = 5;
const Foam::scalar comparedEvery = 64;

//- Most that their number grows from one such time step to the next
const Foam::scalar growth = 8;

//- Processor time of all ranks so far (s)
Foam::scalar processorTime()
{
    return Foam::returnReduce(Foam::scalar(std::clock()) / CLOCKS_PER_SEC, Foam::sumOp<Foam::scalar>());
}

//- The run's time is that of the next time step while this lives
class nextStep : public Foam::TimeState
{
    Foam::Time& time_;
    const Foam::scalar before_;
    const Foam::label indexBefore_;
    const Foam::scalar deltaT0Before_;

    static Foam::scalar& deltaT0(Foam::Time& time)
    {
        Foam::scalar Foam::TimeState::*const member = &nextStep::deltaT0_;
        return time.*member;
    }

public:
    explicit nextStep(Foam::Time& time)
        : time_(time), before_(time.value()), indexBefore_(time.timeIndex()),
          deltaT0Before_(time.deltaT0Value())
    {
        time_.setTime(before_ + time_.deltaTValue(), indexBefore_ + 1);
        deltaT0(time_) = Foam::m4gnLastStep::of(time_);
    }

    ~nextStep()
    {
        time_.setTime(before_, indexBefore_);
        deltaT0(time_) = deltaT0Before_;
    }
};

//- Fields of a type that have old levels store them, as the first access of a
//  time step would
template <class FieldType> void storeOldTimes(const Foam::fvMesh& mesh)
{
    for (const Foam::word& name : mesh.names<FieldType>()) {
        mesh.lookupObject<FieldType>(name).storeOldTimes();
    }
}

} // End anonymous namespace

void Foam::functionObjects::m4gnAnderson::start()
{
    if (started_) {
        return;
    }
    started_ = true;

    // When it acts all others have been executed, but m4gnSurrogate jumps then
    m4gn::checkLast(*this, time_, "the next time step", "m4gnSurrogate");

    why_ = "neither solids4Foam nor solidDisplacementFoam solves for a solid on the mesh " + mesh_.name();
    if (m4gnSolidDisplacement::registered(mesh_)) {
        correctors_.reset(new m4gnSolidDisplacement(mesh_));
    } else if (!m4gn::solidModel(mesh_).empty()) {
        correctors_.reset(m4gnSolidLaw::New(mesh_, &why_).release());
    }
    if (correctors_) {
        why_ = correctors_->cannotStep();
    }
    if (!why_.empty()) {
        correctors_.clear();
        Info << "m4gn: " << name() << " leaves all time steps to the solver: " << why_.c_str() << nl << endl;
    }
}

Foam::label Foam::functionObjects::m4gnAnderson::affordable() const
{
    if (plain_ <= 0 || corrector_ <= 0) {
        return maxCorrectors;
    }

    // No more than the step takes without it, and what was saved before
    const scalar correctors = (plain_ + saved_) / corrector_;

    return correctors < maxCorrectors ? max(label(correctors), label(2)) : maxCorrectors;
}

bool Foam::functionObjects::m4gnAnderson::pays()
{
    const scalar remaining = (time_.endTime().value() - time_.value()) / time_.deltaTValue();
    const bool due = toCompare_ <= 0 && (remaining > manySteps || latest_ <= fewCorrectors);

    // Where the machine was slow since, the solver's time step is dearer too: it is measured anew before anything is
    // spent in vain, and then the corrector
    const bool dear = affordable() < latest_ && toCompare_ != compared_;
    const bool comparing = compare_ && (due || dear);
    if (saved_ >= 0 && !comparing) {
        return true;
    }

    if (saved_ < 0 && !leaving_) {
        Info << "m4gn: time steps are left to the solver, which is no slower: " << name()
             << " tries again where " << 100 * allowed << " % of their time make up for it" << nl << endl;
    }
    leaving_ = saved_ < 0;

    return false;
}

void Foam::functionObjects::m4gnAnderson::account()
{
    // One in which a surrogate jumped is of another kind, and those behind it are hard for the solver; so is one with a
    // time to write where the others have none
    const bool jumped = time_.timeIndex() != index_ + 1;
    const bool counts = !jumped && time_.writeTime() == written_;
    if (jumped) {
        toCompare_ = max(toCompare_, firstCompared);
    }
    const scalar taken = processorTime() - began_;

    if (!solved_) {
        if (counts) {
            plain_ = taken - attempt_;
        }
        // It may have been slow by chance: what is far beyond the last interval waits for another one
        const scalar interval = comparedEvery * min(plain_ / max(helped_, VSMALL), 1e3);
        compared_ = label(max(scalar(firstCompared), min(interval, growth * compared_)));
        toCompare_ = compared_;
        saved_ += attempt_ > 0 ? -attempt_ : allowed * plain_;

        // What was lost is forgotten where the solver takes longer
        if (plain_ > helped_) {
            saved_ = max(saved_, scalar(0));
        }
        return;
    }

    --toCompare_;
    if (counts) {
        // What others do now and then in a time step is no part of it
        helped_ = min(taken, last_);
        last_ = taken;
        if (plain_ > 0) {
            saved_ = min(saved_ + max(plain_ - helped_, compare_ ? -plain_ : scalar(0)), maxSaved * plain_);
        }
    }
}

void Foam::functionObjects::m4gnAnderson::solveNext()
{
    const scalar deltaT = time_.deltaTValue();
    if (!correctors_ || time_.value() > time_.endTime().value() - 0.5 * deltaT) {
        return;
    }
    began_ = processorTime();
    index_ = time_.timeIndex();
    attempt_ = 0;
    solved_ = false;
    if (!pays()) {
        ++nLeft_;
        return;
    }

    label nCorrectors = 0;
    {
        const nextStep next(const_cast<Time&>(time_));

        storeOldTimes<volScalarField>(mesh_);
        storeOldTimes<volVectorField>(mesh_);
        storeOldTimes<volTensorField>(mesh_);
        storeOldTimes<volSymmTensorField>(mesh_);
        storeOldTimes<surfaceScalarField>(mesh_);
        storeOldTimes<surfaceVectorField>(mesh_);
        storeOldTimes<surfaceTensorField>(mesh_);
        storeOldTimes<surfaceSymmTensorField>(mesh_);
        storeOldTimes<pointVectorField>(mesh_);

        nCorrectors = correctors_->step(max(affordable(), latest_));
    }
    attempt_ = processorTime() - began_;
    solved_ = nCorrectors >= 0;

    if (!solved_) {
        helped_ = last_ = GREAT;
        ++nLeft_;
        Info << "m4gn: the next time step is left to the solver" << nl << endl;
    } else {
        ++nSolved_;
        nCorrectors_ += nCorrectors;
        latest_ = nCorrectors;
        spent_ += attempt_;
        corrector_ = attempt_ / nCorrectors;
        Info << "m4gn: the next time step is solved in " << nCorrectors << " correctors" << nl << endl;
    }
}

Foam::functionObjects::m4gnAnderson::m4gnAnderson(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), started_(false), due_(false), timeStart_(-VGREAT),
      compare_(true), began_(0), index_(-1), attempt_(0), solved_(false), written_(true), plain_(0),
      helped_(GREAT), last_(GREAT), saved_(0), corrector_(0), latest_(0), toCompare_(firstCompared),
      compared_(firstCompared), leaving_(false), nSolved_(0), nCorrectors_(0), nLeft_(0), spent_(0)
{
    read(dict);
}

bool Foam::functionObjects::m4gnAnderson::read(const dictionary& dict)
{
    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);
    m4gn::checkKeys(dict, {"compare"}, true);
    compare_ = dict.getOrDefault<bool>("compare", true);
    timeStart_ = dict.getOrDefault<scalar>("timeStart", -VGREAT);

    return true;
}

bool Foam::functionObjects::m4gnAnderson::filesModified() const
{
    const bool first = !started_ && !postProcess && time_.value() >= timeStart_;

    if (first || due_) {
        auto& self = const_cast<m4gnAnderson&>(*this);
        self.due_ = false;
        self.start();
        self.solveNext();
    }

    return false;
}

bool Foam::functionObjects::m4gnAnderson::execute()
{
    if (m4gn::onStoredTimes(*this)) {
        return true;
    }
    start();
    due_ = true;
    if (correctors_ && index_ >= 0) {
        if (nSolved_ + nLeft_ <= 2) {
            written_ = written_ && time_.writeTime();
        }
        account();
    }

    return true;
}

bool Foam::functionObjects::m4gnAnderson::write() { return true; }

bool Foam::functionObjects::m4gnAnderson::end()
{
    if (correctors_) {
        Info << "m4gn: " << nSolved_ << " time steps solved ahead in " << nCorrectors_ << " correctors and "
             << spent_ << " s, " << nLeft_ << " left to the solver" << nl << endl;
    }
    if (started_ && Pstream::master()) {
        dictionary summary;
        summary.set("time_steps_solved", nSolved_);
        summary.set("correctors", nCorrectors_);
        summary.set("seconds", spent_);
        summary.set("time_steps_left", nLeft_);
        if (!why_.empty()) {
            summary.set("why", why_);
        }
        m4gnFieldFiles files;
        files.write(
            time_, m4gn::outputDir(name(), mesh_) / "summary.json",
            [&](Ostream& os) { os << m4gn::json(summary).c_str() << endl; }, true);
        files.rename();
    }

    return true;
}
