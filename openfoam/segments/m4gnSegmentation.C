// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegmentation.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnNodes.H"
#include "m4gnSegmentField.H"
#include "m4gnStoredSegments.H"
#include "m4gnCaseChecks.H"
#include "m4gnVersion.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "Time.H"
#include "wallFvPatch.H"

std::string Foam::m4gnSegmentation::options(const dictionary& dict, const bool withModes)
{
    const dictionary segments(m4gn::without(dict, {"model", "nodeTypes", "D"}));

    dictionary settings;
    settings.add("segments", m4gn::without(segments, ownKeys()));
    settings.add("with_modes", word(withModes ? "yes" : "no"));
    return m4gn::json(settings);
}

void Foam::m4gnSegmentation::compute(const m4gnModel* model, const dictionary& dict, const bool withModes)
{
    // Of what a boundary face stands for, walls alone make a difference to
    // segments, as obstacles
    labelList types(mesh_.boundary().size(), label(M4GN_INLET));
    forAll(types, patchi) {
        if (isA<wallFvPatch>(mesh_.boundary()[patchi])) {
            types[patchi] = M4GN_WALL;
        }
    }
    m4gnNodes nodes(mesh_, types);

    dictionary used(dict);
    if (!computed()) {
        // As stored, whatever else is said
        used.set("count", count_);
    }

    const label needed = model ? model->elasticModes() : -1;

    const bool modal = withModes || dict.getOrDefault<word>("method", "") != "metis";
    if (modal && m4gnElasticModes::wanted(mesh_, dict, needed)) {
        const label nModes(dict.getOrDefault<label>("modes", needed > 0 ? needed : -1));
        elastic_.reset(new m4gnElasticModes(mesh_, dict, nModes));
        nodes.setModes(elastic_->eigenvalues(), elastic_->cells());
    }
    used.set("operator", word(elastic_ ? "elastic" : "laplacian"));

    const std::string settings(options(used, withModes && !elastic_));

    m4gn::check(
        m4gn_segments_new(
            m4gn::communicator(), &nodes.data(), model ? model->handle() : nullptr, settings.c_str(),
            computed() ? nullptr : m4gn::labels(cells_), &segments_),
        "The segments cannot be computed");

    count_ = m4gn_segments_n_segments(segments_);
    cells_.resize(mesh_.nCells());
    m4gn::check(m4gn_segments_cells(segments_, cells_.data()), "The segments cannot be computed");
}

void Foam::m4gnSegmentation::count(const dictionary& dict)
{
    // Each of them is a label (m4gnStoredSegments)
    label highest = 0;
    for (const int32_t segment : cells_) {
        highest = Foam::max(highest, label(segment));
    }
    reduce(highest, maxOp<label>());

    labelList sizes(highest + 1, Zero);
    for (const int32_t segment : cells_) {
        ++sizes[segment];
    }
    Pstream::listCombineGather(sizes, plusEqOp<label>());
    m4gn::broadcast(sizes);

    if (min(sizes) == 0) {
        FatalErrorInFunction << from_.c_str() << " is no segmentation: expected the labels 0 to " << highest
                             << ", and all of them to occur" << nl
                             << "    Remove the file to have segments computed anew." << exit(FatalError);
    }

    count_ = highest + 1;

    const label wanted = dict.getOrDefault<label>("count", count_);
    if (wanted != count_) {
        FatalErrorInFunction << from_.c_str() << " has " << count_ << " segments, but " << dict.dictName()
                             << " says count " << wanted << nl
                             << "    Remove the file to have segments computed anew, or the"
                             << " entry to take those that are stored." << exit(FatalError);
    }
}

Foam::m4gnSegmentation::m4gnSegmentation(
    const fvMesh& mesh, const dictionary& dict, const bool withModes, const bool recompute)
    : mesh_(mesh), segments_(nullptr), elastic_(), from_(), cells_(), count_(0)
{
    m4gn::checkAbi();
    m4gn::endWith(mesh.time());

    autoPtr<m4gnModel> model;
    if (dict.found("model")) {
        model.reset(new m4gnModel(m4gn::resolve(dict.get<fileName>("model"), mesh_.time().globalPath())));
    }

    if (!recompute) {
        m4gnStoredSegments found(mesh);

        const bool taken = found.use(
            model.get(), options(dict, false),
            dict.getOrDefault<word>("stored", m4gnStoredSegments::choices().first()));

        if (taken) {
            cells_ = found.cells();
            from_ = found.from();
            count(dict);
        }
    }

    if (computed() || withModes) {
        compute(model.get(), dict, withModes);
    }

    Info << "m4gn: " << count_ << " segments" << (computed() ? " computed" : "") << endl;
}

Foam::m4gnSegmentation::~m4gnSegmentation()
{
    if (segments_) {
        m4gn_segments_free(segments_);
    }
}

Foam::wordList Foam::m4gnSegmentation::ownKeys() { return {"stored", "material", "freeBody"}; }

void Foam::m4gnSegmentation::checkDictionary(const dictionary& dict)
{
    const wordList& choices = m4gnStoredSegments::choices();
    const word stored(dict.getOrDefault<word>("stored", choices.first()));
    if (!choices.found(stored)) {
        FatalIOErrorInFunction(dict) << "Entry stored is " << stored << "; expected one of "
                                     << m4gn::join(choices) << exit(FatalIOError);
    }

    m4gnElasticModes::checkDictionary(dict);

    wordList own(ownKeys());
    own.append("model");
    m4gn::checkOptions(dict, "segments", "{\"segments\": " + m4gn::json(m4gn::without(dict, own)) + '}', own);
}

void Foam::m4gnSegmentation::store(const word& instance) const
{
    if (computed()) {
        m4gn::writeSegments(mesh_, cells_, m4gn_segments_record(segments_), instance);
    }
}

Foam::label Foam::m4gnSegmentation::nModes() const
{
    return segments_ ? m4gn_segments_n_modes(segments_) : 0;
}

Foam::scalar Foam::m4gnSegmentation::mode(const label modei, scalarField& cells) const
{
    cells.resize(mesh_.nCells());

    double eigenvalue = 0;
    m4gn::check(m4gn_segments_mode(segments_, modei, &eigenvalue, cells.data()), "A mode cannot be read");

    return eigenvalue;
}
