//! `libm4gn_torch.so`, loaded when something needs libtorch and not before: the backend `torch` and `m4gn train`.
//!
//! Its C interface, version [`LIBRARY`]`.version`:
//!
//! ```c
//! uint32_t    m4gn_torch_abi_version(void);
//! const char *m4gn_torch_last_error(void);                /* of this thread, valid until its next call */
//! int32_t     m4gn_torch_load(const uint8_t *model,       /* [size] a model file's bytes */
//!                             uint64_t size,
//!                             const char *structure,      /* JSON: m4gn_structure::Structure, of one rank */
//!                             const char *device,         /* "cpu", "cuda:0"; NULL: the library's choice */
//!                             void **handle);             /* 0 fine */
//! int32_t     m4gn_torch_step(void *handle,
//!                             const float *inputs,        /* [n_owned * n_field_inputs], physical */
//!                             float *outputs);            /* [n_cells * n_outputs], physical, changes not added */
//! void        m4gn_torch_free(void *handle);
//! int32_t     m4gn_torch_train(const char *request,       /* JSON: m4gn_train::Request */
//!                              const uint8_t *stop);      /* changed atomically; nonzero: save and stop */
//! int32_t     m4gn_torch_trial(const char *trial,         /* JSON: m4gn_workbench::bench::Trial */
//!                              const char *device, void **handle);
//! int32_t     m4gn_torch_trial_step(void *handle, double *loss);
//! void        m4gn_torch_trial_free(void *handle);
//! ```
//!
//! Statuses are those of the C ABI of `m4gn.h`.

use m4gn_base::Result;
use m4gn_base::plugin::{Description, Plugin, c_string};
use std::ffi::{c_char, c_void};
use std::sync::OnceLock;
use std::sync::atomic::AtomicU8;

/// The library.
pub const LIBRARY: Description = Description {
    file: "libm4gn_torch.so",
    prefix: "m4gn_torch",
    version: 8,
    remedy: "It needs libtorch: type setup/all.sh, which fetches libtorch and builds it; backend native \
             needs none of it",
    global: false,
};

/// The library, loaded once a process.
///
/// # Errors
/// [`m4gn_base::Error::File`] where it is not found, cannot be loaded (libtorch is not found) or is of another version.
pub fn library() -> Result<&'static Plugin> {
    static LOADED: OnceLock<Result<Plugin>> = OnceLock::new();
    LOADED.get_or_init(|| LIBRARY.load()).as_ref().map_err(Clone::clone)
}

/// Trains as the request says; `stop` nonzero: save and stop.
///
/// # Errors
/// As [`library`]; what the library reports.
pub fn train(request: &serde_json::Value, stop: &AtomicU8) -> Result<()> {
    let library = library()?;
    let text = c_string(&request.to_string())?;
    // SAFETY: the type is that of the interface.
    let train = unsafe {
        library.function::<unsafe extern "C" fn(*const c_char, *const u8) -> i32>("m4gn_torch_train")?
    };
    // SAFETY: a NUL-terminated string and a byte that is only changed atomically; both outlive the call.
    library.check(unsafe { train(text.as_ptr(), stop.as_ptr()) })
}

/// Steps of training on libtorch, to be measured.
#[derive(Debug)]
pub struct TorchTrial {
    library: &'static Plugin,
    handle: *mut c_void,
    step: unsafe extern "C" fn(*mut c_void, *mut f64) -> i32,
    free: unsafe extern "C" fn(*mut c_void),
}

impl TorchTrial {
    /// Of a trial in JSON, on a device.
    ///
    /// # Errors
    /// As [`library`]; what the library reports.
    pub fn new(trial: &serde_json::Value, device: &str) -> Result<Self> {
        type Make = unsafe extern "C" fn(*const c_char, *const c_char, *mut *mut c_void) -> i32;
        let library = library()?;
        let (text, device) = (c_string(&trial.to_string())?, c_string(device)?);
        // SAFETY: the types are those of the interface.
        let (make, step, free) = unsafe {
            (
                library.function::<Make>("m4gn_torch_trial")?,
                library.function("m4gn_torch_trial_step")?,
                library.function("m4gn_torch_trial_free")?,
            )
        };
        let mut handle = std::ptr::null_mut();
        // SAFETY: NUL-terminated strings and a place for the handle; all outlive the call.
        library.check(unsafe { make(text.as_ptr(), device.as_ptr(), &mut handle) })?;
        Ok(TorchTrial { library, handle, step, free })
    }

    /// One step; its loss.
    ///
    /// # Errors
    /// What the library reports.
    pub fn step(&mut self) -> Result<f64> {
        let mut loss = 0.0;
        // SAFETY: the handle came from m4gn_torch_trial and lives until drop.
        let status = unsafe { (self.step)(self.handle, &mut loss) };
        self.library.check(status)?;
        Ok(loss)
    }
}

impl Drop for TorchTrial {
    fn drop(&mut self) {
        // SAFETY: the handle came from m4gn_torch_trial and is freed once.
        unsafe { (self.free)(self.handle) };
    }
}
