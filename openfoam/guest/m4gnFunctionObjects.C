// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnFunctionObjects.H"
#include "m4gnDictionary.H"
#include "Time.H"
#include "functionObjectList.H"
#include "timeControlFunctionObject.H"

namespace
{
using namespace Foam;

const char* const entryName = "executeOthers";

const char* const intervalName = "othersInterval";

//- Types of function objects that do more than look
const wordHashSet acting(
    {"age", "electricPotential", "energyTransport", "externalCoupled", "hydrostaticPressure",
     "icoUncoupledKinematicCloud", "limitFields", "m4gnAnderson", "phaseScalarTransport", "runTimeControl",
     "scalarTransport", "setFlow", "setTimeStep"});

//- Is the entry a list?
bool isList(const dictionary& dict)
{
    if (!dict.found(entryName)) {
        return false;
    }

    const token first(dict.lookup(entryName).first());

    return first.isPunctuation() || first.isLabel() || first.isCompound();
}

} // End anonymous namespace

Foam::word Foam::m4gnFunctionObjects::typeOf(const functionObject& object, const Time& time)
{
    // In the list it may be wrapped in the control of its times, which says nothing of it
    const dictionary* functions = time.controlDict().findDict("functions");
    const dictionary* own = functions ? functions->findDict(object.name()) : nullptr;

    return own ? own->getOrDefault<word>("type", object.type()) : object.type();
}

Foam::label Foam::m4gnFunctionObjects::interval(const dictionary& dict)
{
    return dict.getOrDefault<label>(intervalName, 1);
}

void Foam::m4gnFunctionObjects::checkDictionary(const dictionary& dict)
{
    if (isList(dict)) {
        dict.get<wordList>(entryName);
    } else {
        dict.getOrDefault<bool>(entryName, true);
    }
    if (interval(dict) < 1) {
        FatalIOErrorInFunction(dict) << intervalName << ' ' << interval(dict)
                                     << ": expected at least 1 time step of the solver" << exit(FatalIOError);
    }
}

void Foam::m4gnFunctionObjects::check(const word& name, const Time& time, const dictionary& dict)
{
    const functionObjectList& list = time.functionObjects();

    wordHashSet known, left;

    forAll(list, i) {
        const word& other = list[i].name();
        const auto* controls = isA<functionObjects::timeControl>(list[i]);
        if (controls && time.isAdjustTimeStep() && controls->dict().found("deltaTCoeff")) {
            FatalErrorInFunction
                << "The entry deltaTCoeff of " << other
                << " derives each of the solver's steps from the one before, which a jump does not have" << nl
                << "    Expected none beside " << name
                << " in mode replace: leave it out, or set nStepsToStartTimeChange" << exit(FatalError);
        }
        if (other != name) {
            known.insert(other);
            if (acting.found(typeOf(list[i], time))) {
                left.insert(other);
            }
        }
    }

    if (isList(dict)) {
        for (const word& other : dict.get<wordList>(entryName)) {
            if (!known.found(other)) {
                FatalErrorInFunction << "executeOthers of " << name << " has the name " << other
                                     << ", which is no other function object of this run" << nl
                                     << "    The others are: " << m4gn::join(known.sortedToc())
                                     << exit(FatalError);
            }
        }
    } else if (left.size() && dict.getOrDefault<bool>(entryName, true)) {
        Info << "m4gn: function objects that are not executed at the"
             << " surrogate's times, since they do more than look: " << m4gn::join(left.sortedToc())
             << " (entry executeOthers)" << endl;
    }
}

Foam::wordHashSet Foam::m4gnFunctionObjects::chosen(
    const word& name, const Time& time, const dictionary& dict)
{
    if (isList(dict)) {
        return wordHashSet(dict.get<wordList>(entryName));
    }

    wordHashSet watching;
    if (dict.getOrDefault<bool>(entryName, true)) {
        const functionObjectList& list = time.functionObjects();
        forAll(list, i) {
            if (list[i].name() != name && !acting.found(typeOf(list[i], time))) {
                watching.insert(list[i].name());
            }
        }
    }
    return watching;
}

bool Foam::m4gnFunctionObjects::reportsSolves(const functionObject& object, const Time& time)
{
    static const wordHashSet types({"residuals", "solverInfo"});
    return types.found(typeOf(object, time));
}
