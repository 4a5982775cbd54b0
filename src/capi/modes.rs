//! Exports: modes of a host's own pair of matrices.

use super::guard;
use super::pointers;
use m4gn_base::settings;
use m4gn_base::{Error, Result};
use m4gn_model::SegmentSpec;
use m4gn_model::modal::{ModalOptions, ModalSolver, Modes};
use m4gn_modes as modes;
use m4gn_modes::{Mass, Problem, Rows};
use m4gn_parallel::Comm;
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

settings! {
    /// What is asked for, of a host's own matrices or of an elastic body.
    pub(super) struct ModesOptions in "modes" {
        /// Number of modes; repeated eigenvalues are taken whole, so there may be more.
        modes: usize = SegmentSpec::default().modes;
        /// The way to the modes: `auto` (by size), `direct` (factorisation) or `iterative` (multigrid).
        modal_solver: ModalSolver = ModalSolver::default();
        /// Unknowns a point, in consecutive rows.
        block: usize = 1;
        /// A number a little below the eigenvalues that are wanted.
        shift: Option<f64> = None, "estimated";
    }
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
        let n = pointers::count(name, self.n_rows)?;
        let what = |part: &str| format!("{name}, {part}");
        // SAFETY: passed on to the caller.
        let offsets = unsafe { pointers::slice(&what("row"), self.row, n + 1)? };
        let row = offsets.iter().map(|&r| usize::try_from(r)).collect::<std::result::Result<Vec<_>, _>>();
        let row = row.map_err(|_| Error::Input(format!("{}: an offset is negative", what("row"))))?;
        let entries = row.last().copied().unwrap_or(0);
        // SAFETY: as above; the header gives the length.
        unsafe {
            Ok(Rows {
                row,
                column: pointers::slice(&what("column"), self.column, entries)?.to_vec(),
                value: pointers::slice(&what("value"), self.value, entries)?.to_vec(),
            })
        }
    }
}

impl ModesOptions {
    /// From the text of a JSON object.
    pub(super) fn parse(text: &str) -> Result<Self> {
        settings::parse("modes", text, &[])
    }

    /// Of an elastic body, whose matrices are made here.
    pub(super) fn of_body(text: &str) -> Result<Self> {
        let options = Self::parse(text)?;
        let own = ModesOptions::default();
        match (options.block, options.shift) == (own.block, own.shift) {
            true => Ok(options),
            false => Err(Error::Input(
                "modes: block and shift are for matrices of the host; expected neither of them for an elastic body"
                    .into(),
            )),
        }
    }

    /// As a modal solution takes them.
    pub(super) fn modal(&self) -> ModalOptions {
        ModalOptions { count: self.modes, solver: self.modal_solver }
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read(
    stiffness: *const CsrData,
    mass: *const CsrData,
    positions: *const f64,
    options: *const c_char,
) -> Result<((Problem, ModalOptions), String)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let options = ModesOptions::parse(pointers::options(options)?)?;
        let same = format!("mass {}\n{}", !mass.is_null(), settings::lines(&options)?);
        let stiffness = pointers::reference("stiffness", stiffness)?.read("stiffness")?;
        let mass = match mass.is_null() {
            true => Mass::Diagonal(vec![1.0; stiffness.n()]),
            false => Mass::Matrix(pointers::reference("mass", mass)?.read("mass")?),
        };
        let points = stiffness.n() / options.block.max(1);
        let positions = match positions.is_null() {
            true => Vec::new(),
            false => pointers::vectors("positions", positions, points)?.to_vec(),
        };
        let problem = Problem { stiffness, mass, block: options.block, positions, shift: options.shift };
        Ok(((problem, options.modal()), same))
    }
}

/// Collective.
fn solve(comm: &Comm, (mut problem, options): (Problem, ModalOptions)) -> Result<ModesHandle> {
    problem.simplify(comm);
    Ok(ModesHandle { modes: modes::solve(&problem, comm, &options)?, n_rows: problem.stiffness.n() })
}

exports! {
    /// Solves for the modes.
    fn m4gn_modes_new(
        comm: i32,
        stiffness: *const CsrData,
        mass: *const CsrData,
        options: *const c_char,
        positions: *const f64,
        modes: *mut *mut ModesHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("modes", modes));
            guard::create("m4gn_modes_new", comm, place, |_| read(stiffness, mass, positions, options), solve)
        }
    }

    /// Modes found; -1 for null.
    fn m4gn_modes_n_modes(modes: *const ModesHandle) -> i32, or guard::no_count; {
        // SAFETY: modes of ours, or null.
        Ok(unsafe { pointers::reference("modes", modes)? }.modes.eigenvalues.len() as i32)
    }

    /// Eigenvalues, ascending.
    fn m4gn_modes_eigenvalues(modes: *const ModesHandle, eigenvalues: *mut f64) -> i32, or |s| s; {
        // SAFETY: modes of ours and the host's array of their count, or null.
        unsafe {
            let found = &pointers::reference("modes", modes)?.modes.eigenvalues;
            pointers::slice_mut("eigenvalues", eigenvalues, found.len())?.copy_from_slice(found);
        }
        Ok(0)
    }

    /// One mode.
    fn m4gn_modes_vector(modes: *const ModesHandle, index: i32, vector: *mut f64) -> i32, or |s| s; {
        // SAFETY: modes of ours and the host's array of n_rows, or null.
        let (handle, out) = unsafe {
            let handle = pointers::reference("modes", modes)?;
            (handle, pointers::slice_mut("vector", vector, handle.n_rows)?)
        };
        let vectors = &handle.modes.vectors;
        let found = usize::try_from(index).ok().and_then(|i| vectors.get(i)).ok_or_else(|| {
            Error::Input(format!("mode index: expected 0 to {}, found {index}", vectors.len() as i64 - 1))
        })?;
        out.copy_from_slice(found);
        Ok(0)
    }
}
