//! Exports: segments of a mesh without a model, and their way to ranks.

use super::guard::{self, no_count};
use super::model::ModelHandle;
use super::pointers::{self, MeshData};
use m4gn_base::settings;
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::modal::{ModalSource, Modes};
use m4gn_model::{SegmentEntries, SegmentSpec};
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_structure as segments;
use m4gn_structure::Record;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Segmentation, ranks};
use std::ffi::CString;
use std::ffi::c_char;

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
    record: CString,
}

settings! {
    /// What the host asks for.
    pub(super) struct Request in "segments_request" {
        /// How the mesh is cut (dictionary): what differs from the model's segmentation, without a model from the defaults.
        pub(super) segments: SegmentEntries = SegmentEntries::default(), "nothing";
        /// Whether modes are computed and kept.
        with_modes: bool = false;
    }
    beside {
        /// Segments computed before; none: they are computed.
        pub(super) labels: Option<Vec<i32>>;
    }
}

impl Request {
    /// From the text of a JSON object, checked.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let request: Self = settings::parse("segments", text, &[])?;
        request.segments.over(&SegmentSpec::default())?;
        Ok(request)
    }

    /// What every rank must be given alike: not its cells' labels.
    fn shared(&self, model: Option<&ModelHandle>) -> Result<String> {
        let model = model.map_or(String::new(), ModelHandle::shared);
        Ok(format!("{}{model}", settings::lines(self)?))
    }

    /// The model's segmentation, or the default, with what differs from it.
    pub(super) fn spec(&self, model: Option<&ModelHandle>) -> Result<SegmentSpec> {
        match model {
            Some(handle) => self.segments.over(&handle.model.spec.segments),
            None => self.segments.over(&SegmentSpec::default()),
        }
    }
}

/// What a host asks segments of: its mesh, the model that they are for, and how.
pub(super) type Asked<'a> = (Mesh, Option<&'a ModelHandle>, Request);

/// The same, and its text for the other ranks.
///
/// # Safety
/// Pointers must be what `m4gn.h` says; `cell_segment` has an entry for each cell.
pub(super) unsafe fn read<'a>(
    mesh: *const MeshData,
    model: *const ModelHandle,
    options: *const c_char,
    cell_segment: *const i32,
) -> Result<(Asked<'a>, String)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let mesh = pointers::mesh(pointers::reference("mesh", mesh)?)?;
        let model = pointers::optional_reference("model", model)?;
        let labels = pointers::labels(cell_segment, mesh.n_cells())?;
        let request = Request { labels, ..Request::parse(pointers::options(options)?)? };
        let same = request.shared(model)?;
        Ok(((mesh, model, request), same))
    }
}

/// Collective.
fn cut(comm: &Comm, (mesh, model, request): Asked) -> Result<SegmentsHandle> {
    let (mesh, spec) = (&mesh, &comm.agree(request.spec(model))?);
    let mut graph = Graph::new(mesh, comm)?;
    let modal = Modal(spec.modal());
    let modes = match request.with_modes {
        true => {
            let elastic = comm.agree(spec.is_elastic(mesh))?;
            Some(modal.of_mesh(mesh, elastic, spec.modes, comm)?)
        }
        false => None,
    };
    let preset = request.labels.as_deref();
    let any_preset = comm.any(preset.is_some());
    let segmentation = match &modes {
        // Not solved for a second time.
        Some(modes) if !any_preset => segments::segment_by_modes(mesh, &mut graph, spec, modes, comm)?,
        _ => segments::segment(mesh, &mut graph, spec, &modal, comm, preset)?,
    };
    let record = match any_preset {
        false => Record::new(mesh, spec, &segmentation.node_segment[..mesh.n_cells()], comm)?.text()?,
        true => String::new(),
    };
    Ok(SegmentsHandle {
        record: CString::new(record).map_err(|e| Error::Internal(format!("record of the segments: {e}")))?,
        segmentation,
        modes: modes.unwrap_or(Modes { eigenvalues: Vec::new(), vectors: Vec::new() }),
        n_cells: mesh.n_cells(),
    })
}

exports! {
    /// Computes segments, and modes if they are asked for.
    fn m4gn_segments_new(
        comm: i32,
        mesh: *const MeshData,
        model: *const ModelHandle,
        options: *const c_char,
        cell_segment: *const i32,
        segments: *mut *mut SegmentsHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("segments", segments));
            guard::create("m4gn_segments_new", comm, place, |_| read(mesh, model, options, cell_segment), cut)
        }
    }

    /// How the segments were computed; null for null.
    fn m4gn_segments_record(segments: *const SegmentsHandle) -> *const c_char, or |_| std::ptr::null(); {
        // SAFETY: segments of ours, or null.
        Ok(unsafe { pointers::reference("segments", segments)? }.record.as_ptr())
    }

    /// Number of segments; -1 for null.
    fn m4gn_segments_n_segments(segments: *const SegmentsHandle) -> i32, or no_count; {
        // SAFETY: segments of ours, or null.
        Ok(unsafe { pointers::reference("segments", segments)? }.segmentation.count as i32)
    }

    /// Segment of each cell.
    fn m4gn_segments_cells(segments: *const SegmentsHandle, cell_segment: *mut i32) -> i32, or |s| s; {
        // SAFETY: segments of ours and the host's array of n_cells, or null.
        let (handle, out) = unsafe {
            let handle = pointers::reference("segments", segments)?;
            (handle, pointers::slice_mut("cell_segment", cell_segment, handle.n_cells)?)
        };
        out.copy_from_slice(&handle.segmentation.node_segment[..handle.n_cells]);
        Ok(0)
    }

    /// Number of modes; -1 for null.
    fn m4gn_segments_n_modes(segments: *const SegmentsHandle) -> i32, or no_count; {
        // SAFETY: segments of ours, or null.
        Ok(unsafe { pointers::reference("segments", segments)? }.modes.eigenvalues.len() as i32)
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
            let handle = pointers::reference("segments", segments)?;
            (handle, pointers::reference_mut("eigenvalue", eigenvalue)?, pointers::slice_mut("cells", cells, handle.n_cells)?)
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
        segment_rank: *mut i32,
        report: *mut RankReport,
    ) -> i32, or |s| s; {
        let (k, np) = (pointers::count("n_segments", n_segments)?, pointers::count("n_ranks", n_ranks)?);
        // SAFETY: the host's arrays, of the lengths that the header gives.
        let (sizes, adjacency, weights, out) = unsafe {
            (
                pointers::slice("sizes", sizes, k)?,
                pointers::slice("adjacency", adjacency, k * k)?,
                match rank_weights.is_null() {
                    true => vec![1.0; np],
                    false => pointers::slice("rank_weights", rank_weights, np)?.to_vec(),
                },
                pointers::slice_mut("segment_rank", segment_rank, k)?,
            )
        };
        let assigned = ranks::assign(sizes, adjacency, &weights)?;
        if !report.is_null() {
            let found = ranks::report(sizes, adjacency, &weights, &assigned)?;
            // SAFETY: the host's struct, not null.
            *unsafe { pointers::reference_mut("report", report)? } = RankReport {
                cut: found.cut,
                imbalance: found.imbalance,
            };
        }
        out.copy_from_slice(&assigned);
        Ok(0)
    }
}
