//! Bodies at points: an obstacle goes down on a beam that several ranks share, and away again.

use m4gn_base::{Error, Result};
use m4gn_mesh::body::Body;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{ContactSpec, Kind, Model, ModelSpec, SegmentMethod, SegmentSpec, WorldEdges};
use m4gn_parallel::Comm;
use m4gn_samples::bodies as sample;
use m4gn_step::{Session, SessionOptions};

/// The description of a model of bodies with this network.
fn spec(base: ModelSpec, method: SegmentMethod, overlap: usize) -> ModelSpec {
    let mut s = base;
    s.fields.truncate(1);
    s.fields[0].name = "D".into();
    s.fields[0].input = false;
    s.node_types = vec![NodeType::Obstacle, NodeType::Body, NodeType::Handle];
    s.contact = Some(ContactSpec { radius: 0.6 });
    s.segments = SegmentSpec { method, count: 6, modes: 1, overlap, ..SegmentSpec::default() };
    s
}

/// What differs from a run on one rank.
pub fn failures(comm: &Comm, base: &ModelSpec) -> Vec<String> {
    let mut failures = Vec::new();
    let (together, apart) = (WorldEdges::Together, WorldEdges::Apart);
    let mut cases = Vec::new();
    for (method, overlap, world_edges) in [
        (SegmentMethod::SlicExp, 0, together),
        (SegmentMethod::Metis, 1, together),
        (SegmentMethod::Metis, 0, apart),
    ] {
        let name = format!("body, {method}, overlap {overlap}, world edges {world_edges:?}");
        let mut spec = spec(base.clone(), method, overlap);
        spec.architecture.micro.world_edges = world_edges;
        spec.architecture.micro.node_rwse_steps = if world_edges == apart { 5 } else { 0 };
        cases.push((name, spec));
    }
    for kind in [Kind::BsmsGnn { levels: 3 }, Kind::Gcn { layers: 2 }] {
        let mut spec = spec(base.clone(), SegmentMethod::Metis, 0);
        spec.fields[0].input = matches!(kind, Kind::Gcn { .. });
        spec.architecture.kind = kind;
        cases.push((format!("body, {}", spec.architecture.name().name()), spec));
    }
    for (name, spec) in cases {
        match compare(comm, spec) {
            Ok(error) if error < super::TOLERANCE => {}
            Ok(error) => failures.push(format!("{name}: differs from serial by {error:e}")),
            Err(e) => failures.push(format!("{name}: {e}")),
        }
    }
    let mut whole = spec(base.clone(), SegmentMethod::Metis, 0);
    whole.architecture.kind = Kind::GUNet { levels: 2 };
    match compare(comm, whole) {
        Ok(0.0) if comm.size() == 1 => {}
        Err(e) if comm.size() > 1 && e.to_string().contains("kind g-u-net") => {}
        other => failures.push(format!("body, g-u-net on {} ranks: {other:?}", comm.size())),
    }
    let pressed = spec(base.clone(), SegmentMethod::SlicExp, 0);
    if let Err(e) = goes_on(comm, &pressed) {
        failures.push(format!("body: {e}"));
    }
    failures
}

/// This rank's part of a body under an obstacle at this height, and sessions of the whole and of the parts.
fn sessions(comm: &Comm, model: &Model, body: &Body, height: f64) -> Result<(Mesh, [Session; 2])> {
    let obstacle = sample::octahedron([4.0, 0.8, height], 0.5);
    // As a host may deal the points out: in turns along the beam. Of three ranks the first has none.
    let first = usize::from(comm.size() > 2);
    let size = comm.size() as usize - first;
    let ranks: Vec<i32> = (0..body.positions.len()).map(|p| (first + p % 10 * size / 10) as i32).collect();
    let part = body.share(Some(&obstacle), &ranks, comm.rank());
    let options = SessionOptions::default();
    let serial = Session::new(Comm::serial(), &body.mesh(Some(&obstacle)), model, &options)?;
    let session = Session::new(comm.clone(), &part, model, &options)?;
    Ok((part, [serial, session]))
}

/// Largest difference of the steps from serial, relative to the largest change.
fn compare(comm: &Comm, spec: ModelSpec) -> Result<f64> {
    let model = Model::random(spec, 3)?;
    let body = sample::block([9, 3, 2], [4.5, 1.5, 1.0]);
    let (part, [mut serial, mut session]) = sessions(comm, &model, &body, 1.7)?;
    for (&p, &segment) in part.cell_global.iter().zip(session.cell_segment()) {
        if serial.cell_segment()[p as usize] != segment {
            return Err(Error::Internal(format!("point {p} has another segment than in serial")));
        }
    }
    let own = |u: &[[f64; 3]]| -> Vec<[f64; 3]> { part.cell_global.iter().map(|&p| u[p as usize]).collect() };
    let mut start = vec![[0.0; 3]; body.positions.len()];
    let (mut worst, mut largest) = (0f64, 0f64);
    for step in [0, 1, 2, 9] {
        let at = |s: i32| vec![[0.02 * f64::from(s), 0.0, -0.2 * f64::from(s % 4)]; 6];
        let (now, next) = (at(step), at(step + 1));
        let (mut alone, mut shared) = (start.clone(), own(&start));
        serial.step_body(&mut alone, [&now, &next])?;
        session.step_body(&mut shared, [&now, &next])?;
        for ((a, b), before) in own(&alone).iter().zip(&shared).zip(own(&start)) {
            for i in 0..3 {
                worst = worst.max((a[i] - b[i]).abs());
                largest = largest.max((a[i] - before[i]).abs());
            }
        }
        // Random weights move points far: the next step starts from a small part of it.
        start = alone;
        start.iter_mut().flatten().for_each(|v| *v *= 0.02);
    }
    let mut figures = [worst, largest];
    comm.max_f64(&mut figures);
    Ok(figures[0] / figures[1])
}

/// A session that goes on from its own steps, against one rank, under an obstacle that presses from above.
fn goes_on(comm: &Comm, spec: &ModelSpec) -> Result<()> {
    let body = sample::block([9, 3, 2], [4.5, 1.5, 1.0]);
    let mut model = Model::random(spec.clone(), 3)?;
    // Random weights move points far.
    if let Some(std) = model.tensors.get_mut("norm.output.std") {
        std.data.fill(0.01);
    }
    let (part, [mut serial, mut session]) = sessions(comm, &model, &body, 1.7)?;
    let mut alone = vec![[0.0; 3]; body.positions.len()];
    let mut shared = vec![[0.0; 3]; part.cell_global.len()];
    let at = |s: i32| vec![[0.02 * f64::from(s), 0.0, -0.1 * f64::from(s)]; 6];
    for step in 0..4 {
        let (now, next) = (at(step), at(step + 1));
        serial.step_body(&mut alone, [&now, &next])?;
        session.step_body(&mut shared, [&now, &next])?;
        let pairs = part.cell_global.iter().zip(&shared);
        let off = pairs.flat_map(|(&p, b)| (0..3).map(move |i| (p as usize, i, b[i])));
        let mut worst = [off.fold(0f64, |worst, (p, i, b)| worst.max((alone[p][i] - b).abs()))];
        comm.max_f64(&mut worst);
        if worst[0] > 1e-5 {
            return Err(Error::Internal(format!("step {step} is off by {:e} m", worst[0])));
        }
    }
    Ok(())
}
