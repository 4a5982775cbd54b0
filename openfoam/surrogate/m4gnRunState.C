// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRunState.H"
#include "m4gnDictionary.H"
#include "m4gnFluxProjection.H"
#include "Time.H"

namespace
{
using namespace Foam;

//- Fields that stay positive
const wordHashSet& positive()
{
    static const wordHashSet names({"k", "epsilon", "omega", "nut", "nuTilda", "alphat", "T", "rho"});
    return names;
}

//- Does the solver read and write it? Old levels are not read as such, and means are other function objects'
bool isState(const regIOobject& object)
{
    const word& name = object.name();
    return
        object.writeOpt() == IOobject::AUTO_WRITE && object.readOpt() != IOobject::NO_READ
     && !name.ends_with("_0") && !name.ends_with("Mean") && !name.starts_with("m4gn");
}

template<class Type>
scalar* numbers(Field<Type>& values)
{
    return reinterpret_cast<scalar*>(values.data());
}

//- Does it follow from other fields, without an equation in time? It then has the noise of the tolerance that it is solved to: the fit is
//  made of the fields that evolve, and carries it.
bool follows(const regIOobject& object, const dimensionSet& dimensions)
{
    static const wordHashSet coefficients({"nut", "mut", "alphat"});
    static const wordHashSet pressures({"p", "p_rgh"});
    return
        coefficients.found(object.name())
     || (pressures.found(object.name()) && dimensions == sqr(dimVelocity));
}

//- What the arrays are
struct describe
{
    std::vector<std::string>& names;
    std::vector<m4gn_ride_array>& layout;
    const scalarField& volumes;
    const label solvedDirections;

    void add
    (
        const std::string& name, const label n, const label components, const label solved, const bool fitted
    )
    {
        names.push_back(name);
        m4gn_ride_array array{};
        array.n = n*components;
        array.components = components;
        array.solved = solved;
        array.positive = positive().found(name);
        array.fitted = solved && fitted;
        array.weights = array.fitted ? volumes.cdata() : nullptr;
        layout.push_back(array);
    }

    template<class Type, template<class> class Patch, class Mesh>
    void operator()(GeometricField<Type, Patch, Mesh>& field)
    {
        const label n = pTraits<Type>::nComponents;
        const bool measured = std::is_same<Mesh, volMesh>::value && (n == 1 || n == 3);
        const label solved = !measured ? 0 : n == 1 ? 1 : solvedDirections;
        add(field.name(), field.primitiveField().size(), n, solved, !follows(field, field.dimensions()));
        label faces = 0;
        for (const auto& patch : field.boundaryField())
        {
            faces += patch.size();
        }
        add(field.name() + ".boundary", faces, n, 0, false);
    }
};

//- From the fields into the arrays
struct copyOut
{
    List<scalarField>& values;
    label arrayi;

    template<class Type, template<class> class Patch, class Mesh>
    void operator()(GeometricField<Type, Patch, Mesh>& field)
    {
        const Field<Type>& cells = field.primitiveField();
        const auto* from = reinterpret_cast<const scalar*>(cells.cdata());
        std::copy(from, from + values[arrayi].size(), values[arrayi].begin());
        scalar* to = values[arrayi + 1].begin();
        for (const auto& patch : field.boundaryField())
        {
            from = reinterpret_cast<const scalar*>(patch.cdata());
            to = std::copy(from, from + patch.size()*pTraits<Type>::nComponents, to);
        }
        arrayi += 2;
    }
};

//- And back: old levels get the old state
struct copyIn
{
    const List<scalarField>& values;
    label arrayi;

    template<class Type, template<class> class Patch, class Mesh>
    void operator()(GeometricField<Type, Patch, Mesh>& field)
    {
        std::copy(values[arrayi].begin(), values[arrayi].end(), numbers<Type>(field.primitiveFieldRef()));
        const scalar* from = values[arrayi + 1].begin();
        for (auto& patch : field.boundaryFieldRef())
        {
            const label n = patch.size()*pTraits<Type>::nComponents;
            std::copy(from, from + n, numbers<Type>(patch));
            from += n;
        }
        arrayi += 2;
    }
};

template<class FieldType, class Action>
void apply(const fvMesh& mesh, const word& name, Action& action)
{
    if (auto* field = mesh.getObjectPtr<FieldType>(name))
    {
        action(*field);
    }
}

} // End anonymous namespace

template<class Action>
void Foam::m4gnRunState::each(Action& action) const
{
    for (const word& name : fields_)
    {
        apply<volScalarField>(mesh_, name, action);
        apply<volVectorField>(mesh_, name, action);
        apply<volSymmTensorField>(mesh_, name, action);
        apply<volTensorField>(mesh_, name, action);
        apply<surfaceScalarField>(mesh_, name, action);
        apply<surfaceVectorField>(mesh_, name, action);
    }
}

void Foam::m4gnRunState::checkScheme() const
{
    const word used(m4gn::scheme(mesh_.schemesDict(), "ddtSchemes", "default"));

    if (used != "Euler" && used != "backward")
    {
        FatalErrorInFunction
            << "The linear surrogate does not handle the time scheme " << used << nl
            << "    Handled as default of ddtSchemes: Euler, backward"
            << exit(FatalError);
    }
    if (mesh_.foundObject<volVectorField>("D"))
    {
        FatalErrorInFunction
            << "The linear surrogate does not handle solvers of a displacement"
            << " D, which is of second order in time" << exit(FatalError);
    }
}

Foam::m4gnRunState::m4gnRunState(const fvMesh& mesh)
:
    m4gnSolverState(mesh),
    volumes_(mesh.V())
{
    checkScheme();

    wordHashSet names(mesh.names<volScalarField>());
    names.insert(mesh.names<volVectorField>());
    names.insert(mesh.names<volSymmTensorField>());
    names.insert(mesh.names<volTensorField>());
    names.insert(mesh.names<surfaceScalarField>());
    names.insert(mesh.names<surfaceVectorField>());
    DynamicList<word> found;
    for (const word& name : names.sortedToc())
    {
        if (isState(mesh.lookupObject<regIOobject>(name)))
        {
            found.append(name);
        }
    }
    fields_ = found;

    label solved = 0;
    for (direction d = 0; d < vector::nComponents; ++d)
    {
        solved += mesh.solutionD()[d] > 0;
    }
    describe describing{names_, layout_, volumes_, solved};
    each(describing);

    bool measured = false;
    values_.resize(layout_.size());
    forAll(values_, i)
    {
        layout_[i].name = names_[i].c_str();
        values_[i].resize(layout_[i].n);
        measured = measured || layout_[i].solved;
    }
    if (!measured)
    {
        FatalErrorInFunction
            << "The solver has no field of cells that it reads and writes: the"
            << " linear surrogate has nothing to be fitted to" << exit(FatalError);
    }
    Info<< "m4gn: the linear surrogate advances " << m4gn::join(fields_) << nl << endl;
}

std::vector<const double*> Foam::m4gnRunState::gather()
{
    copyOut copying{values_, 0};
    each(copying);

    std::vector<const double*> all;
    for (const scalarField& values : values_)
    {
        all.push_back(values.cdata());
    }
    return all;
}

std::vector<m4gn_field> Foam::m4gnRunState::measured() const
{
    std::vector<m4gn_field> fields;
    forAll(values_, i)
    {
        if (layout_[i].solved)
        {
            m4gn_field field{};
            field.name = layout_[i].name;
            field.components = layout_[i].components;
            field.cells = values_[i].cdata();
            fields.push_back(field);
        }
    }
    return fields;
}

std::vector<double*> Foam::m4gnRunState::places()
{
    std::vector<double*> all;
    for (scalarField& values : values_)
    {
        all.push_back(values.data());
    }
    return all;
}

void Foam::m4gnRunState::advance(const List<scalarField>&, const scalar duration)
{
    step(duration);
    copyIn copying{values_, 0};
    each(copying);
}

Foam::List<Foam::m4gnSolverState::quantity> Foam::m4gnRunState::quantities() const
{
    const auto* phi = mesh_.findObject<surfaceScalarField>("phi");
    if (!phi || phi->dimensions() != dimVelocity*dimArea)
    {
        return {};
    }
    return {quantity("maxDivAfter", m4gnFluxProjection::maxDiv(*phi))};
}
