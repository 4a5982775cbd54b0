//! Loads `libm4gn_foam_bridge.so` and calls its C interface (`cpp/src/abi.rs`, version 2).
#![allow(unsafe_code)]

use crate::{Error, Result};
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_NOW, Symbol};
use std::{
    ffi::{CStr, CString, c_char, c_void},
    path::Path,
    ptr,
    sync::OnceLock,
};

/// Version of the C interface that this code speaks.
const ABI_VERSION: u32 = 2;

/// Where OpenFOAM keeps `etc/controlDict` when the user has not sourced an OpenFOAM of their own.
const PROJECT_DIR: &str = match option_env!("M4GN_FOAM_PROJECT_DIR") {
    Some(dir) => dir,
    None => "/usr/share/openfoam",
};

type Open = unsafe extern "C" fn(*const c_char, *mut *mut c_void) -> i32;
type Close = unsafe extern "C" fn(*mut c_void);
type Describe = unsafe extern "C" fn(*mut c_void, *mut *const c_char) -> i32;
type Query = unsafe extern "C" fn(*mut c_void, *const c_char, *mut *const f64, *mut usize) -> i32;

type Write = unsafe extern "C" fn(*mut c_void, *const c_char, *const f64, usize) -> i32;

/// The loaded library. It is never unloaded: OpenFOAM's tables and signal handlers would outlive it.
pub struct FoamBridge {
    _library: Library,
    last_error: Symbol<unsafe extern "C" fn() -> *const c_char>,
    open: Symbol<Open>,
    close: Symbol<Close>,
    describe: Symbol<Describe>,
    query: Symbol<Query>,
    write: Symbol<Write>,
}

static LOADED: OnceLock<Result<FoamBridge>> = OnceLock::new();

/// The bridge, loaded from `path` the first time.
pub fn load(path: &Path) -> Result<&'static FoamBridge> {
    LOADED
        .get_or_init(|| FoamBridge::load(path))
        .as_ref()
        .map_err(Clone::clone)
}

impl FoamBridge {
    fn load(path: &Path) -> Result<Self> {
        let failed = |e: libloading::Error| {
            Error::file(
                path,
                format!(
                    "the OpenFOAM bridge cannot be loaded: {e}. It is built by setup/build.sh and needs the libraries of \
                     the OpenFOAM that it was built against (Debian: package libopenfoam)"
                ),
            )
        };
        let project = std::env::var_os("WM_PROJECT_DIR").unwrap_or_else(|| PROJECT_DIR.into());
        let control = Path::new(&project).join("etc/controlDict");
        if !control.is_file() {
            return Err(Error::file(
                control,
                "OpenFOAM's own settings are not there, and its libraries cannot be loaded without them. Install \
                 Debian's openfoam-common, or source the etc/bashrc of your OpenFOAM (WM_PROJECT_DIR)",
            ));
        }
        // SAFETY: a command calls this on the main thread before it starts threads that could read the environment.
        unsafe { std::env::set_var("WM_PROJECT_DIR", &project) };
        // Global, as OpenFOAM itself loads libraries: boundary conditions of `libs (...)` find its symbols.
        // SAFETY: the initialisers of OpenFOAM's libraries need WM_PROJECT_DIR, which is set.
        let library = unsafe { Library::open(Some(path), RTLD_NOW | RTLD_GLOBAL) }.map_err(failed)?;
        // SAFETY: the signature is the library's, of every version.
        let version = unsafe { library.get::<unsafe extern "C" fn() -> u32>(b"m4gn_foam_abi_version") }
            .map_err(failed)?;
        // SAFETY: takes nothing and returns a number.
        let version = unsafe { version() };
        if version != ABI_VERSION {
            return Err(Error::file(
                path,
                format!(
                    "expected interface version {ABI_VERSION}, found {version}. Build both with setup/build.sh"
                ),
            ));
        }
        // SAFETY: the types are those of cpp/src/abi.rs at this version.
        unsafe {
            Ok(FoamBridge {
                last_error: library.get(b"m4gn_foam_last_error").map_err(failed)?,
                open: library.get(b"m4gn_foam_open").map_err(failed)?,
                close: library.get(b"m4gn_foam_close").map_err(failed)?,
                describe: library.get(b"m4gn_foam_describe").map_err(failed)?,
                query: library.get(b"m4gn_foam_query").map_err(failed)?,
                write: library.get(b"m4gn_foam_write").map_err(failed)?,
                _library: library,
            })
        }
    }

    fn check(&self, status: i32) -> Result<()> {
        if status == 0 {
            return Ok(());
        }
        // SAFETY: a C string that is valid until the next call on this thread.
        let message = unsafe { CStr::from_ptr((self.last_error)()) }.to_string_lossy();
        Err(Error::Input(format!("OpenFOAM: {}", tidy(&message))))
    }
}

/// OpenFOAM breaks and indents its messages; ours are one paragraph.
fn tidy(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// A case opened by the bridge. Neither `Send` nor `Sync`: OpenFOAM stays on one thread.
pub struct CaseHandle {
    bridge: &'static FoamBridge,
    handle: *mut c_void,
}

impl CaseHandle {
    /// Opens the case in `folder`.
    pub fn open(bridge: &'static FoamBridge, folder: &Path) -> Result<Self> {
        let path = text(&folder.to_string_lossy())?;
        let mut handle = ptr::null_mut();
        // SAFETY: a C string and a place for a pointer, both alive through the call.
        bridge.check(unsafe { (bridge.open)(path.as_ptr(), &mut handle) })?;
        Ok(CaseHandle { bridge, handle })
    }

    /// The description as JSON.
    pub fn describe(&mut self) -> Result<String> {
        let mut json = ptr::null();
        // SAFETY: an open case and a place for a pointer.
        let status = unsafe { (self.bridge.describe)(self.handle, &mut json) };
        self.bridge.check(status)?;
        // SAFETY: status 0 means a C string that is valid until the next call on this case.
        Ok(unsafe { CStr::from_ptr(json) }.to_string_lossy().into_owned())
    }

    /// The answer to a query.
    pub fn query(&mut self, request: &serde_json::Value) -> Result<Vec<f64>> {
        let request = text(&request.to_string())?;
        let (mut data, mut count) = (ptr::null(), 0);
        // SAFETY: an open case, a C string and places for the answer.
        let status = unsafe { (self.bridge.query)(self.handle, request.as_ptr(), &mut data, &mut count) };
        self.bridge.check(status)?;
        if count == 0 {
            return Ok(Vec::new());
        }
        // SAFETY: status 0 means `count` doubles that are valid until the next call on this case.
        Ok(unsafe { std::slice::from_raw_parts(data, count) }.to_vec())
    }

    /// Writes fields, all of them or none.
    pub fn write(&mut self, request: &serde_json::Value, values: &[f64]) -> Result<()> {
        let request = text(&request.to_string())?;
        // SAFETY: an open case, a C string and as many doubles as are counted.
        let status =
            unsafe { (self.bridge.write)(self.handle, request.as_ptr(), values.as_ptr(), values.len()) };
        self.bridge.check(status)
    }
}

impl Drop for CaseHandle {
    fn drop(&mut self) {
        // SAFETY: opened by this bridge and closed once.
        unsafe { (self.bridge.close)(self.handle) }
    }
}

fn text(s: &str) -> Result<CString> {
    CString::new(s).map_err(|_| Error::Input(format!("expected text without a zero byte, found {s:?}")))
}
