//! What a host hands to the C ABI.

use crate::damaged::{at, host, n_cells, not_internal, settings_as_text, shorter, size, word};
use crate::fuzzing::{Random, fuzz};
use crate::host::*;
use crate::{place, read_all, root};
use m4gn_parallel::NO_MPI;
use m4gn_samples::mesh as sample;
use m4gn_samples::points::{Flat, Kind, block, rectangle};
use serde_json::json;
use std::ffi::{CStr, CString};
use std::ptr::null;

#[test]
fn session_arguments() {
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    fuzz("session", |r| {
        let h = host(r);
        let labels: Vec<i32> = (0..n_cells(&h)).map(|_| label(r)).collect();
        let mut o = json!({ "segments": {} });
        let mut cell_segment = null();
        let s = &mut o["segments"];
        match r.below(14) {
            0 => s["count"] = r.integer().into(),
            1 => s["modes"] = r.integer().into(),
            2 => s["overlap"] = r.integer().into(),
            3 => s["iterations"] = r.integer().into(),
            4 => s["tau"] = r.real().into(),
            5 => s["size"] = r.real().into(),
            6 => s["connected"] = r.integer().into(),
            7 => s["distanceScale"] = r.real().into(),
            8 => cell_segment = labels.as_ptr(),
            9 => s["method"] = (*r.pick(&["metis", "slic-md", "slic-mdodl", ""])).into(),
            10 => s["obstacles"] = json!([r.pick(&["wall", "a,b", "", "left"])]),
            11 => o["precision"] = (*r.pick(&["bf16", "fp64"])).into(),
            12 => o["n_threads"] = (r.integer() % 5).into(),
            _ => s["modal_solver"] = (*r.pick(&["direct", "iterative", "fast"])).into(),
        }
        let o = settings_as_text(&o, r);
        let mut session = none();
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            if m4gn_session_new(NO_MPI, &h.data, model, o.as_ptr(), cell_segment, &mut session) == 0 {
                let value = if r.below(2) == 0 { 0.5 } else { r.real() };
                let (given, mut next) = (Flow::of(&h, value), Flow::of(&h, 0.0));
                let (mut cells, mut faces, mut places) = (given.cells(), given.boundary(), next.next());
                match r.below(8) {
                    0 => *at(&mut cells, r) = null(),
                    1 => *at(&mut faces, r) = null(),
                    2 => *at(&mut places, r) = none(),
                    _ => (),
                }
                if m4gn_session_step(session, cells.as_ptr(), faces.as_ptr(), places.as_ptr()) == 0 {
                    let mut all = next.u.iter().chain(&next.p);
                    assert!(all.all(|v| v.is_finite()), "a step gave what is not finite");
                }
            }
            not_internal();
            m4gn_session_free(session);
        }
        size(&h)
    });
    // SAFETY: freed once.
    unsafe { m4gn_model_free(model) };
}

fn label(r: &mut Random) -> i32 {
    match r.below(6) {
        0 => r.integer() as i32,
        _ => r.below(4) as i32,
    }
}

/// What a stored field m4gnSegment may hold.
#[test]
fn stored_segments() {
    fuzz("segments", |r| {
        let h = host(r);
        let mut settings = json!({
            "segments": { "method": "slic-md", "count": 4, "modes": 3, "overlap": 1, "tau": 1.0 },
            "with_modes": r.below(2) == 0,
        });
        if r.below(3) == 0 {
            let solver = *r.pick(&["direct", "iterative", "none"]);
            settings["segments"]["modal_solver"] = solver.into();
        }
        let settings = settings_as_text(&settings, r);
        let labels: Vec<i32> = match r.below(3) {
            // All four, as a good one has them.
            0 => (0..n_cells(&h)).map(|c| c as i32 % 4).collect(),
            _ => (0..n_cells(&h)).map(|_| label(r)).collect(),
        };
        let cell_segment = if r.below(3) == 0 { null() } else { labels.as_ptr() };
        let mut segments = none();
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            m4gn_segments_new(NO_MPI, &h.data, none(), settings.as_ptr(), cell_segment, &mut segments);
            not_internal();
            m4gn_segments_free(segments);
        }
        size(&h)
    });
}

/// Whether what is stored fits, with the record that was stored beside it.
#[test]
fn stored_segments_and_their_record() {
    let (good, record) = cut();
    let entries = json!({ "method": "slic-md", "count": 4, "modes": 3 });
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    fuzz("fit", |r| {
        let h = host(r);
        let mut settings = json!({ "segments": entries });
        match r.below(8) {
            0 => settings["segments"]["count"] = r.integer().into(),
            1 => settings["segments"]["tau"] = r.real().into(),
            2 => settings["segments"]["obstacles"] = json!([r.pick(&["wall", "", "left"])]),
            _ => (),
        }
        let of = if r.below(8) == 0 { model } else { none() };
        let settings = settings_as_text(&settings, r);
        let mut labels = good.clone();
        labels.resize(n_cells(&h), 0);
        if r.below(2) == 0 {
            labels.iter_mut().for_each(|l| *l = label(r));
        }
        let mut text = record.clone();
        match r.below(4) {
            0 => (),
            1 => text.clear(),
            2 => r.damage_number(&mut text, 0),
            _ => r.damage(&mut text),
        }
        text.retain(|b| *b != 0);
        let text = CString::new(text).unwrap();
        let stored = if r.below(8) == 0 { null() } else { text.as_ptr() };
        let labels = if r.below(16) == 0 { null() } else { labels.as_ptr() };
        let (mut fit, mut why) = (-1, [1; 200]);
        let why_size = *r.pick(&[-1, 0, 1, 20, 200]);
        // SAFETY: arrays at least of the lengths that the counts say.
        let status = unsafe {
            let (settings, text) = (settings.as_ptr(), why.as_mut_ptr());
            m4gn_segments_fit(NO_MPI, &h.data, of, settings, labels, stored, &mut fit, text, why_size)
        };
        not_internal();
        if status == 0 {
            assert!((0..=1).contains(&fit), "fit {fit}");
            let written = &why[..why_size as usize];
            assert!(written.is_empty() || written.contains(&0), "an answer without an end");
            assert!(fit == 0 || written.first().is_none_or(|c| *c == 0), "it fits, and why not");
        }
        assert!(why[why_size.max(0) as usize..].iter().all(|c| *c == 1), "written too far");
        size(&h) + text.as_bytes().len()
    });
    // SAFETY: freed once.
    unsafe { m4gn_model_free(model) };
}

/// Good labels of a good mesh, and their record.
fn cut() -> (Vec<i32>, Vec<u8>) {
    let h = Host::new(sample::triangles(4, 3, 1.0, 0.7));
    let settings = options(&json!({ "segments": { "method": "slic-md", "count": 4, "modes": 3 } }));
    let mut labels = vec![0; n_cells(&h)];
    let mut segments = none();
    // SAFETY: arrays of the lengths that the counts say; the record lives as long as the segments.
    unsafe {
        let made = m4gn_segments_new(NO_MPI, &h.data, none(), settings.as_ptr(), null(), &mut segments);
        assert_eq!(made, 0, "{}", message());
        m4gn_segments_cells(segments, labels.as_mut_ptr());
        let record = CStr::from_ptr(m4gn_segments_record(segments)).to_bytes().to_vec();
        m4gn_segments_free(segments);
        (labels, record)
    }
}

/// Eigenvalues are finite where modes were found; frees them.
///
/// # Safety
/// The modes must be what a call of this status made.
unsafe fn found(status: i32, modes: *mut ModesHandle) {
    not_internal();
    // SAFETY: null, or modes that are freed once.
    unsafe {
        if status == 0 {
            let mut values = vec![0.0; m4gn_modes_n_modes(modes) as usize];
            m4gn_modes_eigenvalues(modes, values.as_mut_ptr());
            assert!(values.iter().all(|v| v.is_finite()), "eigenvalues {values:?}");
        }
        m4gn_modes_free(modes);
    }
}

#[test]
fn matrices() {
    fuzz("modes", |r| {
        let n = *r.pick(&[1usize, 2, 5, 12, 30, 130]);
        let scale = if r.below(3) == 0 { r.real() } else { 1.0 };
        let band = |r: &mut Random, inner: f64, outer: f64| {
            let mut rows = Rows::band(0..n as i64, n as i64, inner * scale, outer * scale);
            for _ in 0..r.below(3) {
                match r.below(4) {
                    // The last offset is a length, which must be that of the arrays.
                    0 => rows.row[r.below(n)] = r.integer(),
                    1 => *at(&mut rows.column, r) = r.integer(),
                    2 => rows.row[n] = r.below(rows.column.len() + 1) as i64,
                    _ => *at(&mut rows.value, r) = r.real(),
                }
            }
            rows
        };
        let (k, m) = (band(r, 2.0, -1.0), band(r, 4.0, 1.0));
        let (mut stiffness, mass) = (k.data(), m.data());
        if r.below(8) == 0 {
            // Not shorter: a damaged offset would then be a length.
            stiffness.n_rows = -1 - r.below(1 << 30) as i32;
        }
        let mut o = json!({ "modes": 3 });
        match r.below(6) {
            0 => o["modes"] = r.integer().into(),
            1 => o["block"] = r.integer().into(),
            2 => o["shift"] = r.real().into(),
            3 => o["modal_solver"] = (*r.pick(&["direct", "iterative"])).into(),
            _ => (),
        }
        let o = settings_as_text(&o, r);
        let mut modes = none();
        let mass = if r.below(2) == 0 { null() } else { &raw const mass };
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            let status = m4gn_modes_new(NO_MPI, &stiffness, mass, o.as_ptr(), null(), &mut modes);
            found(status, modes);
        }
        100 * n
    });
}

#[test]
fn elastic_bodies() {
    fuzz("solid", |r| {
        let mut mesh = match r.below(3) {
            0 => rectangle(*r.pick(&Flat::ALL), 3, 2, 1.0, 0.5),
            _ => block(*r.pick(&Kind::ALL), [3, 2, 1], [1.0, 0.4, 0.3]),
        };
        for _ in 0..r.below(3) {
            let (i, x) = (r.integer(), r.real());
            let last = mesh.face_start.len() - 1;
            match r.below(7) {
                0 => *at(&mut mesh.point_global, r) = i,
                1 => at(&mut mesh.points, r)[r.below(3)] = x,
                // The last offset is a length.
                2 => mesh.face_start[r.below(last)] = i as i32,
                3 => *at(&mut mesh.face_points, r) = i as i32,
                4 => *at(&mut mesh.face_owner, r) = i as i32,
                5 if !mesh.face_neighbour.is_empty() => *at(&mut mesh.face_neighbour, r) = i as i32,
                _ => mesh.points.iter_mut().flatten().for_each(|v| *v *= 1e-160),
            }
        }
        let n = mesh.n_cells;
        let mut h = BodyHost::new(mesh);
        let (material, fixed) = (vec![r.real(); n], [r.integer() as i32]);
        match r.below(11) {
            0 => h.data.young = material.as_ptr(),
            1 => h.data.poisson = material.as_ptr(),
            2 => h.data.density = material.as_ptr(),
            3 => (h.data.n_fixed, h.data.fixed_point) = (1, fixed.as_ptr()),
            4 => shorter(&mut h.data.n_fixed, r),
            5 => h.data.free_body = 1,
            6 => shorter(&mut h.data.n_internal_faces, r),
            7 => h.data.n_directions = r.integer() as i32,
            8 => h.data.face_points = null(),
            9 => shorter(&mut h.data.n_points, r),
            _ => (),
        }
        let modes = if r.below(6) == 0 { r.integer() } else { 3 };
        let o = settings_as_text(&json!({ "modes": modes }), r);
        let mut modes = none();
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            let status = m4gn_solid_modes_new(NO_MPI, &h.data, o.as_ptr(), &mut modes);
            found(status, modes);
        }
        1000 * (n + h.mesh.points.len())
    });
}

#[test]
fn recorder_arguments() {
    let (_folder, path) = place("recorded.h5");
    fuzz("recorder", |r| {
        let h = host(r);
        let odd = word(r, &[c"a/b", c"", c".", c"..", c"\xff", c"times", c"p"]);
        let fields =
            [declared(c"U".as_ptr(), 3), declared(if odd.is_null() { c"p".as_ptr() } else { odd }, 1)];
        let provenance = [json!({ "a": [1, 2] }), json!([]), json!({ "aB": { "c": null } })];
        let settings = json!({
            "path": path,
            "provenance": r.pick(&provenance),
            "split": r.pick(&["train", "test", "other"]),
            "overwrite": true,
        });
        let settings = CString::new(settings.to_string()).unwrap();
        let mut n_fields = 2;
        if r.below(6) == 0 {
            shorter(&mut n_fields, r);
        }
        let mut recorder = none();
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            if m4gn_recorder_new(NO_MPI, &h.data, settings.as_ptr(), fields.as_ptr(), n_fields, &mut recorder)
                == 0
            {
                let (n, b) = (h.data.n_cells as usize, h.data.n_boundary as usize);
                let value = if r.below(4) == 0 { r.real() } else { 0.5 };
                let values = (vec![value; 3 * n], vec![value; 3 * b]);
                let (mut cells, faces) = ([values.0.as_ptr(); 2], [values.1.as_ptr(); 2]);
                if r.below(8) == 0 {
                    *at(&mut cells, r) = null();
                }
                for _ in 0..2 {
                    let time = if r.below(2) == 0 { 0.5 } else { r.real() };
                    m4gn_recorder_append(recorder, time, cells.as_ptr(), faces.as_ptr());
                }
                if m4gn_recorder_finish(recorder) == 0 {
                    read_all(&path);
                }
            }
            not_internal();
            m4gn_recorder_free(recorder);
        }
        size(&h)
    });
}
