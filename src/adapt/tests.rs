//! Adaptations of a random model to a vortex that is carried along, in serial.

use super::*;
use m4gn_model::SegmentMethod;
use m4gn_samples::mesh::{self as sample, vortex};
use m4gn_step::SessionOptions;

/// Two solver steps a stride.
const STEP: f64 = 0.005;

fn model(seed: u64) -> Model {
    let mut spec = m4gn_samples::model::spec();
    spec.segments.method = SegmentMethod::Metis;
    Model::random(spec, seed).unwrap()
}

fn adaptation(settings: &str) -> (Session, Adaptation) {
    adaptation_of(&model(11), settings)
}

fn adaptation_of(model: &Model, settings: &str) -> (Session, Adaptation) {
    let mesh = sample::triangles(6, 4, 1.5, 1.0);
    let session = Session::new(Comm::serial(), &mesh, model, &SessionOptions::default()).unwrap();
    let settings = Settings::parse(settings).unwrap();
    let adaptation = Adaptation::new(&session, &mesh, model, settings).unwrap();
    (session, adaptation)
}

fn show(a: &mut Adaptation, steps: std::ops::Range<usize>) {
    show_at(a, steps, STEP, 1.0);
}

/// A vortex that is carried along so many times as fast.
fn show_at(a: &mut Adaptation, steps: std::ops::Range<usize>, step: f64, speed: f64) {
    let first = steps.start;
    for i in steps {
        let time = step * i as f64;
        let [u, p] = vortex(&a.mesh, speed * time);
        let field = |name, components, values: &'_ (Vec<f64>, Vec<f64>)| (name, components, values.clone());
        let fields = [field("U", 3, &u), field("p", 1, &p)];
        let fields: Vec<Field> = fields
            .iter()
            .map(|(name, components, (cells, boundary))| Field {
                name,
                components: *components,
                cells,
                boundary,
            })
            .collect();
        a.frame(time, i == first, &fields).unwrap();
    }
}

#[test]
fn a_case_is_learned_and_the_session_takes_it_over() {
    let (mut session, mut a) = adaptation(r#"{"learningRate": 3e-3, "steps": 200, "threads": 2}"#);
    show(&mut a, 0..60);
    let outcome = a.run(10).unwrap();
    println!("{}", outcome.note);
    assert!(outcome.used && outcome.after < 0.5 * outcome.before, "{}", outcome.note);
    assert_eq!(outcome.strides, 1, "two thirds of the two strides held back");
    // The session's step is now that of the adapted model.
    let model = a.model();
    let error = |session: &mut Session| {
        let [u, p] = vortex(&a.mesh, 0.0);
        let expected = vortex(&a.mesh, 2.0 * STEP);
        let fields = [
            Field { name: "U", components: 3, cells: &u.0, boundary: &u.1 },
            Field { name: "p", components: 1, cells: &p.0, boundary: &p.1 },
        ];
        session.advance(&fields, Ok(())).unwrap();
        let mut found = u.0.clone();
        session.write(&mut m4gn_step::FieldMut { name: "U", components: 3, cells: &mut found });
        let square = found.iter().zip(&expected[0].0).map(|(a, b)| (a - b).powi(2));
        square.sum::<f64>().sqrt()
    };
    let before = error(&mut session);
    session.set_weights(&a.mesh, &model).unwrap();
    let after = error(&mut session);
    assert!(after < 0.5 * before, "{before} to {after}");
    // The one round was made, and the frames are gone.
    assert!(a.is_done() && a.frames() == 0);
    assert_eq!(a.run(10).unwrap(), Outcome::default());
}

#[test]
fn weights_that_are_no_better_are_not_used() {
    let (_, mut a) = adaptation(r#"{"learningRate": 30, "steps": 12}"#);
    let shipped = a.learner.shipped.clone();
    show(&mut a, 0..40);
    let outcome = a.run(4).unwrap();
    assert!(!outcome.used && outcome.after == outcome.before, "{}", outcome.note);
    assert!(outcome.note.contains("stay as they were"), "{}", outcome.note);
    assert_eq!(a.learner.knowledge.optimiser.weights, shipped);
}

#[test]
fn too_few_frames_and_a_spent_budget_are_said() {
    let (_, mut a) = adaptation("{}");
    assert!(a.run(4).unwrap().note.contains("fewer than two"));
    let (_, mut a) = adaptation("{}");
    show(&mut a, 0..4);
    let note = a.run(4).unwrap().note;
    assert!(note.contains("4 frames") && note.contains("start earlier"), "{note}");
    let (_, mut a) = adaptation(r#"{"budget": 0}"#);
    show(&mut a, 0..40);
    let outcome = a.run(4).unwrap();
    assert!(outcome.note.contains("budget") && outcome.steps == 0, "{}", outcome.note);
}

#[test]
fn later_stretches_are_judged_by_the_newest_one() {
    let (_, mut a) = adaptation(r#"{"mode": "during", "learningRate": 3e-3, "steps": 30, "stepsEach": 60}"#);
    show(&mut a, 0..40);
    a.run(4).unwrap();
    let mut used = 0;
    for first in [60, 80, 100] {
        show(&mut a, first..first + 7);
        let outcome = a.run(4).unwrap();
        assert_eq!((outcome.steps, outcome.strides), (60, 2), "{}", outcome.note);
        assert!(outcome.after <= outcome.before);
        used += u32::from(outcome.used);
    }
    assert!(used > 0);
    assert_eq!(a.frames(), 40 + 3 * 7);
}

#[test]
fn carried_on_from_a_file_it_is_the_uninterrupted_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("state");
    let path = path.as_path();
    let settings = r#"{"mode": "during", "steps": 12, "stepsEach": 5, "maxFrames": 30}"#;
    let (_, mut whole) = adaptation(settings);
    let mut parts = adaptation(settings).1;
    for (number, range) in [0..40, 60..70, 80..90].into_iter().enumerate() {
        show(&mut whole, range.clone());
        show(&mut parts, range);
        // Before the round, and after it.
        for _ in 0..2 {
            parts.save(path).unwrap();
            parts = adaptation(settings).1;
            parts.load(path).unwrap();
            if parts.learner.knowledge.steps == whole.learner.knowledge.steps {
                let (a, b) = (whole.run(4).unwrap(), parts.run(4).unwrap());
                assert_eq!((a.before, a.after), (b.before, b.after), "round {number}");
            }
        }
        assert_eq!(whole.learner.knowledge.optimiser, parts.learner.knowledge.optimiser);
        assert_eq!(
            (&whole.learner.window, &whole.learner.sample.frames),
            (&parts.learner.window, &parts.learner.sample.frames)
        );
    }
    // What is damaged or of another model changes nothing.
    let good = std::fs::read(path).unwrap();
    let before = parts.learner.knowledge.optimiser.clone();
    for cut in [0, 7, good.len() / 2, good.len() - 1] {
        std::fs::write(path, &good[..cut]).unwrap();
        let error = parts.load(path).unwrap_err().to_string();
        assert!(error.contains("delete it"), "{error}");
    }
    assert_eq!(parts.learner.knowledge.optimiser, before);
    std::fs::write(path, &good).unwrap();
    parts.learner.shipped[0] += 1.0;
    assert!(parts.load(path).unwrap_err().to_string().contains("another model"));
}

#[test]
fn frames_that_do_not_fit_change_nothing() {
    let (_, mut a) = adaptation("{}");
    show(&mut a, 0..3);
    let [u, p] = vortex(&a.mesh, 0.0);
    let field = |cells| Field { name: "U", components: 3, cells, boundary: &u.1 };
    let p = Field { name: "p", components: 1, cells: &p.0, boundary: &p.1 };
    let mut infinite = u.0.clone();
    infinite[4] = f64::INFINITY;
    let time = 3.0 * STEP;
    for (fields, said) in [
        (vec![p], "'U' is missing"),
        (vec![field(&u.0[3..]), p], "expected 3 components"),
        (vec![field(&infinite), p], "not finite"),
    ] {
        let error = a.frame(time, false, &fields).unwrap_err().to_string();
        assert!(error.contains(said), "{error}");
    }
    assert!(a.frame(STEP, false, &[field(&u.0), p]).is_err(), "a time that was there before");
    assert_eq!(a.frames(), 3);
    a.frame(time, false, &[field(&u.0), p]).unwrap();
    assert_eq!(a.frames(), 4);
}
