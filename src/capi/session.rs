//! Exports: the surrogate.

use super::guard::{self, no_count};
use super::model::ModelHandle;
use super::pointers::{self, MeshData};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, Output};
use m4gn_parallel::Comm;
use m4gn_step::{Field, FieldMut, Session, SessionOptions};
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
    /// Points of the obstacle of a body.
    n_obstacle: Option<usize>,
    /// For [`guard::changed`].
    broken: bool,
}

/// # Safety
/// Pointers must be what `m4gn.h` says; `cell_segment` has an entry for each cell.
unsafe fn read<'a>(
    mesh: *const MeshData,
    model: *const ModelHandle,
    options: *const c_char,
    cell_segment: *const i32,
) -> Result<((Mesh, &'a ModelHandle, SessionOptions), String)> {
    // SAFETY: passed on to the caller.
    unsafe {
        let mesh = pointers::mesh(pointers::reference("mesh", mesh)?)?;
        let model = pointers::reference("model", model)?;
        let mut options = SessionOptions::parse(pointers::options(options)?)?;
        options.cell_segment = pointers::labels(cell_segment, mesh.n_cells())?;
        let same = format!("{}{}\n{}", options.shared()?, m4gn_domain::shared(&mesh), model.shared());
        Ok(((mesh, model, options), same))
    }
}

/// Collective.
fn open(comm: &Comm, (mesh, model, options): (Mesh, &ModelHandle, SessionOptions)) -> Result<SessionHandle> {
    let session = Session::new(comm.clone(), &mesh, &model.model, &options)?;
    let (model, n_obstacle) = (model.model.clone(), mesh.obstacle.as_ref().map(|o| o.positions.len()));
    let name =
        |n: &str| CString::new(n).map_err(|_| Error::Model(format!("field name {n:?} has a zero byte")));
    let names = session.spec().fields.iter().map(|f| name(&f.name)).collect::<Result<_>>()?;
    let segment_record = name(session.segment_record())?;
    Ok(SessionHandle { session, model, segment_record, n_obstacle, names, broken: false })
}

impl SessionHandle {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn step(
        &mut self,
        cells: *const *const f64,
        boundary: *const *const f64,
        next: *const *mut f64,
    ) -> Result<()> {
        let spec = self.session.spec().clone();
        let comm = self.session.comm().clone();
        let (n_cells, n_boundary) = (self.session.n_cells(), self.session.n_boundary());
        let components = |vector: bool| if vector { 3 } else { 1 };
        let n = spec.fields.len();
        let read = || {
            // SAFETY: the host's arrays, as the header says; outputs are not turned into references before the inputs are no longer
            // needed, since the host may name the same arrays.
            unsafe {
                let cells = pointers::slice("cells", cells, n)?;
                let boundary = match boundary.is_null() {
                    true => None,
                    false => Some(pointers::slice("boundary", boundary, n)?),
                };
                let next = pointers::slice("next", next, n)?;
                let (mut fields, mut outputs, mut obstacle) = (Vec::new(), Vec::new(), None);
                for (i, field) in spec.fields.iter().enumerate() {
                    let components = components(field.vector);
                    if spec.reads(field) {
                        let values = pointers::slice(&field.name, cells[i], components * n_cells)?;
                        let faces = boundary.map_or(std::ptr::null(), |b| b[i]);
                        let faces = match self.n_obstacle {
                            Some(points) => {
                                let both = pointers::vectors("boundary", faces, 2 * points)?;
                                obstacle = Some(both.split_at(points));
                                &[]
                            }
                            None if n_boundary > 0 => {
                                pointers::slice(&field.name, faces, components * n_boundary)?
                            }
                            None => &[],
                        };
                        fields.push(Field { name: &field.name, components, cells: values, boundary: faces });
                    }
                    if field.output != Output::None {
                        let len = components * n_cells;
                        if len > 0 && (next[i].is_null() || !next[i].is_aligned()) {
                            return Err(Error::Input(format!(
                                "next: field '{}': expected an array of {len}, found a null pointer",
                                field.name
                            )));
                        }
                        outputs.push((&field.name[..], components, len, next[i]));
                    }
                }
                Ok((fields, outputs, obstacle))
            }
        };
        let (fields, outputs, obstacle) = comm.agree(read())?;
        if let Some((now, after)) = obstacle {
            self.session.set_obstacle(now, after)?;
        }
        self.session.advance(&fields, Ok(()))?;
        drop(fields);
        for (name, components, len, cells) in outputs {
            // SAFETY: not null (checked above), of this length by the header; no other reference lives.
            let cells = unsafe { pointers::slice_mut(name, cells, len)? };
            self.session.write(&mut FieldMut { name, components, cells });
        }
        Ok(())
    }
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
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("session", session));
            guard::create("m4gn_session_new", comm, place, |_| read(mesh, model, options, cell_segment), open)
        }
    }

    /// Time that one step advances, s; 0 for a null session.
    fn m4gn_session_stride(session: *const SessionHandle) -> f64, or |_| 0.0; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { pointers::reference("session", session)? }.session.spec().stride)
    }

    /// Segments K; -1 for a null session.
    fn m4gn_session_n_segments(session: *const SessionHandle) -> i32, or no_count; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { pointers::reference("session", session)? }.session.n_segments() as i32)
    }

    /// Fields of the model; -1 for a null session.
    fn m4gn_session_n_fields(session: *const SessionHandle) -> i32, or no_count; {
        // SAFETY: a session of ours, or null.
        Ok(unsafe { pointers::reference("session", session)? }.names.len() as i32)
    }

    /// What field `index` of the model is.
    fn m4gn_session_field(session: *const SessionHandle, index: i32, info: *mut FieldInfo) -> i32, or |s| s; {
        // SAFETY: a session of ours and the host's struct, or null.
        let (handle, info) = unsafe { (pointers::reference("session", session)?, pointers::reference_mut("info", info)?) };
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
            let handle = pointers::reference("session", session)?;
            (handle, pointers::slice_mut("cell_segment", cell_segment, handle.session.n_cells())?)
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
        Ok(unsafe { pointers::reference("session", session)? }.session.n_groups() as i32)
    }

    /// Group of each of this rank's cells.
    fn m4gn_session_groups(session: *const SessionHandle, cell_group: *mut i32) -> i32, or |s| s; {
        // SAFETY: a session of ours and the host's array of n_cells, or null.
        let (handle, out) = unsafe {
            let handle = pointers::reference("session", session)?;
            (handle, pointers::slice_mut("cell_group", cell_group, handle.session.n_cells())?)
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
        Ok(unsafe { pointers::reference("session", session)? }.segment_record.as_ptr())
    }

    /// Whether mesh and fields are what the model was trained on.
    fn m4gn_session_outside(
        session: *const SessionHandle,
        count: *mut i32,
        why: *mut c_char,
        why_size: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours, or null.
        let handle = unsafe { pointers::reference("session", session)? };
        let comm = handle.session.comm().clone();
        comm.guarded(|| {
            let places = || {
                let size = pointers::count("why_size", why_size)?;
                // SAFETY: the host's places, as the header says.
                unsafe { Ok((pointers::reference_mut("count", count)?, pointers::slice_mut("why", why, size)?)) }
            };
            let (count, why) = comm.agree(places())?;
            let found = handle.session.outside();
            *count = found.len() as i32;
            pointers::put_text(&found.join("\n"), why);
            Ok(())
        })?;
        Ok(0)
    }

    /// One step.
    fn m4gn_session_step(
        session: *mut SessionHandle,
        cells: *const *const f64,
        boundary: *const *const f64,
        next: *const *mut f64,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours, or null.
        let handle = unsafe { pointers::reference_mut("session", session)? };
        guard::changed("session", handle, |h| &mut h.broken, |h| {
            let comm = h.session.comm().clone();
            // SAFETY: the host's arrays, as the header says.
            comm.guarded(|| unsafe { h.step(cells, boundary, next) })
        })
    }
}
