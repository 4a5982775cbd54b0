// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPredictorChoice.H"
#include "m4gnDictionary.H"

const Foam::Enum<Foam::m4gnPredictorChoice::predictorType>
Foam::m4gnPredictorChoice::names
({
    { NONE, "none" },
    { LINEAR, "linear" },
    { QUADRATIC, "quadratic" },
});

namespace
{
    const Foam::word automatic("auto");

    //- Time steps of a trial, of which the last one counts
    const Foam::label trial = 2;

    //- Time steps without a guess before the first round
    const Foam::label warmUp = 5;

    //- Time steps between two rounds of trials, at first and at most
    const Foam::label firstStay = 20;
    const Foam::label longestStay = 320;

    //- Weight of a time step in the mean of the kind that is in use
    const Foam::scalar memory = 0.2;

    //- Share of the work without a guess that a guess may need: what it costs
    //  itself, above all a residual, is some 5 % of a solve
    const Foam::scalar worth = 0.95;
}

Foam::m4gnPredictorChoice::predictorType
Foam::m4gnPredictorChoice::cheapest() const
{
    predictorType best = NONE;
    scalar least = worth*records_[NONE].lately;

    for (const predictorType type : {LINEAR, QUADRATIC})
    {
        const scalar lately = records_[type].lately;
        if (lately >= 0 && lately < least)
        {
            least = lately;
            best = type;
        }
    }

    return best;
}

Foam::m4gnPredictorChoice::m4gnPredictorChoice(const dictionary& dict)
:
    given_(NONE),
    auto_(dict.getOrDefault<word>("predictor", automatic) == automatic),
    used_(NONE),
    left_(warmUp),
    staying_(true),
    best_(NONE),
    stay_(firstStay)
{
    if (!auto_)
    {
        check(dict);
        given_ = names.get(dict.get<word>("predictor"));
        used_ = given_;
    }
}

void Foam::m4gnPredictorChoice::check(const dictionary& dict)
{
    const word given(dict.getOrDefault<word>("predictor", automatic));

    if (given != automatic && !names.found(given))
    {
        wordList valid(names.sortedToc());
        valid.append(automatic);
        FatalIOErrorInFunction(dict)
            << "Entry predictor is " << given << "; expected "
            << m4gn::join(valid) << exit(FatalIOError);
    }
}

void Foam::m4gnPredictorChoice::next(const scalar work)
{
    record& last = records_[used_];
    ++last.steps;
    last.work += work;

    if (!auto_)
    {
        return;
    }

    if (staying_)
    {
        last.lately =
            last.lately < 0 ? work : last.lately + memory*(work - last.lately);
    }
    else if (left_ == 1)
    {
        // The first time step of a trial begins from what another guess left
        last.lately = last.lately < 0 ? work : 0.5*(last.lately + work);
    }

    if (--left_ > 0)
    {
        return;
    }

    if (staying_)
    {
        for (const predictorType type : {QUADRATIC, LINEAR, NONE})
        {
            if (type != best_)
            {
                untried_.append(type);
            }
        }
        staying_ = false;
    }
    else if (untried_.empty())
    {
        const predictorType before = best_;
        best_ = cheapest();
        stay_ = best_ == before ? min(2*stay_, longestStay) : firstStay;
        used_ = best_;
        left_ = stay_;
        staying_ = true;
        return;
    }

    used_ = untried_.remove();
    left_ = trial;
}

void Foam::m4gnPredictorChoice::report(Ostream& os, const word& unit) const
{
    forAll(records_, i)
    {
        const record& r = records_[i];
        if (r.steps)
        {
            os  << "  " << names[predictorType(i)] << ": " << r.steps
                << " time steps of " << r.work/r.steps << ' ' << unit;
        }
    }
    os  << nl;
}
