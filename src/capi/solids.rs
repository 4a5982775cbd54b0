//! Exports: modes of elastic bodies.

use super::guard;
use super::modes::{ModesHandle, ModesOptions};
use super::pointers::{self, SolidData};
use m4gn_base::Result;
use m4gn_base::settings;
use m4gn_model::modal::Modes;
use m4gn_modes::fem;
use m4gn_modes::fem::HostBody;
use m4gn_parallel::Comm;
use std::ffi::c_char;

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read(body: *const SolidData, options: *const c_char) -> Result<(HostBody, String)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let mut found = HostBody::new(&pointers::reference("body", body)?.arrays()?);
        let asked = ModesOptions::of_body(pointers::options(options)?)?;
        found.options.modal = asked.modal();
        let o = &found.options;
        let asked = settings::lines(&asked)?;
        let same = format!("plane_stress {:?}\nfree_body {}\n{asked}", o.plane, o.free_body);
        Ok((found, same))
    }
}

/// Collective.
fn solve(comm: &Comm, body: HostBody) -> Result<ModesHandle> {
    let found = fem::modes(&body.mesh, &body.materials, &body.fixed, &body.options, comm)?;
    Ok(ModesHandle {
        n_rows: 3 * body.mesh.points.len(),
        modes: Modes {
            eigenvalues: found.eigenvalues,
            vectors: found.vectors.into_iter().map(|v| v.into_iter().flatten().collect()).collect(),
        },
    })
}

exports! {
    /// Solves for the modes of an elastic body.
    fn m4gn_solid_modes_new(
        comm: i32,
        body: *const SolidData,
        options: *const c_char,
        modes: *mut *mut ModesHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("modes", modes));
            guard::create("m4gn_solid_modes_new", comm, place, |_| read(body, options), solve)
        }
    }
}
