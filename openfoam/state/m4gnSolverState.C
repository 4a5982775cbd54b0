/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSolverState.H"
#include "m4gnDictionary.H"
#include "m4gnFlowState.H"
#include "m4gnSolidDisplacementState.H"
#include "m4gnTotalDisplacementState.H"
#include "m4gnVertexCentredState.H"
#include "Time.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

using namespace Foam;

struct kind
{
    const char* name;
    const char* needs;
    bool atPoints;
    bool (*applies)(const fvMesh&, const dictionary&);
    autoPtr<m4gnSolverState> (*make)
        (const fvMesh&, const dictionary&, const m4gnSession&);
};

template<class State>
autoPtr<m4gnSolverState> make
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
{
    return autoPtr<m4gnSolverState>(new State(mesh, dict, session));
}

template<class State>
kind as(const char* name, const bool atPoints = false)
{
    return { name, State::needs, atPoints, &State::applies, &make<State> };
}

//- In the order in which they are tried
const kind kinds[] =
{
    as<m4gnFlowState>("flow"),
    as<m4gnSolidDisplacementState>("solidDisplacement"),
    as<m4gnTotalDisplacementState>("totalDisplacement"),
    as<m4gnVertexCentredState>("vertexCentred", true),
};

} // End anonymous namespace


// * * * * * * * * * * * * Protected Member Functions  * * * * * * * * * * * //

template<class Type>
void Foam::m4gnSolverState::imposeCells
(
    const word& name,
    const scalarField& cells
) const
{
    auto& field =
        mesh_.lookupObjectRef<GeometricField<Type, fvPatchField, volMesh>>
        (
            name
        );

    // Stores the old time before it gives access
    Field<Type>& values = field.primitiveFieldRef();

    const auto* flat = reinterpret_cast<const Type*>(cells.cdata());

    std::copy(flat, flat + values.size(), values.begin());
}


void Foam::m4gnSolverState::imposeCells
(
    const label outputi,
    const scalarField& cells
) const
{
    const word& name = session_.outputs()[outputi];

    if (session_.outputComponents(outputi) == 1)
    {
        imposeCells<scalar>(name, cells);
    }
    else
    {
        imposeCells<vector>(name, cells);
    }
}


Foam::word Foam::m4gnSolverState::scheme
(
    const word& group,
    const word& key
) const
{
    const dictionary schemes
    (
        mesh_.lookupObject<IOdictionary>("fvSchemes").subOrEmptyDict(group)
    );

    const word used(schemes.found(key) ? key : word("default"));

    if (!schemes.found(used))
    {
        return word::null;
    }

    const ITstream& stream = schemes.lookup(used);

    // "bounded Euler", "NewmarkBeta 0.25 0.5"
    for (label i = stream.size() - 1; i >= 0; --i)
    {
        if (stream[i].isWord())
        {
            return stream[i].wordToken();
        }
    }

    return word::null;
}


void Foam::m4gnSolverState::warnOfOthers(const wordList& advanced) const
{
    DynamicList<word> others;

    for (const word& name : mesh_.sortedNames<volScalarField>())
    {
        if
        (
            !session_.outputs().found(name) && !advanced.found(name)
         && mesh_.lookupObject<volScalarField>(name).nOldTimes() > 0
         && !name.ends_with("_0")
        )
        {
            others.append(name);
        }
    }

    if (others.size())
    {
        WarningInFunction
            << "The solver keeps old times of " << m4gn::join(others)
            << ", which the model does not advance: they stay as they are"
            << " during each jump" << endl;
    }
}


void Foam::m4gnSolverState::step(const scalar deltaT) const
{
    time_.setDeltaT(deltaT, false);
    ++time_;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnSolverState::m4gnSolverState
(
    const fvMesh& mesh,
    const m4gnSession& session
)
:
    mesh_(mesh),
    time_(const_cast<Time&>(mesh.time())),
    session_(session)
{
    if (mesh_.moving() || mesh_.changing())
    {
        FatalErrorInFunction
            << "mode replace does not handle a mesh that moves or changes"
            << exit(FatalError);
    }

    if (session_.stride() < time_.deltaTValue()*(1 - 1e-6))
    {
        FatalErrorInFunction
            << "The stride of the model " << session_.model() << ", "
            << session_.stride() << " s, is shorter than the solver's deltaT "
            << time_.deltaTValue() << " s: nothing can be saved." << nl
            << "    Train a model of a longer stride, or reduce deltaT"
            << exit(FatalError);
    }
}


// * * * * * * * * * * * * * * * * * Selectors * * * * * * * * * * * * * * * //

Foam::wordList Foam::m4gnSolverState::names()
{
    DynamicList<word> all;
    for (const kind& k : kinds)
    {
        all.append(k.name);
    }

    return wordList(std::move(all));
}


Foam::autoPtr<Foam::m4gnSolverState> Foam::m4gnSolverState::New
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
{
    const word given(dict.getOrDefault<word>("state", word::null));

    for (const kind& k : kinds)
    {
        if (given.empty() ? k.applies(mesh, dict) : given == k.name)
        {
            if (!k.applies(mesh, dict))
            {
                break;
            }

            if (k.atPoints != session.nodes().atPoints())
            {
                FatalErrorInFunction
                    << "The solver (state " << k.name << ") has its unknowns at "
                    << (k.atPoints ? "points" : "cells") << nl
                    << "    Give m4gnHarvest and m4gnSurrogate location "
                    << (k.atPoints ? "points" : "cells")
                    << exit(FatalError);
            }

            return k.make(mesh, dict, session);
        }
    }

    OStringStream expected;
    for (const kind& k : kinds)
    {
        if (given.empty() || given == k.name)
        {
            expected << "    " << k.name << ": " << k.needs << nl;
        }
    }

    FatalErrorInFunction
        << "mode replace does not know how this solver carries on from a"
        << " state. Expected" << nl << expected.str().c_str()
        << "    Registered: "
        << m4gnFieldSet::names(mesh, session.nodes().atPoints()).c_str()
        << ", " << m4gn::join(mesh.sortedNames<surfaceScalarField>())
        << exit(FatalError);

    return nullptr;
}


// ************************************************************************* //
