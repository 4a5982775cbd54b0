// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnState.H"
#include "m4gnCaseChecks.H"
#include "m4gnDictionary.H"
#include "m4gnHandOver.H"
#include "m4gnNodeTypes.H"
#include "m4gnOwnFields.H"
#include "m4gnSchemeFields.H"
#include "directionMixedFvPatchFields.H"
#include "mixedFvPatchFields.H"
#include "pointFields.H"
#include "surfaceFields.H"
#include "Time.H"
#include <cmath>

namespace
{
using namespace Foam;

//- Does it stay positive? Pressures are absolute where the density varies.
bool positive(const word& name, const dimensionSet& dimensions)
{
    // Turbulence models take roots of theirs before they bound them
    static const wordHashSet names({"k",        "kl",         "kt",         "epsilon",   "omega",
                                    "nut",      "nuTilda",    "v2",         "phit",      "gammaInt",
                                    "ReThetat", "flm",        "fmm",        "alphat",    "T",
                                    "rho",      "thermo:rho", "thermo:psi", "thermo:mu", "thermo:alpha"});
    return names.found(name) || (name == "p" && dimensions == dimPressure);
}

//- Does the solver read and write it?
bool isRead(const regIOobject& object)
{
    return object.writeOpt() == IOobject::AUTO_WRITE && object.readOpt() != IOobject::NO_READ
           && !object.name().ends_with("Mean") && !m4gn::isOfScheme(object.name());
}

//- Does the solver go on from it? What it reads and writes, and what it keeps beside (enthalpy, compressibility, stress): those
//  fields are its own variables, while those of function objects and of caches belong to the registry. Of the time schemes'
//  own fields, which do so too, CrankNicolson's are part of the state; old levels are those of their fields.
bool isState(const regIOobject& object)
{
    const word& name = object.name();
    const auto beside = [&](const char* end) {
        return name.ends_with(end) && object.db().found(name.substr(0, name.size() - strlen(end)));
    };
    return !beside("_0") && !beside("PrevIter") && !name.starts_with("m4gn")
           && (isRead(object) || !object.ownedByRegistry() || m4gn::isOfScheme(name));
}

template <class Type> scalar* numbers(Field<Type>& values)
{
    return reinterpret_cast<scalar*>(values.data());
}

template <class Type> const scalar* numbers(const Field<Type>& values)
{
    return reinterpret_cast<const scalar*>(values.cdata());
}

template <class Type, template <class> class Patch, class Mesh>
constexpr label componentsOf(const GeometricField<Type, Patch, Mesh>&)
{
    return pTraits<Type>::nComponents;
}

//- A field of points has no boundary values beside those of its points
template <class Type> label sizeOf(const Field<Type>& patch) { return patch.size(); }

template <class Type> label sizeOf(const pointPatchField<Type>&) { return 0; }

template <class Type> scalar* numbers(const pointPatchField<Type>&) { return nullptr; }

template <class Type, template <class> class Patch, class Mesh>
constexpr label placeOf(const GeometricField<Type, Patch, Mesh>&)
{
    return std::is_same<Mesh, pointMesh>::value ? M4GN_POINTS
           : std::is_same<Mesh, volMesh>::value ? M4GN_CELLS
                                                : M4GN_FACES;
}

//- The points' shares of the cells' volumes; a point of several ranks has a share of each
scalarField shares(const fvMesh& mesh)
{
    scalarField shares(mesh.nPoints(), Zero);
    forAll(mesh.cellPoints(), celli) {
        const labelList& points = mesh.cellPoints()[celli];
        for (const label pointi : points) {
            shares[pointi] += mesh.V()[celli] / points.size();
        }
    }
    return shares;
}

//- Does it follow from other fields, without an equation in time? It then has the noise of the tolerance that it is solved to: the fit is
//  made of the fields that evolve, and carries it.
bool follows(const regIOobject& object, const dimensionSet& dimensions)
{
    static const wordHashSet coefficients({"nut", "mut", "alphat"});
    static const wordHashSet pressures({"p", "p_rgh"});
    return coefficients.found(object.name())
           || (pressures.found(object.name()) && dimensions == sqr(dimVelocity));
}

template <class FieldType, class Action>
void apply(const fvMesh& mesh, const word& name, const Action& action)
{
    if (auto* field = mesh.getObjectPtr<FieldType>(name)) {
        action(*field);
    }
}

//- Which faces hold a field's value; where they let go, a face has its cell's
template <class Type>
void mark(const GeometricField<Type, fvPatchField, volMesh>& field, const labelList& patches, scalar* held)
{
    for (const label patchi : patches) {
        const fvPatchField<Type>& patch = field.boundaryField()[patchi];
        const auto* mixed = dynamic_cast<const mixedFvPatchField<Type>*>(&patch);
        const auto* directionMixed = dynamic_cast<const directionMixedFvPatchField<Type>*>(&patch);

        forAll(patch, facei) {
            *held++ = mixed            ? mixed->valueFraction()[facei] > 0.5
                      : directionMixed ? tr(directionMixed->valueFraction()[facei]) > 0.5
                                       : patch.fixesValue();
        }
    }
}

} // End anonymous namespace

template <class Action> void Foam::m4gnState::each(const Action& action) const
{
    for (const word& name : fields_) {
        apply<volScalarField>(mesh_, name, action);
        apply<volVectorField>(mesh_, name, action);
        apply<volSymmTensorField>(mesh_, name, action);
        apply<volTensorField>(mesh_, name, action);
        apply<surfaceScalarField>(mesh_, name, action);
        apply<surfaceVectorField>(mesh_, name, action);
        apply<surfaceTensorField>(mesh_, name, action);
        apply<surfaceSymmTensorField>(mesh_, name, action);
        apply<pointScalarField>(mesh_, name, action);
        apply<pointVectorField>(mesh_, name, action);
    }
}

template <class FieldType> void Foam::m4gnState::copyBoundary(const FieldType& field, double* to) const
{
    for (const label patchi : patches_) {
        const auto& patch = field.boundaryField()[patchi];
        to = std::copy_n(numbers(patch), componentsOf(field) * sizeOf(patch), to);
    }
}

m4gn_array& Foam::m4gnState::add(
    const std::string& name, const label place, const label role, const label components, const label n)
{
    m4gn_array array{};
    array.place = place;
    array.role = role;
    array.components = components;
    array.n = n;
    array.floor = -HUGE_VAL;
    names_.push_back(name);
    arrays_.push_back(array);
    return arrays_.back();
}

template <class FieldType> void Foam::m4gnState::describe(const FieldType& field)
{
    const word& name = field.name();
    const label n = componentsOf(field);
    const label place = placeOf(field);
    const label unknowns = m4gn::solidModel(mesh_).starts_with("vertexCentred") ? M4GN_POINTS : M4GN_CELLS;
    const bool evolves = whole_ && place == unknowns && (n == 1 || n == 3) && isRead(field) && isState(field);

    label role = M4GN_CARRIED;
    if (evolves) {
        role = follows(field, field.dimensions()) ? M4GN_FOLLOWS : M4GN_SOLVED;
    } else if (outputs_.found(name)) {
        // A fit is made of what the solver solves for
        role = whole_ ? M4GN_FOLLOWS : M4GN_SOLVED;
    }
    label directions = 0;
    for (direction d = 0; d < vector::nComponents; ++d) {
        directions += mesh_.solutionD()[d] > 0;
    }
    label faces = 0;
    for (const auto& patch : field.boundaryField()) {
        faces += sizeOf(patch);
    }

    const scalar floor = positive(name, field.dimensions()) ? 0 : -HUGE_VAL;
    m4gn_array& array = add(name, place, role, n, field.primitiveField().size());
    array.floor = floor;
    array.solved = n == 1 ? 1 : directions;
    array.weights = whole_ && role == M4GN_SOLVED ? volumes_.cdata() : nullptr;
    add(name, M4GN_BOUNDARY, M4GN_CARRIED, n, faces).floor = floor;
}

Foam::m4gnState::m4gnState(
    const fvMesh& mesh, const wordHashSet& atStart, const bool whole, const bool observes,
    const m4gnNodes* nodes, const wordList& inputs, const wordList& outputs)
    : mesh_(mesh), whole_(whole), nodes_(nodes), outputs_(outputs), nOldLevels_(0)
{
    DynamicList<label> withValues, others;
    for (const fvPatch& patch : mesh.boundary()) {
        (m4gnNodeTypes::carriesValues(patch) ? withValues : others).append(patch.index());
    }
    patches_ = withValues;
    patches_.append(others);

    wordHashSet ofNetwork(inputs);
    ofNetwork.insert(outputs);
    for (const word& name : ofNetwork.sortedToc()) {
        m4gnOwnFields::provide(mesh, name);
    }
    if (whole) {
        const string why(m4gn::unsupported(mesh));
        if (why.size()) {
            FatalErrorInFunction << "The dmd surrogate cannot hand states of this case over to its"
                                 << " solver: " << why.c_str() << exit(FatalError);
        }
        nOldLevels_ = m4gn::oldLevels(mesh);
        const bool atPoints = m4gn::solidModel(mesh).starts_with("vertexCentred");
        volumes_ = atPoints ? shares(mesh) : scalarField(mesh.V());
    }

    DynamicList<word> found, read, beside;
    fields_ = mesh.sortedNames<regIOobject>();
    each([&](auto& field) {
        const word& name = field.name();
        const bool there = atStart.empty() || isRead(field) || m4gn::isOfScheme(name) || atStart.found(name);
        const bool state = whole && there && isState(field);
        if (state || ofNetwork.found(field.name())) {
            found.append(field.name());
        }
        if (state) {
            (isRead(field) ? read : beside).append(field.name());
        }
    });
    fields_ = found;
    read_ = read;
    beside_ = beside;
    each([&](auto& field) { describe(field); });

    if (whole) {
        prescribed_.reset(new m4gnPrescribed(mesh, fields_));
        forAll(prescribed_->values(), i) {
            // Of some faces
            add(prescribed_->name(i), M4GN_FACES, M4GN_PRESCRIBED, 1, prescribed_->values()[i].size());
        }
    }
    if (observes && nodes) {
        for (const word& name : outputs) {
            add(name, M4GN_BOUNDARY, M4GN_HELD, 1, nodes->nBoundary());
        }
    }

    values_.resize(arrays_.size());
    bool solved = false;
    forAll(values_, i) {
        m4gn_array& array = arrays_[i];
        array.name = names_[i].c_str();
        values_[i].resize(array.n * array.components);
        solved = solved || array.role == M4GN_SOLVED || array.role == M4GN_FOLLOWS;
    }
    if (!solved) {
        FatalErrorInFunction << "The solver has no field that it reads and writes: the"
                             << " dmd surrogate has nothing to be fitted to" << exit(FatalError);
    }
    if (whole) {
        Info << "m4gn: the dmd surrogate advances " << m4gn::join(read_);
        if (beside_.size()) {
            Info << " and, with them, " << m4gn::join(beside_);
        }
        Info << nl << endl;
    }
}

std::vector<const double*> Foam::m4gnState::gather()
{
    std::vector<const double*> all;
    for (const scalarField& values : values_) {
        all.push_back(values.cdata());
    }

    label arrayi = 0;
    each([&](auto& field) {
        m4gnOwnFields::provide(mesh_, field.name());
        copyBoundary(field, values_[arrayi + 1].data());
        all[arrayi] = numbers(field.primitiveField());
        arrayi += 2;
    });
    if (prescribed_) {
        prescribed_->say(0);
        for (const scalarField& values : prescribed_->values()) {
            all[arrayi++] = values.cdata();
        }
    }
    for (; arrayi < values_.size(); ++arrayi) {
        const word& name = names_[arrayi];
        scalar* held = values_[arrayi].data();
        if (const auto* field = mesh_.findObject<volScalarField>(name)) {
            mark(*field, nodes_->valuePatches(), held);
        } else {
            mark(mesh_.lookupObject<volVectorField>(name), nodes_->valuePatches(), held);
        }
    }
    return all;
}

std::vector<double*> Foam::m4gnState::places(const label before)
{
    std::vector<double*> all;
    forAll(values_, i) {
        all.push_back(arrays_[i].role == M4GN_PRESCRIBED ? nullptr : values_[i].data());
    }
    label arrayi = 0;
    each([&](const auto& field) {
        if (before > field.nOldTimes()) {
            all[arrayi] = all[arrayi + 1] = nullptr;
        }
        arrayi += 2;
    });
    return all;
}

void Foam::m4gnState::put(const label before)
{
    label arrayi = 0;
    each([&](auto& present) {
        if (before <= present.nOldTimes()) {
            auto& field = before == 0   ? present
                          : before == 1 ? present.oldTime()
                                        : present.oldTime().oldTime();
            std::copy(values_[arrayi].begin(), values_[arrayi].end(), numbers(field.primitiveFieldRef()));
            const scalar* from = values_[arrayi + 1].begin();
            auto& boundary = field.boundaryFieldRef();
            for (const label patchi : patches_) {
                const label n = sizeOf(boundary[patchi]) * componentsOf(field);
                std::copy_n(from, n, numbers(boundary[patchi]));
                from += n;
            }
        }
        arrayi += 2;
    });
}

void Foam::m4gnState::impose() const
{
    forAll(fields_, i) {
        if (outputs_.found(fields_[i])) {
            nodes_->impose(fields_[i], arrays_[2 * i].components, values_[2 * i]);
        }
    }
}

Foam::scalar Foam::m4gnState::size() const
{
    scalar n = 0;
    for (const m4gn_array& array : arrays_) {
        n += array.n * array.components;
    }
    return returnReduce(n, sumOp<scalar>());
}

void Foam::m4gnState::ahead(const scalar later, double* const* arrays)
{
    label arrayi = 2 * fields_.size();
    if (prescribed_) {
        prescribed_->say(later);
        for (const scalarField& values : prescribed_->values()) {
            if (double* to = arrays[arrayi++]) {
                std::copy(values.begin(), values.end(), to);
            }
        }
    }
}

int32_t Foam::m4gnState::ahead(void* state, double later, double* const* arrays)
{
    static_cast<m4gnState*>(state)->ahead(scalar(later), arrays);
    return M4GN_OK;
}
