// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnFieldFiles.H"
#include "m4gnVersion.H"
#include "OSspecific.H"
#include "Time.H"
#include "gzstream.h"
#include "uncollatedFileOperation.H"
#include "volFields.H"

Foam::m4gnFieldFiles::~m4gnFieldFiles()
{
    for (const file& f : files_) {
        if (isFile(f.unfinished, false)) {
            rm(f.unfinished);
        }
    }
}

void Foam::m4gnFieldFiles::write(const regIOobject& field)
{
    const Time& time = field.time();

    if (fileHandler().type() != fileOperations::uncollatedFileOperation::typeName) {
        // The ranks write together, to where such a file handler keeps files
        if (!m4gn::writeTogether(field, IOstreamOption(time.writeFormat(), time.writeCompression()))) {
            FatalErrorInFunction << "Cannot write " << field.name() << " to " << field.instance()
                                 << " with the file handler " << fileHandler().type()
                                 << ": no permission, or the disk is full" << exit(FatalError);
        }
        return;
    }

    // field.write() would put it into a folder of the current time
    const fileName name(time.path() / field.instance() / field.db().dbDir() / field.name());

    write(time, name, [&](Ostream& os) {
        field.writeHeader(os);
        field.writeData(os);
        IOobject::writeEndDivider(os);
    });
}

void Foam::m4gnFieldFiles::write(
    const Time& time, const fileName& name, const std::function<void(Ostream&)>& contents, const bool plain)
{
    const fileName dir(name.path());

    if (!isDir(dir) && !mkDir(dir)) {
        FatalErrorInFunction << "Cannot make the folder " << dir << exit(FatalError);
    }

    const bool compressed = !plain && time.writeCompression() == IOstream::COMPRESSED;
    const fileName beside(dir / ('.' + name.name() + ".unfinished"));
    const fileName zipped(name + ".gz");

    files_.push_back(
        {compressed ? fileName(beside + ".gz") : beside, compressed ? zipped : name,
         compressed ? name : zipped});

    m4gn::outputFile os(
        beside, IOstreamOption(
                    plain ? IOstream::ASCII : time.writeFormat(),
                    compressed ? IOstream::COMPRESSED : IOstream::UNCOMPRESSED));
    contents(os);

    // What OpenFOAM's own stream says is of the time before; zlib keeps the last bytes until it is closed
    std::ostream& stream = os.stdStream().flush();
    if (auto* zipping = dynamic_cast<ogzstream*>(&stream)) {
        zipping->close();
    }
    if (!stream.good()) {
        FatalErrorInFunction << "Cannot write " << name << ": no permission, or the disk is full"
                             << exit(FatalError);
    }
}

void Foam::m4gnFieldFiles::rename()
{
    for (const file& f : files_) {
        if (!mv(f.unfinished, f.final)) {
            FatalErrorInFunction << "Cannot write " << f.final << exit(FatalError);
        }
        if (isFile(f.other, false)) {
            rm(f.other);
        }
    }
    files_.clear();
}
