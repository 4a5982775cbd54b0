//! The backend `torch`: the same model run by libtorch in `libm4gn_torch.so`, loaded when it is asked for. Serial
//! only.

mod library;

pub use library::{LIBRARY, TorchTrial, library, train};

use super::Forward;
use m4gn_base::plugin::{Plugin, c_string};
use m4gn_base::{Error, Result};
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_structure::{Level, Structure};
use std::ffi::{c_char, c_void};

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
    /// The nodes of each segment after one another, in the order in which they are read, as many as members; null: in none.
    pub sequence: *const i32,
    /// Coarser graphs, the finest first `[n_levels]`.
    pub levels: *const TorchLevel,
    /// Their number.
    pub n_levels: i64,
    /// Positional encoding of the nodes `[n_owned x n_walk]`.
    pub walk: *const f32,
    /// Random-walk steps of it; 0: none.
    pub n_walk: i64,
}

/// A coarser graph.
#[repr(C)]
#[derive(Debug)]
pub struct TorchLevel {
    /// Nodes.
    pub n_nodes: i64,
    /// Directed edges.
    pub n_edges: i64,
    /// As of [`TorchGraph`].
    pub senders: *const i32,
    /// As of [`TorchGraph`].
    pub receivers: *const i32,
    /// As of [`TorchGraph`].
    pub edge_features: *const f32,
    /// Node i is the sum of `weight[k]` times node `from[k]` of the next finer graph over `row[i]..row[i + 1]`; `[n_nodes + 1]`.
    pub row: *const u32,
    /// See `row`.
    pub from: *const i32,
    /// See `row`.
    pub weight: *const f32,
}

type Load = unsafe extern "C" fn(*const u8, u64, *const TorchGraph, *const c_char, *mut *mut c_void) -> i32;
type Step = unsafe extern "C" fn(*mut c_void, *const f32, *mut f32) -> i32;
type Free = unsafe extern "C" fn(*mut c_void);

/// A model loaded by the library.
#[derive(Debug)]
pub struct TorchBackend {
    handle: *mut c_void,
    step: Step,
    free: Free,
    n_inputs: usize,
    n_outputs: usize,
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
        let levels: Vec<TorchLevel> = structure.levels.iter().map(level).collect();
        let described = describe(structure, &levels);
        let mut handle = std::ptr::null_mut();
        let device = device.as_ref().map_or(std::ptr::null(), |d| d.as_ptr());
        // SAFETY: all pointers are valid for the call and the arrays have the lengths that the struct says.
        let status = unsafe { load(bytes.as_ptr(), bytes.len() as u64, &described, device, &mut handle) };
        library.check(status)?;
        if handle.is_null() {
            return Err(Error::Internal("libm4gn_torch.so loaded no model".into()));
        }
        let (n_inputs, n_outputs) = lengths;
        Ok(TorchBackend { handle, step, free, n_inputs, n_outputs, library })
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

fn level(level: &Level) -> TorchLevel {
    let (graph, down) = (&level.graph, &level.down);
    TorchLevel {
        n_nodes: graph.n_owned as i64,
        n_edges: graph.senders.len() as i64,
        senders: graph.senders.as_ptr(),
        receivers: graph.receivers.as_ptr(),
        edge_features: graph.edge_features.as_ptr(),
        row: down.row.as_ptr(),
        from: down.from.as_ptr(),
        weight: down.weight.as_ptr(),
    }
}

fn describe(structure: &Structure, levels: &[TorchLevel]) -> TorchGraph {
    let graph = &structure.graph;
    let n_edges = graph.senders.len();
    let view = structure.segments.as_ref().filter(|v| v.count > 0);
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
        sequence: structure.sequence.as_ref().map_or(std::ptr::null(), |s| s.node.as_ptr()),
        levels: levels.as_ptr(),
        n_levels: levels.len() as i64,
        walk: structure.walk.as_ptr(),
        n_walk: (structure.walk.len() / graph.n_owned.max(1)) as i64,
    }
}
