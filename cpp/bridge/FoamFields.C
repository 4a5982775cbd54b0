// SPDX-License-Identifier: GPL-3.0-or-later
// Fields of a case at a time, and what follows from them on a patch.

#include "FoamData.H"
#include "m4gnVersion.H"

#include "gaussGrad.H"

namespace
{
Foam::word field_name(rust::Str name) { return Foam::word(std::string(name.data(), name.size())); }

Foam::IOobject header(const Foam::word& name, const Foam::Time& time, const Foam::objectRegistry& mesh)
{
    return Foam::IOobject(
        name, time.timeName(), mesh, Foam::IOobject::MUST_READ, Foam::IOobject::NO_WRITE, false);
}

} // End anonymous namespace

template <class Field> bool m4gn::FoamCase::Data::is(const Foam::word& name) const
{
    const bool distributed = databases.size();
    const Foam::objectRegistry& registry = distributed ? processors->meshes()[0].thisDb() : mesh->thisDb();
    return header(name, stored_time(), registry).typeHeaderOk<Field>(true);
}

template <class Field> const Field& m4gn::FoamCase::Data::read(Known<Field>& known, const Foam::word& name)
{
    const auto found = known.find(name);
    if (found != known.end()) {
        return *found->second;
    }

    const bool distributed = databases.size();
    if (!is<Field>(name)) {
        FatalErrorInFunction << "expected a " << Field::typeName << " in " << stored_time().timePath() / name
                             << ", found no such file or a file of another class"
                             << Foam::exit(Foam::FatalError);
    }
    const Foam::IOobject io(header(name, time, *mesh));
    std::unique_ptr<const Field> field(
        distributed ? new Field(Foam::m4gn::reconstruct<typename Field::value_type>(*reconstructor, io))
                    : new Field(io, *mesh));
    return *(known[name] = std::move(field));
}

// FoamSolids.C asks for these too.
template const Foam::volVectorField& m4gn::FoamCase::Data::read(
    Known<Foam::volVectorField>&, const Foam::word&);
template const Foam::volSymmTensorField& m4gn::FoamCase::Data::read(
    Known<Foam::volSymmTensorField>&, const Foam::word&);
template const Foam::volTensorField& m4gn::FoamCase::Data::read(
    Known<Foam::volTensorField>&, const Foam::word&);
template bool m4gn::FoamCase::Data::is<Foam::volSymmTensorField>(const Foam::word&) const;
template bool m4gn::FoamCase::Data::is<Foam::volTensorField>(const Foam::word&) const;

bool m4gn::FoamCase::has_field(rust::Str name, std::size_t time)
{
    data_->set_time(time);
    return Foam::isFile(data_->stored_time().timePath() / field_name(name));
}

rust::Vec<double> m4gn::FoamCase::scalar_field(rust::Str name, std::size_t time)
{
    data_->set_time(time);
    return numbers(data_->read(data_->scalars, field_name(name)).primitiveField());
}

rust::Vec<double> m4gn::FoamCase::vector_field(rust::Str name, std::size_t time)
{
    data_->set_time(time);
    return flat(data_->read(data_->vectors, field_name(name)).primitiveField());
}

rust::Vec<double> m4gn::FoamCase::force(rust::Str patch, std::size_t time)
{
    const Foam::label i = data_->patch(patch).index();
    data_->set_time(time);
    const Foam::volScalarField& p = data_->read(data_->scalars, "p");
    const Foam::volVectorField& U = data_->read(data_->vectors, "U");
    if (p.dimensions() != Foam::dimPressure / Foam::dimDensity) {
        FatalErrorInFunction
            << "the force on a patch needs the kinematic pressure p of an incompressible solver, dimensions "
            << (Foam::dimPressure / Foam::dimDensity) << ", found " << p.dimensions() << " in " << data_->path
            << Foam::exit(Foam::FatalError);
    }
    const Foam::IOdictionary transport(Foam::IOobject(
        "transportProperties", data_->time.constant(), *data_->mesh, Foam::IOobject::MUST_READ,
        Foam::IOobject::NO_WRITE, false));
    // The solver stores that of a fluid that is not Newtonian
    const bool stored = transport.lookupOrDefault<Foam::word>("transportModel", "Newtonian") != "Newtonian";

    // The scheme's own gradient: no entry of fvSchemes is needed, and boundary gradients are corrected.
    const Foam::tmp<Foam::volTensorField> gradient(
        Foam::fv::gaussGrad<Foam::vector>(*data_->mesh).calcGrad(U, "grad(U)"));
    const Foam::tensorField& gradU = gradient().boundaryField()[i];
    const Foam::scalarField& pressure = p.boundaryField()[i];
    const Foam::vectorField& area = data_->mesh->Sf().boundaryField()[i];
    Foam::scalarField viscosity(area.size(), Foam::Zero);
    if (stored) {
        viscosity = data_->read(data_->scalars, "nu").boundaryField()[i];
    } else {
        viscosity = Foam::dimensionedScalar("nu", Foam::dimViscosity, transport).value();
    }
    if (data_->is<Foam::volScalarField>("nut")) {
        viscosity += data_->read(data_->scalars, "nut").boundaryField()[i];
    }

    // Sf points out of the fluid, into the body.
    Foam::vectorField sums(2, Foam::Zero);
    forAll(area, face) {
        sums[0] += pressure[face] * area[face];
        sums[1] -= viscosity[face] * (area[face] & Foam::dev(Foam::twoSymm(gradU[face])));
    }
    return flat(sums);
}

rust::Vec<double> m4gn::FoamCase::flow(rust::Str patch, std::size_t time)
{
    const Foam::label i = data_->patch(patch).index();
    data_->set_time(time);
    const Foam::vectorField& U = data_->read(data_->vectors, "U").boundaryField()[i];
    const Foam::vectorField& area = data_->mesh->Sf().boundaryField()[i];
    std::vector<double> sums(5, 0);
    // An `empty` patch has faces and no values.
    forAll(U, face) {
        sums[0] += U[face] & area[face];
        sums[1] += Foam::mag(area[face]);
        for (Foam::direction d = 0; d < 3; ++d) {
            sums[2 + d] += U[face][d] * Foam::mag(area[face]);
        }
    }
    return numbers(sums);
}
