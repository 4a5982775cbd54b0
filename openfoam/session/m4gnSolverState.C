// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolverState.H"
#include "m4gnDictionary.H"
#include "m4gnSolverStateType.H"
#include "fvcDiv.H"
#include "StringStream.H"
#include "surfaceFields.H"
#include "Time.H"

namespace Foam
{
defineTypeNameAndDebug(m4gnSolverStateType, 0);
defineRunTimeSelectionTable(m4gnSolverStateType, kind);
}

Foam::autoPtr<Foam::m4gnSolverStateType> Foam::m4gnSolverStateType::New(const word& name)
{
    const auto found = kindConstructorTablePtr_->cfind(name);

    if (!found.found()) {
        FatalErrorInFunction << "There is no kind of solver state " << name << nl << "    Valid: " << names()
                             << exit(FatalError);
    }

    return found.val()();
}

Foam::wordList Foam::m4gnSolverStateType::names() { return kindConstructorTablePtr_->sortedToc(); }

void Foam::m4gnSolverState::step(const scalar deltaT) const
{
    time_.setDeltaT(deltaT, false);
    ++time_;
}

Foam::m4gnSolverState::m4gnSolverState(const fvMesh& mesh)
    : mesh_(mesh), time_(const_cast<Time&>(mesh.time()))
{
    if (mesh_.moving() || mesh_.changing()) {
        FatalErrorInFunction << "mode replace does not handle a mesh that moves or changes"
                             << exit(FatalError);
    }
}

Foam::scalar Foam::m4gnSolverState::maxDiv(const surfaceScalarField& phi)
{
    const tmp<volScalarField> div(fvc::div(phi));

    return gMax(mag(div().primitiveField())());
}

void Foam::m4gnSolverState::write() const { time_.write(); }

Foam::wordList Foam::m4gnSolverState::keys(const dictionary& dict)
{
    const wordList names(m4gnSolverStateType::names());
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
            all.insert(m4gnSolverStateType::New(name)->keys());
        }
    }

    return all.sortedToc();
}

Foam::autoPtr<Foam::m4gnSolverState> Foam::m4gnSolverState::New(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
{
    const word given(dict.getOrDefault<word>("state", word::null));

    wordList fitting;
    OStringStream expected;

    for (const word& name : m4gnSolverStateType::names()) {
        const auto kind(m4gnSolverStateType::New(name));

        if (given.empty() || given == name) {
            expected << "    " << name << ": " << kind->needs().c_str() << nl;
            if (kind->applies(mesh, dict)) {
                fitting.append(name);
            }
        }
    }

    if (fitting.empty()) {
        FatalErrorInFunction << "mode replace does not know how this solver carries on from a"
                             << " state. Expected" << nl << expected.str().c_str()
                             << "    Registered: " << session.nodes().registered().c_str() << ", "
                             << m4gn::join(mesh.sortedNames<surfaceScalarField>()) << exit(FatalError);
    }
    if (fitting.size() > 1) {
        FatalErrorInFunction << "This solver carries on from several kinds of state: " << m4gn::join(fitting)
                             << nl << "    Give the entry state the one that is meant" << exit(FatalError);
    }

    const auto kind(m4gnSolverStateType::New(fitting.first()));

    if (kind->atPoints() != session.nodes().atPoints()) {
        FatalErrorInFunction << "The solver (state " << fitting.first() << ") has its unknowns at "
                             << (kind->atPoints() ? "points" : "cells") << nl
                             << "    Give m4gnRecorder and m4gnSurrogate location "
                             << (kind->atPoints() ? "points" : "cells") << exit(FatalError);
    }

    return kind->make(mesh, dict, session);
}
