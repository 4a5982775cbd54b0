/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnFieldFiles.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "Time.H"
#include "volFields.H"

// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::m4gnFieldFiles::~m4gnFieldFiles()
{
    for (const file& f : files_)
    {
        if (isFile(f.unfinished, false))
        {
            rm(f.unfinished);
        }
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnFieldFiles::write(const regIOobject& field)
{
    const Time& time = field.time();

    // field.write() would put it into a folder of the current time
    const fileName name
    (
        time.path()/field.instance()/field.db().dbDir()/field.name()
    );

    write
    (
        time,
        name,
        [&](Ostream& os)
        {
            field.writeHeader(os);
            field.writeData(os);
            IOobject::writeEndDivider(os);
        }
    );
}


void Foam::m4gnFieldFiles::write
(
    const Time& time,
    const fileName& name,
    const std::function<void(Ostream&)>& contents
)
{
    const fileName dir(name.path());

    if (!isDir(dir) && !mkDir(dir))
    {
        FatalErrorInFunction
            << "Cannot make the folder " << dir << exit(FatalError);
    }

    const bool compressed =
        time.writeCompression() == IOstream::COMPRESSED;
    const fileName beside(dir/('.' + name.name() + ".unfinished"));
    const fileName zipped(name + ".gz");

    files_.push_back
    ({
        compressed ? fileName(beside + ".gz") : beside,
        compressed ? zipped : name,
        compressed ? name : zipped
    });

    OFstream os
    (
        beside,
        time.writeFormat(),
        time.writeVersion(),
        time.writeCompression()
    );
    contents(os);
    os.stdStream().flush();

    if (!os.good())
    {
        FatalErrorInFunction
            << "Cannot write " << name
            << ": no permission, or the disk is full" << exit(FatalError);
    }
}


void Foam::m4gnFieldFiles::rename()
{
    for (const file& f : files_)
    {
        if (!mv(f.unfinished, f.final))
        {
            FatalErrorInFunction
                << "Cannot write " << f.final << exit(FatalError);
        }
        if (isFile(f.other, false))
        {
            rm(f.other);
        }
    }
    files_.clear();
}


// ************************************************************************* //
