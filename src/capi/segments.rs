//! Exports: segments of a mesh without a model, and their way to ranks.

use super::raw::{self, MeshData};
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::model::{ModalOperator, Model, SegmentSpec};
use crate::modes::{self, ModalOptions, ModalSolver, Modes};
use crate::parallel::Comm;
use crate::segments::{self, Segmentation, ranks};
use crate::{Error, Result};
use std::ffi::c_char;
use std::path::{Path, PathBuf};

/// `m4gn_segment_options`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct SegmentOptionsData {
    pub model: *const c_char,
    pub spec: *const c_char,
    pub cell_segment: *const i32,
    pub modal_solver: *const c_char,
    pub petsc_options: *const c_char,
    pub with_modes: i32,
}

/// `m4gn_rank_report`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RankReport {
    pub cut: f64,
    pub imbalance: f64,
}

/// `m4gn_segments`
pub struct SegmentsHandle {
    segmentation: Segmentation,
    modes: Modes,
    n_cells: usize,
}

/// What the host asks for.
struct Request {
    model: Option<PathBuf>,
    spec: String,
    labels: Option<Vec<i32>>,
    modal: ModalOptions,
    with_modes: bool,
}

impl SegmentOptionsData {
    /// # Safety
    /// Pointers must be what `m4gn.h` says; `cell_segment` has `n_cells` entries.
    unsafe fn read(&self, n_cells: usize) -> Result<Request> {
        // SAFETY: passed on to the caller.
        unsafe {
            Ok(Request {
                model: raw::optional_text("model", self.model)?.map(PathBuf::from),
                spec: raw::optional_text("spec", self.spec)?.unwrap_or("{}").to_owned(),
                labels: match self.cell_segment.is_null() {
                    true => None,
                    false => Some(raw::slice("cell_segment", self.cell_segment, n_cells)?.to_vec()),
                },
                modal: ModalOptions {
                    solver: raw::optional_text("modal_solver", self.modal_solver)?
                        .map_or(Ok(ModalSolver::Auto), ModalSolver::parse)?,
                    petsc: raw::optional_text("petsc_options", self.petsc_options)?
                        .unwrap_or_default()
                        .to_owned(),
                    ..ModalOptions::default()
                },
                with_modes: self.with_modes != 0,
            })
        }
    }
}

impl Request {
    /// The model's segmentation, or the default, with the entries of `spec` in place of its own. Collective.
    fn spec(&self, comm: &Comm) -> Result<SegmentSpec> {
        let base = match &self.model {
            Some(path) => model_segments(path, comm)?,
            None => SegmentSpec::default(),
        };
        let merged = || -> Result<SegmentSpec> {
            let wrong = |e: serde_json::Error| Error::Input(format!("segments {}: {e}", self.spec));
            let given: serde_json::Map<String, serde_json::Value> =
                serde_json::from_str(&self.spec).map_err(wrong)?;
            let mut whole = serde_json::to_value(&base).map_err(wrong)?;
            if let Some(object) = whole.as_object_mut() {
                object.extend(given);
            }
            serde_json::from_value(whole).map_err(wrong)
        };
        comm.agree(merged())
    }
}

/// Read on the root and told to all. Collective.
fn model_segments(path: &Path, comm: &Comm) -> Result<SegmentSpec> {
    let read = match comm.is_root() {
        true => Model::read(path).and_then(|m| {
            serde_json::to_vec(&m.spec.segments).map_err(|e| Error::Internal(format!("segments: {e}")))
        }),
        false => Ok(Vec::new()),
    };
    let mut text = comm.agree(read)?;
    comm.broadcast(&mut text);
    let parsed = serde_json::from_slice(&text).map_err(|e| Error::Internal(format!("segments: {e}")));
    comm.agree(parsed)
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    comm: i32,
    mesh: *const MeshData,
    options: *const SegmentOptionsData,
) -> Result<SegmentsHandle> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<(Mesh, Request)> {
        // SAFETY: passed on to the caller.
        unsafe {
            let mesh = raw::mesh(raw::reference("mesh", mesh)?)?;
            let request = raw::reference("options", options)?.read(mesh.n_cells())?;
            Ok((mesh, request))
        }
    };
    let (mesh, request) = comm.agree(read())?;
    let spec = request.spec(&comm)?;
    let mut graph = Graph::new(&mesh, &comm)?;
    let modal = ModalOptions {
        count: spec.mode_count(),
        ..request.modal
    };
    let modes = match request.with_modes {
        true => {
            let elastic = comm.agree(spec.is_elastic(&mesh))?;
            Some(modes::of_mesh(&mesh, &mut graph, &comm, elastic, &modal)?)
        }
        false => None,
    };
    let preset = request.labels.as_deref();
    let mut any_preset = [i64::from(preset.is_some())];
    comm.max_i64(&mut any_preset);
    let segmentation = match &modes {
        // Not solved for a second time.
        Some(modes) if any_preset[0] == 0 => {
            segments::segment_by_modes(&mesh, &mut graph, &spec, modes, &comm)?
        }
        _ => segments::segment_with(&mesh, &mut graph, &spec, &modal, &comm, preset)?,
    };
    Ok(SegmentsHandle {
        segmentation,
        modes: modes.unwrap_or(Modes {
            eigenvalues: Vec::new(),
            vectors: Vec::new(),
        }),
        n_cells: mesh.n_cells(),
    })
}

/// Elastic modes that a model's segments need. Collective.
fn elastic_modes(comm: i32, model: Result<PathBuf>) -> Result<i32> {
    let comm = Comm::from_fortran(comm)?;
    let path = comm.agree(model)?;
    let mut count = [0i64];
    let read = match comm.is_root() {
        true => Model::read(&path).map(|model| {
            let spec = &model.spec.segments;
            let elastic = spec.operator == Some(ModalOperator::Elastic) && spec.method.uses_modes();
            if elastic && model.spec.architecture.segment_transformer.is_some() {
                count[0] = spec.modes as i64;
            }
        }),
        false => Ok(()),
    };
    comm.agree(read)?;
    comm.max_i64(&mut count);
    i32::try_from(count[0]).map_err(|_| Error::Model(format!("segments.modes: {} is too large", count[0])))
}

fn no_count(_: i32) -> i32 {
    -1
}

exports! {
    /// Computes segments, and modes if they are asked for.
    fn m4gn_segments_new(
        comm: i32,
        mesh: *const MeshData,
        options: *const SegmentOptionsData,
        segments: *mut *mut SegmentsHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let segments = raw::reference_mut("segments", segments)?;
            *segments = std::ptr::null_mut();
            *segments = Box::into_raw(Box::new(new(comm, mesh, options)?));
        }
        Ok(0)
    }

    /// Elastic modes that the mesh must have for a model.
    fn m4gn_model_elastic_modes(comm: i32, model: *const c_char) -> i32, or no_count; {
        // SAFETY: the host's string, or null.
        let path = unsafe { raw::text("model", model) }.map(PathBuf::from);
        elastic_modes(comm, path)
    }

    /// Frees segments; null is none.
    fn m4gn_segments_free(segments: *mut SegmentsHandle) -> (), or |_| (); {
        if !segments.is_null() {
            // SAFETY: made by m4gn_segments_new and freed once.
            drop(unsafe { Box::from_raw(segments) });
        }
        Ok(())
    }

    /// Number of segments; -1 for null.
    fn m4gn_segments_count(segments: *const SegmentsHandle) -> i32, or no_count; {
        // SAFETY: segments of ours, or null.
        Ok(unsafe { raw::reference("segments", segments)? }.segmentation.count as i32)
    }

    /// Segment of each cell.
    fn m4gn_segments_cells(segments: *const SegmentsHandle, cell_segment: *mut i32) -> i32, or |s| s; {
        // SAFETY: segments of ours and the host's array of n_cells, or null.
        let (handle, out) = unsafe {
            let handle = raw::reference("segments", segments)?;
            (handle, raw::slice_mut("cell_segment", cell_segment, handle.n_cells)?)
        };
        out.copy_from_slice(&handle.segmentation.node_segment[..handle.n_cells]);
        Ok(0)
    }

    /// Sizes and adjacency of the segments.
    fn m4gn_segments_graph(
        segments: *const SegmentsHandle,
        sizes: *mut f64,
        adjacency: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: segments of ours and the host's arrays of K and K x K, or null.
        let (found, sizes, adjacency) = unsafe {
            let found = &raw::reference("segments", segments)?.segmentation;
            let k = found.count;
            (found, raw::slice_mut("sizes", sizes, k)?, raw::slice_mut("adjacency", adjacency, k * k)?)
        };
        sizes.copy_from_slice(&found.sizes);
        adjacency.copy_from_slice(&found.adjacency);
        Ok(0)
    }

    /// Number of modes; -1 for null.
    fn m4gn_segments_n_modes(segments: *const SegmentsHandle) -> i32, or no_count; {
        // SAFETY: segments of ours, or null.
        Ok(unsafe { raw::reference("segments", segments)? }.modes.eigenvalues.len() as i32)
    }

    /// One mode and its eigenvalue.
    fn m4gn_segments_mode(
        segments: *const SegmentsHandle,
        index: i32,
        eigenvalue: *mut f64,
        cells: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: segments of ours, the host's number and array of n_cells, or null.
        let (handle, value, cells) = unsafe {
            let handle = raw::reference("segments", segments)?;
            (handle, raw::reference_mut("eigenvalue", eigenvalue)?, raw::slice_mut("cells", cells, handle.n_cells)?)
        };
        let modes = &handle.modes;
        let at = usize::try_from(index).ok().filter(|&i| i < modes.eigenvalues.len()).ok_or_else(|| {
            Error::Input(format!("mode index: expected 0 to {}, found {index}", modes.eigenvalues.len() as i64 - 1))
        })?;
        *value = modes.eigenvalues[at];
        cells.copy_from_slice(&modes.vectors[at]);
        Ok(0)
    }

    /// The rank of each segment.
    fn m4gn_segment_ranks(
        n_segments: i32,
        sizes: *const f64,
        adjacency: *const f64,
        n_ranks: i32,
        rank_weights: *const f64,
        fixed: *const i32,
        segment_rank: *mut i32,
        report: *mut RankReport,
    ) -> i32, or |s| s; {
        let (k, np) = (raw::count("n_segments", n_segments)?, raw::count("n_ranks", n_ranks)?);
        // SAFETY: the host's arrays, of the lengths that the header gives.
        let (sizes, adjacency, weights, fixed, out) = unsafe {
            (
                raw::slice("sizes", sizes, k)?,
                raw::slice("adjacency", adjacency, k * k)?,
                match rank_weights.is_null() {
                    true => vec![1.0; np],
                    false => raw::slice("rank_weights", rank_weights, np)?.to_vec(),
                },
                match fixed.is_null() {
                    true => vec![-1; k],
                    false => raw::slice("fixed", fixed, k)?.to_vec(),
                },
                raw::slice_mut("segment_rank", segment_rank, k)?,
            )
        };
        let assigned = ranks::assign_with(sizes, adjacency, &weights, &fixed)?;
        if !report.is_null() {
            let found = ranks::report(sizes, adjacency, &weights, &assigned)?;
            // SAFETY: the host's struct, not null.
            *unsafe { raw::reference_mut("report", report)? } = RankReport {
                cut: found.cut,
                imbalance: found.imbalance,
            };
        }
        out.copy_from_slice(&assigned);
        Ok(0)
    }
}
