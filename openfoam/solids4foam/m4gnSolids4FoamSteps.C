// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "fvc.H"
#include "fvm.H"
#include "solidModel.H"

bool Foam::m4gnSolids4FoamLaw::relaxes() const
{
    if (!atPoints()) {
        return steps();
    }

    // The other algorithms do not take a step of any length
    const solidModel& model = *solid_;

    return model.solidModelDict().get<word>("solutionAlgorithm") == "implicitCoupled";
}

bool Foam::m4gnSolids4FoamLaw::steps() const
{
    const word& model = solid_->type();

    // A pressure that the law solves for is no unknown of the correctors, nor
    // is the stress at the interface of two materials, which keeps its last
    return !solvesPressure() && laws().size() == 1
           && (model == "linearGeometryTotalDisplacement"
               || model == "nonLinearGeometryTotalLagrangianTotalDisplacement" || model == "linearGeometry"
               || model == "nonLinearGeometryTotalLagrangian"
               || model == "nonLinearGeometryUpdatedLagrangian");
}

bool Foam::m4gnSolids4FoamLaw::relax(const vectorField& free, const scalar duration, const scalar tolerance)
{
    if (atPoints()) {
        return relaxPoints(free, duration, tolerance);
    }

    solidModel& solid = *solid_;
    const solidModel& model = solid;
    volVectorField& u = solid.solutionD();
    const scalar size = max(gMax(mag(solid.D().primitiveField())()), VSMALL);

    return asOneIncrement([&]() {
        // Of the mesh that the increment begins from
        volScalarField rho("rho", model.rho());
        if (solid.movingMesh()) {
            rho /= mesh_.lookupObject<volScalarField>("J").oldTime();
        }
        const volScalarField inertia("inertia", rho / sqr(dimensionedScalar("duration", dimTime, duration)));
        volVectorField target("target", u);
        target.primitiveFieldRef() = free;
        if (solid.incremental()) {
            target.primitiveFieldRef() -= solid.D().oldTime().primitiveField();
        }

        return correct(
                   [&]() { return fvm::Sp(inertia, u) - inertia * target - rho * model.g(); },
                   [&]() { return tolerance * size; })
               >= 0;
    });
}

Foam::label Foam::m4gnSolids4FoamLaw::step()
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

    const auto inertiaAndWeight = [&]() -> tmp<fvVectorMatrix> {
        if (!solid.incremental()) {
            return rho * fvm::d2dt2(u) - rho * model.g();
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

    return correct(inertiaAndWeight, largest);
}
