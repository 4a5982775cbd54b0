// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnCheck.H"
#include "m4gnDictionary.H"
#include "m4gnFatalError.H"
#include "m4gnFieldFiles.H"
#include "m4gnNodeTypes.H"
#include "m4gnHybridRun.H"
#include "m4gnVersion.H"
#include "memInfo.H"
#include "Time.H"
#include <algorithm>

namespace
{
using namespace Foam;

//- Steps until the jump, and behind it, at most; and steps of which a time scale can be told
const label most = 100, fewest = 20;

//- Entries of the dmd surrogate for a jump after a few states, however they are fitted, and whatever the case sets
const char* const early =
    "{ window 14; minSnapshots 14; holdOut 3; delays (2 4); svdRank (4 8); jumpTolerance 1e30; fitTolerance "
    "1e30; initialJump 1; maxJump 1; cutTransient no; keep no; }";

dictionary parsed(const std::string& text)
{
    IStringStream stream(text);
    return dictionary(stream);
}

//- As strings: names such as (E|rho) are no words to those who read them
List<string> texts(const wordList& names)
{
    List<string> all(names.size());
    std::copy(names.begin(), names.end(), all.begin());
    return all;
}

//- Memory of all ranks (bytes). Collective.
scalar memory()
{
    memInfo info;
    return returnReduce(scalar(info.update().rss()), sumOp<scalar>()) * 1024;
}

} // End anonymous namespace

Foam::m4gnCheck::m4gnCheck(const fvMesh& mesh, const dictionary& dict)
    : mesh_(mesh), dict_(dict), file_(dict.get<fileName>("report")),
      seconds_(dict.getOrDefault<scalar>("seconds", 10)), made_(0), steps_(0), after_(0), jumped_(false),
      began_(0), state_(nullptr)
{
    report_.set("most_steps", most);
    report_.set("surrogate", m4gnHybridRun::kinds(dict).first());
    report_.set("cells", returnReduce(mesh.nCells(), sumOp<label>()));
    report_.set("ranks", Pstream::nProcs());
    // Times are added as tokens: set makes a text of a number, of six digits, which may be less than a step
    report_.add("delta_t", mesh.time().deltaTValue(), true);
    report_.add("start_time", mesh.time().startTime().value(), true);
    report_.set("adjusts", word(mesh.time().isAdjustTimeStep() ? "yes" : "no"));
    report_.add("end_time", mesh.time().endTime().value(), true);
    report_.set("memory_before", memory());
    write();
}

Foam::dictionary Foam::m4gnCheck::jumping() const
{
    dictionary own(m4gn::without(dict_, {"report", "seconds"}));
    own.set("mode", word("replace"));
    if (m4gnHybridRun::has(own, "dmd")) {
        own.merge(parsed(std::string("dmd ") + early + " control { tolerance 1e30; relTol 1e30; }"));
    } else {
        own.set("solverSteps", 5);
        own.set("surrogateSteps", 1);
    }
    return own;
}

void Foam::m4gnCheck::setInterval(dictionary& dict) const
{
    if (m4gnHybridRun::has(dict, "dmd")) {
        // As a token: a number that becomes text has six digits, which may be less than the step
        const token step(mesh_.time().deltaTValue());
        dict.subDict("dmd").set(new primitiveEntry("snapshotInterval", step));
    }
}

void Foam::m4gnCheck::reportTypes()
{
    dictionary patches;
    labelList types(mesh_.boundary().size(), -1);
    string why;
    m4gn::fails([&]() { types = m4gnNodeTypes(mesh_, dict_).types(); }, why);
    for (label patchi = 0; patchi < mesh_.boundaryMesh().nNonProcessor(); ++patchi) {
        dictionary patch;
        patch.set("type", mesh_.boundary()[patchi].type());
        patch.set("node_type", types[patchi] < 0 ? word("none") : m4gnNodeTypes::names.get(types[patchi]));
        patches.set(mesh_.boundary()[patchi].name(), patch);
    }
    report_.set("patches", patches);
    report_.set("types_refused", why);
}

void Foam::m4gnCheck::made(m4gnState& state, const m4gnCompletion* completion, const wordList& frozen)
{
    state_ = completion ? nullptr : &state;
    // States may not be nearer than this
    report_.add("delta_t", mesh_.time().deltaTValue(), true);
    report_.set(
        "handed_over", texts(completion ? wordHashSet(completion->advanced()).sortedToc() : state.read()));
    report_.set("beside", texts(state.beside()));
    report_.set("frozen", texts(frozen));
    report_.set("numbers", completion ? scalar(0) : state.size());
    reportTypes();
    write();
    made_ = clock_.elapsed();
}

void Foam::m4gnCheck::jumped()
{
    jumped_ = true;
    report_.set("jumped", word("yes"));
    write();
}

void Foam::m4gnCheck::watch()
{
    if (!state_) {
        return;
    }
    const Time& time = mesh_.time();
    const std::vector<const double*> arrays(state_->gather());
    const std::vector<m4gn_array>& layout = state_->arrays();
    const label n = layout.size();
    // The first steps after the jump have something of it
    const label count = after_ - 2;
    if (count == 1) {
        last_.resize(n);
        mean_.resize(n);
        spread_.resize(n, Zero);
        rate_.resize(n, Zero);
        began_ = time.value();
    }
    for (label fieldi = 0; count > 0 && fieldi < n; ++fieldi) {
        const m4gn_array& array = layout[fieldi];
        if (array.role != M4GN_SOLVED) {
            continue;
        }
        const UList<scalar> values(const_cast<scalar*>(arrays[fieldi]), array.n * array.components);
        if (count == 1) {
            last_[fieldi] = values;
            mean_[fieldi] = values;
            continue;
        }
        forAll(values, i) {
            const scalar V = array.weights[i / array.components];
            const scalar off = values[i] - mean_[fieldi][i];
            mean_[fieldi][i] += off / count;
            spread_[fieldi] += V * off * (values[i] - mean_[fieldi][i]);
            rate_[fieldi] += V * sqr((values[i] - last_[fieldi][i]) / time.deltaTValue());
            last_[fieldi][i] = values[i];
        }
    }
    if (count >= fewest) {
        dictionary scales;
        for (label fieldi = 0; fieldi < n; ++fieldi) {
            const scalar spread = returnReduce(spread_[fieldi], sumOp<scalar>());
            const scalar rate = returnReduce(rate_[fieldi], sumOp<scalar>());
            if (rate > VSMALL) {
                scales.set(word(layout[fieldi].name, false), sqrt(spread / rate));
            }
        }
        report_.set("scales", scales);
        report_.set("watched", time.value() - began_);
    }
}

void Foam::m4gnCheck::solved()
{
    const Time& time = mesh_.time();
    ++steps_;
    after_ += jumped_;
    watch();
    report_.add("time", time.value(), true);
    report_.set("steps", steps_);
    report_.set("steps_after", after_);
    const scalar wall = clock_.elapsed() - made_;
    report_.set("wall", wall);
    bool over = (jumped_ ? after_ : steps_) >= most || wall > seconds_;
    m4gn::broadcast(over);
    if (after_ == 2 || over || steps_ == 1) {
        report_.set("memory_after", memory());
        write();
    }
    if (over) {
        const_cast<Time&>(time).setEndTime(time.value());
    }
}

void Foam::m4gnCheck::write() const
{
    if (Pstream::master()) {
        m4gnFieldFiles files;
        files.write(
            mesh_.time(), file_, [&](Ostream& os) { os << m4gn::json(report_).c_str() << endl; }, true);
        files.rename();
    }
}
