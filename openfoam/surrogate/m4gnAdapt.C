// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnAdapt.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnSession.H"
#include "m4gnRun.H"
#include "HashSet.H"
#include "OSspecific.H"
#include "Time.H"

namespace
{
//- The settings as libm4gn.so takes them: all but what is read here
std::string settings(const Foam::dictionary& dict)
{
    Foam::dictionary own(dict.subDict("adapt"));
    own.remove("start");
    own.remove("writeModel");
    if (dict.getOrDefault<Foam::word>("mode", "") != "replace")
    {
        // It is jumps that are given another time
        own.set("clock", Foam::word("no"));
    }
    return Foam::m4gn::json(own);
}

//- Names of all fields of the model
Foam::wordList fields(const Foam::m4gnSession& session)
{
    Foam::wordHashSet names(session.inputs());
    names.insert(session.outputs());
    return names.sortedToc();
}

} // End anonymous namespace

Foam::fileName Foam::m4gnAdapt::file(const word& name, const Time& time, const word& at)
{
    return time.path()/at/"uniform"/(name + ".adapt");
}

Foam::m4gnAdapt::m4gnAdapt
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession& session
)
:
    name_(name),
    mesh_(mesh),
    session_(session),
    fields_(mesh, fields(session)),
    writeModel_(dict.subDict("adapt").getOrDefault<bool>("writeModel", false)),
    adapt_(nullptr),
    report_(),
    nRuns_(0),
    nUsed_(0),
    nSteps_(0),
    seconds_(0)
{
    m4gn::check
    (
        m4gn_adapt_new
        (
            session_.handle(),
            &session_.nodes().data(),
            settings(dict).c_str(),
            &adapt_
        ),
        "m4gnSurrogate cannot adapt its model"
    );

    const Time& time = mesh.time();

    if (stored(name, time))
    {
        const fileName state(file(name, time, Time::timeName(time.startTime().value())));
        m4gn::check
        (
            m4gn_adapt_load(adapt_, session_.handle(), state.c_str()),
            "m4gnSurrogate cannot carry on its adaptation"
        );
        Info<< "m4gn: the adaptation of the model is carried on from " << state
            << nl << endl;
    }
}

Foam::m4gnAdapt::~m4gnAdapt()
{
    m4gn_adapt_free(adapt_);
}

bool Foam::m4gnAdapt::wanted(const dictionary& dict)
{
    return
        dict.isDict("adapt")
     && dict.subDict("adapt").getOrDefault<word>("mode", "before") != "off";
}

void Foam::m4gnAdapt::checkDictionary(const dictionary& dict)
{
    if (!dict.found("adapt"))
    {
        return;
    }

    const dictionary& own = dict.subDict("adapt");
    own.getOrDefault<bool>("writeModel", false);
    own.getOrDefault<scalar>("start", 0);

    if (m4gn_adapt_check(settings(dict).c_str()) != M4GN_OK)
    {
        FatalIOErrorInFunction(own)
            << m4gn_last_error() << nl
            << "    (start and writeModel are entries too)"
            << exit(FatalIOError);
    }

    if
    (
        dict.getOrDefault<word>("mode", "replace") == "observe"
     && own.getOrDefault<word>("mode", "before") == "during"
    )
    {
        FatalIOErrorInFunction(own)
            << "Entry mode of adapt is during, which adapts after jumps, and"
            << " mode observe has none; expected before"
            << exit(FatalIOError);
    }

    if (!own.getOrDefault<bool>("overlap", false))
    {
        return;
    }
    if (dict.getOrDefault<word>("mode", "") != "replace")
    {
        FatalIOErrorInFunction(own)
            << "Entry overlap of adapt is for mode replace: what is learned"
            << " beside the run is used from the next jump but one on"
            << exit(FatalIOError);
    }
    if (Pstream::parRun())
    {
        FatalIOErrorInFunction(own)
            << "Entry overlap of adapt is for runs on one rank: more would sum"
            << " gradients over MPI beside a solver that uses it. Leave it out"
            << exit(FatalIOError);
    }
}

Foam::scalar Foam::m4gnAdapt::start
(
    const dictionary& dict,
    const Time& time,
    const scalar timeStart
)
{
    const scalar begin = time.startTime().value();

    return dict.subDict("adapt").getOrDefault<scalar>
    (
        "start",
        begin + max(timeStart - begin, scalar(0))/3
    );
}

bool Foam::m4gnAdapt::stored(const word& name, const Time& time)
{
    bool found = false;
    if (Pstream::master())
    {
        const word at(Time::timeName(time.startTime().value()));
        found = isFile(file(name, time, at), false);
    }
    reduce(found, orOp<bool>());

    return found;
}

bool Foam::m4gnAdapt::active() const
{
    return m4gn_adapt_active(adapt_);
}

void Foam::m4gnAdapt::frame(const bool begins)
{
    if (!active())
    {
        return;
    }

    fields_.gather(session_.nodes());

    m4gn::check
    (
        m4gn_adapt_frame
        (
            adapt_,
            mesh_.time().value(),
            begins,
            fields_.view().data(),
            fields_.view().size()
        ),
        "m4gnSurrogate cannot adapt its model"
    );
}

void Foam::m4gnAdapt::run(const label strides)
{
    if (!active())
    {
        return;
    }

    m4gn_adapt_report report;
    char note[1024] = "";
    m4gn::check
    (
        m4gn_adapt_run(adapt_, session_.handle(), strides, &report, note, sizeof(note)),
        "m4gnSurrogate cannot adapt its model"
    );

    ++nRuns_;
    nSteps_ += report.steps;
    seconds_ += report.seconds;

    const scalar elapsed = mesh_.time().elapsedClockTime();

    Info<< "m4gn: " << note;
    if (report.steps)
    {
        Info<< "; all adaptation so far is "
            << label(100*min(seconds_/max(elapsed, VSMALL), scalar(1)) + 0.5)
            << " % of the run's wall time";
    }
    Info<< nl << endl;

    if (report.used)
    {
        ++nUsed_;
        report_ = report;

        if (writeModel_)
        {
            const fileName dir(m4gn::outputDir(name_, mesh_));
            if (Pstream::master())
            {
                mkDir(dir);
            }
            m4gn::check
            (
                m4gn_adapt_write_model(adapt_, (dir/"adapted.safetensors").c_str()),
                "m4gnSurrogate cannot write its adapted model"
            );
        }
    }
}

void Foam::m4gnAdapt::write() const
{
    const fileName state(file(name_, mesh_.time(), mesh_.time().timeName()));

    if (Pstream::master())
    {
        mkDir(state.path());
    }

    m4gn::check
    (
        m4gn_adapt_save(adapt_, state.c_str()),
        "m4gnSurrogate cannot write the state of its adaptation"
    );
}

void Foam::m4gnAdapt::writeSummary(Ostream& os) const
{
    os  << "  \"adapt_ahead\": " << ahead(true) << ",\n"
        << "  \"adapt_runs\": " << nRuns_ << ",\n"
        << "  \"adapt_runs_used\": " << nUsed_ << ",\n"
        << "  \"adapt_steps\": " << nSteps_ << ",\n"
        << "  \"adapt_seconds\": " << seconds_ << ",\n";

    if (nUsed_)
    {
        os  << "  \"adapt_error_before\": " << report_.before << ",\n"
            << "  \"adapt_error_after\": " << report_.after << ",\n";
    }
}
