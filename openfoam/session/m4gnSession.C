/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSession.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnNodeTypes.H"
#include "clockTime.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "Time.H"
#include "zeroGradientFvPatchFields.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

const char* const segmentName = "m4gnSegment";

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

    // A rank may be without cells, and yet have segments
    static const int32_t none = 0;
    const bool stored = returnReduce(segments.size() > 0, orOp<bool>());
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
            &adapter_->data(),
            &options,
            &session_
        ),
        what.c_str()
    );

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

        const word name(info.name);
        const auto* scalars = mesh_.findObject<volScalarField>(name);
        const auto* vectors = mesh_.findObject<volVectorField>(name);

        if (!scalars && !vectors)
        {
            FatalErrorInFunction
                << "The model " << model_ << " is for the field " << name
                << ", which this solver has not registered." << nl
                << "    Registered: "
                << m4gn::join(mesh_.sortedNames<volScalarField>()) << ", "
                << m4gn::join(mesh_.sortedNames<volVectorField>())
                << exit(FatalError);
        }

        const label found = scalars ? 1 : 3;
        const dimensionSet& dimensions =
            scalars ? scalars->dimensions() : vectors->dimensions();
        const FixedList<int32_t, 7> exponents
        (
            m4gnFieldSet::exponents(name, dimensions)
        );

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


Foam::List<int32_t> Foam::m4gnSession::readSegments() const
{
    const Time& time = mesh_.time();

    for
    (
        const word& instance
      : wordList({Time::timeName(time.startTime().value()), "0", time.constant()})
    )
    {
        IOobject io
        (
            segmentName,
            instance,
            mesh_,
            IOobject::MUST_READ,
            IOobject::NO_WRITE,
            false
        );

        if
        (
            returnReduce
            (
                io.typeHeaderOk<volScalarField>(true, false),
                andOp<bool>()
            )
        )
        {
            const volScalarField stored(io, mesh_);

            List<int32_t> segments(stored.size());
            forAll(segments, celli)
            {
                segments[celli] = int32_t(std::lround(stored[celli]));
            }

            Info<< "m4gn: segments read from " << instance << '/'
                << segmentName << endl;

            return segments;
        }
    }

    return List<int32_t>();
}


void Foam::m4gnSession::writeSegments() const
{
    List<int32_t> segments(mesh_.nCells());
    m4gn::check
    (
        m4gn_session_segments(session_, segments.data()),
        "m4gnSurrogate"
    );

    volScalarField field
    (
        IOobject
        (
            segmentName,
            Time::timeName(mesh_.time().startTime().value()),
            mesh_,
            IOobject::NO_READ,
            IOobject::NO_WRITE,
            false
        ),
        mesh_,
        dimensionedScalar(dimless, Zero),
        zeroGradientFvPatchScalarField::typeName
    );

    forAll(field, celli)
    {
        field[celli] = segments[celli];
    }
    field.correctBoundaryConditions();

    // field.write() would put it into a folder of the current time
    const fileName dir(mesh_.time().path()/field.instance()/mesh_.dbDir());
    mkDir(dir);
    OFstream os(dir/segmentName);
    os.format(mesh_.time().writeFormat());
    field.writeHeader(os);
    field.writeData(os);

    if (!os.good())
    {
        FatalErrorInFunction
            << "Cannot write " << os.name() << exit(FatalError);
    }
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

    const m4gnNodeTypes nodeTypes
    (
        mesh,
        dict,
        dict.getOrDefault<word>("U", "U"),
        dict.getOrDefault<word>("p", "p")
    );

    adapter_.reset(new m4gnMeshAdapter(mesh, nodeTypes.types()));

    const List<int32_t> segments(readSegments());

    open(dict, segments);
    checkFields();

    if
    (
        returnReduce(segments.empty(), andOp<bool>())
     && dict.getOrDefault<bool>("writeSegments", true)
    )
    {
        writeSegments();
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
        "model", "backend", "nThreads", "precision", "nodeTypes",
        "segments", "writeSegments", "U", "p"
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

    m4gn::checkKeys
    (
        own,
        {
            "count", "modes", "energy", "tau", "size", "overlap", "iterations",
            "method", "connected", "distanceScale", "obstacles", "modalSolver",
            "petscOptions"
        },
        false
    );

    m4gn::checkAtLeast(own, "count", own.getOrDefault<label>("count", 1), 1);
    m4gn::checkAtLeast(own, "modes", own.getOrDefault<label>("modes", 0), 0);
    m4gn::checkAtLeast(own, "tau", own.getOrDefault<scalar>("tau", 0), 0);
    m4gn::checkAtLeast
    (
        own, "size", own.getOrDefault<scalar>("size", 1), VSMALL
    );
    m4gn::checkAtLeast
    (
        own, "overlap", own.getOrDefault<label>("overlap", 0), 0
    );
    m4gn::checkAtLeast
    (
        own, "iterations", own.getOrDefault<label>("iterations", 0), 0
    );

    m4gn::checkAtLeast
    (
        own, "energy", own.getOrDefault<scalar>("energy", 1), VSMALL
    );
    m4gn::checkAtLeast
    (
        own, "distanceScale", own.getOrDefault<scalar>("distanceScale", 0), 0
    );
    own.getOrDefault<bool>("connected", true);
    own.getOrDefault<wordList>("obstacles", wordList());
    own.getOrDefault<string>("petscOptions", string::null);

    const auto checkWord = [&](const word& key, const wordList& valid)
    {
        const word given(own.getOrDefault<word>(key, valid.first()));
        if (!valid.found(given))
        {
            FatalIOErrorInFunction(own)
                << "Entry " << key << " is " << given << "; expected one of "
                << m4gn::join(valid) << exit(FatalIOError);
        }
    };

    checkWord
    (
        "method",
        {"metis", "slic-md", "slic-mdodl", "slic-mdode", "slic"}
    );
    checkWord("modalSolver", {"auto", "direct", "iterative"});
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
