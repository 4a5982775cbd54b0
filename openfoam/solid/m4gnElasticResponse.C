// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticResponse.H"
#include "m4gnDictionary.H"
#include "basicSymmetryFvPatchFields.H"
#include "fixedGradientFvPatchFields.H"
#include "fixedValueFvPatchFields.H"
#include "fvcGrad.H"
#include "fvmLaplacian.H"
#include "fvmSup.H"
#include "obstacleTractionFvPatchVectorField.H"
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

Foam::scalarField Foam::m4gnElasticResponse::cellSizes() const
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

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticResponse::heldAs(
    const volVectorField& D, const word& name, const dimensionSet& dimensions) const
{
    wordList types(mesh_.boundary().size(), fixedGradientFvPatchVectorField::typeName);

    forAll(types, patchi) {
        const fvPatchVectorField& patch = D.boundaryField()[patchi];

        if (polyPatch::constraintType(patch.patch().type()) || isA<basicSymmetryFvPatchVectorField>(patch)) {
            types[patchi] = patch.type();
        } else if (patch.fixesValue()) {
            types[patchi] = fixedValueFvPatchVectorField::typeName;
        } else if (isA<obstacleTractionFvPatchVectorField>(patch)) {
            types[patchi] = linearisedTractionFvPatchVectorField::typeName;
        }
    }

    return tmp<volVectorField>::New(
        IOobject(name, mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false), mesh_,
        dimensionedVector(dimensions, Zero), types);
}

Foam::m4gnElasticResponse::m4gnElasticResponse(
    const fvMesh& mesh, const m4gnExplicitStress& law, const word& entry, const scalar length)
    : mesh_(mesh), law_(law), stiffness_("m4gnStiffness", law.stiffness()), entry_(entry), length_(length),
      inertia_(
          IOobject("m4gnInertia", mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE, false),
          mesh, dimensionedScalar(dimless / sqr(dimTime), Zero))
{
    if (length_ > 0) {
        inertia_.field() = stiffness_.primitiveField() / sqr(length_ * cellSizes());
    }
}

Foam::scalar Foam::m4gnElasticResponse::lengthOf(
    const dictionary& dict, const word& name, const scalar defaultLength)
{
    const std::string example(name + " { length " + m4gn::text(defaultLength) + "; }");
    if (m4gn::isNone(dict, name, example)) {
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
                                    << "    To hand over what was predicted: " << name << " none;"
                                    << exit(FatalIOError);
    }

    return length;
}

Foam::List<Foam::m4gnElasticResponse::support> Foam::m4gnElasticResponse::touching(
    const volVectorField& D, const scalar push)
{
    List<support> supports(D.boundaryField().size());

    forAll(supports, patchi) {
        const fvPatchVectorField& patch = D.boundaryField()[patchi];

        if (isA<obstacleTractionFvPatchVectorField>(patch)) {
            const auto& contact = refCast<const obstacleTractionFvPatchVectorField>(patch);

            // A contact's own traction presses the layer between face and
            // cell: a push is to bring the cell out
            const vectorField displacement(push > 0 ? patch.patchInternalField() : contact.displacement());

            scalarField stiffness, gap;
            vectorField normal;
            contact.contact(displacement, stiffness, gap, normal);

            if (push > 0) {
                stiffness *= push;
            }
            supports[patchi].slope = stiffness * cmptMultiply(normal, normal);
            supports[patchi].traction =
                push > 0 ? vectorField(-stiffness * gap * normal) : vectorField(gap.size(), Zero);
        }
    }

    return supports;
}

void Foam::m4gnElasticResponse::release(
    volVectorField& field, const volSymmTensorField& stress, const List<support>& supports) const
{
    auto& boundary = field.boundaryFieldRef();

    forAll(boundary, patchi) {
        fvPatchVectorField& patch = boundary[patchi];

        if (!isA<fixedGradientFvPatchVectorField>(patch)) {
            continue;
        }

        const vectorField traction(
            (mesh_.boundary()[patchi].nf() & stress.boundaryField()[patchi])
            / stiffness_.boundaryField()[patchi]);

        if (!isA<linearisedTractionFvPatchVectorField>(patch)) {
            refCast<fixedGradientFvPatchVectorField>(patch).gradient() -= traction;
            continue;
        }

        auto& linear = refCast<linearisedTractionFvPatchVectorField>(patch);

        if (supports.empty()) {
            const vectorField none(patch.size(), Zero);
            linear.linearise(none, none, traction);
            continue;
        }

        const support& held = supports[patchi];
        const vectorField moved(linear.displacement());
        linear.linearise(held.traction - cmptMultiply(held.slope, moved), held.slope, traction);
    }

    field.correctBoundaryConditions();
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticResponse::respond(
    const volVectorField& D, const volVectorField::Internal& force, const scalar size,
    const List<support>& supports) const
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
    release(response, law_.stress(fvc::grad(response, gradScheme)())(), supports);

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
        release(response, stress, supports);
    }

    WarningInFunction << "The response of " << D.name() << " over a length of " << length_
                      << " cells has not converged in " << maxSweeps << " sweeps" << nl
                      << "    Expected lengths of a few cells: give " << entry_ << " a smaller one" << endl;

    return tresponse;
}
