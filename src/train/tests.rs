//! Trainings on the native engine, from data on disk to model files: they learn, stop and go on exactly, and refuse what
//! does not fit.

use super::checkpoint::Checkpoint;
use super::*;
use m4gn_base::Error;
use m4gn_learn::Workload;
use m4gn_learn::normaliser::Normaliser;
use m4gn_model::Model;
use m4gn_samples::fails;
use sample::{folder, interrupt, losses, request};
use std::path::Path;
use std::sync::atomic::AtomicU8;

pub(super) fn run(request: &Request) -> Result<serde_json::Value> {
    train_native(request, &AtomicU8::new(0), &Comm::serial())
}

pub(super) fn edit(path: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from}");
    std::fs::write(path, text.replace(from, to)).unwrap();
}

/// Everything that the next step depends on.
pub(super) fn state(request: &Request) -> (u64, Vec<Vec<f32>>, Normaliser) {
    let c = Checkpoint::read(&request.checkpoint()).unwrap();
    let weights = vec![c.weights, c.first, c.second, c.average.unwrap(), c.best.unwrap()];
    (c.progress.step, weights, c.normaliser)
}

#[test]
fn interrupted_anywhere_and_resumed_it_is_the_uninterrupted_one_bit_for_bit() {
    let folder = folder();
    // Whose matrices are shared out to the threads.
    let training = "optimiser = \"muon\"\ncheckpoint_interval = 5";
    let whole = request(folder.path(), "whole", training, 14);
    run(&whole).unwrap();
    for round in 0..20u64 {
        let mut parts = request(folder.path(), &format!("parts{round}"), training, 14);
        parts.resume = true;
        // Stopped after some rows of the log were written, three times, on one and two threads in turn.
        for part in 0..3u64 {
            parts.threads = Some(1 + (part as usize + round as usize) % 2);
            let lines = |text: &str| text.lines().count() as u64;
            let before = std::fs::read_to_string(parts.log()).map_or(0, |text| lines(&text));
            let rows = before.max(1) + (7 * round + 3 * part) % 3;
            interrupt(&parts, |text| lines(text) > rows, |stop| train_native(&parts, stop, &Comm::serial()));
        }
        run(&parts).unwrap();
        assert!(state(&whole) == state(&parts), "round {round}: the weights differ");
        assert_eq!(losses(&whole).last(), losses(&parts).last(), "round {round}");
    }
}

#[test]
fn a_training_by_time_ends_with_it_at_the_end_of_its_schedule() {
    let folder = folder();
    let request = request(folder.path(), "time", "schedule = \"time\"\nmax_minutes = 0.02", 2);
    edit(&request.config, "decay_steps = 1000", "decay_steps = 2\nlearning_rate_end = 1e-4");
    let figures = run(&request).unwrap();
    let figure = |name: &str| figures[name].as_f64().unwrap();
    assert!(figure("seconds") >= 1.2, "{figures}");
    let log = std::fs::read_to_string(request.log()).unwrap();
    assert_eq!(log.lines().last().unwrap().split(',').nth(3), Some("1.000000e-4"));
}

#[test]
fn training_lowers_the_loss_and_leaves_a_model() {
    let folder = folder();
    for (precision, optimiser, most) in [("fp32", "adam", 0.3), ("bf16", "adam", 0.35), ("fp32", "muon", 0.3)]
    {
        let training =
            format!("precision = \"{precision}\"\noptimiser = \"{optimiser}\"\nvalidation_interval = 100");
        let name = format!("{precision}-{optimiser}");
        let request = request(folder.path(), &name, &training, 150);
        let figures = run(&request).unwrap();
        let loss = losses(&request);
        // The first row is the normalisers' warm-up.
        assert!(loss.last().unwrap() < &(most * loss[1]), "{loss:?}");
        let rmse = |who: &str| figures[who]["rmse_1"].as_f64().unwrap();
        assert!(rmse("model") < 0.75 * rmse("persistence"), "no better than persistence: {figures}");
        let model = Model::read(&request.out).unwrap();
        assert_eq!(model.spec.stride, 0.02);
        assert_eq!(model.spec.fields[0].dimensions, [0, 1, -1, 0, 0, 0, 0]);
        let text = std::fs::read_to_string(request.json.as_ref().unwrap()).unwrap();
        assert_eq!(text, format!("{}\n", serde_json::to_string_pretty(&figures).unwrap()));
    }
}

#[test]
fn a_model_is_trained_further() {
    let folder = folder();
    let first = request(folder.path(), "first", "validation_interval = 100", 100);
    run(&first).unwrap();
    let mut second = request(folder.path(), "second", "", 4);
    second.from = Some(first.out.clone());
    run(&second).unwrap();
    let (old, new) = (Model::read(&first.out).unwrap(), Model::read(&second.out).unwrap());
    for (name, tensor) in &old.tensors {
        let pairs = tensor.data.iter().zip(&new.tensors[name].data);
        let apart = pairs.fold(0f32, |m, (a, b)| m.max((a - b).abs()));
        // Four steps of at most 2e-3 from there; the normalisers stay.
        let most = if name.starts_with("norm.") { 1e-6 } else { 4.0 * 2.1e-3 };
        assert!(apart <= most, "{name}: {apart}");
    }
    assert!(new.spec.training["from"].as_str().unwrap().contains("first"));
    assert!(losses(&second)[0] < 0.5 * losses(&first)[1], "{:?}", losses(&second));
    second.resume = true;
    second.steps = Some(6);
    second.from = None;
    run(&second).unwrap();
    let mut other = request(folder.path(), "other", "", 4);
    other.from = Some(first.out.clone());
    // How the mesh is cut is no matter of the weights.
    edit(&other.config, "count = 4", "count = 6");
    run(&other).unwrap();
    let cut = Model::read(&other.out).unwrap().spec.segments;
    assert_eq!(cut.count, 6);
    let mut other = request(folder.path(), "narrow", "", 4);
    other.from = Some(first.out.clone());
    edit(&other.config, "width = 16", "width = 8");
    fails(run(&other), &["[model] and [macro]"]);
}

#[test]
fn a_model_is_given_an_input_more() {
    let folder = folder();
    // All of them with a positional encoding of the nodes, which adds to what is said of their inputs.
    let request = |name: &str, steps: u64| {
        let made = request(folder.path(), name, "", steps);
        edit(&made.config, "layers_before = 1", "layers_before = 1\nnode_rwse_steps = 3");
        made
    };
    let first = request("first", 20);
    let p = "{ name = \"p\", input = true, output = \"value\" }";
    edit(&first.config, &format!(", {p}"), "");
    edit(&first.config, ", p = 0.01", "");
    run(&first).unwrap();
    let mut second = request("second", 0);
    edit(&second.config, p, "{ name = \"p\", input = true, output = \"none\" }");
    second.from = Some(first.out.clone());
    run(&second).unwrap();
    let (old, new) = (Model::read(&first.out).unwrap(), Model::read(&second.out).unwrap());
    let encoder = |model: &Model| model.tensor("encoder.node.0.weight").unwrap().clone();
    let (narrow, wide) = (encoder(&old), encoder(&new));
    assert_eq!((narrow.shape[1] + 1, new.spec.fields.len()), (wide.shape[1], 2));
    let rows = narrow.data.chunks(narrow.shape[1]).zip(wide.data.chunks(wide.shape[1]));
    for (a, b) in rows {
        assert!(a[..2] == b[..2] && b[2] == 0.0 && a[2..] == b[3..], "{a:?} {b:?}");
    }
    let position = |model: &Model| model.tensor("encoder.position.1.bias").unwrap().data.clone();
    let (a, b) = (position(&old), position(&new));
    assert!(a[..2] == b[..2] && b[2] == 0.0 && a[2..] == b[3..], "{a:?} {b:?}");
    let mean = |model: &Model| model.tensor("norm.node.mean").unwrap().data.clone();
    assert_eq!(mean(&old), mean(&new)[..2]);
    let pressure = mean(&new)[2];
    assert!((-0.5..0.0).contains(&pressure), "{pressure}");
    // From there it is trained, stopped and carried on as any other.
    second.steps = Some(4);
    second.out = folder.path().join("third.safetensors");
    run(&second).unwrap();
    second.resume = true;
    second.steps = Some(6);
    run(&second).unwrap();
    // A field that is predicted is another network.
    let mut other = request("other", 4);
    other.from = Some(first.out.clone());
    fails(run(&other), &["only inputs"]);
}

#[test]
fn trajectories_that_are_too_short_are_left_out() {
    let folder = folder();
    let count = |name: &str| {
        let r = request(folder.path(), name, "", 4);
        run(&r).unwrap();
        Model::read(&r.out).unwrap().spec.training["trajectories"].clone()
    };
    let before = count("before");
    // Two strides of two frames each, and the state before them.
    for (frames, more) in [(4, 0), (5, 1)] {
        let path = folder.path().join("data/short.h5");
        sample::write_trajectory(&path, 7, m4gn_data::Split::Train, frames).unwrap();
        let expected = before.as_u64().unwrap() + more;
        assert_eq!(count(&format!("with{frames}")), expected, "{frames} frames");
        std::fs::remove_file(path).unwrap();
    }
    // A run that was killed at once, in front of the others
    let single = folder.path().join("data/0-killed.h5");
    sample::write_trajectory(&single, 7, m4gn_data::Split::Train, 1).unwrap();
    assert_eq!(count("single"), before);
    std::fs::remove_file(single).unwrap();
    // One that was ended between the times of its frames
    let odd = folder.path().join("data/0-odd.h5");
    let whole = m4gn_data::Trajectory::open(folder.path().join("data/000.h5")).unwrap();
    let options = m4gn_data::WriteOptions {
        fields: whole.fields().to_vec(),
        provenance: whole.provenance().clone(),
        split: whole.split(),
        overwrite: false,
    };
    let mut writer = m4gn_data::Writer::create(&odd, whole.mesh(), &options).unwrap();
    for (i, time) in [0.0, 0.01, 0.013].into_iter().enumerate() {
        let frames: Vec<_> = whole.fields().iter().map(|f| whole.read_frame(&f.name, i).unwrap()).collect();
        writer.append(time, &frames).unwrap();
    }
    writer.finish().unwrap();
    assert_eq!(count("odd"), before);
    std::fs::remove_file(odd).unwrap();
    let r = request(folder.path(), "none", "", 4);
    edit(&r.config, "[6, 2]", "[6, 40]");
    fails(run(&r), &["no trajectory to learn from but 3 with fewer frames than the 81"]);
}

#[test]
fn a_wider_network_begins_with_what_a_narrower_one_knows() {
    let folder = folder();
    let first = request(folder.path(), "first", "", 20);
    run(&first).unwrap();
    // What a training of one update says that changes next to nothing.
    let figures = |name: &str, factor: usize| {
        let mut r = request(folder.path(), name, "", 1);
        r.from = Some(first.out.clone());
        edit(&r.config, "learning_rate = 2e-3", "learning_rate = 1e-12");
        // That of the segment transformer with it.
        edit(&r.config, "width = 16", &format!("width = {}", 16 * factor));
        let figures = run(&r).unwrap();
        let rmse = |at: &str| figures["model"][at].as_f64().unwrap();
        (r, [rmse("rmse_1"), rmse("rmse_all")])
    };
    let (_, same) = figures("same", 1);
    for factor in [2, 3] {
        let (mut r, wide) = figures(&format!("wide{factor}"), factor);
        let apart = same.iter().zip(wide).map(|(a, b)| (a - b).abs() / a);
        assert!(apart.clone().all(|d| d < 1e-4), "{same:?} {wide:?}");
        // The copies are not alike, so that they can learn different things.
        let model = Model::read(&r.out).unwrap();
        let weight = model.tensor("processor.0.node.1.weight").unwrap();
        assert_eq!(weight.shape, [16 * factor; 2]);
        assert!((weight.data[0] - weight.data[1]).abs() > 1e-3 * weight.data[0].abs());
        r.resume = true;
        r.steps = Some(3);
        run(&r).unwrap();
    }
    let mut other = request(folder.path(), "other", "", 4);
    other.from = Some(first.out.clone());
    edit(&other.config, "ffn_width = 16", "ffn_width = 32");
    fails(run(&other), &["ffn_width may both be larger"]);
}

#[test]
fn a_training_that_diverges_keeps_what_was_good() {
    let folder = folder();
    for interval in [1, 2] {
        let name = format!("wild{interval}");
        let training = format!("checkpoint_interval = {interval}\nvalidation_interval = 4");
        let mut r = request(folder.path(), &name, &training, 8);
        run(&r).unwrap();
        let good = std::fs::read(&r.out).unwrap();
        r.resume = true;
        r.steps = Some(400);
        let wild = "learning_rate = 1e37\nlearning_rate_end = 1e37";
        edit(&r.config, "learning_rate = 2e-3", wild);
        let error = run(&r).unwrap_err();
        assert!(matches!(error, Error::Numerical(_)), "{error}");
        assert!(error.to_string().contains("Lower learning_rate"), "{error}");
        assert!(good == std::fs::read(&r.out).unwrap(), "the best model was overwritten");
        // The first wild update is in no checkpoint, though its weights are finite.
        let left = Checkpoint::read(&r.checkpoint()).unwrap();
        assert!(left.weights.iter().all(|w| w.abs() < 1e3) && left.best.is_some());
        edit(&r.config, wild, "learning_rate = 1e-3");
        r.steps = Some(left.progress.step + 2);
        run(&r).unwrap();
    }
    // From the start: no model, no checkpoint, and a status that says so.
    let r = request(folder.path(), "new", "learning_rate_end = 1e37", 4);
    edit(&r.config, "learning_rate = 2e-3", "learning_rate = 1e37");
    assert!(matches!(run(&r).unwrap_err(), Error::Numerical(_)));
    assert!(!r.out.exists() && !r.checkpoint().exists());
}

#[test]
fn damaged_checkpoints_are_refused() {
    let folder = folder();
    let mut r = request(folder.path(), "model", "", 4);
    run(&r).unwrap();
    r.resume = true;
    r.steps = Some(6);
    let good = Checkpoint::read(&r.checkpoint()).unwrap();
    type Change = fn(&mut Checkpoint);
    let changes: [(&str, Change); 7] = [
        ("`first`", |c| c.first.truncate(10)),
        ("`second`", |c| c.second.push(0.0)),
        ("`weights`: number 3 is inf", |c| c.weights[3] = f32::INFINITY),
        ("`average`: number 0 is NaN", |c| c.average.as_mut().unwrap()[0] = f32::NAN),
        ("`best`", |c| c.best.as_mut().unwrap().clear()),
        ("norm.edge", |c| c.normaliser.edge.sum[1] = f64::NAN),
        ("norm.node", |c| c.best_normaliser.as_mut().unwrap().node.square.clear()),
    ];
    for (what, change) in changes {
        let mut bad = good.clone();
        change(&mut bad);
        bad.write(&r.checkpoint()).unwrap();
        fails(run(&r), &[what, "model.checkpoint"]);
    }
    good.write(&r.checkpoint()).unwrap();
    run(&r).unwrap();
}

/// One that was killed behind a validation and before its checkpoint, and is carried on in another way, has left a model that nothing tells of.
#[test]
fn the_model_that_is_left_is_the_one_that_is_told() {
    let folder = folder();
    let mut r = request(folder.path(), "a", "", 4);
    run(&r).unwrap();
    let best = Model::read(&r.out).unwrap();
    let mut other = best.clone();
    other.tensors.values_mut().flat_map(|t| &mut t.data).for_each(|x| *x *= 0.5);
    other.spec.training["best"]["step"] = 3.into();
    other.write(&r.out).unwrap();
    r.resume = true;
    run(&r).unwrap();
    assert_eq!(Model::read(&r.out).unwrap().tensors, best.tensors);
}

/// Files of the same names and lengths with other flows in them, and one trajectory to validate on more.
#[test]
fn a_training_is_carried_on_with_its_own_data_alone() {
    let folder = folder();
    let at = |name: &str| folder.path().join("data").join(name);
    sample::write_trajectory(&at("003.h5"), 3, m4gn_data::Split::Valid, 30).unwrap();
    let mut r = request(folder.path(), "a", "validation_rollouts = 1", 2);
    run(&r).unwrap();
    (r.resume, r.steps) = (true, Some(4));
    edit(&r.config, "validation_rollouts = 1", "validation_rollouts = 2");
    fails(run(&r), &["made with another training.validation_rollouts"]);
    edit(&r.config, "validation_rollouts = 2", "validation_rollouts = 1");
    edit(&r.config, "mirror = true", "mirror = true\noptimiser = \"muon\"");
    fails(run(&r), &["made with another training.optimiser"]);
    edit(&r.config, "optimiser = \"muon\"", "optimiser = \"adam\"");
    let own = std::fs::read(at("000.h5")).unwrap();
    std::fs::remove_file(at("000.h5")).unwrap();
    sample::write_trajectory(&at("000.h5"), 5, m4gn_data::Split::Train, 30).unwrap();
    fails(run(&r), &["a.checkpoint: made with another data set"]);
    std::fs::write(at("000.h5"), own).unwrap();
    run(&r).unwrap();
}

#[test]
fn what_does_not_fit_is_refused_before_anything_is_written() {
    let folder = folder();
    let mut first = request(folder.path(), "first", "", 2);
    run(&first).unwrap();
    fails(run(&first), &["--resume"]);
    first.resume = true;
    first.steps = Some(3);
    edit(&first.config, "width = 16", "width = 8");
    fails(run(&first), &["[model]"]);

    let message = |change: &dyn Fn(&mut Request)| {
        let mut request = request(folder.path(), "bad", "", 2);
        change(&mut request);
        let message = run(&request).unwrap_err().to_string();
        assert!(!request.out.exists() && !request.checkpoint().exists());
        message
    };
    let edited = |from: &'static str, to: &'static str| message(&move |r| edit(&r.config, from, to));
    assert!(edited("stride = 0.02", "stride = 0.015").contains("model.stride"));
    assert!(edited("stride = 0.02", "stride = 0.2").contains("than the 41"));
    let temperature = "fields = [{ name = \"T\", input = true, output = \"none\" }, ";
    assert!(edited("fields = [", temperature).contains("recorded are U, p"));
    assert!(edited("count = 4", "count = 400").contains("400 segments"));
    // Limits of a model, at once.
    assert!(
        edited("layers_before = 1", "layers_before = 1025").contains("layers_before: expected 0 to 1024")
    );
    assert!(edited("width = 16", "width = 32768").contains("width: expected 1 to 16384"));
    let huge = message(&|r| {
        edit(&r.config, "width = 16", "width = 16384");
        edit(&r.config, "layers_before = 1", "layers_before = 1000");
    });
    assert!(huge.contains("million weights"), "{huge}");
    assert!(edited("batch_size = 3", "batch_size = 99999999999").contains("training.batch_size"));
    assert!(edited("[6, 2]", "[6, 99999999999]").contains("training.unroll"));
    assert!(message(&|r| r.data = "nowhere".into()).contains("nowhere"));
    // Files that cannot be written, before the data are read.
    let early = |change: &dyn Fn(&mut Request)| {
        message(&|r| {
            r.data = "nowhere".into();
            change(r);
        })
    };
    assert!(early(&|r| r.json = Some("none/a.json".into())).contains("none/a.json: cannot be written"));
    let cut = folder.path().join("data/000.h5");
    let bytes = std::fs::read(&cut).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    assert!(message(&|_| ()).contains("000.h5"));
}

const BODY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/solid.h5");

/// Of a body, points stand before the obstacle's, which are the boundary.
#[test]
fn a_body_is_read_as_a_flow_is() {
    let trajectory = m4gn_data::Trajectory::open(BODY).unwrap();
    let mut spec = m4gn_samples::model::bodies();
    spec.segments.count = 2;
    spec.segments.modes = 1;
    let sample = recorded::read(&trajectory, &spec).unwrap();
    assert_eq!((sample.n_cells(), sample.structure.graph.n_owned), (12, 12 + 26));
    assert_eq!((sample.n_frames, sample.width), (4, 3));
    let displacement = trajectory.read_frame("D", 3).unwrap().cells;
    let motion = trajectory.read_motion(3, 1, 1).unwrap().concat();
    assert_eq!(sample.frame(3).unwrap(), [&displacement[..], motion.as_flattened()].concat());
    assert_eq!((0..12).filter(|&p| sample.domain.is_held(p, 0)).count(), 4, "points of the handle");
    assert!(sample.domain.moves() && !sample.domain.boundary().follows().contains(&true));
    let streamed = recorded::read_within(&trajectory, &spec, 4 * 38 * 3 * 4 - 1).unwrap();
    assert!(streamed.is_streamed() && streamed.frames.is_empty() && !sample.is_streamed());
    for frame in 0..4 {
        assert_eq!(streamed.frame(frame).unwrap(), sample.frame(frame).unwrap());
    }
    assert_eq!(streamed.domain.boundary().follows(), sample.domain.boundary().follows());
}

#[test]
fn bodies_among_flows_are_refused() {
    let folder = folder();
    std::fs::copy(BODY, folder.path().join("data/body.h5")).unwrap();
    let message = run(&request(folder.path(), "mixed", "", 2)).unwrap_err().to_string();
    assert!(message.contains("body.h5") && message.contains("a table [contact] with a radius"), "{message}");
}

#[test]
fn contact_on_flows_is_refused_with_what_to_leave_out() {
    let folder = folder();
    let request = request(folder.path(), "contact", "", 2);
    edit(&request.config, "[training]", "[contact]\nradius = 0.01\n[training]");
    fails(run(&request), &["[contact]", "delete the table"]);
}

/// Twice the fields, four times the squared changes: 0.4 and 1.6 of the mean.
#[test]
fn trajectories_of_small_changes_weigh_up_to_those_of_large_ones() {
    let folder = folder();
    let spec = m4gn_samples::model::spec();
    let path = folder.path().join("data/000.h5");
    let read = || recorded::read(&m4gn_data::Trajectory::open(&path).unwrap(), &spec).unwrap();
    let mut fast = read();
    fast.frames.iter_mut().for_each(|x| *x *= 2.0);
    let work = Workload {
        train: vec![read().into(), fast.into()],
        valid: vec![read().into()],
        frames_a_step: 2,
        names: vec![],
    };
    assert_eq!(work.weights(&spec, 0.0).unwrap(), [1.0, 1.0]);
    for balance in [0.5, 1.0] {
        let [slow, fast] = [0.45_f64, 1.65].map(|c| c.powf(-balance));
        let expected = [slow, fast].map(|w| 2.0 * w / (slow + fast));
        for (found, expected) in work.weights(&spec, balance).unwrap().iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found}, expected {expected}");
        }
    }
}
