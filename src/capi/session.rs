//! Exports: the surrogate.

use super::door;
use super::fields::{read_fields, read_outputs};
use super::model::ModelHandle;
use super::raw::{self, FieldData, FieldOut, MeshData};
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::{Model, Output};
use m4gn_step::{FieldMut, Session, SessionOptions};
use std::ffi::{CString, c_char};
use std::sync::Arc;

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
    pub(super) session: Session,
    /// The model as it was opened.
    pub(super) model: Arc<Model>,
    /// The fields' names as C reads them.
    names: Vec<CString>,
    segment_record: CString,
    /// Set while a call runs: one that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    comm: i32,
    place: Result<()>,
    mesh: *const MeshData,
    model: *const ModelHandle,
    options: *const c_char,
    cell_segment: *const i32,
) -> Result<SessionHandle> {
    let comm = Comm::from_fortran(comm)?;
    let read = || -> Result<((Mesh, &ModelHandle, SessionOptions), String)> {
        place?;
        // SAFETY: passed on to the caller; the labels are as many as the cells.
        unsafe {
            let mesh = raw::mesh(raw::reference("mesh", mesh)?)?;
            let model = raw::reference("model", model)?;
            let mut options = SessionOptions::parse(raw::options(options)?)?;
            options.cell_segment = raw::labels(cell_segment, mesh.n_cells())?;
            let same = format!("{}{}\n{}", options.shared()?, m4gn_domain::shared(&mesh), model.shared());
            Ok(((mesh, model, options), same))
        }
    };
    door::together("m4gn_session_new", &comm, read, |(mesh, model, options)| {
        let session = Session::new(comm.clone(), &mesh, &model.model, &options)?;
        handle(session, model.model.clone())
    })
}

fn handle(session: Session, model: Arc<Model>) -> Result<SessionHandle> {
    let name =
        |n: &str| CString::new(n).map_err(|_| Error::Model(format!("field name {n:?} has a zero byte")));
    let names = session.spec().fields.iter().map(|f| name(&f.name)).collect::<Result<_>>()?;
    let segment_record = name(session.segment_record())?;
    Ok(SessionHandle { session, model, segment_record, names, broken: false })
}

impl SessionHandle {
    /// What a call that changes the session does. Collective.
    fn guarded(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<i32> {
        let broken = std::mem::replace(&mut self.broken, true);
        let comm = self.session.comm().clone();
        let result = comm.guarded(|| match broken {
            true => Err(Error::Internal("the session broke in an earlier call and can only be freed".into())),
            false => work(self),
        });
        self.broken = matches!(result, Err(Error::Internal(_)));
        result.map(|()| 0)
    }

    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn step(&mut self, fields: (*const FieldData, i32), out: (*const FieldOut, i32)) -> Result<()> {
        let (n_cells, n_boundary) = (self.session.n_cells(), self.session.n_boundary());
        // SAFETY: as above; outputs are not turned into references before the inputs are no longer needed, since
        // the host may name the same arrays.
        let read = || unsafe { Ok((read_fields(fields, n_cells, n_boundary)?, read_outputs(out, n_cells)?)) };
        let (fields, outputs, problem) = match read() {
            Ok((fields, outputs)) => (fields, outputs, None),
            Err(e) => (Vec::new(), Vec::new(), Some(e)),
        };
        let checked = match problem {
            Some(e) => Err(e),
            None => self.session.check_outputs(outputs.iter().map(|(shape, _)| *shape)),
        };
        self.session.advance(&fields, checked)?;
        drop(fields);
        for (shape, cells) in outputs {
            // SAFETY: not null (checked in read_outputs), of this length by the header; no other reference lives.
            let cells = unsafe { raw::slice_mut(shape.name, cells, shape.len)? };
            self.session.write(&mut FieldMut { name: shape.name, components: shape.components, cells });
        }
        Ok(())
    }
}

/// What a getter returns after a failure, where it does not return a status.
fn no_count(_: i32) -> i32 {
    -1
}

exports! {
    /// Builds graph, modes and segments for a model.
    fn m4gn_session_new(
        comm: i32,
        mesh: *const MeshData,
        model: *const ModelHandle,
        options: *const c_char,
        cell_segment: *const i32,
        session: *mut *mut SessionHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            door::create(raw::reference_mut("session", session), |place| {
                new(comm, place, mesh, model, options, cell_segment)
            })
        }
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
            is_input: i32::from(handle.session.spec().reads(field)),
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

    /// Groups of cells that the network lives on; -1 for a null session.
    fn m4gn_session_n_groups(session: *const SessionHandle) -> i32, or no_count; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { raw::reference("session", session)? }.session.n_groups() as i32)
    }

    /// Group of each of this rank's cells.
    fn m4gn_session_groups(session: *const SessionHandle, cell_group: *mut i32) -> i32, or |s| s; {
        // SAFETY: a session of ours and the host's array of n_cells, or null.
        let (handle, out) = unsafe {
            let handle = raw::reference("session", session)?;
            (handle, raw::slice_mut("cell_group", cell_group, handle.session.n_cells())?)
        };
        let Some(groups) = handle.session.cell_group() else {
            return Err(Error::Input("the network of this session lives on the cells and has no groups of them".into()));
        };
        out.copy_from_slice(groups);
        Ok(0)
    }

    /// How the segments were computed; null for a null session.
    fn m4gn_session_segment_record(session: *const SessionHandle) -> *const c_char, or |_| std::ptr::null(); {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { raw::reference("session", session)? }.segment_record.as_ptr())
    }

    /// Where the obstacle is at the start and at the end of the next step.
    fn m4gn_session_set_obstacle(
        session: *mut SessionHandle,
        now: *const f64,
        after: *const f64,
        n_obstacle: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours, or null.
        let handle = unsafe { raw::reference_mut("session", session)? };
        handle.guarded(|handle| {
            let read = || {
                let n = raw::count("n_obstacle", n_obstacle)?;
                // SAFETY: the host's arrays, as the header says.
                unsafe { Ok((raw::vectors("now", now, n)?, raw::vectors("after", after, n)?)) }
            };
            let (now, after) = handle.session.comm().agree(read())?;
            handle.session.set_obstacle(now, after)
        })
    }

    /// Whether mesh and fields are what the model was trained on.
    fn m4gn_session_outside(
        session: *const SessionHandle,
        count: *mut i32,
        why: *mut c_char,
        why_size: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours, or null.
        let handle = unsafe { raw::reference("session", session)? };
        let comm = handle.session.comm().clone();
        comm.guarded(|| {
            let places = || {
                let size = raw::count("why_size", why_size)?;
                // SAFETY: the host's places, as the header says.
                unsafe { Ok((raw::reference_mut("count", count)?, raw::slice_mut("why", why, size)?)) }
            };
            let (count, why) = comm.agree(places())?;
            let found = handle.session.outside();
            *count = found.len() as i32;
            raw::put_text(&found.join("\n"), why);
            Ok(())
        })?;
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
        // SAFETY: the host's arrays, as the header says. The ranks agree within the step.
        handle.guarded(|handle| unsafe { handle.step((fields, n_in), (out, n_out)) })
    }
}
