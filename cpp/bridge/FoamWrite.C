// SPDX-License-Identifier: GPL-3.0-or-later
// Cell fields written into the folder of the case's start time, all of them or none.

#include "FoamData.H"

#include "OSspecific.H"
#include "localIOdictionary.H"
#include "m4gnFieldFiles.H"
#include "m4gnSegmentField.H"

rust::String m4gn::FoamCase::start_note(rust::Str name) const
{
    const Foam::fileName file(
        data_->time.path() / data_->start_name() / Foam::word(std::string(name.data(), name.size())));
    return rust::String(std::string(Foam::m4gn::noteOf(data_->time, file)));
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
// The file of a field in a folder of a case of the same mesh; null: there is none of this class. A dictionary needs no libraries of boundary
// conditions.
template <class Type>
Foam::autoPtr<Foam::localIOdictionary> field_file(
    const Foam::fvMesh& mesh, const Foam::word& name, const Foam::fileName& folder)
{
    using volField = Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>;
    Foam::IOobject io(name, folder, mesh, Foam::IOobject::MUST_READ, Foam::IOobject::NO_WRITE, false);
    return Foam::autoPtr<Foam::localIOdictionary>(
        io.typeHeaderOk<volField>(true) ? new Foam::localIOdictionary(io, volField::typeName) : nullptr);
}

Foam::List<Foam::fileName> folders(const rust::Vec<rust::String>& names)
{
    Foam::List<Foam::fileName> list;
    for (const rust::String& name : names) {
        list.append(Foam::fileName(std::string(name)));
    }
    return list;
}

// What m4gn::FoamCase::take_start does of one field. Of the own file all but the cells' values stays, whatever its boundary conditions are.
template <class Type>
bool take_field(
    const Foam::fvMesh& mesh, const Foam::word& name, const Foam::fileName& own,
    const Foam::List<Foam::fileName>& sources, rust::Slice<const double> weights,
    rust::Slice<const double> ratios, Foam::m4gnFieldFiles& files)
{
    const auto dict = field_file<Type>(mesh, name, own);
    if (!dict) {
        return false;
    }
    const Foam::dimensionSet dimensions(dict->lookup("dimensions"));
    // All lengths, and the density, are the same: of a velocity the first power of the ratio, of a kinematic pressure the second
    const bool scaled = Foam::mag(dimensions[Foam::dimensionSet::MASS]) < Foam::SMALL
                        && Foam::mag(dimensions[Foam::dimensionSet::TEMPERATURE]) < Foam::SMALL;
    const Foam::scalar power = scaled ? -dimensions[Foam::dimensionSet::TIME] : 0;
    Foam::Field<Type> values(mesh.nCells(), Foam::Zero);
    Foam::scalar least = Foam::GREAT;
    forAll(sources, i) {
        const auto from = field_file<Type>(mesh, name, sources[i]);
        if (!from) {
            return false;
        }
        const Foam::dimensionSet found(from->lookup("dimensions"));
        if (dimensions != found) {
            FatalErrorInFunction << name << " has the dimensions " << dimensions << " in "
                                 << dict->objectPath() << " and " << found << " in " << from->objectPath()
                                 << Foam::exit(Foam::FatalError);
        }
        const Foam::Field<Type> part(
            std::pow(ratios[i], power) * Foam::Field<Type>("internalField", *from, mesh.nCells()));
        values += weights[i] * part;
        least = Foam::min(least, Foam::cmptMin(Foam::min(part)));
    }
    // What is nowhere negative may not become so, as k and concentrations
    if (least >= 0) {
        values = Foam::max(values, least * Foam::pTraits<Type>::one);
    }

    files.write(mesh.time(), dict->objectPath(), [&](Foam::Ostream& os) {
        dict->writeHeader(os, Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>::typeName);
        for (const Foam::entry& e : *dict) {
            if (e.keyword() == "internalField") {
                values.writeEntry(e.keyword(), os);
            } else {
                os << e;
            }
        }
        Foam::IOobject::writeEndDivider(os);
    });
    return true;
}

} // End anonymous namespace

std::size_t m4gn::FoamCase::take_start(
    const rust::Vec<rust::String>& sources, rust::Slice<const double> weights,
    rust::Slice<const double> ratios) const
{
    const Foam::List<Foam::fileName> from(folders(sources));
    const Foam::fileName own(data_->start_name());
    Foam::m4gnFieldFiles files;
    std::size_t taken = 0;
    for (const Foam::fileName& file : Foam::readDir(data_->time.path() / own, Foam::fileName::FILE)) {
        const auto take = [&](auto zero) {
            return take_field<decltype(zero)>(
                *data_->mesh, Foam::word(file), own, from, weights, ratios, files);
        };
        taken += take(Foam::scalar()) || take(Foam::vector()) || take(Foam::symmTensor());
    }
    files.rename();
    return taken;
}

rust::Vec<double> m4gn::FoamCase::products(const rust::Vec<rust::String>& names) const
{
    const Foam::fvMesh& mesh = *data_->mesh;
    const Foam::List<Foam::fileName> from(folders(names));
    std::vector<double> sums(from.size() * from.size(), 0);
    const Foam::fileName own(data_->start_name());
    for (const Foam::fileName& name : Foam::readDir(data_->time.path() / own, Foam::fileName::FILE)) {
        // Of the others no file is opened in any folder
        if (!field_file<Foam::vector>(mesh, Foam::word(name), own)) {
            continue;
        }
        Foam::PtrList<Foam::vectorField> all(from.size());
        forAll(from, i) {
            if (const auto dict = field_file<Foam::vector>(mesh, Foam::word(name), from[i])) {
                all.set(i, new Foam::vectorField("internalField", *dict, mesh.nCells()));
            }
        }
        forAll(from, i) {
            for (Foam::label j = 0; j <= i && all.set(i); ++j) {
                if (all.set(j)) {
                    sums[i * from.size() + j] += Foam::sum(mesh.V().field() * (all[i] & all[j]));
                    sums[j * from.size() + i] = sums[i * from.size() + j];
                }
            }
        }
    }
    return numbers(sums);
}
