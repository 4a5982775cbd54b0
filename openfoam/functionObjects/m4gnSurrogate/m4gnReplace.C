/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnReplace.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "clockTime.H"
#include "fixedFluxPressureFvPatchScalarField.H"
#include "functionObjectList.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "Time.H"

// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

Foam::volVectorField& Foam::m4gnReplace::U() const
{
    return mesh_.lookupObjectRef<volVectorField>(UName_);
}


Foam::surfaceScalarField& Foam::m4gnReplace::phi() const
{
    return mesh_.lookupObjectRef<surfaceScalarField>(phiName_);
}


void Foam::m4gnReplace::checkCase() const
{
    if
    (
        !mesh_.foundObject<volVectorField>(UName_)
     || !mesh_.foundObject<volScalarField>(pName_)
     || !mesh_.foundObject<surfaceScalarField>(phiName_)
    )
    {
        FatalErrorInFunction
            << "mode replace needs a solver that registers the velocity "
            << UName_ << ", the pressure " << pName_ << " and the flux "
            << phiName_ << "; give other names with U, p and phi." << nl
            << "    Registered: "
            << m4gn::join(mesh_.sortedNames<volScalarField>()) << ", "
            << m4gn::join(mesh_.sortedNames<volVectorField>()) << ", "
            << m4gn::join(mesh_.sortedNames<surfaceScalarField>())
            << exit(FatalError);
    }

    if (phi().dimensions() != U().dimensions()*dimArea)
    {
        FatalErrorInFunction
            << "The flux " << phiName_ << " has the dimensions "
            << phi().dimensions() << "; mode replace needs a volumetric flux "
            << U().dimensions()*dimArea << " (incompressible solvers)"
            << exit(FatalError);
    }

    if (mesh_.moving() || mesh_.changing())
    {
        FatalErrorInFunction
            << "mode replace does not handle a mesh that moves or changes"
            << exit(FatalError);
    }

    // The scheme's state must be in the old-time levels of the fields:
    // CrankNicolson keeps fields of its own, pseudo-time has no real time.
    const dictionary schemes
    (
        mesh_.lookupObject<IOdictionary>("fvSchemes")
       .subOrEmptyDict("ddtSchemes")
    );
    const word key("ddt(" + UName_ + ')');
    const ITstream& scheme =
        schemes.lookup(schemes.found(key) ? key : word("default"));
    const word last(scheme.size() ? scheme.last().wordToken() : word::null);

    if (last != "Euler" && last != "backward")
    {
        FatalErrorInFunction
            << "mode replace does not handle the time scheme of " << UName_
            << ": " << flatOutput(scheme) << nl
            << "    Handled: Euler, backward"
            << exit(FatalError);
    }

    if (session_.stride() < time_.deltaTValue()*(1 - 1e-6))
    {
        FatalErrorInFunction
            << "The stride of the model " << session_.model() << ", "
            << session_.stride() << " s, is shorter than the solver's deltaT "
            << time_.deltaTValue() << " s: nothing can be saved." << nl
            << "    Train a model of a longer stride, or reduce deltaT"
            << exit(FatalError);
    }

    // What else is solved for in time stands still while the surrogate steps
    DynamicList<word> others;
    for (const word& name : mesh_.sortedNames<volScalarField>())
    {
        if
        (
            !session_.outputs().found(name) && name != pName_
         && mesh_.lookupObject<volScalarField>(name).nOldTimes() > 0
         && !name.ends_with("_0")
        )
        {
            others.append(name);
        }
    }
    if (others.size())
    {
        WarningInFunction
            << "The solver keeps old times of " << m4gn::join(others)
            << ", which the model does not advance: they stay as they are"
            << " during each jump" << endl;
    }
}


bool Foam::m4gnReplace::predict()
{
    inputs_.gather(session_.adapter());

    forAll(predicted_, i)
    {
        const word& name = session_.outputs()[i];
        const label n = session_.outputComponents(i);

        const scalar* now =
            n == 1
          ? mesh_.lookupObject<volScalarField>(name).primitiveField().cdata()
          : reinterpret_cast<const scalar*>
            (
                mesh_.lookupObject<volVectorField>(name)
               .primitiveField().cdata()
            );

        predicted_[i].resize(n*mesh_.nCells());
        std::copy(now, now + predicted_[i].size(), predicted_[i].begin());
    }

    return session_.step(inputs_.view(), predicted_);
}


template<class Type>
void Foam::m4gnReplace::impose(const label outputi) const
{
    auto& field =
        mesh_.lookupObjectRef<GeometricField<Type, fvPatchField, volMesh>>
        (
            session_.outputs()[outputi]
        );

    // Stores the old time before it gives access
    Field<Type>& cells = field.primitiveFieldRef();

    const auto* values =
        reinterpret_cast<const Type*>(predicted_[outputi].cdata());

    std::copy(values, values + cells.size(), cells.begin());
}


void Foam::m4gnReplace::impose()
{
    forAll(predicted_, i)
    {
        if (session_.outputComponents(i) == 1)
        {
            impose<scalar>(i);
        }
        else
        {
            impose<vector>(i);
        }
    }

    U().correctBoundaryConditions();
    m4gnFluxProjection::interpolate(U(), phi());

    // Conditions that look at phi (inletOutlet) now see the new one
    forAll(predicted_, i)
    {
        const word& name = session_.outputs()[i];

        if (session_.outputComponents(i) == 3)
        {
            mesh_.lookupObjectRef<volVectorField>(name)
           .correctBoundaryConditions();
            continue;
        }

        volScalarField& field = mesh_.lookupObjectRef<volScalarField>(name);

        // The solver sets these gradients from the flux before it solves
        for (fvPatchScalarField& patch : field.boundaryFieldRef())
        {
            if (isA<fixedFluxPressureFvPatchScalarField>(patch))
            {
                auto& fixedFlux =
                    refCast<fixedFluxPressureFvPatchScalarField>(patch);
                const scalarField gradient(fixedFlux.gradient());
                fixedFlux.updateSnGrad(gradient);
            }
        }

        field.correctBoundaryConditions();
    }
}


void Foam::m4gnReplace::executeOthers
(
    const bool before,
    const bool after
) const
{
    if (!executeOthers_)
    {
        return;
    }

    functionObjectList& list = time_.functionObjects();

    bool behind = false;
    forAll(list, i)
    {
        if (list[i].name() == name_)
        {
            behind = true;
        }
        else if (behind ? after : before)
        {
            list[i].execute();
            list[i].write();
        }
    }
}


void Foam::m4gnReplace::writeLine
(
    const label nSteps,
    const scalar surrogateSeconds,
    const scalar projectionSeconds,
    const scalar divInterpolated,
    const scalar divProjected
)
{
    const tmp<scalarField> magU(mag(U().primitiveField()));
    const scalar minU = gMin(magU());
    const scalar maxU = gMax(magU());

    Info<< "m4gn: jumped " << nSteps << " steps of " << session_.stride()
        << " s to time " << time_.timeName() << " in "
        << surrogateSeconds + projectionSeconds << " s; max div(phi) "
        << divInterpolated << " -> " << divProjected << ", max |" << UName_
        << "| " << maxU << nl << endl;

    if (!Pstream::master() || !writeToFile())
    {
        return;
    }

    Ostream& os = file();

    if (!writtenHeader_)
    {
        writeHeader(os, "Jumps of the surrogate " + session_.model());
        writeHeaderValue(os, "stride (s)", session_.stride());
        writeCommented(os, "Time");
        writeTabbed(os, "steps");
        writeTabbed(os, "surrogate(s)");
        writeTabbed(os, "projection(s)");
        writeTabbed(os, "maxDivBefore");
        writeTabbed(os, "maxDivAfter");
        writeTabbed(os, "minMagU");
        writeTabbed(os, "maxMagU");
        os  << endl;
        writtenHeader_ = true;
    }

    os  << time_.timeOutputValue()
        << tab << nSteps
        << tab << surrogateSeconds
        << tab << projectionSeconds
        << tab << divInterpolated
        << tab << divProjected
        << tab << minU
        << tab << maxU
        << endl;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnReplace::m4gnReplace
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession& session
)
:
    writeFile(mesh, name, "surrogate", dict),
    name_(name),
    mesh_(mesh),
    time_(const_cast<Time&>(mesh.time())),
    UName_(dict.getOrDefault<word>("U", "U")),
    pName_(dict.getOrDefault<word>("p", "p")),
    phiName_(dict.getOrDefault<word>("phi", "phi")),
    nSteps_(dict.get<label>("surrogateSteps")),
    executeOthers_(dict.getOrDefault<bool>("executeOthers", true)),
    session_(session),
    projection_(mesh, dict),
    inputs_(mesh, session.inputs()),
    predicted_(session.outputs().size()),
    replacedTime_(0),
    firstTime_(mesh.time().value()),
    takeoverTime_(mesh.time().value()),
    surrogateSeconds_(0),
    projectionSeconds_(0),
    nStepsDone_(0),
    nJumps_(0),
    nRefused_(0)
{
    checkCase();
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

bool Foam::m4gnReplace::jump(const scalar endTime)
{
    const scalar deltaT = time_.deltaTValue();
    const scalar stride = session_.stride();

    // Room for a stride that leaves the solver the last step?
    const auto fits = [&]()
    {
        return
            time_.value() + stride
          < min(endTime + deltaT, time_.endTime().value()) - 0.5*deltaT;
    };

    if (!nJumps_)
    {
        takeoverTime_ = time_.value();
    }

    clockTime timer;
    scalar surrogateSeconds = 0;
    scalar projectionSeconds = 0;
    scalar divInterpolated = 0;
    label stepi = 0;
    // Tightly enough to be written, to be handed over
    bool projected = false;
    bool handedOver = false;

    const auto project = [&](const bool handOver)
    {
        timer.timeIncrement();
        if (!projected)
        {
            divInterpolated = m4gnFluxProjection::maxDiv(phi());
        }
        projection_.project
        (
            mesh_.lookupObject<volScalarField>(pName_), U(), phi(), handOver
        );
        projected = true;
        handedOver = handOver;
        projectionSeconds += timer.timeIncrement();
    };

    for (; stepi < nSteps_ && fits(); ++stepi)
    {
        timer.timeIncrement();
        if (!predict())
        {
            ++nRefused_;
            break;
        }
        surrogateSeconds += timer.timeIncrement();

        // Function objects behind this one have not seen this time yet; in
        // front of it they have not if it is the surrogate's.
        executeOthers(stepi > 0, true);

        timer.timeIncrement();
        time_.setDeltaT(stride, false);
        ++time_;
        impose();
        surrogateSeconds += timer.timeIncrement();

        const bool last = stepi + 1 == nSteps_ || !fits();
        projected = false;
        handedOver = false;

        if (last || projection_.every() || time_.writeTime())
        {
            project(last);
        }

        time_.write();
    }

    if (!stepi)
    {
        return false;
    }

    if (!handedOver)
    {
        // The jump ended early
        project(true);
    }

    // Those behind this one follow when it returns
    executeOthers(true, false);

    time_.setDeltaT(deltaT, false);

    if (time_.value() > time_.endTime().value() - 0.5*deltaT)
    {
        // Stopped from outside (stopAt, a signal): Time ends a run in an
        // orderly way only after a step of the solver
        time_.setEndTime(time_.value() + deltaT);
    }

    ++nJumps_;
    nStepsDone_ += stepi;
    replacedTime_ += stepi*stride;
    surrogateSeconds_ += surrogateSeconds;
    projectionSeconds_ += projectionSeconds;

    writeLine
    (
        stepi,
        surrogateSeconds,
        projectionSeconds,
        divInterpolated,
        m4gnFluxProjection::maxDiv(phi())
    );

    return true;
}


void Foam::m4gnReplace::end() const
{
    const scalar total = max(time_.value() - firstTime_, VSMALL);
    const scalar fraction = replacedTime_/total;

    Info<< "m4gn: replacedFraction = " << fraction << " (" << replacedTime_
        << " s of " << total << " s in " << nJumps_ << " jumps, "
        << nStepsDone_ << " surrogate steps; " << nRefused_
        << " jumps ended early), surrogate " << surrogateSeconds_
        << " s, projection " << projectionSeconds_ << " s, setup "
        << session_.setupSeconds() << " s" << nl << endl;

    if (!Pstream::master())
    {
        return;
    }

    const fileName dir(m4gn::outputDir(name_, mesh_));
    mkDir(dir);
    OFstream os(dir/"summary.json");

    os  << "{\n"
        << "  \"replaced_time\": " << replacedTime_ << ",\n"
        << "  \"solver_time\": " << total - replacedTime_ << ",\n"
        << "  \"replaced_fraction\": " << fraction << ",\n"
        << "  \"takeover_time\": " << takeoverTime_ << ",\n"
        << "  \"jumps\": " << nJumps_ << ",\n"
        << "  \"jumps_ended_early\": " << nRefused_ << ",\n"
        << "  \"surrogate_steps\": " << nStepsDone_ << ",\n"
        << "  \"stride\": " << session_.stride() << ",\n"
        << "  \"surrogate_seconds\": " << surrogateSeconds_ << ",\n"
        << "  \"projection_seconds\": " << projectionSeconds_ << ",\n"
        << "  \"setup_seconds\": " << session_.setupSeconds() << "\n"
        << "}\n";

    if (!os.good())
    {
        FatalErrorInFunction
            << "Cannot write " << os.name() << exit(FatalError);
    }
}


// ************************************************************************* //
