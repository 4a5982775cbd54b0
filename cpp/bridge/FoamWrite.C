// SPDX-License-Identifier: GPL-3.0-or-later
// Cell fields written into the folder of the case's start time, all of them or none.

#include "FoamData.H"

#include "IFstream.H"
#include "OSspecific.H"
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
