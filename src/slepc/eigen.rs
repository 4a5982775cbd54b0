//! Eigenpairs of K x = lambda M x nearest to a shift, by Krylov-Schur with shift-and-invert.

use super::database::{Options, PREFIX};
use super::door::{Call, Mass};
use super::method::Method;
use super::objects::{Matrix, Solver, Vector};
use super::{Quiet, c, check, raw, start};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use std::mem::ManuallyDrop;
use std::sync::{Mutex, MutexGuard};

/// Most sweeps that look for copies of repeated eigenvalues, or for the end of a cluster, where nothing counts them.
const SWEEPS: usize = 40;

/// Sweeps one after the other that may find none of those that the count says are missing.
const IDLE: usize = 3;

/// Most restarts of a sweep.
pub(super) const ITERATIONS: i32 = 1000;

/// Eigenvalues closer than this, relatively, are copies of one.
const SAME: f64 = 1e-6;

/// Residual of the sweep that only looks whether something was missed, and the margin that its eigenvalue then has.
const PROBE: (f64, f64) = (1e-3, 1e-2);

/// Residuals above this, relative to the terms of K x = lambda M x, are no solution.
const RESIDUAL: f64 = 1e-3;

/// How far below the spectrum, in largest entries of K over largest entries of M, K - sigma M is M alone but for its null space.
const FAR: f64 = 1e10;

/// How MUMPS says that a matrix is singular.
const SINGULAR: &str = "INFOG(1)=-10";

/// How conjugate gradients say that they do not come to an end.
const DIVERGED: &str = "KSPSolve has not converged";

/// Below it an eigenvalue of M, scaled to a unit diagonal, is no rounding.
const NEGATIVE: f64 = -1e-8;

/// A problem's matrices in PETSc; the problem's own stiffness is not needed any more.
pub(crate) struct Matrices {
    pub(super) k: ManuallyDrop<Matrix>,
    pub(super) m: ManuallyDrop<Matrix>,
    /// A number far below the spectrum; none where M is diagonal.
    far: Option<f64>,
    /// On one rank: whether the entries of both lie symmetrically, zeros among them or not.
    pub(super) symmetric_pattern: bool,
    /// Unknowns and entries of K over all ranks.
    pub(super) unknowns: i64,
    pub(super) entries: i64,
}

impl Matrices {
    /// Copies the problem's matrices. Collective; all ranks fail together.
    pub(crate) fn new(comm: &Comm, problem: &Call) -> Result<Self> {
        let turn = turn();
        comm.agree(start(comm))?;
        let quiet = Quiet::new();
        let mut sizes = [problem.stiffness.n() as i64, problem.stiffness.column.len() as i64];
        comm.sum_i64(&mut sizes);
        let largest = |values: &[f64]| values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let far = match problem.mass {
            Mass::Diagonal(_) => None,
            Mass::Matrix(rows) => {
                let mut sizes = [largest(problem.stiffness.value), largest(rows.value)];
                comm.max_f64(&mut sizes);
                Some(-FAR * if sizes[0] > 0.0 { sizes[0] / sizes[1] } else { 1.0 })
            }
        };
        let make = || {
            let k = Matrix::new(comm, problem.stiffness, problem.block)?;
            let m = match problem.mass {
                Mass::Diagonal(values) => Matrix::diagonal(comm, values, problem.block)?,
                Mass::Matrix(rows) => Matrix::new(comm, rows, problem.block)?,
            };
            Ok(Matrices {
                k: ManuallyDrop::new(k),
                m: ManuallyDrop::new(m),
                far,
                symmetric_pattern: comm.size() == 1
                    && problem.stiffness.has_symmetric_pattern()
                    && match problem.mass {
                        Mass::Diagonal(_) => true,
                        Mass::Matrix(rows) => rows.has_symmetric_pattern(),
                    },
                unknowns: sizes[0],
                entries: sizes[1],
            })
        };
        let made = make();
        // To drop them takes a turn as well.
        drop((quiet, turn));
        comm.agree(made)
    }

    /// How M's entries lie beside those of K.
    pub(super) fn structure(&self) -> c::MatStructure {
        match self.far {
            None => c::MatStructure_SUBSET_NONZERO_PATTERN,
            Some(_) => c::MatStructure_DIFFERENT_NONZERO_PATTERN,
        }
    }
}

impl Drop for Matrices {
    fn drop(&mut self) {
        let _turn = turn();
        // SAFETY: neither is used again.
        unsafe {
            ManuallyDrop::drop(&mut self.k);
            ManuallyDrop::drop(&mut self.m);
        }
    }
}

/// Refuses a pair whose M, not diagonal, has a negative eigenvalue: the modes of least magnitude would be found all the same, and
/// those below zero be missing. Where nothing counts the modes, also one with an eigenvalue far below the shift. Collective.
fn check_pair(comm: &Comm, matrices: &Matrices, method: Method, shift: f64) -> Result<()> {
    let scaled = |least: f64| format!("scaled to a diagonal of 1 it has the eigenvalue {least:e}");
    if let Some(sigma) = matrices.far {
        let why = match method.factors() {
            true => Some(matrices.below(sigma)?)
                .filter(|n| *n > 0)
                .map(|n| format!("it has {n} negative eigenvalues")),
            false => Some(matrices.smallest(comm, None, 1e-6)?).filter(|least| *least < NEGATIVE).map(scaled),
        };
        if let Some(why) = why {
            return Err(m4gn_modes::negative_mass(&why));
        }
    }
    if method.factors() {
        return Ok(());
    }
    match matrices.smallest(comm, Some(shift), 1e-3)? {
        least if least < NEGATIVE => Err(m4gn_modes::not_definite(shift, &scaled(least))),
        _ => Ok(()),
    }
}

/// PETSc keeps global state and is not thread-safe.
fn turn() -> MutexGuard<'static, ()> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner())
}

/// Hands eigenpairs out by ascending distance from the shift, those that are taken and a few more. Collective; all ranks fail
/// together.
///
/// A Krylov method started from one vector sees a repeated eigenvalue once. Further sweeps look for copies, with the found vectors
/// deflated. Of a pair that is factored the eigenvalues are counted, and the sweeps end when all are there; else when one finds nothing
/// new within the range that is taken.
pub(crate) fn eigenpairs(comm: &Comm, matrices: &Matrices, request: &Call) -> Result<()> {
    let _turn = turn();
    let _quiet = Quiet::new();
    let mut last = Error::Internal("no method was tried".into());
    for &method in Method::of(comm, matrices, request) {
        let run = || {
            let _options = Options::new(method.defaults())?;
            check_pair(comm, matrices, method, request.shift)?;
            let found = Search::new(comm, matrices, request, method).run()?;
            // The solver with its factor is gone by now.
            found.into_iter().map(|f| f.into_pair(&matrices.m)).collect::<Result<Vec<_>>>()
        };
        let found = run();
        match comm.agree(found) {
            Ok(pairs) => {
                pairs.iter().for_each(|(value, x, mx)| request.pair(*value, x, mx));
                return Ok(());
            }
            Err(Error::Numerical(m)) if m.contains(SINGULAR) => {
                last = m4gn_modes::not_definite(request.shift, "it is singular");
            }
            Err(Error::Numerical(m)) if m.contains(DIVERGED) => {
                let why = "or is badly scaled: conjugate gradients with multigrid do not converge; modalSolver direct does without";
                last = m4gn_modes::not_definite(request.shift, why);
            }
            Err(e) => last = e,
        }
    }
    Err(last)
}

/// An eigenvalue and its vector.
struct Found {
    value: f64,
    vector: Vector,
}

impl Found {
    /// What is handed out: eigenvalue, vector, M times the vector.
    fn into_pair(self, m: &Matrix) -> Result<(f64, Vec<f64>, Vec<f64>)> {
        Ok((self.value, self.vector.values()?, m.times(&self.vector)?.values()?))
    }
}

struct Search<'a> {
    comm: &'a Comm,
    request: &'a Call<'a>,
    matrices: &'a Matrices,
    method: Method,
    /// The solver with its factor; none while eigenvalues are counted, which takes a factor of its own.
    eps: Solver,
    /// As set by the method or the options.
    tolerance: f64,
    /// Sizes of the subspace as set by the options, or PETSc's default.
    space: (i32, i32),
    found: Vec<Found>,
    /// A number behind the pairs that are taken, and how many eigenvalues lie below it.
    counted: Option<(f64, usize)>,
}

impl<'a> Search<'a> {
    fn new(comm: &'a Comm, matrices: &'a Matrices, request: &'a Call<'a>, method: Method) -> Self {
        Search {
            comm,
            request,
            matrices,
            method,
            eps: Solver::null(),
            tolerance: 0.0,
            space: (0, 0),
            found: Vec::new(),
            counted: None,
        }
    }

    /// Makes the solver if there is none.
    fn open(&mut self) -> Result<()> {
        if !self.eps.0.is_null() {
            return Ok(());
        }
        let (matrices, shift) = (self.matrices, self.request.shift);
        let eps = &mut self.eps;
        // SAFETY: objects are live; the strings are C strings; ST and KSP are borrowed from the solver.
        unsafe {
            check(c::EPSCreate(raw(self.comm), &mut eps.0))?;
            check(c::EPSSetOptionsPrefix(eps.0, PREFIX.as_ptr()))?;
            check(c::EPSSetOperators(eps.0, matrices.k.0, matrices.m.0))?;
            check(c::EPSSetProblemType(eps.0, c::EPSProblemType_EPS_GHEP))?;
            check(c::EPSSetType(eps.0, c"krylovschur".as_ptr()))?;
            check(c::EPSSetTarget(eps.0, shift))?;
            check(c::EPSSetWhichEigenpairs(eps.0, c::EPSWhich_EPS_TARGET_MAGNITUDE))?;
            check(c::EPSSetTolerances(eps.0, self.method.tolerance(), ITERATIONS))?;
            let (mut st, mut ksp) = (std::ptr::null_mut(), std::ptr::null_mut());
            check(c::EPSGetST(eps.0, &mut st))?;
            check(c::STSetType(st, c"sinvert".as_ptr()))?;
            check(c::STSetShift(st, shift))?;
            check(c::STSetMatStructure(st, matrices.structure()))?;
            check(c::STGetKSP(st, &mut ksp))?;
            self.method.set(ksp)?;
            check(c::EPSSetFromOptions(eps.0))?;
            let mut ignored = 0;
            check(c::EPSGetTolerances(eps.0, &mut self.tolerance, &mut ignored))?;
            let (ncv, mpd) = (&mut self.space.0, &mut self.space.1);
            check(c::EPSGetDimensions(eps.0, &mut ignored, ncv, mpd))?;
        }
        Ok(())
    }

    fn run(mut self) -> Result<Vec<Found>> {
        let total = self.matrices.unknowns as usize;
        let mut ask = (self.request.wanted + 2).min(total);
        let (mut sweeps, mut idle) = (0, 0);
        loop {
            let bound = self.bound();
            let new = self.sweep(ask)?;
            let fresh =
                self.found.is_empty() || new.iter().any(|f| bound.is_none_or(|b| self.distance(f) <= b));
            self.found.extend(new);
            let distance = |f: &Found| (f.value - self.request.shift).abs();
            self.found.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            (sweeps, idle) = (sweeps + 1, if fresh { 0 } else { idle + 1 });
            let counts = self.method.factors();
            if let Some(Found { value, .. }) = self.found.iter().find(|f| f.value < self.request.shift) {
                let why = format!("{value:e} is an eigenvalue");
                return Err(m4gn_modes::not_definite(self.request.shift, &why));
            }
            let missing = match counts {
                true => self.missing()?,
                false if !fresh && self.bound().is_some() => Some(0),
                false if self.nothing_missed()? => Some(0),
                false => None,
            };
            if missing == Some(0) || self.found.len() >= total {
                return Ok(self.found);
            }
            if counts && idle == IDLE {
                return Err(self.not_whole(missing.unwrap_or(0)));
            }
            if !counts && sweeps == SWEEPS {
                return Err(Error::Numerical(format!(
                    "{} modes did not suffice to find the end of a cluster of repeated eigenvalues: ask for fewer or more \
                     modes",
                    self.found.len()
                )));
            }
            let left = total - self.found.len();
            // A sweep sees one copy of each.
            ask = missing.map_or(2, |missing| missing.min(self.different())).min(left);
        }
    }

    /// How many eigenvalues are not found of those up to the end of what is taken; none: the end is not seen yet.
    fn missing(&mut self) -> Result<Option<usize>> {
        let values: Vec<f64> = self.found.iter().map(|f| f.value).collect();
        let Some((last, next)) = self.end() else {
            return Ok(None);
        };
        let (sigma, number) = match self.counted {
            Some(counted) if counted.0 > last => counted,
            _ => {
                let sigma = 0.5 * (last + next);
                // Two factors at a time may be more than there is room for.
                self.eps = Solver::null();
                *self.counted.insert((sigma, self.matrices.below(sigma)?))
            }
        };
        let known = values.iter().filter(|v| **v < sigma).count();
        match number.checked_sub(known) {
            Some(missing) => Ok(Some(missing)),
            None => Err(Error::Numerical(format!(
                "{known} modes were found below {sigma:e}, but {number} are there: the matrices are too badly scaled for \
                 this method"
            ))),
        }
    }

    /// Why what is missing is not found.
    fn not_whole(&self, missing: usize) -> Error {
        match self.matrices.below(self.request.shift) {
            Err(e) => e,
            Ok(0) => Error::Numerical(format!(
                "{missing} modes are missing of those below the eigenvalue {:e}: a repeated eigenvalue did not come out \
                 whole; ask for fewer or more modes, or give a larger subspace (PETSC_OPTIONS=\"-m4gn_eps_ncv N\")",
                self.counted.map_or(f64::NAN, |c| c.0)
            )),
            Ok(n) => m4gn_modes::not_definite(self.request.shift, &format!("{n} eigenvalues are below")),
        }
    }

    /// Different eigenvalues up to the end of what is taken, 1 at least.
    fn different(&self) -> usize {
        let end = self.counted.map_or(0.0, |c| c.0);
        let below = self.found.iter().filter(|f| f.value < end);
        let mut values: Vec<f64> = below.map(|f| f.value - self.request.shift).collect();
        values.dedup_by(|b, a| *b - *a <= SAME * *b);
        values.len().max(1)
    }

    /// The last eigenvalue that is taken and the next one, once that can be said.
    fn end(&self) -> Option<(f64, f64)> {
        let values: Vec<f64> = self.found.iter().map(|f| f.value).collect();
        let taken = self.request.taken(&values)?;
        Some((*values.get(taken.checked_sub(1)?)?, *values.get(taken)?))
    }

    fn distance(&self, f: &Found) -> f64 {
        (f.value - self.request.shift).abs()
    }

    /// Distance from the shift of the farthest pair that is taken, once that can be said.
    fn bound(&self) -> Option<f64> {
        let values: Vec<f64> = self.found.iter().map(|f| f.value).collect();
        let taken = self.request.taken(&values)?;
        Some(self.found[..taken].last().map_or(0.0, |f| self.distance(f)))
    }

    /// Whether a look, as rough as it can be, at what remains besides the known vectors sees nothing within the range
    /// that is taken.
    fn nothing_missed(&mut self) -> Result<bool> {
        let Some(bound) = self.bound() else {
            return Ok(false);
        };
        self.set_up(1, Some(PROBE.0))?;
        let first = self.eps.first()?;
        Ok(first.is_some_and(|value| (value - self.request.shift) * (1.0 - PROBE.1) > bound))
    }

    /// Prepares the solver for `wanted` pairs with the known ones kept out, to its tolerance or a rough one.
    fn set_up(&mut self, wanted: usize, rough: Option<f64>) -> Result<()> {
        self.open()?;
        let tolerance = rough.unwrap_or(self.tolerance);
        let default = c::PETSC_DEFAULT;
        // The options' sizes of the subspace are those of the first run.
        let (ncv, mpd) = if self.found.is_empty() { self.space } else { (default, default) };
        let mut handles: Vec<c::Vec> = self.found.iter().map(|f| f.vector.0).collect();
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
    fn sweep(&mut self, wanted: usize) -> Result<Vec<Found>> {
        self.set_up(wanted, None)?;
        let converged = self.eps.solve()?;
        let left = self.matrices.unknowns as usize - self.found.len();
        if (converged as usize) < wanted.min(left) {
            return Err(Error::Numerical(format!(
                "{converged} of {wanted} modes converged: are there as many finite eigenvalues (the rank of M)? Ask \
                 for fewer modes, or look at the mesh for badly scaled cells (PETSC_OPTIONS=-m4gn_eps_monitor \
                 shows the progress)"
            )));
        }
        let mut found = Vec::with_capacity(converged as usize);
        for i in 0..converged {
            let (mut value, vector, null) = (0.0, self.matrices.k.vector()?, std::ptr::null_mut());
            // SAFETY: i is below the number of converged pairs; the vector has the matrix's layout; no imaginary part is asked for.
            check(unsafe { c::EPSGetEigenpair(self.eps.0, i, &mut value, null, vector.0, null.cast()) })?;
            let mut one = Found { value, vector };
            self.judge(&mut one)?;
            found.push(one);
        }
        Ok(found)
    }

    /// Sets an eigenvalue to its Rayleigh quotient, whose error is the square of the vector's, and
    /// looks at the residual. Collective.
    fn judge(&self, found: &mut Found) -> Result<()> {
        let (x, kx, mx) = (
            found.vector.values()?,
            self.matrices.k.times(&found.vector)?.values()?,
            self.matrices.m.times(&found.vector)?.values()?,
        );
        let mut sums = [0.0; 5];
        for i in 0..x.len() {
            let terms = [
                x[i] * kx[i],
                x[i] * mx[i],
                kx[i] * kx[i],
                mx[i] * mx[i],
                (kx[i] - found.value * mx[i]).powi(2),
            ];
            sums.iter_mut().zip(terms).for_each(|(s, t)| *s += t);
        }
        self.comm.sum_f64(&mut sums);
        let [k, m, kk, mm, residual] = sums;
        if m > 0.0 {
            found.value = k / m;
        }
        let size = kk.sqrt() + (found.value.abs() + self.request.shift.abs()) * mm.sqrt();
        if residual.sqrt() > RESIDUAL * size {
            return Err(Error::Numerical(format!(
                "the mode of eigenvalue {:e} has a relative residual of {:.1e}: the matrices are too badly scaled for \
                 this method, or the pair is not symmetric",
                found.value,
                residual.sqrt() / size
            )));
        }
        Ok(())
    }
}
