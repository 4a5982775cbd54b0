//! A body at points in a session: edges that change with every step, an obstacle with prescribed motion, and contact
//! projection after the step.

mod given;

use super::SessionOptions;
use super::correction::Correction;
use super::history::{History, Origin, State};
use m4gn_contact::graph::ContactGraph;
use m4gn_contact::part::BodyPart;
use m4gn_contact::projection::{Projection, ProjectionReport, check_start};
use m4gn_contact::segments;
use m4gn_engine::{Engine, Forward};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, NodeType, Result};
use m4gn_model::modal::ModalSource;
use m4gn_model::{Model, SegmentSpec, Solid, cell_size};
use m4gn_modes::Modal;
use m4gn_structure::Structure;

type Vector = [f64; 3];

/// A displacement beyond which no solver would take on, m; contact projection and search trees need not either.
const FARTHEST: f64 = 1e6;

/// The network of a body, and what moves.
pub(super) struct Moving {
    graph: ContactGraph,
    engine: Engine,
    /// For each of the host's own points its place in the graph.
    place: Vec<usize>,
    /// Own points of the graph that are free to move.
    free: Vec<bool>,
    /// Own points of the graph, as numbers of the whole body.
    points: Vec<u32>,
    n_points: usize,
    n_obstacle: usize,
    /// What the body's elements are made of.
    solid: Solid,
    /// Displacement of the obstacle's points now and after the step, once it is known.
    motion: Option<[Vec<Vector>; 2]>,
    /// Displacement of the owned nodes `[n_owned x 3]`.
    displacement: Vec<f32>,
    /// What the network is told at the owned nodes ([`ContactGraph::inputs`]).
    inputs: Vec<f32>,
    /// Change of the displacement of the own points `[n x 3]`.
    outputs: Vec<f32>,
    projection: Option<(Projection, ProjectionReport)>,
    /// Where the model reads it, or is corrected by it.
    history: Option<History>,
    /// Of the network by what it was off by over the stride before a hand-over, where it does not read the change over that stride.
    correction: Option<Correction>,
}

/// What a session says of its segments: their number, and that of each of the host's own points.
pub(super) type Cut = (usize, Vec<i32>);

impl Moving {
    /// Builds graph, modes and segments for a model of bodies; the number is the mean length of the edges at rest, m.
    /// Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a mesh without elements or an obstacle that overlaps the body at rest; [`Error::Input`] for a
    /// body without handle, options out of range, or backend torch; what the modes may fail with.
    pub(super) fn new(
        comm: &Comm,
        mesh: &Mesh,
        model: &Model,
        radius: f64,
        settings: &SegmentSpec,
        options: &SessionOptions,
    ) -> Result<(Self, Cut, f64)> {
        let spec = &model.spec;
        if options.backend != super::Backend::Native {
            return Err(Error::Input(
                "backend torch: a body's edges change with every step; use backend native".into(),
            ));
        }
        let (body, ranks) = mesh.whole_body(comm)?;
        let obstacle = mesh.obstacle.as_ref();
        let projection = match &options.projection {
            Some(settings) => {
                let made = comm.agree(Projection::new(&body, obstacle, settings))?;
                Some((made, ProjectionReport::default()))
            }
            None => {
                comm.agree(check_start(&body, obstacle))?;
                None
            }
        };
        let whole = spec.architecture.needs().segments;
        // Every rank computes the same modes: bodies at points are small beside what ranks are for.
        let modes = match whole && settings.method.uses_modes() && settings.count > 1 {
            true => {
                let modal = Modal(settings.modal());
                Some(comm.agree(modal.of_body(&body, settings.mode_count()))?)
            }
            false => None,
        };
        let part = comm.agree(BodyPart::of_rank(&body, obstacle, &ranks, comm.rank()))?;
        let graph = ContactGraph::new(&part, radius, comm)?;
        let segments = match whole {
            true => Some(segments::segment(
                &part,
                &graph,
                spec,
                settings,
                modes.as_ref(),
                comm,
            )?),
            false => None,
        };
        let engine_options = options.engine(options.precision.agreed(model.spec.precision_of_runs(), comm));
        let structure = Structure {
            graph: graph.graph().clone(),
            segments,
        };
        let engine = comm.agree(Engine::new(model, &structure, &engine_options))?;
        let place = |g: &i64| part.points.binary_search(&(*g as u32)).unwrap_or_default();
        let place: Vec<usize> = mesh.cell_global.iter().map(place).collect();
        let cut = structure.segments.map_or((0, Vec::new()), |s| {
            // The obstacle is the last one, and none of the body's.
            let count = s.count - usize::from(obstacle.is_some());
            (count, place.iter().map(|&i| s.node_segment[i]).collect())
        });
        let n_owned = graph.graph().n_owned;
        let size = cell_size(&part.mesh, comm);
        let carried = spec.calibration.as_ref().and_then(|c| c.carried);
        let carried = carried.filter(|&decay| decay > 0.0 && !spec.has_history());
        let moving = Moving {
            n_points: body.positions.len(),
            n_obstacle: part.obstacle.len(),
            solid: Solid::of_body(&body),
            motion: None,
            displacement: vec![0.0; 3 * n_owned],
            inputs: Vec::new(),
            outputs: vec![0.0; 3 * part.points.len()],
            free: part.types.iter().map(|&t| t == NodeType::Body).collect(),
            points: part.points,
            place,
            graph,
            engine,
            projection,
            history: (spec.has_history() || carried.is_some()).then(|| History::new(size)),
            correction: carried.map(Correction::new),
        };
        Ok((moving, cut, size))
    }

    /// Takes the weights of another model of the same description; `labels` are the segments of the host's own points. Collective;
    /// all ranks fail together, and the weights are then those from before.
    pub(super) fn set_weights(
        &mut self,
        comm: &Comm,
        mesh: &Mesh,
        model: &Model,
        (settings, labels): (&SegmentSpec, &[i32]),
        options: &SessionOptions,
    ) -> Result<()> {
        let spec = &model.spec;
        let segments = match spec.architecture.needs().segments {
            true => {
                let (body, ranks) = mesh.whole_body(comm)?;
                let part = BodyPart::of_rank(&body, mesh.obstacle.as_ref(), &ranks, comm.rank());
                let part = comm.agree(part)?;
                let mut own = vec![0; self.points.len()];
                self.place.iter().zip(labels).for_each(|(&i, &k)| own[i] = k);
                let of_labels = segments::of_labels(&part, &self.graph, spec, settings, &own, comm)?;
                Some(of_labels)
            }
            false => None,
        };
        let structure = Structure {
            graph: self.graph.graph().clone(),
            segments,
        };
        let settings = options.engine(options.precision.agreed(model.spec.precision_of_runs(), comm));
        self.engine = comm.agree(Engine::new(model, &structure, &settings))?;
        if let Some(correction) = &mut self.correction {
            // The error is that of the weights from before.
            correction.forget();
        }
        Ok(())
    }

    /// One step of the displacement of the host's own points, m; held points stay. Collective; all ranks fail together,
    /// and `displacement` is then as it was.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths, or where the obstacle's motion in this step was not given;
    /// [`Error::Numerical`] for values that are not finite, going in or coming out.
    pub(super) fn step(&mut self, comm: &Comm, displacement: &mut [Vector]) -> Result<()> {
        let motion = match self.motion.take() {
            Some(motion) => Ok(motion),
            None if self.n_obstacle == 0 => Ok([Vec::new(), Vec::new()]),
            None => Err(Error::Input(
                "the obstacle's motion in this step is not known: give it before every step (m4gn_session_set_obstacle)"
                    .into(),
            )),
        };
        let checked = motion.and_then(|m| self.check(displacement, "now").map(|()| m));
        let [now, after] = comm.agree(checked)?;
        // States are kept for a history alone.
        let start = self.history.is_some().then(|| State {
            body: displacement.to_vec(),
            obstacle: now.clone(),
        });
        let (mut change, mut correction) = (None, None);
        if let (Some(history), Some(start)) = (&mut self.history, &start) {
            if self.correction.is_some() {
                let origin = history.origin(comm, start);
                correction = self.correct(comm, origin, [start.body.as_slice(), &now, &after])?;
            } else {
                let before = history.before(comm, start)?;
                change = Some(self.change(&before, start));
            }
        }
        self.predict(comm, displacement, change.as_deref(), [&now, &after])?;
        let mut end = comm.agree(self.moved(displacement, correction.as_deref()))?;
        self.project(comm, &mut end, &after)?;
        displacement.copy_from_slice(&end);
        if let (Some(history), Some(start)) = (&mut self.history, start) {
            // What the projection corrected is part of the change.
            let obstacle = after;
            history.done(start, State { body: end, obstacle });
        }
        Ok(())
    }

    /// Takes the change over a step from a displacement of the host's own points into the outputs, as the network says. Collective;
    /// all ranks fail together.
    fn predict(
        &mut self,
        comm: &Comm,
        displacement: &[Vector],
        change: Option<&[f32]>,
        motion: [&[Vector]; 2],
    ) -> Result<()> {
        let n = self.points.len();
        let (own, here) = self.displacement.split_at_mut(3 * n);
        let own = own.as_chunks_mut::<3>().0;
        for (&i, u) in self.place.iter().zip(displacement) {
            own[i] = u.map(|v| v as f32);
        }
        let narrow = |rows: &[Vector]| -> Vec<f32> { rows.iter().flatten().map(|v| *v as f32).collect() };
        let motion = motion.map(narrow);
        // Only the first rank has rows of the obstacle.
        here.copy_from_slice(&motion[0][..here.len()]);
        // First, so that the inputs know where the points of other ranks are.
        self.graph.update(comm, &self.displacement)?;
        let (own, motion) = (&self.displacement[..3 * n], [&motion[0][..], &motion[1]]);
        self.graph.inputs(own, change, motion, &mut self.inputs);
        let edges = self.engine.set_edges(self.graph.graph());
        comm.agree(edges)?;
        let done = self.engine.forward(comm, &self.inputs, &mut self.outputs);
        comm.agree(done)
    }

    /// What the network's change in a step from a state is to be corrected by, at the host's own points, m; None: by nothing. At a
    /// hand-over this takes a step of the network, from the state one stride before. Collective; all ranks fail together.
    fn correct(
        &mut self,
        comm: &Comm,
        origin: Origin,
        [body, now, after]: [&[Vector]; 3],
    ) -> Result<Option<Vec<Vector>>> {
        let before = match origin {
            Origin::Step(start) => start.obstacle,
            Origin::Solver(before) => {
                self.predict(comm, &before.body, None, [&before.obstacle, now])?;
                let held = |p: usize| !self.free[self.place[p]];
                let of_free = |p: usize, u: Vector| if held(p) { [0.0; 3] } else { u };
                let changes = self.outputs.as_chunks::<3>().0;
                let n = body.len();
                let was = (0..n).map(|p| of_free(p, std::array::from_fn(|k| body[p][k] - before.body[p][k])));
                let said = (0..n).map(|p| of_free(p, changes[self.place[p]].map(f64::from)));
                let (was, said): (Vec<Vector>, Vec<Vector>) = (was.collect(), said.collect());
                if let Some(correction) = &mut self.correction {
                    correction.measure(comm, (&was, &said));
                }
                before.obstacle
            }
            Origin::Unknown => {
                self.correction.iter_mut().for_each(Correction::forget);
                return Ok(None);
            }
        };
        let next = self
            .correction
            .as_mut()
            .and_then(|c| c.next([&before, now, after]));
        let scaled =
            |(weight, error): (f64, &[Vector])| error.iter().map(|e| e.map(|v| weight * v)).collect();
        Ok(next.map(scaled))
    }

    /// What the displacement of the owned nodes changed by from a state to another one `[n_owned x 3]`.
    fn change(&self, before: &State, now: &State) -> Vec<f32> {
        let changes = |before: &[Vector], now: &[Vector]| -> Vec<[f32; 3]> {
            let pairs = before.iter().zip(now);
            pairs
                .map(|(a, b)| std::array::from_fn(|i| (b[i] - a[i]) as f32))
                .collect()
        };
        let mut change = vec![0.0; self.displacement.len()];
        let (own, here) = change.as_chunks_mut::<3>().0.split_at_mut(self.points.len());
        for (&i, u) in self.place.iter().zip(changes(&before.body, &now.body)) {
            own[i] = u;
        }
        // Only the first rank has rows of the obstacle.
        let obstacle = changes(&before.obstacle, &now.obstacle);
        here.copy_from_slice(&obstacle[..here.len()]);
        change
    }

    /// The displacement of the host's own points after the change that the network says, and a correction of it; held points stay.
    fn moved(&self, displacement: &[Vector], correction: Option<&[Vector]>) -> Result<Vec<Vector>> {
        let changes = self.outputs.as_chunks::<3>().0;
        let mut end = displacement.to_vec();
        let own = self.place.iter().zip(&mut end).enumerate();
        for (p, (&i, u)) in own.filter(|(_, (i, _))| self.free[**i]) {
            for k in 0..3 {
                u[k] += f64::from(changes[i][k]) + correction.map_or(0.0, |c| c[p][k]);
            }
            if !u.iter().all(|v| v.abs() < FARTHEST) {
                return Err(Error::Numerical(format!(
                    "the model's displacement is {u:?} at point {}: the state has left what it was trained on; hand back \
                     to the solver sooner",
                    self.points[i]
                )));
            }
        }
        Ok(end)
    }

    /// Pushes the body out of the obstacle. Every rank does so with the whole body, and to the same effect.
    fn project(&mut self, comm: &Comm, own: &mut [Vector], obstacle: &[Vector]) -> Result<()> {
        let Some((projection, report)) = &mut self.projection else {
            return Ok(());
        };
        let mut all = vec![0.0; 3 * self.n_points];
        let number = |i: usize| 3 * self.points[i] as usize;
        for (&i, u) in self.place.iter().zip(&*own) {
            all[number(i)..][..3].copy_from_slice(u);
        }
        comm.sum_f64(&mut all);
        let all = all.as_chunks_mut::<3>().0;
        *report = comm.agree(projection.apply(all, obstacle))?;
        for (&i, u) in self.place.iter().zip(own) {
            *u = all[self.points[i] as usize];
        }
        Ok(())
    }

    /// Displacement of the own points before the last step `[n x 3]`, m.
    pub(super) fn displacement(&self) -> &[f32] {
        &self.displacement[..3 * self.points.len()]
    }

    /// What the body's elements are made of.
    pub(super) fn solid(&self) -> &Solid {
        &self.solid
    }

    /// What the projection did in the last step; none without one.
    pub(super) fn projection(&self) -> Option<&ProjectionReport> {
        self.projection.as_ref().map(|(_, report)| report)
    }
}

#[cfg(test)]
#[path = "moving_tests.rs"]
mod tests;
