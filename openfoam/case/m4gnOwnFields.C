// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnOwnFields.H"
#include "m4gnLastStep.H"
#include "calculatedFvPatchFields.H"
#include "surfaceFields.H"
#include "Time.H"
#include "volFields.H"
#include "zeroGradientFvPatchFields.H"

namespace
{
using namespace Foam;

const word sizeName("cellSize");
const word stepName("deltaT");
const word viscosityName("nu");

//- In the header's notes: whose field it is, and whether deltaT keeps its value
const char* const rateMark = "rate of change, by m4gn";
const char* const sizeMark = "mean distance of neighbouring cells, by m4gn";
const char* const stepMark = "the solver's time step, by m4gn";
const char* const stepKept = "the solver's time step, by m4gn, held";
const char* const viscosityMark = "viscosity of transportProperties, by m4gn";

//- Patches of this type
wordList patches(const fvMesh& mesh, const word& type) { return wordList(mesh.boundary().size(), type); }

//- The field of this name, made with zeros if there is none. Null: it is not to
//  be changed, since its note is not the mark (it is somebody else's) or, once
//  a time, since it is that of this time.
template <class Type>
GeometricField<Type, fvPatchField, volMesh>* own(
    const fvMesh& mesh, const word& name, const dimensionSet& dimensions, const char* const mark,
    const wordList& patchTypes, const bool onceATime = false)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    auto* field = mesh.getObjectPtr<fieldType>(name);
    if (!field) {
        field = new fieldType(
            IOobject(name, mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE), mesh,
            dimensioned<Type>(name, dimensions, Zero), patchTypes);
        field->note() = mark;
        mesh.objectRegistry::store(field);
    } else if (onceATime && field->timeIndex() == mesh.time().timeIndex()) {
        return nullptr;
    }
    if (field->note() != mark) {
        return nullptr;
    }
    field->timeIndex() = mesh.time().timeIndex();
    return field;
}

//- A number as a field
void provideNumber(const fvMesh& mesh, const dimensionedScalar& value, const char* const mark)
{
    const wordList types(patches(mesh, zeroGradientFvPatchScalarField::typeName));
    if (auto* field = own<scalar>(mesh, value.name(), value.dimensions(), mark, types)) {
        *field == value;
    }
}

void provideViscosity(const fvMesh& mesh)
{
    const auto* properties = mesh.findObject<dictionary>("transportProperties");
    if (properties && properties->found(viscosityName)) {
        provideNumber(mesh, dimensionedScalar(viscosityName, dimViscosity, *properties), viscosityMark);
    }
}

void provideTimeStep(const fvMesh& mesh)
{
    provideNumber(mesh, dimensionedScalar(stepName, dimTime, mesh.time().deltaTValue()), stepMark);
}

//- It stays while the mesh does
void provideSize(const fvMesh& mesh)
{
    if (mesh.foundObject<volScalarField>(sizeName) && !mesh.changing()) {
        return;
    }
    const wordList types(patches(mesh, zeroGradientFvPatchScalarField::typeName));
    volScalarField* field = own<scalar>(mesh, sizeName, dimLength, sizeMark, types);
    if (!field) {
        return;
    }

    scalarField sum(mesh.nCells(), Zero);
    labelList n(mesh.nCells(), Zero);
    const auto add = [&](const label celli, const scalar distance) {
        sum[celli] += distance;
        ++n[celli];
    };
    const surfaceScalarField distance(mag(mesh.delta()));

    forAll(mesh.neighbour(), facei) {
        add(mesh.owner()[facei], distance[facei]);
        add(mesh.neighbour()[facei], distance[facei]);
    }
    for (const fvsPatchScalarField& patch : distance.boundaryField()) {
        if (patch.coupled()) {
            forAll(patch, facei) {
                add(patch.patch().faceCells()[facei], patch[facei]);
            }
        }
    }
    forAll(sum, celli) {
        field->primitiveFieldRef()[celli] = sum[celli] / max(n[celli], 1);
    }
    field->correctBoundaryConditions();
}

//- False: no field of this type has that name
template <class Type> bool provideRate(const fvMesh& mesh, const word& name, const word& rateName)
{
    const auto* field = mesh.findObject<GeometricField<Type, fvPatchField, volMesh>>(name);
    if (!field) {
        return false;
    }

    // OpenFOAM would take the present values for those before, whose rate is zero
    const Time& time = mesh.time();
    if (functionObject::postProcess && !field->nOldTimes() && time.value() > 0) {
        FatalErrorInFunction << rateName << " of time " << time.timeName() << " needs the level before, "
                             << name << "_0, which the solver has not stored there" << nl
                             << "    Record while the solver runs" << exit(FatalError);
    }

    wordList types(patches(mesh, zeroGradientFvPatchField<Type>::typeName));
    forAll(types, patchi) {
        const fvPatchField<Type>& patch = field->boundaryField()[patchi];
        if (patch.patch().coupled() || patch.type() == "empty") {
            types[patchi] = patch.type();
        } else if (patch.fixesValue()) {
            types[patchi] = calculatedFvPatchField<Type>::typeName;
        }
    }
    auto* rate = own<Type>(mesh, rateName, field->dimensions() / dimTime, rateMark, types, true);
    if (!rate) {
        return true;
    }

    // Of stored times the one that is stored
    const scalar rDeltaT = 1 / (functionObject::postProcess ? time.deltaTValue() : m4gnLastStep::of(time));
    const auto& old = field->oldTime();
    rate->primitiveFieldRef() = rDeltaT * (field->primitiveField() - old.primitiveField());
    auto& boundary = rate->boundaryFieldRef();
    forAll(boundary, patchi) {
        boundary[patchi] == rDeltaT*(field->boundaryField()[patchi] - old.boundaryField()[patchi]);
    }
    rate->correctBoundaryConditions();
    return true;
}

} // End anonymous namespace

Foam::word Foam::m4gnOwnFields::rateOf(const word& name) { return "ddt(" + name + ')'; }

void Foam::m4gnOwnFields::provide(const fvMesh& mesh, const word& name)
{
    if (name == sizeName) {
        provideSize(mesh);
    } else if (name == stepName) {
        provideTimeStep(mesh);
    } else if (name == viscosityName) {
        provideViscosity(mesh);
    } else if (name.starts_with("ddt(") && name.ends_with(")")) {
        const word of(name.substr(4, name.size() - 5), false);
        if (!provideRate<vector>(mesh, of, name)) {
            provideRate<scalar>(mesh, of, name);
        }
    }
}

Foam::m4gnOwnFields::heldTimeStep::heldTimeStep(const fvMesh& mesh, const wordList& inputs) : field_(nullptr)
{
    if (inputs.found(stepName)) {
        provideTimeStep(mesh);
        field_ = mesh.getObjectPtr<volScalarField>(stepName);
        if (field_ && field_->note() != stepMark) {
            field_ = nullptr;
        }
    }
    if (field_) {
        field_->note() = stepKept;
    }
}

Foam::m4gnOwnFields::heldTimeStep::~heldTimeStep()
{
    if (field_) {
        field_->note() = stepMark;
    }
}
