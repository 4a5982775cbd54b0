//! The trajectory of a bar that Python wrote (`python -m m4gn_solids.fixture`), whole and damaged.

use super::*;
use crate::solids::elements::ElementKind;
use crate::solids::holding;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/solid.h5");

fn read_all(path: &Path) -> crate::Result<Vec<SolidFrame>> {
    let t = SolidTrajectory::open(path)?;
    t.stiffness()?;
    t.mass()?;
    t.read_frames(0, 1, t.times().len())
}

/// A copy that was changed.
fn changed(change: impl FnOnce(&hdf5::File)) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.h5");
    std::fs::copy(FILE, &path).unwrap();
    change(&hdf5::File::open_rw(&path).unwrap());
    (dir, path)
}

/// What reading all of the changed copy says.
fn message(change: impl FnOnce(&hdf5::File)) -> String {
    let (_dir, path) = changed(change);
    read_all(&path).unwrap_err().to_string()
}

#[test]
fn what_python_wrote_is_read() {
    let t = SolidTrajectory::open(FILE).unwrap();
    assert_eq!(
        (t.split(), t.times()),
        (Split::Test, &[0.0, 0.01, 0.02, 0.03][..])
    );
    assert_eq!(t.provenance()["family"], "bar");
    let body = t.body();
    assert_eq!((body.positions.len(), body.elements.len()), (12, 4));
    assert!(body.elements.kind.iter().all(|&k| k == ElementKind::Wedge));
    // Two bricks of 1 cm
    assert!((body.elements.measures(&body.positions).iter().sum::<f64>() - 2e-6).abs() < 1e-18);
    assert_eq!(body.edges, body.elements.edges());
    let handles: Vec<usize> = (0..12).filter(|&p| body.types[p] == PointType::Handle).collect();
    assert_eq!(handles, [0, 3, 6, 9]);
    let rubber = Material {
        young: 1e6,
        poisson: 0.4,
        density: 1000.0,
    };
    assert_eq!(body.material, [rubber; 4]);

    let frames = t.read_frames(0, 1, 4).unwrap();
    assert!(frames[0].displacement.as_flattened().iter().all(|&u| u == 0.0));
    // Pressed down, held at the handle; the obstacle goes down 1 mm a frame
    assert!(frames[3].displacement.iter().any(|u| u[1] < -5e-4));
    assert!(
        frames
            .iter()
            .all(|f| handles.iter().all(|&p| f.displacement[p] == [0.0; 3]))
    );
    assert!(
        frames[2]
            .obstacle
            .iter()
            .all(|u| (u[1] + 2e-3).abs() < 1e-9 && u[0] == 0.0)
    );
    assert!(frames[3].von_mises.as_ref().unwrap().iter().all(|&s| s >= 0.0));
    assert_eq!(t.read_frame(3).unwrap(), frames[3]);
    assert!(t.read_frame(4).unwrap_err().to_string().contains("4 frames"));
}

/// Stiffness: no force in a rigid motion, symmetric. Mass: that of the body in every direction.
#[test]
fn matrices_know_rigid_motions() {
    let t = SolidTrajectory::open(FILE).unwrap();
    let (k, m) = (t.stiffness().unwrap().unwrap(), t.mass().unwrap().unwrap());
    let x = &t.body().positions;
    let product = |a: &Csr, v: &[f64]| -> Vec<f64> {
        (0..36)
            .map(|r| {
                (a.start[r]..a.start[r + 1])
                    .map(|e| a.value[e] * v[a.column[e] as usize])
                    .sum()
            })
            .collect()
    };
    let largest = k.value.iter().fold(0.0f64, |s, v| s.max(v.abs()));
    let turn: Vec<f64> = x.iter().flat_map(|p| [-p[1], p[0], 0.0]).collect();
    assert!(product(&k, &turn).iter().all(|f| f.abs() < 1e-12 * largest));
    for i in 0..3 {
        let shift: Vec<f64> = (0..36).map(|d| f64::from(u8::from(d % 3 == i))).collect();
        assert!(product(&k, &shift).iter().all(|f| f.abs() < 1e-10 * largest));
        let mass: f64 = product(&m, &shift).iter().zip(&shift).map(|(a, b)| a * b).sum();
        assert!((mass - 2e-3).abs() < 1e-15, "{mass} kg");
    }
    let entry = |r: usize, c: usize| {
        let e = (k.start[r]..k.start[r + 1]).find(|&e| k.column[e] == c as i32);
        e.map_or(0.0, |e| k.value[e])
    };
    assert!((0..36).all(|r| (0..r).all(|c| (entry(r, c) - entry(c, r)).abs() < 1e-10 * largest)));
}

/// The obstacle's facets lie inside the sphere that the simulation knew, so the gap is at least the recorded one.
#[test]
fn persistence_and_the_worst_gap() {
    let t = SolidTrajectory::open(FILE).unwrap();
    let scores = holding::score(&t, 1).unwrap();
    let gap = scores.worst_gap.unwrap().cells;
    let recorded = t.provenance()["worst_gap"].as_f64().unwrap();
    assert!(
        (recorded - 1e-9..0.15).contains(&gap),
        "{gap}, recorded {recorded}"
    );
    let (a, b) = (scores.persistence, scores.hold_first);
    assert!(0.0 < a.rmse && a.rmse < b.rmse, "{a:?} {b:?}");
    assert!(0.0 < a.quality.gf_h && a.quality.gf_h < b.quality.gf_h);
    assert!(b.quality.mc > 0.0 && b.quality.ar > 0.0 && b.quality.inverted == 0.0);
    // Hold first at stride 3: its Hausdorff distance is at most the largest displacement
    let last = t.read_frame(3).unwrap();
    let length = |u: &[f32; 3]| u.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
    let largest = last.displacement.iter().map(length).fold(0.0, f64::max);
    let end = holding::score(&t, 3).unwrap().hold_first;
    assert!(end.quality.gf_h <= largest && end.quality.gf_h > 0.3 * largest);
    let squares: f64 = last.displacement.iter().map(|u| length(u).powi(2)).sum();
    assert!((end.rmse - (squares / 24.0).sqrt()).abs() < 1e-12);
}

#[test]
fn the_two_kinds_are_told_apart() {
    assert!(matches!(Recorded::open(FILE).unwrap(), Recorded::Points(_)));
    let text = Trajectory::open(FILE).unwrap_err().to_string();
    assert!(text.contains("deforming body"), "{text}");
    let (_dir, path) = changed(|f| f.delete_attr("location").unwrap());
    let text = SolidTrajectory::open(path).unwrap_err().to_string();
    assert!(text.contains("at cells"), "{text}");
}

#[test]
fn what_is_inconsistent_is_named() {
    let labels = |name: &str, at: usize, value: i32| {
        let name = name.to_string();
        message(move |f| {
            let data = f.dataset(&name).unwrap();
            let mut values = data.read_raw::<i32>().unwrap();
            values[at] = value;
            data.as_writer().write_raw(&values).unwrap();
        })
    };
    assert!(labels("points/type", 3, 9).contains("/points/type[3] is 9, expected 6 (body)"));
    assert!(labels("elements/kind", 1, 5).contains("/elements/kind[1] is flat"));
    assert!(labels("elements/kind", 1, 11).contains("element code 11"));
    assert!(labels("elements/kind", 1, 10).contains("/elements/start[2] is 12, expected 10"));
    assert!(labels("elements/points", 7, 12).contains("/elements/points[7] is 12, expected 0 to below 12"));
    // A wedge with a point twice is no wedge
    assert!(labels("elements/points", 0, 1).contains("/edges are not"));
    assert!(labels("edges", 1, 7).contains("/edges are not"));
    assert!(labels("obstacle/triangles", 0, -1).contains("/obstacle/triangles[0] is -1"));
    assert!(labels("obstacle/triangles", 0, 3).contains("not closed"));
    assert!(labels("stiffness/column", 5, 36).contains("/stiffness/column[5] is 36"));
    let value = |name: &str, value: f64| {
        let name = name.to_string();
        message(move |f| {
            let data = f.dataset(&name).unwrap();
            let mut values = data.read_raw::<f64>().unwrap();
            values[2] = value;
            data.as_writer().write_raw(&values).unwrap();
        })
    };
    assert!(value("elements/poisson", 0.5).contains("element 2 has E 1000000 Pa, nu 0.5"));
    assert!(value("elements/density", 0.0).contains("rho 0 kg"));
    assert!(value("elements/young", f64::NAN).contains("expected a finite one"));
    assert!(value("points/positions", f64::INFINITY).contains("value 2 of /points/positions"));
    assert!(value("points/positions", 0.05).contains("element 0 has the volume -"));
    assert!(value("mass/value", f64::NAN).contains("value 2 of /mass/value"));
    assert!(value("times", 0.0).contains("times must increase"));
    let starts = message(|f| {
        let data = f.dataset("mass/start").unwrap();
        let mut values = data.read_raw::<i64>().unwrap();
        values[4] = -1;
        data.as_writer().write_raw(&values).unwrap();
    });
    assert!(starts.contains("/mass/start[4] is -1"), "{starts}");
    assert!(message(|f| f.unlink("displacement").unwrap()).contains("/displacement cannot be opened"));
    assert!(message(|f| f.delete_attr("complete").unwrap()).contains("not finished"));
    assert!(message(|f| f.dataset("times").unwrap().resize(0).unwrap()).contains("no frames"));
    let short = message(|f| f.dataset("von_mises").unwrap().resize((2, 12)).unwrap());
    assert!(short.contains("[2, 12], expected [4, 12]"), "{short}");
    let nan = message(|f| {
        let data = f.dataset("obstacle/displacement").unwrap();
        let mut values = data.read_raw::<f32>().unwrap();
        values[1] = f32::NAN;
        data.as_writer().write_raw(&values).unwrap();
    });
    assert!(nan.contains("frame 0 of /obstacle/displacement"), "{nan}");
}

/// What may be left out is left out.
#[test]
fn optional_parts() {
    let (_dir, path) = changed(|f| {
        for name in ["stiffness", "mass", "von_mises", "obstacle"] {
            f.unlink(name).unwrap();
        }
    });
    let t = SolidTrajectory::open(path).unwrap();
    assert!(t.stiffness().unwrap().is_none() && t.mass().unwrap().is_none() && t.obstacle().is_none());
    let frame = t.read_frame(1).unwrap();
    assert!(frame.von_mises.is_none() && frame.obstacle.is_empty());
    assert!(holding::score(&t, 1).unwrap().worst_gap.is_none());
}

#[test]
fn every_truncation_is_an_error() {
    let whole = std::fs::read(FILE).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.h5");
    for length in (0..whole.len()).step_by(1777) {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(
            read_all(&path).is_err(),
            "truncated to {length} of {} bytes",
            whole.len()
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Flipped bytes anywhere give values or an error, never a panic, and never other frames: those are checksummed.
    #[test]
    fn damaged_bytes_never_panic(places in prop::collection::vec((0.0..1.0f64, 1..=255u8), 1..4)) {
        let mut bytes = std::fs::read(FILE).unwrap();
        for (place, flip) in places {
            let i = (place * bytes.len() as f64) as usize;
            bytes[i] ^= flip;
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.h5");
        std::fs::write(&path, &bytes).unwrap();
        if let Ok(found) = read_all(&path) {
            prop_assert_eq!(found, read_all(Path::new(FILE)).unwrap());
            let _ = holding::score(&SolidTrajectory::open(&path).unwrap(), 1);
        }
    }
}
