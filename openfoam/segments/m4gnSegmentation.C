/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSegmentation.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnMeshAdapter.H"
#include "m4gnSegmentField.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "Time.H"
#include "wallFvPatch.H"

// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

std::string Foam::m4gnSegmentation::spec
(
    const dictionary& dict,
    const word& countKey
)
{
    std::string object("{");

    const auto add = [&](const char* key, const std::string& value)
    {
        object += (object.size() > 1 ? ", \"" : "\"") + std::string(key) + "\": " + value;
    };

    if (dict.found(countKey))
    {
        add("count", std::to_string(dict.get<label>(countKey)));
    }
    for (const char* key : {"modes", "iterations"})
    {
        if (dict.found(key))
        {
            add(key, std::to_string(dict.get<label>(key)));
        }
    }
    for (const char* key : {"tau", "size", "energy"})
    {
        if (dict.found(key))
        {
            add(key, m4gn::text(dict.get<scalar>(key)));
        }
    }
    if (dict.found("distanceScale"))
    {
        add("distance_scale", m4gn::text(dict.get<scalar>("distanceScale")));
    }
    if (dict.found("connected"))
    {
        add("connected", dict.get<bool>("connected") ? "true" : "false");
    }
    if (dict.found("operator"))
    {
        add("operator", '"' + dict.get<word>("operator") + '"');
    }
    if (dict.found("method"))
    {
        add("method", '"' + dict.get<word>("method") + '"');
    }
    if (dict.found("obstacles"))
    {
        std::string list;
        for (const word& patch : dict.get<wordList>("obstacles"))
        {
            list += (list.empty() ? "\"" : ", \"") + patch + '"';
        }
        add("obstacles", '[' + list + ']');
    }

    return object + '}';
}


void Foam::m4gnSegmentation::compute
(
    const dictionary& dict,
    const word& countKey,
    const bool withModes
)
{
    // Of what a boundary face stands for, walls alone make a difference to
    // segments, as obstacles
    labelList types(mesh_.boundary().size(), label(M4GN_INLET));
    forAll(types, patchi)
    {
        if (isA<wallFvPatch>(mesh_.boundary()[patchi]))
        {
            types[patchi] = M4GN_WALL;
        }
    }

    m4gnMeshAdapter adapter(mesh_, types);

    const fileName model
    (
        dict.found("model")
      ? m4gn::resolve(dict.get<fileName>("model"), mesh_.time().globalPath())
      : fileName()
    );

    dictionary used(dict);
    if (!computed())
    {
        // As stored, whatever else is said
        used.set(countKey, count_);
    }

    const label needed =
        model.empty() ? -1 : m4gnElasticModes::needed(model);

    const bool modal = withModes || dict.getOrDefault<word>("method", "") != "metis";
    if (modal && m4gnElasticModes::wanted(mesh_, dict, needed))
    {
        const label nModes
        (
            dict.getOrDefault<label>("modes", needed > 0 ? needed : 6)
        );
        elastic_.reset
        (
            new m4gnElasticModes(mesh_, dict, Foam::max(nModes, label(1)))
        );
        adapter.setModes(elastic_->eigenvalues(), elastic_->cells());
    }
    used.set("operator", word(elastic_ ? "elastic" : "laplacian"));

    const std::string entries(spec(used, countKey));

    const word solver(dict.getOrDefault<word>("modalSolver", "auto"));
    const string petsc
    (
        dict.getOrDefault<string>("petscOptions", string::null)
    );

    m4gn_segment_options options = {};
    options.modal_solver = solver.c_str();
    options.petsc_options = petsc.c_str();
    options.model = model.empty() ? nullptr : model.c_str();
    options.spec = entries.c_str();
    options.with_modes = withModes && !elastic_;

    // A rank may be without cells, and yet have segments
    static const int32_t none = 0;
    options.cell_segment =
        computed() ? nullptr : cells_.size() ? cells_.cdata() : &none;

    m4gn::check
    (
        m4gn_segments_new
        (
            m4gn::communicator(),
            &adapter.data(),
            &options,
            &segments_
        ),
        "The segments cannot be computed"
    );

    count_ = m4gn_segments_count(segments_);
    cells_.resize(mesh_.nCells());
    m4gn::check
    (
        m4gn_segments_cells(segments_, cells_.data()),
        "The segments cannot be computed"
    );
}


void Foam::m4gnSegmentation::count
(
    const dictionary& dict,
    const word& countKey
)
{
    label lowest = labelMax;
    label highest = -1;
    for (const int32_t segment : cells_)
    {
        lowest = Foam::min(lowest, label(segment));
        highest = Foam::max(highest, label(segment));
    }
    reduce(lowest, minOp<label>());
    reduce(highest, maxOp<label>());

    labelList sizes(Foam::max(highest, label(0)) + 1, Zero);
    if (lowest >= 0)
    {
        for (const int32_t segment : cells_)
        {
            ++sizes[segment];
        }
    }
    Pstream::listCombineGather(sizes, plusEqOp<label>());
    Pstream::listCombineScatter(sizes);

    if (lowest < 0 || min(sizes) == 0)
    {
        FatalErrorInFunction
            << from_.c_str() << " is no segmentation: expected the labels 0 to "
            << highest << ", and all of them to occur" << nl
            << "    Remove the file to have segments computed anew."
            << exit(FatalError);
    }

    count_ = highest + 1;

    const label wanted = dict.getOrDefault<label>(countKey, count_);
    if (wanted != count_)
    {
        FatalErrorInFunction
            << from_.c_str() << " has " << count_ << " segments, but "
            << dict.dictName() << " says " << countKey << ' ' << wanted << nl
            << "    Remove the file to have segments computed anew, or the"
            << " entry to take those that are stored."
            << exit(FatalError);
    }
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnSegmentation::m4gnSegmentation
(
    const fvMesh& mesh,
    const dictionary& dict,
    const word& countKey,
    const bool withModes,
    const bool recompute
)
:
    mesh_(mesh),
    segments_(nullptr),
    elastic_(),
    from_(),
    cells_(),
    count_(0)
{
    m4gn::checkAbi();

    const bool stored =
        !recompute && m4gn::readSegments(mesh, cells_, from_);

    if (stored)
    {
        count(dict, countKey);
    }
    if (!stored || withModes)
    {
        compute(dict, countKey, withModes);
    }

    Info<< "m4gn: " << count_ << " segments ";
    if (stored)
    {
        Info<< "read from " << from_.c_str() << endl;
    }
    else
    {
        Info<< "computed" << endl;
    }
}


// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::m4gnSegmentation::~m4gnSegmentation()
{
    if (segments_)
    {
        m4gn_segments_free(segments_);
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

Foam::wordList Foam::m4gnSegmentation::keys(const word& countKey)
{
    return
    {
        countKey, "modes", "energy", "tau", "size", "iterations", "method",
        "connected", "distanceScale", "obstacles", "modalSolver",
        "petscOptions", "operator", "material", "freeBody"
    };
}


void Foam::m4gnSegmentation::checkDictionary
(
    const dictionary& dict,
    const word& countKey
)
{
    const auto atLeast = [&](const word& key, const scalar lower)
    {
        m4gn::checkAtLeast
        (
            dict, key, dict.getOrDefault<scalar>(key, lower), lower
        );
    };

    const auto checkWord = [&](const word& key, const wordList& valid)
    {
        const word given(dict.getOrDefault<word>(key, valid.first()));
        if (!valid.found(given))
        {
            FatalIOErrorInFunction(dict)
                << "Entry " << key << " is " << given << "; expected one of "
                << m4gn::join(valid) << exit(FatalIOError);
        }
    };

    atLeast(countKey, 1);
    atLeast("modes", 0);
    atLeast("energy", VSMALL);
    atLeast("tau", 0);
    atLeast("size", VSMALL);
    atLeast("iterations", 0);
    atLeast("distanceScale", 0);
    dict.getOrDefault<bool>("connected", true);
    dict.getOrDefault<wordList>("obstacles", wordList());
    dict.getOrDefault<string>("petscOptions", string::null);
    checkWord
    (
        "method",
        {"metis", "slic-md", "slic-mdodl", "slic-mdode", "slic"}
    );
    checkWord("modalSolver", {"auto", "direct", "iterative"});
    m4gnElasticModes::checkDictionary(dict);
}


void Foam::m4gnSegmentation::store(const word& instance) const
{
    if (computed())
    {
        m4gn::writeSegments(mesh_, cells_, instance);
    }
}


Foam::label Foam::m4gnSegmentation::nModes() const
{
    return segments_ ? m4gn_segments_n_modes(segments_) : 0;
}


Foam::scalar Foam::m4gnSegmentation::mode
(
    const label modei,
    scalarField& cells
) const
{
    cells.resize(mesh_.nCells());

    double eigenvalue = 0;
    m4gn::check
    (
        m4gn_segments_mode(segments_, modei, &eigenvalue, cells.data()),
        "A mode cannot be had"
    );

    return eigenvalue;
}


// ************************************************************************* //
