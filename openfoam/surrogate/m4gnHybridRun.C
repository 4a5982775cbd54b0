// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnHybridRun.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnSolidDisplacement.H"
#include "m4gnCaseChecks.H"
#include "m4gnVersion.H"
#include "OSspecific.H"
#include "SolverPerformance.H"
#include "stateFunctionObject.H"
#include "Time.H"
#include "writeFile.H"

#include <limits>

namespace
{
using namespace Foam;

//- The results of other function objects that are held
List<dictionary> quantities(const dictionary& dict)
{
    return dict.found("quantities") ? List<dictionary>(dict.lookup("quantities")) : List<dictionary>();
}

//- Settings of m4gn_ride_new
std::string settings(const dictionary& dict)
{
    wordHashSet own(m4gnHybridRun::keys());
    own.insert(
        wordList({"timeStart", "timeEnd", "name", "model", "host", "setupSeconds", "decisions", "states"}));
    own.erase("quantities");
    std::string text(m4gn::json(m4gn::without(dict, (wordHashSet(dict.toc()) -= own).toc())));

    std::string list;
    for (const dictionary& quantity : quantities(dict)) {
        list += (list.empty() ? "" : ", ") + m4gn::json(quantity);
    }
    text.erase(text.rfind('}'));
    return text + (text.find(':') == std::string::npos ? "" : ", ") + "\"quantities\": [" + list + "]}";
}

//- As the calls of the ride take a state
const double* const* given(const std::vector<const double*>& state)
{
    return state.empty() ? nullptr : state.data();
}

} // End anonymous namespace

m4gn_ride_step Foam::m4gnHybridRun::now(const label correctors) const
{
    const Time& time = mesh_.time();
    timeName_ = time.timeName();

    m4gn_ride_step step{};
    step.time = time.value();
    step.delta_t = time.deltaTValue();
    step.end_time = time.endTime().value();
    step.output_time = time.timeOutputValue();
    step.within = within_ ? within_() : 0;
    step.index = time.timeIndex();
    step.name = timeName_.c_str();
    step.correctors = correctors;
    if (correctors >= 0) {
        const dictionary* stress = mesh_.solutionDict().findDict("stressAnalysis");
        step.most_correctors = stress ? stress->getOrDefault<label>("nCorrectors", 1) : 1;
    }
    return step;
}

template <class Call> m4gn_ride_answer Foam::m4gnHybridRun::ask(const Call& call, const char* what)
{
    m4gn_ride_answer answer{};
    const int32_t status = call(&answer);

    // The row of the stride that ends a run
    std::string error(status == M4GN_OK ? "" : m4gn_last_error());
    listen();

    if (status != M4GN_OK) {
        FatalErrorInFunction << what << ": " << error.c_str() << exit(FatalError);
    }
    if (answer.stepped && session_) {
        session_->stepped();
    }
    return answer;
}

Foam::m4gnHybridRun::m4gnHybridRun(
    const word& name, const fvMesh& mesh, const dictionary& dict, m4gnSession* session, m4gnState& state,
    const m4gnConditions& conditions)
    : name_(name), mesh_(mesh), dict_(dict), start_(mesh.time().startTime().value()),
      dir_(m4gn::outputDir(name, mesh)), observes_(dict.get<word>("mode") == "observe"), session_(session),
      state_(state), conditions_(conditions), kinds_(kinds(dict)), ride_(nullptr),
      quantities_(quantities(dict)), tables_(5)
{
    dictionary own(dict);
    own.set("name", name);
    if (session) {
        own.set("model", string(session->model()));
        own.set("setupSeconds", session->setupSeconds());
        own.set("host", string(types()));
    }
    if (dict.getOrDefault<bool>("writeToFile", true)) {
        own.set("decisions", string(m4gn::outputDir(name, mesh).path() / "decisions.jsonl"));
    }
    own.set("writePrecision", dict.getOrDefault<label>("writePrecision", IOstream::defaultPrecision()));

    if (has(dict, "dmd")) {
        own.set("states", string(mesh.time().globalPath() / "postProcessing" / name / "states"));
    }

    // It is made after the first step, or the one at which it came into a run
    const Time& time = mesh.time();
    const bool late = time.timeIndex() > time.startTimeIndex() + 1;
    m4gn_ride_step start(now());
    start.time = late ? time.value() - time.deltaTValue() : start_;
    start.index = late ? time.timeIndex() - 1 : time.startTimeIndex();
    m4gn_host host{};
    if (session) {
        host.session = session->handle();
        host.mesh = &session->nodes().data();
    }
    host.arrays = state.arrays().data();
    host.n_arrays = state.arrays().size();
    host.ahead = m4gnState::ahead;
    host.data = &state;
    m4gn::check(
        m4gn_ride_new(m4gn::communicator(), &host, settings(own).c_str(), &start, &ride_),
        "m4gnSurrogate cannot start");
    listen();

    if (!observes_) {
        tables_.set(0, new functionObjects::writeFile(mesh, name, "surrogate", dict));
    }
}

Foam::m4gnHybridRun::~m4gnHybridRun() { m4gn_ride_free(ride_); }

Foam::wordList Foam::m4gnHybridRun::kinds(const dictionary& dict)
{
    return dict.getOrDefault<wordList>("surrogates", wordList({"network"}));
}

bool Foam::m4gnHybridRun::has(const dictionary& dict, const word& kind) { return kinds(dict).found(kind); }

Foam::wordList Foam::m4gnHybridRun::keys()
{
    return {"mode",         "surrogates",  "dmd",     "solverSteps", "surrogateSteps",
            "rolloutSteps", "writeErrors", "control", "quantities",  "writePrecision"};
}

void Foam::m4gnHybridRun::checkDictionary(const dictionary& dict)
{
    if (m4gn_options_check("ride", settings(dict).c_str()) != M4GN_OK) {
        FatalIOErrorInFunction(dict) << m4gn_last_error() << exit(FatalIOError);
    }
}

Foam::label Foam::m4gnHybridRun::correctors() const
{
    if (!m4gnSolidDisplacement::registered(mesh_)) {
        return -1;
    }

    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(dict_.getOrDefault<word>("D", "D"), solves);

    return solves.size() ? solves.size() : -1;
}

m4gn_ride_answer Foam::m4gnHybridRun::solved()
{
    const char* const what = "m4gnSurrogate ends the run";
    const m4gn_ride_step step(now(correctors()));
    int32_t wants = 0;
    m4gn::check(m4gn_ride_wants(ride_, &step, &wants), what);
    const std::vector<const double*> state(gather(wants));
    const m4gn_ride_answer answer =
        ask([&](m4gn_ride_answer* a) { return m4gn_ride_solved(ride_, &step, given(state), a); }, what);
    writeFields();
    return answer;
}

m4gn_ride_answer Foam::m4gnHybridRun::stride()
{
    const std::vector<double*> places(state_.places());
    return ask(
        [&](m4gn_ride_answer* a) { return m4gn_ride_stride(ride_, places.data(), a); },
        "m4gnSurrogate cannot step");
}

bool Foam::m4gnHybridRun::setOldLevels(const scalar deltaT)
{
    for (label before = 1; before <= state_.nOldLevels(); ++before) {
        const std::vector<double*> places(state_.places(before));
        m4gn::check(
            m4gn_ride_old_level(ride_, before * deltaT, places.data()), "m4gnSurrogate cannot hand over");
        state_.put(before);
    }
    return state_.nOldLevels();
}

void Foam::m4gnHybridRun::putPresent()
{
    const std::vector<double*> places(state_.places());
    m4gn::check(m4gn_ride_old_level(ride_, 0, places.data()), "m4gnSurrogate cannot carry on");
    state_.put();
}

m4gn_ride_answer Foam::m4gnHybridRun::advanced(const m4gn_ride_answer& asked)
{
    const m4gn_ride_step step(now());
    const std::vector<const double*> state(gather(asked.state));
    return ask(
        [&](m4gn_ride_answer* a) { return m4gn_ride_advanced(ride_, &step, given(state), a); },
        "m4gnSurrogate cannot go on");
}

void Foam::m4gnHybridRun::reported(const functionObjects::stateFunctionObject& results)
{
    if (quantities_.empty()) {
        return;
    }
    scalarField values(quantities_.size(), std::numeric_limits<scalar>::quiet_NaN());
    forAll(quantities_, i) {
        const word object(quantities_[i].get<word>("object"));
        const word result(quantities_[i].get<word>("result"));
        // Results outlive a function object that is taken out of controlDict
        const bool inRun = mesh_.time().functionObjects().findObjectID(object) >= 0;
        if (!inRun || results.objectResultEntries(object).empty()) {
            // Not executed yet, or no longer
            continue;
        }
        const word type(results.objectResultType(object, result));
        if (type != pTraits<scalar>::typeName) {
            FatalErrorInFunction << "Entry quantities of " << name_ << " has the result " << result << " of "
                                 << object << ", "
                                 << (type.empty() ? "which it does not have" : "which is no scalar") << nl
                                 << "    Its results are: " << m4gn::join(results.objectResultEntries(object))
                                 << exit(FatalError);
        }
        values[i] = results.getObjectResult<scalar>(object, result);
    }
    // Ranks jump together, and what others publish need not be the same on all of them
    m4gn::broadcast(values);
    m4gn::check(m4gn_ride_reported(ride_, values.cdata(), values.size()), "m4gnSurrogate cannot go on");
    listen();
}

void Foam::m4gnHybridRun::checkQuantities(const wordHashSet& executed) const
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

void Foam::m4gnHybridRun::spent(const scalar surrogate, const scalar handOver)
{
    m4gn::check(m4gn_ride_spent(ride_, surrogate, handOver), "m4gnSurrogate cannot go on");
}

m4gn_ride_answer Foam::m4gnHybridRun::handedBack(
    const m4gn_ride_answer& asked, const List<quantity>& quantities)
{
    const m4gn_ride_step step(now());
    const std::vector<const double*> state(gather(asked.state));
    std::vector<m4gn_ride_quantity> told;
    for (const quantity& q : quantities) {
        told.push_back({q.first().c_str(), q.second()});
    }
    return ask(
        [&](m4gn_ride_answer* a) {
            return m4gn_ride_handed_back(ride_, &step, given(state), told.data(), told.size(), a);
        },
        "m4gnSurrogate cannot go on");
}
