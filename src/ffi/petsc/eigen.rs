//! The smallest eigenpairs of K x = lambda B x, K symmetric and B diagonal, by Krylov-Schur with shift-and-invert.

use super::{Quiet, c, check, raw, start};
use crate::parallel::Comm;
use crate::{Error, Result};
use std::ffi::CStr;
use std::sync::Mutex;

/// This rank's rows of a distributed symmetric matrix. Rows are numbered rank after rank.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SymmetricRows {
    /// Row i holds entries `row[i]..row[i + 1]`; one more than the rows of this rank.
    pub row: Vec<i32>,
    /// Column of each entry, ascending within a row, in the numbering of all ranks.
    pub column: Vec<i32>,
    /// Value of each entry.
    pub value: Vec<f64>,
}

impl SymmetricRows {
    /// Rows of this rank.
    pub fn n(&self) -> usize {
        self.row.len().saturating_sub(1)
    }
}

/// An eigenvalue and this rank's part of its eigenvector.
pub type Eigenpair = (f64, Vec<f64>);

/// Relative residual at which an eigenpair counts as converged: far below the quantum that SLIC sees (1e-7).
const TOLERANCE: f64 = 1e-11;

/// Most sweeps that look for copies of repeated eigenvalues.
const SWEEPS: usize = 20;

macro_rules! owned {
    ($name:ident, $type:ty, $destroy:path) => {
        struct $name($type);
        impl $name {
            fn null() -> Self {
                Self(std::ptr::null_mut())
            }
        }
        impl Drop for $name {
            fn drop(&mut self) {
                if !self.0.is_null() {
                    // SAFETY: created by PETSc and destroyed once, here.
                    unsafe { $destroy(&mut self.0) };
                }
            }
        }
    };
}
owned!(Matrix, c::Mat, c::MatDestroy);
owned!(Vector, c::Vec, c::VecDestroy);
owned!(Solver, c::EPS, c::EPSDestroy);

impl Matrix {
    fn new(comm: &Comm, rows: &SymmetricRows) -> Result<Self> {
        let n = rows.n() as c::PetscInt;
        let mut matrix = Matrix::null();
        // SAFETY: the arrays have n + 1 and row[n] entries and are copied; the matrix is destroyed on drop.
        unsafe {
            check(c::MatCreate(raw(comm), &mut matrix.0))?;
            check(c::MatSetSizes(matrix.0, n, n, c::PETSC_DECIDE, c::PETSC_DECIDE))?;
            check(c::MatSetType(matrix.0, c"aij".as_ptr()))?;
            let (row, column, value) = (rows.row.as_ptr(), rows.column.as_ptr(), rows.value.as_ptr());
            // Each is ignored by the type that the other is for.
            check(c::MatSeqAIJSetPreallocationCSR(matrix.0, row, column, value))?;
            check(c::MatMPIAIJSetPreallocationCSR(matrix.0, row, column, value))?;
            check(c::MatSetOption(
                matrix.0,
                c::MatOption_MAT_SYMMETRIC,
                c::PetscBool_PETSC_TRUE,
            ))?;
            check(c::MatSetOption(
                matrix.0,
                c::MatOption_MAT_SYMMETRY_ETERNAL,
                c::PetscBool_PETSC_TRUE,
            ))?;
        }
        Ok(matrix)
    }

    fn diagonal(comm: &Comm, values: &[f64]) -> Result<Self> {
        let first = comm.exclusive_scan_i64(values.len() as i64) as i32;
        let n = values.len() as i32;
        Matrix::new(
            comm,
            &SymmetricRows {
                row: (0..=n).collect(),
                column: (first..first + n).collect(),
                value: values.to_vec(),
            },
        )
    }

    fn vector(&self) -> Result<Vector> {
        let mut vector = Vector::null();
        // SAFETY: a vector of the matrix's layout; the other result is not asked for.
        check(unsafe { c::MatCreateVecs(self.0, &mut vector.0, std::ptr::null_mut()) })?;
        Ok(vector)
    }
}

impl Vector {
    fn values(&self, n: usize) -> Result<Vec<f64>> {
        let mut data = std::ptr::null();
        // SAFETY: PETSc lends its local array, of n values in this layout, until the restore.
        unsafe {
            check(c::VecGetArrayRead(self.0, &mut data))?;
            let values = match n {
                0 => Vec::new(),
                _ => std::slice::from_raw_parts(data, n).to_vec(),
            };
            check(c::VecRestoreArrayRead(self.0, &mut data))?;
            Ok(values)
        }
    }
}

impl Solver {
    fn new(
        comm: &Comm,
        k: &Matrix,
        b: &Matrix,
        shift: f64,
        factorisation: &CStr,
        package: &CStr,
    ) -> Result<Self> {
        let mut eps = Solver::null();
        // SAFETY: objects are live; the strings are C strings; ST, KSP and PC are borrowed from the solver.
        unsafe {
            check(c::EPSCreate(raw(comm), &mut eps.0))?;
            check(c::EPSSetOptionsPrefix(eps.0, c"m4gn_".as_ptr()))?;
            check(c::EPSSetOperators(eps.0, k.0, b.0))?;
            check(c::EPSSetProblemType(eps.0, c::EPSProblemType_EPS_GHEP))?;
            check(c::EPSSetType(eps.0, c"krylovschur".as_ptr()))?;
            check(c::EPSSetTarget(eps.0, shift))?;
            check(c::EPSSetWhichEigenpairs(eps.0, c::EPSWhich_EPS_TARGET_MAGNITUDE))?;
            check(c::EPSSetTolerances(eps.0, TOLERANCE, 1000))?;
            let mut st = std::ptr::null_mut();
            check(c::EPSGetST(eps.0, &mut st))?;
            check(c::STSetType(st, c"sinvert".as_ptr()))?;
            check(c::STSetShift(st, shift))?;
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
    fn solve(
        &self,
        k: &Matrix,
        n: usize,
        wanted: usize,
        known: &[Vector],
    ) -> Result<Vec<(f64, Vector, Vec<f64>)>> {
        let mut converged = 0;
        // SAFETY: the solver is live; PETSc copies the vectors of the deflation space.
        unsafe {
            check(c::EPSSetDimensions(
                self.0,
                wanted as i32,
                c::PETSC_DEFAULT,
                c::PETSC_DEFAULT,
            ))?;
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
                "{converged} of {wanted} Laplacian modes converged: ask for fewer modes, or look at the mesh for \
                 badly scaled cells (option -m4gn_eps_monitor shows the progress)"
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
                let values = vector.values(n)?;
                Ok((value, vector, values))
            })
            .collect()
    }
}

/// At least `wanted` smallest eigenpairs of K x = lambda B x, ascending, B-orthonormal. Collective.
///
/// `shift` lies below the spectrum, so that K - shift B is positive definite. A Krylov method started from one
/// vector sees a repeated eigenvalue once; further sweeps with the found vectors deflated look for copies until
/// nothing new lies within the range found.
pub fn smallest_eigenpairs(
    comm: &Comm,
    k: &SymmetricRows,
    b: &[f64],
    shift: f64,
    wanted: usize,
) -> Result<Vec<Eigenpair>> {
    // PETSc keeps global state and is not thread-safe.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner());
    comm.agree(start(comm))?;
    let _quiet = Quiet::new();
    let mut last = Error::Internal("no factorisation was tried".into());
    // On one rank PETSc's own factors are some five times quicker here than MUMPS.
    let package = if comm.size() == 1 { c"petsc" } else { c"mumps" };
    // K - shift B is positive definite, so Cholesky; LU is the second chance where rounding has spoilt that.
    for factorisation in [c"cholesky", c"lu"] {
        let result = attempt(comm, k, b, shift, wanted, factorisation, package);
        match comm.agree(result) {
            Ok(pairs) => return Ok(pairs),
            Err(e) => last = e,
        }
    }
    Err(last)
}

fn attempt(
    comm: &Comm,
    k: &SymmetricRows,
    b: &[f64],
    shift: f64,
    wanted: usize,
    factorisation: &CStr,
    package: &CStr,
) -> Result<Vec<Eigenpair>> {
    let n = k.n();
    let mut total = [n as i64];
    comm.sum_i64(&mut total);
    let total = total[0] as usize;
    let stiffness = Matrix::new(comm, k)?;
    let mass = Matrix::diagonal(comm, b)?;
    let solver = Solver::new(comm, &stiffness, &mass, shift, factorisation, package)?;
    let mut pairs: Vec<Eigenpair> = Vec::new();
    let mut known: Vec<Vector> = Vec::new();
    let mut ask = wanted.min(total);
    for _ in 0..SWEEPS {
        let found = solver.solve(&stiffness, n, ask, &known)?;
        let largest = pairs.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
        let fresh = known.is_empty() || found.iter().any(|f| f.0 < largest);
        for (value, vector, values) in found {
            if !value.is_finite() || values.iter().any(|x| !x.is_finite()) {
                return Err(Error::Numerical(
                    "a Laplacian mode is not finite: look at the mesh for cells of extreme size or coefficients".into(),
                ));
            }
            pairs.push((value, values));
            known.push(vector);
        }
        ask = 2.min(total - known.len());
        if !fresh || ask == 0 {
            break;
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(pairs)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of tridiag(-1, 2, -1).
    fn second_difference(n: i32) -> SymmetricRows {
        let mut rows = SymmetricRows {
            row: vec![0],
            ..Default::default()
        };
        for i in 0..n {
            for j in (i - 1).max(0)..=(i + 1).min(n - 1) {
                rows.column.push(j);
                rows.value.push(if i == j { 2.0 } else { -1.0 });
            }
            rows.row.push(rows.column.len() as i32);
        }
        rows
    }

    #[test]
    fn eigenvalues_of_the_second_difference() {
        let pairs =
            smallest_eigenpairs(&Comm::serial(), &second_difference(40), &[0.5; 40], -1e-3, 3).unwrap();
        for (k, (value, vector)) in pairs.iter().take(3).enumerate() {
            let exact = 4.0 * (2.0 - 2.0 * ((k + 1) as f64 * std::f64::consts::PI / 41.0).cos()) / 2.0;
            assert!((value / exact - 1.0).abs() < 1e-10);
            let norm: f64 = vector.iter().map(|x| 0.5 * x * x).sum();
            assert!((norm - 1.0).abs() < 1e-10);
        }
    }

    #[test]
    fn a_matrix_that_cannot_be_solved_is_an_error() {
        let mut rows = second_difference(40);
        rows.value[6] = f64::NAN; // a diagonal entry: only half of the others is read
        let error = smallest_eigenpairs(&Comm::serial(), &rows, &[1.0; 40], 0.0, 3).unwrap_err();
        assert!(
            matches!(&error, Error::Numerical(m) if m.contains("PETSc error") || m.contains("not finite")),
            "{error}"
        );
        let empty = SymmetricRows {
            column: vec![9; 40],
            ..second_difference(40)
        };
        let error = smallest_eigenpairs(&Comm::serial(), &empty, &[1.0; 40], 0.0, 3).unwrap_err();
        assert!(
            matches!(&error, Error::Numerical(m) if m.contains("PETSc error")),
            "{error}"
        );
        // And PETSc still works.
        eigenvalues_of_the_second_difference();
    }
}
