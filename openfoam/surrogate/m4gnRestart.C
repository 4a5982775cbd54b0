// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRestart.H"
#include "localIOdictionary.H"
#include "m4gnFieldFiles.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "SHA1.H"
#include "Time.H"
#include <fstream>

namespace
{
Foam::IOobject object
(
    const Foam::word& name,
    const Foam::Time& time,
    const Foam::IOobject::readOption read
)
{
    return Foam::IOobject
    (
        name + ".state",
        time.timeName()/"uniform",
        time,
        read,
        Foam::IOobject::NO_WRITE,
        false
    );
}

//- A dictionary that is written as it comes: entries of Foam::dictionary
//  would lose the last digits of their numbers
class file
:
    public Foam::regIOobject
{
    const Foam::word type_;

    const std::function<void(Foam::Ostream&)>& entries_;

public:
    file(const Foam::IOobject& io, const std::function<void(Foam::Ostream&)>& entries)
    :
        Foam::regIOobject(io),
        type_(Foam::localIOdictionary::typeName),
        entries_(entries)
    {}

    virtual const Foam::word& type() const
    {
        return type_;
    }

    virtual bool writeData(Foam::Ostream& os) const
    {
        // Enough for a double
        const int before = os.precision(17);
        entries_(os);
        os.precision(before);
        return os.good();
    }
};

} // End anonymous namespace

void Foam::m4gnRestart::write
(
    const word& name,
    const Time& time,
    const std::function<void(Ostream&)>& entries
)
{
    const auto together = []() { returnReduce(true, andOp<bool>()); };

    m4gnFieldFiles files;
    files.write(file(object(name, time, IOobject::NO_READ), entries));

    if (!Pstream::master())
    {
        files.rename();
    }
    together();
    files.rename();
    together();
}

Foam::dictionary Foam::m4gnRestart::read(const word& name, const Time& time)
{
    IOobject io(object(name, time, IOobject::MUST_READ));

    // Together, for the sake of file handlers
    bool found = io.typeHeaderOk<localIOdictionary>(true);
    reduce(found, andOp<bool>());

    const fileName damaged(time.path()/io.instance()/io.name());
    if (!found && isFile(damaged))
    {
        FatalErrorInFunction
            << damaged << " is not the state of a run, or another rank has"
            << " none: it is damaged" << nl
            << "    Start from an earlier time, or remove it: the schedule of "
            << name << " then begins anew" << exit(FatalError);
    }

    return found ? dictionary(localIOdictionary(io)) : dictionary();
}

Foam::word Foam::m4gnRestart::last(const word& name, const Time& time)
{
    word found;
    for (const instant& at : time.times())
    {
        if (at.value() < time.value() && isFile(time.path()/at.name()/"uniform"/(name + ".state")))
        {
            found = at.name();
        }
    }
    Pstream::scatter(found);

    return found;
}

Foam::word Foam::m4gnRestart::digest(const fileName& file)
{
    string text;
    if (Pstream::master())
    {
        std::ifstream stream(file, std::ios::binary);
        const std::string bytes
        (
            (std::istreambuf_iterator<char>(stream)),
            std::istreambuf_iterator<char>()
        );
        text = SHA1(bytes).digest().str(true);
    }
    Pstream::scatter(text);
    return word(text, false);
}
