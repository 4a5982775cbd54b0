//! A body in a host's run, and an obstacle with prescribed motion.

use super::Made;
use super::graph::Body;
use super::start::check_start;
use crate::field::expect_shape;
use crate::host::{Host, HostOptions, Hosted, Predict};
use crate::{Domain, Field};
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_mesh::Mesh;
use m4gn_mesh::body::Obstacle;
use m4gn_mesh::vector::Vector;
use m4gn_model::{ModelSpec, Solid, cell_size};
use m4gn_parallel::Comm;

/// A displacement beyond which no solver would take on, m; search trees need not either.
const FARTHEST: f64 = 1e6;

/// A body whose points a host has.
pub struct BodyHost {
    body: Body,
    /// Name of the displacement.
    field: String,
    /// For each of the host's own points its place among the body's.
    place: Vec<usize>,
    /// Own points of the body, as numbers of the whole body.
    points: Vec<u32>,
    obstacle: Option<Obstacle>,
    /// What the body's elements are made of.
    solid: Solid,
    /// Displacement of the obstacle's points now and after the step, once it is known.
    motion: Option<[Vec<Vector>; 2]>,
    /// Displacement of the local nodes `[n_local x 3]`.
    state: Vec<f32>,
    /// The obstacle's displacement after the step, at its local nodes `[n_local x 3]`.
    next: Vec<f32>,
    /// Change of the displacement of the own points `[n x 3]`, as the network says.
    outputs: Vec<f32>,
}

impl BodyHost {
    /// As [`crate::open`].
    pub(crate) fn open(mesh: &Mesh, spec: &ModelSpec, options: &HostOptions, comm: &Comm) -> Result<Hosted> {
        let (whole, ranks) = mesh.whole_body(comm)?;
        let obstacle = mesh.obstacle.as_ref();
        comm.agree(check_start(&whole, obstacle))?;
        let made = Made::new((&whole, &ranks, obstacle), spec, options.segments, options.modes, comm)?;
        let Made { part, body, structure } = made;
        let place = |g: &i64| part.points.binary_search(&(*g as u32)).unwrap_or_default();
        let place: Vec<usize> = mesh.cell_global.iter().map(place).collect();
        let (n_segments, node_segment) = structure.segments.as_ref().map_or((0, Vec::new()), |s| {
            // The obstacle is the last one, and none of the body's.
            let count = s.count - usize::from(obstacle.is_some());
            (count, place.iter().map(|&i| s.node_segment[i]).collect())
        });
        let size = cell_size(&part.mesh, comm);
        let local = 3 * body.n_local;
        let host = BodyHost {
            field: spec.fields[0].name.clone(),
            obstacle: obstacle.cloned(),
            solid: Solid::of_body(&whole),
            motion: None,
            state: vec![0.0; local],
            next: vec![0.0; local],
            outputs: vec![0.0; 3 * part.points.len()],
            points: part.points,
            place,
            body,
        };
        Ok(Hosted {
            host: Box::new(host),
            structure,
            n_segments,
            node_segment,
            segment_record: String::new(),
            cell_size: size,
        })
    }

    /// One step of the displacement of the host's own points, m; held points stay. Collective; all ranks fail together,
    /// and `displacement` is then as it was.
    fn advance(&mut self, comm: &Comm, network: &mut dyn Predict, displacement: &mut [Vector]) -> Result<()> {
        let motion = match self.motion.take() {
            Some(motion) => Ok(motion),
            None if self.obstacle.is_none() => Ok([Vec::new(), Vec::new()]),
            None => Err(Error::Input(
                "the obstacle's motion in this step is not known: give it with every step (boundary of m4gn_session_step); a ride \
                 knows no obstacle"
                    .into(),
            )),
        };
        let point = |i: usize| self.points[self.place[i]];
        let checked =
            motion.and_then(|m| check("body", "now", displacement, self.place.len(), point).map(|()| m));
        let [now, after] = comm.agree(checked)?;
        self.predict(comm, network, displacement, [&now, &after])?;
        let end = comm.agree(self.moved(displacement))?;
        displacement.copy_from_slice(&end);
        Ok(())
    }

    /// Takes the change over a step from a displacement of the host's own points into the outputs, as the network says. Collective;
    /// all ranks fail together.
    fn predict(
        &mut self,
        comm: &Comm,
        network: &mut dyn Predict,
        displacement: &[Vector],
        motion: [&[Vector]; 2],
    ) -> Result<()> {
        let BodyHost { body, state, next, .. } = self;
        fill(state, self.place.iter().copied(), displacement);
        for (rows, values) in [(&mut *state, motion[0]), (next, motion[1])] {
            fill(rows, body.obstacle_nodes.iter().map(|&node| node as usize), values);
        }
        let outputs = network.predict(comm, body, state, next)?;
        self.outputs.copy_from_slice(outputs);
        Ok(())
    }

    /// The displacement of the host's own points after the change that the network says; held points stay.
    fn moved(&self, displacement: &[Vector]) -> Result<Vec<Vector>> {
        let changes = self.outputs.as_chunks::<3>().0;
        let mut end = displacement.to_vec();
        for (&i, u) in self.place.iter().zip(&mut end).filter(|(i, _)| !self.body.is_held(**i, 0)) {
            for k in 0..3 {
                u[k] += f64::from(changes[i][k]);
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

    fn check_obstacle(&self, values: &[Vector], when: &str) -> Result<()> {
        let n = self.obstacle.as_ref().map_or(0, |o| o.positions.len());
        check("obstacle", when, values, n, |i| i as u32)?;
        let rigid = self.obstacle.as_ref().map_or(Ok(()), |o| o.check_motion(values));
        rigid.map_err(|e| Error::Input(format!("displacement of the obstacle {when}: {e}")))
    }
}

/// Whether these are displacements of n points.
fn check(what: &str, when: &str, values: &[Vector], n: usize, point: impl Fn(usize) -> u32) -> Result<()> {
    refuse(values.len() != n, Error::Input, || {
        format!("displacement of the {what} {when}: expected {n} points, found {}", values.len())
    })?;
    refuse_any(values.iter().position(|u| u.iter().any(|v| !v.is_finite())), Error::Numerical, |i| {
        format!("displacement of the {what} {when}: {:?} at point {}", values[i], point(i))
    })
}

/// The first rank's values on all ranks. Collective.
fn of_root(comm: &Comm, values: &[Vector]) -> Vec<Vector> {
    let mut flat = values.as_flattened().to_vec();
    comm.broadcast(&mut flat);
    flat.as_chunks().0.to_vec()
}

/// Takes vectors into the rows of these nodes.
fn fill(rows: &mut [f32], nodes: impl Iterator<Item = usize>, vectors: &[Vector]) {
    let rows = rows.as_chunks_mut::<3>().0;
    for (node, u) in nodes.zip(vectors) {
        rows[node] = u.map(|v| v as f32);
    }
}

impl Host for BodyHost {
    fn domain(&self) -> &dyn Domain {
        &self.body
    }

    fn step(
        &mut self,
        comm: &Comm,
        network: &mut dyn Predict,
        fields: &[Field],
        checked: Result<()>,
        result: &mut [f64],
    ) -> Result<()> {
        let name = &self.field;
        let read = || -> Result<&[f64]> {
            checked?;
            let field = fields.iter().find(|f| f.name == name).ok_or_else(|| {
                Error::Input(format!("input field '{name}' is missing; the model moves it"))
            })?;
            let (c, len) = (field.components, field.cells.len());
            expect_shape(name, "cell", true, c, len, self.place.len())?;
            Ok(field.cells)
        };
        let points = comm.agree(read())?;
        result.copy_from_slice(points);
        self.advance(comm, network, result.as_chunks_mut().0)
    }

    fn set_obstacle(&mut self, comm: &Comm, motion: [&[Vector]; 2]) -> Result<()> {
        let checked = self.check_obstacle(motion[0], "now");
        let checked = checked.and_then(|()| self.check_obstacle(motion[1], "after the step"));
        comm.agree(checked)?;
        self.motion = Some(motion.map(|values| of_root(comm, values)));
        Ok(())
    }

    fn solid(&self) -> Option<&Solid> {
        Some(&self.solid)
    }

    fn seen(&self) -> &[f32] {
        &self.state[..3 * self.points.len()]
    }
}
