// SPDX-License-Identifier: GPL-3.0-or-later

#include "linearisedTractionFvPatchVectorField.H"
#include "addToRunTimeSelectionTable.H"
#include "fvPatchFieldMapper.H"
#include "volFields.H"

Foam::tmp<Foam::vectorField> Foam::linearisedTractionFvPatchVectorField::gradientNow() const
{
    return explicit_ - cmptMultiply(implicit_, patchInternalField());
}

Foam::linearisedTractionFvPatchVectorField::linearisedTractionFvPatchVectorField(
    const fvPatch& p, const DimensionedField<vector, volMesh>& iF)
    : fixedGradientFvPatchVectorField(p, iF), explicit_(p.size(), Zero), implicit_(p.size(), Zero)
{
    fvPatchVectorField::operator=(patchInternalField());
    gradient() = Zero;
}

Foam::linearisedTractionFvPatchVectorField::linearisedTractionFvPatchVectorField(
    const fvPatch& p, const DimensionedField<vector, volMesh>& iF, const dictionary& dict)
    : fixedGradientFvPatchVectorField(p, iF), explicit_(p.size(), Zero), implicit_(p.size(), Zero)
{
    const vectorField inside(patchInternalField());

    fvPatchVectorField::operator=(dict.found("value") ? vectorField("value", dict, p.size()) : inside);
    gradient() = p.deltaCoeffs() * (*this - inside);
    explicit_ = gradient();
}

Foam::linearisedTractionFvPatchVectorField::linearisedTractionFvPatchVectorField(
    const linearisedTractionFvPatchVectorField& other, const fvPatch& p,
    const DimensionedField<vector, volMesh>& iF, const fvPatchFieldMapper& mapper)
    : fixedGradientFvPatchVectorField(other, p, iF, mapper), explicit_(other.explicit_, mapper),
      implicit_(other.implicit_, mapper)
{}

Foam::linearisedTractionFvPatchVectorField::linearisedTractionFvPatchVectorField(
    const linearisedTractionFvPatchVectorField& other, const DimensionedField<vector, volMesh>& iF)
    : fixedGradientFvPatchVectorField(other, iF), explicit_(other.explicit_), implicit_(other.implicit_)
{}

Foam::linearisedTractionFvPatchVectorField::linearisedTractionFvPatchVectorField(
    const linearisedTractionFvPatchVectorField& other)
    : linearisedTractionFvPatchVectorField(other, other.internalField())
{}

Foam::tmp<Foam::vectorField> Foam::linearisedTractionFvPatchVectorField::displacement() const
{
    return patchInternalField() + gradient() / patch().deltaCoeffs();
}

void Foam::linearisedTractionFvPatchVectorField::linearise(
    const vectorField& traction, const vectorField& slope, const vectorField& stress)
{
    const vectorField D(displacement());

    forAll(D, facei) {
        const vector full(traction[facei] + gradient()[facei] - stress[facei]);

        for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
            // The face moves with its cell, and with the gradient itself
            const scalar share = 1 / (1 + slope[facei][cmpt] / patch().deltaCoeffs()[facei]);

            implicit_[facei][cmpt] = slope[facei][cmpt] * share;
            explicit_[facei][cmpt] = (full[cmpt] + slope[facei][cmpt] * D[facei][cmpt]) * share;
        }
    }

    gradient() = gradientNow();
}

void Foam::linearisedTractionFvPatchVectorField::autoMap(const fvPatchFieldMapper& mapper)
{
    fixedGradientFvPatchVectorField::autoMap(mapper);
    explicit_.autoMap(mapper);
    implicit_.autoMap(mapper);
}

void Foam::linearisedTractionFvPatchVectorField::rmap(
    const fvPatchVectorField& other, const labelList& addressing)
{
    fixedGradientFvPatchVectorField::rmap(other, addressing);

    const auto& own = refCast<const linearisedTractionFvPatchVectorField>(other);
    explicit_.rmap(own.explicit_, addressing);
    implicit_.rmap(own.implicit_, addressing);
}

void Foam::linearisedTractionFvPatchVectorField::evaluate(const Pstream::commsTypes commsType)
{
    if (!updated()) {
        updateCoeffs();
    }

    gradient() = gradientNow();
    fixedGradientFvPatchVectorField::evaluate(commsType);
}

Foam::tmp<Foam::vectorField> Foam::linearisedTractionFvPatchVectorField::gradientInternalCoeffs() const
{
    return -implicit_;
}

Foam::tmp<Foam::vectorField> Foam::linearisedTractionFvPatchVectorField::gradientBoundaryCoeffs() const
{
    return tmp<vectorField>::New(explicit_);
}

void Foam::linearisedTractionFvPatchVectorField::write(Ostream& os) const
{
    fvPatchVectorField::write(os);
    writeEntry("value", os);
}

namespace Foam
{
makePatchTypeField(fvPatchVectorField, linearisedTractionFvPatchVectorField);
}
