// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnStaleFields.H"
#include "m4gnDictionary.H"
#include "m4gnSegmentField.H"
#include "Time.H"
#include "IOdictionary.H"
#include "volFields.H"

void Foam::m4gnStaleFields::derive()
{
    auto* rhok = mesh_.getObjectPtr<volScalarField>("rhok");
    const auto* T = mesh_.findObject<volScalarField>("T");
    const auto* transport = mesh_.findObject<IOdictionary>("transportProperties");

    if (rhok && T && transport && advanced_.found("T") && transport->found("beta")
        && transport->found("TRef")) {
        const dimensionedScalar beta("beta", dimless / dimTemperature, *transport);
        const dimensionedScalar TRef("TRef", dimTemperature, *transport);
        *rhok = 1.0 - beta * (*T - TRef);
        derived_.insert("rhok");
    }

    auto* p = mesh_.getObjectPtr<volScalarField>("p");
    const auto* p_rgh = mesh_.findObject<volScalarField>("p_rgh");
    const auto* gh = mesh_.findObject<volScalarField>("gh");
    const auto* rho = rhok ? rhok : mesh_.findObject<volScalarField>("rho");

    if (p && p_rgh && gh && rho && advanced_.found("p_rgh") && !advanced_.found("p")
        && p->dimensions() == p_rgh->dimensions() && p->dimensions() == rho->dimensions() * gh->dimensions())
    {
        *p == *p_rgh + *rho*(*gh);
        derived_.insert("p");
    }
}

bool Foam::m4gnStaleFields::stale(const regIOobject& object) const
{
    const word& type = object.type();
    const bool field =
        type.ends_with("Field")
        && (type.starts_with("vol") || type.starts_with("surface") || type.starts_with("point"));

    // Old times go with their field; a ray's ILambda_0_0 is none
    const auto made = [&](const word& name) { return advanced_.found(name) || derived_.found(name); };
    word name(object.name());
    while (name.ends_with("_0") && !made(name)) {
        name.resize(name.size() - 2);
    }

    return field && object.writeOpt() == IOobject::AUTO_WRITE && !made(name);
}

Foam::wordList Foam::m4gnStaleFields::names(const wordList& advanced)
{
    advanced_ = wordHashSet(advanced);
    derive();

    DynamicList<word> found;
    for (const word& name : mesh_.sortedNames<regIOobject>()) {
        if (stale(mesh_.lookupObject<regIOobject>(name))) {
            found.append(name);
        }
    }
    return wordList(found);
}

void Foam::m4gnStaleFields::write(
    const wordList& advanced, const word& since, const std::function<void()>& writeState)
{
    const wordList marked(names(advanced));

    if (!mesh_.time().writeTime()) {
        return;
    }

    DynamicList<string> notes;
    for (const word& name : marked) {
        auto& object = mesh_.lookupObjectRef<regIOobject>(name);
        notes.append(object.note());
        object.note() = std::string(m4gn::staleNote) + ", values of time " + since;
    }

    if (marked.size() && !said_) {
        Info << "m4gn: the model does not advance " << m4gn::join(marked)
             << ": what is written of them in a jump has the values of the"
             << " solver's last step, and a note that says so" << endl;
        said_ = true;
    }

    writeState();

    forAll(marked, i) {
        mesh_.lookupObjectRef<regIOobject>(marked[i]).note() = notes[i];
    }
}
