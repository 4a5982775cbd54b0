// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnDisplacementCompletion.H"
#include "m4gnDictionary.H"
#include "m4gnLastStep.H"
#include "m4gnOwnFields.H"
#include "Time.H"

Foam::volVectorField& Foam::m4gnDisplacementCompletion::D() const
{
    return mesh_.lookupObjectRef<volVectorField>(DName_);
}

Foam::volVectorField& Foam::m4gnDisplacementCompletion::rate() const
{
    return mesh_.lookupObjectRef<volVectorField>(m4gnOwnFields::rateOf(DName_));
}

Foam::word Foam::m4gnDisplacementCompletion::displacementName(const dictionary& dict, const word& usual)
{
    return dict.getOrDefault<word>("D", usual);
}

void Foam::m4gnDisplacementCompletion::update() { D().correctBoundaryConditions(); }

void Foam::m4gnDisplacementCompletion::useLaw(const dictionary& dict, const bool atPoints)
{
    law_ = m4gnSolidLaw::New(mesh_);
    relaxation_ = m4gnRelaxation::New(mesh_, dict, session_.stride(), atPoints, law_, dynamic_);
}

bool Foam::m4gnDisplacementCompletion::leftAsPredicted(const scalar deltaT, const bool handOver)
{
    if (!completeLastTwo()) {
        return false;
    }

    const bool relaxed = relaxation_->relax(*law_, displacements(), rates(), accelerations(), deltaT);
    if (handOver) {
        relaxation_->end();
    }
    return !relaxed;
}

void Foam::m4gnDisplacementCompletion::checkSolver(const HashTable<wordList>& rates, const char* how) const
{
    refuseHistory();

    if (!rates.found(scheme_)) {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << scheme_ << nl
                             << "    Handled: " << m4gn::join(rates.sortedToc()) << exit(FatalError);
    }

    wordList needed(1, DName_);
    needed.append(rates[scheme_]);
    checkAdvanced(needed, scheme_, how);
}

Foam::m4gnDisplacementCompletion::m4gnDisplacementCompletion(
    const fvMesh& mesh, const m4gnSession& session, const word& DName)
    : m4gnCompletion(mesh, session), DName_(DName),
      scheme_(m4gn::scheme(mesh.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName + ')')),
      dynamic_(scheme_ != "steadyState"), followed_(false)
{}

Foam::m4gnDisplacementCompletion::m4gnDisplacementCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnDisplacementCompletion(mesh, session, displacementName(dict))
{
    checkSolver({{"Euler", {m4gnOwnFields::rateOf(DName_)}}, {"steadyState", {}}}, "");
}

bool Foam::m4gnDisplacementCompletion::beforeStride()
{
    return relaxation_ && relaxation_->restore(displacements(), rates(), accelerations());
}

void Foam::m4gnDisplacementCompletion::advance(const m4gnState& predicted, const scalar duration)
{
    predicted.impose();
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

void Foam::m4gnDisplacementCompletion::complete(const scalar deltaT, const bool handOver)
{
    if (handOver) {
        smooth();
    }

    if (dynamic_) {
        D().oldTime().primitiveFieldRef() = D().primitiveField() - deltaT * rate().primitiveField();
        // A stride is no step of the solver
        m4gnLastStep::of(time_) = deltaT;
    }
}

Foam::wordList Foam::m4gnDisplacementCompletion::advanced() const
{
    // sigmaD and divSigmaExp: of solidDisplacementFoam
    wordList names(m4gnCompletion::advanced());
    names.append(wordList({DName_, m4gnOwnFields::rateOf(DName_), "sigmaD", "divSigmaExp"}));
    return names;
}

void Foam::m4gnDisplacementCompletion::write() const
{
    if (relaxation_) {
        relaxation_->write();
    }
    if (followed_) {
        law_->write();
    } else {
        m4gnCompletion::write();
    }
}

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnDisplacementCompletion::quantities() const
{
    const tmp<scalarField> magD(mag(displacements()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
