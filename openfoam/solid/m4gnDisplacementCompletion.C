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

Foam::word Foam::m4gnDisplacementCompletion::displacementName(const dictionary& dict)
{
    return dict.getOrDefault<word>("D", "D");
}

void Foam::m4gnDisplacementCompletion::checkSolver() const
{
    refuseHistory();

    if (scheme_ != "Euler" && dynamic_) {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << scheme_ << nl << "    Handled: Euler, steadyState"
                             << exit(FatalError);
    }

    wordList needed(1, DName_);
    if (dynamic_) {
        needed.append(m4gnOwnFields::rateOf(DName_));
    }
    checkAdvanced(needed, scheme_);
}

Foam::m4gnDisplacementCompletion::m4gnDisplacementCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnCompletion(mesh, session), DName_(displacementName(dict)),
      scheme_(m4gn::scheme(mesh.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName_ + ')')),
      dynamic_(scheme_ != "steadyState")
{
    checkSolver();
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

void Foam::m4gnDisplacementCompletion::complete(const scalar deltaT, const bool)
{
    if (dynamic_) {
        D().oldTime().primitiveFieldRef() = D().primitiveField() - deltaT * rate().primitiveField();
        // A stride is no step of the solver
        m4gnLastStep::of(time_) = deltaT;
    }
}

Foam::wordList Foam::m4gnDisplacementCompletion::advanced() const
{
    wordList names(m4gnCompletion::advanced());
    names.append(wordList({DName_, m4gnOwnFields::rateOf(DName_)}));
    return names;
}

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnDisplacementCompletion::quantities() const
{
    const tmp<scalarField> magD(mag(D().primitiveField()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
