//! A model that learns its case on several ranks against the same on one: run as `mpirun -np P <this binary>` for
//! P = 1, 2, 3. Without mpirun this is a run on one rank.

#[path = "mpi_adapt/bodies.rs"]
mod bodies;
#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_adapt::{Adaptation, Outcome, Settings};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, SegmentMethod};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_samples::mesh::vortex;
use m4gn_step::{Field, Session, SessionOptions};
use std::process::ExitCode;

/// Sums of the batch come in another order, and Adam divides by what is small.
const TOLERANCE: f64 = 1e-4;

fn main() -> ExitCode {
    ranks::run("mpi_adapt", run)
}

/// Two or more frames a stride.
fn show(a: &mut Adaptation, mesh: &Mesh, steps: std::ops::Range<usize>, step: f64) -> Result<()> {
    let first = steps.start;
    for i in steps {
        let time = step * i as f64;
        let [u, p] = vortex(mesh, time);
        let field = |name, components, cells, boundary| Field { name, components, cells, boundary };
        let fields = [field("U", 3, &u.0[..], &u.1[..]), field("p", 1, &p.0, &p.1)];
        a.frame(time, i == first, &fields)?;
    }
    Ok(())
}

/// A start-up and two stretches; the model, and what came of each round.
fn adapt(comm: &Comm, mesh: &Mesh, model: &Model) -> Result<(Model, Vec<Outcome>)> {
    let mut session = Session::new(comm.clone(), mesh, model, &SessionOptions::default())?;
    let settings = r#"{"mode": "during", "precision": "fp32", "learningRate": 3e-3, "steps": 24, "stepsEach": 6, "batch": 3, "maxFrames": 40}"#;
    let mut a = Adaptation::new(&session, mesh, model, Settings::parse(settings)?)?;
    let mut outcomes = Vec::new();
    for steps in [0..50, 60..70, 80..90] {
        show(&mut a, mesh, steps, 0.005)?;
        outcomes.push(a.run(3)?);
        session.set_weights(mesh, &a.model())?;
    }
    Ok((a.model(), outcomes))
}

fn run(comm: &Comm) -> Result<Vec<String>> {
    let mesh = sample::triangles(6, 4, 1.5, 1.0);
    let mut spec = m4gn_samples::model::spec();
    spec.segments.method = SegmentMethod::Metis;
    spec.segments.overlap = 1;
    let model = Model::random(spec, 11)?;
    let mut failures = Vec::new();
    compare(comm, &mesh, &model, &mut failures)?;
    bodies::run(comm, &mut failures)?;

    // What one rank finds wrong, all know.
    let size = comm.size();
    let part = sample::part(&mesh, &sample::strips(mesh.n_cells(), size), comm.rank());
    let session = Session::new(comm.clone(), &part, &model, &SessionOptions::default())?;
    let mut a = Adaptation::new(&session, &part, &model, Settings::default())?;
    let [mut u, p] = vortex(&part, 0.0);
    if comm.rank() == size - 1 {
        u.0[0] = f64::NAN;
    }
    let field = |name, components, cells, boundary| Field { name, components, cells, boundary };
    let fields = [field("U", 3, &u.0[..], &u.1[..]), field("p", 1, &p.0, &p.1)];
    match a.frame(0.0, true, &fields) {
        Err(Error::Numerical(_) | Error::OtherRank { .. }) if a.frames() == 0 => {}
        other => failures.push(format!("a value that is not finite on one rank: {other:?}")),
    }
    match a.load(std::path::Path::new("/nowhere")) {
        Err(e) if e.to_string().contains("nowhere") => {}
        other => failures.push(format!("a state that is not there: {other:?}")),
    }
    Ok(failures)
}

/// The same answer, however the mesh is shared out.
fn compare(comm: &Comm, mesh: &Mesh, model: &Model, failures: &mut Vec<String>) -> Result<()> {
    let (alone, expected) = adapt(&Comm::serial(), mesh, model)?;
    let size = comm.size();
    let scattered: Vec<i32> = (0..mesh.n_cells()).map(|c| (c % size as usize) as i32).collect();
    for (how, ranks) in [
        ("strips", sample::strips(mesh.n_cells(), size)),
        ("scattered", scattered),
        ("the last rank alone", vec![size - 1; mesh.n_cells()]),
    ] {
        let part = sample::part(mesh, &ranks, comm.rank());
        let (together, found) = adapt(comm, &part, model)?;
        for (a, b) in found.iter().zip(&expected) {
            let off = [(a.before, b.before), (a.after, b.after)].map(|(a, b)| (a / b - 1.0).abs());
            if (a.used, a.steps, a.frames, a.strides) != (b.used, b.steps, b.frames, b.strides)
                || off[0].max(off[1]) > 1e-3
            {
                failures.push(format!("{how}: {} and, alone, {}", a.note, b.note));
            }
        }
        if !found[0].used {
            failures.push(format!("{how}: nothing was learned: {}", found[0].note));
        }
        let off = distance(&together, &alone);
        if off > TOLERANCE {
            failures.push(format!("{how}: weights are {off:e} from those of one rank"));
        }
    }
    Ok(())
}

/// Distance of all weights, relative to how far they are from the start.
fn distance(a: &Model, b: &Model) -> f64 {
    let numbers = |m: &Model| m.tensors.values().flat_map(|t| t.data.clone()).collect::<Vec<f32>>();
    let (a, b) = (numbers(a), numbers(b));
    let square = |x: f32| f64::from(x).powi(2);
    let apart: f64 = a.iter().zip(&b).map(|(a, b)| square(a - b)).sum();
    (apart / b.iter().map(|b| square(*b)).sum::<f64>().max(1e-300)).sqrt()
}
