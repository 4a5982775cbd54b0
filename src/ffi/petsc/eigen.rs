//! Eigenpairs of K x = lambda M x nearest to a shift, by Krylov-Schur with shift-and-invert.

use super::database::{Options, PREFIX};
use super::method::Method;
use super::objects::{Matrix, Solver, Vector};
use super::{Quiet, c, check, raw, start};
use crate::modes::{Mass, ModalOptions, Pair, Problem};
use crate::parallel::Comm;
use crate::{Error, Result};
use std::sync::Mutex;

/// Most sweeps that look for copies of repeated eigenvalues, or for the end of a cluster.
const SWEEPS: usize = 40;

/// Most restarts of a sweep.
const ITERATIONS: i32 = 1000;

/// Residual of the sweep that only looks whether something was missed, and the margin that its eigenvalue then has.
const PROBE: (f64, f64) = (1e-3, 1e-2);

/// Residuals above this, relative to the terms of K x = lambda M x, are no solution.
const RESIDUAL: f64 = 1e-3;

/// What is asked of the solver.
pub(crate) struct Request<'a> {
    /// The matrices.
    pub problem: &'a Problem,
    /// Below the eigenvalues wanted: K - shift M is positive definite where both are symmetric.
    pub shift: f64,
    /// Pairs wanted at first.
    pub wanted: usize,
    /// How many of these eigenvalues, nearest to the shift first, are taken; none: more have to be seen.
    pub taken: &'a dyn Fn(&[f64]) -> Option<usize>,
    /// The way to them.
    pub options: &'a ModalOptions,
}

/// Eigenpairs by ascending distance from the shift, those that are taken and a few more. Collective.
///
/// A Krylov method started from one vector sees a repeated eigenvalue once. Further sweeps look for copies until
/// nothing new lies within the range that is taken: with the found vectors deflated where the matrices are symmetric,
/// else from other start vectors.
pub(crate) fn eigenpairs(comm: &Comm, request: &Request) -> Result<Vec<Pair>> {
    // PETSc keeps global state and is not thread-safe.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
    comm.agree(start(comm))?;
    let _quiet = Quiet::new();
    let mut last = Error::Internal("no method was tried".into());
    for &method in Method::of(comm, request) {
        let mut options = comm.agree(Options::new(&request.options.petsc))?;
        let found = options
            .defaults(method.defaults())
            .and_then(|()| Search::new(comm, request, method)?.run());
        match comm.agree(found) {
            Ok(pairs) => {
                comm.agree(options.all_used())?;
                return Ok(pairs);
            }
            Err(e) => last = options.explain(e),
        }
    }
    Err(last)
}

struct Search<'a> {
    comm: &'a Comm,
    request: &'a Request<'a>,
    k: Matrix,
    m: Matrix,
    eps: Solver,
    /// As set by the method or the options.
    tolerance: f64,
    /// Sizes of the subspace as set by the options, or PETSc's default.
    space: (i32, i32),
    total: usize,
    pairs: Vec<Pair>,
    /// Vectors of `pairs`, where these are deflated.
    known: Vec<Vector>,
}

impl<'a> Search<'a> {
    fn new(comm: &'a Comm, request: &'a Request<'a>, method: Method) -> Result<Self> {
        let problem = request.problem;
        let mut total = [problem.stiffness.n() as i64];
        comm.sum_i64(&mut total);
        let k = Matrix::new(comm, &problem.stiffness, problem.symmetric, problem.block)?;
        let m = match &problem.mass {
            Mass::Diagonal(values) => Matrix::diagonal(comm, values, problem.block)?,
            Mass::Matrix(rows) => Matrix::new(comm, rows, problem.symmetric, problem.block)?,
        };
        let kind = match problem.symmetric {
            true => c::EPSProblemType_EPS_GHEP,
            false => c::EPSProblemType_EPS_GNHEP,
        };
        let mut eps = Solver::null();
        let (mut tolerance, mut space) = (0.0, (0, 0));
        // SAFETY: objects are live; the strings are C strings; ST and KSP are borrowed from the solver.
        unsafe {
            check(c::EPSCreate(raw(comm), &mut eps.0))?;
            check(c::EPSSetOptionsPrefix(eps.0, PREFIX.as_ptr()))?;
            check(c::EPSSetOperators(eps.0, k.0, m.0))?;
            check(c::EPSSetProblemType(eps.0, kind))?;
            check(c::EPSSetType(eps.0, c"krylovschur".as_ptr()))?;
            check(c::EPSSetTarget(eps.0, request.shift))?;
            check(c::EPSSetWhichEigenpairs(eps.0, c::EPSWhich_EPS_TARGET_MAGNITUDE))?;
            check(c::EPSSetTolerances(eps.0, method.tolerance(), ITERATIONS))?;
            let (mut st, mut ksp) = (std::ptr::null_mut(), std::ptr::null_mut());
            check(c::EPSGetST(eps.0, &mut st))?;
            check(c::STSetType(st, c"sinvert".as_ptr()))?;
            check(c::STSetShift(st, request.shift))?;
            if matches!(problem.mass, Mass::Diagonal(_)) {
                check(c::STSetMatStructure(st, c::MatStructure_SUBSET_NONZERO_PATTERN))?;
            }
            check(c::STGetKSP(st, &mut ksp))?;
            method.set(ksp)?;
            check(c::EPSSetFromOptions(eps.0))?;
            let mut ignored = 0;
            check(c::EPSGetTolerances(eps.0, &mut tolerance, &mut ignored))?;
            check(c::EPSGetDimensions(
                eps.0,
                &mut ignored,
                &mut space.0,
                &mut space.1,
            ))?;
        }
        Ok(Search {
            comm,
            request,
            k,
            m,
            eps,
            tolerance,
            space,
            total: total[0] as usize,
            pairs: Vec::new(),
            known: Vec::new(),
        })
    }

    fn run(mut self) -> Result<Vec<Pair>> {
        let symmetric = self.request.problem.symmetric;
        let mut ask = (self.request.wanted + 2).min(self.total);
        for _ in 0..SWEEPS {
            let before = self.pairs.len();
            let bound = self.bound();
            let found = self.sweep(ask)?;
            let new = match symmetric {
                true => found,
                false => super::subspace::independent(self.comm, &self.pairs, found),
            };
            let fresh = before == 0 || new.iter().any(|p| bound.is_none_or(|b| self.distance(p) <= b));
            self.pairs.extend(new);
            self.order();
            let done = !fresh && self.bound().is_some();
            if done || self.pairs.len() >= self.total || (symmetric && self.nothing_missed()?) {
                return Ok(self.pairs);
            }
            ask = match symmetric {
                true => 2.min(self.total - self.known.len()),
                // All over again, from another start; wider while the end of a cluster is not seen.
                false if self.bound().is_none() => (2 * ask).min(self.total),
                false => ask,
            };
        }
        Err(Error::Numerical(format!(
            "{} modes did not suffice to find the end of a cluster of repeated eigenvalues: ask for fewer or more modes",
            self.pairs.len()
        )))
    }

    fn distance(&self, p: &Pair) -> f64 {
        (p.value - self.request.shift).hypot(p.imaginary)
    }

    fn order(&mut self) {
        let mut pairs = std::mem::take(&mut self.pairs);
        // Stable: the two of a complex pair stay together.
        pairs.sort_by(|a, b| self.distance(a).total_cmp(&self.distance(b)));
        self.pairs = pairs;
    }

    /// Distance from the shift of the farthest pair that is taken, once that can be said.
    fn bound(&self) -> Option<f64> {
        let values: Vec<f64> = self.pairs.iter().map(|p| p.value).collect();
        let taken = (self.request.taken)(&values)?;
        Some(self.pairs[..taken].last().map_or(0.0, |p| self.distance(p)))
    }

    /// Whether a look, as rough as it can be, at what remains besides the known vectors sees nothing within the range
    /// that is taken.
    fn nothing_missed(&self) -> Result<bool> {
        let Some(bound) = self.bound() else {
            return Ok(false);
        };
        self.set_up(1, PROBE.0)?;
        let (mut value, mut converged) = (0.0, 0);
        // SAFETY: the solver is live and set up; vectors and the imaginary part are not asked for.
        unsafe {
            check(c::EPSSolve(self.eps.0))?;
            check(c::EPSGetConverged(self.eps.0, &mut converged))?;
            if converged < 1 {
                return Ok(false);
            }
            check(c::EPSGetEigenvalue(
                self.eps.0,
                0,
                &mut value,
                std::ptr::null_mut(),
            ))?;
        }
        Ok((value - self.request.shift) * (1.0 - PROBE.1) > bound)
    }

    /// Prepares the solver for `wanted` pairs with the known ones kept out.
    fn set_up(&self, wanted: usize, tolerance: f64) -> Result<()> {
        let default = c::PETSC_DEFAULT;
        // The options' sizes of the subspace are those of the first run.
        let (ncv, mpd) = if self.pairs.is_empty() {
            self.space
        } else {
            (default, default)
        };
        let mut handles: Vec<c::Vec> = self.known.iter().map(|v| v.0).collect();
        // SAFETY: the solver is live; PETSc copies the vectors of the deflation space.
        unsafe {
            check(c::EPSSetDimensions(self.eps.0, wanted as i32, ncv, mpd))?;
            check(c::EPSSetTolerances(self.eps.0, tolerance, ITERATIONS))?;
            if !handles.is_empty() {
                let n = handles.len() as i32;
                check(c::EPSSetDeflationSpace(self.eps.0, n, handles.as_mut_ptr()))?;
            }
        }
        Ok(())
    }

    /// One run of the solver.
    fn sweep(&mut self, wanted: usize) -> Result<Vec<Pair>> {
        self.set_up(wanted, self.tolerance)?;
        let mut converged = 0;
        // SAFETY: the solver is live.
        unsafe {
            check(c::EPSSolve(self.eps.0))?;
            check(c::EPSGetConverged(self.eps.0, &mut converged))?;
        }
        if (converged as usize) < wanted && self.total > wanted + self.known.len() {
            return Err(Error::Numerical(format!(
                "{converged} of {wanted} modes converged: are there as many finite eigenvalues (the rank of M)? Ask \
                 for fewer modes, or look at the mesh for badly scaled cells (option -m4gn_eps_monitor shows the \
                 progress)"
            )));
        }
        let mut pairs = Vec::with_capacity(converged as usize);
        let mut i = 0;
        while i < converged {
            let (x, y) = (self.k.vector()?, self.k.vector()?);
            let (mut value, mut imaginary) = (0.0, 0.0);
            // SAFETY: i is below the number of converged pairs; both vectors have the matrix's layout.
            check(unsafe { c::EPSGetEigenpair(self.eps.0, i, &mut value, &mut imaginary, x.0, y.0) })?;
            i += 1;
            if imaginary != 0.0 {
                // Its conjugate is the next one.
                i += 1;
                let second = self.pair(value, -imaginary, &y)?;
                pairs.extend([self.pair(value, imaginary, &x)?, second]);
                continue;
            }
            let mut pair = self.pair(value, 0.0, &x)?;
            self.judge(&mut pair, &x)?;
            pairs.push(pair);
            if self.request.problem.symmetric {
                self.known.push(x);
            }
        }
        Ok(pairs)
    }

    fn pair(&self, value: f64, imaginary: f64, x: &Vector) -> Result<Pair> {
        let pair = Pair {
            value,
            imaginary,
            vector: x.values()?,
            weighted: self.m.times(x)?.values()?,
        };
        let finite = match value.is_finite() && pair.vector.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(Error::Numerical(
                "a mode is not finite: look at the mesh for cells of extreme size or coefficients".into(),
            )),
        };
        self.comm.agree(finite)?;
        Ok(pair)
    }

    /// Sets a symmetric pair's eigenvalue to its Rayleigh quotient, whose error is the square of the vector's, and
    /// looks at the residual. Collective.
    fn judge(&self, pair: &mut Pair, x: &Vector) -> Result<()> {
        let kx = self.k.times(x)?.values()?;
        let mut sums = [0.0; 5];
        let mx = &pair.weighted;
        for i in 0..kx.len() {
            let terms = [
                pair.vector[i] * kx[i],
                pair.vector[i] * mx[i],
                kx[i] * kx[i],
                mx[i] * mx[i],
                (kx[i] - pair.value * mx[i]).powi(2),
            ];
            sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
        }
        self.comm.sum_f64(&mut sums);
        let [k, m, kk, mm, residual] = sums;
        if self.request.problem.symmetric && m > 0.0 {
            pair.value = k / m;
        }
        let size = kk.sqrt() + (pair.value.abs() + self.request.shift.abs()) * mm.sqrt();
        if residual.sqrt() > RESIDUAL * size {
            return Err(Error::Numerical(format!(
                "the mode of eigenvalue {:e} has a relative residual of {:.1e}: the matrices are too badly scaled for \
                 this method, or a symmetric pair was announced that is none",
                pair.value,
                residual.sqrt() / size
            )));
        }
        Ok(())
    }
}
