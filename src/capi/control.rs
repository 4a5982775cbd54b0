//! Exports: the controller of a surrogate's jumps.

use super::door;
use super::raw;
use super::session::SessionHandle;
use m4gn_mesh::Error;
use m4gn_model::Output;
use m4gn_ride::control::{Control, ControlSettings, StrideError};
use std::ffi::c_char;

/// `m4gn_control`
pub struct ControlHandle(Control);

exports! {
    /// Whether settings can be used.
    fn m4gn_control_check(settings: *const c_char) -> i32, or |status| status; {
        // SAFETY: the host's text, or null.
        ControlSettings::parse(unsafe { raw::text("settings", settings)? })?;
        Ok(0)
    }

    /// Begins the control of a session's jumps.
    fn m4gn_control_new(
        session: *const SessionHandle,
        settings: *const c_char,
        note: *mut c_char,
        note_size: i32,
        control: *mut *mut ControlHandle,
    ) -> i32, or |status| status; {
        // SAFETY: a session of ours and the host's pointers, as the header says.
        unsafe {
            let session = raw::reference("session", session)?;
            door::create(raw::reference_mut("control", control), |place| {
                place?;
                let size = raw::count("note_size", note_size)?;
                let note = raw::slice_mut("note", note, size)?;
                let settings = ControlSettings::parse(raw::text("settings", settings)?)?;
                let spec = session.session.spec();
                let growth = |name: &str| spec.calibration.as_ref()?.factors(name).map(<[f64]>::to_vec);
                let outputs = spec.fields.iter().filter(|f| f.output != Output::None);
                let fields = outputs.map(|f| (f.name.clone(), growth(&f.name))).collect();
                let control = Control::new(fields, settings)?;
                raw::put_text(&control.not_calibrated().join(" "), note);
                Ok(ControlHandle(control))
            })
        }
    }

    /// Frees a controller; null is none.
    fn m4gn_control_free(control: *mut ControlHandle) -> (), or |_| (); {
        if !control.is_null() {
            // SAFETY: made by m4gn_control_new and freed once.
            drop(unsafe { Box::from_raw(control) });
        }
        Ok(())
    }

    /// Takes up a stride that solver and surrogate both took.
    fn m4gn_control_measure(
        control: *mut ControlHandle,
        strides: *const StrideError,
        n_fields: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's array, as the header says.
        let (handle, strides) = unsafe {
            (
                raw::reference_mut("control", control)?,
                raw::slice("strides", strides, raw::count("n_fields", n_fields)?)?,
            )
        };
        handle.0.measure(strides)?;
        Ok(0)
    }

    /// How far the next jump may go.
    fn m4gn_control_strides(
        control: *const ControlHandle,
        most: i32,
        strides: *mut i32,
        error: *mut f64,
        estimate: *mut f64,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's places, as the header says.
        unsafe {
            let control = &raw::reference("control", control)?.0;
            let allowed = control.strides(raw::count("most", most)?);
            *raw::reference_mut("strides", strides)? = allowed as i32;
            *raw::reference_mut("error", error)? = control.error();
            *raw::reference_mut("estimate", estimate)? = control.estimate(allowed.max(1));
        }
        Ok(0)
    }

    /// Whether a stride of a jump may be true.
    fn m4gn_control_accepts(
        control: *const ControlHandle,
        changes: *const f64,
        n_fields: i32,
        accepted: *mut i32,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's array and place, as the header says.
        unsafe {
            let control = &raw::reference("control", control)?.0;
            let changes = raw::slice("changes", changes, raw::count("n_fields", n_fields)?)?;
            let accepted = raw::reference_mut("accepted", accepted)?;
            *accepted = i32::from(control.accepts(changes)?);
        }
        Ok(0)
    }

    /// Relative error that is expected of a jump of so many strides.
    fn m4gn_control_estimate(
        control: *const ControlHandle,
        strides: i32,
        estimate: *mut f64,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's place, as the header says.
        unsafe {
            let control = &raw::reference("control", control)?.0;
            *raw::reference_mut("estimate", estimate)? = control.estimate(raw::count("strides", strides)?);
        }
        Ok(0)
    }

    /// Relative error of the fields that the tolerance holds for.
    fn m4gn_control_relative(
        control: *const ControlHandle,
        errors: *const f64,
        n_fields: i32,
        relative: *mut f64,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's array and place, as the header says.
        unsafe {
            let control = &raw::reference("control", control)?.0;
            let errors = raw::slice("errors", errors, raw::count("n_fields", n_fields)?)?;
            *raw::reference_mut("relative", relative)? = control.relative(errors)?;
        }
        Ok(0)
    }

    /// What a controller decides by.
    fn m4gn_control_state(
        control: *const ControlHandle,
        strides: *mut StrideError,
        n_fields: i32,
        bad: *mut i32,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's array and place, as the header says.
        unsafe {
            let control = &raw::reference("control", control)?.0;
            let strides = raw::slice_mut("strides", strides, raw::count("n_fields", n_fields)?)?;
            let bad = raw::reference_mut("bad", bad)?;
            *bad = match control.state() {
                None => -1,
                Some((rows, bad)) if rows.len() == strides.len() => {
                    strides.copy_from_slice(&rows);
                    bad as i32
                }
                Some((rows, _)) => {
                    return Err(Error::Input(format!("n_fields {n_fields}: expected {}", rows.len())));
                }
            };
        }
        Ok(0)
    }

    /// Goes on from the state of another run's controller.
    fn m4gn_control_restore(
        control: *mut ControlHandle,
        strides: *const StrideError,
        n_fields: i32,
        bad: i32,
    ) -> i32, or |status| status; {
        // SAFETY: a controller of ours and the host's array, as the header says.
        unsafe {
            let control = &mut raw::reference_mut("control", control)?.0;
            let strides = raw::slice("strides", strides, raw::count("n_fields", n_fields)?)?;
            control.restore(strides, raw::count("bad", bad)?)?;
        }
        Ok(0)
    }
}
