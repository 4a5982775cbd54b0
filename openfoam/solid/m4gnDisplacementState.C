// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnDisplacementState.H"
#include "m4gnDictionary.H"
#include "m4gnOwnFields.H"
#include "Time.H"

namespace
{
//- Time's deltaT0 of the next time step is the deltaT of this one. A stride is
//  no step of the solver: give it the solver's own.
struct previousStep : public Foam::TimeState
{
    static void set(Foam::Time& time, const Foam::scalar deltaT)
    {
        Foam::scalar Foam::TimeState::*saved = &previousStep::deltaTSave_;
        static_cast<Foam::TimeState&>(time).*saved = deltaT;
    }
};

} // End anonymous namespace

Foam::volVectorField& Foam::m4gnDisplacementState::D() const
{
    return mesh_.lookupObjectRef<volVectorField>(DName_);
}

Foam::volVectorField& Foam::m4gnDisplacementState::rate() const
{
    return mesh_.lookupObjectRef<volVectorField>(m4gnOwnFields::rateOf(DName_));
}

Foam::word Foam::m4gnDisplacementState::displacementName(const dictionary& dict)
{
    return dict.getOrDefault<word>("D", "D");
}

void Foam::m4gnDisplacementState::update() { D().correctBoundaryConditions(); }

Foam::m4gnDisplacementState::m4gnDisplacementState(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnModelState(mesh, dict, session), DName_(displacementName(dict)), dynamic_(false)
{
    refuseHistory();

    const word used(m4gn::scheme(mesh_.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName_ + ')'));

    if (used != "Euler" && used != "steadyState") {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << used << nl << "    Handled: Euler, steadyState"
                             << exit(FatalError);
    }
    dynamic_ = used == "Euler";

    wordList needed(1, DName_);
    if (dynamic_) {
        needed.append(m4gnOwnFields::rateOf(DName_));
    }

    for (const word& name : needed) {
        if (!session_.outputs().found(name)) {
            FatalErrorInFunction << "The solver carries on from " << m4gn::join(needed) << " (d2dt2Schemes "
                                 << used << "); the model " << session_.model() << " advances "
                                 << m4gn::join(session_.outputs()) << nl
                                 << "    Record these fields, and train a model that predicts"
                                 << " them" << exit(FatalError);
        }
    }
}

void Foam::m4gnDisplacementState::advance(const List<scalarField>& predicted, const scalar duration)
{
    step(duration);

    forAll(predicted, outputi) {
        impose(outputi, predicted[outputi]);
    }

    update();

    if (dynamic_) {
        const volVectorField& old = D().oldTime();
        const scalar rDuration = 1 / duration;

        // Predicted, and not to be computed from D anew
        rate().timeIndex() = time_.timeIndex();

        auto& boundary = rate().boundaryFieldRef();
        forAll(boundary, patchi) {
            boundary[patchi] == rDuration*(D().boundaryField()[patchi] - old.boundaryField()[patchi]);
        }
        rate().correctBoundaryConditions();
    }
}

void Foam::m4gnDisplacementState::complete(const scalar deltaT, const bool handOver)
{
    if (handOver) {
        smooth();
    }

    if (dynamic_) {
        D().oldTime().primitiveFieldRef() = D().primitiveField() - deltaT * rate().primitiveField();
        previousStep::set(time_, deltaT);
    }
}

Foam::wordList Foam::m4gnDisplacementState::advanced() const
{
    // sigmaD and divSigmaExp: of solidDisplacementFoam
    wordList names(m4gnModelState::advanced());
    names.append(wordList({DName_, m4gnOwnFields::rateOf(DName_), "sigmaD", "divSigmaExp"}));
    return names;
}

Foam::List<Foam::m4gnSolverState::quantity> Foam::m4gnDisplacementState::quantities() const
{
    const tmp<scalarField> magD(mag(D().primitiveField()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
