// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPredictor.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnDictionary.H"
#include "m4gnActiveSurrogate.H"
#include "m4gnCaseChecks.H"
#include "m4gnLastStep.H"
#include "m4gnVersion.H"

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnPredictor, 0);
addToRunTimeSelectionTable(functionObject, m4gnPredictor, dictionary);
}
}

namespace
{
//- Relative change of the boundary values, between sweeps over them and
//  the stress, that is small beside the error of a guess
const Foam::scalar converged = 1e-5;
}

const Foam::dictionary& Foam::functionObjects::m4gnPredictor::controls() const
{
    return mesh_.solutionDict().subDict("stressAnalysis");
}

void Foam::functionObjects::m4gnPredictor::checkConverged()
{
    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(DName_, solves);
    const scalar tolerance = controls().getOrDefault<scalar>("D", 0);
    const label most = controls().getOrDefault<label>("nCorrectors", 1);
    if (solves.size() < most || cmptMax(solves.last().initialResidual()) <= tolerance) {
        return;
    }
    if (!nUnconverged_++) {
        WarningInFunction << "The time step to " << time_.timeName() << " s ended at nCorrectors " << most
                          << " with a residual of " << cmptMax(solves.last().initialResidual())
                          << "; expected less than entry D of stressAnalysis, " << tolerance << nl
                          << "    A guess changes the result of such a time step. Raise nCorrectors, or"
                          << " remove " << name() << endl;
    }
}

void Foam::functionObjects::m4gnPredictor::checkRun() const
{
    if (!m4gnExplicitStress::registered(mesh_) || !foundObject<volVectorField>(DName_)) {
        FatalErrorInFunction << "Function object " << name() << " of type " << type()
                             << " needs a displacement " << DName_ << ", sigmaD, divSigmaExp,"
                             << " E, nu and rho (solidDisplacementFoam)" << exit(FatalError);
    }

    const label nCorrectors = controls().getOrDefault<label>("nCorrectors", 1);
    if (nCorrectors < 2) {
        FatalErrorInFunction << "Entry nCorrectors of stressAnalysis in fvSolution is " << nCorrectors
                             << ": time steps are not iterated to the tolerance,"
                             << " and a guess would change the result" << nl
                             << "    Set nCorrectors to the most that a time step may need (some"
                             << " hundreds) and D to a tolerance, or remove " << name() << exit(FatalError);
    }

    const word replacer(m4gnActiveSurrogate::before(VGREAT));
    if (replacer.size()) {
        FatalErrorInFunction << "Function object " << name() << " predicts for a solver that " << replacer
                             << " replaces" << nl << "    Have one of them in a run" << exit(FatalError);
    }
}

void Foam::functionObjects::m4gnPredictor::remember(const vectorField& D)
{
    const label now = time_.timeIndex();

    if (now != timeIndex_ + 1) {
        nStates_ = 0;
    }
    oldOld_.transfer(old_);
    old_.transfer(last_);
    last_ = D;
    nStates_ = min(nStates_ + 1, label(3));
    timeIndex_ = now;
    deltaTOld_ = deltaT_;
    deltaT_ = m4gnLastStep::of(time_);
}

Foam::tmp<Foam::vectorField> Foam::functionObjects::m4gnPredictor::guess() const
{
    if (nStates_ < (quadratic_ ? 3 : 2)) {
        return nullptr;
    }

    const scalar deltaT = time_.deltaTValue();
    const vectorField rate((last_ - old_) / deltaT_);

    if (!quadratic_) {
        return deltaT * rate;
    }

    return parabola(deltaT, deltaT_, deltaTOld_, rate, (old_ - oldOld_) / deltaTOld_);
}

Foam::tmp<Foam::vectorField> Foam::functionObjects::m4gnPredictor::parabola(
    const scalar deltaT, const scalar deltaT0, const scalar deltaT00, const vectorField& rate,
    const vectorField& before)
{
    return deltaT * (rate + ((deltaT + deltaT0) / (deltaT0 + deltaT00)) * (rate - before));
}

Foam::functionObjects::m4gnPredictor::m4gnPredictor(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), DName_("D"), quadratic_(false), timeIndex_(-1), deltaT_(0),
      deltaTOld_(0), nStates_(0), nUnconverged_(0)
{
    read(dict);
}

bool Foam::functionObjects::m4gnPredictor::read(const dictionary& dict)
{
    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);
    m4gn::checkStatic(mesh_, dict);
    m4gn::checkKeys(dict, {"predictor", "D"}, true);

    const word predictor(dict.getOrDefault<word>("predictor", "linear"));
    if (predictor != "linear" && predictor != "quadratic") {
        FatalIOErrorInFunction(dict) << "Entry predictor is " << predictor << "; expected linear or quadratic"
                                     << exit(FatalIOError);
    }
    quadratic_ = predictor == "quadratic";
    DName_ = dict.getOrDefault<word>("D", "D");

    return true;
}

bool Foam::functionObjects::m4gnPredictor::execute()
{
    if (m4gn::onStoredTimes(*this)) {
        return true;
    }
    if (!stress_) {
        checkRun();
        stress_.reset(new m4gnExplicitStress(mesh_));
    }
    // Each time: controlDict may have got more function objects
    m4gn::checkLast(*this, time_, "a guess");

    checkConverged();

    volVectorField& D = lookupObjectRef<volVectorField>(DName_);

    remember(D.primitiveField());

    const bool last = time_.value() > time_.endTime().value() - 0.5 * time_.deltaTValue();
    const tmp<vectorField> change(guess());

    if (last || !change.valid()) {
        return true;
    }

    // As the solver does when the next time step begins
    D.storeOldTime();
    D.primitiveFieldRef() += change();
    stress_->update(D, converged);

    // It has been done. Not earlier: every access but this one would do it
    // again.
    D.timeIndex() = time_.timeIndex() + 1;

    return true;
}

bool Foam::functionObjects::m4gnPredictor::write() { return true; }

bool Foam::functionObjects::m4gnPredictor::end()
{
    if (nUnconverged_) {
        Info << "m4gn: " << nUnconverged_ << " time steps ended at nCorrectors, and have another result than"
             << " without " << name() << nl << endl;
    }

    return true;
}
