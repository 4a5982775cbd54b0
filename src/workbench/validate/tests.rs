//! Figures on paper; predictions whose errors are known, and sessions, on the trajectory of a body that Python wrote: 12
//! points, 4 frames, 0.01 s apart.

use super::prediction::Prediction;
use super::*;
use m4gn_data::{FieldMeta, Frame, WriteOptions, Writer};
use m4gn_domain::body::quality::Quality;
use m4gn_mesh::NodeType;
use m4gn_samples::fails;
use m4gn_train::errors::SquaredError;
use serde_json::Value;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/solid.h5");

fn errors(values: &[f64]) -> Vec<SquaredError> {
    let error = |v: &f64| SquaredError::between(&[*v], &[0.0]);
    values.iter().map(error).collect()
}

fn prediction(key: &'static str, single: &[f64], rollout: &[f64]) -> Prediction {
    Prediction {
        key,
        name: key,
        fields: vec![FieldErrors { single: errors(single), rollout: errors(rollout) }],
        ..Prediction::default()
    }
}

fn case(split: Split, pace: Pace, single: f64, rollout: &[f64], hold: &[f64]) -> Case {
    let twice = vec![2.0 * single; hold.len()];
    let model = Prediction {
        largest: Some(1.1),
        diverged: (rollout.len() < hold.len()).then(|| "step 2".into()),
        seconds: (0.4, 4),
        ..prediction("model", &vec![single; hold.len()], rollout)
    };
    Case {
        path: "x.h5".into(),
        split,
        diameter: 9,
        horizon: HORIZON as f64 * pace.interval,
        pace,
        fields: vec![("U".into(), "m/s".into())],
        times: (1..=hold.len()).map(|i| 0.2 * i as f64).collect(),
        predictions: vec![
            model,
            prediction("persistence", &twice, &twice),
            prediction("hold_first", &twice, hold),
        ],
        variation: 0.2,
        data_gap: Vec::new(),
        solver: None,
        node_segment: Vec::new(),
        outside: Vec::new(),
    }
}

/// 20 frames a step: two steps within the first 50 frames.
const PACE: Pace = Pace { interval: 0.01, frames: 20, steps: 3 };

fn figures(case: &Case, row: usize) -> [f64; 3] {
    let f = case.rows()[row].figures[0];
    [f.rmse_1, f.rmse_50, f.rmse_all]
}

#[test]
fn figures_on_paper() {
    let c = case(Split::Test, PACE, 0.5, &[1.0, 7.0, 4.0], &[2.0, 2.0, 2.0]);
    for (found, expected) in figures(&c, 0).into_iter().zip([0.5, 5.0, 22.0_f64.sqrt()]) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    assert_eq!(figures(&c, 1), [1.0, 1.0, 1.0]);
    assert_eq!(figures(&c, 2), [1.0, 2.0, 2.0]);
    // A stride beyond 50 frames: one step.
    let long = Pace { interval: 0.01, frames: 100, steps: 3 };
    let c = case(Split::Test, long, 0.5, &[1.0, 7.0, 4.0], &[2.0; 3]);
    assert_eq!(figures(&c, 0)[1], 1.0);
}

#[test]
fn splits_are_averaged_apart_and_test_counts() {
    let cases = [
        case(Split::Train, PACE, 0.1, &[1.0; 3], &[2.0; 3]),
        case(Split::Test, PACE, 0.2, &[2.0; 3], &[4.0; 3]),
        case(Split::Test, PACE, 0.4, &[4.0; 3], &[4.0; 3]),
    ];
    let figures = json(&cases);
    assert_eq!((figures["split"].as_str(), figures["trajectories"].as_u64()), (Some("test"), Some(2)));
    assert_eq!((&figures["field"], &figures["unit"]), (&"U".into(), &"m/s".into()));
    assert!((figures["model"]["rmse_1"].as_f64().unwrap() - 0.3).abs() < 1e-12);
    assert!((figures["model"]["rmse_50"].as_f64().unwrap() - 3.0).abs() < 1e-12);
    assert!((figures["splits"]["train"]["model"]["rmse_all"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    assert_eq!(figures["model"]["ms_per_step"], 100.0);
    assert_eq!(figures["model"]["largest_ratio"], 1.1);
    assert!(figures["hold_first"]["ms_per_step"].is_null());
    assert_eq!(headline(&cases[..1]).unwrap().name, "all");
    assert!(headline(&[]).is_none());
}

/// Two models of one flow, one in steps of two frames: RMSE-50 is of the same time, and says so.
#[test]
fn rmse_50_is_fifty_recorded_frames_whatever_the_stride() {
    let pace = |frames, steps| Pace { interval: 0.02, frames, steps };
    assert_eq!(pace(1, 100).rmse_50(), 1.0);
    assert_eq!(pace(4, 25).rmse_50(), 1.0);
    assert_eq!(pace(4, 25).steps_within(pace(4, 25).rmse_50()), 12);
    let of = |horizon| Case { horizon, ..case(Split::Test, pace(4, 3), 0.1, &[1.0; 3], &[2.0; 3]) };
    let head = |horizons: &[f64]| {
        let cases: Vec<Case> = horizons.iter().map(|h| of(*h)).collect();
        summaries(&cases)[0].tables()[0].to_string()
    };
    assert!(head(&[1.0]).contains("RMSE-50 (1.00 s) [m/s]"), "{}", head(&[1.0]));
    // Some are shorter
    assert!(head(&[1.0, 0.05]).contains("RMSE-50 (0.0500 to 1.00 s) [m/s]"), "{}", head(&[1.0, 0.05]));
}

/// Of three trajectories two end in a cycle, and on one of them a rollout became non-finite.
#[test]
fn errors_but_for_phase_are_of_the_trajectories_that_have_cycles() {
    let of = |[model, hold]: [Option<f64>; 2]| {
        let mut one = case(Split::Test, PACE, 0.5, &[1.0; 3], &[2.0; 3]);
        (one.predictions[0].phase_free, one.predictions[2].phase_free) = (model, hold);
        one
    };
    let mut cases = [of([Some(0.1), Some(0.5)]), of([None, None]), of([Some(0.3), Some(0.7)])];
    let figures = json(&cases);
    assert!((figures["model"]["phase_free"].as_f64().unwrap() - 0.2).abs() < 1e-12, "{figures}");
    assert!((figures["hold_first"]["phase_free"].as_f64().unwrap() - 0.6).abs() < 1e-12, "{figures}");
    assert!(figures["cases"][1]["model"].get("phase_free").is_none());
    let text = |cases: &[Case]| summaries(cases)[0].tables()[0].to_string();
    assert!(text(&cases).contains("phase-free [m/s]"), "{}", text(&cases));
    assert!(!text(&cases[1..2]).contains("phase-free"), "{}", text(&cases[1..2]));
    cases[0].predictions[0].phase_free = Some(f64::INFINITY);
    assert!(json(&cases)["model"]["phase_free"].is_null());
    assert!(text(&cases).contains("not finite"), "{}", text(&cases));
}

/// A flow that has come to rest is named, and the others are told without it.
#[test]
fn flows_that_hardly_move_are_named() {
    let of = |name: &str, variation, hold: &[f64]| Case {
        path: format!("data/{name}.h5").into(),
        variation,
        ..case(Split::Test, PACE, 0.5, &[3.0; 3], hold)
    };
    let mut cases = vec![of("a", 0.1, &[4.0; 3]), of("b", 0.01, &[1.0; 3]), of("c", 0.3, &[6.0; 3])];
    let line = |cases: &[Case]| summaries(cases)[0].line();
    let text = line(&cases);
    let expected = "Data that vary by less than 2 % in their second half: b.h5; RMSE-all without them: 3.00 (model), 5.00 (hold_first)";
    assert!(text.contains(expected), "{text}");
    let figures = json(&cases);
    assert_eq!(
        (&figures["still"], &figures["cases"][1]["variation"]),
        (&serde_json::json!(["b.h5"]), &serde_json::json!(0.01))
    );
    assert!(line(&cases[1..2]).ends_with("in their second half: b.h5"), "{}", line(&cases[1..2]));
    cases.remove(1);
    assert!(!line(&cases).contains("vary by less"), "{}", line(&cases));
}

#[test]
fn other_predicted_fields_have_figures_too() {
    let mut one = case(Split::Test, PACE, 0.5, &[1.0, 7.0, 4.0], &[2.0; 3]);
    one.fields.push(("p".into(), "m^2/s^2".into()));
    for (p, value) in one.predictions.iter_mut().zip([3.0, 5.0, 6.0]) {
        p.fields.push(FieldErrors { single: errors(&[value; 3]), rollout: errors(&[value + 1.0; 3]) });
    }
    let figures = json(&[one.clone()]);
    assert_eq!(figures["fields"]["p"]["model"]["rmse_1"], 3.0);
    assert_eq!(figures["fields"]["p"]["hold_first"]["rmse_50"], 7.0);
    assert_eq!(figures["cases"][0]["fields"]["p"]["model"]["rmse_all"], 4.0);
    let tables = summaries(&[one])[0].tables();
    assert!(tables[1].to_string().contains("[m^2/s^2]"), "{}", tables[1]);
}

/// Scores a step that knows the truth, and what is done to it.
fn known(stride: f64, mut wrong: impl FnMut(&mut [f64], &Trajectory) -> Result<()>) -> Case {
    let t = Trajectory::open(FILE).unwrap();
    let fields = m4gn_samples::model::bodies().fields;
    let pace = Pace::new(t.times(), stride).unwrap();
    let scene = Scene::read(&t, &fields, pace).unwrap();
    let mut followed = None;
    let mut step = |fields: &[Field], out: &mut [FieldMut], given: StepContext| {
        let k = (0..pace.steps).find(|&k| scene.motion(k) == given.motion[0]).unwrap();
        assert_eq!(scene.motion(k + 1), given.motion[1]);
        // A step starts from a recorded frame, or goes on from the last one.
        match given.recorded {
            true => assert_eq!(fields[0].cells, scene.truth(0, k)),
            false => assert_eq!(followed, Some(k)),
        }
        followed = Some(k + 1);
        out[0].cells.copy_from_slice(scene.truth(0, k + 1));
        wrong(out[0].cells, &t)
    };
    let mut calls = 0;
    let mut count = || {
        calls += 1;
        Ok(())
    };
    let model = scene.predict(Keep::All, &mut step, &mut count);
    assert!(calls <= steps(pace));
    let mut case = Case::of(&t, &scene, &fields, None, model.unwrap()).unwrap();
    case.solver = Some(0.5);
    case
}

/// Moves the free points in y.
fn shift(u: &mut [f64], t: &Trajectory, by: f64) {
    let rows = u.chunks_exact_mut(3).zip(&t.body().unwrap().types);
    rows.filter(|(_, kind)| **kind == NodeType::Body).for_each(|(u, _)| u[1] += by);
}

#[test]
fn the_truth_has_no_error() {
    let case = known(0.01, |_, _| Ok(()));
    // Three steps are all there is: no more is said to be covered
    assert!((case.horizon - 0.03).abs() < 1e-12, "{}", case.horizon);
    let rows = case.rows();
    assert_eq!(figures(&case, 0), [0.0; 3]);
    let quality = rows[0].quality.unwrap();
    assert!(quality.mc_predicted > 1.0);
    assert_eq!(quality, Quality { mc_predicted: quality.mc_predicted, ..Quality::default() });
    assert_eq!(rows[0].gap, case.data_gap.iter().copied().reduce(f64::min));
    assert_eq!(rows[0].largest, Some(1.0));
    // Four frames are no cycle
    assert_eq!(rows[0].phase_free, None);
    // Holding is worse the longer it is held
    let row = |key: &str| rows.iter().find(|r| r.key == key).unwrap();
    assert!(row("persistence").figures[0].rmse_all < row("hold_first").figures[0].rmse_all);
    let quality = row("hold_first").quality.unwrap();
    assert!(quality.gf_h > 0.0 && quality.mc > 0.0 && quality.ar > 0.0 && quality.inverted == 0.0);
    assert_eq!(row("hold_first").figures[0].rmse_1, row("persistence").figures[0].rmse_1);
}

/// From the first frame to the last in one step.
#[test]
fn a_single_step_moves_as_well() {
    assert!(known(0.03, |_, _| Ok(())).variation > 0.0);
}

/// All free points are 1e-4 m too far in y: a third of the squared errors is 1e-8.
#[test]
fn a_shift_on_paper() {
    let case = known(0.01, |u, t| {
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
    assert!(of("/model/gf_h") <= 1e-4 + 1e-12 && of("/model/gf_h") > 0.0);
    // 0.5 s a frame of the solver
    assert_eq!(of("/solver_ms_per_step"), 500.0);
    assert!(of("/model/ms_per_step") >= 0.0 && of("/solver_ratio") > 0.0);
    assert_eq!(figures["split"], "test");
    assert!(figures["cases"][0]["hold_first"]["mc"].is_number());
}

/// Every other point is a segment's, whose points are 1e-4 m too far in y.
#[test]
fn errors_of_segments_on_paper() {
    let t = Trajectory::open(FILE).unwrap();
    let fields = m4gn_samples::model::bodies().fields;
    let pace = Pace::new(t.times(), 0.01).unwrap();
    let scene = Scene::read(&t, &fields, pace).unwrap();
    let mut found = scene.truth(0, pace.steps).to_vec();
    found.chunks_exact_mut(3).skip(1).step_by(2).for_each(|u| u[1] += 1e-4);
    let labels: Vec<i32> = (0..found.len() as i32 / 3).map(|p| p % 2).collect();
    let over = scene.over_segments(&[(pace.steps, found)].into(), &labels);
    let rmse = &over[&pace.steps];
    assert_eq!((over.len(), rmse.len(), rmse[0]), (1, 2, 0.0));
    assert!((rmse[1] - (1e-8f64 / 3.0).sqrt()).abs() < 1e-12, "{rmse:?}");
}

#[test]
fn a_prediction_that_blows_up_has_no_figures() {
    let mut calls = 0;
    let case = known(0.01, |_, _| {
        calls += 1;
        match calls {
            5 => Err(Error::Numerical("nan".into())),
            _ => Ok(()),
        }
    });
    assert_eq!(case.predictions[0].fields[0].rollout.len(), 1);
    assert!(case.diverged().unwrap().starts_with("step 2: nan"));
    let figures = json(std::slice::from_ref(&case));
    assert!(figures["model"]["rmse_all"].is_null() && figures["model"]["rmse_1"] == 0.0);
    assert!(figures["model"]["gf_h"].is_null() && figures["diverged"] == 1);
    assert!(summaries(&[case])[0].tables()[0].to_string().contains("not finite"));
}

/// Three frames are too few for a fit: single steps hold, and there is no rollout.
#[test]
fn a_fit_needs_a_history() {
    let case = known(0.01, |_, _| Ok(()));
    let rows = case.rows();
    let row = |key: &str| rows.iter().find(|r| r.key == key).unwrap().figures[0];
    assert_eq!(row("dmd").rmse_1, row("persistence").rmse_1);
    assert!(row("dmd").rmse_all.is_nan());
    assert!(json(&[case])["dmd"]["rmse_all"].is_null());
}

/// A line needs two frames: the first step is no line, and counts in neither figure.
#[test]
fn extrapolation_counts_from_its_second_step() {
    let t = Trajectory::open(FILE).unwrap();
    let fields = m4gn_samples::model::bodies().fields;
    let pace = Pace::new(t.times(), 0.01).unwrap();
    let scene = Scene::read(&t, &fields, pace).unwrap();
    let case = Case::of(&t, &scene, &fields, None, Prediction::default()).unwrap();
    let row = case.predictions.iter().position(|p| p.key == "extrapolation").unwrap();
    let mut expected = SquaredError::default();
    for i in 1..pace.steps {
        let pairs = scene.truth(0, i).iter().zip(scene.truth(0, i - 1));
        let line: Vec<f64> = pairs.map(|(a, b)| 2.0 * a - b).collect();
        expected.add(scene.error(0, &line, i + 1));
    }
    assert!(expected.rmse() > 0.0);
    assert_eq!(figures(&case, row), [expected.rmse(); 3]);
    // One step alone has none.
    let pace = Pace { frames: pace.steps, steps: 1, ..pace };
    let scene = Scene::read(&t, &fields, pace).unwrap();
    let mut case = Case::of(&t, &scene, &fields, None, Prediction::default()).unwrap();
    assert!(figures(&case, row).iter().all(|f| f.is_nan()));
    case.predictions.retain(|p| p.key == "extrapolation");
    assert!(json(&[case])["extrapolation"]["rmse_1"].is_null());
}

/// A vortex that is carried along: once there are frames enough the fit knows the next one, where holding is off.
#[test]
fn a_fit_knows_what_is_carried_along() {
    let folder = tempfile::tempdir().unwrap();
    m4gn_samples::training::write_data(folder.path(), 1).unwrap();
    let t = Trajectory::open(folder.path().join("000.h5")).unwrap();
    let spec = m4gn_samples::model::spec();
    let pace = Pace::new(t.times(), 0.01).unwrap();
    let scene = Scene::read(&t, &spec.fields, pace).unwrap();
    let case = Case::of(&t, &scene, &spec.fields, None, Prediction::default()).unwrap();
    let last = |key: &str| {
        let row = case.predictions.iter().find(|p| p.key == key).unwrap();
        row.fields[0].single.last().unwrap().rmse()
    };
    assert!(pace.steps > 26, "{}", pace.steps);
    assert!(last("dmd") < 0.2 * last("persistence"), "{} {}", last("dmd"), last("persistence"));
}

/// A model of bodies whose steps change next to nothing: the obstacle sinks into the body.
fn still() -> Model {
    let mut spec = m4gn_samples::model::bodies();
    spec.segments.count = 2;
    spec.segments.modes = 1;
    let mut model = Model::random(spec, 5).unwrap();
    for name in ["norm.output.mean", "norm.output.std"] {
        let tensor = model.tensors.get_mut(name).unwrap();
        tensor.data.fill(1e-9);
    }
    model
}

#[test]
fn a_rollout_of_a_body_is_a_trajectory() {
    let (t, folder) = (Trajectory::open(FILE).unwrap(), tempfile::tempdir().unwrap());
    let out = folder.path().join("p.h5");
    let options = SessionOptions::default();
    let steps = Some(3);
    let found = crate::predict::run(&still(), &t, &options, (steps, &out), &mut || Ok(())).unwrap();
    // A model that stands still is the first frame.
    let [model, _, hold] = &found.fields[0].rows;
    assert_eq!((found.steps, model.len()), (3, 3));
    assert!(model.iter().zip(hold).all(|(a, b)| (a / b - 1.0).abs() < 1e-3), "{model:?} {hold:?}");
    let p = Trajectory::open(out).unwrap();
    assert_eq!((p.body(), p.obstacle()), (t.body(), t.obstacle()));
    let frames = (still().spec.stride / (t.times()[1] - t.times()[0])).round() as usize;
    assert_eq!(p.read_motion(0, 1, 4).unwrap(), t.read_motion(0, frames, 4).unwrap());
    assert_eq!(p.read_frame("D", 0).unwrap(), t.read_frame("D", 0).unwrap());
}

/// Outputs of more than single precision holds: what comes before the first step is written, and the others of a folder go on.
#[test]
fn a_rollout_that_blows_up_at_once_is_noted() {
    let (t, folder) = (Trajectory::open(FILE).unwrap(), tempfile::tempdir().unwrap());
    let out = folder.path().join("p.h5");
    let mut model = still();
    for name in ["norm.output.mean", "norm.output.std"] {
        model.tensors.get_mut(name).unwrap().data.fill(f32::MAX);
    }
    let options = SessionOptions::default();
    let found = crate::predict::run(&model, &t, &options, (None, &out), &mut || Ok(())).unwrap();
    assert!(found.steps == 0 && found.diverged.as_ref().unwrap().starts_with("step 1: "), "{found:?}");
    assert_eq!(Trajectory::open(out).unwrap().times(), [t.times()[0]]);
    assert!(!found.table().to_string().contains("model"));
}

#[test]
fn an_obstacle_that_sinks_in_is_told() {
    let t = Trajectory::open(FILE).unwrap();
    let mut calls = 0;
    let mut count = || {
        calls += 1;
        Ok(())
    };
    let options = SessionOptions::default();
    let case = run(&still(), &t, &options, (None, Keep::Shown), &mut count).unwrap();
    let rows = case.rows();
    let keys: Vec<&str> = rows.iter().map(|r| r.key).collect();
    assert_eq!(keys, ["model", "persistence", "extrapolation", "dmd", "hold_first"]);
    assert!(rows[0].gap.unwrap() < -0.1, "{:?}", rows[0].gap);
    // Standing still is holding the first frame, to what such a step adds.
    let [model, hold] = [0, 4].map(|i| figures(&case, i)[2]);
    assert!((model / hold - 1.0).abs() < 1e-3, "{model} {hold}");
    assert_eq!(calls, steps(case.pace));
    let figures = json(std::slice::from_ref(&case));
    let rows = figures.pointer("/cases/0/model/over_segments").and_then(Value::as_array).unwrap();
    assert_eq!(rows.len(), case.rollout().unwrap().states.len());
    let count = 1 + case.node_segment.iter().max().copied().unwrap() as usize;
    assert_eq!(rows[0]["rmse"].as_array().unwrap().len(), count);
    assert!(case.diverged().is_none());
}

#[test]
fn models_and_data_of_other_kinds_are_refused() {
    let t = Trajectory::open(FILE).unwrap();
    let message = |spec: m4gn_model::ModelSpec| {
        let model = Model::random(spec, 1).unwrap();
        fits(&model.spec, &t).unwrap_err().to_string()
    };
    assert!(message(m4gn_samples::model::spec()).contains("the data are a body at points"));
    let mut spec = m4gn_samples::model::bodies();
    spec.fields[0].dimensions[2] = -1;
    assert!(message(spec).contains("the model knows a vector with dimensions [0 1 -1"));
}

/// A run that was killed leaves some frames: the others are taken, and that is told.
#[test]
fn trajectories_shorter_than_a_step_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    m4gn_samples::training::write_data(folder.path(), 1).unwrap();
    for (name, frames) in [("001.h5", 1), ("002.h5", 2), ("003.h5", 3)] {
        m4gn_samples::training::write_trajectory(&at(name), 0, Split::Test, frames).unwrap();
    }
    // Two frames a step
    let spec = m4gn_model::ModelSpec { stride: 0.02, ..m4gn_samples::model::spec() };
    let mut notes = Vec::new();
    let mut found = |data: &Path, split: &str| trajectories(data, split, &spec, &mut |note| notes.push(note));
    assert_eq!(found(folder.path(), "valid").unwrap().len(), 1);
    assert_eq!(found(folder.path(), "test").unwrap()[0].1.steps, 1);
    fails(found(&at("002.h5"), "test"), &["002.h5: the model steps 0.02 s"]);
    std::fs::remove_file(at("003.h5")).unwrap();
    fails(found(folder.path(), "test"), &["no trajectory of split test but 2 shorter than a step"]);
    assert!(notes.len() == 1 && notes[0].contains("001.h5"), "{notes:?}");
}

/// A flow at cells in two directions, its fields by whatever names.
#[test]
fn a_flow_whose_field_has_another_name() {
    let folder = tempfile::tempdir().unwrap();
    m4gn_samples::training::write_data(folder.path(), 1).unwrap();
    let t = Trajectory::open(folder.path().join("000.h5")).unwrap();
    let mut spec = m4gn_samples::model::spec();
    spec.segments.method = m4gn_model::SegmentMethod::Metis;
    spec.fields.reverse();
    let model = Model::random(spec, 3).unwrap();
    let options = SessionOptions::default();
    let go = |model: &Model| run(model, &t, &options, (Some(0.1), Keep::Shown), &mut || Ok(()));
    let case = go(&model).unwrap();
    let names: Vec<&str> = case.fields.iter().map(|f| f.0.as_str()).collect();
    assert_eq!(names, ["U", "p"]);
    // Persistence by hand
    let frames = t.read_frames("U", 0, 1, 30).unwrap();
    let mut total = SquaredError::default();
    frames.windows(2).for_each(|w| total.add(SquaredError::between(&w[0].cells, &w[1].cells)));
    assert!((figures(&case, 1)[2] / total.rmse() - 1.0).abs() < 1e-12);
    assert!(case.rows().iter().all(|r| r.quality.is_none() && r.gap.is_none()));

    // What the model was trained on is compared with what it is shown.
    assert!(case.outside.is_empty());
    let mut slow = Model::random(model.spec.clone(), 3).unwrap();
    slow.spec.trained_on = Some(m4gn_model::TrainedOn {
        cell_size: [1e-9, 2e-9],
        speed: None,
        courant: None,
        inputs: Vec::new(),
        solid: None,
    });
    let outside = go(&slow).unwrap().outside;
    assert!(outside.len() == 1 && outside[0].contains("distance of neighbouring cells"), "{outside:?}");

    let mut scalar = model.spec.clone();
    scalar.fields.retain(|f| f.name == "p");
    let case = go(&Model::random(scalar, 3).unwrap()).unwrap();
    assert_eq!(case.fields[0], ("p".to_string(), "m^2/s^2".to_string()));
    assert!(figures(&case, 0).iter().all(|v| v.is_finite()));
}

#[test]
fn fields_that_are_read_and_not_predicted_are_those_of_the_record() {
    let folder = tempfile::tempdir().unwrap();
    m4gn_samples::training::write_data(folder.path(), 1).unwrap();
    let t = Trajectory::open(folder.path().join("000.h5")).unwrap();
    let mut spec = m4gn_samples::model::spec();
    let p = spec.fields.iter_mut().find(|f| f.name == "p").unwrap();
    p.output = m4gn_model::Output::None;
    let pace = Pace::new(t.times(), 0.01).unwrap();
    let frames = t.read_frames("p", 0, 1, pace.steps + 1).unwrap();
    let mut seen = Vec::new();
    let mut step = |fields: &[m4gn_step::Field], _: &mut [m4gn_step::FieldMut], _: StepContext| {
        let p = fields.iter().find(|f| f.name == "p").unwrap();
        seen.push((p.components, p.cells.to_vec(), p.boundary.to_vec()));
        Ok(())
    };
    let scene = Scene::read(&t, &spec.fields, pace).unwrap();
    scene.predict(Keep::Shown, &mut step, &mut || Ok(())).unwrap();
    // Single steps, then the rollout
    assert_eq!(seen.len(), 2 * pace.steps);
    for ((components, cells, boundary), frame) in seen.iter().zip(frames[..pace.steps].iter().cycle()) {
        let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&v| f64::from(v)).collect() };
        assert_eq!(*components, 1);
        assert!(*cells == wide(&frame.cells) && *boundary == wide(&frame.boundary));
    }
    // And a session takes them.
    spec.segments.method = m4gn_model::SegmentMethod::Metis;
    let model = Model::random(spec, 3).unwrap();
    let options = SessionOptions::default();
    let case = run(&model, &t, &options, (None, Keep::Shown), &mut || Ok(())).unwrap();
    assert_eq!(case.fields.len(), 1);
    assert!(figures(&case, 0)[0].is_finite());
}

/// Beside 1 half of 2e-6 is little, and on the scale that networks see it is not: the walls' values stay prescribed, as in a training.
#[test]
fn small_boundary_values_of_positive_fields_stay_prescribed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let (mesh, dimensions) = (m4gn_samples::mesh::rectangle(3, 1, 3.0, 1.0), [0, 2, -2, 0, 0, 0, 0]);
    let options = WriteOptions {
        fields: vec![FieldMeta { name: "k".into(), vector: false, dimensions }],
        provenance: serde_json::json!({}),
        split: Split::Test,
        overwrite: false,
    };
    let boundary = mesh.boundary.iter().map(|face| if face.owner == 0 { 1.0 } else { 1e-6 }).collect();
    let frame = [Frame { cells: vec![1.0, 2e-6, 2e-6], boundary }];
    let mut writer = Writer::create(&path, &mesh, &options).unwrap();
    [0.0, 0.1].iter().for_each(|time| writer.append(*time, &frame).unwrap());
    writer.finish().unwrap();
    let t = Trajectory::open(&path).unwrap();
    let k = FieldSpec {
        name: "k".into(),
        vector: false,
        dimensions,
        input: true,
        output: m4gn_model::Output::Delta,
        floor: Some(1e-9),
    };
    let scene = Scene::read(&t, &[k], Pace::new(t.times(), 0.1).unwrap()).unwrap();
    let mut step = |_: &[Field], _: &mut [FieldMut], _: StepContext| Ok(());
    let mut found = Vec::new();
    let mut visit = |_: usize, state: &[(Vec<f64>, Vec<f64>)]| {
        found = state[0].1.clone();
        Ok(())
    };
    scene.roll((0, 1), &mut step, &mut (0.0, 0), &mut visit).unwrap();
    assert_eq!(found, scene.state(1)[0].1);
}

#[test]
fn a_series_of_a_rollout() {
    let case = known(0.01, |u, t| {
        shift(u, t, 1e-4);
        Ok(())
    });
    let summary = headline(std::slice::from_ref(&case)).unwrap();
    let text = format!("{}{}", summary.tables()[0], summary.line());
    for words in ["worst gap", "hold first", "solver took 500 ms"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("series");
    std::fs::create_dir(&folder).unwrap();
    write_series(&folder, &case).unwrap();
    // Four states of three things, and their lists
    assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 15);
    let list = std::fs::read_to_string(folder.join("prediction.pvd")).unwrap();
    assert!(list.contains("timestep=\"0.03\" file=\"prediction_0003.vtu\""), "{list}");
    let last = std::fs::read_to_string(folder.join("prediction_0003.vtu")).unwrap();
    assert!(last.contains("Name=\"error\"") && last.contains("NumberOfPoints=\"12\""));
}
