// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnMechanicalProperties.H"
#include "m4gnDictionary.H"
#include "IOdictionary.H"
#include "StringStream.H"
#include "stringOps.H"
#include "Time.H"
#include "dictionaryEntry.H"
#include "volFields.H"

const Foam::word Foam::m4gnMechanicalProperties::fileName("mechanicalProperties");

namespace Foam
{
//- The last number of an entry: "2e11", "[1 -1 -2 0 0 0 0] 2e11" or
//  "E [1 -1 -2 0 0 0 0] 2e11", or the value of a dictionary; false if there is
//  none, as of the list that materials with several relaxation times have
static bool number(const dictionary& dict, const word& key, scalar& value)
{
    if (dict.isDict(key)) {
        return number(dict.subDict(key), "value", value);
    }
    if (!dict.found(key)) {
        return false;
    }

    const ITstream& stream = dict.lookup(key);

    if (stream.empty() || !stream.last().isNumber()) {
        return false;
    }

    value = stream.last().number();
    return true;
}

//- Largest traction on the patches of a displacement, Pa: the entries traction
//  and pressure of conditions that have them as fields. The classes themselves
//  belong to the solvers.
static scalar largestTraction(const volVectorField& D)
{
    scalar largest = 0;

    for (const fvPatchVectorField& patch : D.boundaryField()) {
        OStringStream written;
        patch.write(written);
        IStringStream stream(written.str());
        const dictionary entries(stream);

        const auto isField = [&](const word& key) {
            const entry* e = entries.findEntry(key);

            return e && e->isStream() && e->stream().size() && e->stream().first().isWord()
                   && (e->stream().first().wordToken() == "uniform"
                       || e->stream().first().wordToken() == "nonuniform");
        };

        vectorField traction(patch.size(), Zero);
        if (isField("traction")) {
            traction += vectorField("traction", entries, patch.size());
        }
        if (isField("pressure")) {
            traction -= scalarField("pressure", entries, patch.size()) * patch.patch().nf();
        }

        for (const vector& t : traction) {
            largest = max(largest, mag(t));
        }
    }

    return returnReduce(largest, maxOp<scalar>());
}

//- Adds (low high); written as a list, two equal values would become 2{low}
static void addRange(dictionary& to, const word& name, const scalar low, const scalar high)
{
    tokenList tokens(4);
    tokens[0] = token::BEGIN_LIST;
    tokens[1] = low;
    tokens[2] = high;
    tokens[3] = token::END_LIST;
    to.add(new primitiveEntry(name, std::move(tokens)));
}

//- Adds the entries of a law, and of the one that it wraps
static void addLaws(DynamicList<dictionary>& to, const dictionary& law)
{
    to.append(law);
    for (const entry& e : law) {
        // mechanicalLaw, effectiveStressMechanicalLaw, passiveMechanicalLaw
        if (e.isDict() && e.keyword().ends_with("echanicalLaw")) {
            addLaws(to, e.dict());
        }
    }
}

} // End namespace Foam

Foam::m4gnMechanicalProperties::m4gnMechanicalProperties(const fvMesh& mesh) : mesh_(mesh)
{
    for (const objectRegistry* registry : {&mesh.thisDb(), &mesh.time().db()}) {
        const auto* known = registry->findObject<IOdictionary>(fileName);

        if (known) {
            properties_.reset(new dictionary(*known));
            return;
        }
    }

    IOobject io(fileName, mesh.time().constant(), mesh, IOobject::MUST_READ, IOobject::NO_WRITE, false);

    if (io.typeHeaderOk<IOdictionary>(true)) {
        properties_.reset(new dictionary(IOdictionary(io)));
    }
}

bool Foam::m4gnMechanicalProperties::registered() const
{
    for (const word key : {"E", "nu", "rho"}) {
        if (!mesh_.foundObject<volScalarField>(key)) {
            return false;
        }
    }

    return mesh_.lookupObject<volScalarField>("E").dimensions() == dimPressure
           && mesh_.lookupObject<volScalarField>("rho").dimensions() == dimDensity;
}

bool Foam::m4gnMechanicalProperties::uniform() const
{
    for (const word key : {"E", "nu", "rho"}) {
        scalar value;
        if (!found() || !dict().isDict(key)
            || dict().subDict(key).getOrDefault<word>("type", "uniform") != "uniform"
            || !number(dict(), key, value))
        {
            return false;
        }
    }

    return true;
}

Foam::PtrList<Foam::entry> Foam::m4gnMechanicalProperties::materials() const
{
    return PtrList<entry>(dict().lookup("mechanical"));
}

Foam::List<Foam::dictionary> Foam::m4gnMechanicalProperties::lawEntries() const
{
    DynamicList<dictionary> all;

    if (listed()) {
        const PtrList<entry> list(materials());
        for (const entry& material : list) {
            if (material.isDict()) {
                addLaws(all, material.dict());
            }
        }
    }

    return List<dictionary>(all);
}

Foam::wordList Foam::m4gnMechanicalProperties::laws() const
{
    wordHashSet names;

    for (const dictionary& law : lawEntries()) {
        if (law.found("type")) {
            names.insert(law.get<word>("type"));
        }
    }

    return names.sortedToc();
}

Foam::wordList Foam::m4gnMechanicalProperties::lawsWithHistory() const
{
    DynamicList<word> found;

    for (const word& law : laws()) {
        const std::string lower(stringOps::lower(law));

        for (const char* part : {"plastic", "visco", "damage", "coulo", "umat"}) {
            if (lower.find(part) != std::string::npos) {
                found.append(law);
                break;
            }
        }
    }

    return wordList(std::move(found));
}

bool Foam::m4gnMechanicalProperties::moduli(const dictionary& material, scalar& E, scalar& nu, scalar& rho)
{
    if (!number(material, "rho", rho)) {
        return false;
    }
    if (number(material, "E", E) && number(material, "nu", nu)) {
        return true;
    }

    scalar mu, K;
    if (number(material, "mu", mu) && number(material, "K", K)) {
        E = 9 * K * mu / (3 * K + mu);
        nu = (3 * K - 2 * mu) / (2 * (3 * K + mu));
        return true;
    }

    return false;
}

Foam::dictionary Foam::m4gnMechanicalProperties::description(const word& D) const
{
    dictionary solid;

    if (registered()) {
        for (const word key : {"E", "nu", "rho"}) {
            const scalarField& values = mesh_.lookupObject<volScalarField>(key).primitiveField();
            addRange(solid, key, gMin(values), gMax(values));
        }
    } else if (listed() || uniform()) {
        scalar E, nu, rho;
        DynamicList<vector> known;
        bool all = true;

        if (listed()) {
            const PtrList<entry> list(materials());
            for (const entry& material : list) {
                if (!material.isDict()) {
                    continue;
                }
                if (moduli(material.dict(), E, nu, rho)) {
                    known.append(vector(E, nu, rho));
                } else {
                    all = false;
                }
            }
        } else if (moduli(dict(), E, nu, rho)) {
            known.append(vector(E, nu, rho));
        }

        if (all && known.size()) {
            const vector low(min(known));
            const vector high(max(known));
            addRange(solid, "E", low.x(), high.x());
            addRange(solid, "nu", low.y(), high.y());
            addRange(solid, "rho", low.z(), high.z());
        }
        const wordList names(laws());
        if (names.size()) {
            solid.add("laws", names);
        }
    } else {
        return solid;
    }

    const auto* displacement = mesh_.findObject<volVectorField>(D);
    if (displacement) {
        // solids4foam's incremental models have the conditions at the increment
        const auto* increment = mesh_.findObject<volVectorField>("D" + D);
        const scalar largest =
            max(largestTraction(*displacement), increment ? largestTraction(*increment) : scalar(0));
        addRange(solid, "traction", largest, largest);

        const word scheme(m4gn::scheme(mesh_.schemesDict(), "d2dt2Schemes", "d2dt2(" + D + ')'));
        if (scheme.size()) {
            solid.add("schemes", wordList(1, scheme));
        }
    }

    return solid;
}
