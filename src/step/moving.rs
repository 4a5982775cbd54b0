//! A body at points in a session: edges that change with every step, an obstacle with prescribed motion, and contact
//! projection after the step.

use super::SessionOptions;
use super::history::{History, State};
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
    /// Where the model reads it, or a part of it goes on.
    history: Option<History>,
    /// What part of the change over the stride before goes on after a hand-over, where the model does not read that change.
    carried: Option<f64>,
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
        let whole = spec.architecture.segment_transformer().is_some();
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
        let cut = match whole {
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
        let engine_options = options.engine(options.precision.agreed(comm));
        let engine = Engine::new(model, graph.graph(), cut.as_ref(), &engine_options);
        let engine = comm.agree(engine)?;
        let place = |g: &i64| part.points.binary_search(&(*g as u32)).unwrap_or_default();
        let place: Vec<usize> = mesh.cell_global.iter().map(place).collect();
        let cut = cut.map_or((0, Vec::new()), |s| {
            // The obstacle is the last one, and none of the body's.
            let count = s.count - usize::from(obstacle.is_some());
            (count, place.iter().map(|&i| s.node_segment[i]).collect())
        });
        let n_owned = graph.graph().n_owned;
        let size = cell_size(&part.mesh, comm);
        let carried = spec.calibration.as_ref().and_then(|c| c.carried);
        let carried = carried.filter(|_| !spec.has_history());
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
            carried,
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
        let cut = match spec.architecture.segment_transformer() {
            Some(_) => {
                let (body, ranks) = mesh.whole_body(comm)?;
                let part = BodyPart::of_rank(&body, mesh.obstacle.as_ref(), &ranks, comm.rank());
                let part = comm.agree(part)?;
                let mut own = vec![0; self.points.len()];
                self.place.iter().zip(labels).for_each(|(&i, &k)| own[i] = k);
                let of_labels = segments::of_labels(&part, &self.graph, spec, settings, &own, comm)?;
                Some(of_labels)
            }
            None => None,
        };
        let settings = options.engine(options.precision.agreed(comm));
        let engine = Engine::new(model, self.graph.graph(), cut.as_ref(), &settings);
        self.engine = comm.agree(engine)?;
        Ok(())
    }

    /// Takes the displacement of the obstacle's points at the start and at the end of the next step, m; that of the
    /// first rank counts. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths; [`Error::Numerical`] for values that are not finite.
    pub(super) fn set_obstacle(&mut self, comm: &Comm, motion: [&[Vector]; 2]) -> Result<()> {
        let checked = self.check_obstacle(motion[0], "now");
        let checked = checked.and_then(|()| self.check_obstacle(motion[1], "after the step"));
        comm.agree(checked)?;
        self.motion = Some(motion.map(|values| of_root(comm, values)));
        Ok(())
    }

    /// Takes the displacement one stride before the next step, m: of the host's own points, and of the obstacle's, of which that of
    /// the first rank counts. Where neither the model reads it nor a part of it is carried on, it is checked and forgotten.
    /// Collective; all ranks fail together.
    ///
    /// # Errors
    /// As [`Moving::set_obstacle`].
    pub(super) fn set_before(&mut self, comm: &Comm, body: &[Vector], obstacle: &[Vector]) -> Result<()> {
        let when = "one stride before";
        let checked = self.check(body, when);
        comm.agree(checked.and_then(|()| self.check_obstacle(obstacle, when)))?;
        let obstacle = of_root(comm, obstacle);
        if let Some(history) = &mut self.history {
            let body = body.to_vec();
            history.give(State { body, obstacle });
        }
        Ok(())
    }

    fn check_obstacle(&self, values: &[Vector], when: &str) -> Result<()> {
        if values.len() != self.n_obstacle {
            return Err(Error::Input(format!(
                "displacement of the obstacle {when}: expected {} points, found {}",
                self.n_obstacle,
                values.len()
            )));
        }
        match values.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
            Some(i) => Err(Error::Numerical(format!(
                "displacement of the obstacle {when}: {:?} at point {i}",
                values[i]
            ))),
            None => Ok(()),
        }
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
        let (mut change, mut handed_over) = (None, None);
        if let (Some(history), Some(start)) = (&mut self.history, &start) {
            match self.carried {
                Some(part) => handed_over = history.handed_over(comm, start).zip(Some(part)),
                None => {
                    let before = history.before(comm, start)?;
                    change = Some(self.change(&before, start));
                }
            }
        }
        let n = self.points.len();
        let (own, here) = self.displacement.split_at_mut(3 * n);
        let own = own.as_chunks_mut::<3>().0;
        for (&i, u) in self.place.iter().zip(&*displacement) {
            own[i] = u.map(|v| v as f32);
        }
        let narrow = |rows: &[Vector]| -> Vec<f32> { rows.iter().flatten().map(|v| *v as f32).collect() };
        let motion = [narrow(&now), narrow(&after)];
        // Only the first rank has rows of the obstacle.
        here.copy_from_slice(&motion[0][..here.len()]);
        // First, so that the inputs know where the points of other ranks are.
        self.graph.update(comm, &self.displacement)?;
        let (own, motion) = (&self.displacement[..3 * n], [&motion[0][..], &motion[1]]);
        self.graph
            .inputs(own, change.as_deref(), motion, &mut self.inputs);
        let edges = self.engine.set_edges(self.graph.graph());
        comm.agree(edges)?;
        let done = self.engine.forward(comm, &self.inputs, &mut self.outputs);
        let carried = handed_over.as_ref().map(|(before, part)| {
            let part = part * evenness(&before.obstacle, &now, &after);
            (part, &before.body[..])
        });
        let mut end = comm.agree(done.and_then(|()| self.moved(displacement, carried)))?;
        self.project(comm, &mut end, &after)?;
        displacement.copy_from_slice(&end);
        if let (Some(history), Some(start)) = (&mut self.history, start) {
            // What the projection corrected is part of the change.
            let obstacle = after;
            history.done(start, State { body: end, obstacle });
        }
        Ok(())
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

    /// The displacement of the host's own points after the change that the network says, of which a part is that from the displacement
    /// one stride before, where that is given; held points stay.
    fn moved(&self, displacement: &[Vector], before: Option<(f64, &[Vector])>) -> Result<Vec<Vector>> {
        let changes = self.outputs.as_chunks::<3>().0;
        let mut end = displacement.to_vec();
        let own = self.place.iter().zip(&mut end).enumerate();
        for (p, (&i, u)) in own.filter(|(_, (i, _))| self.free[**i]) {
            for k in 0..3 {
                let change = f64::from(changes[i][k]);
                u[k] += match before {
                    Some((part, before)) => (1.0 - part) * change + part * (u[k] - before[p][k]),
                    None => change,
                };
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

    fn check(&self, displacement: &[Vector], when: &str) -> Result<()> {
        if displacement.len() != self.place.len() {
            return Err(Error::Input(format!(
                "displacement of the body {when}: expected {} points, found {}",
                self.place.len(),
                displacement.len()
            )));
        }
        match displacement.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
            Some(i) => Err(Error::Numerical(format!(
                "displacement of the body {when}: {:?} at point {}",
                displacement[i], self.points[self.place[i]]
            ))),
            None => Ok(()),
        }
    }
}

/// How evenly the obstacle goes on: 1 with the motion of the stride before, 0 where it begins, stops or turns back. 1 without obstacle.
fn evenness(before: &[Vector], now: &[Vector], after: &[Vector]) -> f64 {
    let size = |of: &dyn Fn(usize, usize) -> f64| {
        let values = (0..now.len()).flat_map(|q| (0..3).map(move |k| of(q, k).powi(2)));
        values.sum::<f64>().sqrt()
    };
    let behind = size(&|q, k| now[q][k] - before[q][k]);
    let ahead = size(&|q, k| after[q][k] - now[q][k]);
    let turn = size(&|q, k| after[q][k] - 2.0 * now[q][k] + before[q][k]);
    match behind.max(ahead) {
        0.0 => 1.0,
        largest => (1.0 - turn / largest).max(0.0),
    }
}

/// The first rank's values on all ranks. Collective.
fn of_root(comm: &Comm, values: &[Vector]) -> Vec<Vector> {
    let mut flat = values.as_flattened().to_vec();
    comm.broadcast(&mut flat);
    flat.as_chunks().0.to_vec()
}

#[cfg(test)]
#[path = "moving_tests.rs"]
mod tests;
