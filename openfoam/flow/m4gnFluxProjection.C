// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnFluxProjection.H"
#include "m4gnDictionary.H"
#include "m4gnLaplacian.H"
#include "adjustPhi.H"
#include "fixedValueFvPatchFields.H"
#include "fvcDiv.H"
#include "fvcFlux.H"
#include "fvcGrad.H"
#include "IOMRFZoneList.H"
#include "zeroGradientFvPatchFields.H"

Foam::dictionary Foam::m4gnFluxProjection::solverControls(const word& pressureName, const bool handOver) const
{
    const dictionary solvers(mesh_.lookupObject<IOdictionary>("fvSolution").subOrEmptyDict("solvers"));

    dictionary controls(mesh_.solverDict(solvers.found("pcorr") ? "pcorr" : pressureName));

    const scalar given = controls.getOrDefault<scalar>("tolerance", 1e-6);

    // In the strides before, what enters and what leaves are as equal as at
    // the solver's own steps
    controls.set("relTol", scalar(handOver ? 0 : 1e-7));
    controls.set("tolerance", tolerance_ > 0 ? tolerance_ : min(given, 1e-9));

    return controls;
}

Foam::m4gnFluxProjection::m4gnFluxProjection(const fvMesh& mesh, const dictionary& dict)
    : mesh_(mesh), nCorrectors_(0), tolerance_(-1)
{
    const dictionary own(dict.subOrEmptyDict("projection"));

    m4gn::checkKeys(own, {"nCorrectors", "tolerance", "pressure"}, false);

    nCorrectors_ = own.getOrDefault<label>("nCorrectors", 0);
    m4gn::checkAtLeast(own, "nCorrectors", nCorrectors_, 0);

    if (own.readIfPresent("tolerance", tolerance_)) {
        m4gn::checkAtLeast(own, "tolerance", tolerance_, VSMALL);
    }
}

void Foam::m4gnFluxProjection::interpolate(const volVectorField& U, surfaceScalarField& phi)
{
    phi = fvc::flux(U);

    // As solvers have it in rotating zones
    if (const auto* zones = U.mesh().findObject<IOMRFZoneList>("MRFProperties")) {
        zones->makeRelative(phi);
    }
}

void Foam::m4gnFluxProjection::project(
    const volScalarField& p, volVectorField& U, surfaceScalarField& phi, const bool handOver) const
{
    wordList types(p.boundaryField().size(), "zeroGradient");

    forAll(types, patchi) {
        if (p.boundaryField()[patchi].fixesValue()) {
            types[patchi] = "fixedValue";
        }
    }

    // m^2/s: phi = U S, and Laplacian(pcorr) = div(phi)
    volScalarField pcorr(
        IOobject("pcorr", mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false),
        mesh_, dimensionedScalar(U.dimensions() * dimLength, Zero), types);

    if (pcorr.needReference()) {
        adjustPhi(phi, U, pcorr);
    }

    mesh_.setFluxRequired(pcorr.name());

    const surfaceScalarField one(
        m4gnLaplacian::uniform(mesh_, "m4gnOne", dimensionedScalar("one", dimless, 1)));
    const auto laplacian(m4gnLaplacian::scheme<scalar>(mesh_));

    const dictionary controls(solverControls(p.name(), handOver));

    // One cell of all ranks: setReference fixes one on each that names one
    const label first = returnReduce(mesh_.nCells() ? Pstream::myProcNo() : labelMax, minOp<label>());
    const label referenceCell = Pstream::myProcNo() == first ? 0 : -1;

    for (label corri = 0; corri <= nCorrectors_; ++corri) {
        fvScalarMatrix pcorrEqn(laplacian.constCast().fvmLaplacian(one, pcorr) == fvc::div(phi));

        pcorrEqn.setReference(referenceCell, Zero);
        pcorrEqn.solve(controls);

        if (corri == nCorrectors_) {
            const surfaceScalarField correction(pcorrEqn.flux());

            phi -= correction;
            // Not fvc::reconstruct: its tensor is all but singular in cells
            // of two-dimensional meshes, and gives velocities of 50 m/s there
            U -= fvc::grad(pcorr, "grad(pcorr)");
            U.correctBoundaryConditions();
        }
    }
}
