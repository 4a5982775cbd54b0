// SPDX-License-Identifier: GPL-3.0-or-later
// What a case of a solid says beside its displacement: its stress, and the force on a patch.

#include "FoamData.H"

#include "IOdictionary.H"
#include "leastSquaresGrad.H"
#include "m4gnSegmentField.H"

namespace
{
enum answer
{
    present = 0,
    missing = 1,
    stale = 2,
    kinematic = 3,
    moved = 4
};

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

} // End anonymous namespace

Foam::dictionary m4gn::FoamCase::Data::solid_properties() const
{
    return Foam::IOdictionary(Foam::IOobject(
        "solidProperties", time.constant(), *mesh, Foam::IOobject::READ_IF_PRESENT, Foam::IOobject::NO_WRITE,
        false));
}

bool m4gn::FoamCase::Data::up_to_date(const Foam::word& name) const
{
    const auto marked = [&](const Foam::fileName& file) {
        return Foam::m4gn::noteOf(time, file).find(Foam::m4gn::staleNote) == 0;
    };
    // reconstructPar does not take notes over: the first processor's file says what that of the whole case does not
    return Foam::isFile(stored_time().timePath() / name) && !marked(time.timePath() / name)
           && !marked(path / "processor0" / time.timeName() / name);
}

rust::Vec<double> m4gn::FoamCase::stress(std::size_t time)
{
    data_->set_time(time);
    rust::Vec<double> result;
    if (!data_->up_to_date("sigma") || !data_->is<Foam::volSymmTensorField>("sigma")) {
        return result;
    }

    // Components off the diagonal count twice in a tensor's magnitude
    const Foam::symmTensorField& cells = data_->read(data_->symmTensors, "sigma").primitiveField();
    result.reserve(9 * cells.size());
    for (const Foam::symmTensor& cell : cells) {
        const Foam::tensor stress(cell);
        for (Foam::direction d = 0; d < 9; ++d) {
            result.push_back(stress[d]);
        }
    }
    return result;
}

rust::Vec<double> m4gn::FoamCase::reaction(rust::Str patch, std::size_t time)
{
    using Foam::tensor;
    using Foam::volSymmTensorField;
    using Foam::volTensorField;

    const Foam::label i = data_->patch(patch).index();
    rust::Vec<double> result;
    const auto without = [&](const answer why) {
        result.push_back(why);
        return std::move(result);
    };

    if (!has_field("sigma", time)) {
        return without(missing);
    }
    if (!data_->up_to_date("sigma")) {
        return without(stale);
    }
    const volSymmTensorField& sigma = data_->read(data_->symmTensors, "sigma");
    if (sigma.dimensions() == Foam::dimPressure / Foam::dimDensity) {
        return without(kinematic);
    }
    if (sigma.dimensions() != Foam::dimPressure) {
        FatalErrorInFunction << "the reaction force on a patch needs a stress sigma, dimensions "
                             << Foam::dimPressure << ", found " << sigma.dimensions() << " in " << data_->path
                             << Foam::exit(Foam::FatalError);
    }

    // Names of solids4foam; other solvers that are known have no solidProperties and small strains
    const auto model = data_->solid_properties().lookupOrDefault<Foam::word>("solidModel", Foam::word::null);
    if (contains(model, "UpdatedLag")) {
        return without(moved);
    }

    const Foam::symmTensorField& stress = sigma.boundaryField()[i];
    const Foam::vectorField& area = data_->mesh->Sf().boundaryField()[i];
    Foam::vector sum(Foam::Zero);
    if (!contains(model, "onLin")) {
        // An `empty` patch has faces and no values.
        forAll(stress, face) {
            sum += area[face] & stress[face];
        }
    } else {
        // Total Lagrangian: the mesh is the undeformed body, sigma the Cauchy stress. Areas deform by Nanson's formula.
        Foam::tensorField F(stress.size());
        if (data_->up_to_date("F") && data_->is<volTensorField>("F")) {
            F = data_->read(data_->tensors, "F").boundaryField()[i];
        } else {
            // Exact where D is linear, and no entry of fvSchemes is needed
            const Foam::tmp<volTensorField> gradient(
                Foam::fv::leastSquaresGrad<Foam::vector>(*data_->mesh)
                    .calcGrad(data_->read(data_->vectors, "D"), "grad(D)"));
            F = tensor::I + gradient().boundaryField()[i].T();
        }
        forAll(stress, face) {
            const Foam::scalar J = Foam::det(F[face]);
            if (!(J > 0)) {
                FatalErrorInFunction << "the solid is turned inside out at face " << face << " of patch "
                                     << data_->patch(patch).name() << " at time " << data_->time.timeName()
                                     << " of " << data_->path << " (its volume there is " << J
                                     << " times that at rest): expected a positive volume. The run went "
                                        "wrong there; leave that time"
                                     << " out, or compare no force" << Foam::exit(Foam::FatalError);
            }
            sum += (J * Foam::inv(F[face]).T() & area[face]) & stress[face];
        }
    }
    result.push_back(present);
    for (Foam::direction d = 0; d < 3; ++d) {
        result.push_back(sum[d]);
    }
    return result;
}
