//! PETSc's matrices and vectors, destroyed when dropped.

use super::door::Csr;
use super::{c, check, raw};
use m4gn_base::Result;
use m4gn_parallel::Comm;

macro_rules! owned {
    ($name:ident, $type:ty, $destroy:path) => {
        pub(super) struct $name(pub(super) $type);
        impl $name {
            pub(super) fn null() -> Self {
                Self(std::ptr::null_mut())
            }
        }
        impl Drop for $name {
            fn drop(&mut self) {
                // On the way out of a panic the other ranks are not here, and to destroy a factor takes them all.
                if !self.0.is_null() && !std::thread::panicking() {
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
    /// A symmetric matrix of these rows, `block` of them a point. Collective.
    pub(super) fn new(comm: &Comm, rows: Csr, block: usize) -> Result<Self> {
        let (row, column, value) = compress(rows);
        let n = rows.n() as c::PetscInt;
        let mut matrix = Matrix::null();
        // SAFETY: the arrays have n + 1 and row[n] entries and are copied; the matrix is destroyed on drop.
        unsafe {
            check(c::MatCreate(raw(comm), &mut matrix.0))?;
            check(c::MatSetSizes(matrix.0, n, n, c::PETSC_DECIDE, c::PETSC_DECIDE))?;
            check(c::MatSetType(matrix.0, c"aij".as_ptr()))?;
            check(c::MatSetBlockSize(matrix.0, block as c::PetscInt))?;
            let (row, column, value) = (row.as_ptr(), column.as_ptr(), value.as_ptr());
            // Each is ignored by the type that the other is for.
            check(c::MatSeqAIJSetPreallocationCSR(matrix.0, row, column, value))?;
            check(c::MatMPIAIJSetPreallocationCSR(matrix.0, row, column, value))?;
        }
        matrix.announce_symmetry()?;
        Ok(matrix)
    }

    /// Says that it is symmetric and stays so.
    pub(super) fn announce_symmetry(&self) -> Result<()> {
        for option in [c::MatOption_MAT_SYMMETRIC, c::MatOption_MAT_SYMMETRY_ETERNAL] {
            // SAFETY: a live matrix.
            check(unsafe { c::MatSetOption(self.0, option, c::PetscBool_PETSC_TRUE) })?;
        }
        Ok(())
    }

    /// A diagonal matrix. Collective.
    pub(super) fn diagonal(comm: &Comm, values: &[f64], block: usize) -> Result<Self> {
        let first = comm.exclusive_scan_i64(values.len() as i64);
        let row: Vec<usize> = (0..=values.len()).collect();
        let column: Vec<i64> = (first..first + values.len() as i64).collect();
        let rows = Csr { row: &row, column: &column, value: values };
        Matrix::new(comm, rows, block)
    }

    /// A vector of the matrix's layout. Collective.
    pub(super) fn vector(&self) -> Result<Vector> {
        let mut vector = Vector::null();
        // SAFETY: the other result is not asked for.
        check(unsafe { c::MatCreateVecs(self.0, &mut vector.0, std::ptr::null_mut()) })?;
        Ok(vector)
    }

    /// The matrix times a vector. Collective.
    pub(super) fn times(&self, x: &Vector) -> Result<Vector> {
        let y = self.vector()?;
        // SAFETY: live objects of one layout.
        check(unsafe { c::MatMult(self.0, x.0, y.0) })?;
        Ok(y)
    }
}

impl Solver {
    /// Solves; so many pairs converged. Collective.
    pub(super) fn solve(&self) -> Result<i32> {
        let mut converged = 0;
        // SAFETY: the solver is live and set up.
        unsafe {
            check(c::EPSSolve(self.0))?;
            check(c::EPSGetConverged(self.0, &mut converged))?;
        }
        Ok(converged)
    }

    /// Solves for the first eigenvalue, if one converges. Collective.
    pub(super) fn first(&self) -> Result<Option<f64>> {
        let mut value = 0.0;
        if self.solve()? < 1 {
            return Ok(None);
        }
        // SAFETY: one pair is there; its imaginary part is not asked for.
        check(unsafe { c::EPSGetEigenvalue(self.0, 0, &mut value, std::ptr::null_mut()) })?;
        Ok(Some(value))
    }
}

impl Vector {
    /// This rank's values.
    pub(super) fn values(&self) -> Result<Vec<f64>> {
        let (mut data, mut n) = (std::ptr::null(), 0);
        // SAFETY: PETSc lends its local array, of n values, until the restore.
        unsafe {
            check(c::VecGetLocalSize(self.0, &mut n))?;
            check(c::VecGetArrayRead(self.0, &mut data))?;
            let values = match n {
                0 => Vec::new(),
                _ => std::slice::from_raw_parts(data, n as usize).to_vec(),
            };
            check(c::VecRestoreArrayRead(self.0, &mut data))?;
            Ok(values)
        }
    }
}

/// Rows with ascending columns and one entry a place, in PETSc's integers.
fn compress(rows: Csr) -> (Vec<i32>, Vec<i32>, Vec<f64>) {
    let mut row = Vec::with_capacity(rows.row.len());
    let mut column = Vec::with_capacity(rows.column.len());
    let mut value: Vec<f64> = Vec::with_capacity(rows.value.len());
    let mut entries: Vec<(i64, f64)> = Vec::new();
    row.push(0);
    for w in rows.row.windows(2) {
        entries.clear();
        let columns = rows.column[w[0]..w[1]].iter().copied();
        entries.extend(columns.zip(rows.value[w[0]..w[1]].iter().copied()));
        entries.sort_by_key(|e| e.0);
        let start = column.len();
        for &(c, v) in &entries {
            match value.last_mut() {
                Some(last) if column.len() > start && column.last() == Some(&(c as i32)) => *last += v,
                _ => {
                    column.push(c as i32);
                    value.push(v);
                }
            }
        }
        row.push(column.len() as i32);
    }
    (row, column, value)
}
