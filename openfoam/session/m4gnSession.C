// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSession.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnHandOver.H"
#include "m4gnElasticModes.H"
#include "m4gnMechanicalProperties.H"
#include "m4gnOwnFields.H"
#include "m4gnSegmentField.H"
#include "m4gnSegmentation.H"
#include "m4gnStoredSegments.H"
#include "m4gnCaseChecks.H"
#include "m4gnVersion.H"
#include "m4gnClock.H"
#include "OSspecific.H"
#include "Time.H"
#include <sstream>

void Foam::m4gnSession::open(const dictionary& dict, const List<int32_t>& segments)
{
    const dictionary own(dict.subOrEmptyDict("segments"));

    const bool stored = returnReduce(segments.size() > 0, orOp<bool>());

    autoPtr<m4gnElasticModes> modes;
    const label needed = model_.elasticModes();
    if (!stored && m4gnElasticModes::wanted(mesh_, own, needed)) {
        dictionary body(own);
        for (const word key : {"nodeTypes", "D"}) {
            if (const entry* e = dict.findEntry(key)) {
                body.add(*e);
            }
        }
        const label nModes(own.getOrDefault<label>("modes", needed > 0 ? needed : -1));
        modes.reset(new m4gnElasticModes(mesh_, body, nModes));
        nodes_->setModes(modes->eigenvalues(), modes->cells());
    }

    const m4gnMechanicalProperties properties(mesh_);
    const std::string settings(
        options(dict, others_, properties.description(dict.getOrDefault<word>("D", "D"))));

    const word what(
        stored ? "m4gnSurrogate cannot start (with the segments of m4gnSegment)"
               : "m4gnSurrogate cannot start",
        false);

    m4gn::check(
        m4gn_session_new(
            m4gn::communicator(), &nodes_->data(), model_.handle(), settings.c_str(),
            stored ? m4gn::labels(segments) : nullptr, &session_),
        what.c_str());

    nodes_->clearModes();
    stride_ = m4gn_session_stride(session_);
}

void Foam::m4gnSession::checkFields()
{
    List<m4gn_field_info> infos(m4gn_session_n_fields(session_));
    DynamicList<word> inputs;

    forAll(infos, i) {
        m4gn::check(m4gn_session_field(session_, i, &infos[i]), "m4gnSurrogate");
        if (infos[i].is_input) {
            inputs.append(word(infos[i].name, false));
        }
    }
    inputNames_.transfer(inputs);

    DynamicList<word> outputs;

    for (const m4gn_field_info& info : infos) {
        const word name(info.name, false);

        m4gnOwnFields::provide(mesh_, name);
        if (!nodes_->registered(name)) {
            FatalErrorInFunction << "The model " << model_.file() << " is for the field " << name
                                 << ", which this solver has not registered." << nl
                                 << "    Registered: " << nodes_->registered().c_str() << exit(FatalError);
        }

        m4gnNodes::values field;
        nodes_->gather(name, field);
        const FixedList<int32_t, 7> exponents(field.exponents(name));

        if (info.components != field.components) {
            FatalErrorInFunction << "The model " << model_.file() << " is for " << name << " with "
                                 << label(info.components) << " components; this solver's has "
                                 << field.components << exit(FatalError);
        }

        if (!std::equal(exponents.begin(), exponents.end(), info.dimensions)) {
            FixedList<int32_t, 7> expected;
            std::copy(info.dimensions, info.dimensions + 7, expected.begin());

            FatalErrorInFunction << "The model " << model_.file() << " is for " << name
                                 << " with the dimensions " << flatOutput(expected) << "; this solver's has "
                                 << flatOutput(exponents) << nl
                                 << "    (an incompressible p is p/rho, 0 2 -2)" << exit(FatalError);
        }

        if (info.is_output) {
            outputs.append(name);
        }
    }

    outputNames_.transfer(outputs);
}

Foam::List<int32_t> Foam::m4gnSession::labels(const labelFunction get) const
{
    List<int32_t> labels(mesh_.nCells());
    m4gn::check(get(session_, labels.data()), "m4gnSurrogate");
    return labels;
}

void Foam::m4gnSession::compare()
{
    int32_t count = 0;
    char why[1024] = "";
    m4gn::check(m4gn_session_outside(session_, &count, why, sizeof(why)), "m4gnSurrogate");

    std::istringstream lines(count ? why : "");
    std::string line;
    string text;
    while (std::getline(lines, line)) {
        // Not stripped of its blanks
        if (said_.insert(word(line, false))) {
            text += (text.empty() ? "" : "\n        ") + line;
        }
    }

    if (text.empty() || outOfRange_ == "ignore") {
        return;
    }

    if (outOfRange_ == "refuse") {
        FatalErrorInFunction << "This case is not what the model " << model_.file()
                             << " was trained on:" << nl << "        " << text.c_str() << nl
                             << "    Use a model for such cases, or see with mode observe how"
                             << " wrong it is; outOfRange warn goes on" << exit(FatalError);
    }

    WarningInFunction << "This case is not what the model " << model_.file() << " was trained on:" << nl
                      << "        " << text.c_str() << nl
                      << "    See with mode observe how wrong it is; outOfRange refuse ends"
                      << " such a run, outOfRange ignore says nothing" << endl;
}

Foam::m4gnSession::m4gnSession(const fvMesh& mesh, const dictionary& dict, const wordList& others)
    : mesh_(mesh), others_(others),
      model_(m4gn::resolve(dict.get<fileName>("model"), mesh.time().globalPath())), session_(nullptr),
      stride_(0), setupSeconds_(0), outOfRange_(dict.getOrDefault<word>("outOfRange", "warn")),
      compared_(false)
{
    m4gnClock timer;

    m4gn::checkAbi();
    m4gn::endWith(mesh.time());

    nodes_ = m4gnNodes::New(mesh, dict);

    const dictionary own(dict.subOrEmptyDict("segments"));
    m4gnStoredSegments stored(mesh);
    const bool taken = stored.use(
        &model_, m4gnSegmentation::options(own, false),
        own.getOrDefault<word>("stored", m4gnStoredSegments::choices().first()));

    open(dict, stored.cells());
    checkFields();

    const bool write = dict.getOrDefault<bool>("writeSegments", true);
    const label nGroups = m4gn_session_n_groups(session_);

    if (write && nGroups > 0) {
        const word start(Time::timeName(mesh.time().startTime().value()));
        m4gn::writeLabels(mesh, m4gn::groupName, start, labels(m4gn_session_groups));
    }

    if (write && !taken && m4gn_session_n_segments(session_) > 0) {
        m4gn::writeSegments(mesh, segments(), m4gn_session_segment_record(session_));
    }

    setupSeconds_ = timer.elapsed();

    // Mesh and solid before the run waits for timeStart
    compare();

    const string acting(m4gn::sources(mesh));
    if (acting.size() && outOfRange_ != "ignore") {
        WarningInFunction << "The case has " << acting.c_str() << ", and the model " << model_.file()
                          << " has no input for it: it knows of it only where the data that it"
                          << " was trained on had the same" << nl
                          << "    See with mode observe how wrong it is; outOfRange ignore"
                          << " says nothing" << endl;
    }

    Info << "m4gn: model " << model_.file() << ", stride " << stride_ << " s, "
         << label(m4gn_session_n_segments(session_)) << " segments, ";
    if (nGroups > 0) {
        Info << nGroups << " groups of cells, ";
    }
    Info << "ready in " << setupSeconds_ << " s" << nl << endl;
}

Foam::m4gnSession::~m4gnSession()
{
    if (session_) {
        m4gn_session_free(session_);
    }
}

Foam::scalar Foam::m4gnSession::cellsAGroup() const
{
    const label nGroups = m4gn_session_n_groups(session_);

    return nGroups > 0 ? scalar(returnReduce(mesh_.nCells(), sumOp<label>())) / nGroups : 1;
}

std::string Foam::m4gnSession::options(
    const dictionary& dict, const wordList& others, const dictionary& solid)
{
    dictionary settings(m4gn::without(dict, m4gn::commonKeys()));
    settings = m4gn::without(settings, ownKeys());
    settings = m4gn::without(settings, others);
    if (solid.size() && !settings.found("solid")) {
        settings.add("solid", solid);
    }
    settings.set("segments", m4gn::without(dict.subOrEmptyDict("segments"), m4gnSegmentation::ownKeys()));
    return m4gn::json(settings);
}

Foam::wordList Foam::m4gnSession::ownKeys()
{
    return {"model", "nodeTypes", "writeSegments", "outOfRange", "U", "p", "D"};
}

void Foam::m4gnSession::checkDictionary(const dictionary& dict, const fileName& casePath)
{
    const fileName model(m4gn::resolve(dict.get<fileName>("model"), casePath));

    // The first rank reads it for all of them, and another one may see another disk
    bool found = isFile(model, false);
    m4gn::broadcast(found);

    if (!found) {
        FatalIOErrorInFunction(dict) << "There is no model " << model << nl
                                     << "    Give model as an absolute path, or relative to the case,"
                                     << " to models in " << m4gn::home() << ", or to that folder"
                                     << " (another one: set M4GN_HOME)" << exit(FatalIOError);
    }

    const word outOfRange(dict.getOrDefault<word>("outOfRange", "warn"));
    if (!wordList({"warn", "refuse", "ignore"}).found(outOfRange)) {
        FatalIOErrorInFunction(dict) << "Entry outOfRange is " << outOfRange
                                     << "; expected warn, refuse or ignore" << exit(FatalIOError);
    }

    m4gnSegmentation::checkDictionary(dict.subOrEmptyDict("segments"));
}

void Foam::m4gnSession::checkEntries(const dictionary& dict, const wordList& others)
{
    wordList valid(others);
    valid.append(ownKeys());
    m4gn::checkOptions(dict, "session", options(dict, others), valid);
}

void Foam::m4gnSession::stepped()
{
    if (!compared_) {
        compare();
        compared_ = true;
    }
}
