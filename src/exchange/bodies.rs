//! Trajectories of a body of tetrahedra that an obstacle touches (DeepMind's DeformingPlate) as m4gn's, and back.
//!
//! Points of type `normal` and `handle` are the body's, those of type `obstacle` the obstacle's, of which the surface is kept. What the
//! data do not say is the material: the body is of one, of a Poisson's ratio that is given.

use super::array::{Array, Arrays};
use super::points::{frames, interval, structure, with_times};
use m4gn_base::{Error, Result, refuse_any};
use m4gn_data::{FieldMeta, Frame, Split, Trajectory, WriteOptions, Writer};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Material, Obstacle};
use m4gn_mesh::elements::{ElementKind, Elements};
use m4gn_mesh::vector::Vector;
use serde_json::json;
use std::path::Path;

/// Codes of node types in these data.
const NORMAL: i32 = 0;
const OBSTACLE: i32 = 1;
const HANDLE: i32 = 3;

/// Arrays that are no fields.
const STRUCTURE: [&str; 7] =
    ["mesh_pos", "pos", "cells", "faces", "node_type", "world_pos", "obstacle_triangles"];

/// A trajectory that was read.
#[derive(Clone, Debug)]
pub struct Bodies {
    /// At rest.
    pub body: Body,
    /// Its surface; none of a body that nothing touches.
    pub obstacle: Option<Obstacle>,
    /// Fields beside the displacement, with their values in all frames.
    fields: Vec<(FieldMeta, Array)>,
    /// Places of all points in all frames, m.
    world: Array,
    /// Places of all points at rest, m.
    rest: Vec<Vector>,
    /// Numbers in these data of the body's points, and of those of the obstacle's surface.
    of_body: Vec<usize>,
    of_obstacle: Vec<usize>,
    /// Time between frames, s.
    dt: f64,
}

impl Bodies {
    /// Whether a trajectory's arrays are those of a body: places in three directions.
    pub fn are(arrays: &Arrays) -> bool {
        let places = arrays.get("mesh_pos").or(arrays.get("pos"));
        places.is_some_and(|a| a.shape.last() == Some(&3))
    }

    /// Makes sense of a trajectory's arrays: `mesh_pos` (or `pos`) and `world_pos`, `cells` (or `faces`), `node_type`, for an obstacle without cells
    /// `obstacle_triangles`, and a field for each other array that has a row a point in each frame. `dt` is the time between frames where
    /// the arrays do not say it.
    ///
    /// # Errors
    /// [`Error::File`] naming the array of `path` that is missing or does not fit.
    pub fn new(arrays: &Arrays, dt: Option<f64>, poisson: f64, path: &Path) -> Result<Self> {
        let wrong = |what: String| Error::file(path, what);
        let (places, cells, kinds) = structure(arrays, 3, 4, path)?;
        let rest: Vec<Vector> = places.as_chunks::<3>().0.to_vec();
        let n = rest.len();
        refuse_any(kinds.iter().position(|k| ![NORMAL, OBSTACLE, HANDLE].contains(k)), wrong, |p| {
            format!("node_type of point {p} is {}, expected 0 (normal), 1 (obstacle), 3 (handle)", kinds[p])
        })?;
        let [elements, solid] = cut(cells.as_chunks::<4>().0, &kinds, &rest).map_err(wrong)?;
        let surface = match arrays.get("obstacle_triangles") {
            Some(triangles) => triangles.labels("obstacle_triangles", 3, n, path)?,
            None => Elements::of_kind(ElementKind::Tetrahedron, solid).skin().concat(),
        };
        refuse_any(surface.iter().find(|p| kinds[**p as usize] != OBSTACLE), wrong, |p| {
            format!("obstacle_triangles: point {p} is none of the obstacle's (node_type 1)")
        })?;
        let of_body: Vec<usize> = (0..n).filter(|&p| kinds[p] != OBSTACLE).collect();
        if of_body.len() < n && surface.is_empty() {
            return Err(wrong(
                "points of an obstacle (node_type 1) without cells or obstacle_triangles".into(),
            ));
        }
        let (of_obstacle, triangles) = renumbered(&surface, n);
        let (used, elements) = renumbered(&elements, n);
        if let Some(p) = of_body.iter().find(|p| used.binary_search(p).is_err()) {
            return Err(wrong(format!("point {p} belongs to no cell")));
        }
        let elements = Elements::of_kind(ElementKind::Tetrahedron, elements);
        let types =
            of_body.iter().map(|&p| if kinds[p] == HANDLE { NodeType::Handle } else { NodeType::Body });
        let body = Body {
            positions: of_body.iter().map(|&p| rest[p]).collect(),
            types: types.collect(),
            // Modes of one material depend on Poisson's ratio alone.
            material: vec![Material { young: 1.0, poisson, density: 1.0 }; elements.len()],
            edges: elements.edges(),
            elements,
        };
        body.check().map_err(|e| wrong(e.to_string()))?;
        let obstacle = (!triangles.is_empty()).then(|| Obstacle {
            positions: of_obstacle.iter().map(|&p| rest[p]).collect(),
            triangles: triangles.as_chunks::<3>().0.to_vec(),
        });
        obstacle.iter().try_for_each(|o| o.check(&body)).map_err(|e| wrong(e.to_string()))?;
        let world = frames(arrays, "world_pos", n, path)?.filter(|world| world.shape[2] == 3);
        let world = world.ok_or_else(|| {
            let found = arrays.get("world_pos").map_or("none".into(), |a| format!("{:?}", a.shape));
            wrong(format!(
                "world_pos: expected an array [frames, {n}, 3] of two frames or more, found {found}"
            ))
        })?;
        let dt = interval(arrays, dt, path)?;
        let mut bodies = Bodies { body, obstacle, fields: Vec::new(), world, rest, of_body, of_obstacle, dt };
        for frame in 0..bodies.world.shape[0] {
            let motion = bodies.displacement(frame, &bodies.of_obstacle);
            let rigid = bodies.obstacle.as_ref().map_or(Ok(()), |o| o.check_motion(&motion));
            rigid.map_err(|e| wrong(format!("world_pos: frame {frame}: {e}")))?;
        }
        bodies.fields = bodies.others(arrays, path)?;
        Ok(bodies)
    }

    /// The fields beside the displacement.
    fn others(&self, arrays: &Arrays, path: &Path) -> Result<Vec<(FieldMeta, Array)>> {
        let wrong = |what: String| Err(Error::file(path, what));
        let (mut fields, expected) = (Vec::new(), self.world.shape[0]);
        for name in arrays.keys().filter(|name| !STRUCTURE.contains(&&name[..])) {
            let Some(array) = frames(arrays, name, self.rest.len(), path)? else { continue };
            let meta = match (&name[..], array.shape[2]) {
                ("stress", 1) => {
                    FieldMeta { name: "sigmaEq".into(), vector: false, dimensions: [1, -1, -2, 0, 0, 0, 0] }
                }
                (_, c @ (1 | 3)) => FieldMeta { name: name.clone(), vector: c == 3, dimensions: [0; 7] },
                (_, c) => return wrong(format!("{name} has {c} components, expected 1 or 3")),
            };
            if array.shape[0] != expected {
                return wrong(format!("{name} has {} frames, world_pos {expected}", array.shape[0]));
            }
            fields.push((meta, array));
        }
        Ok(fields)
    }

    /// Displacement of points in a frame, m.
    fn displacement(&self, frame: usize, points: &[usize]) -> Vec<[f32; 3]> {
        let rows = &self.world.data.as_chunks::<3>().0[frame * self.rest.len()..];
        let of = |&p: &usize| std::array::from_fn(|i| (rows[p][i] - self.rest[p][i]) as f32);
        points.iter().map(of).collect()
    }

    /// Writes a trajectory; `from` and `inputs` say what it is made from.
    ///
    /// # Errors
    /// As [`Writer`]'s.
    pub fn write(&self, path: &Path, split: Split, (from, inputs): (&str, &str)) -> Result<()> {
        let d = FieldMeta { name: "D".into(), vector: true, dimensions: [0, 1, 0, 0, 0, 0, 0] };
        let options = WriteOptions {
            fields: std::iter::once(d).chain(self.fields.iter().map(|f| f.0.clone())).collect(),
            provenance: json!({
                "application": "m4gn convert", "from": from, "inputs": inputs, "location": "points",
                "material": "not in the data: E 1 Pa, rho 1 kg/m^3, Poisson's ratio as given",
            }),
            split,
            overwrite: false,
        };
        let mut writer = Writer::create_copy(path, &self.body.mesh(self.obstacle.as_ref()), &options)?;
        for frame in 0..self.world.shape[0] {
            let d = self.displacement(frame, &self.of_body).into_flattened();
            let others = self.fields.iter().map(|(_, array)| {
                let c = array.shape[2];
                let rows = &array.data[frame * self.rest.len() * c..];
                self.of_body.iter().flat_map(|p| &rows[p * c..][..c]).map(|v| *v as f32).collect()
            });
            let values = std::iter::once(d).chain(others);
            let values: Vec<Frame> = values.map(|cells| Frame { cells, boundary: Vec::new() }).collect();
            let time = frame as f64 * self.dt;
            match self.obstacle {
                Some(_) => {
                    writer.append_moved(time, &values, &self.displacement(frame, &self.of_obstacle))?
                }
                None => writer.append(time, &values)?,
            }
        }
        writer.finish()
    }
}

/// Tetrahedra of the body and of the obstacle, the fourth point on the side to which the normal of the others leads.
fn cut(cells: &[[i32; 4]], kinds: &[i32], rest: &[Vector]) -> std::result::Result<[Vec<i32>; 2], String> {
    let mut parts = [Vec::new(), Vec::new()];
    for (i, cell) in cells.iter().enumerate() {
        let of_obstacle = cell.map(|p| kinds[p as usize] == OBSTACLE);
        if of_obstacle.iter().any(|o| *o != of_obstacle[0]) {
            return Err(format!(
                "cell {i} of the points {cell:?} is of both the body and the obstacle (node_type 1)"
            ));
        }
        if let Some(k) = (1..4).find(|&k| cell[..k].contains(&cell[k])) {
            return Err(format!("cell {i} of the points {cell:?} has the point {} twice", cell[k]));
        }
        let volume = ElementKind::Tetrahedron.measure(&cell.map(|p| rest[p as usize]));
        if !(volume != 0.0 && volume.is_finite()) {
            return Err(format!("cell {i} of the points {cell:?} has the volume {volume} m^3"));
        }
        let [a, b, c, d] = *cell;
        parts[usize::from(of_obstacle[0])].extend(if volume > 0.0 { [a, b, c, d] } else { [a, c, b, d] });
    }
    Ok(parts)
}

/// The points of these numbers below n, ascending, and the numbers as places among them.
fn renumbered(numbers: &[i32], n: usize) -> (Vec<usize>, Vec<i32>) {
    let mut place = vec![-1; n];
    numbers.iter().for_each(|&p| place[p as usize] = 0);
    let used: Vec<usize> = (0..n).filter(|&p| place[p] == 0).collect();
    used.iter().zip(0..).for_each(|(&p, own)| place[p] = own);
    let numbers = numbers.iter().map(|&p| place[p as usize]).collect();
    (used, numbers)
}

/// The arrays of a body of tetrahedra, those of DeepMind's data and `obstacle_triangles`: the body's points, then the obstacle's, where
/// fields are 0. None of other bodies.
///
/// # Errors
/// What reading the frames may fail with.
pub fn arrays(trajectory: &Trajectory) -> Result<Option<Arrays>> {
    let tetrahedra = |b: &&Body| b.elements.kind.iter().all(|k| *k == ElementKind::Tetrahedron);
    let Some(body) = trajectory.body().filter(tetrahedra) else { return Ok(None) };
    let (times, n) = (trajectory.times(), body.positions.len());
    let obstacle = trajectory.obstacle();
    let q = obstacle.map_or(0, |o| o.positions.len());
    let mut arrays = with_times(times);
    let mut add = |name: &str, shape: &[usize], data: Vec<f64>| {
        arrays.insert(name.into(), Array { shape: shape.to_vec(), data });
    };
    let rest = [&body.positions[..], obstacle.map_or(&[], |o| &o.positions)].concat();
    add("mesh_pos", &[n + q, 3], rest.as_flattened().to_vec());
    let of_body = body.types.iter().map(|t| if *t == NodeType::Handle { HANDLE } else { NORMAL });
    let kinds = of_body.chain(std::iter::repeat_n(OBSTACLE, q)).map(f64::from);
    add("node_type", &[n + q, 1], kinds.collect());
    add("cells", &[body.elements.len(), 4], body.elements.points.iter().map(|p| f64::from(*p)).collect());
    if let Some(o) = obstacle {
        let triangles = o.triangles.as_flattened().iter().map(|p| (n + *p as usize) as f64);
        add("obstacle_triangles", &[o.triangles.len(), 3], triangles.collect());
    }
    let motion =
        if q > 0 { trajectory.read_motion(0, 1, times.len())? } else { vec![Vec::new(); times.len()] };
    for field in trajectory.fields() {
        let frames = trajectory.recorded_frames(&field.name)?;
        let c = field.components(3);
        let mut rows = Vec::with_capacity(times.len() * (n + q) * c);
        for (frame, motion) in frames.iter().zip(&motion) {
            let own = frame.cells.iter().map(|v| f64::from(*v));
            if field.name != "D" {
                rows.extend(own.chain(std::iter::repeat_n(0.0, q * c)));
                continue;
            }
            let moved = own.chain(motion.as_flattened().iter().map(|v| f64::from(*v)));
            rows.extend(moved.zip(rest.as_flattened()).map(|(d, x)| x + d));
        }
        let name = match &field.name[..] {
            "D" => "world_pos",
            "sigmaEq" => "stress",
            other => other,
        };
        add(name, &[times.len(), n + q, c], rows);
    }
    Ok(Some(arrays))
}
