//! What a host hands to sessions of bodies at points.

use crate::damaged::{at, body_host, not_internal, settings_as_text, size};
use crate::fuzzing::{Random, fuzz};
use crate::host::*;
use crate::place;
use m4gn_mesh::body::Obstacle;
use m4gn_parallel::NO_MPI;
use m4gn_samples::mesh as sample;
use serde_json::json;
use std::ptr::null;

/// A displacement of so many points, some of them nowhere.
fn displacement(n: usize, r: &mut Random) -> Vec<f64> {
    let mut values = vec![*r.pick(&[0.0, 0.0, 0.1, -0.2]); 3 * n];
    if r.below(3) == 0 && n > 0 {
        *at(&mut values, r) = r.real();
    }
    values
}

#[test]
fn bodies_at_points() {
    let (_folder, path) = place("body.safetensors");
    body_model().write(&path).unwrap();
    let model = open_model(path);
    fuzz("body", |r| {
        let h = body_host(r);
        let mut o = json!({});
        // Mostly what makes a session, so that there is one to be given the rest.
        match r.below(8) {
            0 => o["segments"] = json!({ "count": r.integer() }),
            1 => o["segments"] = json!({ "size": r.real() }),
            2 => o["backend"] = "torch".into(),
            _ => (),
        }
        let o = settings_as_text(&o, r);
        let mut session = none();
        // SAFETY: arrays at least of the lengths that the counts say.
        unsafe {
            if m4gn_session_new(NO_MPI, &h.data, model, o.as_ptr(), null(), &mut session) == 0 {
                for _ in 0..2 {
                    step(session, h.data.n_cells as usize, h.data.n_obstacle as usize, r);
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

/// A step from somewhere, under an obstacle that moves anywhere.
///
/// # Safety
/// `session` must be one of a body of `n` points under an obstacle of so many.
unsafe fn step(session: Session, n: usize, n_obstacle: usize, r: &mut Random) {
    let motion = [displacement(n_obstacle, r), displacement(n_obstacle, r)].concat();
    let start = displacement(n, r);
    let mut end = start.clone();
    let motion = if r.below(8) > 0 { motion.as_ptr() } else { null() };
    // SAFETY: arrays of the lengths that the counts say.
    let stepped = unsafe { m4gn_session_step(session, &start.as_ptr(), &motion, &end.as_mut_ptr()) };
    let good = match stepped {
        0 => end.iter().all(|v| v.is_finite()),
        _ => end.iter().zip(&start).all(|(a, b)| a.to_bits() == b.to_bits()),
    };
    assert!(good, "a step that ended with {stepped} wrote what is not finite, or wrote at all: {end:?}");
}

/// An obstacle beside, around and inside of a body, whole and damaged: what is no rigid body outside of the other is refused.
#[test]
fn obstacles() {
    let body = sample::bar(3);
    fuzz("obstacle", |r| {
        let size = *r.pick(&[1e-30, 1e-3, 0.3, 1.0, 30.0, 1e30]);
        let (points, triangles) = sample::brick([size, 0.7 * size, 0.4 * size]);
        let from = [0, 1, 2].map(|_| *r.pick(&[-9.0, 0.1, 0.45, 1.7, 8.0]));
        let mut obstacle = Obstacle {
            positions: points.iter().map(|p| [0, 1, 2].map(|i| p[i] + from[i])).collect(),
            triangles,
        };
        let damaged = r.below(3) == 0;
        if damaged {
            match r.below(3) {
                0 => at(&mut obstacle.triangles, r)[r.below(3)] = r.integer() as i32,
                1 => at(&mut obstacle.positions, r)[r.below(3)] = r.real(),
                _ => obstacle.triangles.truncate(r.below(12)),
            }
        }
        let around = (0..3).all(|i| {
            let [low, high] = [0, 7].map(|p: usize| obstacle.positions[p][i]);
            body.positions.iter().all(|x| low < x[i] && x[i] < high)
        });
        let placed = obstacle.check(&body);
        assert!(damaged || !around || placed.is_err(), "the body lies inside: {obstacle:?}");
        // A turn about z, a shift, and a growth.
        let (sin, cos) = (r.below(7) as f64).sin_cos();
        let (shift, growth) = (*r.pick(&[0.0, -0.4, 6.0]), *r.pick(&[1.0, 1.0, 1.01, 0.5, 0.0]));
        let to = |x: &[f64; 3]| {
            let turned = [cos * x[0] - sin * x[1], sin * x[0] + cos * x[1], x[2]];
            [0, 1, 2].map(|i| growth * turned[i] + shift - x[i])
        };
        let mut motion: Vec<[f64; 3]> = obstacle.positions.iter().map(to).collect();
        let rigid = obstacle.check_motion(&motion).is_ok();
        // Smaller ones are in the rounding of their place.
        if !damaged && size > 0.01 {
            assert_eq!(rigid, growth == 1.0, "grown by {growth}: {obstacle:?}");
        }
        at(&mut motion, r)[r.below(3)] = r.real();
        let _ = obstacle.check_motion(&motion);
        24 * (obstacle.positions.len() + body.positions.len())
    });
}
