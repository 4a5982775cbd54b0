// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "fixedValueFvPatchFields.H"
#include "fvc.H"
#include "fvm.H"
#include "m4gnDictionary.H"
#include "m4gnMechanicalProperties.H"
#include "solidModel.H"
#include "zeroGradientFvPatchFields.H"

Foam::string Foam::m4gnSolids4FoamLaw::cannotRelax() const
{
#if __has_include("foamPetscSnesHelper.H")
    return "this solids4foam has a Newton-Krylov solver and other equations of its correctors; needed: 2.2";
#endif
    const word& model = solid_->type();

    if (model != "linearGeometryTotalDisplacement"
        && model != "nonLinearGeometryTotalLagrangianTotalDisplacement" && model != "linearGeometry"
        && model != "nonLinearGeometryTotalLagrangian" && model != "nonLinearGeometryUpdatedLagrangian")
    {
        return "solidModel is " + model
               + "; needed: linearGeometry or nonLinearGeometryTotalLagrangian, both also with"
                 " TotalDisplacement, or nonLinearGeometryUpdatedLagrangian";
    }
    if (solvesPressure()) {
        return "a law has solvePressureEqn, whose pressure is no unknown of the correctors; needed:"
               " solvePressureEqn no";
    }
    const label nMaterials = m4gnMechanicalProperties(mesh_).materials().size();
    if (nMaterials != 1) {
        return Foam::name(nMaterials)
               + " materials, whose interface keeps the stress of the corrector before; needed: one";
    }

    return string();
}

Foam::string Foam::m4gnSolids4FoamLaw::cannotStep() const
{
    const string why(cannotRelax());
    if (!why.empty()) {
        return why;
    }

    const solidModel& model = *solid_;
    if (model.solidModelDict().getOrDefault<bool>("predictor", false)) {
        return "entry predictor begins each time step elsewhere; needed: predictor no";
    }
    // It is solved for several times in a time step, with other loads, and before the coupling begins not at all
    if (mesh_.time().foundObject<IOdictionary>("fsiProperties")) {
        return "a fluid loads the solid (fsiProperties); needed: a solid alone";
    }
    const polyMesh& mesh = mesh_;
    if (mesh.type() != "staticFvMesh") {
        return "dynamicFvMesh is " + mesh.type() + "; needed: staticFvMesh";
    }

    // Their gradients are among the unknowns
    static const wordHashSet known(
        {"solidTraction", "solidTractionFree", "solidForce", "analyticalPlateHoleTraction",
         "rigidCylinderContact", "fixedDisplacementZeroShear", "normalDisplacementZeroShear",
         "displacementOrTraction"});
    for (const fvPatchVectorField& patch : solid_->solutionD().boundaryField()) {
        // The values of these follow from the time and the cells
        const bool follows = polyPatch::constraintType(patch.patch().type())
                             || isA<fixedValueFvPatchVectorField>(patch)
                             || isA<zeroGradientFvPatchVectorField>(patch);
        if (!follows && !known.found(patch.type())) {
            return "it is unknown what condition " + patch.type() + " of the patch " + patch.patch().name()
                   + " keeps from one corrector to the next; needed: a condition of fixed values, or one of "
                   + m4gn::join(known.sortedToc());
        }
    }

    return string();
}

bool Foam::m4gnSolids4FoamLaw::relax(const vectorField& free, const scalar duration, const scalar tolerance)
{
    solidModel& solid = *solid_;
    const solidModel& model = solid;
    volVectorField& u = solid.solutionD();
    const volScalarField& rho = model.rho();
    const scalar size = max(gMax(mag(solid.D().primitiveField())()), VSMALL);

    const volScalarField inertia("inertia", rho / sqr(dimensionedScalar("duration", dimTime, duration)));
    volVectorField target("target", u);
    target.primitiveFieldRef() = free;

    return correct(
               [&]() { return fvm::Sp(inertia, u) - inertia * target - rho * model.g(); },
               [&]() { return tolerance * size; })
           >= 0;
}

Foam::label Foam::m4gnSolids4FoamLaw::step(const label most)
{
    solidModel& solid = *solid_;
    const solidModel& model = solid;
    volVectorField& u = solid.solutionD();
    const volScalarField& rho = model.rho();
    const volVectorField& oldD = solid.D().oldTime();

    const scalar tolerance = model.solidProperties()
                                 .subOrEmptyDict(solid.type() + "Coeffs")
                                 .getOrDefault<scalar>("alternativeTolerance", 1e-7);

    autoPtr<volScalarField> moved;
    if (solid.movingMesh()) {
        // The model keeps the density of its moved mesh to itself, but for its
        // old levels: it is that of the time step before over relJ, and it
        // becomes the old level when the next time step begins
        const auto* old = mesh_.findObject<volScalarField>("rho_0");
        moved.reset(new volScalarField(
            IOobject("rho", mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false),
            old ? *old / mesh_.lookupObject<volScalarField>("relJ") : tmp<volScalarField>(rho)));
        if (old) {
            moved->oldTime().oldTime() == *old;
        }
    }

    // The only model that has it
    const bool damped =
        solid.type() == "linearGeometryTotalDisplacement" && model.dampingCoeff().value() > SMALL;

    const auto inertiaAndWeight = [&]() -> tmp<fvVectorMatrix> {
        if (!solid.incremental()) {
            tmp<fvVectorMatrix> equation(rho * fvm::d2dt2(u) - rho * model.g());
            if (damped) {
                equation.ref() += model.dampingCoeff() * rho * fvm::ddt(u);
            }
            return equation;
        }
        if (solid.movingMesh()) {
            return fvm::d2dt2(moved(), u) + fvc::d2dt2(moved(), oldD) - moved() * model.g();
        }
        if (solid.nonLinGeom() == nonLinearGeometry::LINEAR_GEOMETRY) {
            return rho * fvm::d2dt2(u) + mesh_.lookupObject<volVectorField>("rhoD2dt2D").oldTime()
                   - rho * model.g();
        }
        return rho * fvm::d2dt2(u) + rho * fvc::d2dt2(oldD) - rho * model.g();
    };

    // As solids4foam's own measure, of the motion in the time step
    const auto largest = [&]() {
        const vectorField& now = u.primitiveField();
        const scalar motion =
            solid.incremental() ? gMax(mag(now)()) : gMax(mag(now - u.oldTime().primitiveField())());

        return tolerance * max(motion < SMALL ? gMax(mag(now)()) : motion, SMALL);
    };

    return correct(inertiaAndWeight, largest, most);
}
