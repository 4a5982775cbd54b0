// SPDX-License-Identifier: GPL-3.0-or-later

#include "obstacleTractionFvPatchVectorField.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnExplicitStress.H"
#include "m4gnObstacles.H"
#include "Time.H"
#include "volFields.H"

void Foam::obstacleTractionFvPatchVectorField::checkAtRest()
{
    // Of a cell's half
    const scalar tolerance = 0.05;

    if (checked_) {
        return;
    }
    checked_ = true;

    if (size() && max(mag(primitiveField())) > 0) {
        return;
    }

    scalarField gap;
    vectorField normal;
    gaps(displacement(), db().time().startTime().value(), gap, normal);

    forAll(gap, facei) {
        if (-gap[facei] * patch().deltaCoeffs()[facei] > tolerance) {
            FatalErrorInFunction << "The patch " << patch().name() << " is " << -gap[facei]
                                 << " m inside of an obstacle (constant/" << m4gnObstacles::fileNameOf
                                 << ") at " << patch().Cf()[facei] << " when the run begins" << nl
                                 << "    Let the obstacle begin outside of the body" << exit(FatalError);
        }
    }
}

void Foam::obstacleTractionFvPatchVectorField::gaps(
    const vectorField& displacement, const scalar time, scalarField& gap, vectorField& normal) const
{
    const fvMesh& mesh = patch().boundaryMesh().mesh();

    // No face is further inside than the whole body is long
    m4gnObstacles::of(mesh).gaps(patch().Cf() + displacement, time, mesh.bounds().mag(), gap, normal);
}

Foam::obstacleTractionFvPatchVectorField::obstacleTractionFvPatchVectorField(
    const fvPatch& p, const DimensionedField<vector, volMesh>& iF)
    : linearisedTractionFvPatchVectorField(p, iF), penaltyFactor_(1), checked_(false)
{}

Foam::obstacleTractionFvPatchVectorField::obstacleTractionFvPatchVectorField(
    const fvPatch& p, const DimensionedField<vector, volMesh>& iF, const dictionary& dict)
    : linearisedTractionFvPatchVectorField(p, iF, dict),
      penaltyFactor_(dict.getOrDefault<scalar>("penaltyFactor", 1)), checked_(false)
{
    if (penaltyFactor_ <= 0) {
        FatalIOErrorInFunction(dict) << "Entry penaltyFactor is " << penaltyFactor_
                                     << "; expected a number above 0" << exit(FatalIOError);
    }
}

Foam::obstacleTractionFvPatchVectorField::obstacleTractionFvPatchVectorField(
    const obstacleTractionFvPatchVectorField& other, const fvPatch& p,
    const DimensionedField<vector, volMesh>& iF, const fvPatchFieldMapper& mapper)
    : linearisedTractionFvPatchVectorField(other, p, iF, mapper), penaltyFactor_(other.penaltyFactor_),
      checked_(other.checked_)
{}

Foam::obstacleTractionFvPatchVectorField::obstacleTractionFvPatchVectorField(
    const obstacleTractionFvPatchVectorField& other, const DimensionedField<vector, volMesh>& iF)
    : linearisedTractionFvPatchVectorField(other, iF), penaltyFactor_(other.penaltyFactor_),
      checked_(other.checked_)
{}

Foam::obstacleTractionFvPatchVectorField::obstacleTractionFvPatchVectorField(
    const obstacleTractionFvPatchVectorField& other)
    : obstacleTractionFvPatchVectorField(other, other.internalField())
{}

void Foam::obstacleTractionFvPatchVectorField::contact(
    const vectorField& displacement, scalarField& stiffness, scalarField& gap, vectorField& normal) const
{
    gaps(displacement, db().time().value(), gap, normal);
    stiffness = neg(gap) * penaltyFactor_ * patch().deltaCoeffs();
}

void Foam::obstacleTractionFvPatchVectorField::updateCoeffs()
{
    if (updated()) {
        return;
    }

    checkAtRest();

    scalarField penalty, gap;
    vectorField normal;
    contact(displacement(), penalty, gap, normal);

    // As solidDisplacementFoam's tractionDisplacement
    const auto& rho = patch().lookupPatchField<volScalarField, scalar>("rho");
    const scalarField E(patch().lookupPatchField<volScalarField, scalar>("E") / rho);
    const scalarField& nu = patch().lookupPatchField<volScalarField, scalar>("nu");
    const auto& sigmaD = patch().lookupPatchField<volSymmTensorField, symmTensor>("sigmaD");
    const bool planeStress = db().lookupObject<IOdictionary>("mechanicalProperties").get<bool>("planeStress");

    const scalarField stiffness(
        2 * m4gnExplicitStress::shearModulus(E, nu) + m4gnExplicitStress::lambda(E, nu, planeStress));

    linearise(
        -penalty * gap * normal, penalty * cmptMultiply(normal, normal), (patch().nf() & sigmaD) / stiffness);

    linearisedTractionFvPatchVectorField::updateCoeffs();
}

void Foam::obstacleTractionFvPatchVectorField::write(Ostream& os) const
{
    fvPatchVectorField::write(os);
    os.writeEntryIfDifferent<scalar>("penaltyFactor", 1, penaltyFactor_);
    writeEntry("value", os);
}

namespace Foam
{
makePatchTypeField(fvPatchVectorField, obstacleTractionFvPatchVectorField);
}
