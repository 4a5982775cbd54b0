/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSession.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnElasticModes.H"
#include "m4gnSegmentField.H"
#include "m4gnSegmentation.H"
#include "clockTime.H"
#include "OSspecific.H"
#include "Time.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

//- Entry as C takes it; nullptr: the model's own
const char* textOrNull(const Foam::word& text)
{
    return text.empty() ? nullptr : text.c_str();
}

} // End anonymous namespace


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

void Foam::m4gnSession::open
(
    const dictionary& dict,
    const List<int32_t>& segments
)
{
    const dictionary own(dict.subOrEmptyDict("segments"));

    const word backend(dict.getOrDefault<word>("backend", word::null));
    const word method(own.getOrDefault<word>("method", word::null));
    const word obstacles
    (
        m4gn::join(own.getOrDefault<wordList>("obstacles", wordList()))
    );
    const word modalSolver(own.getOrDefault<word>("modalSolver", word::null));
    const string petscOptions
    (
        own.getOrDefault<string>("petscOptions", string::null)
    );
    const word precision(dict.getOrDefault<word>("precision", word::null));
    const word modalOperator(own.getOrDefault<word>("operator", word::null));
    const bool stored = returnReduce(segments.size() > 0, orOp<bool>());

    autoPtr<m4gnElasticModes> modes;
    const label needed = m4gnElasticModes::needed(model_);
    if
    (
        !stored
     && !nodes_->atPoints()
     && m4gnElasticModes::wanted(mesh_, own, needed)
    )
    {
        dictionary body(own);
        for (const word key : {"nodeTypes", "D"})
        {
            if (const entry* e = dict.findEntry(key))
            {
                body.add(*e);
            }
        }
        const label nModes
        (
            own.getOrDefault<label>("modes", needed > 0 ? needed : 6)
        );
        modes.reset
        (
            new m4gnElasticModes(mesh_, body, Foam::max(nModes, label(1)))
        );
        nodes_->setModes(modes->eigenvalues(), modes->cells());
    }

    m4gn_session_options options;
    m4gn_session_options_init(&options);

    options.model = model_.c_str();
    options.backend = textOrNull(backend);
    options.n_threads = dict.getOrDefault<label>("nThreads", 1);
    options.precision = textOrNull(precision);
    options.segments = own.getOrDefault<label>("count", 0);
    options.modes = own.getOrDefault<label>("modes", -1);
    options.overlap = own.getOrDefault<label>("overlap", -1);
    options.slic_iterations = own.getOrDefault<label>("iterations", -1);
    options.tau = own.getOrDefault<scalar>("tau", -1);
    options.segment_size = own.getOrDefault<scalar>("size", 0);
    options.segment_method = textOrNull(method);
    options.energy = own.getOrDefault<scalar>("energy", 0);
    options.connected =
        own.found("connected") ? int(own.get<bool>("connected")) : -1;
    options.distance_scale = own.getOrDefault<scalar>("distanceScale", -1);
    options.obstacles = textOrNull(obstacles);
    options.modal_solver = textOrNull(modalSolver);
    options.petsc_options = petscOptions.c_str();
    options.modal_operator = textOrNull(modalOperator);

    // A rank may be without cells, and yet have segments
    static const int32_t none = 0;
    options.cell_segment =
        !stored ? nullptr : segments.size() ? segments.cdata() : &none;

    const word what
    (
        stored
      ? "m4gnSurrogate cannot start (with the segments of m4gnSegment)"
      : "m4gnSurrogate cannot start",
        false
    );

    m4gn::check
    (
        m4gn_session_new
        (
            m4gn::communicator(),
            &nodes_->data(),
            &options,
            &session_
        ),
        what.c_str()
    );

    nodes_->clearModes();
    stride_ = m4gn_session_stride(session_);
}


void Foam::m4gnSession::checkFields()
{
    DynamicList<word> inputs;
    DynamicList<word> outputs;
    DynamicList<label> components;

    for (label i = 0; i < m4gn_session_n_fields(session_); ++i)
    {
        m4gn_field_info info;
        m4gn::check(m4gn_session_field(session_, i, &info), "m4gnSurrogate");

        const word name(info.name, false);

        if (!m4gnFieldSet::registered(mesh_, name, nodes_->atPoints()))
        {
            FatalErrorInFunction
                << "The model " << model_ << " is for the field " << name
                << ", which this solver has not registered." << nl
                << "    Registered: "
                << m4gnFieldSet::names(mesh_, nodes_->atPoints()).c_str()
                << exit(FatalError);
        }

        m4gnFieldSet field(mesh_, wordList(1, name));
        field.gather(*nodes_);

        const label found = field.components(0);
        const FixedList<int32_t, 7>& exponents = field.dimensions(0);

        if (info.components != found)
        {
            FatalErrorInFunction
                << "The model " << model_ << " is for " << name << " with "
                << label(info.components) << " components; this solver's has "
                << found << exit(FatalError);
        }

        if (!std::equal(exponents.begin(), exponents.end(), info.dimensions))
        {
            FixedList<int32_t, 7> expected;
            std::copy(info.dimensions, info.dimensions + 7, expected.begin());

            FatalErrorInFunction
                << "The model " << model_ << " is for " << name
                << " with the dimensions " << flatOutput(expected)
                << "; this solver's has " << flatOutput(exponents) << nl
                << "    (an incompressible p is p/rho, 0 2 -2)"
                << exit(FatalError);
        }

        if (info.is_input)
        {
            inputs.append(name);
        }
        if (info.is_output)
        {
            outputs.append(name);
            components.append(found);
        }
    }

    inputNames_.transfer(inputs);
    outputNames_.transfer(outputs);
    outputComponents_.transfer(components);
}


Foam::List<int32_t> Foam::m4gnSession::segments() const
{
    List<int32_t> segments(mesh_.nCells());
    m4gn::check
    (
        m4gn_session_segments(session_, segments.data()),
        "m4gnSurrogate"
    );
    return segments;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnSession::m4gnSession(const fvMesh& mesh, const dictionary& dict)
:
    mesh_(mesh),
    model_
    (
        m4gn::resolve(dict.get<fileName>("model"), mesh.time().globalPath())
    ),
    session_(nullptr),
    stride_(0),
    setupSeconds_(0)
{
    clockTime timer;

    m4gn::checkAbi();

    nodes_ = m4gnNodes::New(mesh, dict);

    List<int32_t> stored;
    fileName from;
    if (!nodes_->atPoints() && m4gn::readSegments(mesh, stored, from))
    {
        Info<< "m4gn: segments read from " << from.c_str() << endl;
    }

    open(dict, stored);
    checkFields();

    if
    (
        from.empty()
     && !nodes_->atPoints()
     && m4gn_session_n_segments(session_) > 0
     && dict.getOrDefault<bool>("writeSegments", true)
    )
    {
        m4gn::writeSegments(mesh, segments());
    }

    setupSeconds_ = timer.elapsedTime();

    Info<< "m4gn: model " << model_ << ", stride " << stride_ << " s, "
        << label(m4gn_session_n_segments(session_)) << " segments, ready in "
        << setupSeconds_ << " s" << nl << endl;
}


// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::m4gnSession::~m4gnSession()
{
    if (session_)
    {
        m4gn_session_free(session_);
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

Foam::wordList Foam::m4gnSession::keys()
{
    return
    {
        "model", "backend", "nThreads", "precision", "location",
        "nodeTypes", "segments", "writeSegments", "U", "p", "D"
    };
}


void Foam::m4gnSession::checkDictionary
(
    const dictionary& dict,
    const fileName& casePath
)
{
    const fileName model(m4gn::resolve(dict.get<fileName>("model"), casePath));

    if (!isFile(model, false))
    {
        FatalIOErrorInFunction(dict)
            << "There is no model " << model << nl
            << "    Give model as an absolute path, or relative to the case,"
            << " to $M4GN_HOME/models or to $M4GN_HOME"
            << " (M4GN_HOME is set by m4gn's env.sh; now it is "
            << (getEnv("M4GN_HOME").empty() ? "not set" : getEnv("M4GN_HOME"))
            << ")" << exit(FatalIOError);
    }

    m4gnNodes::atPoints(dict);

    const label nThreads = dict.getOrDefault<label>("nThreads", 1);
    m4gn::checkAtLeast(dict, "nThreads", nThreads, 1);

    const word backend(dict.getOrDefault<word>("backend", "native"));
    if (backend != "native" && backend != "torch")
    {
        FatalIOErrorInFunction(dict)
            << "Entry backend is " << backend << "; expected native or torch"
            << exit(FatalIOError);
    }

    const word precision(dict.getOrDefault<word>("precision", "fp32"));
    if (precision != "fp32" && precision != "bf16")
    {
        FatalIOErrorInFunction(dict)
            << "Entry precision is " << precision << "; expected fp32 or bf16"
            << exit(FatalIOError);
    }

    const dictionary own(dict.subOrEmptyDict("segments"));

    wordList valid(m4gnSegmentation::keys("count"));
    valid.append("overlap");
    m4gn::checkKeys(own, valid, false);
    m4gnSegmentation::checkDictionary(own, "count");
    m4gn::checkAtLeast
    (
        own, "overlap", own.getOrDefault<label>("overlap", 0), 0
    );
}


bool Foam::m4gnSession::step
(
    const std::vector<m4gn_field>& inputs,
    List<scalarField>& cells
)
{
    std::vector<m4gn_field_out> outputs(outputNames_.size());
    forAll(outputNames_, i)
    {
        outputs[i].name = outputNames_[i].c_str();
        outputs[i].components = outputComponents_[i];
        outputs[i].cells = cells[i].data();
    }

    const int32_t status = m4gn_session_step
    (
        session_,
        inputs.data(),
        inputs.size(),
        outputs.data(),
        outputs.size()
    );

    if (status == M4GN_ERROR_NUMERICAL)
    {
        WarningInFunction
            << "At time " << mesh_.time().timeName() << ": "
            << m4gn_last_error() << endl;

        return false;
    }

    m4gn::check(status, "m4gnSurrogate cannot step");

    return true;
}


// ************************************************************************* //
