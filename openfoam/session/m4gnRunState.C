// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRunState.H"
#include "m4gnDictionary.H"
#include "m4gnHandOver.H"
#include "m4gnRun.H"
#include "pointFields.H"
#include "Time.H"

namespace
{
using namespace Foam;

//- Does it stay positive? Pressures are absolute where the density varies.
bool positive(const word& name, const dimensionSet& dimensions)
{
    static const wordHashSet names(
        {"k", "epsilon", "omega", "nut", "nuTilda", "alphat", "T", "rho", "thermo:rho", "thermo:psi",
         "thermo:mu", "thermo:alpha"});
    return names.found(name) || (name == "p" && dimensions == dimPressure);
}

//- Does the solver read and write it?
bool isRead(const regIOobject& object)
{
    return object.writeOpt() == IOobject::AUTO_WRITE && object.readOpt() != IOobject::NO_READ
           && !object.name().ends_with("Mean");
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
           && (isRead(object) || !object.ownedByRegistry() || name.starts_with("ddt0(")
               || name.starts_with("ddtCorrDdt0("));
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
bool isOf(const bool points, const GeometricField<Type, Patch, Mesh>&)
{
    return points ? std::is_same<Mesh, pointMesh>::value : std::is_same<Mesh, volMesh>::value;
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

} // End anonymous namespace

template <class Action> void Foam::m4gnRunState::each(const Action& action) const
{
    for (const word& name : fields_) {
        apply<volScalarField>(mesh_, name, action);
        apply<volVectorField>(mesh_, name, action);
        apply<volSymmTensorField>(mesh_, name, action);
        apply<volTensorField>(mesh_, name, action);
        apply<surfaceScalarField>(mesh_, name, action);
        apply<surfaceVectorField>(mesh_, name, action);
        apply<surfaceTensorField>(mesh_, name, action);
        apply<pointScalarField>(mesh_, name, action);
        apply<pointVectorField>(mesh_, name, action);
    }
}

void Foam::m4gnRunState::checkCase()
{
    const string why(m4gn::notInFields(mesh_));

    if (why.size()) {
        FatalErrorInFunction << "The dmd surrogate cannot hand states of this case over to its"
                             << " solver: " << why.c_str() << exit(FatalError);
    }

    for (const word group : {"ddtSchemes", "d2dt2Schemes"}) {
        const wordHashSet handled(
            group == "ddtSchemes" ? wordHashSet({"Euler", "backward", "CrankNicolson", "NewmarkBeta", "none"})
                                  : wordHashSet({"Euler", "NewmarkBeta", "steadyState", "none"}));

        for (const entry& e : mesh_.schemesDict().subOrEmptyDict(group)) {
            const word used(m4gn::scheme(mesh_.schemesDict(), group, e.keyword()));

            if (!handled.found(used)) {
                FatalErrorInFunction << "The dmd surrogate does not handle the time scheme " << used << " of "
                                     << group << " (" << e.keyword() << ')' << nl
                                     << "    Handled: " << m4gn::join(handled.sortedToc())
                                     << exit(FatalError);
            }
            // solids4foam's models of increments go on from two levels of the displacement
            const bool second = group == "d2dt2Schemes" && used == "Euler";
            nOldLevels_ = max(nOldLevels_, label(second ? 2 : used == "backward" || used == "CrankNicolson"));
        }
    }
}

Foam::m4gnRunState::m4gnRunState(const fvMesh& mesh)
    : m4gnSolverState(mesh), atPoints_(m4gn::solidModel(mesh).starts_with("vertexCentred")),
      volumes_(atPoints_ ? shares(mesh) : scalarField(mesh.V())), nOldLevels_(0)
{
    checkCase();

    wordHashSet names(mesh.names<volScalarField>());
    names.insert(mesh.names<volVectorField>());
    names.insert(mesh.names<volSymmTensorField>());
    names.insert(mesh.names<volTensorField>());
    names.insert(mesh.names<surfaceScalarField>());
    names.insert(mesh.names<surfaceVectorField>());
    names.insert(mesh.names<surfaceTensorField>());
    names.insert(mesh.names<pointScalarField>());
    names.insert(mesh.names<pointVectorField>());
    DynamicList<word> found;
    for (const word& name : names.sortedToc()) {
        if (isState(mesh.lookupObject<regIOobject>(name))) {
            found.append(name);
        }
    }
    fields_ = found;

    label solved = 0;
    for (direction d = 0; d < vector::nComponents; ++d) {
        solved += mesh.solutionD()[d] > 0;
    }
    const auto add = [&](const std::string& name, const label n, const label components,
                         const label solvedComponents, const bool fitted, const bool isPositive) {
        names_.push_back(name);
        m4gn_ride_array array{};
        array.n = n * components;
        array.components = components;
        array.solved = solvedComponents;
        array.positive = isPositive;
        array.fitted = solvedComponents && fitted;
        array.weights = array.fitted ? volumes_.cdata() : nullptr;
        layout_.push_back(array);
    };
    each([&](auto& field) {
        const label n = componentsOf(field);
        const bool measured = isOf(atPoints_, field) && (n == 1 || n == 3) && isRead(field);
        const bool isPositive = positive(field.name(), field.dimensions());
        add(field.name(), field.primitiveField().size(), n,
            !measured ? 0
            : n == 1  ? 1
                      : solved,
            !follows(field, field.dimensions()), isPositive);
        label faces = 0;
        for (const auto& patch : field.boundaryField()) {
            faces += sizeOf(patch);
        }
        add(field.name() + ".boundary", faces, n, 0, false, isPositive);
    });

    values_.resize(layout_.size());

    inputs_.reset(new m4gnPrescribed(mesh, fields_));
    forAll(inputs_->values(), i) {
        add(inputs_->name(i), inputs_->values()[i].size(), 1, 0, false, false);
        layout_.back().input = 1;
    }

    for (size_t i = 0; i < layout_.size(); ++i) {
        layout_[i].name = names_[i].c_str();
    }
    forAll(values_, i) {
        values_[i].resize(layout_[i].n);
        if (layout_[i].solved) {
            m4gn_field field{};
            field.name = layout_[i].name;
            field.components = layout_[i].components;
            field.cells = values_[i].cdata();
            measured_.push_back(field);
        }
    }
    if (measured_.empty()) {
        FatalErrorInFunction << "The solver has no field that it reads and writes: the"
                             << " dmd surrogate has nothing to be fitted to" << exit(FatalError);
    }
    DynamicList<word> read, beside;
    for (const word& name : fields_) {
        (isRead(mesh.lookupObject<regIOobject>(name)) ? read : beside).append(name);
    }
    read_ = read;
    beside_ = beside;
    Info << "m4gn: the dmd surrogate advances " << m4gn::join(read_);
    if (beside_.size()) {
        Info << " and, with them, " << m4gn::join(beside_);
    }
    Info << nl << endl;
}

Foam::scalar Foam::m4gnRunState::size() const
{
    scalar n = 0;
    for (const m4gn_ride_array& array : layout_) {
        n += array.n;
    }
    return returnReduce(n, sumOp<scalar>());
}

std::vector<const double*> Foam::m4gnRunState::gather()
{
    label arrayi = 0;
    each([&](auto& field) {
        std::copy_n(numbers(field.primitiveField()), values_[arrayi].size(), values_[arrayi].begin());
        scalar* to = values_[arrayi + 1].begin();
        for (const auto& patch : field.boundaryField()) {
            to = std::copy_n(numbers(patch), sizeOf(patch) * componentsOf(field), to);
        }
        arrayi += 2;
    });

    std::vector<const double*> all;
    for (const scalarField& values : values_) {
        all.push_back(values.cdata());
    }
    for (const double* values : inputs(0)) {
        all.push_back(values);
    }
    return all;
}

std::vector<const double*> Foam::m4gnRunState::inputs(const scalar later)
{
    inputs_->say(later);

    std::vector<const double*> all;
    for (const scalarField& values : inputs_->values()) {
        all.push_back(values.cdata());
    }
    return all;
}

std::vector<double*> Foam::m4gnRunState::places()
{
    std::vector<double*> all;
    for (scalarField& values : values_) {
        all.push_back(values.data());
    }
    for (scalarField& values : inputs_->values()) {
        all.push_back(values.data());
    }
    return all;
}

void Foam::m4gnRunState::advance(const List<scalarField>&, const scalar duration)
{
    step(duration);
    put(0);
}

void Foam::m4gnRunState::put(const label before)
{
    label arrayi = 0;
    each([&](auto& present) {
        if (before <= present.nOldTimes()) {
            auto& field = before == 0   ? present
                          : before == 1 ? present.oldTime()
                                        : present.oldTime().oldTime();
            std::copy(values_[arrayi].begin(), values_[arrayi].end(), numbers(field.primitiveFieldRef()));
            const scalar* from = values_[arrayi + 1].begin();
            for (auto& patch : field.boundaryFieldRef()) {
                const label n = sizeOf(patch) * componentsOf(field);
                std::copy_n(from, n, numbers(patch));
                from += n;
            }
        }
        arrayi += 2;
    });
}

Foam::List<Foam::m4gnSolverState::quantity> Foam::m4gnRunState::quantities() const
{
    const auto* phi = mesh_.findObject<surfaceScalarField>("phi");
    if (!phi || phi->dimensions() != dimVelocity * dimArea) {
        return {};
    }
    return {quantity("maxDivAfter", maxDiv(*phi))};
}
