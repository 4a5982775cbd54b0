// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSurrogate.H"
#include "m4gnAdapt.H"
#include "m4gnControl.H"
#include "m4gnHandBack.H"
#include "m4gnReplace.H"
#include "m4gnRestart.H"
#include "m4gnSession.H"

void Foam::functionObjects::m4gnSurrogate::save(const label left) const
{
    if (adapt_)
    {
        adapt_->write();
    }

    if (mode_ != modeType::REPLACE)
    {
        return;
    }

    m4gnRestart::write
    (
        name(),
        time_,
        [&](Ostream& os)
        {
            const scalar deltaT = left < 0 ? time_.deltaTValue() : solverDeltaT_;

            os.writeEntry("ranks", Pstream::nProcs());
            os.writeEntry("left", left);
            os.writeEntry("solverSteps", time_.timeIndex() - handedBack_);
            List<scalar>(1, deltaT).writeEntry("deltaT", os);
            if (adaptStart_ > -VGREAT)
            {
                List<scalar>(1, adaptStart_).writeEntry("adaptStart", os);
            }
            if (session_)
            {
                os.writeEntry("model", string(session_->model()));
                os.writeEntry("digest", digest_);
            }
            handBack_->writeState(os);
            if (replace_)
            {
                replace_->writeState(os);
            }
            if (control_)
            {
                control_->writeState(os);
            }
        }
    );
}

void Foam::functionObjects::m4gnSurrogate::resume()
{
    if (mode_ != modeType::REPLACE)
    {
        return;
    }

    const dictionary state(m4gnRestart::read(name(), time_));

    if (state.empty())
    {
        const word last(m4gnRestart::last(name(), time_));
        if (last.size())
        {
            WarningInFunction
                << "There is no state of " << name() << " at time "
                << time_.timeName() << ": its schedule begins anew" << nl
                << "    The last one is at time " << last
                << ". What was written later may not be whole" << endl;
        }
        return;
    }

    checkOthers();

    const bool sameRanks = state.get<label>("ranks") == Pstream::nProcs();

    if (state.found("model"))
    {
        load();

        if (state.get<word>("digest") != digest_)
        {
            WarningInFunction
                << "The run up to time " << time_.timeName()
                << " had another model, " << state.get<string>("model")
                << ": the schedule of " << name() << " begins anew" << endl;
            return;
        }
    }

    if (state.found("totals"))
    {
        replace_.reset(new m4gnReplace(name(), mesh_, dict_, *session_, std::move(state_)));
        replace_->restore(state.subDict("totals"));
    }

    if (state.found("control") && m4gnEstimate::wanted(dict_))
    {
        control_.reset(new m4gnControl(mesh_, dict_, *session_));
        control_->restore(state.subDict("control"), sameRanks);
    }

    if (state.found("handBack"))
    {
        handBack_->restore(state.subDict("handBack"));
    }

    handedBack_ = time_.timeIndex() - state.get<label>("solverSteps");
    if (replace_ && replace_->jumps())
    {
        replace_->solved(time_.timeIndex() - handedBack_);
    }

    if (state.found("adaptStart") && !dict_.subOrEmptyDict("adapt").found("start"))
    {
        // Of the whole run, not of this part
        adaptStart_ = state.get<List<scalar>>("adaptStart").first();
    }

    const label left = state.get<label>("left");

    Info<< "m4gn: " << name() << " goes on from its state at time "
        << time_.timeName();
    if (left > 0)
    {
        Info<< ", in a jump of which " << left << " steps are left";
    }
    if (!sameRanks)
    {
        Info<< ", written by " << state.get<label>("ranks") << " ranks";
    }
    Info<< nl << endl;

    if (left >= 0 && time_.isAdjustTimeStep())
    {
        // Time was written with the surrogate's
        const_cast<Time&>(time_).setDeltaT(state.get<List<scalar>>("deltaT").first(), false);
    }

    advance(left);
}

bool Foam::functionObjects::m4gnSurrogate::filesModified() const
{
    if (!started_)
    {
        started_ = true;

        if (!postProcess && time_.timeIndex() == time_.startTimeIndex())
        {
            const_cast<m4gnSurrogate&>(*this).resume();
        }
    }

    return false;
}
