// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnTimeStep.H"
#include "Time.H"
#include "m4gnFieldSet.H"
#include "m4gnOwnField.H"
#include "volFields.H"

namespace Foam
{
namespace m4gnTimeStep
{
const word fieldName("deltaT");

//- In the header's note: whose field it is, and whether it keeps its value
static const char* const mark = "the solver's time step, by m4gn";
static const char* const kept = "the solver's time step, by m4gn, held";

} // End namespace m4gnTimeStep
} // End namespace Foam

void Foam::m4gnTimeStep::provide(const fvMesh& mesh, const word& name)
{
    if (name != fieldName)
    {
        return;
    }

    if (auto* field = m4gnOwnField::get<scalar>(mesh, fieldName, dimTime, mark))
    {
        *field ==
            dimensionedScalar(fieldName, dimTime, mesh.time().deltaTValue());
    }
}

Foam::m4gnTimeStep::held::held(const fvMesh& mesh, const m4gnFieldSet& fields)
:
    field_(nullptr)
{
    for (label fieldi = 0; fieldi < fields.size(); ++fieldi)
    {
        if (fields.name(fieldi) == fieldName)
        {
            provide(mesh, fieldName);
            field_ = mesh.getObjectPtr<volScalarField>(fieldName);
        }
    }

    if (field_ && field_->note() == mark)
    {
        field_->note() = kept;
    }
    else
    {
        field_ = nullptr;
    }
}

Foam::m4gnTimeStep::held::~held()
{
    if (field_)
    {
        field_->note() = mark;
    }
}
