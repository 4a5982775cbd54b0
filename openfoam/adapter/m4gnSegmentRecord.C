// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegmentRecord.H"
#include "IFstream.H"
#include "IOobject.H"
#include "OSspecific.H"
#include "Time.H"
#include "dictionary.H"

static const char* const recordName = "m4gnSegmentDict";

Foam::string Foam::m4gn::readSegmentRecord(const fileNameList& folders)
{
    for (const fileName& folder : folders)
    {
        const fileName file(folder/recordName);

        if (isFile(file))
        {
            IFstream is(file);
            const dictionary dict(is);

            const string record(dict.getOrDefault<string>("record", "none"));

            // Line breaks are for people
            return string(record).replaceAll("\n", " ");
        }
    }

    return string();
}

void Foam::m4gn::writeSegmentRecord
(
    m4gnFieldFiles& files,
    const Time& time,
    const fileName& folder,
    const std::string& record
)
{
    files.write
    (
        time,
        folder/recordName,
        [&](Ostream& os)
        {
            os  << "// How m4gnSegment was made (m4gn); a run compares it with"
                << " what its model wants" << nl
                << "FoamFile" << nl << '{' << nl
                << "    version     2.0;" << nl
                << "    format      ascii;" << nl
                << "    class       dictionary;" << nl
                << "    object      m4gnSegmentDict;" << nl << '}' << nl << nl;
            os.writeQuoted("record #{" + record + "#};\n", false);
        },
        true
    );
}

Foam::string Foam::m4gn::noteOf(const Time& time, const fileName& file)
{
    // Compressed files too
    if (!isFile(file))
    {
        return string();
    }

    IFstream is(file);
    IOobject io(file.name(), time.constant(), time);
    const bool read = io.readHeader(is);

    return read && io.note().size() ? string(io.note()) : string("unknown");
}
