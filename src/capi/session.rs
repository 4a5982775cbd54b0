//! Exports: the surrogate.

use super::raw::{self, FieldData, FieldOut, MeshData};
use crate::engine::Precision;
use crate::mesh::Mesh;
use crate::model::{ModalOperator, Output, SegmentMethod};
use crate::modes::{ModalOptions, ModalSolver};
use crate::parallel::Comm;
use crate::step::{Backend, Field, FieldMut, OutputShape, Session, SessionOptions};
use crate::{Error, Result};
use std::ffi::{CString, c_char};
use std::path::PathBuf;

/// `m4gn_session_options`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct SessionOptionsData {
    pub model: *const c_char,
    pub backend: *const c_char,
    pub n_threads: i32,
    pub segments: i32,
    pub modes: i32,
    pub overlap: i32,
    pub slic_iterations: i32,
    pub tau: f64,
    pub segment_size: f64,
    pub segment_method: *const c_char,
    pub cell_segment: *const i32,
    pub precision: *const c_char,
    pub energy: f64,
    pub connected: i32,
    pub distance_scale: f64,
    pub obstacles: *const c_char,
    pub modal_solver: *const c_char,
    pub petsc_options: *const c_char,
    pub modal_operator: *const c_char,
}

/// `m4gn_field_info`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct FieldInfo {
    pub name: *const c_char,
    pub components: i32,
    pub dimensions: [i32; 7],
    pub is_input: i32,
    pub is_output: i32,
}

/// `m4gn_session`
pub struct SessionHandle {
    session: Session,
    /// The fields' names as C reads them.
    names: Vec<CString>,
    /// Set while a step runs: a step that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

impl SessionOptionsData {
    const AS_TRAINED: Self = SessionOptionsData {
        model: std::ptr::null(),
        backend: std::ptr::null(),
        n_threads: 0,
        segments: 0,
        modes: -1,
        overlap: -1,
        slic_iterations: -1,
        tau: -1.0,
        segment_size: 0.0,
        segment_method: std::ptr::null(),
        cell_segment: std::ptr::null(),
        precision: std::ptr::null(),
        energy: 0.0,
        connected: -1,
        distance_scale: -1.0,
        obstacles: std::ptr::null(),
        modal_solver: std::ptr::null(),
        petsc_options: std::ptr::null(),
        modal_operator: std::ptr::null(),
    };

    /// # Safety
    /// Pointers must be what `m4gn.h` says; `cell_segment` has `n_cells` entries.
    unsafe fn read(&self, n_cells: usize) -> Result<(PathBuf, SessionOptions)> {
        // SAFETY: passed on to the caller.
        let (model, backend, method, precision, obstacles, solver, petsc, operator, labels) = unsafe {
            (
                raw::text("model", self.model)?,
                raw::optional_text("backend", self.backend)?,
                raw::optional_text("segment_method", self.segment_method)?,
                raw::optional_text("precision", self.precision)?,
                raw::optional_text("obstacles", self.obstacles)?,
                raw::optional_text("modal_solver", self.modal_solver)?,
                raw::optional_text("petsc_options", self.petsc_options)?,
                raw::optional_text("modal_operator", self.modal_operator)?,
                match self.cell_segment.is_null() {
                    true => None,
                    false => Some(raw::slice("cell_segment", self.cell_segment, n_cells)?.to_vec()),
                },
            )
        };
        let given = |value: i32| usize::try_from(value).ok();
        let segment_method = method.map(SegmentMethod::parse).transpose()?;
        let segments = raw::count("segments", self.segments)?;
        let options = SessionOptions {
            backend: backend.map_or(Ok(Backend::default()), Backend::parse)?,
            precision: precision.map_or(Ok(Precision::default()), Precision::parse)?,
            n_threads: raw::count("n_threads", self.n_threads)?,
            segments: (segments > 0).then_some(segments),
            modes: given(self.modes),
            overlap: given(self.overlap),
            slic_iterations: given(self.slic_iterations),
            // Comparisons that NaN fails, so that it is passed on and refused.
            tau: if self.tau < 0.0 { None } else { Some(self.tau) },
            segment_size: if self.segment_size <= 0.0 {
                None
            } else {
                Some(self.segment_size)
            },
            segment_method,
            energy: if self.energy <= 0.0 {
                None
            } else {
                Some(self.energy)
            },
            connected: match self.connected {
                0 => Some(false),
                1 => Some(true),
                n if n < 0 => None,
                n => return Err(Error::Input(format!("connected: expected 0 or 1, found {n}"))),
            },
            distance_scale: if self.distance_scale < 0.0 {
                None
            } else {
                Some(self.distance_scale)
            },
            obstacles: obstacles.map(names),
            operator: operator.map(ModalOperator::parse).transpose()?,
            modal: ModalOptions {
                solver: solver.map_or(Ok(ModalSolver::Auto), ModalSolver::parse)?,
                petsc: petsc.unwrap_or_default().to_string(),
                ..ModalOptions::default()
            },
            cell_segment: labels,
            model_path: None,
        };
        Ok((PathBuf::from(model), options))
    }
}

/// The names of a list like `a, b`.
fn names(list: &str) -> Vec<String> {
    list.split(',')
        .map(str::trim)
        .filter(|name| !name.is_empty())
        .map(str::to_string)
        .collect()
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(comm: i32, mesh: *const MeshData, options: *const SessionOptionsData) -> Result<SessionHandle> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<(Mesh, PathBuf, SessionOptions)> {
        // SAFETY: passed on to the caller.
        unsafe {
            let mesh = raw::mesh(raw::reference("mesh", mesh)?)?;
            let (path, options) = raw::reference("options", options)?.read(mesh.n_cells())?;
            Ok((mesh, path, options))
        }
    };
    let (mesh, path, options) = comm.agree(read())?;
    let session = Session::open(comm, &mesh, &path, &options)?;
    let name =
        |n: &str| CString::new(n).map_err(|_| Error::Model(format!("field name {n:?} has a zero byte")));
    let names = session
        .spec()
        .fields
        .iter()
        .map(|f| name(&f.name))
        .collect::<Result<_>>()?;
    Ok(SessionHandle {
        session,
        names,
        broken: false,
    })
}

impl SessionHandle {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn step(&mut self, fields: (*const FieldData, i32), out: (*const FieldOut, i32)) -> Result<()> {
        let (n_cells, n_boundary) = (self.session.n_cells(), self.session.n_boundary());
        // SAFETY: as above; outputs are not turned into references before the inputs are no longer needed, since
        // the host may name the same arrays.
        let read = || unsafe {
            Ok((
                read_fields(fields, n_cells, n_boundary)?,
                read_outputs(out, n_cells)?,
            ))
        };
        let (fields, outputs, problem) = match read() {
            Ok((fields, outputs)) => (fields, outputs, None),
            Err(e) => (Vec::new(), Vec::new(), Some(e)),
        };
        let checked = match problem {
            Some(e) => Err(e),
            None => self
                .session
                .check_outputs(outputs.iter().map(|(shape, _)| *shape)),
        };
        self.session.advance(&fields, checked)?;
        drop(fields);
        for (shape, cells) in outputs {
            // SAFETY: not null (checked in read_outputs), of this length by the header; no other reference lives.
            let cells = unsafe { raw::slice_mut(shape.name, cells, shape.len)? };
            self.session.write(&mut FieldMut {
                name: shape.name,
                components: shape.components,
                cells,
            });
        }
        Ok(())
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn read_fields<'a>(
    (fields, n): (*const FieldData, i32),
    n_cells: usize,
    n_boundary: usize,
) -> Result<Vec<Field<'a>>> {
    // SAFETY: passed on to the caller.
    let list = unsafe { raw::slice("fields", fields, raw::count("number of fields", n)?)? };
    let read = |f: &FieldData| {
        // SAFETY: as above; the components were checked before the lengths are made of them.
        unsafe {
            let name = raw::text("field name", f.name)?;
            let components = components(name, f.components)?;
            Ok(Field {
                name,
                components,
                cells: raw::slice(name, f.cells, components * n_cells)?,
                boundary: raw::slice(name, f.boundary, components * n_boundary)?,
            })
        }
    };
    list.iter().map(read).collect()
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn read_outputs<'a>(
    (out, n): (*const FieldOut, i32),
    n_cells: usize,
) -> Result<Vec<(OutputShape<'a>, *mut f64)>> {
    // SAFETY: passed on to the caller.
    let list = unsafe { raw::slice("outputs", out, raw::count("number of outputs", n)?)? };
    let read = |f: &FieldOut| {
        // SAFETY: as above.
        let name = unsafe { raw::text("output name", f.name)? };
        let components = components(name, f.components)?;
        let len = components * n_cells;
        if len > 0 && (f.cells.is_null() || !f.cells.is_aligned()) {
            return Err(Error::Input(format!(
                "output '{name}': expected an array of {len}, found a null pointer"
            )));
        }
        Ok((
            OutputShape {
                name,
                components,
                len,
            },
            f.cells,
        ))
    };
    list.iter().map(read).collect()
}

fn components(name: &str, n: i32) -> Result<usize> {
    match n {
        1 | 3 => Ok(n as usize),
        _ => Err(Error::Input(format!(
            "field '{name}': expected 1 or 3 components, found {n}"
        ))),
    }
}

/// What a getter returns after a failure, where it does not return a status.
fn no_count(_: i32) -> i32 {
    -1
}

exports! {
    /// Fills in "as the model was trained" everywhere.
    fn m4gn_session_options_init(options: *mut SessionOptionsData) -> (), or |_| (); {
        // SAFETY: the host's struct.
        *unsafe { raw::reference_mut("options", options)? } = SessionOptionsData::AS_TRAINED;
        Ok(())
    }

    /// Builds graph, modes and segments and loads the model.
    fn m4gn_session_new(
        comm: i32,
        mesh: *const MeshData,
        options: *const SessionOptionsData,
        session: *mut *mut SessionHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let session = raw::reference_mut("session", session)?;
            *session = std::ptr::null_mut();
            *session = Box::into_raw(Box::new(new(comm, mesh, options)?));
        }
        Ok(0)
    }

    /// Frees a session; null is none.
    fn m4gn_session_free(session: *mut SessionHandle) -> (), or |_| (); {
        if !session.is_null() {
            // SAFETY: made by m4gn_session_new and freed once.
            drop(unsafe { Box::from_raw(session) });
        }
        Ok(())
    }

    /// Time that one step advances, s; 0 for a null session.
    fn m4gn_session_stride(session: *const SessionHandle) -> f64, or |_| 0.0; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { raw::reference("session", session)? }.session.spec().stride)
    }

    /// Segments K; -1 for a null session.
    fn m4gn_session_n_segments(session: *const SessionHandle) -> i32, or no_count; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { raw::reference("session", session)? }.session.n_segments() as i32)
    }

    /// Fields of the model; -1 for a null session.
    fn m4gn_session_n_fields(session: *const SessionHandle) -> i32, or no_count; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { raw::reference("session", session)? }.names.len() as i32)
    }

    /// What field `index` of the model is.
    fn m4gn_session_field(session: *const SessionHandle, index: i32, info: *mut FieldInfo) -> i32, or |s| s; {
        // SAFETY: a session of ours and the host's struct, or null.
        let (handle, info) = unsafe { (raw::reference("session", session)?, raw::reference_mut("info", info)?) };
        let fields = &handle.session.spec().fields;
        let at = usize::try_from(index).ok().filter(|i| *i < fields.len()).ok_or_else(|| {
            Error::Input(format!("field index: expected 0 to {}, found {index}", fields.len() - 1))
        })?;
        let field = &fields[at];
        *info = FieldInfo {
            name: handle.names[at].as_ptr(),
            components: if field.vector { 3 } else { 1 },
            dimensions: field.dimensions,
            is_input: i32::from(field.input),
            is_output: i32::from(field.output != Output::None),
        };
        Ok(0)
    }

    /// Segment of each cell.
    fn m4gn_session_segments(session: *const SessionHandle, cell_segment: *mut i32) -> i32, or |s| s; {
        // SAFETY: a session of ours and the host's array of n_cells, or null.
        let (handle, out) = unsafe {
            let handle = raw::reference("session", session)?;
            (handle, raw::slice_mut("cell_segment", cell_segment, handle.session.n_cells())?)
        };
        if handle.session.n_segments() == 0 {
            return Err(Error::Input("this model has no macro stage and its session no segments".into()));
        }
        out.copy_from_slice(handle.session.cell_segment());
        Ok(0)
    }

    /// One step.
    fn m4gn_session_step(
        session: *mut SessionHandle,
        fields: *const FieldData,
        n_in: i32,
        out: *const FieldOut,
        n_out: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours, or null.
        let handle = unsafe { raw::reference_mut("session", session)? };
        if std::mem::replace(&mut handle.broken, true) {
            return Err(Error::Internal("the session broke in an earlier step and can only be freed".into()));
        }
        // SAFETY: the host's arrays, as the header says.
        let result = unsafe { handle.step((fields, n_in), (out, n_out)) };
        handle.broken = matches!(result, Err(Error::Internal(_)));
        result.map(|()| 0)
    }
}
