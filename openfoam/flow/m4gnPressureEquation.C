// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPressureEquation.H"
#include "m4gnLaplacian.H"
#include "adjustPhi.H"
#include "constrainHbyA.H"
#include "constrainPressure.H"
#include "findRefCell.H"
#include "fvcDiv.H"
#include "fvcFlux.H"
#include "fvmDiv.H"
#include "surfaceInterpolate.H"

const Foam::dictionary& Foam::m4gnPressureEquation::algorithm(const fvMesh& mesh)
{
    for (const char* name : {"PISO", "PIMPLE", "SIMPLE"}) {
        if (const auto* found = mesh.solutionDict().findDict(name)) {
            return *found;
        }
    }
    return dictionary::null;
}

namespace
{
//- The viscosity's dictionary, if it has a constant one
const Foam::dictionary* constantViscosity(const Foam::fvMesh& mesh)
{
    const auto* properties = mesh.findObject<Foam::dictionary>("transportProperties");

    return properties && properties->found("nu")
                   && properties->getOrDefault<Foam::word>("transportModel", "Newtonian") == "Newtonian"
               ? properties
               : nullptr;
}

} // End anonymous namespace

Foam::string Foam::m4gnPressureEquation::obstacle(const volScalarField& p) const
{
    if (p.dimensions() != dimPressure / dimDensity) {
        return "the pressure " + p.name() + " is not divided by the density";
    }
    if (!constantViscosity(mesh_)) {
        return "transportProperties has no constant viscosity nu";
    }
    if (mesh_.foundObject<volScalarField>("nut")) {
        return "there is a turbulence model";
    }
    for (const char* name : {"fvOptions", "MRFProperties"}) {
        const auto* sources = mesh_.findObject<dictionary>(name);
        if (sources && sources->size()) {
            return string("there are ") + name;
        }
    }
    return string();
}

Foam::m4gnPressureEquation::m4gnPressureEquation(
    const volScalarField& p, const dictionary& dict, const bool preferred)
    : mesh_(p.mesh()), solved_(false)
{
    const string found(obstacle(p));
    const word wanted(
        dict.getOrDefault<word>("pressure", preferred && found.empty() ? "solved" : "predicted"));

    if (wanted != "solved" && wanted != "predicted") {
        FatalIOErrorInFunction(dict) << "pressure: expected solved or predicted, found " << wanted
                                     << exit(FatalIOError);
    }

    solved_ = wanted == "solved";

    if (solved_ && !found.empty()) {
        FatalIOErrorInFunction(dict) << "pressure solved: the pressure of a velocity is known by"
                                     << " convection and a constant viscosity alone, and " << found.c_str()
                                     << nl << "    Say pressure predicted; or leave the entry out"
                                     << exit(FatalIOError);
    }
}

void Foam::m4gnPressureEquation::solve(
    const volVectorField& U, const surfaceScalarField& phi, const scalar deltaT, volScalarField& p) const
{
    const dimensionedScalar nu("nu", dimViscosity, *constantViscosity(mesh_));
    const dimensionedScalar rDeltaT("rDeltaT", dimless / dimTime, 1 / deltaT);
    const surfaceScalarField viscosity(m4gnLaplacian::uniform(mesh_, "m4gnViscosity", nu));
    const auto diffusion(m4gnLaplacian::scheme<vector>(mesh_));
    const fvVectorMatrix UEqn(fvm::div(phi, U) - diffusion.constCast().fvmLaplacian(viscosity, U));

    const volScalarField rAU("m4gnRAU", 1 / (UEqn.A() + rDeltaT));
    const volVectorField HbyA(constrainHbyA(rAU * (UEqn.H() + rDeltaT * U), U, p));
    const surfaceScalarField rAUf(fvc::interpolate(rAU, "interpolate(1|A)"));
    surfaceScalarField phiHbyA("phiHbyA", fvc::flux(HbyA) + rAUf * rDeltaT * (phi - fvc::flux(U)));

    const dictionary& controls = algorithm(mesh_);
    label referenceCell = -1;
    scalar reference = 0;

    if (p.needReference()) {
        adjustPhi(phiHbyA, U, p);
        setRefCell(p, controls, referenceCell, reference);
    }
    constrainPressure(p, U, phiHbyA, rAU);

    const auto laplacian(m4gnLaplacian::scheme<scalar>(mesh_));

    dictionary linearSolver(mesh_.solverDict(p.select(true)));
    // What is predicted is near: a tolerance of its own residual would do
    // nothing, and the solver's is of single steps
    linearSolver.set("relTol", scalar(1e-3));

    const label nCorrectors = controls.getOrDefault<label>("nNonOrthogonalCorrectors", 0);

    for (label corri = 0; corri <= nCorrectors; ++corri) {
        fvScalarMatrix pEqn(laplacian.constCast().fvmLaplacian(rAUf, p) == fvc::div(phiHbyA));

        pEqn.setReference(referenceCell, reference);
        pEqn.solve(linearSolver);
    }
}
