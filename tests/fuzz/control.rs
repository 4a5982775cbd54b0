//! What a host hands to a controller.

use crate::fuzzing::fuzz;
use crate::host::*;
use crate::root;
use m4gn::StrideError;
use m4gn_mesh::parallel::NO_MPI;
use m4gn_samples::mesh as sample;
use serde_json::json;
use std::ptr::null;

/// Whatever the figures are: a jump has as many strides as the estimate allows, and never one of which nothing is known.
#[test]
fn control_figures() {
    let host = Host::new(sample::triangles(5, 4, 1.0, 0.7));
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    let mut session = none();
    // SAFETY: arrays of the lengths that the counts say.
    let made = unsafe { m4gn_session_new(NO_MPI, &host.data, model, null(), null(), &mut session) };
    // SAFETY: freed once.
    unsafe { m4gn_model_free(model) };
    assert_eq!(made, 0, "{}", message());
    fuzz("control", |r| {
        let mut settings = json!({ "tolerance": *r.pick(&[1e-9, 0.05, 1.0, 1e300]) });
        match r.below(9) {
            0 => settings["tolerance"] = r.real().into(),
            1 => settings["patience"] = r.integer().into(),
            2 => settings["fields"] = json!([r.pick(&["U", "p", "T", ""])]),
            3 => settings["onFailure"] = (*r.pick(&["stop", "solver", "goOn"])).into(),
            4 => settings["unknown"] = r.integer().into(),
            5 => settings["relTol"] = r.real().into(),
            _ => (),
        }
        let settings = options(&settings);
        let mut figure = || match r.below(3) {
            0 => r.real(),
            n => n as f64,
        };
        let rows: Vec<StrideError> = (0..3)
            .map(|_| StrideError {
                error: figure(),
                change: figure(),
                size: figure(),
            })
            .collect();
        let n = if r.below(4) == 0 { r.below(4) as i32 } else { 2 };
        let most = if r.below(2) == 0 {
            i32::MAX
        } else {
            r.integer() as i32
        };
        let (mut control, mut note) = (none(), [0; 64]);
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            if m4gn_control_new(session, settings.as_ptr(), note.as_mut_ptr(), 64, &mut control) == 0 {
                let known = match r.below(2) {
                    0 => m4gn_control_measure(control, rows.as_ptr(), n) == 0,
                    _ => m4gn_control_restore(control, rows.as_ptr(), n, r.integer() as i32) == 0,
                };
                let (mut strides, mut error, mut estimate, mut at_end) = (-1, 0.0, 0.0, 0.0);
                if m4gn_control_strides(control, most, &mut strides, &mut error, &mut estimate) == 0 {
                    assert!(
                        (0..=most.max(0)).contains(&strides),
                        "{strides} of {most} strides"
                    );
                    assert!(known || strides == 0, "a jump of which nothing is known");
                    assert!(m4gn_control_estimate(control, strides, &mut at_end) == 0);
                    assert!(!error.is_nan() && !estimate.is_nan(), "{error} and {estimate}");
                }
            }
            let text = message();
            assert!(!text.contains("internal error"), "{text}");
            m4gn_control_free(control);
        }
        64
    });
    // SAFETY: made above, and freed once.
    unsafe { m4gn_session_free(session) };
}
