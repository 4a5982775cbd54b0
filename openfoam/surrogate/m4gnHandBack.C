// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnHandBack.H"
#include "m4gnRun.H"
#include "m4gnExplicitStress.H"
#include "SolverPerformance.H"
#include "Time.H"

namespace
{
    //- Steps of the solver that are watched after a jump
    const Foam::label nAfter = 5;

    //- Steps of the solver before a jump whose median is taken
    const Foam::label nBefore = 50;
}

Foam::label Foam::m4gnHandBack::correctors() const
{
    if (!m4gnExplicitStress::registered(mesh_))
    {
        return -1;
    }

    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(DName_, solves);

    return solves.size() ? solves.size() : -1;
}

Foam::label Foam::m4gnHandBack::cap() const
{
    return
        mesh_.solutionDict().subOrEmptyDict("stressAnalysis")
       .getOrDefault<label>("nCorrectors", 1);
}

Foam::label Foam::m4gnHandBack::median() const
{
    if (before_.empty())
    {
        return -1;
    }

    List<label> sorted(before_);
    sort(sorted);

    return sorted[(sorted.size() - 1)/2];
}

void Foam::m4gnHandBack::judge()
{
    watching_ = false;

    const label usual = median();
    if (after_.empty() || usual < 0)
    {
        return;
    }

    scalar mean = 0;
    for (const label n : after_)
    {
        mean += scalar(n)/after_.size();
    }

    ++nWatched_;
    sumBefore_ += usual;
    sumAfter_ += mean;

    Info<< "m4gn: correctors of the solver's first steps after the jump:";
    for (const label n : after_)
    {
        Info<< ' ' << n;
    }
    Info<< "; median of the steps before it: " << usual << nl << endl;

    // Without correctors (1) there is no tolerance to be reached
    const label most = cap();
    if (most < 2 || usual >= most || max(after_) < most)
    {
        return;
    }

    ++nCapped_;
    most_ = jumpSteps_/2;

    if (most_)
    {
        Info<< "m4gn: the solver stopped at its cap of " << most
            << " correctors after a jump of " << jumpSteps_ << " steps: the"
            << " next jumps have " << most_ << " at most" << nl << endl;
    }
    else
    {
        WarningInFunction
            << "The solver stopped at its cap of " << most << " correctors"
            << " (nCorrectors) up to time " << mesh_.time().timeName()
            << ", after a jump of one step of the surrogate; a median of "
            << usual << " was enough before. The run goes on with the solver"
            << " alone" << nl
            << "    Smooth more of what is handed back (smoothing { length ...;"
            << " }), allow more correctors, or train a model whose"
            << " displacements are smoother" << endl;
    }
}

Foam::m4gnHandBack::m4gnHandBack(const fvMesh& mesh, const word& DName)
:
    mesh_(mesh),
    DName_(DName),
    watching_(false),
    jumpSteps_(0),
    stepsDone_(0),
    most_(labelMax),
    nWatched_(0),
    nCapped_(0),
    sumBefore_(0),
    sumAfter_(0)
{}

void Foam::m4gnHandBack::stepped()
{
    const label n = correctors();

    if (n < 0)
    {
        return;
    }

    if (watching_)
    {
        after_.append(n);
        if (after_.size() == nAfter)
        {
            judge();
        }
        return;
    }

    if (before_.size() == nBefore)
    {
        for (label i = 1; i < nBefore; ++i)
        {
            before_[i - 1] = before_[i];
        }
        before_.last() = n;
    }
    else
    {
        before_.append(n);
    }
}

void Foam::m4gnHandBack::handedBack(const label stepsDone)
{
    jumpSteps_ = stepsDone - stepsDone_;
    stepsDone_ = stepsDone;
    after_.clear();
    watching_ = true;
}

Foam::label Foam::m4gnHandBack::most(const label wanted)
{
    if (watching_)
    {
        // The next jump comes before five steps of the solver
        judge();
    }

    return min(wanted, most_);
}

void Foam::m4gnHandBack::writeState(Ostream& os) const
{
    const List<scalar> sums({sumBefore_, sumAfter_});

    os.beginBlock("handBack");
    List<label>(before_).writeEntry("before", os);
    List<label>(after_).writeEntry("after", os);
    os.writeEntry("watching", Switch(watching_));
    os.writeEntry("jumpSteps", jumpSteps_);
    os.writeEntry("stepsDone", stepsDone_);
    os.writeEntry("most", most_);
    os.writeEntry("watched", nWatched_);
    os.writeEntry("capped", nCapped_);
    sums.writeEntry("sums", os);
    os.endBlock();
}

void Foam::m4gnHandBack::restore(const dictionary& state)
{
    before_ = state.get<List<label>>("before");
    after_ = state.get<List<label>>("after");
    watching_ = state.get<bool>("watching");
    jumpSteps_ = state.get<label>("jumpSteps");
    stepsDone_ = state.get<label>("stepsDone");
    most_ = state.get<label>("most");
    nWatched_ = state.get<label>("watched");
    nCapped_ = state.get<label>("capped");
    const FixedList<scalar, 2> sums(state.get<List<scalar>>("sums"));
    sumBefore_ = sums[0];
    sumAfter_ = sums[1];
}

void Foam::m4gnHandBack::writeSummary(Ostream& os) const
{
    if (nWatched_)
    {
        os  << "  \"jumps_watched\": " << nWatched_ << ",\n"
            << "  \"correctors_before\": " << sumBefore_/nWatched_ << ",\n"
            << "  \"correctors_after\": " << sumAfter_/nWatched_ << ",\n"
            << "  \"jumps_to_the_cap\": " << nCapped_ << ",\n";
    }
}
