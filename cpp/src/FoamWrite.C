// SPDX-License-Identifier: GPL-3.0-or-later
// Cell fields written into the folder of the case's start time, all of them or none.

#include "FoamData.H"

#include "IFstream.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "zeroGradientFvPatchFields.H"

#include <vector>

namespace
{

//- Files written beside their final names; what was not renamed is removed
class Pending
{
    struct File
    {
        Foam::fileName from, to, other;
    };

    std::vector<File> files_;

public:

    ~Pending()
    {
        for (const File& file : files_)
        {
            if (Foam::isFile(file.from, false)) { Foam::rm(file.from); }
        }
    }

    void add(const Foam::fileName& from, const Foam::fileName& to, const bool compressed)
    {
        if (compressed) { files_.push_back({from + ".gz", to + ".gz", to}); }
        else { files_.push_back({from, to, to + ".gz"}); }
    }

    void rename()
    {
        for (const File& file : files_)
        {
            if (!Foam::mv(file.from, file.to))
            {
                FatalErrorInFunction << "cannot write " << file.to << Foam::exit(Foam::FatalError);
            }
            // OpenFOAM would read the uncompressed one of two.
            if (Foam::isFile(file.other, false)) { Foam::rm(file.other); }
        }
    }
};

} // End anonymous namespace


Foam::IOobject m4gn::FoamCase::Data::start_io(const Foam::word& name) const
{
    return Foam::IOobject
    (
        name, start_name(), *mesh, Foam::IOobject::READ_IF_PRESENT, Foam::IOobject::NO_WRITE, false
    );
}


rust::String m4gn::FoamCase::start_note(rust::Str name) const
{
    Foam::IOobject io(data_->start_io(std::string(name.data(), name.size())));
    const Foam::fileName file(data_->time.path()/io.instance()/io.name());
    if (!Foam::isFile(file)) { return ""; }
    // A file without a header, or without a note in it, is somebody's.
    Foam::IFstream is(file);
    const bool read = io.readHeader(is);
    return read && io.note().size() ? rust::String(std::string(io.note())) : rust::String("unknown");
}


void m4gn::FoamCase::remove_start_field(rust::Str name) const
{
    const Foam::fileName file(data_->time.path()/data_->start_name()/Foam::word(std::string(name.data(), name.size())));
    for (const Foam::fileName& f : {file, Foam::fileName(file + ".gz")})
    {
        if (Foam::isFile(f, false)) { Foam::rm(f); }
    }
}


void m4gn::FoamCase::write_start_fields
(
    const rust::Vec<rust::String>& names,
    rust::Str note,
    rust::Slice<const double> values
) const
{
    const Foam::fvMesh& mesh = *data_->mesh;
    const Foam::Time& time = data_->time;
    const std::size_t n = mesh.nCells();
    if (values.size() != n*names.size())
    {
        FatalErrorInFunction
            << Foam::label(names.size()) << " fields of " << mesh.nCells() << " cells: found "
            << Foam::label(values.size()) << " values" << Foam::exit(Foam::FatalError);
    }
    const Foam::fileName dir(time.path()/data_->start_name());
    if (!Foam::isDir(dir) && !Foam::mkDir(dir))
    {
        FatalErrorInFunction << "cannot make the folder " << dir << Foam::exit(Foam::FatalError);
    }
    const bool compressed = time.writeCompression() == Foam::IOstream::COMPRESSED;
    Pending pending;
    for (std::size_t i = 0; i < names.size(); ++i)
    {
        Foam::IOobject io(data_->start_io(Foam::word(std::string(names[i]))));
        io.readOpt() = Foam::IOobject::NO_READ;
        io.note() = std::string(note.data(), note.size());
        Foam::volScalarField field
        (
            io,
            mesh,
            Foam::dimensionedScalar(Foam::dimless, Foam::Zero),
            Foam::zeroGradientFvPatchScalarField::typeName
        );
        for (std::size_t cell = 0; cell < n; ++cell) { field[cell] = values[i*n + cell]; }
        field.correctBoundaryConditions();

        const Foam::fileName unfinished(dir/("." + io.name() + ".unfinished"));
        pending.add(unfinished, dir/io.name(), compressed);
        Foam::OFstream os(unfinished, time.writeFormat(), time.writeVersion(), time.writeCompression());
        field.writeHeader(os);
        field.writeData(os);
        Foam::IOobject::writeEndDivider(os);
        os.stdStream().flush();
        if (!os.good())
        {
            FatalErrorInFunction
                << "cannot write " << dir/io.name() << ": no permission, or the disk is full"
                << Foam::exit(Foam::FatalError);
        }
    }
    pending.rename();
}
