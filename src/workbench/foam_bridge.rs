//! Loads `libm4gn_foam_bridge.so` and calls its C interface (`cpp/bridge/abi.rs`, version 8).
#![allow(unsafe_code)]

use m4gn_base::plugin::{Description, Plugin, c_string, folder_variable};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_mesh::ffi::host::{self, MeshData, SolidData};
use m4gn_modes::fem::HostBody;
use std::{
    ffi::{CStr, c_char, c_void},
    path::{Path, PathBuf},
    ptr,
    sync::OnceLock,
};

/// The library. Its symbols are for all, as OpenFOAM itself loads libraries: boundary conditions of `libs (...)` find
/// them.
pub const LIBRARY: Description = Description {
    file: "libm4gn_foam_bridge.so",
    prefix: "m4gn_foam",
    version: 8,
    remedy: "It is built by setup/build.sh, or in the package m4gn-openfoam of your OpenFOAM's version, and needs the \
             libraries of the OpenFOAM that it was built against (Debian: package libopenfoam)",
    global: true,
};

/// Where OpenFOAM keeps `etc/controlDict` when the user has not sourced an OpenFOAM of their own.
const PROJECT_DIR: &str = match option_env!("M4GN_FOAM_PROJECT_DIR") {
    Some(dir) => dir,
    None => "/usr/share/openfoam",
};

type Open = unsafe extern "C" fn(*const c_char, *mut *mut c_void) -> i32;
type Close = unsafe extern "C" fn(*mut c_void);
type Describe = unsafe extern "C" fn(*mut c_void, *mut *const c_char) -> i32;
type Query = unsafe extern "C" fn(*mut c_void, *const c_char, *mut *const f64, *mut usize) -> i32;

type MeshOf =
    unsafe extern "C" fn(*mut c_void, *const c_char, *mut *const MeshData, *mut *const SolidData) -> i32;
type Write = unsafe extern "C" fn(*mut c_void, *const c_char, *const f64, usize) -> i32;

/// The loaded library.
pub struct FoamBridge {
    library: Plugin,
    open: Open,
    close: Close,
    describe: Describe,
    query: Query,
    mesh: MeshOf,
    write: Write,
}

static LOADED: OnceLock<Result<FoamBridge>> = OnceLock::new();

/// The bridge, loaded the first time.
pub fn load() -> Result<&'static FoamBridge> {
    LOADED.get_or_init(FoamBridge::load).as_ref().map_err(Clone::clone)
}

impl FoamBridge {
    fn load() -> Result<Self> {
        let file = LIBRARY.find()?;
        let project = folder_variable("WM_PROJECT_DIR").unwrap_or_else(|| PROJECT_DIR.into());
        let control = project.join("etc/controlDict");
        if !control.is_file() {
            return Err(Error::file(
                control,
                "OpenFOAM's own settings are not there, and its libraries cannot be loaded without them. Install \
                 Debian's openfoam-common, or source the etc/bashrc of your OpenFOAM (WM_PROJECT_DIR)",
            ));
        }
        // The initialisers of OpenFOAM's libraries need it.
        // SAFETY: a command calls this on the main thread before it starts threads that could read the environment.
        unsafe { std::env::set_var("WM_PROJECT_DIR", &project) };
        let library = LIBRARY.load_from(file)?;
        // SAFETY: the types are those of cpp/bridge/abi.rs at this version.
        unsafe {
            Ok(FoamBridge {
                open: library.function("m4gn_foam_open")?,
                close: library.function("m4gn_foam_close")?,
                describe: library.function("m4gn_foam_describe")?,
                query: library.function("m4gn_foam_query")?,
                mesh: library.function("m4gn_foam_mesh")?,
                write: library.function("m4gn_foam_write")?,
                library,
            })
        }
    }

    fn check(&self, status: i32) -> Result<()> {
        match status {
            0 => Ok(()),
            _ => Err(Error::Input(format!("OpenFOAM: {}", tidy(&self.library.message())))),
        }
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
    folder: PathBuf,
}

impl CaseHandle {
    /// Opens the case in `folder`.
    pub fn open(bridge: &'static FoamBridge, folder: &Path) -> Result<Self> {
        let path = c_string(&folder.to_string_lossy())?;
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
        let mut case = CaseHandle { bridge, handle: ptr::null_mut(), folder };
        case.enter();
        // SAFETY: a C string and a place for a pointer, both alive through the call.
        bridge.check(unsafe { (bridge.open)(path.as_ptr(), &mut case.handle) })?;
        Ok(case)
    }

    /// Has `#include "<system>/NAME"` and `$FOAM_CASE` of files stand for this case, of several that are open.
    fn enter(&self) {
        // SAFETY: OpenFOAM has one thread; the others read the environment through Rust, which locks it.
        unsafe { std::env::set_var("FOAM_CASE", &self.folder) };
    }

    /// The description as JSON.
    pub fn describe(&mut self) -> Result<String> {
        self.enter();
        let mut json = ptr::null();
        // SAFETY: an open case and a place for a pointer.
        let status = unsafe { (self.bridge.describe)(self.handle, &mut json) };
        self.bridge.check(status)?;
        // SAFETY: status 0 means a C string that is valid until the next call on this case.
        Ok(unsafe { CStr::from_ptr(json) }.to_string_lossy().into_owned())
    }

    /// The answer to a query.
    pub fn query(&mut self, request: &serde_json::Value) -> Result<Vec<f64>> {
        self.enter();
        let request = c_string(&request.to_string())?;
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

    /// The mesh as the function objects hand it over, and the elastic body of a solid whose material is known.
    /// `node_types`: pairs of patch or group and node type.
    pub fn mesh(&mut self, node_types: &serde_json::Value) -> Result<(Mesh, Option<HostBody>)> {
        self.enter();
        let request = c_string(&node_types.to_string())?;
        let (mut mesh, mut body) = (ptr::null(), ptr::null());
        // SAFETY: an open case, a C string and places for the answer.
        let status = unsafe { (self.bridge.mesh)(self.handle, request.as_ptr(), &mut mesh, &mut body) };
        self.bridge.check(status)?;
        // SAFETY: status 0 means structs of m4gn.h that are valid until the next such call; both are copied here.
        unsafe {
            let mesh = host::mesh(host::reference("mesh", mesh)?)?;
            let body = match body.is_null() {
                true => None,
                false => Some(HostBody::new(&host::reference("body", body)?.arrays()?)),
            };
            Ok((mesh, body))
        }
    }

    /// Writes fields, all of them or none.
    pub fn write(&mut self, request: &serde_json::Value, values: &[f64]) -> Result<()> {
        self.enter();
        let request = c_string(&request.to_string())?;
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
