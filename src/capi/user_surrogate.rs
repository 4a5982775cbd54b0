//! A surrogate of the host's own in a ride.

use super::pointers;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_ride::{Description, Growth, Start, Surrogate};
use m4gn_state::{Layout, Values};
use std::ffi::{c_char, c_void};

/// A step of a host's surrogate.
type StepFunction = unsafe extern "C" fn(*mut c_void, *const *const f64, *const *mut f64) -> i32;

/// `m4gn_surrogate`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct SurrogateData {
    pub name: *const c_char,
    pub stride: f64,
    pub n_fields: i32,
    pub fields: *const *const c_char,
    pub step: Option<StepFunction>,
    pub data: *mut c_void,
}

/// A host's function as a surrogate.
pub(super) struct UserSurrogate {
    comm: Comm,
    description: Description,
    step: StepFunction,
    data: *mut c_void,
}

impl UserSurrogate {
    /// # Safety
    /// Pointers must be what `m4gn.h` says, and function and data remain so while the surrogate lives.
    pub unsafe fn new(own: *const SurrogateData, comm: Comm, layout: &Layout) -> Result<Self> {
        // SAFETY: passed on to the caller.
        let (own, name, names) = unsafe {
            let own = pointers::reference("own", own)?;
            let n = pointers::count("own.n_fields", own.n_fields)?;
            let names = pointers::slice("own.fields", own.fields, n)?;
            let text = |&name: &*const c_char| pointers::text("own.fields", name);
            (own, pointers::text("own.name", own.name)?, names.iter().map(text).collect::<Result<Vec<_>>>()?)
        };
        let mut advances: Vec<usize> = Vec::new();
        for field in &names {
            let new = |i: &usize| layout.arrays()[*i].is_measured() && !advances.contains(i);
            let array = layout.at_nodes(field).filter(new);
            advances.push(array.ok_or_else(|| {
                Error::Input(format!(
                    "own: fields: '{field}' is no array of the state that is solved, or follows, or is named twice"
                ))
            })?);
        }
        if advances.is_empty() || !(own.stride.is_finite() && own.stride > 0.0) {
            return Err(Error::Input(format!(
                "own: expected at least one field and a stride above 0, found {} and {} s",
                advances.len(),
                own.stride
            )));
        }
        let step =
            own.step.ok_or_else(|| Error::Input("own.step: expected a function, found null".into()))?;
        let description = Description {
            name: name.to_string(),
            source: name.to_string(),
            digest: format!("{name} {:?} {names:?}", own.stride),
            stride: own.stride,
            reads: (0..layout.arrays().len()).collect(),
            growth: vec![Growth::Unknown; advances.len()],
            advances,
            ..Description::default()
        };
        Ok(UserSurrogate { comm, description, step, data: own.data })
    }

    /// What all ranks must be given alike.
    pub fn shared(&self) -> &str {
        &self.description.digest
    }
}

impl Surrogate for UserSurrogate {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()> {
        let state: Vec<*const f64> = start.state.iter().map(|v| v.as_ptr()).collect();
        let mut result = next.clone();
        let mut places = vec![std::ptr::null_mut(); state.len()];
        for (&array, values) in self.description.advances.iter().zip(&mut result) {
            places[array] = values.as_mut_ptr();
        }
        // SAFETY: arrays of the described lengths, which live through the call; the host's function and data, as the header says.
        let status = unsafe { (self.step)(self.data, state.as_ptr(), places.as_ptr()) };
        let finite = result.iter().flatten().all(|v| v.is_finite());
        let name = &self.description.name;
        let found = match status {
            0 if finite => Ok(()),
            0 | 5 => Err(Error::Numerical(format!("the surrogate {name} has no finite result"))),
            status => Err(Error::Input(format!("the surrogate {name} failed with status {status}"))),
        };
        self.comm.agree(found)?;
        *next = result;
        Ok(())
    }
}
