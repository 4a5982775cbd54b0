// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnAverages.H"
#include "OSspecific.H"
#include "StringStream.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnDictionary.H"
#include "m4gnFieldFiles.H"
#include "m4gnVersion.H"
#include "timeControlFunctionObject.H"
#include "vector.H"

#include <cmath>

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnAverages, 0);
addToRunTimeSelectionTable(functionObject, m4gnAverages, dictionary);
}
}

namespace
{
using namespace Foam;

//- FatalIOError that says what the entry has to be, unless it is that
void expect(const bool good, const dictionary& dict, const word& key, const char* expected)
{
    if (!good) {
        FatalIOErrorInFunction(dict) << "Entry " << key << " of " << dict.dictName() << ": expected "
                                     << expected << ", found " << dict.getOrDefault<token>(key, token())
                                     << exit(FatalIOError);
    }
}

//- A number as JSON has it
std::string number(const double value) { return std::isfinite(value) ? m4gn::text(value) : "null"; }

} // End anonymous namespace

void Foam::functionObjects::m4gnAverages::readQuantities(const dictionary& dict)
{
    const dictionary& all = dict.subDict("quantities");
    if (all.empty()) {
        FatalIOErrorInFunction(dict) << "Entry quantities of " << dict.dictName()
                                     << ": expected a dictionary for each figure, as in Cd { functionObject "
                                        "forces; result Cd; }, found none"
                                     << exit(FatalIOError);
    }
    const List<quantity> before(quantities_);
    const auto seriesBefore(std::move(averages_));
    quantities_.clear();
    silent_.clear();
    averages_.reset(m4gn_averages_new(confidence_));

    for (const entry& e : all) {
        expect(e.isDict(), all, e.keyword(), "a dictionary, as in { functionObject forces; result Cd; }");
        const dictionary& of = e.dict();
        m4gn::checkKeys(
            of, {"functionObject", "result", "component", "statistic", "tolerance", "relative"}, false);

        quantity q;
        q.name = e.keyword();
        if (q.name == "time" || q.name == "Time") {
            FatalIOErrorInFunction(of) << "Quantity " << q.name << " of " << all.dictName()
                                       << ": expected another name, as averages.json and averages.dat have"
                                          " the run's time by this one"
                                       << exit(FatalIOError);
        }
        if (!string::valid<word>(q.name)) {
            FatalIOErrorInFunction(of) << "Quantity '" << q.name.c_str() << "' of " << all.dictName()
                                       << ": expected a name without spaces, as averages.dat has it for a"
                                          " column"
                                       << exit(FatalIOError);
        }
        of.readEntry("functionObject", q.functionObject);
        of.readEntry("result", q.result);
        const word component(of.getOrDefault<word>("component", "none"));
        q.component = component == "x" ? 0 : component == "y" ? 1 : component == "z" ? 2 : -1;
        expect(q.component >= 0 || !of.found("component"), of, "component", "x, y or z");
        const word statistic(of.getOrDefault<word>("statistic", "mean"));
        expect(statistic == "mean" || statistic == "rms", of, "statistic", "mean or rms");
        q.ofRms = statistic == "rms";
        q.relative = of.found("relative");
        const word limit(q.relative ? "relative" : "tolerance");
        q.tolerance = of.getOrDefault<scalar>(limit, 0);
        expect(q.tolerance > 0 || !of.found(limit), of, limit, "a positive number");
        if (q.relative && of.found("tolerance")) {
            FatalIOErrorInFunction(of) << "Entries tolerance and relative of " << of.dictName()
                                       << ": expected one of them, found both" << exit(FatalIOError);
        }

        q.seldom = q.any = q.settled = false;
        q.seen = q.last = 0;
        q.before = objectResultEntries(q.functionObject);
        q.published = published(q);

        quantities_.append(q);
        const std::string source(q.functionObject + ' ' + q.result + ' ' + component);
        m4gn_averages_add(averages_.get(), q.name.c_str(), source.c_str(), q.tolerance, q.relative, q.ofRms);
    }

    const bool goesOn = m4gn_averages_carry_on(averages_.get(), seriesBefore.get()) > 0;
    goesOn_ = goesOn && (started_ || goesOn_);
    // Of other columns the table begins anew
    bool same = before.size() == quantities_.size();
    for (label i = 0; same && i < before.size(); ++i) {
        same = before[i].name == quantities_[i].name;
    }
    lastCheck_ = same ? lastCheck_ : 0;
}

void Foam::functionObjects::m4gnAverages::start()
{
    if (started_) {
        return;
    }
    started_ = true;

    wordList others;
    const functionObjectList& list = time_.functionObjects();
    forAll(list, i) {
        others.append(list[i].name());
        if (list[i].name() == name()) {
            const auto* own = isA<functionObjects::timeControl>(list[i]);
            everyStep_ = !own || own->executeControl().always();
        }
    }
    for (quantity& q : quantities_) {
        if (!others.found(q.functionObject)) {
            FatalErrorInFunction << "Quantity " << q.name << " of " << name() << " is of functionObject "
                                 << q.functionObject << ", which this run has not" << nl
                                 << "    It has: " << m4gn::join(others) << exit(FatalError);
        }
        const auto* at = isA<functionObjects::timeControl>(list[others.find(q.functionObject)]);
        const bool always = !at || (at->executeControl().always() && at->writeControl().always());
        q.source = source(q);
        // It may end before the run
        q.seldom = !always || (at && at->dict().found("triggerEnd"));
        q.end = at ? time_.userTimeToTime(at->dict().getOrDefault<scalar>("timeEnd", VGREAT)) : VGREAT;
        // Behind a timeStart the first row stands for its own step alone
        q.last = max(last_, time_.value() - time_.deltaTValue());
    }

    string note;
    const fileName path(stateFile(last_));
    if (last_ > begun_) {
        note = (goesOn_ ? "goes on with its series at time " : "begins a series at time ") + time_.timeName();
    } else if (Pstream::master()) {
        char why[1000] = "";
        if (isFile(path)) {
            // A folder of another run that was renamed has later rows, and no new one would count
            const scalar latest = last_ + time_.deltaTValue();
            note = m4gn_averages_load(averages_.get(), path.c_str(), latest, why, sizeof(why)) == 0
                       ? "carries on with the series of " + path
                       : string("begins anew: ") + why;
        } else if (time_.startTimeIndex() > 0) {
            note = "begins anew: there is no " + path;
        }
    }
    if (note.size()) {
        Info << "m4gn: " << name() << ' ' << note.c_str() << nl << endl;
    }
}

Foam::fileName Foam::functionObjects::m4gnAverages::stateFile(const scalar time) const
{
    // A file handler that collates has the times of all ranks in one folder
    const fileName at(time_.path() / Time::timeName(time));
    const fileName ranks(fileHandler().filePath(at));

    return (ranks.empty() ? at : ranks) / "uniform" / (name() + ".state");
}

const void* Foam::functionObjects::m4gnAverages::published(const quantity& from) const
{
    const dictionary& all = m4gn::properties(const_cast<Time&>(time_).functionObjects());
    const dictionary* results = all.findDict("results", keyType::LITERAL);
    const dictionary* types = results ? results->findDict(from.functionObject, keyType::LITERAL) : nullptr;
    if (types) {
        for (const entry& type : *types) {
            const dictionary* of = type.dictPtr();
            if (const entry* found = of ? of->findEntry(from.result, keyType::LITERAL) : nullptr) {
                return found;
            }
        }
    }
    return nullptr;
}

Foam::SHA1Digest Foam::functionObjects::m4gnAverages::source(const quantity& from) const
{
    const dictionary* functions = time_.controlDict().findDict("functions");
    const dictionary* own = functions ? functions->findDict(from.functionObject) : nullptr;

    return own ? own->digest() : SHA1Digest();
}

bool Foam::functionObjects::m4gnAverages::value(const quantity& from, scalar& found)
{
    // Results outlive a function object that is taken out of controlDict
    const bool inRun = time_.functionObjects().findObjectID(from.functionObject) >= 0;
    const word type(inRun ? objectResultType(from.functionObject, from.result) : word::null);

    if (type == pTraits<scalar>::typeName && from.component < 0) {
        return getObjectResult(from.functionObject, from.result, found);
    }
    if (type == pTraits<label>::typeName && from.component < 0) {
        label whole = 0;
        const bool there = getObjectResult(from.functionObject, from.result, whole);
        found = whole;
        return there;
    }
    if (type == pTraits<vector>::typeName && from.component >= 0) {
        vector all(Zero);
        const bool there = getObjectResult(from.functionObject, from.result, all);
        found = all[from.component];
        return there;
    }
    if (type.size()) {
        FatalErrorInFunction
            << "Quantity " << from.name << " of " << name() << ": " << from.result << " of "
            << from.functionObject << " is a " << type << nl
            << "    Expected a scalar without component, or a vector with component x, y or z"
            << exit(FatalError);
    }

    const wordList others(inRun ? objectResultEntries(from.functionObject) : wordList());
    if (others.size() && others != from.before) {
        FatalErrorInFunction << "Quantity " << from.name << " of " << name() << ": " << from.functionObject
                             << " publishes no " << from.result << nl
                             << "    It publishes: " << m4gn::join(others) << exit(FatalError);
    }
    if (silent_.insert(from.name)) {
        Info << "m4gn: " << name() << " waits for " << from.functionObject
             << (!inRun          ? ", which this run has no longer"
                 : others.size() ? ", which has published other results alone so far: "
                                 : ", which has published no result yet; have it in front, and one that"
                                   " publishes results, as probes do not")
             << m4gn::join(others) << nl << endl;
    }
    return false;
}

void Foam::functionObjects::m4gnAverages::addRow(const label i, const bool surrogate)
{
    quantity& q = quantities_[i];
    const scalar now = time_.value();
    scalar found = 0;

    if (now > q.end + 0.5 * time_.deltaTValue()) {
        return;
    }
    if (!value(q, found)) {
        // Nothing yet: the first value stands for the step before it
        q.last = now;
        return;
    }
    // A function object that publishes twice in a step may leave its entry where the last one was
    const void* const place = published(q);
    const bool old = place == q.published && (!q.any || found == q.seen);
    if (old && q.seldom) {
        return;
    }
    if (old && (surrogate || source(q) != q.source)) {
        // What publishes is not executed in jumps, and may have been edited to publish this no more
        q.last = now;
        return;
    }
    // If this is not executed in jumps, what follows one stands for the solver's step alone
    const bool ofStep = everyStep_ && !q.seldom && !surrogate;
    const scalar since = ofStep ? min(now - q.last, time_.deltaTValue()) : now - q.last;
    if (Pstream::master()) {
        m4gn_averages_push(averages_.get(), i, now, found, since, surrogate);
    }
    q.any = true;
    q.published = place;
    q.seen = found;
    q.last = now;
}

bool Foam::functionObjects::m4gnAverages::fromSurrogate() const
{
    // m4gnSurrogate keeps the solver's time step there within a jump, and 0 outside
    auto& list = const_cast<Time&>(time_).functionObjects();
    for (const entry& e : m4gn::properties(list)) {
        // What is kept outlives a function object that this run no longer has
        if (e.isDict() && e.dict().getOrDefault<scalar>("solverDeltaT", 0) > 0
            && list.findObjectID(e.keyword()) >= 0) {
            return true;
        }
    }
    return false;
}

bool Foam::functionObjects::m4gnAverages::check(const bool due)
{
    bool all = true, any = false;
    std::string row(m4gn::text(last_)), json("{\n  \"time\": " + row);

    forAll(quantities_, i) {
        quantity& q = quantities_[i];
        m4gn_averages_figures f{};
        const bool found = m4gn_averages_check(averages_.get(), i, &f) == 0;
        const bool asked = q.tolerance > 0;
        // What has kept its first value may be what the flow has not reached: minTime says when that is over
        const bool reached = !f.unvaried || (minTime_ > 0 && time_.value() >= minTime_);
        q.settled = f.settled && reached && (due || q.settled);
        any = any || asked;
        all = all && (!asked || q.settled);
        char line[1000] = "";
        m4gn_averages_line(averages_.get(), i, line, sizeof(line));
        Info << "m4gn: " << line << (asked ? (q.settled ? ", known" : ", not known yet") : "") << nl;
        const double columns[] = {f.mean,           f.half_width,          f.rms,
                                  f.rms_half_width, f.frequency,           f.frequency_resolution,
                                  f.transient_end,  f.independent_samples, f.surrogate_share};
        const char* const keys[] = {"mean",           "half_width",          "rms",
                                    "rms_half_width", "frequency",           "frequency_resolution",
                                    "transient_end",  "independent_samples", "surrogate_share"};
        json += ",\n  " + m4gn::quoted(q.name) + ": {\n    \"statistic\": "
                + (q.ofRms ? "\"rms\"" : "\"mean\"") + ",\n    \"settled\": " + (q.settled ? "true" : "false")
                + ",\n    \"rows\": " + std::to_string(f.rows);
        for (unsigned k = 0; k < sizeof(keys) / sizeof(*keys); ++k) {
            const bool none = !found || ((k == 4 || k == 5) && f.frequency == 0);
            row += '\t' + (none ? std::string("nan") : m4gn::text(columns[k]));
            json += std::string(",\n    \"") + keys[k] + "\": " + (none ? "null" : number(columns[k]));
        }
        json += "\n  }";
    }
    Info << endl;

    const fileName dir(outputDir()), table(dir / "averages.dat");
    const bool begun = isFile(table) && lastCheck_ > 0;
    mkDir(dir);
    {
        OFstream os(table, IOstream::ASCII, IOstream::currentVersion, IOstream::UNCOMPRESSED, begun);
        if (!begun) {
            os << "# Time";
            static const char* const columns[] = {
                "half_width",           "rms",           "rms_half_width",      "frequency",
                "frequency_resolution", "transient_end", "independent_samples", "surrogate_share"};
            wordHashSet names;
            for (const quantity& q : quantities_) {
                names.insert(q.name);
            }
            for (const quantity& q : quantities_) {
                bool taken = false;
                for (const char* column : columns) {
                    taken = taken || names.found(word(q.name + '_' + column));
                }
                os << tab << q.name.c_str();
                for (const char* column : columns) {
                    os << tab << (q.name + (taken ? ':' : '_') + column).c_str();
                }
            }
            os << nl;
        }
        os << row.c_str() << endl;
    }
    m4gnFieldFiles files;
    files.write(
        time_, dir / "averages.json", [&](Ostream& os) { os << (json + "\n}").c_str() << endl; }, true);
    files.rename();

    return all && any;
}

Foam::fileName Foam::functionObjects::m4gnAverages::outputDir() const
{
    return time_.globalPath() / "postProcessing" / name() / Time::timeName(begun_);
}

Foam::functionObjects::m4gnAverages::m4gnAverages(
    const word& name, const Time& runTime, const dictionary& dict)
    : stateFunctionObject(name, runTime), averages_(nullptr, m4gn_averages_free), confidence_(0.95),
      minTime_(0), stop_(false), keep_(true), checkInterval_(1), begun_(runTime.startTime().value()),
      last_(max(begun_, runTime.value())), lastRow_(0), lastCheck_(0), lastState_(-1), started_(false),
      goesOn_(false), known_(false), everyStep_(true)
{
    read(dict);
    if (postProcess) {
        Info << "m4gn: " << name << " leaves the figures of the run as they are;"
             << " \"m4gn averages\" reads the tables that others make of stored times" << nl << endl;
    }
}

Foam::functionObjects::m4gnAverages::~m4gnAverages() { end(); }

bool Foam::functionObjects::m4gnAverages::read(const dictionary& dict)
{
    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    stateFunctionObject::read(dict);
    m4gn::checkKeys(dict, {"quantities", "confidence", "stop", "minTime", "checkInterval", "keep"}, true);
    if (!dict.isDict("quantities")) {
        FatalIOErrorInFunction(dict)
            << "Entry quantities of " << dict.dictName()
            << ": expected a dictionary, as in quantities { Cd { functionObject forces; result Cd; } }"
            << exit(FatalIOError);
    }
    confidence_ = dict.getOrDefault<scalar>("confidence", 0.95);
    expect(confidence_ > 0 && confidence_ < 1, dict, "confidence", "a number between 0 and 1, without them");
    minTime_ = dict.getOrDefault<scalar>("minTime", 0);
    m4gn::checkAtLeast(dict, "minTime", minTime_, 0);
    stop_ = dict.getOrDefault<bool>("stop", false);
    keep_ = dict.getOrDefault<bool>("keep", true);
    checkInterval_ = dict.getOrDefault<label>("checkInterval", 1);
    m4gn::checkAtLeast(dict, "checkInterval", checkInterval_, 1);

    // A dictionary that is read again goes on with the series of the same quantities
    OStringStream asked;
    asked << dict.subDict("quantities") << confidence_;
    if (asked.str() != asked_) {
        readQuantities(dict);
        asked_ = asked.str();
        started_ = known_ = false;
    }
    bool ends = !stop_;
    for (const quantity& q : quantities_) {
        ends = ends || q.tolerance > 0;
    }
    expect(ends, dict, "stop", "tolerance or relative of a quantity as well, or no");

    return true;
}

bool Foam::functionObjects::m4gnAverages::execute()
{
    if (postProcess) {
        return true;
    }
    start();

    const scalar now = time_.value();
    // Executed again at the run's end
    if (now <= last_) {
        return true;
    }
    const bool surrogate = fromSurrogate();
    forAll(quantities_, i) {
        addRow(i, surrogate);
    }
    last_ = now;
    lastRow_ = time_.timeIndex();

    bool known = known_;
    if (Pstream::master() && m4gn_averages_due(averages_.get())
        && time_.timeIndex() >= lastCheck_ + checkInterval_)
    {
        known = check(true);
        lastCheck_ = time_.timeIndex();
    }
    m4gn::broadcast(known);
    if (known && !known_) {
        Info << "m4gn: all figures of " << name() << " are known at time " << time_.timeName() << nl << endl;
    }
    known_ = known;
    // Once: at the run's last time this would put off its end
    if (known_ && stop_ && now >= minTime_ && time_.stopAt() != Time::stopAtControls::saWriteNow) {
        time_.stopAt(Time::stopAtControls::saWriteNow);
    }
    // Whatever writeControl says: a restart goes on from any write time
    write();

    return true;
}

bool Foam::functionObjects::m4gnAverages::write()
{
    if (!keep_ || !time_.writeTime() || lastState_ == time_.timeIndex()) {
        return true;
    }
    lastState_ = time_.timeIndex();
    const fileName path(stateFile(time_.value()));
    if (!Pstream::master()) {
        return true;
    }
    char why[1000] = "";
    mkDir(path.path());
    if (m4gn_averages_save(averages_.get(), path.c_str(), why, sizeof(why)) != 0) {
        FatalErrorInFunction << name() << " cannot keep its series: " << why << exit(FatalError);
    }

    return true;
}

bool Foam::functionObjects::m4gnAverages::end()
{
    // The figures of a run that ends as they are known are those of that check
    const bool ended = known_ && stop_ && time_.value() >= minTime_;
    if (started_ && !ended && Pstream::master() && lastCheck_ < lastRow_) {
        // It may come a step behind the last one, of the same rows but for one
        check(m4gn_averages_due(averages_.get()));
        lastCheck_ = lastRow_;
    }

    return true;
}
