//! Bodies at points: an obstacle goes down on a beam that several ranks share, and away again.

use m4gn::mesh::NodeType;
use m4gn::model::{ContactSpec, Model, ModelSpec, SegmentMethod, SegmentSpec};
use m4gn::parallel::Comm;
use m4gn::solids::sample;
use m4gn::step::{BodySession, SessionOptions};
use m4gn::{Error, Result};

/// The description of a model of bodies with this network.
fn spec(base: ModelSpec, method: SegmentMethod, overlap: usize) -> ModelSpec {
    let mut s = base;
    s.fields.truncate(1);
    s.fields[0].name = "D".into();
    s.fields[0].input = false;
    s.node_types = vec![NodeType::Obstacle, NodeType::Body, NodeType::Handle];
    s.contact = Some(ContactSpec { radius: 0.6 });
    s.segments = SegmentSpec {
        method,
        count: 6,
        modes: 1,
        overlap,
        ..SegmentSpec::default()
    };
    s
}

/// What differs from a run on one rank.
pub fn failures(comm: &Comm, base: &ModelSpec) -> Vec<String> {
    let mut failures = Vec::new();
    for (method, overlap) in [(SegmentMethod::SlicExp, 0), (SegmentMethod::Metis, 1)] {
        let name = format!("body, {method}, overlap {overlap}");
        match compare(comm, spec(base.clone(), method, overlap)) {
            Ok(error) if error < super::TOLERANCE => {}
            Ok(error) => failures.push(format!("{name}: differs from serial by {error:e}")),
            Err(e) => failures.push(format!("{name}: {e}")),
        }
    }
    failures
}

/// Largest difference of the steps from serial, relative to the largest change.
fn compare(comm: &Comm, spec: ModelSpec) -> Result<f64> {
    let model = Model::random(spec, 3)?;
    let body = sample::block([9, 3, 2], [4.5, 1.5, 1.0]);
    let obstacle = sample::octahedron([4.0, 0.8, 1.7], 0.5);
    let options = SessionOptions::default();
    let mut serial = BodySession::new(Comm::serial(), &model, &body, Some(&obstacle), &options)?;
    let mut session = BodySession::new(comm.clone(), &model, &body, Some(&obstacle), &options)?;
    let labels = serial.segments().1.to_vec();
    let (points, own) = session.segments();
    for (&p, &segment) in points.iter().zip(own) {
        if labels[p as usize] != segment {
            return Err(Error::Internal(format!(
                "point {p} has another segment than in serial"
            )));
        }
    }
    let mut start = vec![[0.0; 3]; body.positions.len()];
    let (mut worst, mut largest) = (0f64, 0f64);
    for step in [0, 1, 2, 9] {
        let at = |s: i32| vec![[0.02 * f64::from(s), 0.0, -0.2 * f64::from(s % 4)]; 6];
        let (now, next) = (at(step), at(step + 1));
        let (mut alone, mut shared) = (start.clone(), start.clone());
        serial.step(&mut alone, [&now, &next])?;
        session.step(&mut shared, [&now, &next])?;
        for ((a, b), before) in alone.iter().zip(&shared).zip(&start) {
            for i in 0..3 {
                worst = worst.max((a[i] - b[i]).abs());
                largest = largest.max((a[i] - before[i]).abs());
            }
        }
        // Random weights move points far: the next step starts from a small part of it.
        start = alone;
        start.iter_mut().flatten().for_each(|v| *v *= 0.02);
    }
    Ok(worst / largest)
}
