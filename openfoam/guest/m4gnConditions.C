// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnConditions.H"
#include "HashSet.H"
#include "m4gnDictionary.H"
#include "m4gnNodes.H"
#include "m4gnSchemeFields.H"
#include "m4gnVersion.H"
#include "pointFields.H"
#include "StringStream.H"
#include "Time.H"
#include "globalIndex.H"
#include "uniformDimensionedFields.H"
#include "volFields.H"
#include <cmath>

namespace
{
using namespace Foam;

//- Longer texts are told apart by a number
constexpr size_t longest = 300;

//- Does the solver read and write it? Means are those of function objects.
bool isRead(const regIOobject& object)
{
    return object.writeOpt() == IOobject::AUTO_WRITE && object.readOpt() != IOobject::NO_READ
           && !object.name().ends_with("Mean") && !object.name().ends_with("_0")
           && !m4gn::isOfScheme(object.name());
}

//- Is it made anew of other fields when a run begins?
bool isMadeAnew(const word& name)
{
    static const wordHashSet names({"nut", "mut", "alphat"});
    return names.found(name);
}

//- Entries that the condition makes anew in each step, unless its type has no other
bool isMade(const word& entry, const word& type)
{
    static const wordHashSet names(
        {"value", "gradient", "refValue", "refGradient", "refGrad", "valueFraction"});
    static const wordHashSet plain({"fixedValue", "fixedGradient", "mixed", "directionMixed"});
    return names.found(entry) && !(plain.found(type) && entry != "value");
}

std::string textOf(const ITstream& stream)
{
    OStringStream os;
    os.precision(15);
    for (const token& t : stream) {
        os << t << ' ';
    }
    std::string text(os.str());
    if (!text.empty()) {
        text.pop_back();
    }
    if (text.size() > longest) {
        // FNV-1a
        uint64_t hash = 0xcbf29ce484222325;
        for (const char c : text) {
            hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3;
        }
        text = text.substr(0, 40) + "... #" + std::to_string(hash);
    }
    return text;
}

//- The entries of a dictionary, each with its path
void flatten(const std::string& path, const dictionary& dict, std::map<std::string, std::string>& found)
{
    for (const entry& e : dict) {
        const std::string name(path + ' ' + std::string(e.keyword()));
        if (e.keyword() == "FoamFile") {
            continue;
        }
        if (e.isDict()) {
            flatten(name, e.dict(), found);
        } else {
            found[name] = textOf(e.stream());
        }
    }
}

//- Add items with their values and places to sums
template <class Type>
void addTo(std::vector<scalar>& sums, const UList<Type>& values, const scalarField& places)
{
    constexpr label n = pTraits<Type>::nComponents;
    sums.resize(2 + 2 * n, 0);
    forAll(values, i) {
        sums[0] += 1;
        sums[1] += magSqr(values[i]);
        for (direction d = 0; d < n; ++d) {
            const scalar v = component(values[i], d);
            sums[2 + d] += v;
            sums[2 + n + d] += i < places.size() ? v * places[i] : 0;
        }
    }
}

//- Values of an entry "uniform 1" or "nonuniform List<scalar> 2(1 2)" of so many faces; false: it is none
bool addTo(std::vector<scalar>& sums, const ITstream& stream, const label nFaces, const scalarField& places)
{
    if (!stream.size() || !stream.first().isWord()) {
        return false;
    }
    const word form(stream.first().wordToken());
    if (form == "uniform") {
        DynamicList<scalar> components;
        for (const token& t : stream) {
            if (t.isNumber()) {
                components.append(t.number());
            }
        }
        const label n = components.size();
        sums.resize(2 + 2 * n, 0);
        for (label i = 0; i < nFaces; ++i) {
            sums[0] += 1;
            for (label d = 0; d < n; ++d) {
                sums[1] += sqr(components[d]);
                sums[2 + d] += components[d];
                sums[2 + n + d] += i < places.size() ? components[d] * places[i] : 0;
            }
        }
        return true;
    }
    if (form != "nonuniform") {
        return false;
    }
    for (const token& t : stream) {
        if (t.isCompound()) {
            const token::compound& list = t.compoundToken();
            if (const auto* scalars = dynamic_cast<const token::Compound<List<scalar>>*>(&list)) {
                addTo<scalar>(sums, *scalars, places);
            } else if (const auto* vectors = dynamic_cast<const token::Compound<List<vector>>*>(&list)) {
                addTo<vector>(sums, *vectors, places);
            } else if (const auto* symm = dynamic_cast<const token::Compound<List<symmTensor>>*>(&list)) {
                addTo<symmTensor>(sums, *symm, places);
            } else if (const auto* tensors = dynamic_cast<const token::Compound<List<tensor>>*>(&list)) {
                addTo<tensor>(sums, *tensors, places);
            }
        }
    }
    return true;
}

//- A number of each place that tells them apart, from 0 to 1
scalarField placesOf(const fvMesh& mesh, const vectorField& points)
{
    const boundBox& bounds = mesh.bounds();
    const vector along(vector(1, 0.7, 0.4) / max(VSMALL, bounds.mag()));
    return scalarField((points - bounds.min()) & along);
}

//- Does the condition hold the field's value?
template <class Type> bool holds(const fvPatchField<Type>& patch) { return patch.fixesValue(); }

template <class Type> bool holds(const pointPatchField<Type>& patch) { return patch.type() == "fixedValue"; }

} // End anonymous namespace

void Foam::m4gnConditions::addKept(figures& found) const
{
    for (const word& name : mesh_.sortedNames<volScalarField>()) {
        const auto& field = mesh_.lookupObject<volScalarField>(name);
        if (!isRead(field) && !field.ownedByRegistry() && !isMadeAnew(name) && !name.starts_with("m4gn")) {
            addTo<scalar>(found[name], field.primitiveField(), placesOf(mesh_, mesh_.C().primitiveField()));
        }
    }
}

void Foam::m4gnConditions::addFields(texts& words, figures& found, const bool values) const
{
    const auto add = [&](const auto& field) {
        if (!isRead(field)) {
            return;
        }
        // Those of processors are not those of all ranks
        for (label patchi = 0; patchi < mesh_.boundaryMesh().nNonProcessor(); ++patchi) {
            const fvPatch& patch = mesh_.boundary()[patchi];
            const auto& condition = field.boundaryField()[patchi];
            if (polyPatch::constraintType(patch.type())) {
                continue;
            }
            OStringStream os;
            os.precision(15);
            condition.write(os);
            IStringStream is(os.str());
            const dictionary entries(is);
            const std::string at(std::string(field.name()) + " at " + patch.name());
            const scalarField places(placesOf(mesh_, patch.Cf()));
            for (const entry& e : entries) {
                const word& key = e.keyword();
                const std::string name(at + ' ' + key);
                if (e.isDict()) {
                    flatten(name, e.dict(), words);
                    continue;
                }
                if (key == "value" ? !values || !holds(condition) || isMadeAnew(field.name())
                                   : isMade(key, condition.type())) {
                    continue;
                }
                std::vector<scalar> sums;
                if (addTo(sums, e.stream(), patch.size(), places)) {
                    found[name] = sums;
                } else {
                    words[name] = textOf(e.stream());
                }
            }
        }
    };
    const auto inside = [&](const auto& field) {
        if (values && isRead(field) && !isMadeAnew(field.name())) {
            addTo(
                found[std::string(field.name()) + " in cells"], field.primitiveField(),
                placesOf(mesh_, mesh_.C().primitiveField()));
        }
    };
    for (const word& name : mesh_.sortedNames<volScalarField>()) {
        add(mesh_.lookupObject<volScalarField>(name));
        inside(mesh_.lookupObject<volScalarField>(name));
    }
    for (const word& name : mesh_.sortedNames<volVectorField>()) {
        add(mesh_.lookupObject<volVectorField>(name));
        inside(mesh_.lookupObject<volVectorField>(name));
    }
    for (const word& name : mesh_.sortedNames<pointVectorField>()) {
        add(mesh_.lookupObject<pointVectorField>(name));
    }
}

void Foam::m4gnConditions::addOrder(const bool ofRanks)
{
    if (ofRanks) {
        given_["ranks of the state"] = std::to_string(Pstream::nProcs());
    }
    const globalIndex consecutive(mesh_.nCells());
    labelList numbers(mesh_.nCells());
    forAll(numbers, celli) {
        numbers[celli] = consecutive.toGlobal(celli);
    }
    labelList whole;
    if (!ofRanks && Pstream::parRun()
        && m4gnNodes::procAddressing(mesh_, "cellProcAddressing", mesh_.nCells(), whole))
    {
        numbers.transfer(whole);
    }
    const scalar nCells = returnReduce(mesh_.nCells(), sumOp<label>());
    scalarField order(numbers.size());
    forAll(order, celli) {
        order[celli] = numbers[celli] / nCells;
    }
    addTo<scalar>(order_["order of the cells"], order, placesOf(mesh_, mesh_.C().primitiveField()));
}

Foam::m4gnConditions::m4gnConditions(const fvMesh& mesh, const bool ofRanks) : mesh_(mesh)
{
    addOrder(ofRanks);

    // "data" is what linear solvers have done in the last step
    static const wordHashSet others({"controlDict", "decomposeParDict", "blockMeshDict", "data"});
    const objectRegistry* registries[] = {&mesh.time(), &mesh.thisDb()};
    for (const objectRegistry* registry : registries) {
        const auto ofCase = [&](const IOobject& object) {
            return (object.instance() == mesh.time().constant() || object.instance() == mesh.time().system())
                   && !others.found(object.name());
        };
        for (const word& name : registry->sortedNames<IOdictionary>()) {
            const auto& dict = registry->lookupObject<IOdictionary>(name);
            if (ofCase(dict)) {
                flatten(
                    name, name == "fvSolution" ? m4gn::without(dict, {"solvers"}) : dictionary(dict), given_);
            }
        }
        for (const word& name : registry->sortedNames<uniformDimensionedVectorField>()) {
            const auto& field = registry->lookupObject<uniformDimensionedVectorField>(name);
            if (ofCase(field)) {
                OStringStream os;
                os << field.value();
                given_[name] = os.str();
            }
        }
    }
    addKept(kept_);
}

std::string Foam::m4gnConditions::now(const wordList& fields) const
{
    texts words(given_);
    figures found(order_);
    addFields(words, found, true);
    figures kept;
    addKept(kept);
    for (const auto& before : kept_) {
        bool same = kept.count(before.first) && kept[before.first] == before.second;
        reduce(same, andOp<bool>());
        if (same) {
            found[before.first] = before.second;
        }
    }
    words["fields of the state"] = m4gn::join(fields);

    // Of all ranks: those of the first one name them
    std::string text("{");
    const auto put = [&](const std::string& name, const std::string& value) {
        text += (text.size() > 1 ? ", " : "") + m4gn::quoted(name) + ": " + value;
    };
    for (const auto& pair : words) {
        put(pair.first, m4gn::quoted(pair.second));
    }
    HashTable<scalarField, string> all;
    for (const auto& pair : found) {
        scalarField sums(pair.second.size());
        std::copy(pair.second.begin(), pair.second.end(), sums.begin());
        all.set(pair.first, sums);
    }
    Pstream::mapCombineGather(all, [](scalarField& sums, const scalarField& others) {
        if (sums.size() < others.size()) {
            sums.resize(others.size(), Zero);
        }
        forAll(others, i) {
            sums[i] += others[i];
        }
    });
    for (const auto& pair : found) {
        scalarField sums(all[pair.first]);
        if (sums.empty()) {
            // A patch without faces
            continue;
        }
        const scalar n = max(scalar(1), sums[0]);
        sums /= n;
        sums[0] = n;
        sums[1] = std::sqrt(sums[1]);
        std::string list;
        bool finite = true;
        // Their number is that of the mesh
        for (label i = 1; i < sums.size(); ++i) {
            finite = finite && std::isfinite(sums[i]);
            list += (i > 1 ? ", " : "") + m4gn::text(sums[i]);
        }
        put(pair.first, finite ? '[' + list + ']' : std::string("\"not finite\""));
    }
    string told(text + '}');
    // JSON is UTF-8, and files of a case need not be, nor texts that were cut
    for (char& c : told) {
        c = static_cast<unsigned char>(c) < 0x80 ? c : '?';
    }
    m4gn::broadcast(told);
    return std::string(told);
}

void Foam::m4gnConditions::refuseMemory()
{
    texts words;
    figures found;
    addFields(words, found, false);
    string changed;
    for (const auto& pair : words) {
        const auto before = entries_.find(pair.first);
        if (before != entries_.end() && before->second != pair.second) {
            changed = pair.first + ", " + before->second + " before and " + pair.second + " now";
        }
    }
    for (const auto& pair : found) {
        const auto before = entryFigures_.find(pair.first);
        if (before != entryFigures_.end() && before->second != pair.second) {
            changed = pair.first;
        }
    }
    entries_ = words;
    entryFigures_ = found;
    List<string> all(Pstream::nProcs());
    all[Pstream::myProcNo()] = changed;
    Pstream::gatherList(all);
    m4gn::broadcast(all);
    for (const string& what : all) {
        if (what.size()) {
            FatalErrorInFunction
                << "A boundary condition keeps what is no value of its field and changes from step to"
                << " step: " << what.c_str() << nl
                << "    It would stand still in a jump. Expected conditions without a state of"
                << " their own; use mode observe" << exit(FatalError);
        }
    }
}
