/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSurrogate.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnDictionary.H"
#include "m4gnObserve.H"
#include "m4gnReplace.H"
#include "m4gnSession.H"
#include "m4gnFluxProjection.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

namespace Foam
{
namespace functionObjects
{
    defineTypeNameAndDebug(m4gnSurrogate, 0);
    addToRunTimeSelectionTable(functionObject, m4gnSurrogate, dictionary);
}
}

const Foam::Enum<Foam::functionObjects::m4gnSurrogate::modeType>
Foam::functionObjects::m4gnSurrogate::modeNames_
({
    { modeType::OBSERVE, "observe" },
    { modeType::REPLACE, "replace" },
});

bool Foam::functionObjects::m4gnSurrogate::jumping_ = false;


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

void Foam::functionObjects::m4gnSurrogate::start()
{
    session_.reset(new m4gnSession(mesh_, dict_));

    if (mode_ == modeType::REPLACE)
    {
        replace_.reset(new m4gnReplace(name(), mesh_, dict_, *session_));
    }
    else
    {
        observe_.reset(new m4gnObserve(name(), mesh_, dict_, *session_));
    }
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::functionObjects::m4gnSurrogate::m4gnSurrogate
(
    const word& name,
    const Time& runTime,
    const dictionary& dict
)
:
    fvMeshFunctionObject(name, runTime, dict),
    mode_(modeType::OBSERVE),
    solverSteps_(1),
    timeStart_(-VGREAT),
    timeEnd_(VGREAT),
    handedBack_(runTime.startTimeIndex())
{
    read(dict);
}


// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::functionObjects::m4gnSurrogate::~m4gnSurrogate()
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

bool Foam::functionObjects::m4gnSurrogate::read(const dictionary& dict)
{
    if (session_)
    {
        Log << type() << ' ' << name() << ": goes on as it was begun; changes"
            << " to the dictionary take effect in the next run" << endl;
        return true;
    }

    // Errors here must be FatalIOError: OpenFOAM turns FatalError during
    // construction into a warning and goes on without the function object.

    fvMeshFunctionObject::read(dict);

    wordList valid
    ({
        "mode", "solverSteps", "surrogateSteps", "rolloutSteps", "phi",
        "state", "executeOthers", "projection", "writePrecision", "writeToFile",
        "useUserTime"
    });
    valid.append(m4gnSession::keys());
    m4gn::checkKeys(dict, valid, true);

    const word mode(dict.get<word>("mode"));
    if (!modeNames_.found(mode))
    {
        FatalIOErrorInFunction(dict)
            << "Entry mode is " << mode << "; expected "
            << m4gn::join(modeNames_.sortedToc())
            << exit(FatalIOError);
    }
    mode_ = modeNames_.get(mode);

    m4gnSession::checkDictionary(dict, time_.globalPath());

    if (mode_ == modeType::REPLACE)
    {
        solverSteps_ = dict.get<label>("solverSteps");
        m4gn::checkAtLeast(dict, "solverSteps", solverSteps_, 1);
        m4gn::checkAtLeast
        (
            dict, "surrogateSteps", dict.get<label>("surrogateSteps"), 1
        );
        const m4gnFluxProjection checked(mesh_, dict);

        const wordList states(m4gnSolverState::names());
        const word state(dict.getOrDefault<word>("state", states.first()));
        if (!states.found(state))
        {
            FatalIOErrorInFunction(dict)
                << "Entry state is " << state << "; expected "
                << m4gn::join(states)
                << exit(FatalIOError);
        }
    }
    else
    {
        if (m4gnNodes::atPoints(dict))
        {
            FatalIOErrorInFunction(dict)
                << "mode observe compares fields of cells; location points is"
                << " for mode replace" << exit(FatalIOError);
        }
        m4gn::checkAtLeast
        (
            dict,
            "rolloutSteps",
            dict.getOrDefault<label>("rolloutSteps", 50),
            1
        );
    }

    timeStart_ = dict.getOrDefault<scalar>("timeStart", -VGREAT);
    timeEnd_ = dict.getOrDefault<scalar>("timeEnd", VGREAT);

    dict_ = dict;

    return true;
}


bool Foam::functionObjects::m4gnSurrogate::execute()
{
    if (postProcess)
    {
        FatalErrorInFunction
            << "Function object " << name() << " of type " << type()
            << " needs a running solver; it cannot work on stored times."
            << exit(FatalError);
    }

    const scalar half = 0.5*time_.deltaTValue();

    if
    (
        jumping_
     || time_.value() < timeStart_ - half
     || time_.value() > timeEnd_ + half
    )
    {
        return true;
    }

    if (!session_)
    {
        start();
    }

    if (observe_)
    {
        observe_->execute();
    }
    else if (time_.timeIndex() - handedBack_ >= solverSteps_)
    {
        jumping_ = true;

        if (replace_->jump(timeEnd_))
        {
            handedBack_ = time_.timeIndex();
        }

        jumping_ = false;
    }

    return true;
}


bool Foam::functionObjects::m4gnSurrogate::write()
{
    return true;
}


bool Foam::functionObjects::m4gnSurrogate::end()
{
    if (observe_)
    {
        observe_->end();
    }
    if (replace_)
    {
        replace_->end();
    }

    return true;
}


void Foam::functionObjects::m4gnSurrogate::updateMesh(const mapPolyMesh&)
{
    FatalErrorInFunction
        << "The mesh has changed, and a surrogate has one mesh"
        << exit(FatalError);
}


void Foam::functionObjects::m4gnSurrogate::movePoints(const polyMesh&)
{
    FatalErrorInFunction
        << "The mesh has moved, and a surrogate has one mesh"
        << exit(FatalError);
}


// ************************************************************************* //
