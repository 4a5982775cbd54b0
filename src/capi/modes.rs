//! Exports: modes of a host's own pair of matrices.

use super::raw;
use crate::modes::{self, Mass, ModalOptions, ModalSolver, ModeCount, Modes, Problem, Rows};
use crate::parallel::Comm;
use crate::{Error, Result};
use std::ffi::c_char;

/// `m4gn_csr`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct CsrData {
    pub n_rows: i32,
    pub row: *const i64,
    pub column: *const i64,
    pub value: *const f64,
}

/// `m4gn_modes_options`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct ModesOptionsData {
    pub modes: i32,
    pub symmetric: i32,
    pub block: i32,
    pub energy: f64,
    pub shift: f64,
    pub positions: *const f64,
    pub solver: *const c_char,
    pub petsc: *const c_char,
}

/// `m4gn_modes`
pub struct ModesHandle {
    pub(super) modes: Modes,
    pub(super) n_rows: usize,
}

impl CsrData {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn read(&self, name: &str) -> Result<Rows> {
        let n = raw::count(name, self.n_rows)?;
        let what = |part: &str| format!("{name}, {part}");
        // SAFETY: passed on to the caller.
        let offsets = unsafe { raw::slice(&what("row"), self.row, n + 1)? };
        let row = offsets
            .iter()
            .map(|&r| usize::try_from(r))
            .collect::<std::result::Result<Vec<_>, _>>();
        let row = row.map_err(|_| Error::Input(format!("{}: an offset is negative", what("row"))))?;
        let entries = row.last().copied().unwrap_or(0);
        // SAFETY: as above; the header gives the length.
        unsafe {
            Ok(Rows {
                row,
                column: raw::slice(&what("column"), self.column, entries)?.to_vec(),
                value: raw::slice(&what("value"), self.value, entries)?.to_vec(),
            })
        }
    }
}

impl ModesOptionsData {
    const DEFAULT: Self = ModesOptionsData {
        modes: 6,
        symmetric: 1,
        block: 1,
        energy: 0.0,
        shift: f64::NAN,
        positions: std::ptr::null(),
        solver: std::ptr::null(),
        petsc: std::ptr::null(),
    };

    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    pub(super) unsafe fn read(&self) -> Result<ModalOptions> {
        let modes = raw::count("modes", self.modes)?;
        // SAFETY: passed on to the caller.
        let (solver, petsc) = unsafe {
            (
                raw::optional_text("solver", self.solver)?,
                raw::optional_text("petsc", self.petsc)?,
            )
        };
        Ok(ModalOptions {
            // A comparison that NaN fails, so that it is passed on and refused.
            count: match self.energy <= 0.0 {
                true => ModeCount::Fixed(modes),
                false => ModeCount::Energy {
                    share: self.energy,
                    most: modes,
                },
            },
            solver: solver.map_or(Ok(ModalSolver::Auto), ModalSolver::parse)?,
            petsc: petsc.unwrap_or_default().into(),
        })
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read(
    stiffness: *const CsrData,
    mass: *const CsrData,
    options: *const ModesOptionsData,
) -> Result<(Problem, ModalOptions)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let data = raw::reference("options", options)?;
        let stiffness = raw::reference("stiffness", stiffness)?.read("stiffness")?;
        let mass = match mass.is_null() {
            true => Mass::Diagonal(vec![1.0; stiffness.n()]),
            false => Mass::Matrix(raw::reference("mass", mass)?.read("mass")?),
        };
        let block = raw::count("block", data.block)?;
        let points = stiffness.n() / block.max(1);
        let positions = match data.positions.is_null() {
            true => Vec::new(),
            false => raw::vectors("positions", data.positions, points)?.to_vec(),
        };
        let problem = Problem {
            stiffness,
            mass,
            symmetric: data.symmetric != 0,
            block,
            positions,
            shift: (!data.shift.is_nan()).then_some(data.shift),
        };
        Ok((problem, data.read()?))
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    comm: i32,
    stiffness: *const CsrData,
    mass: *const CsrData,
    options: *const ModesOptionsData,
) -> Result<ModesHandle> {
    let comm = Comm::from_fortran(comm)?;
    // SAFETY: passed on to the caller.
    let (mut problem, options) = comm.agree(unsafe { read(stiffness, mass, options) })?;
    problem.simplify(&comm);
    Ok(ModesHandle {
        modes: modes::solve(&problem, &comm, &options)?,
        n_rows: problem.stiffness.n(),
    })
}

exports! {
    /// Six modes of a symmetric pair with one unknown a point.
    fn m4gn_modes_options_init(options: *mut ModesOptionsData) -> (), or |_| (); {
        // SAFETY: the host's struct.
        *unsafe { raw::reference_mut("options", options)? } = ModesOptionsData::DEFAULT;
        Ok(())
    }

    /// Solves for the modes.
    fn m4gn_modes_new(
        comm: i32,
        stiffness: *const CsrData,
        mass: *const CsrData,
        options: *const ModesOptionsData,
        modes: *mut *mut ModesHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let modes = raw::reference_mut("modes", modes)?;
            *modes = std::ptr::null_mut();
            *modes = Box::into_raw(Box::new(new(comm, stiffness, mass, options)?));
        }
        Ok(0)
    }

    /// Frees modes; null is none.
    fn m4gn_modes_free(modes: *mut ModesHandle) -> (), or |_| (); {
        if !modes.is_null() {
            // SAFETY: made by m4gn_modes_new and freed once.
            drop(unsafe { Box::from_raw(modes) });
        }
        Ok(())
    }

    /// Modes found; -1 for null.
    fn m4gn_modes_count(modes: *const ModesHandle) -> i32, or |_| -1; {
        // SAFETY: modes of ours, or null.
        Ok(unsafe { raw::reference("modes", modes)? }.modes.eigenvalues.len() as i32)
    }

    /// Eigenvalues, ascending.
    fn m4gn_modes_eigenvalues(modes: *const ModesHandle, eigenvalues: *mut f64) -> i32, or |s| s; {
        // SAFETY: modes of ours and the host's array of their count, or null.
        unsafe {
            let found = &raw::reference("modes", modes)?.modes.eigenvalues;
            raw::slice_mut("eigenvalues", eigenvalues, found.len())?.copy_from_slice(found);
        }
        Ok(0)
    }

    /// One mode.
    fn m4gn_modes_vector(modes: *const ModesHandle, index: i32, vector: *mut f64) -> i32, or |s| s; {
        // SAFETY: modes of ours and the host's array of n_rows, or null.
        let (handle, out) = unsafe {
            let handle = raw::reference("modes", modes)?;
            (handle, raw::slice_mut("vector", vector, handle.n_rows)?)
        };
        let vectors = &handle.modes.vectors;
        let found = usize::try_from(index).ok().and_then(|i| vectors.get(i)).ok_or_else(|| {
            Error::Input(format!("mode index: expected 0 to {}, found {index}", vectors.len() as i64 - 1))
        })?;
        out.copy_from_slice(found);
        Ok(0)
    }
}
