// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnObservedErrors.H"
#include "m4gnSegmentField.H"
#include "Time.H"

template<class Type>
void Foam::m4gnObservedErrors::writeField(const label outputi) const
{
    tmp<GeometricField<Type, fvPatchField, volMesh>> tfield
    (
        m4gn::cellField<Type>
        (
            mesh_,
            "error(" + outputs_.name(outputi) + ')',
            mesh_.time().timeName()
        )
    );
    auto& field = tfield.ref();

    const scalarField& error = errors_[outputi];
    std::copy
    (
        error.cbegin(),
        error.cend(),
        reinterpret_cast<scalar*>(field.primitiveFieldRef().data())
    );
    field.correctBoundaryConditions();
    const FixedList<int32_t, 7>& e = outputs_.dimensions(outputi);
    field.dimensions().reset(dimensionSet(e[0], e[1], e[2], e[3], e[4], e[5], e[6]));
    field.note() =
        "m4gn: the surrogate's " + outputs_.name(outputi) + " at time " + timeName_
      + " minus the solver's";
    field.write();
}

Foam::m4gnObservedErrors::m4gnObservedErrors
(
    const word& name,
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session,
    const m4gnFieldSet& outputs
)
:
    writeFile(mesh, name, "surrogateSegmentError", dict),
    mesh_(mesh),
    outputs_(outputs),
    segments_
    (
        m4gn_session_n_segments(session.handle()) > 0
      ? session.segments()
      : List<int32_t>(mesh.nCells(), 0)
    ),
    nCells_(max(m4gn_session_n_segments(session.handle()), 1), Zero)
{
    for (const int32_t segmenti : segments_)
    {
        ++nCells_[segmenti];
    }
    Pstream::listCombineGather(nCells_, plusEqOp<scalar>());

    if (Pstream::master() && writeToFile())
    {
        Ostream& os = file();
        writeHeader(os, "Error of the surrogate's rollout in each segment");
        writeHeader(os, session.model());
        writeCommented(os, "Time");
        for (const word& field : session.outputs())
        {
            forAll(nCells_, segmenti)
            {
                writeTabbed(os, field + ':' + Foam::name(segmenti));
            }
        }
        os  << endl;
    }
}

void Foam::m4gnObservedErrors::set(List<scalarField>&& errors)
{
    errors_ = std::move(errors);
    timeName_ = mesh_.time().timeName();

    const bool report = Pstream::master() && writeToFile();
    if (report)
    {
        file() << mesh_.time().timeOutputValue();
    }

    forAll(errors_, outputi)
    {
        const label n = outputs_.components(outputi);
        const scalarField& error = errors_[outputi];
        List<scalar> sums(nCells_.size(), Zero);

        forAll(error, i)
        {
            sums[segments_[i/n]] += sqr(error[i]);
        }
        Pstream::listCombineGather(sums, plusEqOp<scalar>());

        const label nSolved = n == 1 ? 1 : mesh_.nSolutionD();
        if (report)
        {
            forAll(sums, segmenti)
            {
                const scalar size = max(nSolved*nCells_[segmenti], scalar(1));
                file() << tab << std::sqrt(sums[segmenti]/size);
            }
        }
    }

    if (report)
    {
        file() << endl;
    }
}

void Foam::m4gnObservedErrors::write() const
{
    if (!mesh_.time().writeTime())
    {
        return;
    }

    forAll(errors_, outputi)
    {
        if (outputs_.components(outputi) == 1)
        {
            writeField<scalar>(outputi);
        }
        else
        {
            writeField<vector>(outputi);
        }
    }
}
