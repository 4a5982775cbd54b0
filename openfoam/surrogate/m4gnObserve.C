// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnObserve.H"
#include "directionMixedFvPatchFields.H"
#include "mixedFvPatchFields.H"
#include "Time.H"

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
    shadow_.begin();

    // The rollout: as the solver, but for what the model has advanced
    if (steps_ == 0)
    {
        if (expected_)
        {
            if (!measured_)
            {
                // Nothing can be expected yet
                return;
            }
            expect();
        }
        first_ = shadow_.start();
        rolloutOld_ = shadow_.start();
        rollout_ = shadow_.predicted();
        rolloutFinite_ = shadow_.finite();
        steps_ = 1;
        return;
    }

    std::vector<m4gn_field> view(shadow_.inputs().view());

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
            imposeBoundary(mesh_.lookupObject<volScalarField>(name), cells, boundary);
        }
        else
        {
            imposeBoundary(mesh_.lookupObject<volVectorField>(name), cells, boundary);
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

void Foam::m4gnObserve::expect()
{
    forAll(estimates_, i)
    {
        estimates_[i] = expected_->after(i + 1);
    }

    scalar error, estimate;
    allowed_ = expected_->steps(estimates_.size(), error, estimate);

    if (!allowed_)
    {
        ++nRefused_;
    }
}

void Foam::m4gnObserve::judge(const List<scalar>& errors)
{
    const scalar error = expected_->relative(errors);
    const scalar estimate = estimates_[steps_ - 1];

    if (Pstream::master() && writeToFile())
    {
        file() << tab << error << tab << estimate;
    }

    if (steps_ == allowed_)
    {
        ++nJumps_;
        nAllowed_ += allowed_;
        if (error <= tolerance_)
        {
            ++nWithin_;
        }
    }
}

void Foam::m4gnObserve::compare()
{
    const scalar fraction = shadow_.fraction();
    const List<scalarField> solver(shadow_.now());
    const std::vector<m4gn_stride_error> oneStep(shadow_.compare(solver));

    if (expected_)
    {
        expected_->measure(oneStep);
        measured_ = true;
    }

    if (!steps_)
    {
        return;
    }

    const bool report = Pstream::master() && writeToFile();
    List<scalar> rolloutErrors(solver.size());
    List<scalarField> differences(solver.size());

    if (report)
    {
        file() << mesh_.time().timeOutputValue() << tab << steps_;
    }

    forAll(solver, i)
    {
        scalarField& rollout = differences[i];
        rollout =
            m4gnShadow::between(rolloutOld_[i], rollout_[i], fraction)
          - solver[i];
        const FixedList<scalar, 4> errors
        ({
            oneStep[i].error,
            oneStep[i].change,
            rolloutFinite_ ? shadow_.rms(rollout, i) : GREAT,
            shadow_.rms(first_[i] - solver[i], i)
        });
        const scalar size = oneStep[i].size;
        rolloutErrors[i] = errors[2];

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

    if (expected_)
    {
        judge(rolloutErrors);
    }

    if (report)
    {
        file() << endl;
    }

    if (errors_ && rolloutFinite_)
    {
        errors_->set(std::move(differences));
    }

    ++nTimes_;
}

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
    shadow_(mesh, session),
    rolloutBoundary_(session.inputs().size()),
    outputOfInput_(session.inputs().size()),
    steps_(0),
    rolloutFinite_(true),
    sums_(session.outputs().size(), FixedList<scalar, 4>(scalar(0))),
    nTimes_(0),
    tolerance_(0),
    estimates_(rolloutSteps_),
    measured_(false),
    allowed_(0),
    nJumps_(0),
    nRefused_(0),
    nWithin_(0),
    nAllowed_(0)
{
    if (m4gnObservedErrors::wanted(dict))
    {
        errors_.reset(new m4gnObservedErrors(name, mesh, dict, session, shadow_.outputs()));
    }
    if (m4gnEstimate::wanted(dict))
    {
        // An observer ends no run
        dictionary control(dict.subDict("control"));
        control.set("onFailure", "solver");
        expected_.reset(new m4gnEstimate(control, session));
        tolerance_ = control.get<scalar>("tolerance");
    }

    forAll(outputOfInput_, inputi)
    {
        outputOfInput_[inputi] =
            session.outputs().find(session.inputs()[inputi]);
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
        if (expected_)
        {
            writeTabbed(os, "error");
            writeTabbed(os, "estimate");
        }
        os  << endl;
    }
}

void Foam::m4gnObserve::execute()
{
    const bool arrived = shadow_.arrived();

    if (arrived)
    {
        compare();

        if (steps_ >= rolloutSteps_ || !rolloutFinite_)
        {
            steps_ = 0;
        }
    }

    if (errors_)
    {
        errors_->write();
    }

    if (arrived || !shadow_.waiting())
    {
        predict();
    }
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
    if (expected_)
    {
        Info<< "    control would have let " << nJumps_ << " rollouts go as"
            << " jumps, of " << scalar(nAllowed_)/max(nJumps_, label(1))
            << " steps in the mean: the error at the end of " << nWithin_
            << " of them was within the tolerance " << tolerance_ << "; at "
            << nRefused_ << " other starts it would have let none go" << nl;
    }
    Info<< endl;
}
