// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRide.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnExplicitStress.H"
#include "m4gnRun.H"
#include "m4gnSegmentField.H"
#include "directionMixedFvPatchFields.H"
#include "HashSet.H"
#include "m4gnNodeTypes.H"
#include "mixedFvPatchFields.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "SolverPerformance.H"
#include "stateFunctionObject.H"
#include "StringStream.H"
#include "Time.H"
#include "writeFile.H"
#include <algorithm>

//- A table is there from its first row on
class Foam::m4gnRide::table
:
    public functionObjects::writeFile
{
public:
    table(const fvMesh& mesh, const word& name, const word& file, const dictionary& dict)
    :
        writeFile(mesh, name, file, dict)
    {}

    void write(const std::string& rows)
    {
        if (Pstream::master() && writeToFile())
        {
            file() << rows.c_str() << flush;
        }
    }
};

namespace
{
using namespace Foam;

//- Names of all fields of the model
wordList names(const m4gnSession* session)
{
    wordHashSet all;
    if (session)
    {
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
    for (const dictionary& quantity : quantities(dict))
    {
        list += (list.empty() ? "" : ", ") + m4gn::json(quantity);
    }
    text.erase(text.rfind('}'));
    return text + (text.find(':') == std::string::npos ? "" : ", ") + "\"quantities\": [" + list + "]}";
}

//- Which faces hold a field's value; where they let go, a face has its cell's
template<class Type>
void mark(const GeometricField<Type, fvPatchField, volMesh>& field, const m4gnNodes& nodes, List<int32_t>& held)
{
    held.resize(nodes.nBoundary());
    label nodei = 0;

    for (const label patchi : nodes.valuePatches())
    {
        const fvPatchField<Type>& patch = field.boundaryField()[patchi];
        const auto* mixed = dynamic_cast<const mixedFvPatchField<Type>*>(&patch);
        const auto* directionMixed = dynamic_cast<const directionMixedFvPatchField<Type>*>(&patch);

        forAll(patch, facei)
        {
            held[nodei++] =
                mixed ? mixed->valueFraction()[facei] > 0.5
              : directionMixed ? tr(directionMixed->valueFraction()[facei]) > 0.5
              : patch.fixesValue();
        }
    }
}

//- What each patch was told to be, as a dictionary. Collective.
std::string typesOf(const fvMesh& mesh, const m4gn_mesh_data& data)
{
    labelList types(mesh.boundaryMesh().nNonProcessor(), -1);
    for (label facei = 0; facei < data.n_boundary; ++facei)
    {
        const word name(data.patch_names[data.boundary_patch[facei]]);
        types[mesh.boundaryMesh().findPatchID(name)] = data.boundary_type[facei];
    }
    Pstream::listCombineGather(types, maxEqOp<label>());

    std::string text;
    forAll(types, patchi)
    {
        if (types[patchi] >= 0)
        {
            text += m4gn::quoted(mesh.boundaryMesh()[patchi].name()) + ' '
              + m4gnNodeTypes::names.get(types[patchi]) + "; ";
        }
    }
    return text;
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
    step.most_correctors =
        mesh_.solutionDict().subOrEmptyDict("stressAnalysis").getOrDefault<label>("nCorrectors", 1);
    return step;
}

Foam::label Foam::m4gnRide::correctors() const
{
    if (!m4gnExplicitStress::registered(mesh_))
    {
        return -1;
    }

    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(dict_.getOrDefault<word>("D", "D"), solves);

    return solves.size() ? solves.size() : -1;
}

std::vector<m4gn_field> Foam::m4gnRide::gather(const bool network, const bool linear)
{
    std::vector<m4gn_field> fields;

    if (network && session_)
    {
        fields_.gather(session_->nodes());
        fields = fields_.view();
    }
    if (linear && run_)
    {
        if (!gathered_)
        {
            run_->gather();
        }
        gathered_ = true;
        for (const m4gn_field& field : run_->measured())
        {
            const auto same = [&](const m4gn_field& f) { return std::string(f.name) == field.name; };
            if (std::none_of(fields.begin(), fields.end(), same))
            {
                fields.push_back(field);
            }
        }
    }
    return fields;
}

std::vector<m4gn_field> Foam::m4gnRide::gather(const bool wanted)
{
    return gather(wanted, wanted);
}

std::vector<Foam::m4gnRide::advancedField> Foam::m4gnRide::advances(const word& kind) const
{
    std::vector<advancedField> all;

    if (kind == "linear")
    {
        for (const m4gn_field& field : run_->measured())
        {
            all.push_back({field.name, field.components});
        }
        return all;
    }
    forAll(session_->outputs(), i)
    {
        all.push_back({session_->outputs()[i], session_->outputComponents(i)});
    }
    return all;
}

std::vector<const int32_t*> Foam::m4gnRide::held(const bool wanted)
{
    std::vector<const int32_t*> marks;

    if (!wanted || !observes_ || !session_)
    {
        return marks;
    }

    held_.resize(fields_.size());
    // Of the fields of a linear surrogate alone none is asked for
    marks.resize(fields_.size() + (run_ ? run_->measured().size() : 0), nullptr);
    for (label fieldi = 0; fieldi < fields_.size(); ++fieldi)
    {
        const word& name = fields_.name(fieldi);
        if (!session_->outputs().found(name))
        {
            continue;
        }
        if (fields_.components(fieldi) == 1)
        {
            mark(mesh_.lookupObject<volScalarField>(name), session_->nodes(), held_[fieldi]);
        }
        else
        {
            mark(mesh_.lookupObject<volVectorField>(name), session_->nodes(), held_[fieldi]);
        }
        marks[fieldi] = held_[fieldi].cdata();
    }
    return marks;
}

void Foam::m4gnRide::listen()
{
    static const char* const files[] =
        {"surrogate", "strides", "surrogateError", "surrogateSegmentError"};

    for (label i = 0; i < tables_.size(); ++i)
    {
        const std::string rows(m4gn_ride_text(ride_, M4GN_RIDE_JUMPS + i));
        if (rows.size())
        {
            if (!tables_.set(i))
            {
                tables_.set(i, new table(mesh_, name_, files[i], dict_));
            }
            tables_[i].write(rows);
        }
    }

    const std::string text(m4gn_ride_text(ride_, M4GN_RIDE_LOG));
    if (text.size())
    {
        Info<< text.c_str() << flush;
    }

    std::string warning;
    while ((warning = m4gn_ride_text(ride_, M4GN_RIDE_WARNING)).size())
    {
        WarningInFunction << warning.c_str() << endl;
    }
}

template<class Call>
m4gn_ride_answer Foam::m4gnRide::ask(const Call& call, const char* what)
{
    m4gn_ride_answer answer{};
    const int32_t status = call(&answer);

    // The row of the stride that ends a run
    std::string error(status == M4GN_OK ? "" : m4gn_last_error());
    listen();

    if (status != M4GN_OK)
    {
        FatalErrorInFunction << what << ": " << error.c_str() << exit(FatalError);
    }
    if (answer.stepped && session_)
    {
        session_->stepped();
    }
    return answer;
}

template<class Type>
void Foam::m4gnRide::writeError(const label surrogatei, const label fieldi, const word& name) const
{
    const word of(kinds_.size() > 1 ? word(kinds_[surrogatei] + ':' + name, false) : name);
    tmp<GeometricField<Type, fvPatchField, volMesh>> tfield
    (
        m4gn::cellField<Type>(mesh_, "error(" + of + ')', mesh_.time().timeName())
    );
    auto& field = tfield.ref();

    auto* cells = reinterpret_cast<scalar*>(field.primitiveFieldRef().data());
    if (m4gn_ride_difference(ride_, surrogatei, fieldi, cells) != M4GN_OK)
    {
        // None has been compared yet
        return;
    }
    field.correctBoundaryConditions();
    field.dimensions().reset
    (
        mesh_.lookupObject<GeometricField<Type, fvPatchField, volMesh>>(name).dimensions()
    );
    field.note() =
        "m4gn: the surrogate's " + name + " at time "
      + std::string(m4gn_ride_text(ride_, M4GN_RIDE_DIFFERENCE_TIME)) + " minus the solver's";
    field.write();
}

void Foam::m4gnRide::writeErrors() const
{
    if (!observes_ || !mesh_.time().writeTime() || !dict_.getOrDefault<bool>("writeErrors", false))
    {
        return;
    }

    forAll(kinds_, surrogatei)
    {
        label fieldi = 0;
        for (const advancedField& field : advances(kinds_[surrogatei]))
        {
            if (field.components == 1)
            {
                writeError<scalar>(surrogatei, fieldi, field.name);
            }
            else
            {
                writeError<vector>(surrogatei, fieldi, field.name);
            }
            ++fieldi;
        }
    }
}

Foam::m4gnRide::m4gnRide
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession* session,
    m4gnRunState* run
)
:
    name_(name),
    mesh_(mesh),
    dict_(dict),
    observes_(dict.get<word>("mode") == "observe"),
    session_(session),
    run_(run),
    kinds_(kinds(dict)),
    gathered_(false),
    fields_(mesh, names(session)),
    ride_(nullptr),
    quantities_(quantities(dict)),
    tables_(4)
{
    dictionary own(dict);
    own.set("name", name);
    if (session)
    {
        own.set("model", string(session->model()));
        own.set("setupSeconds", session->setupSeconds());
        if (!session->nodes().atPoints())
        {
            own.set("host", string(typesOf(mesh, session->nodes().data())));
        }
    }
    own.set("writePrecision", dict.getOrDefault<label>("writePrecision", IOstream::defaultPrecision()));
    if (own.subOrEmptyDict("adapt").getOrDefault<bool>("writeModel", false))
    {
        const fileName dir(m4gn::outputDir(name, mesh));
        mkDir(dir);
        own.subDict("adapt").set("writeModel", string(dir/"adapted.safetensors"));
    }

    if (run)
    {
        dictionary linear(own.subOrEmptyDict("linear"));
        if (linear.getOrDefault<bool>("keep", true))
        {
            linear.set("file", string(mesh.time().globalPath()/"postProcessing"/name/"states"));
        }
        linear.remove("keep");
        own.set("linear", linear);
    }

    // It is made after the first step
    m4gn_ride_step start(now());
    start.time = mesh.time().startTime().value();
    start.index = mesh.time().startTimeIndex();
    m4gn_ride_surrogates surrogates{};
    if (session)
    {
        surrogates.session = session->handle();
    }
    if (run)
    {
        surrogates.arrays = run->layout().data();
        surrogates.n_arrays = run->layout().size();
    }
    m4gn::check
    (
        m4gn_ride_new
        (
            m4gn::communicator(), &surrogates, session ? &session->nodes().data() : nullptr,
            settings(own).c_str(), &start, &ride_
        ),
        "m4gnSurrogate cannot start"
    );
    listen();

    if (!observes_)
    {
        tables_.set(0, new table(mesh, name, "surrogate", dict));
    }
}

Foam::m4gnRide::~m4gnRide()
{
    m4gn_ride_free(ride_);
}

Foam::wordList Foam::m4gnRide::kinds(const dictionary& dict)
{
    return dict.getOrDefault<wordList>("surrogates", wordList({"network"}));
}

bool Foam::m4gnRide::has(const dictionary& dict, const word& kind)
{
    return kinds(dict).found(kind);
}

Foam::wordList Foam::m4gnRide::keys()
{
    return
    {
        "mode", "surrogates", "linear", "solverSteps", "surrogateSteps", "rolloutSteps", "writeErrors", "adapt", "control",
        "quantities", "writePrecision"
    };
}

void Foam::m4gnRide::checkDictionary(const dictionary& dict)
{
    dictionary own(dict);
    if (own.subOrEmptyDict("adapt").found("writeModel"))
    {
        own.subDict("adapt").get<bool>("writeModel");
        own.subDict("adapt").remove("writeModel");
    }
    if (own.subOrEmptyDict("linear").found("keep"))
    {
        own.subDict("linear").get<bool>("keep");
        own.subDict("linear").remove("keep");
    }
    if (m4gn_options_check("ride", settings(own).c_str()) != M4GN_OK)
    {
        FatalIOErrorInFunction(dict) << m4gn_last_error() << exit(FatalIOError);
    }
}

m4gn_ride_answer Foam::m4gnRide::solved()
{
    const m4gn_ride_step step(now(correctors()));
    gathered_ = false;
    const m4gn_ride_answer answer = ask
    (
        [&](m4gn_ride_answer* a) { return m4gn_ride_solved(ride_, &step, a); },
        "m4gnSurrogate cannot go on"
    );
    record(answer);
    return answer;
}

void Foam::m4gnRide::record(const m4gn_ride_answer& asked)
{
    if (asked.arrays)
    {
        const std::vector<const double*> arrays(run_->gather());
        gathered_ = true;
        m4gn::check
        (
            m4gn_ride_record(ride_, arrays.data(), arrays.size()), "m4gnSurrogate cannot go on"
        );
        listen();
    }
}

m4gn_ride_answer Foam::m4gnRide::decide(const m4gn_ride_answer& asked)
{
    const std::vector<m4gn_field> fields(gather(asked.fields));
    const std::vector<const int32_t*> marks(held(asked.fields));
    const m4gn_ride_answer answer = ask
    (
        [&](m4gn_ride_answer* a)
        {
            return m4gn_ride_decide
            (
                ride_, fields.data(), marks.empty() ? nullptr : marks.data(), fields.size(), a
            );
        },
        "m4gnSurrogate ends the run"
    );
    writeErrors();
    return answer;
}

m4gn_ride_answer Foam::m4gnRide::stride(const m4gn_ride_answer& asked, List<scalarField>& predicted)
{
    const word& kind = kinds_[asked.surrogate];
    const bool linear = kind == "linear";
    const std::vector<m4gn_field> fields(gather(!linear, linear));
    if (linear)
    {
        const std::vector<const double*> inputs(run_->inputs(asked.duration));
        m4gn::check(m4gn_ride_inputs(ride_, inputs.data(), inputs.size()), "m4gnSurrogate cannot step");
    }
    const std::vector<advancedField> to(advances(kind));
    std::vector<m4gn_field_out> outputs(to.size());
    predicted.resize(to.size());
    forAll(predicted, i)
    {
        predicted[i].resize(to[i].components*(linear ? mesh_.nCells() : session_->nodes().size()));
        outputs[i].name = to[i].name.c_str();
        outputs[i].components = to[i].components;
        outputs[i].cells = predicted[i].data();
    }
    const m4gn_ride_answer answer = ask
    (
        [&](m4gn_ride_answer* a)
        {
            return m4gn_ride_stride
            (
                ride_, fields.data(), fields.size(), outputs.data(), outputs.size(), a
            );
        },
        "m4gnSurrogate cannot step"
    );
    if (linear && answer.action == M4GN_RIDE_ADVANCE)
    {
        const std::vector<double*> places(run_->places());
        m4gn::check(m4gn_ride_arrays(ride_, 0, places.data(), places.size()), "m4gnSurrogate cannot step");
    }
    // What a network advances to is in the fields alone
    gathered_ = gathered_ && linear;
    return answer;
}

bool Foam::m4gnRide::setOldLevels(const label surrogatei, const scalar deltaT)
{
    if (kinds_[surrogatei] != "linear" || !run_->hasOldLevels())
    {
        return false;
    }
    const std::vector<double*> places(run_->places());
    m4gn::check(m4gn_ride_arrays(ride_, deltaT, places.data(), places.size()), "m4gnSurrogate cannot hand over");
    run_->setOldLevels();
    gathered_ = false;
    return true;
}

m4gn_ride_answer Foam::m4gnRide::advanced()
{
    const m4gn_ride_step step(now());
    return ask
    (
        [&](m4gn_ride_answer* a) { return m4gn_ride_advanced(ride_, &step, a); },
        "m4gnSurrogate cannot go on"
    );
}

void Foam::m4gnRide::reported(const functionObjects::stateFunctionObject& results)
{
    if (quantities_.empty())
    {
        return;
    }
    std::vector<double> values;
    for (const dictionary& quantity : quantities_)
    {
        const word object(quantity.get<word>("object"));
        const word result(quantity.get<word>("result"));
        const word type(results.objectResultType(object, result));
        if (type != pTraits<scalar>::typeName)
        {
            FatalErrorInFunction
                << "Entry quantities of " << name_ << " has the result "
                << result << " of " << object << ", "
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
    for (const dictionary& quantity : quantities_)
    {
        const word object(quantity.get<word>("object"));
        if (!executed.found(object))
        {
            FatalErrorInFunction
                << "Entry quantities of " << name_ << " has the object "
                << object << ", which is no other function object that is"
                << " executed at the surrogate's times (entry executeOthers)" << nl
                << "    Those are: " << m4gn::join(executed.sortedToc())
                << exit(FatalError);
        }
    }
}

void Foam::m4gnRide::spent(const scalar surrogate, const scalar handOver)
{
    m4gn::check(m4gn_ride_spent(ride_, surrogate, handOver), "m4gnSurrogate cannot go on");
}

m4gn_ride_answer Foam::m4gnRide::handedBack
(
    const m4gn_ride_answer& asked,
    const List<quantity>& quantities
)
{
    const m4gn_ride_step step(now());
    const std::vector<m4gn_field> fields(gather(asked.fields));
    std::vector<m4gn_ride_quantity> told;
    for (const quantity& q : quantities)
    {
        told.push_back({q.first().c_str(), q.second()});
    }
    return ask
    (
        [&](m4gn_ride_answer* a)
        {
            return m4gn_ride_handed_back
            (
                ride_, &step, told.data(), told.size(), fields.data(), fields.size(), a
            );
        },
        "m4gnSurrogate cannot go on"
    );
}

Foam::fileName Foam::m4gnRide::stateFile(const word& name, const Time& time, const word& at)
{
    // A file handler that collates has the times of all ranks in one folder
    const fileName ranks(fileHandler().filePath(time.path()/at));

    return (ranks.empty() ? time.path()/at : ranks)/"uniform"/(name + ".state");
}

bool Foam::m4gnRide::stored(const word& name, const Time& time)
{
    const fileName path(stateFile(name, time, time.timeName()));
    bool found = Pstream::master() && isFile(path, false);
    reduce(found, orOp<bool>());
    return found;
}

Foam::dictionary Foam::m4gnRide::storedTypes(const word& name, const Time& time)
{
    const fileName path(stateFile(name, time, time.timeName()));
    string text;
    if (Pstream::master())
    {
        char found[8192] = "";
        // What is damaged is refused when it is taken up
        if (m4gn_ride_host(path.c_str(), found, sizeof(found)) == M4GN_OK)
        {
            text = found;
        }
    }
    Pstream::scatter(text);

    IStringStream stream(text);
    return dictionary(stream);
}

void Foam::m4gnRide::save()
{
    if (observes_ && !dict_.found("adapt"))
    {
        return;
    }

    // The first rank writes when the fields of all ranks are there
    const fileName path(stateFile(name_, mesh_.time(), mesh_.time().timeName()));
    if (Pstream::master())
    {
        mkDir(path.path());
    }
    returnReduce(true, andOp<bool>());
    m4gn::check(m4gn_ride_save(ride_, path.c_str()), "m4gnSurrogate cannot write its state");
}

bool Foam::m4gnRide::load(m4gn_ride_answer& answer)
{
    const m4gn_ride_step step(now());
    const fileName path(stateFile(name_, mesh_.time(), mesh_.time().timeName()));
    const int32_t status = m4gn_ride_load(ride_, path.c_str(), &step, &answer);

    if (status == M4GN_ERROR_MODEL)
    {
        WarningInFunction
            << m4gn_last_error() << ": the schedule of " << name_
            << " begins anew" << endl;
        return false;
    }
    m4gn::check(status, "m4gnSurrogate cannot carry on");
    listen();
    return true;
}

void Foam::m4gnRide::end()
{
    const std::string summary(m4gn_ride_text(ride_, M4GN_RIDE_SUMMARY));
    listen();

    if (summary.empty() || !Pstream::master())
    {
        return;
    }

    const fileName dir(m4gn::outputDir(name_, mesh_));
    mkDir(dir);
    OFstream os(dir/"summary.json");
    os  << summary.c_str();

    if (!os.good())
    {
        FatalErrorInFunction << "Cannot write " << os.name() << exit(FatalError);
    }
}
