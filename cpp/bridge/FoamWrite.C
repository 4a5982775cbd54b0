// SPDX-License-Identifier: GPL-3.0-or-later
// Cell fields written into the folder of the case's start time, all of them or none.

#include "FoamData.H"

#include "IFstream.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "localIOdictionary.H"
#include "m4gnFieldFiles.H"
#include "m4gnSegmentField.H"

rust::String m4gn::FoamCase::start_note(rust::Str name) const
{
    Foam::IOobject io(
        std::string(name.data(), name.size()), data_->start_name(), *data_->mesh,
        Foam::IOobject::READ_IF_PRESENT, Foam::IOobject::NO_WRITE, false);
    const Foam::fileName file(data_->time.path() / io.instance() / io.name());
    if (!Foam::isFile(file)) {
        return "";
    }
    // A file without a header, or without a note in it, is somebody's.
    Foam::IFstream is(file);
    const bool read = io.readHeader(is);
    return read && io.note().size() ? rust::String(std::string(io.note())) : rust::String("unknown");
}

void m4gn::FoamCase::remove_start_field(rust::Str name) const
{
    const Foam::fileName file(
        data_->time.path() / data_->start_name() / Foam::word(std::string(name.data(), name.size())));
    for (const Foam::fileName& f : {file, Foam::fileName(file + ".gz")}) {
        if (Foam::isFile(f, false)) {
            Foam::rm(f);
        }
    }
}

void m4gn::FoamCase::write_start_fields(
    const rust::Vec<rust::String>& names, rust::Str note, rust::Slice<const double> values,
    rust::Str segment_record) const
{
    const Foam::fvMesh& mesh = *data_->mesh;
    const std::size_t n = mesh.nCells();
    if (values.size() != n * names.size()) {
        FatalErrorInFunction << Foam::label(names.size()) << " fields of " << mesh.nCells()
                             << " cells: found " << Foam::label(values.size()) << " values"
                             << Foam::exit(Foam::FatalError);
    }
    Foam::m4gnFieldFiles files;
    for (std::size_t i = 0; i < names.size(); ++i) {
        Foam::tmp<Foam::volScalarField> tfield(Foam::m4gn::cellField<Foam::scalar>(
            mesh, Foam::word(std::string(names[i])), data_->start_name()));
        Foam::volScalarField& field = tfield.ref();
        field.note() = std::string(note.data(), note.size());
        for (std::size_t cell = 0; cell < n; ++cell) {
            field[cell] = values[i * n + cell];
        }
        field.correctBoundaryConditions();
        files.write(field);
    }
    if (!segment_record.empty()) {
        Foam::m4gn::writeSegmentRecord(
            files, data_->time, data_->time.path() / data_->start_name() / mesh.dbDir(),
            std::string(segment_record.data(), segment_record.size()));
    }
    files.rename();
}

namespace
{
// Takes the cells' values of a field from a folder of another case of the same mesh, as m4gn::FoamCase::take_start. Of the own file all but
// these stays, whatever its boundary conditions are: a dictionary needs none of their libraries.
template <class Type>
bool take_field(
    const Foam::fvMesh& mesh, const Foam::word& name, const Foam::fileName& own, const Foam::fileName& source,
    double ratio)
{
    using volField = Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>;
    const auto at = [&](const Foam::fileName& folder) {
        return Foam::IOobject(name, folder, mesh, Foam::IOobject::MUST_READ, Foam::IOobject::NO_WRITE, false);
    };
    Foam::IOobject target(at(own)), other(at(source));
    if (!target.typeHeaderOk<volField>(true) || !other.typeHeaderOk<volField>(true)) {
        return false;
    }

    const Foam::localIOdictionary dict(target, volField::typeName), from(other, volField::typeName);
    const Foam::dimensionSet dimensions(dict.lookup("dimensions")), found(from.lookup("dimensions"));
    if (dimensions != found) {
        FatalErrorInFunction << name << " has the dimensions " << dimensions << " in " << target.objectPath()
                             << " and " << found << " in " << other.objectPath()
                             << Foam::exit(Foam::FatalError);
    }
    Foam::Field<Type> values("internalField", from, mesh.nCells());
    // All lengths, and the density, are the same: of a velocity the first power of the ratio, of a kinematic pressure the second
    if (Foam::mag(dimensions[Foam::dimensionSet::MASS]) < Foam::SMALL
        && Foam::mag(dimensions[Foam::dimensionSet::TEMPERATURE]) < Foam::SMALL)
    {
        values *= std::pow(ratio, -dimensions[Foam::dimensionSet::TIME]);
    }

    Foam::OFstream os(target.objectPath(), mesh.time().writeFormat());
    dict.writeHeader(os, volField::typeName);
    for (const Foam::entry& e : dict) {
        if (e.keyword() == "internalField") {
            values.writeEntry(e.keyword(), os);
        } else {
            os << e;
        }
    }
    Foam::IOobject::writeEndDivider(os);
    if (!os.good()) {
        FatalErrorInFunction << target.objectPath() << " cannot be written" << Foam::exit(Foam::FatalError);
    }
    Foam::rm(target.objectPath() + ".gz");
    return true;
}

} // End anonymous namespace

std::size_t m4gn::FoamCase::take_start(rust::Str source, double ratio) const
{
    const Foam::fileName folder(std::string(source.data(), source.size())), own(data_->start_name());
    std::size_t taken = 0;
    for (const Foam::fileName& file : Foam::readDir(data_->time.path() / own, Foam::fileName::FILE)) {
        const auto take = [&](auto zero) {
            return take_field<decltype(zero)>(*data_->mesh, Foam::word(file), own, folder, ratio);
        };
        taken += take(Foam::scalar()) || take(Foam::vector()) || take(Foam::symmTensor());
    }
    return taken;
}
