// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPredictedSolver.H"
#include "m4gnSolveHistory.H"
#include "objectRegistry.H"

namespace Foam
{
    defineTypeNameAndDebug(m4gnPredictedSolver, 0);

    lduMatrix::solver::addsymMatrixConstructorToTable<m4gnPredictedSolver>
        addm4gnPredictedSolverSymMatrixConstructorToTable_;

    lduMatrix::solver::addasymMatrixConstructorToTable<m4gnPredictedSolver>
        addm4gnPredictedSolverAsymMatrixConstructorToTable_;
}

Foam::scalar Foam::m4gnPredictedSolver::residual
(
    const scalarField& psi,
    const scalarField& source,
    const direction cmpt
) const
{
    scalarField Apsi(psi.size()), work(psi.size());
    matrix_.Amul(Apsi, psi, interfaceBouCoeffs_, interfaces_, cmpt);
    const scalar norm = normFactor(psi, source, Apsi, work);

    return gSumMag(source - Apsi)/norm;
}

Foam::m4gnPredictedSolver::m4gnPredictedSolver
(
    const word& fieldName,
    const lduMatrix& matrix,
    const FieldField<Field, scalar>& interfaceBouCoeffs,
    const FieldField<Field, scalar>& interfaceIntCoeffs,
    const lduInterfaceFieldPtrsList& interfaces,
    const dictionary& solverControls
)
:
    lduMatrix::solver
    (
        fieldName,
        matrix,
        interfaceBouCoeffs,
        interfaceIntCoeffs,
        interfaces,
        solverControls
    )
{
    m4gnPredictorChoice::check(controlDict_);

    const word linearSolver(controlDict_.get<word>("linearSolver"));

    if (linearSolver == typeName)
    {
        FatalIOErrorInFunction(solverControls)
            << "Entry linearSolver is " << typeName << " itself; expected the"
            << " solver that does the work: GAMG, PCG, PBiCGStab, ..."
            << exit(FatalIOError);
    }

    // What remains of this dictionary is for that solver
    controlDict_.set("solver", linearSolver);
}

Foam::solverPerformance Foam::m4gnPredictedSolver::solve
(
    scalarField& psi,
    const scalarField& source,
    const direction cmpt
) const
{
    const auto work = [&](const dictionary& controls)
    {
        return lduMatrix::solver::New
        (
            fieldName_,
            matrix_,
            interfaceBouCoeffs_,
            interfaceIntCoeffs_,
            interfaces_,
            controls
        )->solve(psi, source, cmpt);
    };

    if (m4gnPredictorChoice(controlDict_).never())
    {
        return work(controlDict_);
    }

    m4gnSolveHistory& history = m4gnSolveHistory::of
    (
        fieldName_,
        matrix_.mesh().thisDb(),
        controlDict_
    );
    history.begin(psi);

    scalarField changed(-psi);
    solverPerformance done;
    const tmp<scalarField> guess(history.guess());

    if (guess.valid())
    {
        const scalar residual0 = residual(psi, source, cmpt);
        dictionary controls(controlDict_);
        controls.set("tolerance", max(tolerance_, relTol_*residual0));
        controls.set("relTol", scalar(0));
        psi += guess();
        done = work(controls);
        done.initialResidual() = residual0;
        done.solverName() = done.solverName() + ':' + history.guessName();
    }
    else
    {
        done = work(controlDict_);
    }

    changed += psi;
    history.end(std::move(changed), done.nIterations());

    return done;
}
