//! Steppers whose errors are known on paper, on the trajectory that Python wrote: 12 points, 4 frames, 0.01 s apart.

use super::*;
use crate::dataset::{PointType, SolidTrajectory};
use crate::solids::projection::ProjectionOptions;
use crate::{Error, Result};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/solid.h5");

type Vector = [f64; 3];

fn plan(trajectory: &SolidTrajectory, stride: f64) -> Plan {
    Plan {
        pace: Pace::new(trajectory.times(), stride).unwrap(),
        plain: true,
        projection: Some(ProjectionOptions::default()),
        keep: true,
    }
}

fn frame(t: &SolidTrajectory, k: usize) -> Vec<Vector> {
    let frame = t.read_frame(k).unwrap();
    frame.displacement.iter().map(|u| u.map(f64::from)).collect()
}

/// Runs a stepper that knows the truth, and what is done to it.
fn case(stride: f64, mut wrong: impl FnMut(&mut [Vector], &SolidTrajectory) -> Result<()>) -> Case {
    let t = SolidTrajectory::open(FILE).unwrap();
    let plan = plan(&t, stride);
    let obstacle = |k: usize| -> Vec<Vector> {
        let frame = t.read_frame(k).unwrap();
        frame.obstacle.iter().map(|u| u.map(f64::from)).collect()
    };
    let mut calls = 0;
    let mut step = |u: &mut [Vector], motion: [&[Vector]; 2]| {
        let frames = plan.pace.frames;
        let k = (0..plan.pace.steps)
            .find(|i| obstacle(i * frames) == motion[0])
            .unwrap();
        assert_eq!(obstacle((k + 1) * frames), motion[1]);
        u.copy_from_slice(&frame(&t, (k + 1) * frames));
        wrong(u, &t)
    };
    let errors = rollout::run(&t, &plan, &mut step, || {
        calls += 1;
        Ok(())
    })
    .unwrap();
    assert!(calls <= plan.steps());
    Case {
        path: FILE.into(),
        split: t.split(),
        pace: plan.pace,
        horizon: HORIZON as f64 * stride,
        errors,
        solver: Some(0.5),
    }
}

fn shift(u: &mut [Vector], t: &SolidTrajectory, by: f64) {
    for (u, kind) in u.iter_mut().zip(&t.body().types) {
        if *kind == PointType::Body {
            u[1] += by;
        }
    }
}

#[test]
fn the_truth_has_no_error() {
    let case = case(0.01, |_, _| Ok(()));
    let rows = case.rows();
    let model = &rows[0];
    assert_eq!(
        (
            model.figures.rmse_1,
            model.figures.rmse_50,
            model.figures.rmse_all
        ),
        (0.0, 0.0, 0.0)
    );
    assert_eq!(model.quality, Some(Quality::default()));
    assert_eq!(model.gap, smallest(&case.errors.gap));
    // Holding scores what `m4gn info --metrics` says
    let t = SolidTrajectory::open(FILE).unwrap();
    let held = crate::solids::holding::score(&t, 1).unwrap();
    let row = |key: &str| rows.iter().find(|r| r.key == key).unwrap();
    assert!((row("persistence").figures.rmse_all - held.persistence.rmse).abs() < 1e-15);
    assert!((row("hold_first").figures.rmse_all - held.hold_first.rmse).abs() < 1e-15);
    assert_eq!(row("hold_first").quality, Some(held.hold_first.quality));
    assert_eq!(
        row("hold_first").figures.rmse_1,
        row("persistence").figures.rmse_1
    );
}

/// All free points are 1e-4 m too far in y: a third of the squared errors is 1e-8.
#[test]
fn a_shift_on_paper() {
    let case = case(0.01, |u, t| {
        shift(u, t, 1e-4);
        Ok(())
    });
    let figures = json(std::slice::from_ref(&case));
    let of = |path: &str| figures.pointer(path).and_then(Value::as_f64).unwrap();
    let expected = (1e-8f64 / 3.0).sqrt();
    for key in ["/model/rmse_1", "/model/rmse_50", "/model/rmse_all"] {
        assert!((of(key) - expected).abs() < 1e-12, "{key} {}", of(key));
    }
    // The Hausdorff distance is at most the shift
    assert!(of("/gf_h") <= 1e-4 + 1e-12 && of("/gf_h") > 0.0 && of("/gf_h") == of("/model/gf_h"));
    assert!(of("/worst_gap") < of("/worst_gap_projected") + 0.02);
    // 0.5 s a frame of the solver
    assert_eq!(of("/solver_ms_per_step"), 500.0);
    assert!(of("/ms_per_step") >= 0.0 && of("/ms_per_projection") > 0.0 && of("/solver_ratio") > 0.0);
    assert_eq!(figures["split"], "test");
    assert!(figures["cases"][0]["hold_first"]["mc"].is_number());
}

/// One step over all frames; a stepper that lifts the body into the obstacle above it (y) is pushed back.
#[test]
fn projection_lifts_the_gap() {
    let body = SolidTrajectory::open(FILE).unwrap().body().clone();
    let cell = crate::solids::holding::cell_size(&body.positions, &body.edges);
    let case = case(0.03, |u, t| {
        shift(u, t, 0.4 * cell);
        Ok(())
    });
    let [model, projected] = [&case.rows()[0], &case.rows()[1]].map(|r| r.gap.unwrap());
    assert!(model < -0.1 && projected >= -0.02, "{model} {projected}");
    assert_eq!(case.errors.projected.as_ref().unwrap().kept.len(), 1);
}

#[test]
fn a_rollout_that_blows_up_has_no_figures() {
    let mut calls = 0;
    let case = case(0.01, |u, t| {
        calls += 1;
        if calls == 5 {
            return Err(Error::Numerical("nan".into()));
        }
        shift(u, t, if calls > 6 { 1e9 } else { 0.0 });
        Ok(())
    });
    assert_eq!(case.errors.model.as_ref().unwrap().rollout.len(), 1);
    assert!(case.diverged().unwrap().starts_with("step 2: nan"));
    assert!(case.errors.projected.as_ref().unwrap().diverged.is_some());
    let figures = json(std::slice::from_ref(&case));
    assert!(figures["model"]["rmse_all"].is_null() && figures["model"]["rmse_1"] == 0.0);
    assert!(figures["gf_h"].is_null() && figures["diverged"] == 1);
}

#[test]
fn the_page_and_the_series() {
    let case = case(0.01, |u, t| {
        shift(u, t, 1e-4);
        Ok(())
    });
    let spec = crate::model::tests::bodies();
    let html = report("m.safetensors", &spec, std::slice::from_ref(&case))
        .unwrap()
        .html();
    for text in [
        "worst gap",
        "Shapes",
        "hold first",
        "model, projected",
        "solver took 500 ms",
    ] {
        assert!(html.contains(text), "{text}");
    }
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("series");
    write_series(&folder, &case).unwrap();
    // Four states of three things, and their lists
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 15);
    let list = std::fs::read_to_string(folder.join("prediction.pvd")).unwrap();
    assert!(
        list.contains("timestep=\"0.03\" file=\"prediction_0003.vtu\""),
        "{list}"
    );
    let last = std::fs::read_to_string(folder.join("prediction_0003.vtu")).unwrap();
    assert!(last.contains("Name=\"error\"") && last.contains("NumberOfPoints=\"12\""));
}
