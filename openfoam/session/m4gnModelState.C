// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnModelState.H"
#include "m4gnDictionary.H"
#include "m4gnMechanicalProperties.H"
#include "surfaceFields.H"
#include "Time.H"

void Foam::m4gnModelState::impose(const label outputi, const scalarField& values) const
{
    session_.nodes().impose(session_.outputs()[outputi], session_.outputComponents(outputi), values);
}

void Foam::m4gnModelState::refuseHistory() const
{
    const wordList laws(m4gnMechanicalProperties(mesh_).lawsWithHistory());

    if (laws.size()) {
        FatalErrorInFunction << "mode replace does not hand over the history of the material: "
                             << m4gnMechanicalProperties::fileName << " has the law " << m4gn::join(laws)
                             << ", whose stress depends on it" << nl
                             << "    Use an elastic law, or mode observe" << exit(FatalError);
    }
}

void Foam::m4gnModelState::warnOfOthers(const wordList& advanced) const
{
    DynamicList<word> others;

    for (const word& name : mesh_.sortedNames<volScalarField>()) {
        if (!session_.outputs().found(name) && !advanced.found(name)
            && mesh_.lookupObject<volScalarField>(name).nOldTimes() > 0 && !name.ends_with("_0"))
        {
            others.append(name);
        }
    }

    if (others.size()) {
        WarningInFunction << "The solver keeps old times of " << m4gn::join(others)
                          << ", which the model does not advance: they stay as they are"
                          << " during each jump" << endl;
    }
}

Foam::m4gnModelState::m4gnModelState(const fvMesh& mesh, const m4gnSession& session)
    : m4gnSolverState(mesh), session_(session)
{
    if (session_.stride() < time_.deltaTValue() * (1 - 1e-6)) {
        FatalErrorInFunction << "The stride of the model " << session_.model() << ", " << session_.stride()
                             << " s, is shorter than the solver's deltaT " << time_.deltaTValue()
                             << " s: nothing can be saved." << nl
                             << "    Train a model of a longer stride, or reduce deltaT" << exit(FatalError);
    }
}

Foam::wordList Foam::m4gnModelState::advanced() const { return session_.outputs(); }
