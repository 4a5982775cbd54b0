/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSolids4FoamLaw.H"
#include "fvc.H"
#include "fvm.H"
#include "m4gnMixing.H"
#include "solidModel.H"
#include "solidTractionFvPatchVectorField.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

using namespace Foam;

//- Most correctors, and correctors that the mixing remembers
const label maxCorrectors = 500;
const label depth = 15;

//- The part of its residual that the linear solver of a corrector leaves. With
//  the few per cent that are enough for a solver, the mixing learns noise.
const scalar linearTolerance = 1e-4;


//- The model hands its stabilisation out to its own classes only
struct protectedParts
:
    public solidModel
{
    static const momentumStabilisation& of(const solidModel& solid)
    {
        return (solid.*(&protectedParts::stabilisation))();
    }
};


//- The patch's condition, if it is one that has a traction, which conditions of
//  contact relax from corrector to corrector
solidTractionFvPatchVectorField* loaded(fvPatchVectorField& patch)
{
    return
        isA<solidTractionFvPatchVectorField>(patch)
      ? &refCast<solidTractionFvPatchVectorField>(patch)
      : nullptr;
}

} // End anonymous namespace


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

Foam::tmp<Foam::vectorField> Foam::m4gnSolids4FoamLaw::unknowns
(
    const volScalarField& impK
) const
{
    volVectorField& D = solid_->D();
    auto& boundary = D.boundaryFieldRef();
    DynamicList<vector> all(D.primitiveField());

    for (const label patchi : tractions())
    {
        fvPatchVectorField& patch = boundary[patchi];
        const auto* condition = loaded(patch);

        forAll(patch, facei)
        {
            const scalar distance = 1/patch.patch().deltaCoeffs()[facei];
            all.append(distance*traction(patch).gradient()[facei]);
            all.append
            (
                condition
              ? distance/impK.boundaryField()[patchi][facei]
               *condition->traction()[facei]
              : vector::zero
            );
        }
    }

    return tmp<vectorField>::New(std::move(all));
}


bool Foam::m4gnSolids4FoamLaw::take
(
    const vectorField& unknowns,
    const volScalarField& impK
)
{
    volVectorField& D = solid_->D();
    auto& boundary = D.boundaryFieldRef();
    label i = 0;

    for (vector& d : D.primitiveFieldRef())
    {
        d = unknowns[i++];
    }
    for (const label patchi : tractions())
    {
        fvPatchVectorField& patch = boundary[patchi];
        auto* condition = loaded(patch);

        forAll(patch, facei)
        {
            const scalar coeff = patch.patch().deltaCoeffs()[facei];
            traction(patch).gradient()[facei] = coeff*unknowns[i++];
            if (condition)
            {
                condition->traction()[facei] =
                    coeff*impK.boundaryField()[patchi][facei]*unknowns[i];
            }
            ++i;
        }

        // It counts as updated, so that its gradient is this one
        patch.fvPatchVectorField::updateCoeffs();
    }
    D.correctBoundaryConditions();

    return stress();
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

bool Foam::m4gnSolids4FoamLaw::settles() const
{
    const word& model = solid_->type();

    return
        model == "linearGeometryTotalDisplacement"
     || model == "nonLinearGeometryTotalLagrangianTotalDisplacement";
}


bool Foam::m4gnSolids4FoamLaw::settle
(
    const vectorField& free,
    const scalar duration,
    const scalar tolerance
)
{
    solidModel& solid = *solid_;
    const solidModel& model = solid;
    volVectorField& D = solid.D();
    const volVectorField before("before", D);
    const volScalarField impK(mechanical().impK());
    const surfaceScalarField impKf(mechanical().impKf());
    const volScalarField inertia
    (
        "inertia",
        model.rho()/sqr(dimensionedScalar("duration", dimTime, duration))
    );
    volVectorField target("target", D);
    target.primitiveFieldRef() = free;

    dictionary controls(mesh_.solverDict(D.name()));
    controls.set("tolerance", VSMALL);
    controls.set("relTol", linearTolerance);

    presentGradients();

    // The solver prints the residuals of none of its correctors either
    const label debug = SolverPerformance<vector>::debug;
    SolverPerformance<vector>::debug = 0;

    const scalar size = max(gMax(mag(D.primitiveField())()), VSMALL);
    m4gnMixing mixing(depth);
    tmp<vectorField> now(unknowns(impK));
    scalar change = GREAT;
    bool valid = true;

    for (label i = 0; i < maxCorrectors && change > tolerance*size; ++i)
    {
        valid = take(now(), impK);
        if (!valid)
        {
            break;
        }

        volSymmTensorField& sigma = solid.sigma();
        const tmp<volVectorField> force
        (
            solid.nonLinGeom() == nonLinearGeometry::LINEAR_GEOMETRY
          ? fvc::div(sigma, "div(sigma)")
          : fvc::div
            (
                mesh_.lookupObject<volScalarField>("J")
               *mesh_.lookupObject<volTensorField>("Finv") & sigma,
                "div(sigma)"
            )
        );

        fvVectorMatrix equation
        (
            fvm::Sp(inertia, D) - inertia*target
         == fvm::laplacian(impKf, D, "laplacian(DD,D)")
          - fvc::laplacian(impKf, D, "laplacian(DD,D)")
          + force
          + model.rho()*model.g()
          + protectedParts::of(model).stabilisation(D, solid.gradD(), impK)
        );
        equation.solve(controls);

        const tmp<vectorField> next(unknowns(impK));
        change = gMax(mag(next() - now())());
        now = mixing.next(now(), next());
    }
    SolverPerformance<vector>::debug = debug;

    valid = valid && take(now(), impK) && change <= tolerance*size;
    if (!valid)
    {
        D == before;
    }

    return valid;
}


// ************************************************************************* //
