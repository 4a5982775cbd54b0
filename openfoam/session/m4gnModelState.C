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

template <class FieldType> void Foam::m4gnModelState::evolving(DynamicList<word>& names) const
{
    for (const word& name : mesh_.sortedNames<FieldType>()) {
        // Those of other function objects are their business
        const FieldType& field = mesh_.lookupObject<FieldType>(name);
        if (field.nOldTimes() > 0 && !field.ownedByRegistry() && !name.ends_with("_0")) {
            names.append(name);
        }
    }
}

void Foam::m4gnModelState::refuseLeftBehind(const wordList& advanced) const
{
    DynamicList<word> evolve, others;
    evolving<volScalarField>(evolve);
    evolving<volVectorField>(evolve);
    evolving<volSymmTensorField>(evolve);

    for (const word& name : evolve) {
        if (!session_.outputs().found(name) && !advanced.found(name)) {
            others.append(name);
        }
    }

    if (others.size()) {
        FatalErrorInFunction << "The solver has equations in time for " << m4gn::join(others)
                             << ", which the model " << session_.model() << " does not predict: in each jump"
                             << " they would stay behind the other fields" << nl
                             << "    Train a model that predicts them, or use surrogates (linear)"
                             << exit(FatalError);
    }
}

Foam::m4gnModelState::m4gnModelState(const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
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
