/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSettling.H"
#include "m4gnDictionary.H"
#include "Time.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

const Foam::word entryName("settling");

//- Implicit steps: the order in (omega h)^2 to which slow modes stay
const Foam::label nSteps = 3;


//- The time that the dictionary asks for, 0 for none, else as given (s).
//  FatalIOError if the entry is not valid.
Foam::scalar timeOf(const Foam::dictionary& dict, const Foam::scalar usual)
{
    if
    (
        Foam::m4gn::isNone
        (
            dict, entryName, "settling { time 0.02; tolerance 1e-5; }"
        )
    )
    {
        return 0;
    }
    if (!dict.found(entryName))
    {
        return usual;
    }

    const Foam::dictionary& own = dict.subDict(entryName);
    Foam::m4gn::checkKeys(own, {"time", "tolerance"}, false);

    for (const Foam::word& name : {Foam::word("time"), Foam::word("tolerance")})
    {
        if (own.found(name) && !(own.get<Foam::scalar>(name) > 0))
        {
            FatalIOErrorInFunction(own)
                << "Entry " << name << " of " << own.dictName() << " is "
                << own.get<Foam::scalar>(name) << "; expected more than 0"
                << Foam::nl << "    To hand over what was predicted: "
                << entryName << " none;" << Foam::exit(Foam::FatalIOError);
        }
    }

    return own.getOrDefault<Foam::scalar>("time", usual);
}

} // End anonymous namespace


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

Foam::tmp<Foam::volVectorField> Foam::m4gnSettling::file
(
    const word& name,
    const dimensionSet& dimensions
) const
{
    return tmp<volVectorField>::New
    (
        IOobject
        (
            name,
            mesh_.time().timeName(),
            mesh_,
            IOobject::READ_IF_PRESENT,
            IOobject::NO_WRITE,
            false
        ),
        mesh_,
        dimensionedVector(dimensions, Zero)
    );
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnSettling::m4gnSettling
(
    const fvMesh& mesh,
    const dictionary& dict,
    const scalar stride
)
:
    mesh_(mesh),
    time_(timeOf(dict, 0.5*stride)),
    tolerance_
    (
        time_ > 0
      ? dict.subOrEmptyDict(entryName).getOrDefault<scalar>("tolerance", 1e-5)
      : 0
    ),
    settledAt_(-VGREAT),
    lastTime_(-VGREAT),
    said_(false)
{
    IOobject written
    (
        "surrogateD", mesh.time().timeName(), mesh, IOobject::MUST_READ
    );
    if (active() && written.typeHeaderOk<volVectorField>(true))
    {
        settledAt_ = lastTime_ = mesh.time().value();
        predictedD_ = file("surrogateD", dimLength)().primitiveField();
        predictedRate_ = file("surrogateRate", dimVelocity)().primitiveField();
        lastAcceleration_ =
            file("surrogateAcceleration", dimAcceleration)().primitiveField();
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnSettling::checkDictionary(const dictionary& dict)
{
    timeOf(dict, 1);
}


void Foam::m4gnSettling::settle
(
    m4gnSolidLaw& law,
    volVectorField& D,
    volVectorField& rate,
    const scalar deltaT
)
{
    const scalar now = mesh_.time().value();
    if (settledAt_ == now)
    {
        return;
    }

    const vectorField predicted(D.primitiveField());
    vectorField free(predicted);
    bool done = true;
    for (label i = 0; done && i < nSteps; ++i)
    {
        if (i)
        {
            free -= D.primitiveField() - predicted;
        }
        done = law.settle(free, time_, tolerance_);
    }
    if (!done)
    {
        D.primitiveFieldRef() = predicted;
        D.correctBoundaryConditions();
        lastD_.clear();
        if (!said_)
        {
            said_ = true;
            WarningInFunction
                << "The displacement of the surrogate could not be settled at"
                << " time " << mesh_.time().timeName() << ": such states are"
                << " handed over as predicted" << nl
                << "    Give it another time, or a larger tolerance (settling"
                << " { time ...; tolerance ...; }), or have settling none;"
                << endl;
        }
        return;
    }

    settledAt_ = now;
    predictedD_ = predicted;
    predictedRate_ = rate.primitiveField();
    const vectorField acceleration((D.primitiveField() - free)/sqr(time_));

    if (lastD_.size())
    {
        // The solver's rate is that of its last time step
        const scalar between = now - lastTime_;
        rate.primitiveFieldRef() =
            (D.primitiveField() - lastD_)/between
          + between*(acceleration/3 + lastAcceleration_/6)
          - 0.5*deltaT*acceleration;
    }

    lastD_ = D.primitiveField();
    lastAcceleration_ = acceleration;
    lastTime_ = now;
}


bool Foam::m4gnSettling::restore(volVectorField& D, volVectorField& rate)
{
    if (settledAt_ != mesh_.time().value())
    {
        return false;
    }

    // Of a run that is carried on
    if (!lastD_.size())
    {
        lastD_ = D.primitiveField();
    }

    D.primitiveFieldRef() = predictedD_;
    rate.primitiveFieldRef() = predictedRate_;
    settledAt_ = -VGREAT;

    return true;
}


void Foam::m4gnSettling::end()
{
    settledAt_ = -VGREAT;
    lastD_.clear();
}


void Foam::m4gnSettling::write() const
{
    if (settledAt_ != mesh_.time().value())
    {
        return;
    }

    const auto write = [&]
    (
        const word& name,
        const dimensionSet& dimensions,
        const vectorField& values
    )
    {
        tmp<volVectorField> field(file(name, dimensions));
        field.ref().primitiveFieldRef() = values;
        field().write();
    };

    write("surrogateD", dimLength, predictedD_);
    write("surrogateRate", dimVelocity, predictedRate_);
    write("surrogateAcceleration", dimAcceleration, lastAcceleration_);
}


// ************************************************************************* //
