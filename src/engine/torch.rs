//! The backend `torch`: the same model run by libtorch in `libm4gn_torch.so`, loaded when it is asked for.
//!
//! The library is found beside this one, in `../../lib` of it, or in `$M4GN_HOME/lib`. Its C interface, version
//! [`ABI_VERSION`], of which this backend uses:
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
//! ```
//!
//! `m4gn_torch_graph` is [`TorchGraph`]. Statuses are those of the C ABI of `m4gn.h`. Serial only.

use super::{Forward, SegmentView};
use crate::graph::Graph;
use crate::parallel::Comm;
use crate::{Error, Result};
use libloading::Library;
use std::ffi::{CStr, CString, c_char, c_void};
use std::path::{Path, PathBuf};

/// Version of the interface; both sides must have the same.
pub const ABI_VERSION: u32 = 1;

/// File name of the library.
const NAME: &str = "libm4gn_torch.so";

/// The graph and its segments as they cross to the library; all pointers are borrowed for the call.
#[repr(C)]
#[derive(Debug)]
pub struct TorchGraph {
    /// Cells, the first nodes.
    pub n_cells: i64,
    /// Nodes; there are no ghosts.
    pub n_owned: i64,
    /// Directed edges.
    pub n_edges: i64,
    /// Features of an edge: solved directions + 1.
    pub n_edge_features: i64,
    /// Node type codes `[n_owned]`.
    pub node_types: *const i32,
    /// Sending node of each edge `[n_edges]`.
    pub senders: *const i32,
    /// Receiving node of each edge `[n_edges]`, ascending.
    pub receivers: *const i32,
    /// `[n_edges x n_edge_features]`, physical.
    pub edge_features: *const f32,
    /// K; 0 for a model without a macro stage, and the following are then null.
    pub n_segments: i64,
    /// Segments of node i: `member[member_row[i]..member_row[i + 1]]`; `[n_owned + 1]`.
    pub member_row: *const u32,
    /// Segment numbers.
    pub member: *const i32,
    /// Member nodes of each segment `[K]`.
    pub sizes: *const f64,
    /// Positional encoding `[K x n_position]`.
    pub position: *const f32,
    /// Positional features a segment; 0: none.
    pub n_position: i64,
    /// Offsets of the nodes from their segment's centroid `[n_owned x n_offsets]`.
    pub offsets: *const f32,
    /// Components of an offset; 0: none.
    pub n_offsets: i64,
}

type AbiVersion = unsafe extern "C" fn() -> u32;
type LastError = unsafe extern "C" fn() -> *const c_char;
type Load = unsafe extern "C" fn(*const c_char, *const TorchGraph, *const c_char, *mut *mut c_void) -> i32;
type Step = unsafe extern "C" fn(*mut c_void, *const f32, *mut f32) -> i32;
type Free = unsafe extern "C" fn(*mut c_void);

/// A model loaded by the library.
#[derive(Debug)]
pub struct TorchBackend {
    handle: *mut c_void,
    step: Step,
    free: Free,
    last_error: LastError,
    n_inputs: usize,
    n_outputs: usize,
    /// Keeps the functions above mapped.
    _library: Library,
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
        model: &Path,
        graph: &Graph,
        segments: Option<&SegmentView>,
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
        let path = c_string(&model.to_string_lossy())?;
        let device = device.map(c_string).transpose()?;
        let file = find()?;
        // SAFETY: loading runs the library's initialisers; it is our own library, found where we install it.
        let library = unsafe { Library::new(&file) }.map_err(|e| {
            Error::file(
                &file,
                format!("cannot be loaded: {e}. `m4gn doctor` checks what it needs"),
            )
        })?;
        // SAFETY: the type of this function is the same in all versions of the interface.
        let version = unsafe { symbol::<AbiVersion>(&library, &file, "m4gn_torch_abi_version")?() };
        if version != ABI_VERSION {
            return Err(Error::file(
                &file,
                format!("expected version {ABI_VERSION} of its interface, found {version}: build it again"),
            ));
        }
        // SAFETY: the version fixes the types of these functions.
        let (load, step, free, last_error) = unsafe {
            (
                symbol::<Load>(&library, &file, "m4gn_torch_load")?,
                symbol::<Step>(&library, &file, "m4gn_torch_step")?,
                symbol::<Free>(&library, &file, "m4gn_torch_free")?,
                symbol::<LastError>(&library, &file, "m4gn_torch_last_error")?,
            )
        };
        let described = describe(graph, segments);
        let mut handle = std::ptr::null_mut();
        let device = device.as_ref().map_or(std::ptr::null(), |d| d.as_ptr());
        // SAFETY: all pointers are valid for the call and the arrays have the lengths that the struct says.
        let status = unsafe { load(path.as_ptr(), &described, device, &mut handle) };
        if status != 0 || handle.is_null() {
            return Err(reported(status, last_error));
        }
        let (n_inputs, n_outputs) = lengths;
        Ok(TorchBackend {
            handle,
            step,
            free,
            last_error,
            n_inputs,
            n_outputs,
            _library: library,
        })
    }
}

impl Forward for TorchBackend {
    fn forward(&mut self, _comm: &Comm, inputs: &[f32], outputs: &mut [f32]) -> Result<()> {
        if (inputs.len(), outputs.len()) != (self.n_inputs, self.n_outputs) {
            return Err(Error::Input(format!(
                "forward step: expected {} inputs and {} outputs, found {} and {}",
                self.n_inputs,
                self.n_outputs,
                inputs.len(),
                outputs.len()
            )));
        }
        // SAFETY: the handle lives until drop, the slices have the lengths that the library expects.
        match unsafe { (self.step)(self.handle, inputs.as_ptr(), outputs.as_mut_ptr()) } {
            0 => Ok(()),
            status => Err(reported(status, self.last_error)),
        }
    }
}

impl Drop for TorchBackend {
    fn drop(&mut self) {
        // SAFETY: the handle came from m4gn_torch_load and is freed once.
        unsafe { (self.free)(self.handle) };
    }
}

fn describe(graph: &Graph, segments: Option<&SegmentView>) -> TorchGraph {
    let n_edges = graph.senders.len();
    let view = segments.filter(|v| v.count > 0);
    TorchGraph {
        n_cells: graph.n_cells as i64,
        n_owned: graph.n_owned as i64,
        n_edges: n_edges as i64,
        n_edge_features: (graph.edge_features.len() / n_edges.max(1)) as i64,
        node_types: graph.node_types.as_ptr(),
        senders: graph.senders.as_ptr(),
        receivers: graph.receivers.as_ptr(),
        edge_features: graph.edge_features.as_ptr(),
        n_segments: view.map_or(0, |v| v.count as i64),
        member_row: view.map_or(std::ptr::null(), |v| v.member_row.as_ptr()),
        member: view.map_or(std::ptr::null(), |v| v.member.as_ptr()),
        sizes: view.map_or(std::ptr::null(), |v| v.sizes.as_ptr()),
        position: view.map_or(std::ptr::null(), |v| v.position.as_ptr()),
        n_position: view.map_or(0, |v| (v.position.len() / v.count) as i64),
        offsets: view.map_or(std::ptr::null(), |v| v.offsets.as_ptr()),
        n_offsets: view.map_or(0, |v| (v.offsets.len() / graph.n_owned.max(1)) as i64),
    }
}

/// The error that the library kept for this thread.
fn reported(status: i32, last_error: LastError) -> Error {
    // SAFETY: the function returns null or a string that is valid until the next call on this thread.
    let message = unsafe {
        let text = last_error();
        if text.is_null() {
            String::new()
        } else {
            CStr::from_ptr(text).to_string_lossy().into_owned()
        }
    };
    let message = format!(
        "backend torch: {}",
        if message.is_empty() {
            "no message"
        } else {
            &message
        }
    );
    match status {
        1 => Error::Input(message),
        4 => Error::Mesh(message),
        5 => Error::Numerical(message),
        s if s < 0 => Error::Internal(message),
        _ => Error::Model(message),
    }
}

/// A function of the library.
///
/// # Safety
/// `T` must be the function's type.
unsafe fn symbol<T: Copy>(library: &Library, file: &Path, name: &str) -> Result<T> {
    // SAFETY: passed on to the caller.
    unsafe { library.get::<T>(name) }
        .map(|s| *s)
        .map_err(|e| Error::file(file, format!("has no function {name}: {e}. Build it again")))
}

fn c_string(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error::Input(format!("{text:?} contains a zero byte")))
}

fn find() -> Result<PathBuf> {
    let own = own_folder();
    let home = std::env::var_os("M4GN_HOME").map(|h| PathBuf::from(h).join("lib"));
    let folders = [own.clone(), own.map(|f| f.join("../../lib")), home];
    let tried: Vec<PathBuf> = folders.into_iter().flatten().map(|f| f.join(NAME)).collect();
    tried.iter().find(|p| p.is_file()).cloned().ok_or_else(|| {
        let list: Vec<_> = tried.iter().map(|p| p.display().to_string()).collect();
        Error::file(
            NAME,
            format!(
                "not found; looked for {}. Build it (`cargo build -p m4gn-torch`) or use backend native",
                list.join(", ")
            ),
        )
    })
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
