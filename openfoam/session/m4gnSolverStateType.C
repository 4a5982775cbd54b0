// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolverStateType.H"

namespace Foam
{
    defineTypeNameAndDebug(m4gnSolverStateType, 0);
    defineRunTimeSelectionTable(m4gnSolverStateType, kind);
}

Foam::autoPtr<Foam::m4gnSolverStateType> Foam::m4gnSolverStateType::New(const word& name)
{
    const auto found = kindConstructorTablePtr_->cfind(name);

    if (!found.found())
    {
        FatalErrorInFunction
            << "There is no kind of solver state " << name << nl
            << "    Valid: " << names() << exit(FatalError);
    }

    return found.val()();
}

Foam::wordList Foam::m4gnSolverStateType::names()
{
    return kindConstructorTablePtr_->sortedToc();
}
