/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnForecast.H"
#include "objectRegistry.H"
#include "Time.H"
#include "vector.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

namespace Foam
{
    defineTypeNameAndDebug(m4gnForecast, 0);
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnForecast::m4gnForecast(const objectRegistry& db)
:
    regIOobject
    (
        IOobject
        (
            typeName,
            db.time().constant(),
            db,
            IOobject::NO_READ,
            IOobject::NO_WRITE
        )
    ),
    time_(-VGREAT)
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

const Foam::m4gnForecast* Foam::m4gnForecast::find(const objectRegistry& db)
{
    return db.findObject<m4gnForecast>(typeName);
}


void Foam::m4gnForecast::reset(const scalar time)
{
    time_ = time;
    values_.clear();
}


void Foam::m4gnForecast::set
(
    const word& field,
    const scalarField& values,
    const label nComponents
)
{
    if (nComponents == 1)
    {
        values_.set(field, values);
        return;
    }

    for (direction cmpt = 0; cmpt < nComponents; ++cmpt)
    {
        scalarField component(values.size()/nComponents);
        forAll(component, celli)
        {
            component[celli] = values[nComponents*celli + cmpt];
        }
        values_.set(field + pTraits<vector>::componentNames[cmpt], component);
    }
}


const Foam::scalarField* Foam::m4gnForecast::values(const word& unknown) const
{
    const auto found = values_.cfind(unknown);

    return found.found() ? &found.val() : nullptr;
}


// ************************************************************************* //
