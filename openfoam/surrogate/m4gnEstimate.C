// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnEstimate.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"

//- FatalError unless libm4gn.so has done it
static void check(const int32_t status)
{
    Foam::m4gn::check(status, "m4gnSurrogate cannot control its jumps");
}

Foam::m4gnEstimate::m4gnEstimate(const dictionary& control, const m4gnSession& session)
:
    control_(nullptr),
    nFields_(session.outputs().size())
{
    char note[1024] = "";
    check
    (
        m4gn_control_new
        (
            session.handle(),
            m4gn::json(control).c_str(),
            note,
            sizeof(note),
            &control_
        )
    );

    if (note[0])
    {
        Info<< "m4gn: the model " << session.model() << " does not say how its"
            << " errors of " << note << " grow over a jump; they are reckoned"
            << " to add up. 'm4gn calibrate' measures it" << nl << endl;
    }
}

Foam::m4gnEstimate::~m4gnEstimate()
{
    m4gn_control_free(control_);
}

bool Foam::m4gnEstimate::wanted(const dictionary& dict)
{
    return dict.found("control");
}

void Foam::m4gnEstimate::checkDictionary(const dictionary& dict)
{
    if (!wanted(dict))
    {
        return;
    }

    const dictionary& own = dict.subDict("control");

    if (m4gn_control_check(m4gn::json(own).c_str()) != M4GN_OK)
    {
        FatalIOErrorInFunction(own)
            << m4gn_last_error() << exit(FatalIOError);
    }
}

void Foam::m4gnEstimate::measure(const std::vector<m4gn_stride_error>& errors)
{
    m4gn::check
    (
        m4gn_control_measure(control_, errors.data(), errors.size()),
        "m4gnSurrogate ends the run"
    );
}

Foam::label Foam::m4gnEstimate::steps(const label most, scalar& error, scalar& estimate) const
{
    int32_t steps = 0;
    check(m4gn_control_strides(control_, most, &steps, &error, &estimate));
    return steps;
}

Foam::scalar Foam::m4gnEstimate::after(const label nSteps) const
{
    scalar estimate = 0;
    check(m4gn_control_estimate(control_, nSteps, &estimate));
    return estimate;
}

Foam::scalar Foam::m4gnEstimate::relative(const List<scalar>& errors) const
{
    scalar relative = 0;
    check(m4gn_control_relative(control_, errors.cdata(), errors.size(), &relative));
    return relative;
}

bool Foam::m4gnEstimate::accepts(const List<scalar>& changes) const
{
    int32_t accepted = 0;
    check(m4gn_control_accepts(control_, changes.cdata(), changes.size(), &accepted));
    return accepted;
}

Foam::List<Foam::scalar> Foam::m4gnEstimate::state(label& bad) const
{
    std::vector<m4gn_stride_error> rows(nFields_, m4gn_stride_error{0, 0, 0});
    int32_t count = 0;
    check(m4gn_control_state(control_, rows.data(), nFields_, &count));
    bad = count;

    List<scalar> values(3*nFields_);
    for (label i = 0; i < nFields_; ++i)
    {
        // A stride that was not finite has none. OpenFOAM does not read -VGREAT
        // or VGREAT back that it has written as text with all digits.
        const scalar error = rows[i].error;
        values[3*i] = std::isfinite(error) ? error : ROOTVGREAT;
        values[3*i + 1] = rows[i].change;
        values[3*i + 2] = rows[i].size;
    }
    return values;
}

void Foam::m4gnEstimate::restore(const List<scalar>& state, const label bad)
{
    if (bad < 0)
    {
        return;
    }

    std::vector<m4gn_stride_error> rows;
    for (label i = 0; i + 2 < state.size(); i += 3)
    {
        rows.push_back({state[i], state[i + 1], state[i + 2]});
    }
    check(m4gn_control_restore(control_, rows.data(), rows.size(), bad));
}
