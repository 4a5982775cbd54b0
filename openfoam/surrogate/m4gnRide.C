// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRide.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnRun.H"
#include "OSspecific.H"
#include "stateFunctionObject.H"
#include "Time.H"
#include "writeFile.H"

namespace
{
using namespace Foam;

//- Names of all fields of the model
wordList names(const m4gnSession* session)
{
    wordHashSet all;
    if (session) {
        all.insert(session->inputs());
        all.insert(session->outputs());
    }
    return all.sortedToc();
}

//- The results of other function objects that are held
List<dictionary> quantities(const dictionary& dict)
{
    return dict.found("quantities") ? List<dictionary>(dict.lookup("quantities")) : List<dictionary>();
}

//- Settings of m4gn_ride_new
std::string settings(const dictionary& dict)
{
    wordHashSet own(m4gnRide::keys());
    own.insert(wordList({"timeStart", "timeEnd", "name", "model", "host", "setupSeconds"}));
    own.erase("quantities");
    std::string text(m4gn::json(m4gn::without(dict, (wordHashSet(dict.toc()) -= own).toc())));

    std::string list;
    for (const dictionary& quantity : quantities(dict)) {
        list += (list.empty() ? "" : ", ") + m4gn::json(quantity);
    }
    text.erase(text.rfind('}'));
    return text + (text.find(':') == std::string::npos ? "" : ", ") + "\"quantities\": [" + list + "]}";
}

} // End anonymous namespace

m4gn_ride_step Foam::m4gnRide::now(const label correctors) const
{
    const Time& time = mesh_.time();
    timeName_ = time.timeName();

    m4gn_ride_step step{};
    step.time = time.value();
    step.delta_t = time.deltaTValue();
    step.end_time = time.endTime().value();
    step.shown = time.timeOutputValue();
    step.wall = time.elapsedClockTime();
    step.index = time.timeIndex();
    step.name = timeName_.c_str();
    step.correctors = correctors;
    if (correctors >= 0) {
        const dictionary* stress = mesh_.solutionDict().findDict("stressAnalysis");
        step.most_correctors = stress ? stress->getOrDefault<label>("nCorrectors", 1) : 1;
    }
    return step;
}

template <class Call> m4gn_ride_answer Foam::m4gnRide::ask(const Call& call, const char* what)
{
    m4gn_ride_answer answer{};
    const int32_t status = call(&answer);

    // The row of the stride that ends a run
    std::string error(status == M4GN_OK ? "" : m4gn_last_error());
    if (status != M4GN_OK || answer.action != M4GN_RIDE_DECIDE) {
        // Else decide() follows, and listens
        listen();
    }

    if (status != M4GN_OK) {
        FatalErrorInFunction << what << ": " << error.c_str() << exit(FatalError);
    }
    if (answer.stepped && session_) {
        session_->stepped();
    }
    return answer;
}

Foam::m4gnRide::m4gnRide(
    const word& name, const fvMesh& mesh, const dictionary& dict, m4gnSession* session, m4gnRunState* run)
    : name_(name), mesh_(mesh), dict_(dict), observes_(dict.get<word>("mode") == "observe"),
      session_(session), run_(run), kinds_(kinds(dict)), gathered_(false), fields_(mesh, names(session)),
      ride_(nullptr), quantities_(quantities(dict)), tables_(4)
{
    dictionary own(dict);
    own.set("name", name);
    if (session) {
        own.set("model", string(session->model()));
        own.set("setupSeconds", session->setupSeconds());
        if (!session->nodes().atPoints()) {
            own.set("host", string(types()));
        }
    }
    own.set("writePrecision", dict.getOrDefault<label>("writePrecision", IOstream::defaultPrecision()));
    if (own.subOrEmptyDict("adapt").getOrDefault<bool>("writeModel", false)) {
        const fileName dir(m4gn::outputDir(name, mesh));
        mkDir(dir);
        own.subDict("adapt").set("writeModel", string(dir / "adapted.safetensors"));
    }

    if (run) {
        dictionary dmd(own.subOrEmptyDict("dmd"));
        dmd.set("file", string(mesh.time().globalPath() / "postProcessing" / name / "states"));
        own.set("dmd", dmd);
    }

    // It is made after the first step
    m4gn_ride_step start(now());
    start.time = mesh.time().startTime().value();
    start.index = mesh.time().startTimeIndex();
    m4gn_ride_surrogates surrogates{};
    if (session) {
        surrogates.session = session->handle();
    }
    if (run) {
        surrogates.arrays = run->layout().data();
        surrogates.n_arrays = run->layout().size();
    }
    m4gn::check(
        m4gn_ride_new(
            m4gn::communicator(), &surrogates, session ? &session->nodes().data() : nullptr,
            settings(own).c_str(), &start, &ride_),
        "m4gnSurrogate cannot start");
    listen();

    if (!observes_) {
        tables_.set(0, new functionObjects::writeFile(mesh, name, "surrogate", dict));
    }
}

Foam::m4gnRide::~m4gnRide() { m4gn_ride_free(ride_); }

Foam::wordList Foam::m4gnRide::kinds(const dictionary& dict)
{
    return dict.getOrDefault<wordList>("surrogates", wordList({"network"}));
}

bool Foam::m4gnRide::has(const dictionary& dict, const word& kind) { return kinds(dict).found(kind); }

Foam::wordList Foam::m4gnRide::keys()
{
    return {"mode",        "surrogates", "dmd",     "solverSteps", "surrogateSteps", "rolloutSteps",
            "writeErrors", "adapt",      "control", "quantities",  "writePrecision"};
}

void Foam::m4gnRide::checkDictionary(const dictionary& dict)
{
    dictionary own(dict);
    if (own.subOrEmptyDict("adapt").found("writeModel")) {
        own.subDict("adapt").get<bool>("writeModel");
        own.subDict("adapt").remove("writeModel");
    }
    if (own.subOrEmptyDict("dmd").found("file")) {
        FatalIOErrorInFunction(dict) << "dmd has no entry file: keep says whether states are kept"
                                     << exit(FatalIOError);
    }
    if (m4gn_options_check("ride", settings(own).c_str()) != M4GN_OK) {
        FatalIOErrorInFunction(dict) << m4gn_last_error() << exit(FatalIOError);
    }
}

m4gn_ride_answer Foam::m4gnRide::solved()
{
    const m4gn_ride_step step(now(correctors()));
    gathered_ = false;
    const m4gn_ride_answer answer = ask(
        [&](m4gn_ride_answer* a) { return m4gn_ride_solved(ride_, &step, a); }, "m4gnSurrogate cannot go on");
    if (answer.arrays) {
        const std::vector<const double*> arrays(run_->gather());
        gathered_ = true;
        m4gn::check(m4gn_ride_record(ride_, arrays.data(), arrays.size()), "m4gnSurrogate cannot go on");
        listen();
    }
    return answer;
}

m4gn_ride_answer Foam::m4gnRide::decide(const m4gn_ride_answer& asked)
{
    const std::vector<m4gn_field> fields(gather(asked.fields, asked.fields));
    const std::vector<const int32_t*> marks(held(asked.fields));
    const m4gn_ride_answer answer = ask(
        [&](m4gn_ride_answer* a) {
            return m4gn_ride_decide(
                ride_, fields.data(), marks.empty() ? nullptr : marks.data(), fields.size(), a);
        },
        "m4gnSurrogate ends the run");
    writeErrors();
    return answer;
}

m4gn_ride_answer Foam::m4gnRide::stride(const m4gn_ride_answer& asked, List<scalarField>& predicted)
{
    const word& kind = kinds_[asked.surrogate];
    const bool dmd = kind == "dmd";
    const std::vector<m4gn_field> fields(gather(!dmd, dmd));
    if (dmd) {
        const std::vector<const double*> inputs(run_->inputs(asked.duration));
        m4gn::check(m4gn_ride_inputs(ride_, inputs.data(), inputs.size()), "m4gnSurrogate cannot step");
    }
    const std::vector<m4gn_field> to(advances(kind));
    std::vector<m4gn_field_out> outputs(to.size());
    predicted.resize(to.size());
    forAll(predicted, i) {
        predicted[i].resize(to[i].components * (dmd ? run_->nValues() : session_->nodes().size()));
        outputs[i].name = to[i].name;
        outputs[i].components = to[i].components;
        outputs[i].cells = predicted[i].data();
    }
    const m4gn_ride_answer answer = ask(
        [&](m4gn_ride_answer* a) {
            return m4gn_ride_stride(ride_, fields.data(), fields.size(), outputs.data(), outputs.size(), a);
        },
        "m4gnSurrogate cannot step");
    if (dmd && answer.action == M4GN_RIDE_ADVANCE) {
        const std::vector<double*> places(run_->places());
        m4gn::check(m4gn_ride_arrays(ride_, 0, places.data(), places.size()), "m4gnSurrogate cannot step");
    }
    // What a network advances to is in the fields alone
    gathered_ = gathered_ && dmd;
    return answer;
}

bool Foam::m4gnRide::setOldLevels(const label surrogatei, const scalar deltaT)
{
    if (kinds_[surrogatei] != "dmd" || !run_->nOldLevels()) {
        return false;
    }
    const std::vector<double*> places(run_->places());
    for (label before = 1; before <= run_->nOldLevels(); ++before) {
        m4gn::check(
            m4gn_ride_arrays(ride_, before * deltaT, places.data(), places.size()),
            "m4gnSurrogate cannot hand over");
        run_->setOldLevels(before);
    }
    gathered_ = false;
    return true;
}

m4gn_ride_answer Foam::m4gnRide::advanced()
{
    const m4gn_ride_step step(now());
    return ask(
        [&](m4gn_ride_answer* a) { return m4gn_ride_advanced(ride_, &step, a); },
        "m4gnSurrogate cannot go on");
}

void Foam::m4gnRide::reported(const functionObjects::stateFunctionObject& results)
{
    if (quantities_.empty()) {
        return;
    }
    std::vector<double> values;
    for (const dictionary& quantity : quantities_) {
        const word object(quantity.get<word>("object"));
        const word result(quantity.get<word>("result"));
        const word type(results.objectResultType(object, result));
        if (type != pTraits<scalar>::typeName) {
            FatalErrorInFunction << "Entry quantities of " << name_ << " has the result " << result << " of "
                                 << object << ", "
                                 << (type.empty() ? "which it does not have" : "which is no scalar") << nl
                                 << "    Its results are: " << m4gn::join(results.objectResultEntries(object))
                                 << exit(FatalError);
        }
        values.push_back(results.getObjectResult<scalar>(object, result));
    }
    m4gn::check(m4gn_ride_reported(ride_, values.data(), values.size()), "m4gnSurrogate cannot go on");
    listen();
}

void Foam::m4gnRide::checkQuantities(const wordHashSet& executed) const
{
    for (const dictionary& quantity : quantities_) {
        const word object(quantity.get<word>("object"));
        if (!executed.found(object)) {
            FatalErrorInFunction << "Entry quantities of " << name_ << " has the object " << object
                                 << ", which is no other function object that is"
                                 << " executed at the surrogate's times (entry executeOthers)" << nl
                                 << "    Those are: " << m4gn::join(executed.sortedToc()) << exit(FatalError);
        }
    }
}

void Foam::m4gnRide::spent(const scalar surrogate, const scalar handOver)
{
    m4gn::check(m4gn_ride_spent(ride_, surrogate, handOver), "m4gnSurrogate cannot go on");
}

m4gn_ride_answer Foam::m4gnRide::handedBack(const m4gn_ride_answer& asked, const List<quantity>& quantities)
{
    const m4gn_ride_step step(now());
    const std::vector<m4gn_field> fields(gather(asked.fields, asked.fields));
    std::vector<m4gn_ride_quantity> told;
    for (const quantity& q : quantities) {
        told.push_back({q.first().c_str(), q.second()});
    }
    return ask(
        [&](m4gn_ride_answer* a) {
            return m4gn_ride_handed_back(
                ride_, &step, told.data(), told.size(), fields.data(), fields.size(), a);
        },
        "m4gnSurrogate cannot go on");
}
