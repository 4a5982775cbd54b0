// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnShadow.H"
#include "Time.H"

Foam::m4gnShadow::m4gnShadow(const fvMesh& mesh, m4gnSession& session)
:
    mesh_(mesh),
    session_(session),
    inputs_(mesh, session.inputs()),
    outputs_(mesh, session.outputs()),
    startTime_(0),
    waiting_(false),
    finite_(true)
{
    if (session.stride() < mesh.time().deltaTValue()*(1 - 1e-6))
    {
        FatalErrorInFunction
            << "The stride of the model " << session.model() << ", "
            << session.stride() << " s, is shorter than the solver's deltaT "
            << mesh.time().deltaTValue() << " s: there is nothing to compare"
            << " with." << exit(FatalError);
    }
}

void Foam::m4gnShadow::begin()
{
    inputs_.gather(session_.nodes());
    start_ = now();
    predicted_ = start_;
    finite_ = session_.step(inputs_.view(), predicted_);
    startTime_ = mesh_.time().value();
    waiting_ = true;
}

bool Foam::m4gnShadow::arrived() const
{
    return
        waiting_
     && fraction() > 1 - 0.5*mesh_.time().deltaTValue()/session_.stride();
}

Foam::scalar Foam::m4gnShadow::fraction() const
{
    const scalar fraction =
        (mesh_.time().value() - startTime_)/session_.stride();

    return mag(fraction - 1) < 1e-6 ? scalar(1) : fraction;
}

Foam::List<Foam::scalarField> Foam::m4gnShadow::now()
{
    return outputs_.values(session_.nodes());
}

std::vector<m4gn_stride_error> Foam::m4gnShadow::compare(const List<scalarField>& solver)
{
    std::vector<m4gn_stride_error> errors(solver.size());

    forAll(solver, i)
    {
        const scalarField error(between(start_[i], predicted_[i], fraction()) - solver[i]);
        errors[i].error = finite_ ? rms(error, i) : GREAT;
        errors[i].change = rms(solver[i] - start_[i], i);
        errors[i].size = rms(solver[i], i);
    }
    waiting_ = false;

    return errors;
}

void Foam::m4gnShadow::writeState(Ostream& os) const
{
    if (!waiting_)
    {
        return;
    }

    os.beginBlock("stride");
    List<scalar>(1, startTime_).writeEntry("begun", os);
    os.writeEntry("finite", Switch(finite_));
    forAll(start_, i)
    {
        const word& name = session_.outputs()[i];
        start_[i].writeEntry("start(" + name + ')', os);
        predicted_[i].writeEntry("predicted(" + name + ')', os);
    }
    os.endBlock();
}

void Foam::m4gnShadow::restore(const dictionary& state)
{
    if (!state.found("stride"))
    {
        return;
    }

    const dictionary& stride = state.subDict("stride");

    startTime_ = stride.get<List<scalar>>("begun").first();
    finite_ = stride.get<bool>("finite");
    start_.resize(session_.outputs().size());
    predicted_.resize(start_.size());
    forAll(start_, i)
    {
        const word& name = session_.outputs()[i];
        const label size =
            session_.outputComponents(i)*session_.nodes().size();

        start_[i] = scalarField("start(" + name + ')', stride, size);
        predicted_[i] = scalarField("predicted(" + name + ')', stride, size);
    }
    waiting_ = true;
}

Foam::tmp<Foam::scalarField> Foam::m4gnShadow::between
(
    const scalarField& old,
    const scalarField& now,
    const scalar fraction
)
{
    return old + fraction*(now - old);
}

Foam::scalar Foam::m4gnShadow::rms(const scalarField& values, const label outputi) const
{
    const label nSolved =
        session_.outputComponents(outputi) == 1 ? 1 : mesh_.nSolutionD();
    const label n =
        nSolved*returnReduce(session_.nodes().size(), sumOp<label>());

    return std::sqrt(gSumSqr(values)/n);
}
