//! A model of bodies at points that learns on several ranks, against the same on one.

use super::distance;
use m4gn_adapt::{Adaptation, Outcome, Settings};
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_model::Model;
use m4gn_samples::bodies as sample;
use m4gn_step::{Field, Session, SessionOptions};

/// Half the model's stride, s.
const STEP: f64 = 0.005;

/// A bar that bends down to the time in the square of the distance from its handle.
fn bent(mesh: &Mesh, time: f64) -> Vec<[f64; 3]> {
    let down = |x: &[f64; 3]| [0.0, 0.0, -0.03 * (20.0 * time).sin() * (x[0] / 3.0).powi(2)];
    mesh.cell_centres.iter().map(down).collect()
}

/// The obstacle at a time, always over the bar.
fn pressed(time: f64) -> Vec<[f64; 3]> {
    vec![[0.0, 0.0, -0.03 * (20.0 * time).sin()]; 6]
}

fn show(a: &mut Adaptation, mesh: &Mesh, steps: std::ops::Range<usize>) -> Result<()> {
    let first = steps.start;
    for i in steps {
        let time = STEP * i as f64;
        let (body, obstacle) = (bent(mesh, time), pressed(time));
        let field =
            Field { name: "D", components: 3, cells: body.as_flattened(), boundary: obstacle.as_flattened() };
        a.frame(time, i == first, &[field])?;
    }
    Ok(())
}

/// How far a step of the session is from the bar's own, of how far that goes. Collective.
fn error(comm: &Comm, session: &mut Session, mesh: &Mesh) -> Result<f64> {
    let (time, stride) = (0.04, 2.0 * STEP);
    let now = bent(mesh, time);
    let mut found = now.clone();
    session.step_body(&mut found, [&pressed(time), &pressed(time + stride)])?;
    let next = bent(mesh, time + stride);
    let square = |a: &[[f64; 3]], b: &[[f64; 3]]| -> f64 {
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        pairs.map(|(a, b)| (a - b).powi(2)).sum()
    };
    let mut sums = [square(&found, &next), square(&now, &next)];
    comm.sum_f64(&mut sums);
    Ok((sums[0] / sums[1]).sqrt())
}

/// What came of a start-up and a stretch: the model, the rounds, and the error of a step before and after.
type Learned = (Model, Vec<Outcome>, [f64; 2]);

fn adapt(comm: &Comm, mesh: &Mesh, model: &Model) -> Result<Learned> {
    let mut session = Session::new(comm.clone(), mesh, model, &SessionOptions::default())?;
    let settings = r#"{"mode": "during", "precision": "fp32", "learningRate": 3e-3, "steps": 60, "stepsEach": 6, "batch": 3}"#;
    let mut a = Adaptation::new(&session, mesh, model, Settings::parse(settings)?)?;
    let before = error(comm, &mut session, mesh)?;
    let mut outcomes = Vec::new();
    for steps in [0..50, 60..70] {
        show(&mut a, mesh, steps)?;
        outcomes.push(a.run(1)?);
        session.set_weights(mesh, &a.model())?;
    }
    let after = error(comm, &mut session, mesh)?;
    Ok((a.model(), outcomes, [before, after]))
}

pub fn run(comm: &Comm, failures: &mut Vec<String>) -> Result<()> {
    let mut spec = m4gn_samples::model::bodies();
    spec.segments.count = 3;
    spec.segments.modes = 1;
    let model = Model::random(spec, 5)?;
    let body = sample::block([6, 2, 2], [3.0, 1.0, 1.0]);
    let obstacle = sample::octahedron([2.6, 0.5, 1.6], 0.5);
    // Planes of points in turns, so that a rank's points are no single stretch of the numbering.
    let size = comm.size() as usize;
    let ranks: Vec<i32> = (0..body.positions.len()).map(|p| (p % 7 % size) as i32).collect();
    let whole = body.mesh(Some(&obstacle));
    let (alone, expected, _) = adapt(&Comm::serial(), &whole, &model)?;
    let part = body.share(Some(&obstacle), &ranks, comm.rank());
    let (together, found, [before, after]) = adapt(comm, &part, &model)?;
    for (a, b) in found.iter().zip(&expected) {
        let same = (a.used, a.steps, a.frames, a.strides) == (b.used, b.steps, b.frames, b.strides);
        if !same || (a.after / b.after - 1.0).abs() > 1e-3 {
            failures.push(format!("body: {} and, alone, {}", a.note, b.note));
        }
    }
    let off = distance(&together, &alone);
    if off > super::TOLERANCE {
        failures.push(format!("body: weights are {off:e} from those of one rank"));
    }
    if !found[0].used || after > 0.5 * before {
        let note = &found[0].note;
        failures.push(format!("body: a step is off by {before}, then {after}: {note}"));
    }
    refusals(comm, &model, (&body, &obstacle, &ranks), failures)
}

/// A frame whose obstacle has other points.
fn refusals(
    comm: &Comm,
    model: &Model,
    (body, obstacle, ranks): (&Body, &Obstacle, &[i32]),
    failures: &mut Vec<String>,
) -> Result<()> {
    let part = body.share(Some(obstacle), ranks, comm.rank());
    let session = Session::new(comm.clone(), &part, model, &SessionOptions::default())?;
    let mut a = Adaptation::new(&session, &part, model, Settings::default())?;
    let at_rest = bent(&part, 0.0);
    let field = Field { name: "D", components: 3, cells: at_rest.as_flattened(), boundary: &[0.0; 15] };
    match a.frame(0.0, true, &[field]) {
        Err(Error::Input(what)) if what.contains("18 boundary values") && what.contains("and 15") => {}
        other => failures.push(format!("an obstacle with a point less: {other:?}")),
    }
    Ok(())
}
