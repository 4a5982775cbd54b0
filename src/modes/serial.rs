//! What stands in for SLEPc in builds without it: faer on the root.

use super::{ModalSolver, Pair, Problem, Request, dense, sparse};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};

/// Most unknowns of a non-symmetric pair: it is solved densely.
const DENSE: i64 = 2000;

/// A copy of the problem.
pub(crate) struct Matrices(Problem);

impl Matrices {
    pub(crate) fn new(_comm: &Comm, problem: &Problem) -> Result<Self> {
        Ok(Matrices(problem.clone()))
    }
}

/// Eigenpairs, nearest to the shift first. Collective.
pub(crate) fn eigenpairs(comm: &Comm, Matrices(problem): &Matrices, request: &Request) -> Result<Vec<Pair>> {
    let mut total = [problem.stiffness.n() as i64];
    comm.sum_i64(&mut total);
    let input = |what: &str| {
        Err(Error::Input(format!(
            "{what} needs PETSc and SLEPc, which this build has not"
        )))
    };
    if !request.options.petsc.trim().is_empty() {
        return input("a PETSc option");
    }
    if request.options.solver == ModalSolver::Iterative {
        return input("the iterative modal solver");
    }
    match request.symmetric {
        true => sparse::eigenpairs(problem, request.shift, request.wanted, request.taken, comm),
        false if total[0] <= DENSE => dense::eigenpairs(problem, request.shift, comm),
        false => input(&format!(
            "a non-symmetric pair of more than {DENSE} unknowns ({} here, {} a point)",
            total[0], request.block
        )),
    }
}
