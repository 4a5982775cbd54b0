// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnControl.H"
#include "Time.H"

Foam::m4gnControl::m4gnControl(const fvMesh& mesh, const dictionary& dict, m4gnSession& session)
:
    time_(mesh.time()),
    shadow_(mesh, session),
    expected_(dict.subDict("control"), session),
    tolerance_(dict.subDict("control").get<scalar>("tolerance")),
    error_(GREAT),
    estimate_(GREAT),
    nMeasured_(0),
    nRefused_(0),
    refused_(false),
    fresh_(false)
{}

void Foam::m4gnControl::measure()
{
    if (!shadow_.arrived())
    {
        return;
    }

    expected_.measure(shadow_.compare(shadow_.now()));
    ++nMeasured_;
    fresh_ = true;
}

void Foam::m4gnControl::begin(const bool handedBack)
{
    if (handedBack || !shadow_.waiting())
    {
        shadow_.begin();
    }
}

Foam::label Foam::m4gnControl::steps(const label most)
{
    if (!fresh_)
    {
        return 0;
    }
    fresh_ = false;

    const label steps = expected_.steps(most, error_, estimate_);

    if (steps)
    {
        if (refused_)
        {
            Info<< "m4gn: the surrogate may jump again" << nl << endl;
        }
        refused_ = false;
    }
    else
    {
        if (!refused_)
        {
            Info<< "m4gn: no jump at time " << time_.timeName()
                << ": the surrogate beside the solver was off by " << error_
                << " in a stride, ";
            if (estimate_ > tolerance_)
            {
                Info<< "and " << estimate_ << " is expected of a step";
            }
            else
            {
                Info<< "more than relTol of what the solver changed";
            }
            Info<< ". The solver goes on" << nl << endl;
        }
        refused_ = true;
        ++nRefused_;
    }

    return steps;
}

bool Foam::m4gnControl::accepts(const List<scalarField>& old, const List<scalarField>& now) const
{
    List<scalar> changes(old.size());
    forAll(changes, i)
    {
        changes[i] = shadow_.rms(now[i] - old[i], i);
    }

    return expected_.accepts(changes);
}

void Foam::m4gnControl::writeState(Ostream& os) const
{
    label bad;
    const List<scalar> figures(expected_.state(bad));

    os.beginBlock("control");
    os.writeEntry("measured", nMeasured_);
    os.writeEntry("refusals", nRefused_);
    os.writeEntry("refused", Switch(refused_));
    os.writeEntry("fresh", Switch(fresh_));
    os.writeEntry("bad", bad);
    figures.writeEntry("figures", os);
    shadow_.writeState(os);
    os.endBlock();
}

void Foam::m4gnControl::restore(const dictionary& state, const bool sameRanks)
{
    nMeasured_ = state.get<label>("measured");
    nRefused_ = state.get<label>("refusals");
    refused_ = state.get<bool>("refused");
    fresh_ = state.get<bool>("fresh");
    expected_.restore(state.get<List<scalar>>("figures"), state.get<label>("bad"));
    if (sameRanks)
    {
        shadow_.restore(state);
    }
}

void Foam::m4gnControl::writeSummary(Ostream& os) const
{
    os  << "  \"strides_measured\": " << nMeasured_ << ",\n"
        << "  \"jumps_refused\": " << nRefused_ << ",\n";
}
