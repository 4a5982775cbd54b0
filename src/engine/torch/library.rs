//! `libm4gn_torch.so`, loaded when something needs libtorch and not before: the backend `torch` and `m4gn train`.
//!
//! Its C interface, version [`ABI_VERSION`]:
//!
//! ```c
//! uint32_t    m4gn_torch_abi_version(void);
//! const char *m4gn_torch_last_error(void);                /* of this thread, valid until its next call */
//! int32_t     m4gn_torch_load(const char *model_path, const m4gn_torch_graph *graph,
//!                             const char *device,         /* "cpu", "cuda:0"; NULL: the library's choice */
//!                             void **handle);             /* 0 fine; the graph is copied */
//! int32_t     m4gn_torch_step(void *handle,
//!                             const float *inputs,        /* [n_owned * n_field_inputs], physical */
//!                             float *outputs);            /* [n_cells * n_outputs], physical, changes not added */
//! void        m4gn_torch_free(void *handle);
//! int32_t     m4gn_torch_train(const char *request,       /* JSON: m4gn_torch::request::Request */
//!                              const uint8_t *stop);      /* changed atomically; nonzero: save and stop */
//! ```
//!
//! Statuses are those of the C ABI of `m4gn.h`.

use crate::{Error, Result};
use libloading::Library;
use std::ffi::{CStr, CString, c_char, c_void};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU8;

/// Version of the interface; both sides must have the same.
pub const ABI_VERSION: u32 = 1;

/// File name of the library.
pub const NAME: &str = "libm4gn_torch.so";

type LastError = unsafe extern "C" fn() -> *const c_char;

/// The loaded library.
#[derive(Debug)]
pub struct TorchLibrary {
    library: Library,
    path: PathBuf,
    last_error: LastError,
}

impl TorchLibrary {
    /// Loads it and checks its version.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be loaded (libtorch is not found) or is of another version.
    pub fn load(path: PathBuf) -> Result<Self> {
        // SAFETY: loading runs the initialisers of our own library, found where we install it, and of libtorch.
        let library = unsafe { Library::new(&path) }.map_err(|e| {
            Error::file(
                &path,
                format!(
                    "cannot be loaded ({e}). It needs libtorch: build it with `cargo build --release -p m4gn-torch`, \
                     with LIBTORCH set to libtorch's folder; `m4gn doctor` checks what there is"
                ),
            )
        })?;
        // SAFETY: the type of this function is the same in all versions of the interface.
        let version =
            unsafe { symbol::<unsafe extern "C" fn() -> u32>(&library, &path, "m4gn_torch_abi_version")?() };
        if version != ABI_VERSION {
            return Err(Error::file(
                &path,
                format!(
                    "version {version} of its interface, this program needs {ABI_VERSION}: build both from one checkout"
                ),
            ));
        }
        // SAFETY: the version fixes the type.
        let last_error = unsafe { symbol::<LastError>(&library, &path, "m4gn_torch_last_error")? };
        Ok(TorchLibrary {
            library,
            path,
            last_error,
        })
    }

    /// The library beside this code's own file, in `../../lib` of it, or in `$M4GN_HOME/lib`.
    ///
    /// # Errors
    /// [`Error::File`] naming the places, where it is in none of them.
    pub fn find() -> Result<PathBuf> {
        let own = own_folder();
        let home = std::env::var_os("M4GN_HOME").map(|h| PathBuf::from(h).join("lib"));
        let folders = [own.clone(), own.map(|f| f.join("../../lib")), home];
        let tried: Vec<PathBuf> = folders.into_iter().flatten().map(|f| f.join(NAME)).collect();
        tried.iter().find(|p| p.is_file()).cloned().ok_or_else(|| {
            let list: Vec<_> = tried.iter().map(|p| p.display().to_string()).collect();
            Error::file(
                NAME,
                format!(
                    "not found; looked for {}. Build it (`cargo build --release -p m4gn-torch`) or use backend native",
                    list.join(", ")
                ),
            )
        })
    }

    /// A function of the library.
    ///
    /// # Safety
    /// `T` must be the function's type in version [`ABI_VERSION`]; what comes back is valid while the library is loaded.
    pub(super) unsafe fn function<T: Copy>(&self, name: &str) -> Result<T> {
        // SAFETY: passed on to the caller.
        unsafe { symbol(&self.library, &self.path, name) }
    }

    /// Trains as the request says; `stop` nonzero: save and stop.
    ///
    /// # Errors
    /// What the library reports.
    pub fn train(&self, request: &serde_json::Value, stop: &AtomicU8) -> Result<()> {
        let text = c_string(&request.to_string())?;
        // SAFETY: the type is that of the interface.
        let train = unsafe {
            self.function::<unsafe extern "C" fn(*const c_char, *const u8) -> i32>("m4gn_torch_train")?
        };
        // SAFETY: a NUL-terminated string and a byte that is only changed atomically; both outlive the call.
        self.check(unsafe { train(text.as_ptr(), stop.as_ptr()) })
    }

    /// Turns a status into the error that the library kept for this thread.
    ///
    /// # Errors
    /// That error, of the class that the status says.
    pub fn check(&self, status: i32) -> Result<()> {
        if status == 0 {
            return Ok(());
        }
        // SAFETY: the function returns null or a string that is valid until the next call on this thread.
        let message = unsafe {
            let text = (self.last_error)();
            match text.is_null() {
                true => "no message".into(),
                false => CStr::from_ptr(text).to_string_lossy().into_owned(),
            }
        };
        Err(match status {
            3 => Error::Model(message),
            4 => Error::Mesh(message),
            5 => Error::Numerical(message),
            6 => Error::Interrupted(message),
            s if s < 0 => Error::Internal(message),
            // Of a file's error the message already begins with the path.
            _ => Error::Input(message),
        })
    }
}

/// # Safety
/// `T` must be the function's type.
unsafe fn symbol<T: Copy>(library: &Library, path: &Path, name: &str) -> Result<T> {
    // SAFETY: passed on to the caller.
    unsafe { library.get::<T>(name) }
        .map(|s| *s)
        .map_err(|e| Error::file(path, format!("has no function {name} ({e}): build it again")))
}

/// # Errors
/// [`Error::Input`] for a text with a zero byte.
pub(super) fn c_string(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error::Input(format!("{text:?} contains a zero byte")))
}

/// Folder of the file that this code was loaded from: libm4gn.so in a solver, the program elsewhere.
fn own_folder() -> Option<PathBuf> {
    let mut info = std::mem::MaybeUninit::<libc::Dl_info>::zeroed();
    let here = own_folder as *const c_void;
    // SAFETY: dladdr fills the struct when it returns non-zero; the name then points to a string of the loader.
    let name = unsafe {
        if libc::dladdr(here, info.as_mut_ptr()) == 0 {
            return None;
        }
        let info = info.assume_init();
        if info.dli_fname.is_null() {
            return None;
        }
        CStr::from_ptr(info.dli_fname)
    };
    let path = std::path::absolute(Path::new(name.to_str().ok()?)).ok()?;
    path.parent().map(Path::to_path_buf)
}
