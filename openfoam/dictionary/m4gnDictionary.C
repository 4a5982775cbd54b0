/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnDictionary.H"
#include "HashSet.H"
#include "StringStream.H"
#include "token.H"

// * * * * * * * * * * * * * * * * Functions * * * * * * * * * * * * * * * * //

const Foam::wordList& Foam::m4gn::commonKeys()
{
    static const wordList keys
    ({
        "type", "libs", "functionObjectLibs", "enabled", "log", "region",
        "subRegion", "errors", "timeStart", "timeEnd", "executeControl",
        "executeInterval", "writeControl", "writeInterval", "outputControl",
        "outputInterval", "triggerStart", "triggerEnd", "controlMode",
        "deltaTCoeff", "nStepsToStartTimeChange", "useNamePrefix"
    });

    return keys;
}


void Foam::m4gn::checkKeys
(
    const dictionary& dict,
    const wordList& valid,
    const bool withCommon
)
{
    wordHashSet known(valid);

    if (withCommon)
    {
        known.insert(commonKeys());
    }

    for (const entry& e : dict)
    {
        if (!known.found(e.keyword()))
        {
            FatalIOErrorInFunction(dict)
                << "Unknown entry " << e.keyword() << " in "
                << dict.dictName() << nl
                << "    Valid entries: "
                << join(wordHashSet(valid).sortedToc()) << nl;

            if (withCommon)
            {
                FatalIOError
                    << "    and those of all function objects: "
                    << join(commonKeys()) << nl;
            }

            FatalIOError << exit(FatalIOError);
        }
    }
}


void Foam::m4gn::checkAtLeast
(
    const dictionary& dict,
    const word& key,
    const scalar value,
    const scalar lower
)
{
    if (!(value >= lower))
    {
        FatalIOErrorInFunction(dict)
            << "Entry " << key << " of " << dict.dictName() << " is "
            << value << "; expected at least " << lower
            << exit(FatalIOError);
    }
}


Foam::word Foam::m4gn::join(const wordList& words)
{
    std::string joined;
    for (const word& w : words)
    {
        joined += (joined.empty() ? "" : ", ") + w;
    }
    return word(joined, false);
}


std::string Foam::m4gn::text(const scalar value)
{
    OStringStream os;
    os.precision(17);
    os << value;
    return os.str();
}


std::string Foam::m4gn::json(const std::string& text)
{
    scalar number;
    if (readScalar(text, number) && std::isfinite(number))
    {
        OStringStream os;
        os.precision(15);
        os << number;
        return os.str();
    }

    std::string quoted("\"");
    for (const char c : text)
    {
        if (c == '"' || c == '\\')
        {
            quoted += '\\';
        }
        quoted += ((unsigned char)(c) < 0x20) ? ' ' : c;
    }
    return quoted + '"';
}


std::string Foam::m4gn::json(const dictionary& dict)
{
    std::string object("{");

    for (const entry& e : dict)
    {
        if (object.size() > 1)
        {
            object += ", ";
        }

        object += '"' + std::string(e.keyword()) + "\": ";

        if (e.isDict())
        {
            object += json(e.dict());
        }
        else
        {
            std::string text;
            for (const token& t : e.stream())
            {
                OStringStream os;
                if (t.isString())
                {
                    os << t.stringToken().c_str();
                }
                else
                {
                    os.precision(15);
                    os << t;
                }
                text += (text.empty() ? "" : " ") + os.str();
            }
            object += json(text);
        }
    }

    return object + '}';
}


// ************************************************************************* //
