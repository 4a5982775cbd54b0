/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnTotalDisplacementState.H"
#include "m4gnObstacles.H"
#include "m4gnSolverStateType.H"
#include "fixedGradientFvPatchFields.H"
#include "fvcGrad.H"
#include "pointFields.H"
#include "volPointInterpolation.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

addM4gnSolverState(m4gnTotalDisplacementState, totalDisplacement)

const char* const Foam::m4gnTotalDisplacementState::needs =
    "a displacement (name: D) and solidProperties with solidModel"
    " linearGeometryTotalDisplacement or"
    " nonLinearGeometryTotalLagrangianTotalDisplacement (solids4foam)";

namespace
{

//- Most sweeps over the gradient and the boundary, and the relative change of
//  the boundary values at which they end
const Foam::label maxSweeps = 50;
const Foam::scalar sweepTolerance = 1e-10;

} // End anonymous namespace


// * * * * * * * * * * * * Protected Member Functions  * * * * * * * * * * * //

void Foam::m4gnTotalDisplacementState::update()
{
    D().correctBoundaryConditions();
    extrapolate(D());
}


void Foam::m4gnTotalDisplacementState::extrapolate
(
    const volVectorField& conditions
)
{
    const scalar size = max(gMax(mag(D().primitiveField())()), VSMALL);
    auto& boundary = D().boundaryFieldRef();

    for (label sweep = 0; sweep < maxSweeps; ++sweep)
    {
        const volTensorField gradD(fvc::grad(D()));
        scalar change = 0;

        forAll(boundary, patchi)
        {
            fvPatchVectorField& patch = boundary[patchi];

            // Of traction, and what derives from it
            if
            (
                isA<fixedGradientFvPatchVectorField>
                (
                    conditions.boundaryField()[patchi]
                )
             && patch.size()
            )
            {
                const labelUList& cells = patch.patch().faceCells();
                const vectorField extrapolated
                (
                    vectorField(D().primitiveField(), cells)
                  + (
                        patch.patch().delta()
                      & tensorField(gradD.primitiveField(), cells)
                    )
                );
                change = max(change, max(mag(extrapolated - patch)));
                patch == extrapolated;
            }
        }

        if (returnReduce(change, maxOp<scalar>()) < sweepTolerance*size)
        {
            break;
        }
    }
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::word Foam::m4gnTotalDisplacementState::solidModel(const fvMesh& mesh)
{
    const auto* properties =
        mesh.time().findObject<IOdictionary>("solidProperties");

    return
        properties
      ? properties->getOrDefault<word>("solidModel", word::null)
      : word::null;
}


bool Foam::m4gnTotalDisplacementState::applies
(
    const fvMesh& mesh,
    const dictionary& dict
)
{
    const word model(solidModel(mesh));

    return
        mesh.foundObject<volVectorField>(displacementName(dict))
     && (
            model == "linearGeometryTotalDisplacement"
         || model == "nonLinearGeometryTotalLagrangianTotalDisplacement"
        );
}


Foam::m4gnTotalDisplacementState::m4gnTotalDisplacementState
(
    const fvMesh& mesh,
    const dictionary& dict,
    const m4gnSession& session
)
:
    m4gnDisplacementState(mesh, dict, session),
    obstacles_
    (
        m4gnObstacles::present(mesh) ? &m4gnObstacles::of(mesh) : nullptr
    )
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnTotalDisplacementState::complete
(
    const scalar deltaT,
    const bool handOver
)
{
    m4gnDisplacementState::complete(deltaT, handOver);

    auto* U = mesh_.getObjectPtr<volVectorField>("U");
    if (dynamic_ && U)
    {
        U->primitiveFieldRef() = rate().primitiveField();

        forAll(U->boundaryFieldRef(), patchi)
        {
            U->boundaryFieldRef()[patchi] == rate().boundaryField()[patchi];
        }
    }

    auto* points = mesh_.getObjectPtr<pointVectorField>("point" + DName_);
    if (points)
    {
        volPointInterpolation::New(mesh_).interpolate(D(), *points);
    }
}


Foam::wordList Foam::m4gnTotalDisplacementState::advanced() const
{
    wordList names(m4gnDisplacementState::advanced());
    names.append("point" + DName_);
    if (dynamic_)
    {
        names.append("U");
    }
    return names;
}


Foam::List<Foam::m4gnSolverState::quantity>
Foam::m4gnTotalDisplacementState::quantities() const
{
    List<quantity> all(m4gnDisplacementState::quantities());

    if (obstacles_)
    {
        all.append(quantity("gap", obstacles_->smallestGap(D())));
    }

    return all;
}


// ************************************************************************* //
