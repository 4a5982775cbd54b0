/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnControl.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "Time.H"

// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnControl::m4gnControl
(
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession& session
)
:
    time_(mesh.time()),
    shadow_(mesh, session),
    control_(nullptr),
    error_(GREAT),
    estimate_(GREAT),
    nMeasured_(0),
    nRefused_(0),
    refused_(false),
    fresh_(false)
{
    char note[1024] = "";
    m4gn::check
    (
        m4gn_control_new
        (
            session.handle(),
            m4gn::json(dict.subDict("control")).c_str(),
            note,
            sizeof(note),
            &control_
        ),
        "m4gnSurrogate cannot control its jumps"
    );

    if (note[0])
    {
        Info<< "m4gn: the model " << session.model() << " does not say how its"
            << " errors of " << note << " grow over a jump; they are reckoned"
            << " to add up. 'm4gn calibrate' measures it" << nl << endl;
    }
}


// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::m4gnControl::~m4gnControl()
{
    m4gn_control_free(control_);
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

bool Foam::m4gnControl::wanted(const dictionary& dict)
{
    return dict.found("control");
}


void Foam::m4gnControl::checkDictionary(const dictionary& dict)
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

    if (dict.getOrDefault<word>("mode", "replace") != "replace")
    {
        FatalIOErrorInFunction(dict)
            << "Entry control is for mode replace: mode observe does not jump"
            << exit(FatalIOError);
    }
}


void Foam::m4gnControl::measure()
{
    if (!shadow_.arrived())
    {
        return;
    }

    const std::vector<m4gn_stride_error> errors(shadow_.compare(shadow_.now()));
    m4gn::check
    (
        m4gn_control_measure(control_, errors.data(), errors.size()),
        "m4gnSurrogate ends the run"
    );
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

    int32_t steps = 0;
    m4gn::check
    (
        m4gn_control_strides(control_, most, &steps, &error_, &estimate_),
        "m4gnSurrogate cannot control its jumps"
    );

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
                << " in a stride, and " << estimate_ << " is expected of a"
                << " step. The solver goes on" << nl << endl;
        }
        refused_ = true;
        ++nRefused_;
    }

    return steps;
}


bool Foam::m4gnControl::accepts
(
    const List<scalarField>& old,
    const List<scalarField>& now
) const
{
    List<scalar> changes(old.size());
    forAll(changes, i)
    {
        changes[i] = shadow_.rms(now[i] - old[i], i);
    }

    int32_t accepted = 0;
    m4gn::check
    (
        m4gn_control_accepts
        (
            control_,
            changes.cdata(),
            changes.size(),
            &accepted
        ),
        "m4gnSurrogate cannot control its jumps"
    );

    return accepted;
}


void Foam::m4gnControl::writeSummary(Ostream& os) const
{
    os  << "  \"strides_measured\": " << nMeasured_ << ",\n"
        << "  \"jumps_refused\": " << nRefused_ << ",\n";
}


// ************************************************************************* //
