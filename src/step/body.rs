//! A session of bodies at points: one model, one body, one obstacle with prescribed motion.

use super::SessionOptions;
use crate::dataset::{Body, Obstacle, PointType};
use crate::engine::{Engine, Forward, SegmentView};
use crate::graph::contact::ContactGraph;
use crate::model::{Model, ModelSpec};
use crate::parallel::Comm;
use crate::segments::ranks;
use crate::solids::part::BodyPart;
use crate::solids::projection::check_start;
use crate::solids::segments;
use crate::{Error, Result};

/// One model on one body.
pub struct BodySession {
    comm: Comm,
    spec: ModelSpec,
    graph: ContactGraph,
    engine: Engine,
    /// Own points, as numbers of the whole body.
    points: Vec<u32>,
    types: Vec<PointType>,
    n_points: usize,
    n_obstacle: usize,
    segment: Vec<i32>,
    /// Displacement of the owned nodes `[n_owned x 3]`.
    displacement: Vec<f32>,
    /// Prescribed motion of the owned nodes `[n_owned x 3]`.
    inputs: Vec<f32>,
    /// Change of the displacement of the own points `[n x 3]`.
    outputs: Vec<f32>,
}

impl BodySession {
    /// Builds graph, modes and segments for a model. Every rank is given the whole body; each keeps its part: whole
    /// segments where there are enough. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Model`] for a model of cells, or one that does not know handles or obstacles; [`Error::Input`] for a body
    /// without handle, options out of range, or backend torch; [`Error::Mesh`] for an obstacle that overlaps the body at
    /// rest; what the modes may fail with.
    pub fn new(
        comm: Comm,
        model: &Model,
        body: &Body,
        obstacle: Option<&Obstacle>,
        options: &SessionOptions,
    ) -> Result<Self> {
        let spec = &model.spec;
        let Some(contact) = spec.contact else {
            return Err(Error::Model(
                "the model is of fields at cells; a body at points needs one with `contact`, trained on trajectories \
                 at points"
                    .into(),
            ));
        };
        if options.backend != super::Backend::Native {
            return Err(Error::Input(
                "backend torch: a body's edges change with every step; use backend native".into(),
            ));
        }
        if let Some(obstacle) = obstacle {
            check_start(body, obstacle)?;
        }
        let settings = comm.agree(options.segment_spec(&spec.segments))?;
        let whole = spec.architecture.segment_transformer.is_some();
        // Every rank computes the same modes: bodies at points are small beside what ranks are for.
        let modes = match whole && settings.method.uses_modes() && settings.count > 1 {
            true => Some(comm.agree(segments::modes(body, &settings, &options.modal))?),
            false => None,
        };
        let owners = comm.agree(owners(body, obstacle, spec, &settings, modes.as_ref(), &comm))?;
        let part = comm.agree(BodyPart::of_rank(body, obstacle, &owners, comm.rank()))?;
        let graph = ContactGraph::new(&part, contact.radius, &comm)?;
        let cut = match whole {
            true => Some(segments::segment(
                &part,
                &graph,
                spec,
                &settings,
                modes.as_ref(),
                &comm,
            )?),
            false => None,
        };
        let view = cut.as_ref().map(|(s, f)| SegmentView::new(s, f));
        let engine = Engine::new(model, graph.graph(), view.as_ref(), &options.engine());
        let engine = comm.agree(engine)?;
        let n = part.points.len();
        let n_owned = graph.graph().n_owned;
        Ok(BodySession {
            spec: spec.clone(),
            segment: cut.map_or(Vec::new(), |(s, _)| s.node_segment[..n].to_vec()),
            points: part.points,
            types: part.types,
            n_points: body.positions.len(),
            n_obstacle: part.obstacle.len(),
            displacement: vec![0.0; 3 * n_owned],
            inputs: vec![0.0; 3 * n_owned],
            outputs: vec![0.0; 3 * n],
            graph,
            engine,
            comm,
        })
    }

    /// The model's description.
    pub fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    /// Own points, as numbers of the whole body, and the segment of each (none without a macro stage).
    pub fn segments(&self) -> (&[u32], &[i32]) {
        (&self.points, &self.segment)
    }

    /// One step. `displacement [N]` of the whole body from rest, m, goes from t to t + stride on every rank; held points
    /// stay. `obstacle` is the displacement of its points `[Q]` at t and at t + stride. Collective; all ranks fail together, and
    /// nothing is written then.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths; [`Error::Numerical`] for values that are not finite, going in or coming out.
    pub fn step(&mut self, displacement: &mut [[f64; 3]], obstacle: [&[[f64; 3]]; 2]) -> Result<()> {
        let checked = self.check(displacement, obstacle);
        self.comm.agree(checked)?;
        let n = self.points.len();
        let (body, here) = self.displacement.split_at_mut(3 * n);
        for (to, &p) in body.as_chunks_mut::<3>().0.iter_mut().zip(&self.points) {
            *to = displacement[p as usize].map(|v| v as f32);
        }
        // Only the first rank has rows of the obstacle.
        let motion = self.inputs[3 * n..].as_chunks_mut::<3>().0.iter_mut();
        let rows = here.as_chunks_mut::<3>().0.iter_mut().zip(motion);
        for ((u, motion), (before, after)) in rows.zip(obstacle[0].iter().zip(obstacle[1])) {
            *u = before.map(|v| v as f32);
            *motion = std::array::from_fn(|i| (after[i] - before[i]) as f32);
        }
        let graph = self.graph.update(&self.comm, &self.displacement)?;
        let edges = self.engine.set_edges(graph);
        self.comm.agree(edges)?;
        let done = self.engine.forward(&self.comm, &self.inputs, &mut self.outputs);
        let done = done.and_then(|()| match self.outputs.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(Error::Numerical(format!(
                "the model's displacement is {} at point {}: the state has left what it was trained on; hand back to \
                 the solver sooner",
                self.outputs[i],
                self.points[i / 3]
            ))),
            None => Ok(()),
        });
        self.comm.agree(done)?;
        self.collect(displacement);
        Ok(())
    }

    /// Adds all ranks' changes to the displacement of the points that move.
    fn collect(&self, displacement: &mut [[f64; 3]]) {
        let mut change = vec![0.0f64; 3 * self.n_points];
        let rows = self.points.iter().zip(&self.types);
        for ((&p, kind), row) in rows.zip(self.outputs.as_chunks::<3>().0) {
            if *kind == PointType::Body {
                change[3 * p as usize..][..3].copy_from_slice(&row.map(f64::from));
            }
        }
        self.comm.sum_f64(&mut change);
        for (u, change) in displacement.iter_mut().zip(change.as_chunks::<3>().0) {
            (0..3).for_each(|i| u[i] += change[i]);
        }
    }

    fn check(&self, displacement: &[[f64; 3]], obstacle: [&[[f64; 3]]; 2]) -> Result<()> {
        let expected = [self.n_points, self.n_obstacle, self.n_obstacle];
        let found = [displacement, obstacle[0], obstacle[1]];
        let names = ["the body", "the obstacle now", "the obstacle after the step"];
        for ((values, n), name) in found.into_iter().zip(expected).zip(names) {
            if values.len() != n {
                return Err(Error::Input(format!(
                    "displacement of {name}: expected {n} points, found {}",
                    values.len()
                )));
            }
            if let Some(i) = values.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
                return Err(Error::Numerical(format!(
                    "displacement of {name}: {:?} at point {i}",
                    values[i]
                )));
            }
        }
        Ok(())
    }
}

/// Rank of each point: whole segments where there are as many as ranks.
fn owners(
    body: &Body,
    obstacle: Option<&Obstacle>,
    spec: &ModelSpec,
    settings: &crate::model::SegmentSpec,
    modes: Option<&crate::modes::Modes>,
    comm: &Comm,
) -> Result<Vec<i32>> {
    let n = body.positions.len();
    let size = comm.size() as usize;
    if size == 1 {
        return Ok(vec![0; n]);
    }
    let alone = Comm::serial();
    let part = BodyPart::whole(body, obstacle)?;
    let radius = spec.contact.map_or(1.0, |c| c.radius);
    let graph = ContactGraph::new(&part, radius, &alone)?;
    // A model without segments is cut into as many pieces as there are ranks.
    let pieces = match spec.architecture.segment_transformer {
        Some(_) => settings.clone(),
        None => crate::model::SegmentSpec {
            count: size.min(n),
            method: crate::model::SegmentMethod::Metis,
            ..settings.clone()
        },
    };
    let (cut, _) = segments::segment(&part, &graph, spec, &pieces, modes, &alone)?;
    let k = pieces.count;
    if k < size {
        return Err(Error::Input(format!(
            "{k} segments for {size} ranks: expected at most {k} ranks, or more segments"
        )));
    }
    let adjacency: Vec<f64> = (0..k)
        .flat_map(|row| cut.adjacency[row * cut.count..][..k].to_vec())
        .collect();
    let rank = ranks::assign(&cut.sizes[..k], &adjacency, &vec![1.0; size])?;
    Ok(cut.node_segment[..n].iter().map(|&s| rank[s as usize]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::plain;
    use crate::model::tests::bodies;
    use crate::solids::sample;

    fn case() -> (Model, Body, Obstacle) {
        let mut spec = bodies();
        spec.segments.count = 3;
        spec.segments.modes = 1;
        let obstacle = sample::octahedron([2.6, 0.5, 1.6], 0.5);
        (
            Model::random(spec, 5).unwrap(),
            sample::block([6, 2, 2], [3.0, 1.0, 1.0]),
            obstacle,
        )
    }

    /// The engine that takes new edges in each step against the plain loops on a graph made for that step.
    #[test]
    fn steps_are_those_of_the_plain_network() {
        let (model, body, obstacle) = case();
        let comm = Comm::serial();
        let options = SessionOptions::default();
        let mut session = BodySession::new(comm.clone(), &model, &body, Some(&obstacle), &options).unwrap();
        let part = BodyPart::whole(&body, Some(&obstacle)).unwrap();
        let mut graph = ContactGraph::new(&part, 0.5, &comm).unwrap();
        let settings = &model.spec.segments;
        let modes = segments::modes(&body, settings, &options.modal).unwrap();
        let cut = segments::segment(&part, &graph, &model.spec, settings, Some(&modes), &comm).unwrap();
        let (cut, features) = cut;
        let view = SegmentView::new(&cut, &features);
        let mut displacement = vec![[0.0; 3]; 63];
        let mut edges = Vec::new();
        for step in 0..4 {
            // Down until it touches, then away.
            let at = |s: i32| [0.0, 0.0, -0.15 * f64::from(if s > 2 { 9 - 3 * s } else { s })];
            let (now, next) = (vec![at(step); 6], vec![at(step + 1); 6]);
            let mut owned: Vec<f32> = displacement
                .iter()
                .chain(&now)
                .flatten()
                .map(|v: &f64| *v as f32)
                .collect();
            let mut inputs = vec![0.0; owned.len()];
            for i in 0..6 {
                inputs[3 * (63 + i) + 2] = (next[i][2] - now[i][2]) as f32;
            }
            let graph = graph.update(&comm, &owned).unwrap();
            edges.push(graph.senders.len());
            let plain = plain::forward(&model, graph, Some(&view), &inputs);
            let before = displacement.clone();
            session.step(&mut displacement, [&now, &next]).unwrap();
            for (p, (u, old)) in displacement.iter().zip(&before).enumerate() {
                for i in 0..3 {
                    let expected = match body.types[p] {
                        PointType::Body => old[i] + plain[3 * p + i],
                        PointType::Handle => 0.0,
                    };
                    assert!((u[i] - expected).abs() < 1e-4, "{step} {p}: {} {expected}", u[i]);
                }
            }
            owned.clear();
            // Random weights move points far: the next step starts from a small part of it.
            displacement.iter_mut().flatten().for_each(|v| *v *= 0.01);
        }
        assert!(edges[0] < edges[2] && edges[3] < edges[2], "{edges:?}");
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let (model, body, obstacle) = case();
        let new = |model: &Model, options: &SessionOptions| {
            BodySession::new(Comm::serial(), model, &body, Some(&obstacle), options).map(|_| ())
        };
        let cells = Model::random(crate::model::tests::spec(), 1).unwrap();
        let says = |result: Result<()>, word: &str| {
            let message = result.unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        };
        says(new(&cells, &SessionOptions::default()), "contact");
        let torch = SessionOptions {
            backend: crate::step::Backend::Torch(None),
            ..SessionOptions::default()
        };
        says(new(&model, &torch), "backend native");
        let inside = sample::octahedron([2.6, 0.5, 1.2], 0.5);
        let options = SessionOptions::default();
        let overlap = BodySession::new(Comm::serial(), &model, &body, Some(&inside), &options);
        says(overlap.map(|_| ()), "overlaps the body at the start");
        let mut session = BodySession::new(
            Comm::serial(),
            &model,
            &body,
            Some(&obstacle),
            &SessionOptions::default(),
        )
        .unwrap();
        let still = vec![[0.0; 3]; 6];
        says(
            session.step(&mut vec![[0.0; 3]; 62], [&still, &still]),
            "63 points",
        );
        says(
            session.step(&mut vec![[0.0; 3]; 63], [&still, &still[1..]]),
            "after the step",
        );
        let mut broken = vec![[0.0; 3]; 63];
        broken[7][1] = f64::NAN;
        says(session.step(&mut broken, [&still, &still]), "point 7");
    }
}
