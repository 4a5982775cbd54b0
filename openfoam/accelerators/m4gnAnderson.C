// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnAnderson.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnClock.H"
#include "m4gnCaseChecks.H"
#include "m4gnDictionary.H"
#include "pointFields.H"
#include "surfaceFields.H"
#include "volFields.H"

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
//- Most time steps that are left to the solver after one without a solution
const Foam::label maxPause = 63;

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

    static Foam::scalar saved(const Foam::Time& time)
    {
        Foam::scalar Foam::TimeState::*const member = &nextStep::deltaTSave_;
        return time.*member;
    }

public:
    explicit nextStep(Foam::Time& time)
        : time_(time), before_(time.value()), indexBefore_(time.timeIndex()),
          deltaT0Before_(time.deltaT0Value())
    {
        time_.setTime(before_ + time_.deltaTValue(), indexBefore_ + 1);
        deltaT0(time_) = saved(time_);
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

    m4gn::checkSolver(*this);

    law_ = m4gnSolidLaw::New(mesh_);
    if (!law_ || !law_->steps()) {
        const word model(m4gn::solidModel(mesh_));

        FatalErrorInFunction << "Function object " << name() << " of type " << type()
                             << " needs a cell-centred solid of solids4foam (linearGeometry,"
                             << " nonLinearGeometryTotalLagrangian, both also with"
                             << " TotalDisplacement, nonLinearGeometryUpdatedLagrangian) of one"
                             << " material without solvePressureEqn, and libm4gnSolids4Foam.so"
                             << " (setup/solids4foam.sh); found "
                             << (model.empty() ? word("no solid of solids4foam") : model) << nl
                             << "    Remove " << name() << " from functions" << exit(FatalError);
    }

    m4gn::checkLast(*this, time_, "the next time step");
}

void Foam::functionObjects::m4gnAnderson::solveNext()
{
    const scalar deltaT = time_.deltaTValue();
    if (time_.value() > time_.endTime().value() - 0.5 * deltaT) {
        return;
    }
    if (wait_ > 0) {
        --wait_;
        ++nLeft_;
        return;
    }

    const m4gnClock timer;
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

        nCorrectors = law_->step();
    }
    seconds_ += timer.elapsed();

    if (nCorrectors < 0) {
        // An attempt in vain costs as much as a hard time step
        wait_ = pause_;
        pause_ = min(2 * pause_ + 1, maxPause);
        ++nLeft_;
        Info << "m4gn: no solution was found for the next time step, which is"
             << " left to the solver, with " << wait_ << " after it" << nl << endl;
    } else {
        pause_ = 0;
        ++nSolved_;
        nCorrectors_ += nCorrectors;
        Info << "m4gn: the next time step is solved in " << nCorrectors << " correctors" << nl << endl;
    }
}

Foam::functionObjects::m4gnAnderson::m4gnAnderson(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), started_(false), due_(false), timeStart_(-VGREAT), wait_(0),
      pause_(0), nSolved_(0), nCorrectors_(0), nLeft_(0), seconds_(0)
{
    read(dict);
}

bool Foam::functionObjects::m4gnAnderson::read(const dictionary& dict)
{
    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);
    m4gn::checkKeys(dict, {}, true);
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
    start();
    due_ = true;

    return true;
}

bool Foam::functionObjects::m4gnAnderson::write() { return true; }

bool Foam::functionObjects::m4gnAnderson::end()
{
    Info << "m4gn: " << nSolved_ << " time steps solved ahead in " << nCorrectors_ << " correctors and "
         << seconds_ << " s, " << nLeft_ << " left to the solver" << nl << endl;

    return true;
}
