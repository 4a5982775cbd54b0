//! The backend `torch`: the same model run by libtorch in `libm4gn_torch.so`, loaded when it is asked for. Serial
//! only.

mod library;

pub use library::{LIBRARY, TorchTrial, library, train};

use super::{Forward, check_lengths};
use m4gn_base::plugin::{Plugin, c_string};
use m4gn_base::{Error, Result, refuse};
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use std::ffi::{c_char, c_void};

type Load = unsafe extern "C" fn(*const u8, u64, *const c_char, *const c_char, *mut *mut c_void) -> i32;
type Step = unsafe extern "C" fn(*mut c_void, *const f32, *mut f32) -> i32;
type Free = unsafe extern "C" fn(*mut c_void);

/// A model loaded by the library.
#[derive(Debug)]
pub struct TorchBackend {
    handle: *mut c_void,
    step: Step,
    free: Free,
    /// Of a step's inputs and outputs.
    lengths: (usize, usize),
    library: &'static Plugin,
}

impl TorchBackend {
    /// Loads the library and the model.
    ///
    /// `lengths` are those of a step's inputs and outputs; `device` as in `m4gn_torch_load`.
    ///
    /// # Errors
    /// [`Error::Input`] on more than one rank; [`Error::File`] when the library is missing, cannot be loaded or
    /// is of another version; what the library itself reports.
    pub fn new(
        model: &Model,
        structure: &Structure,
        lengths: (usize, usize),
        device: Option<&str>,
        comm: &Comm,
    ) -> Result<Self> {
        if comm.size() > 1 {
            let n = comm.size();
            return Err(Error::Input(format!(
                "backend torch runs on one rank, found {n}; use backend native, or run the solver in serial"
            )));
        }
        let bytes = model.to_bytes()?;
        let device = device.map(c_string).transpose()?;
        let library = library()?;
        // SAFETY: the library's version fixes the types of these functions.
        let (load, step, free) = unsafe {
            (
                library.function::<Load>("m4gn_torch_load")?,
                library.function::<Step>("m4gn_torch_step")?,
                library.function::<Free>("m4gn_torch_free")?,
            )
        };
        let text =
            serde_json::to_string(structure).map_err(|e| Error::Internal(format!("structure: {e}")))?;
        let text = c_string(&text)?;
        let mut handle = std::ptr::null_mut();
        let device = device.as_ref().map_or(std::ptr::null(), |d| d.as_ptr());
        // SAFETY: all pointers are valid for the call, the text ends with NUL, and the bytes are so many.
        let status = unsafe { load(bytes.as_ptr(), bytes.len() as u64, text.as_ptr(), device, &mut handle) };
        library.check(status)?;
        refuse(handle.is_null(), Error::Internal, || "libm4gn_torch.so loaded no model")?;
        Ok(TorchBackend { handle, step, free, lengths, library })
    }
}

impl Forward for TorchBackend {
    fn forward(&mut self, _comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        check_lengths(self.lengths, inputs, outputs)?;
        // SAFETY: the handle lives until drop, the slices have the lengths that the library expects.
        let status = unsafe { (self.step)(self.handle, inputs.as_ptr(), outputs.as_mut_ptr()) };
        self.library.check(status)
    }

    fn set_edges(&mut self, _: &Structure) -> Result<()> {
        Err(Error::Internal("libtorch's graph has edges that stay".into()))
    }
}

impl Drop for TorchBackend {
    fn drop(&mut self) {
        // SAFETY: the handle came from m4gn_torch_load and is freed once.
        unsafe { (self.free)(self.handle) };
    }
}
