// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticSmoothing.H"
#include "m4gnDictionary.H"
#include "basicSymmetryFvPatchFields.H"
#include "fixedGradientFvPatchFields.H"
#include "fixedValueFvPatchFields.H"
#include "fvcGrad.H"
#include "fvcLaplacian.H"
#include "fvmLaplacian.H"
#include "fvmSup.H"
#include "surfaceFields.H"

namespace
{
//- Most sweeps
const Foam::label maxSweeps = 200;

//- Change between sweeps at which they end, relative to the largest value
//  of what is looked for, and what is nothing beside the displacement
const Foam::scalar sweepTolerance = 3e-4;
const Foam::scalar nothing = 1e-9;

//- The solver's log is for its own equations
struct quietly
{
    const int before = Foam::SolverPerformance<Foam::vector>::debug;

    quietly() { Foam::SolverPerformance<Foam::vector>::debug = 0; }

    ~quietly() { Foam::SolverPerformance<Foam::vector>::debug = before; }
};
}

Foam::scalar Foam::m4gnElasticSmoothing::lengthOf(const dictionary& dict)
{
    const word name("smoothing");
    const scalar defaultLength = 2;

    if (m4gn::isNone(dict, name, "smoothing { length 2; }")) {
        return 0;
    }
    if (!dict.found(name)) {
        return defaultLength;
    }

    const dictionary& own = dict.subDict(name);
    m4gn::checkKeys(own, {"length"}, false);

    const scalar length = own.getOrDefault<scalar>("length", defaultLength);

    if (!(length > 0)) {
        FatalIOErrorInFunction(own) << "Entry length of " << own.dictName() << " is " << length
                                    << " cells; expected more than 0" << nl
                                    << "    To hand over what was predicted: smoothing none;"
                                    << exit(FatalIOError);
    }

    return length;
}

Foam::scalarField Foam::m4gnElasticSmoothing::cellSizes() const
{
    const surfaceScalarField& coeffs = mesh_.deltaCoeffs();
    scalarField sizes(mesh_.nCells(), Zero);

    const auto take = [&](const label celli, const scalar coeff) {
        sizes[celli] = max(sizes[celli], 1 / coeff);
    };

    forAll(mesh_.neighbour(), facei) {
        take(mesh_.owner()[facei], coeffs[facei]);
        take(mesh_.neighbour()[facei], coeffs[facei]);
    }
    for (const fvPatch& patch : mesh_.boundary()) {
        if (patch.coupled()) {
            forAll(patch, i) {
                take(patch.faceCells()[i], coeffs.boundaryField()[patch.index()][i]);
            }
        }
    }

    forAll(sizes, celli) {
        if (sizes[celli] <= 0) {
            // It has no neighbours
            sizes[celli] = cbrt(mesh_.V()[celli]);
        }
    }

    return sizes;
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::heldAs(
    const volVectorField& D, const word& name, const dimensionSet& dimensions) const
{
    wordList types(mesh_.boundary().size(), fixedGradientFvPatchVectorField::typeName);

    forAll(types, patchi) {
        const fvPatchVectorField& patch = D.boundaryField()[patchi];

        if (polyPatch::constraintType(patch.patch().type()) || isA<basicSymmetryFvPatchVectorField>(patch)) {
            types[patchi] = patch.type();
        } else if (patch.fixesValue()) {
            types[patchi] = fixedValueFvPatchVectorField::typeName;
        }
    }

    return tmp<volVectorField>::New(
        IOobject(name, mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false), mesh_,
        dimensionedVector(dimensions, Zero), types);
}

void Foam::m4gnElasticSmoothing::release(volVectorField& field, const volSymmTensorField& stress) const
{
    for (fvPatchVectorField& patch : field.boundaryFieldRef()) {
        if (isA<fixedGradientFvPatchVectorField>(patch)) {
            const label patchi = patch.patch().index();
            refCast<fixedGradientFvPatchVectorField>(patch).gradient() -=
                (patch.patch().nf() & stress.boundaryField()[patchi]) / stiffness_.boundaryField()[patchi];
        }
    }

    field.correctBoundaryConditions();
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::respond(
    const volVectorField& D, const volVectorField::Internal& force, const scalar size) const
{
    const word gradScheme("grad(" + D.name() + ')');

    auto tresponse = heldAs(D, "m4gnResponse", force.dimensions() / inertia_.dimensions());
    volVectorField& response = tresponse.ref();

    // The next sweep goes on from where the linear solver stops
    dictionary controls(mesh_.solverDict(D.name()));
    controls.set("relTol", scalar(0.1));
    controls.set("tolerance", scalar(1e-14));

    const quietly log;
    volVectorField::Internal right(force);
    release(response, law_.stress(fvc::grad(response, gradScheme)())());

    for (label sweep = 0; sweep < maxSweeps; ++sweep) {
        const vectorField before(response.primitiveField());

        fvVectorMatrix equation(
            fvm::Sp(inertia_, response) - fvm::laplacian(stiffness_, response, "laplacian(DD,D)") == right);
        equation.solve(controls);

        const scalar change = gMax(mag(response.primitiveField() - before)());
        const scalar found = gMax(mag(response.primitiveField())());

        if (change <= max(sweepTolerance * found, nothing * size)) {
            return tresponse;
        }

        const volTensorField gradient(fvc::grad(response, gradScheme));
        const volSymmTensorField stress(law_.stress(gradient));

        right = force + law_.explicitPart(stress, gradient)().internalField();
        release(response, stress);
    }

    WarningInFunction << "The response of " << D.name() << " over a length of " << length_
                      << " cells has not converged in " << maxSweeps << " sweeps" << nl
                      << "    Expected lengths of a few cells: give smoothing a smaller one" << endl;

    return tresponse;
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::elasticForce(
    const volVectorField& field, const word& gradScheme) const
{
    const volTensorField gradient(fvc::grad(field, gradScheme));

    return fvc::laplacian(stiffness_, field, "laplacian(DD,D)")
           + law_.explicitPart(law_.stress(gradient)(), gradient);
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::correction(
    const volVectorField& D, const volVectorField::Internal& force, const scalar size) const
{
    auto r = respond(D, force, size);
    const volVectorField::Internal inertial(inertia_ * r().internalField());
    r.ref() -= respond(D, inertial, size);

    return r;
}

Foam::m4gnElasticSmoothing::m4gnElasticSmoothing(
    const fvMesh& mesh, const dictionary& dict, const m4gnExplicitStress& law)
    : mesh_(mesh), law_(law), stiffness_("m4gnStiffness", law.stiffness()), length_(lengthOf(dict)),
      inertia_(
          IOobject("m4gnInertia", mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE, false),
          mesh, dimensionedScalar(dimless / sqr(dimTime), Zero))
{
    if (active()) {
        inertia_.field() = stiffness_.primitiveField() / sqr(length_ * cellSizes());
    }
}

Foam::scalar Foam::m4gnElasticSmoothing::smoothDisplacement(volVectorField& D) const
{
    volVectorField force(elasticForce(D, "grad(" + D.name() + ')'));

    if (m4gnExplicitStress::thermal(mesh_)) {
        force -= fvc::grad(
            mesh_.lookupObject<volScalarField>("threeKalpha") * mesh_.lookupObject<volScalarField>("T"));
    }

    const auto change = correction(D, force.internalField(), gMax(mag(D.primitiveField())()));

    D.primitiveFieldRef() += change().primitiveField();

    return gMax(mag(change().primitiveField())());
}

void Foam::m4gnElasticSmoothing::smoothRate(const volVectorField& D, volVectorField& rate) const
{
    const word gradScheme("grad(" + D.name() + ')');
    const scalar size = gMax(mag(rate.primitiveField())());

    auto tv = heldAs(D, "m4gnRate", rate.dimensions());
    volVectorField& v = tv.ref();
    v.primitiveFieldRef() = rate.primitiveField();
    forAll(v.boundaryField(), patchi) {
        if (v.boundaryField()[patchi].fixesValue()) {
            v.boundaryFieldRef()[patchi] == rate.boundaryField()[patchi];
        }
    }
    v.correctBoundaryConditions();

    for (label sweep = 0; sweep < maxSweeps; ++sweep) {
        const volVectorField::Boundary before(v.boundaryField());
        release(v, law_.stress(fvc::grad(v, gradScheme)())());

        if (m4gnExplicitStress::change(before, v) <= 1e-6 * size) {
            break;
        }
    }

    const volVectorField force(elasticForce(v, gradScheme));

    rate.primitiveFieldRef() += correction(D, force.internalField(), size)().primitiveField();
    rate.correctBoundaryConditions();
}
