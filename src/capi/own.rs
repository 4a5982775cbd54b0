//! A surrogate of the host's own in a ride.

use super::raw::{self, FieldData, FieldOut};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_ride::{Advanced, Surrogate};
use m4gn_step::{Field, FieldMut};
use std::ffi::{CString, c_char, c_void};

/// A step of a host's surrogate.
type StepFunction = unsafe extern "C" fn(*mut c_void, *const FieldData, i32, *const FieldOut, i32) -> i32;

/// `m4gn_surrogate`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct SurrogateData {
    pub name: *const c_char,
    pub stride: f64,
    pub n_fields: i32,
    pub field_names: *const *const c_char,
    pub field_components: *const i32,
    pub step: Option<StepFunction>,
    pub data: *mut c_void,
}

/// It, as the ride has it.
pub(super) struct Own {
    comm: Comm,
    name: String,
    stride: f64,
    advanced: Vec<Advanced>,
    step: StepFunction,
    data: *mut c_void,
}

impl Own {
    /// # Safety
    /// Pointers must be what `m4gn.h` says, and function and data remain so while the surrogate lives.
    pub unsafe fn new(given: *const SurrogateData, comm: Comm, solved: usize) -> Result<Self> {
        // SAFETY: passed on to the caller.
        unsafe {
            let given = raw::reference("surrogate", given)?;
            let n = raw::count("surrogate.n_fields", given.n_fields)?;
            let names = raw::slice("surrogate.field_names", given.field_names, n)?;
            let components = raw::slice("surrogate.field_components", given.field_components, n)?;
            let mut advanced = Vec::new();
            for (&name, &components) in names.iter().zip(components) {
                let name = raw::text("surrogate.field_names", name)?.to_string();
                let solved = match components {
                    1 => 1,
                    3 => solved,
                    n => {
                        return Err(Error::Input(format!(
                            "surrogate: field '{name}': expected 1 or 3 components, found {n}"
                        )));
                    }
                };
                advanced.push(Advanced { name, components: components as usize, solved });
            }
            if advanced.is_empty() || !(given.stride.is_finite() && given.stride > 0.0) {
                return Err(Error::Input(format!(
                    "surrogate: expected at least one field and a stride above 0, found {} and {} s",
                    advanced.len(),
                    given.stride
                )));
            }
            let step = given.step;
            Ok(Own {
                comm,
                name: raw::text("surrogate.name", given.name)?.to_string(),
                stride: given.stride,
                advanced,
                step: step
                    .ok_or_else(|| Error::Input("surrogate.step: expected a function, found null".into()))?,
                data: given.data,
            })
        }
    }

    /// What all ranks must be given alike.
    pub fn shared(&self) -> String {
        format!("{} {:?} {:?}", self.name, self.stride, self.advanced)
    }
}

impl Surrogate for Own {
    fn name(&self) -> &str {
        &self.name
    }

    fn source(&self) -> String {
        self.name.clone()
    }

    fn digest(&self) -> String {
        self.shared()
    }

    fn stride(&self) -> f64 {
        self.stride
    }

    fn advances(&self) -> &[Advanced] {
        &self.advanced
    }

    fn growth(&self, _: &str) -> Option<Vec<f64>> {
        None
    }

    fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let text =
            |name: &str| CString::new(name).map_err(|_| Error::Internal("a name with a zero byte".into()));
        let names: Vec<CString> = fields.iter().map(|f| text(f.name)).collect::<Result<_>>()?;
        let places: Vec<CString> = out.iter().map(|f| text(f.name)).collect::<Result<_>>()?;
        let pairs = fields.iter().zip(&names);
        let given: Vec<FieldData> = pairs
            .map(|(f, name)| FieldData {
                name: name.as_ptr(),
                components: f.components as i32,
                cells: f.cells.as_ptr(),
                boundary: f.boundary.as_ptr(),
            })
            .collect();
        let before: Vec<Vec<f64>> = out.iter().map(|f| f.cells.to_vec()).collect();
        let pairs = out.iter_mut().zip(&places);
        let filled: Vec<FieldOut> = pairs
            .map(|(f, name)| FieldOut {
                name: name.as_ptr(),
                components: f.components as i32,
                cells: f.cells.as_mut_ptr(),
            })
            .collect();
        // SAFETY: arrays of these lengths, which live through the call; the host's function and data, as the header says.
        let status = unsafe {
            (self.step)(self.data, given.as_ptr(), given.len() as i32, filled.as_ptr(), filled.len() as i32)
        };
        let finite = out.iter().all(|f| f.cells.iter().all(|v| v.is_finite()));
        let found = match status {
            0 if finite => Ok(()),
            0 | 5 => Err(Error::Numerical(format!("the surrogate {} has no finite result", self.name))),
            status => Err(Error::Input(format!("the surrogate {} failed with status {status}", self.name))),
        };
        let found = self.comm.agree(found);
        if found.is_err() {
            for (place, before) in out.iter_mut().zip(before) {
                place.cells.copy_from_slice(&before);
            }
        }
        found
    }
}
