//! Eigenpairs of K x = lambda M x nearest to a shift, by Krylov-Schur with shift-and-invert.

use super::database::{Options, PREFIX};
use super::objects::{Matrix, Solver, Vector};
use super::{Quiet, c, check, raw, start};
use crate::modes::{Mass, ModalOptions, Pair, Problem};
use crate::parallel::Comm;
use crate::{Error, Result};
use std::ffi::CStr;
use std::sync::Mutex;

/// Relative residual at which an eigenpair counts as converged: far below the quantum that SLIC sees (1e-7).
const TOLERANCE: f64 = 1e-11;

/// Most sweeps that look for copies of repeated eigenvalues, or for the end of a cluster.
const SWEEPS: usize = 40;

/// What is asked of the solver.
pub(crate) struct Request<'a> {
    /// The matrices.
    pub problem: &'a Problem,
    /// Below the eigenvalues wanted: K - shift M is positive definite where both are symmetric.
    pub shift: f64,
    /// Pairs wanted at first.
    pub wanted: usize,
    /// Whether these eigenvalues, ascending, are enough; else more are computed.
    pub enough: &'a dyn Fn(&[f64]) -> bool,
    /// The way to them.
    pub options: &'a ModalOptions,
}

/// Eigenpairs nearest to the shift, in no order, M-orthonormal where the matrices are symmetric. Collective.
///
/// A Krylov method started from one vector sees a repeated eigenvalue once; further sweeps, with the found vectors
/// deflated, look for copies until nothing new lies within the range found.
pub(crate) fn eigenpairs(comm: &Comm, request: &Request) -> Result<Vec<Pair>> {
    // PETSc keeps global state and is not thread-safe.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
    comm.agree(start(comm))?;
    let _quiet = Quiet::new();
    let options = comm.agree(Options::new(&request.options.petsc))?;
    let mut last = Error::Internal("no factorisation was tried".into());
    // K - shift M is positive definite, so Cholesky; LU is the second chance where rounding has spoilt that.
    let factorisations: &[&CStr] = match request.problem.symmetric {
        true => &[c"cholesky", c"lu"],
        false => &[c"lu"],
    };
    for factorisation in factorisations {
        let result = attempt(comm, request, factorisation);
        match comm.agree(result) {
            Ok(pairs) => {
                comm.agree(options.all_used())?;
                return Ok(pairs);
            }
            Err(e) => last = options.explain(e),
        }
    }
    Err(last)
}

fn attempt(comm: &Comm, request: &Request, factorisation: &CStr) -> Result<Vec<Pair>> {
    let problem = request.problem;
    let mut total = [problem.stiffness.n() as i64];
    comm.sum_i64(&mut total);
    let total = total[0] as usize;
    let stiffness = Matrix::new(comm, &problem.stiffness, problem.symmetric)?;
    let mass = match &problem.mass {
        Mass::Diagonal(values) => Matrix::diagonal(comm, values)?,
        Mass::Matrix(rows) => Matrix::new(comm, rows, problem.symmetric)?,
    };
    let solver = Solver::new(comm, &stiffness, &mass, request, factorisation)?;
    let mut pairs: Vec<Pair> = Vec::new();
    let mut known: Vec<Vector> = Vec::new();
    let mut ask = (request.wanted + 2).min(total);
    for _ in 0..SWEEPS {
        let found = solver.solve(&stiffness, &mass, ask, &known)?;
        let largest = pairs.iter().map(|p| p.value).fold(f64::NEG_INFINITY, f64::max);
        let fresh = known.is_empty() || found.iter().any(|f| f.0.value < largest);
        for (pair, vector) in found {
            pairs.push(pair);
            known.push(vector);
        }
        let mut values: Vec<f64> = pairs.iter().map(|p| p.value).collect();
        values.sort_by(f64::total_cmp);
        ask = 2.min(total - known.len());
        if ask == 0 || (!fresh && (request.enough)(&values)) {
            return Ok(pairs);
        }
    }
    Err(Error::Numerical(format!(
        "{} modes did not suffice to find the end of a cluster of repeated eigenvalues: ask for fewer or more modes",
        pairs.len()
    )))
}

impl Solver {
    fn new(comm: &Comm, k: &Matrix, m: &Matrix, request: &Request, factorisation: &CStr) -> Result<Self> {
        // On one rank PETSc's own factors are some five times quicker here than MUMPS.
        let package = if comm.size() == 1 { c"petsc" } else { c"mumps" };
        let kind = match request.problem.symmetric {
            true => c::EPSProblemType_EPS_GHEP,
            false => c::EPSProblemType_EPS_GNHEP,
        };
        let mut eps = Solver::null();
        // SAFETY: objects are live; the strings are C strings; ST, KSP and PC are borrowed from the solver.
        unsafe {
            check(c::EPSCreate(raw(comm), &mut eps.0))?;
            check(c::EPSSetOptionsPrefix(eps.0, PREFIX.as_ptr()))?;
            check(c::EPSSetOperators(eps.0, k.0, m.0))?;
            check(c::EPSSetProblemType(eps.0, kind))?;
            check(c::EPSSetType(eps.0, c"krylovschur".as_ptr()))?;
            check(c::EPSSetTarget(eps.0, request.shift))?;
            check(c::EPSSetWhichEigenpairs(eps.0, c::EPSWhich_EPS_TARGET_MAGNITUDE))?;
            check(c::EPSSetTolerances(eps.0, TOLERANCE, 1000))?;
            let mut st = std::ptr::null_mut();
            check(c::EPSGetST(eps.0, &mut st))?;
            check(c::STSetType(st, c"sinvert".as_ptr()))?;
            check(c::STSetShift(st, request.shift))?;
            let (mut ksp, mut pc) = (std::ptr::null_mut(), std::ptr::null_mut());
            check(c::STGetKSP(st, &mut ksp))?;
            check(c::KSPSetType(ksp, c"preonly".as_ptr()))?;
            check(c::KSPGetPC(ksp, &mut pc))?;
            check(c::PCSetType(pc, factorisation.as_ptr()))?;
            check(c::PCFactorSetMatSolverType(pc, package.as_ptr()))?;
            if package == c"petsc" {
                // Nested dissection; PETSc's default for Cholesky is no reordering, which fills in.
                check(c::PCFactorSetMatOrderingType(pc, c"nd".as_ptr()))?;
            }
            check(c::EPSSetFromOptions(eps.0))?;
        }
        Ok(eps)
    }

    /// Eigenpairs found in one run, at least `wanted` of them, with `known` ones kept out.
    fn solve(&self, k: &Matrix, m: &Matrix, wanted: usize, known: &[Vector]) -> Result<Vec<(Pair, Vector)>> {
        let mut converged = 0;
        // SAFETY: the solver is live; PETSc copies the vectors of the deflation space.
        unsafe {
            let default = c::PETSC_DEFAULT;
            check(c::EPSSetDimensions(self.0, wanted as i32, default, default))?;
            if !known.is_empty() {
                let mut handles: Vec<c::Vec> = known.iter().map(|v| v.0).collect();
                check(c::EPSSetDeflationSpace(
                    self.0,
                    handles.len() as i32,
                    handles.as_mut_ptr(),
                ))?;
            }
            check(c::EPSSolve(self.0))?;
            check(c::EPSGetConverged(self.0, &mut converged))?;
        }
        if (converged as usize) < wanted {
            return Err(Error::Numerical(format!(
                "{converged} of {wanted} modes converged: ask for fewer modes, or look at the mesh for badly scaled \
                 cells (option -m4gn_eps_monitor shows the progress)"
            )));
        }
        (0..converged)
            .map(|i| {
                let vector = k.vector()?;
                let (mut value, mut imaginary) = (0.0, 0.0);
                // SAFETY: i is below the number of converged pairs; the imaginary vector is not asked for.
                check(unsafe {
                    c::EPSGetEigenpair(
                        self.0,
                        i,
                        &mut value,
                        &mut imaginary,
                        vector.0,
                        std::ptr::null_mut(),
                    )
                })?;
                let pair = Pair {
                    value,
                    imaginary,
                    vector: vector.values()?,
                    weighted: m.times(&vector)?.values()?,
                };
                if !value.is_finite() || pair.vector.iter().any(|x| !x.is_finite()) {
                    return Err(Error::Numerical(
                        "a mode is not finite: look at the mesh for cells of extreme size or coefficients"
                            .into(),
                    ));
                }
                Ok((pair, vector))
            })
            .collect()
    }
}
