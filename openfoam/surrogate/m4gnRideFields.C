// SPDX-License-Identifier: GPL-3.0-or-later

// What the ride is told of the run's fields, and the fields of its errors

#include "m4gnRide.H"
#include "directionMixedFvPatchFields.H"
#include "m4gnExplicitStress.H"
#include "m4gnSegmentField.H"
#include "m4gnVersion.H"
#include "mixedFvPatchFields.H"
#include "SolverPerformance.H"
#include <algorithm>

namespace
{
using namespace Foam;

//- Which faces hold a field's value; where they let go, a face has its cell's
template <class Type>
void mark(
    const GeometricField<Type, fvPatchField, volMesh>& field, const m4gnNodes& nodes, List<int32_t>& held)
{
    held.resize(nodes.nBoundary());
    label nodei = 0;

    for (const label patchi : nodes.valuePatches()) {
        const fvPatchField<Type>& patch = field.boundaryField()[patchi];
        const auto* mixed = dynamic_cast<const mixedFvPatchField<Type>*>(&patch);
        const auto* directionMixed = dynamic_cast<const directionMixedFvPatchField<Type>*>(&patch);

        forAll(patch, facei) {
            held[nodei++] = mixed            ? mixed->valueFraction()[facei] > 0.5
                            : directionMixed ? tr(directionMixed->valueFraction()[facei]) > 0.5
                                             : patch.fixesValue();
        }
    }
}

} // End anonymous namespace

Foam::label Foam::m4gnRide::correctors() const
{
    if (!m4gnExplicitStress::registered(mesh_)) {
        return -1;
    }

    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(dict_.getOrDefault<word>("D", "D"), solves);

    return solves.size() ? solves.size() : -1;
}

std::vector<m4gn_field> Foam::m4gnRide::gather(const bool network, const bool dmd)
{
    std::vector<m4gn_field> fields;

    if (network && session_) {
        fields_.gather(session_->nodes());
        fields = fields_.view();
    }
    if (dmd && run_) {
        if (!gathered_) {
            run_->gather();
        }
        gathered_ = true;
        for (const m4gn_field& field : run_->measured()) {
            const auto same = [&](const m4gn_field& f) { return std::string(f.name) == field.name; };
            if (std::none_of(fields.begin(), fields.end(), same)) {
                fields.push_back(field);
            }
        }
    }
    return fields;
}

std::vector<m4gn_field> Foam::m4gnRide::advances(const word& kind) const
{
    if (kind == "dmd") {
        return run_->measured();
    }
    std::vector<m4gn_field> all(session_->outputs().size());
    forAll(session_->outputs(), i) {
        all[i].name = session_->outputs()[i].c_str();
        all[i].components = session_->outputComponents(i);
    }
    return all;
}

std::vector<const int32_t*> Foam::m4gnRide::held(const bool wanted)
{
    std::vector<const int32_t*> marks;

    if (!wanted || !observes_ || !session_) {
        return marks;
    }

    held_.resize(fields_.size());
    // Of the fields of a dmd surrogate alone none is asked for
    marks.resize(fields_.size() + (run_ ? run_->measured().size() : 0), nullptr);
    for (label fieldi = 0; fieldi < fields_.size(); ++fieldi) {
        const word& name = fields_.name(fieldi);
        if (!session_->outputs().found(name)) {
            continue;
        }
        if (fields_.components(fieldi) == 1) {
            mark(mesh_.lookupObject<volScalarField>(name), session_->nodes(), held_[fieldi]);
        } else {
            mark(mesh_.lookupObject<volVectorField>(name), session_->nodes(), held_[fieldi]);
        }
        marks[fieldi] = held_[fieldi].cdata();
    }
    return marks;
}

template <class Type>
void Foam::m4gnRide::writeError(const label surrogatei, const label fieldi, const word& name) const
{
    const word of(kinds_.size() > 1 ? word(kinds_[surrogatei] + ':' + name, false) : name);
    tmp<GeometricField<Type, fvPatchField, volMesh>> tfield(
        m4gn::cellField<Type>(mesh_, "error(" + of + ')', mesh_.time().timeName()));
    auto& field = tfield.ref();

    auto* cells = reinterpret_cast<scalar*>(field.primitiveFieldRef().data());
    if (m4gn_ride_difference(ride_, surrogatei, fieldi, cells) != M4GN_OK) {
        // None has been compared yet
        return;
    }
    field.correctBoundaryConditions();
    field.dimensions().reset(
        mesh_.lookupObject<GeometricField<Type, fvPatchField, volMesh>>(name).dimensions());
    field.note() = "m4gn: the surrogate's " + name + " at time "
                   + std::string(m4gn_ride_text(ride_, M4GN_RIDE_DIFFERENCE_TIME)) + " minus the solver's";
    field.write();
}

void Foam::m4gnRide::writeErrors() const
{
    // Those of points are no fields of cells
    const bool wanted = dict_.getOrDefault<bool>("writeErrors", false) && !(run_ && run_->atPoints());
    if (!observes_ || !mesh_.time().writeTime() || !wanted) {
        return;
    }

    forAll(kinds_, surrogatei) {
        label fieldi = 0;
        for (const m4gn_field& field : advances(kinds_[surrogatei])) {
            if (field.components == 1) {
                writeError<scalar>(surrogatei, fieldi, field.name);
            } else {
                writeError<vector>(surrogatei, fieldi, field.name);
            }
            ++fieldi;
        }
    }
}
