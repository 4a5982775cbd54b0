/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnObserve.H"
#include "directionMixedFvPatchFields.H"
#include "mixedFvPatchFields.H"
#include "Time.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

using namespace Foam;

//- Root mean square over the cells of all ranks and the solved components, as
//  'm4gn compare' and 'm4gn validate' have it
scalar rms
(
    const scalarField& difference,
    const label nCells,
    const label nSolved
)
{
    const scalar sum = gSumSqr(difference);
    const label n = nSolved*returnReduce(nCells, sumOp<label>());

    return std::sqrt(sum/n);
}


//- From old (0) to now (1)
tmp<scalarField> between
(
    const scalarField& old,
    const scalarField& now,
    const scalar fraction
)
{
    return old + fraction*(now - old);
}

} // End anonymous namespace


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

Foam::scalarField Foam::m4gnObserve::solverValues(const label outputi) const
{
    const word& name = session_.outputs()[outputi];

    if (session_.outputComponents(outputi) == 1)
    {
        return mesh_.lookupObject<volScalarField>(name).primitiveField();
    }

    const vectorField& vectors =
        mesh_.lookupObject<volVectorField>(name).primitiveField();
    const auto* flat = reinterpret_cast<const scalar*>(vectors.cdata());

    scalarField values(3*vectors.size());
    std::copy(flat, flat + values.size(), values.begin());

    return values;
}


template<class Type>
void Foam::m4gnObserve::imposeBoundary
(
    const GeometricField<Type, fvPatchField, volMesh>& field,
    const scalarField& cells,
    scalarField& boundary
) const
{
    const label n = pTraits<Type>::nComponents;
    label nodei = 0;

    for (const label patchi : session_.nodes().valuePatches())
    {
        const fvPatchField<Type>& patch = field.boundaryField()[patchi];
        const labelUList& owner = patch.patch().faceCells();
        const bool fixes = patch.fixesValue();

        // Where they let go, the face has its cell's value
        const auto* mixed =
            dynamic_cast<const mixedFvPatchField<Type>*>(&patch);
        const auto* directionMixed =
            dynamic_cast<const directionMixedFvPatchField<Type>*>(&patch);

        forAll(patch, facei)
        {
            const bool held =
                mixed ? mixed->valueFraction()[facei] > 0.5
              : directionMixed
              ? tr(directionMixed->valueFraction()[facei]) > 0.5
              : fixes;
            const scalar* from =
                held
              ? reinterpret_cast<const scalar*>(&patch[facei])
              : &cells[n*owner[facei]];

            std::copy(from, from + n, &boundary[n*nodei]);
            ++nodei;
        }
    }
}


void Foam::m4gnObserve::predict()
{
    inputs_.gather(session_.nodes());

    forAll(start_, i)
    {
        start_[i] = solverValues(i);
    }

    oneStep_ = start_;
    oneStepFinite_ = session_.step(inputs_.view(), oneStep_);

    // The rollout: as the solver, but for what the model has advanced
    if (steps_ == 0)
    {
        first_ = start_;
        rolloutOld_ = start_;
        rollout_ = oneStep_;
        rolloutFinite_ = oneStepFinite_;
        steps_ = 1;
        return;
    }

    std::vector<m4gn_field> view(inputs_.view());

    forAll(outputOfInput_, inputi)
    {
        const label outputi = outputOfInput_[inputi];
        if (outputi < 0)
        {
            continue;
        }

        const word& name = session_.inputs()[inputi];
        const scalarField& cells = rollout_[outputi];
        scalarField& boundary = rolloutBoundary_[inputi];
        const label n = session_.outputComponents(outputi);

        boundary.resize(n*session_.nodes().nBoundary());
        if (n == 1)
        {
            imposeBoundary
            (
                mesh_.lookupObject<volScalarField>(name), cells, boundary
            );
        }
        else
        {
            imposeBoundary
            (
                mesh_.lookupObject<volVectorField>(name), cells, boundary
            );
        }

        view[inputi].boundary = boundary.cdata();
    }

    rolloutOld_ = rollout_;
    forAll(outputOfInput_, inputi)
    {
        if (outputOfInput_[inputi] >= 0)
        {
            view[inputi].cells = rolloutOld_[outputOfInput_[inputi]].cdata();
        }
    }

    rolloutFinite_ = session_.step(view, rollout_);
    ++steps_;
}


void Foam::m4gnObserve::compare(const scalar fraction)
{
    const bool report = Pstream::master() && writeToFile();

    if (report)
    {
        file() << mesh_.time().timeOutputValue() << tab << steps_;
    }

    forAll(start_, i)
    {
        const scalarField now(solverValues(i));
        const label n = mesh_.nCells();
        const label m =
            session_.outputComponents(i) == 1 ? 1 : mesh_.nSolutionD();

        const FixedList<scalar, 4> errors
        ({
            oneStepFinite_
          ? rms(between(start_[i], oneStep_[i], fraction) - now, n, m) : GREAT,
            rms(start_[i] - now, n, m),
            rolloutFinite_
          ? rms(between(rolloutOld_[i], rollout_[i], fraction) - now, n, m) : GREAT,
            rms(first_[i] - now, n, m)
        });
        const scalar size = rms(now, n, m);

        if (report)
        {
            for (const scalar error : errors)
            {
                file() << tab << error;
            }
            file() << tab << size;
        }

        forAll(errors, columni)
        {
            sums_[i][columni] += errors[columni];
        }
    }

    if (report)
    {
        file() << endl;
    }

    ++nTimes_;
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnObserve::m4gnObserve
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    m4gnSession& session
)
:
    writeFile(mesh, name, "surrogateError", dict),
    mesh_(mesh),
    session_(session),
    rolloutSteps_(dict.getOrDefault<label>("rolloutSteps", 50)),
    inputs_(mesh, session.inputs()),
    start_(session.outputs().size()),
    oneStep_(start_.size()),
    first_(start_.size()),
    rolloutOld_(start_.size()),
    rollout_(start_.size()),
    rolloutBoundary_(session.inputs().size()),
    outputOfInput_(session.inputs().size()),
    startTime_(0),
    waiting_(false),
    steps_(0),
    oneStepFinite_(true),
    rolloutFinite_(true),
    sums_(start_.size(), FixedList<scalar, 4>(scalar(0))),
    nTimes_(0)
{
    forAll(outputOfInput_, inputi)
    {
        outputOfInput_[inputi] =
            session.outputs().find(session.inputs()[inputi]);
    }

    if (session.stride() < mesh.time().deltaTValue()*(1 - 1e-6))
    {
        FatalErrorInFunction
            << "The stride of the model " << session.model() << ", "
            << session.stride() << " s, is shorter than the solver's deltaT "
            << mesh.time().deltaTValue() << " s: there is nothing to compare"
            << " with." << exit(FatalError);
    }

    if (Pstream::master() && writeToFile())
    {
        Ostream& os = file();
        writeHeader(os, "Error of the surrogate against the solver");
        writeHeader(os, session.model());
        writeHeaderValue(os, "stride (s)", session.stride());
        writeHeaderValue(os, "rolloutSteps", rolloutSteps_);
        writeCommented(os, "Time");
        writeTabbed(os, "steps");
        for (const word& field : session.outputs())
        {
            for
            (
                const char* column
              : { "oneStep", "hold", "rollout", "holdFirst", "rms" }
            )
            {
                writeTabbed(os, word(column) + '(' + field + ')');
            }
        }
        os  << endl;
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnObserve::execute()
{
    const Time& time = mesh_.time();
    const scalar fraction = (time.value() - startTime_)/session_.stride();

    // Nearest time step of the solver to startTime_ + stride
    const bool arrived =
        fraction > 1 - 0.5*time.deltaTValue()/session_.stride();

    if (waiting_ && !arrived)
    {
        return;
    }

    if (waiting_)
    {
        compare(mag(fraction - 1) < 1e-6 ? scalar(1) : fraction);

        if (steps_ >= rolloutSteps_ || !rolloutFinite_)
        {
            steps_ = 0;
        }
    }

    startTime_ = time.value();
    predict();
    waiting_ = true;
}


void Foam::m4gnObserve::end() const
{
    if (!nTimes_)
    {
        Info<< "m4gn: the run was shorter than a stride; nothing observed"
            << nl << endl;
        return;
    }

    Info<< "m4gn: mean rms errors of the surrogate, over cells and components, at " << nTimes_
        << " times" << nl;

    forAll(sums_, i)
    {
        Info<< "    " << session_.outputs()[i]
            << ": one step " << sums_[i][0]/nTimes_
            << " (hold " << sums_[i][1]/nTimes_ << "), rollout "
            << sums_[i][2]/nTimes_ << " (hold first " << sums_[i][3]/nTimes_
            << ")" << nl;
    }
    Info<< endl;
}


// ************************************************************************* //
