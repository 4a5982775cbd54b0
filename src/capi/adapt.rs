//! Exports: a model that learns its case while the case runs.

use super::door;
use super::fields::read_fields;
use super::raw::{self, FieldData, MeshData};
use super::session::SessionHandle;
use m4gn_adapt::{Adaptation, Outcome, Settings};
use m4gn_mesh::{Error, Result};
use std::ffi::c_char;
use std::path::Path;

/// `m4gn_adapt_report`
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)]
pub struct AdaptReport {
    pub used: i32,
    pub strides: i32,
    pub frames: i64,
    pub steps: i64,
    pub seconds: f64,
    pub before: f64,
    pub after: f64,
}

/// `m4gn_adapt`
pub struct AdaptHandle {
    adaptation: Adaptation,
    /// Set while a call runs: one that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

impl AdaptHandle {
    fn guarded<T>(&mut self, work: impl FnOnce(&mut Adaptation) -> Result<T>) -> Result<T> {
        let broken = std::mem::replace(&mut self.broken, true);
        let result = self.adaptation.comm().clone().guarded(|| match broken {
            true => Err(Error::Internal(
                "the adaptation broke in an earlier call and can only be freed".into(),
            )),
            false => work(&mut self.adaptation),
        });
        self.broken = matches!(result, Err(Error::Internal(_)));
        result
    }

    /// A collective call on a file, whose name all ranks give alike, with what else the host gave.
    ///
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn with_file<T>(
        adapt: *mut Self,
        name: &str,
        path: *const c_char,
        other: Result<T>,
        work: impl FnOnce(&mut Adaptation, &Path, T) -> Result<()>,
    ) -> Result<i32> {
        // SAFETY: passed on to the caller.
        let (handle, path) = unsafe { (raw::reference_mut("adapt", adapt)?, raw::text("path", path)) };
        handle.guarded(|a| {
            let path = path.map(Path::new);
            let same = path.as_ref().map_or(String::new(), |path| door::file_name(path));
            let both = path.and_then(|path| Ok((path, other?)));
            let (path, other) = a.comm().agree_with(both, &format!("call {name}\npath {same}"))?;
            work(a, path, other)
        })?;
        Ok(0)
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    session: &SessionHandle,
    place: Result<()>,
    mesh: *const MeshData,
    settings: *const c_char,
) -> Result<AdaptHandle> {
    let comm = session.session.comm().clone();
    let read = || {
        place?;
        // SAFETY: passed on to the caller.
        let (mesh, text) = unsafe {
            (
                raw::mesh(raw::reference("mesh", mesh)?)?,
                raw::text("settings", settings)?,
            )
        };
        let settings = Settings::parse(text)?;
        // Each rank has threads of its own.
        let shared = Settings {
            threads: None,
            ..settings.clone()
        };
        Ok(((mesh, settings), format!("{shared:?}")))
    };
    door::together("m4gn_adapt_new", &comm, read, |(mesh, settings)| {
        Ok(AdaptHandle {
            adaptation: Adaptation::new(&session.session, &mesh, &session.model, settings)?,
            broken: false,
        })
    })
}

fn report(outcome: &Outcome) -> AdaptReport {
    AdaptReport {
        used: i32::from(outcome.used),
        strides: outcome.strides as i32,
        frames: outcome.frames as i64,
        steps: outcome.steps as i64,
        seconds: outcome.seconds,
        before: outcome.before,
        after: outcome.after,
    }
}

exports! {
    /// Whether settings can be used.
    fn m4gn_adapt_check(settings: *const c_char) -> i32, or |status| status; {
        // SAFETY: the host's text, or null.
        Settings::parse(unsafe { raw::text("settings", settings)? })?;
        Ok(0)
    }

    /// Begins an adaptation of a session's model.
    fn m4gn_adapt_new(
        session: *const SessionHandle,
        mesh: *const MeshData,
        settings: *const c_char,
        adapt: *mut *mut AdaptHandle,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours and the host's pointers, as the header says.
        unsafe {
            let session = raw::reference("session", session)?;
            door::create(raw::reference_mut("adapt", adapt), |place| new(session, place, mesh, settings))
        }
    }

    /// Frees an adaptation; null is none.
    fn m4gn_adapt_free(adapt: *mut AdaptHandle) -> (), or |_| (); {
        if !adapt.is_null() {
            // SAFETY: made by m4gn_adapt_new and freed once.
            drop(unsafe { Box::from_raw(adapt) });
        }
        Ok(())
    }

    /// Whether frames and runs are of use; 0 for null.
    fn m4gn_adapt_active(adapt: *const AdaptHandle) -> i32, or |_| 0; {
        // SAFETY: an adaptation of ours, or null.
        let handle = unsafe { raw::reference("adapt", adapt)? };
        Ok(i32::from(!handle.adaptation.is_done()))
    }

    /// Time by which a model step brings the surrogate further than its stride, s; 0 for null.
    fn m4gn_adapt_ahead(adapt: *const AdaptHandle, later: i32) -> f64, or |_| 0.0; {
        // SAFETY: an adaptation of ours, or null.
        let ahead = unsafe { raw::reference("adapt", adapt)? }.adaptation.ahead();
        Ok(if later == 0 { ahead.first } else { ahead.later })
    }

    /// The fields after a step of the solver.
    fn m4gn_adapt_frame(
        adapt: *mut AdaptHandle,
        time: f64,
        begins: i32,
        fields: *const FieldData,
        n_fields: i32,
    ) -> i32, or |status| status; {
        // SAFETY: an adaptation of ours, or null.
        let handle = unsafe { raw::reference_mut("adapt", adapt)? };
        handle.guarded(|a| {
            let (cells, boundary) = (a.n_cells(), a.n_boundary());
            // SAFETY: the host's arrays, as the header says.
            let values = unsafe { read_fields((fields, n_fields), cells, boundary) };
            let same = format!("call m4gn_adapt_frame\ntime {time:?}\nbegins {}", begins != 0);
            let values = a.comm().agree_with(values, &same)?;
            a.frame(time, begins != 0, &values)
        })?;
        Ok(0)
    }

    /// Learns, and hands the weights to the session.
    fn m4gn_adapt_run(
        adapt: *mut AdaptHandle,
        session: *mut SessionHandle,
        strides: i32,
        result: *mut AdaptReport,
        note: *mut c_char,
        note_size: i32,
    ) -> i32, or |status| status; {
        // SAFETY: an adaptation of ours, or null.
        let handle = unsafe { raw::reference_mut("adapt", adapt)? };
        handle.guarded(|a| {
            // SAFETY: a session of ours and the host's places, as the header says.
            let read = || unsafe {
                let session = raw::reference_mut("session", session)?;
                let strides = raw::count("strides", strides)?;
                let size = raw::count("note_size", note_size)?;
                Ok((session, strides, raw::reference_mut("report", result)?, raw::slice_mut("note", note, size)?))
            };
            let same = format!("call m4gn_adapt_run\nstrides {strides}");
            let (session, strides, result, note) = a.comm().agree_with(read(), &same)?;
            let outcome = a.run(strides)?;
            if outcome.used {
                session.session.set_weights(a.mesh(), &a.model())?;
            }
            *result = report(&outcome);
            raw::put_text(&outcome.note, note);
            Ok(())
        })?;
        Ok(0)
    }

    /// Writes the state.
    fn m4gn_adapt_save(adapt: *mut AdaptHandle, path: *const c_char) -> i32, or |status| status; {
        // SAFETY: as the header says.
        unsafe { AdaptHandle::with_file(adapt, "m4gn_adapt_save", path, Ok(()), |a, path, ()| a.save(path)) }
    }

    /// Takes up a state, and hands the weights to the session.
    fn m4gn_adapt_load(
        adapt: *mut AdaptHandle,
        session: *mut SessionHandle,
        path: *const c_char,
    ) -> i32, or |status| status; {
        // SAFETY: as the header says.
        unsafe {
            let session = raw::reference_mut("session", session);
            AdaptHandle::with_file(adapt, "m4gn_adapt_load", path, session, |a, path, session| {
                a.load(path)?;
                session.session.set_weights(a.mesh(), &a.model())
            })
        }
    }

    /// Writes the adapted model.
    fn m4gn_adapt_write_model(adapt: *mut AdaptHandle, path: *const c_char) -> i32, or |status| status; {
        // SAFETY: as the header says.
        unsafe {
            AdaptHandle::with_file(adapt, "m4gn_adapt_write_model", path, Ok(()), |a, path, ()| {
                let written = match a.comm().is_root() {
                    true => a.model().write(path),
                    false => Ok(()),
                };
                a.comm().agree(written)
            })
        }
    }
}
