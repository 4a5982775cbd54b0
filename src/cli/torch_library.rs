//! `libm4gn_torch.so`, loaded when a command needs libtorch and not before.
#![allow(unsafe_code)]

use crate::{Error, Result};
use libloading::{Library, Symbol};
use std::ffi::{CStr, CString, c_char};
use std::path::PathBuf;
use std::sync::atomic::AtomicU8;

/// File name of the library.
pub const NAME: &str = "libm4gn_torch.so";
/// Version of its C interface that this program speaks.
const ABI_VERSION: u32 = 1;

/// The loaded library.
pub struct TorchLibrary {
    library: Library,
    path: PathBuf,
}

impl TorchLibrary {
    /// Finds and loads it, and checks its version.
    ///
    /// Errors: [`Error::File`] where it is missing, cannot be loaded (libtorch is not found) or is of another
    /// version.
    pub fn load(path: PathBuf) -> Result<Self> {
        // SAFETY: the initialisers of this library and of libtorch are those of well-behaved shared libraries;
        // the path is that of our own installation.
        let library = unsafe { Library::new(&path) }.map_err(|e| {
            Error::file(
                &path,
                format!("cannot be loaded ({e}). Training needs libtorch: build with `cargo build --release -p m4gn-torch`, with LIBTORCH set to its folder, beside this program"),
            )
        })?;
        let loaded = TorchLibrary { library, path };
        // SAFETY: the function takes nothing and returns an integer in every version of the interface.
        let version = unsafe { loaded.symbol::<unsafe extern "C" fn() -> u32>("m4gn_torch_abi_version")?() };
        if version != ABI_VERSION {
            return Err(Error::file(
                &loaded.path,
                format!(
                    "version {version} of its interface, this program needs {ABI_VERSION}: build both from one checkout"
                ),
            ));
        }
        Ok(loaded)
    }

    /// Trains as the request says (the JSON of `m4gn_torch::request::Request`); `stop` nonzero: save and stop.
    pub fn train(&self, request: &serde_json::Value, stop: &AtomicU8) -> Result<()> {
        let text = CString::new(request.to_string())
            .map_err(|_| Error::Input("a path holds a NUL character".into()))?;
        let train =
            self.symbol::<unsafe extern "C" fn(*const c_char, *const u8) -> i32>("m4gn_torch_train")?;
        // SAFETY: a NUL-terminated string and a byte that is only changed atomically; both outlive the call.
        let status = unsafe { train(text.as_ptr(), stop.as_ptr()) };
        self.check(status)
    }

    /// Turns a status into the error that the library tells.
    fn check(&self, status: i32) -> Result<()> {
        if status == 0 {
            return Ok(());
        }
        let last = self.symbol::<unsafe extern "C" fn() -> *const c_char>("m4gn_torch_last_error")?;
        // SAFETY: the library returns a NUL-terminated string that lives until this thread's next call.
        let message = unsafe { CStr::from_ptr(last()) }.to_string_lossy().into_owned();
        Err(match status {
            1 => Error::Input(message),
            3 => Error::Model(message),
            4 => Error::Mesh(message),
            5 => Error::Numerical(message),
            6 => Error::Interrupted(message),
            s if s < 0 => Error::Internal(message),
            // The message already starts with the file's path.
            _ => Error::Input(message),
        })
    }

    fn symbol<T>(&self, name: &str) -> Result<Symbol<'_, T>> {
        // SAFETY: callers name the type that the interface of `ABI_VERSION` gives this symbol.
        unsafe { self.library.get(name.as_bytes()) }.map_err(|e| {
            Error::file(
                &self.path,
                format!("has no function {name} ({e}): build it again"),
            )
        })
    }
}
