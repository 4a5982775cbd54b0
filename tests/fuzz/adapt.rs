//! States of an adaptation as they are read, and its settings.

use crate::fuzzing::{Random, fuzz};
use crate::host::*;
use crate::{damage_header, place, root};
use m4gn::{AdaptReport, FieldData};
use m4gn_mesh::parallel::NO_MPI;
use m4gn_samples::mesh as sample;
use serde_json::{Value, json};
use std::ffi::CString;
use std::ptr::null;

/// Frames of a small flow, 0.002 s apart from `first` on.
///
/// # Safety
/// `adapt` must be an adaptation to a session on the mesh of `host`.
unsafe fn frames(adapt: Handle, host: &Host, first: usize, r: &mut Random) {
    for i in first..first + 12 {
        let value = if r.below(20) == 0 {
            r.real()
        } else {
            0.1 * i as f64
        };
        let (cells, faces) = (
            vec![value; 3 * host.mesh.n_cells()],
            vec![value; 3 * host.mesh.boundary.len()],
        );
        let field = |name: &'static std::ffi::CStr, components: i32| FieldData {
            name: name.as_ptr(),
            components,
            cells: cells.as_ptr(),
            boundary: faces.as_ptr(),
        };
        let fields = [field(c"U", 3), field(c"p", 1)];
        // SAFETY: arrays of the lengths that mesh and components say.
        unsafe { m4gn_adapt_frame(adapt, 0.002 * i as f64, 0, fields.as_ptr(), 2) };
    }
}

#[test]
fn adaptation_states() {
    let host = Host::new(sample::triangles(4, 3, 1.0, 0.7));
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    let usual = |method: &str, overlap: bool| json!({ "mode": "during", "method": method, "steps": 1, "stepsEach": 1, "heldBack": 0.4, "overlap": overlap });
    let (_folder, path) = place("state.adapt");
    let name = CString::new(path.to_str().unwrap()).unwrap();
    let mut session = none();
    // SAFETY: handles of these calls, arrays of the lengths that the counts say.
    unsafe {
        let made = m4gn_session_new(NO_MPI, &host.data, model, null(), null(), &mut session);
        m4gn_model_free(model);
        assert_eq!(made, 0, "{}", message());
    }
    // SAFETY: as above.
    let good = [("gradient", false), ("ridge", false), ("gradient", true)].map(|(method, overlap)| unsafe {
        let (mut adapt, mut note) = (none(), [0; 256]);
        let settings = options(&usual(method, overlap));
        assert_eq!(
            m4gn_adapt_new(session, &host.data, settings.as_ptr(), &mut adapt),
            0
        );
        frames(adapt, &host, 0, &mut Random::new(3));
        let mut report = AdaptReport::default();
        let ran = m4gn_adapt_run(adapt, session, 1, &mut report, note.as_mut_ptr(), 256);
        // A round beside the run has brought nothing yet.
        assert_eq!((ran, report.steps > 0), (0, !overlap), "{}", message());
        assert_eq!(m4gn_adapt_save(adapt, name.as_ptr()), 0, "{}", message());
        m4gn_adapt_free(adapt);
        (method, overlap, std::fs::read(&path).unwrap())
    });
    fuzz("adapt", |r| {
        let (method, overlap, good) = r.pick(&good);
        let mut settings = usual(method, *overlap);
        if r.below(4) == 0 {
            let keys = [
                "window",
                "maxFrames",
                "steps",
                "unroll",
                "batch",
                "learningRate",
                "noise",
                "heldBack",
                "pull",
                "budget",
            ];
            settings[*r.pick(&keys)] = match r.below(2) {
                0 => Value::from(r.below(5)),
                _ => r.real().into(),
            };
        }
        let settings = options(&settings);
        let mut bytes = good.clone();
        match r.below(4) {
            0 => (),
            1 => r.damage(&mut bytes),
            _ => damage_header(&mut bytes, r),
        }
        std::fs::write(&path, &bytes).unwrap();
        let (mut adapt, mut note) = (none(), [0; 256]);
        let mut report = AdaptReport::default();
        // SAFETY: as above.
        unsafe {
            if m4gn_adapt_new(session, &host.data, settings.as_ptr(), &mut adapt) == 0 {
                m4gn_adapt_load(adapt, session, name.as_ptr());
                frames(adapt, &host, 12, r);
                m4gn_adapt_run(
                    adapt,
                    session,
                    1 + r.below(3) as i32,
                    &mut report,
                    note.as_mut_ptr(),
                    256,
                );
            }
            let text = message();
            assert!(!text.contains("internal error"), "{text}");
            m4gn_adapt_free(adapt);
        }
        bytes.len()
    });
    // SAFETY: made above, and freed once.
    unsafe { m4gn_session_free(session) };
}
