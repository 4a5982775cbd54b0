// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnCompletion.H"
#include "m4gnCaseChecks.H"
#include "m4gnCompletionType.H"
#include "m4gnDictionary.H"
#include "m4gnMechanicalProperties.H"
#include "fvcDiv.H"
#include "StringStream.H"
#include "surfaceFields.H"
#include "Time.H"

namespace Foam
{
defineTypeNameAndDebug(m4gnCompletionType, 0);
defineRunTimeSelectionTable(m4gnCompletionType, kind);
}

Foam::autoPtr<Foam::m4gnCompletionType> Foam::m4gnCompletionType::New(const word& name)
{
    const auto found = kindConstructorTablePtr_->cfind(name);

    if (!found.found()) {
        FatalErrorInFunction << "There is no kind of completion " << name << nl << "    Valid: " << names()
                             << exit(FatalError);
    }

    return found.val()();
}

Foam::wordList Foam::m4gnCompletionType::names() { return kindConstructorTablePtr_->sortedToc(); }

void Foam::m4gnCompletion::refuseHistory() const
{
    const wordList laws(m4gnMechanicalProperties(mesh_).lawsWithHistory());

    if (laws.size()) {
        FatalErrorInFunction << "mode replace does not hand over the history of the material: "
                             << m4gnMechanicalProperties::fileName << " has the law " << m4gn::join(laws)
                             << ", whose stress depends on it" << nl
                             << "    Use an elastic law, or mode observe" << exit(FatalError);
    }
}

template <class FieldType> void Foam::m4gnCompletion::evolving(DynamicList<word>& names) const
{
    for (const word& name : mesh_.sortedNames<FieldType>()) {
        // Those of other function objects are their business
        const FieldType& field = mesh_.lookupObject<FieldType>(name);
        if (field.nOldTimes() > 0 && !field.ownedByRegistry() && !name.ends_with("_0")) {
            names.append(name);
        }
    }
}

void Foam::m4gnCompletion::refuseLeftBehind(const wordList& advanced) const
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
                             << "    Train a model that predicts them, or use surrogates (dmd)"
                             << exit(FatalError);
    }
}

void Foam::m4gnCompletion::checkAdvanced(const wordList& needed, const word& scheme) const
{
    for (const word& name : needed) {
        if (!session_.outputs().found(name)) {
            FatalErrorInFunction << "The solver carries on from " << m4gn::join(needed) << " (d2dt2Schemes "
                                 << scheme << "); the model " << session_.model() << " advances "
                                 << m4gn::join(session_.outputs()) << nl
                                 << "    Record these fields, and train a model that predicts them"
                                 << exit(FatalError);
        }
    }
}

Foam::m4gnCompletion::m4gnCompletion(const fvMesh& mesh, const m4gnSession& session)
    : mesh_(mesh), time_(const_cast<Time&>(mesh.time())), session_(session)
{
    if (session_.stride() < time_.deltaTValue() * (1 - 1e-6)) {
        FatalErrorInFunction << "The stride of the model " << session_.model() << ", " << session_.stride()
                             << " s, is shorter than the solver's deltaT " << time_.deltaTValue()
                             << " s: nothing can be saved." << nl
                             << "    Train a model of a longer stride, or reduce deltaT" << exit(FatalError);
    }
}

Foam::scalar Foam::m4gnCompletion::maxDiv(const surfaceScalarField& phi)
{
    const tmp<volScalarField> div(fvc::div(phi));

    return gMax(mag(div().primitiveField())());
}

void Foam::m4gnCompletion::write() const { time_.write(); }

Foam::wordList Foam::m4gnCompletion::keys(const dictionary& dict)
{
    const wordList names(m4gnCompletionType::names());
    const word given(dict.getOrDefault<word>("state", word::null));

    if (given.size() && !names.found(given)) {
        FatalIOErrorInFunction(dict) << "Entry state is " << given << "; expected one of "
                                     << m4gn::join(names) << nl
                                     << "    A library of your own that has one belongs into libs"
                                     << exit(FatalIOError);
    }

    wordHashSet all;
    for (const word& name : names) {
        if (given.empty() || given == name) {
            all.insert(m4gnCompletionType::New(name)->keys());
        }
    }

    return all.sortedToc();
}

Foam::autoPtr<Foam::m4gnCompletion> Foam::m4gnCompletion::New(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
{
    const word given(dict.getOrDefault<word>("state", word::null));

    wordList fitting;
    OStringStream expected;

    for (const word& name : m4gnCompletionType::names()) {
        const auto kind(m4gnCompletionType::New(name));

        if (given.empty() || given == name) {
            expected << "    " << name << ": " << kind->needs().c_str() << nl;
            if (kind->applies(mesh, dict)) {
                fitting.append(name);
            }
        }
    }

    if (fitting.empty()) {
        const word model(m4gn::solidModel(mesh));
        // It alone registers such a field
        const bool solidDisplacementFoam = mesh.foundObject<volVectorField>("divSigmaExp");
        const std::string solver(
            model.size()            ? "solidModel " + model
            : solidDisplacementFoam ? "solidDisplacementFoam"
                                    : "this solver");
        FatalErrorInFunction << "mode replace does not know how " << solver.c_str()
                             << " carries on from a state of a network. Expected" << nl
                             << expected.str().c_str()
                             << "    Registered: " << session.nodes().registered().c_str() << ", "
                             << m4gn::join(mesh.sortedNames<surfaceScalarField>()) << nl
                             << "    Use one of these"
                             << (m4gn::meshFollowsBody(mesh) ? "" : ", or surrogates (dmd)")
                             << exit(FatalError);
    }
    if (fitting.size() > 1) {
        FatalErrorInFunction << "This solver carries on from several kinds of state: " << m4gn::join(fitting)
                             << nl << "    Give the entry state the one that is meant" << exit(FatalError);
    }

    return m4gnCompletionType::New(fitting.first())->make(mesh, dict, session);
}
