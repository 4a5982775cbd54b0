// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnDictionary.H"
#include "HashSet.H"
#include "ITstream.H"
#include "StringStream.H"
#include "token.H"

namespace
{
using namespace Foam;

std::string plain(const token& t)
{
    if (t.isString()) {
        return t.stringToken();
    }
    if (t.isWord()) {
        return t.wordToken();
    }
    if (t.isNumber() && !t.isLabel()) {
        return m4gn::text(t.number());
    }

    OStringStream os;
    os << t;
    return os.str();
}

//- One token as JSON
std::string json(const token& t) { return t.isNumber() ? plain(t) : m4gn::quoted(plain(t)); }

//- List that begins behind the bracket at i, which is then behind its end
std::string jsonList(const tokenList& tokens, label& i)
{
    std::string list("[");
    while (i < tokens.size()) {
        const token& t = tokens[i++];
        if (t.isPunctuation() && t.pToken() == token::END_LIST) {
            break;
        }

        list += list.size() > 1 ? ", " : "";
        list += t.isPunctuation() && t.pToken() == token::BEGIN_LIST ? jsonList(tokens, i) : json(t);
    }
    return list + ']';
}

//- An entry's value: a number, a switch, a text, or a list
std::string json(const tokenList& tokens)
{
    if (tokens.size() == 1 && tokens[0].isCompound()) {
        // List<word> 2 (a b), as another program may have written it
        OStringStream os;
        tokens[0].compoundToken().write(os);
        return json(ITstream::parse(os.str()));
    }

    const auto opens = [&](const label i) {
        return i < tokens.size() && tokens[i].isPunctuation() && tokens[i].pToken() == token::BEGIN_LIST;
    };

    // (a b), or 2(a b)
    label first = tokens.size() && tokens[0].isLabel() ? 1 : 0;
    if (opens(first)) {
        ++first;
        return jsonList(tokens, first);
    }

    if (tokens.size() == 1) {
        if (tokens[0].isWord()) {
            const word& w = tokens[0].wordToken();
            if (w == "yes" || w == "on" || w == "true") {
                return "true";
            }
            if (w == "no" || w == "off" || w == "false") {
                return "false";
            }
        }
        return json(tokens[0]);
    }

    std::string words;
    for (const token& t : tokens) {
        words += (words.empty() ? "" : " ") + plain(t);
    }
    return m4gn::quoted(words);
}

} // End anonymous namespace

const Foam::wordList& Foam::m4gn::commonKeys()
{
    static const wordList keys(
        {"type",
         "libs",
         "functionObjectLibs",
         "enabled",
         "log",
         "region",
         "subRegion",
         "errors",
         "timeStart",
         "timeEnd",
         "executeControl",
         "executeInterval",
         "writeControl",
         "writeInterval",
         "outputControl",
         "outputInterval",
         "triggerStart",
         "triggerEnd",
         "controlMode",
         "deltaTCoeff",
         "nStepsToStartTimeChange",
         "useNamePrefix"});

    return keys;
}

void Foam::m4gn::checkKeys(const dictionary& dict, const wordList& valid, const bool withCommon)
{
    wordHashSet known(valid);

    if (withCommon) {
        known.insert(commonKeys());
    }

    for (const entry& e : dict) {
        if (!known.found(e.keyword())) {
            FatalIOErrorInFunction(dict)
                << "Unknown entry " << e.keyword() << " in " << dict.dictName() << nl
                << "    Valid entries: " << join(wordHashSet(valid).sortedToc()) << nl;

            if (withCommon) {
                FatalIOError << "    and those of all function objects: " << join(commonKeys()) << nl;
            }

            FatalIOError << exit(FatalIOError);
        }
    }
}

void Foam::m4gn::checkDictionaries(const dictionary& dict, const wordList& keys)
{
    for (const word& key : keys) {
        const entry* e = dict.findEntry(key);

        if (e && !e->isDict()) {
            FatalIOErrorInFunction(dict)
                << "Entry " << key << " of " << dict.dictName() << " is no dictionary; expected " << key
                << " { ... }" << exit(FatalIOError);
        }
    }
}

bool Foam::m4gn::isNone(const dictionary& dict, const word& key, const std::string& example)
{
    const entry* e = dict.findEntry(key);
    if (!e || e->isDict()) {
        return false;
    }

    const word text(dict.get<word>(key));
    if (text != "none") {
        FatalIOErrorInFunction(dict) << "Entry " << key << " of " << dict.dictName() << " is " << text
                                     << "; expected none, or " << example.c_str() << exit(FatalIOError);
    }

    return true;
}

void Foam::m4gn::checkAtLeast(const dictionary& dict, const word& key, const scalar value, const scalar lower)
{
    if (!(value >= lower)) {
        FatalIOErrorInFunction(dict) << "Entry " << key << " of " << dict.dictName() << " is " << value
                                     << "; expected at least " << lower << exit(FatalIOError);
    }
}

Foam::word Foam::m4gn::join(const wordList& words)
{
    std::string joined;
    for (const word& w : words) {
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

std::string Foam::m4gn::quoted(const std::string& text)
{
    std::string result("\"");
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            result += '\\';
        }
        result += ((unsigned char)(c) < 0x20) ? ' ' : c;
    }
    return result + '"';
}

std::string Foam::m4gn::json(const dictionary& dict)
{
    std::string object("{");

    for (const entry& e : dict) {
        object += (object.size() > 1 ? ", " : "") + quoted(e.keyword()) + ": ";
        object += e.isDict() ? json(e.dict()) : ::json(e.stream());
    }

    return object + '}';
}

Foam::dictionary Foam::m4gn::without(const dictionary& dict, const wordList& keys)
{
    dictionary rest(dict);
    for (const word& key : keys) {
        rest.remove(key);
    }
    return rest;
}

Foam::word Foam::m4gn::scheme(const dictionary& fvSchemes, const word& group, const word& key)
{
    const dictionary schemes(fvSchemes.subOrEmptyDict(group));
    const word used(schemes.found(key) ? key : word("default"));

    if (!schemes.found(used)) {
        return word::null;
    }

    // "bounded Euler", "NewmarkBeta 0.25 0.5", "CrankNicolson ocCoeff { type scale; ... }"
    for (const token& t : schemes.lookup(used)) {
        if (t.isWord() && t.wordToken() != "bounded") {
            return t.wordToken();
        }
    }

    return word::null;
}
