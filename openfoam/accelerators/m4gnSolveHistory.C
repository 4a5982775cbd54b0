// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolveHistory.H"
#include "m4gnExtrapolate.H"
#include "objectRegistry.H"
#include "PstreamReduceOps.H"
#include "Time.H"

namespace Foam
{
    defineTypeNameAndDebug(m4gnSolveHistory, 0);
}

namespace
{
    //- Solves of a time step that are remembered: two fields each
    const Foam::label mostSolves = 8;
}

Foam::m4gnSolveHistory::m4gnSolveHistory
(
    const word& unknown,
    const objectRegistry& db,
    const dictionary& controls
)
:
    regIOobject
    (
        IOobject
        (
            typeName + ':' + unknown,
            db.time().constant(),
            db,
            IOobject::NO_READ,
            IOobject::NO_WRITE
        )
    ),
    unknown_(unknown),
    timeIndex_(-1),
    solve_(0),
    nIterations_(0),
    choice_(controls)
{}

Foam::m4gnSolveHistory& Foam::m4gnSolveHistory::of
(
    const word& unknown,
    const objectRegistry& db,
    const dictionary& controls
)
{
    const word name(typeName + ':' + unknown);

    if (!db.foundObject<m4gnSolveHistory>(name))
    {
        regIOobject::store(new m4gnSolveHistory(unknown, db, controls));
    }

    return db.lookupObjectRef<m4gnSolveHistory>(name);
}

void Foam::m4gnSolveHistory::begin(const scalarField& psi)
{
    const label now = time().timeIndex();

    if (now == timeIndex_)
    {
        return;
    }

    if (returnReduce(psi.size() != start_.size(), orOp<bool>()))
    {
        // The first solve, or another mesh
        series_.clear();
        timeIndex_ = -1;
    }

    if (timeIndex_ >= 0)
    {
        choice_.next(nIterations_);
    }
    nIterations_ = 0;

    start_ = psi;
    timeIndex_ = now;
    solve_ = 0;
}

Foam::tmp<Foam::scalarField> Foam::m4gnSolveHistory::guess() const
{
    const scalar deltaT = time().deltaTValue();

    if (choice_.used() == m4gnPredictorChoice::NONE)
    {
        return nullptr;
    }

    if (solve_ >= series_.size())
    {
        return nullptr;
    }

    const change& last = series_[solve_].last;
    const change& before = series_[solve_].before;

    if (last.timeIndex != timeIndex_ - 1)
    {
        return nullptr;
    }

    if (choice_.used() == m4gnPredictorChoice::LINEAR)
    {
        return (deltaT/last.deltaT)*last.field;
    }

    if (before.timeIndex != timeIndex_ - 2)
    {
        return nullptr;
    }

    return m4gn::parabola<scalar>
    (
        deltaT,
        last.deltaT,
        last.field/last.deltaT,
        before.field/before.deltaT,
        -(last.deltaT + before.deltaT)
    );
}

void Foam::m4gnSolveHistory::end(scalarField&& changed, const label nIterations)
{
    nIterations_ += nIterations;

    if (solve_ < mostSolves)
    {
        if (solve_ == series_.size())
        {
            series_.append(series());
        }

        series& own = series_[solve_];
        std::swap(own.before, own.last);
        own.last.timeIndex = timeIndex_;
        own.last.deltaT = time().deltaTValue();
        own.last.field.transfer(changed);
    }

    ++solve_;
}
