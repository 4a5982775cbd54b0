//! Trajectories at the points of triangles (DeepMind's CylinderFlow and airfoil) as m4gn's, and back.
//!
//! Points become nodes in the place of cells: a point has a third of the area of each of its
//! triangles (times 1 m), an edge the coefficient that finite elements give it on triangles of equal sides. A point that is not of type
//! `normal` is a boundary face as well, at its own place, with the outward area of half of its boundary edges.

use super::array::{Array, Arrays};
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_data::{FieldMeta, Frame, Split, Trajectory, WriteOptions, Writer};
use m4gn_mesh::vector::{Vector, dot, norm, sub};
use m4gn_mesh::{BoundaryFace, Mesh, NodeType};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// Codes of node types in these data, the patches that they become, and what they are. 0 is `normal`, 3 `handle` of a body.
const TYPES: [(i32, &str, NodeType); 5] = [
    (1, "obstacle", NodeType::Obstacle),
    (2, "airfoil", NodeType::Obstacle),
    (4, "inflow", NodeType::Inlet),
    (5, "outflow", NodeType::Outlet),
    (6, "wall", NodeType::Wall),
];

/// Names of fields in these data and here, and their dimensions: a pressure is over the density where there is no field of that.
const FIELDS: [(&str, &str, [i32; 7]); 3] = [
    ("velocity", "U", [0, 1, -1, 0, 0, 0, 0]),
    ("pressure", "p", [0, 2, -2, 0, 0, 0, 0]),
    ("density", "rho", [1, -3, 0, 0, 0, 0, 0]),
];

/// A trajectory that was read.
#[derive(Clone, Debug)]
pub struct Points {
    /// Points for cells, edges for faces.
    pub mesh: Mesh,
    /// Of the points.
    pub triangles: Vec<[i32; 3]>,
    /// Names as here, with their values in all frames.
    fields: Vec<(FieldMeta, Array)>,
    /// Time between frames, s.
    dt: f64,
    /// Points of the boundary.
    boundary: Vec<usize>,
}

impl Points {
    /// Makes sense of a trajectory's arrays: `mesh_pos` (or `pos`), `cells` (or `faces`), `node_type`, and a field for each array that has
    /// a row a point in each of two or more frames. `dt` is the time between frames where the arrays do not say it.
    ///
    /// # Errors
    /// [`Error::File`] naming the array of `path` that is missing or does not fit.
    pub fn new(arrays: &Arrays, dt: Option<f64>, path: &Path) -> Result<Self> {
        let wrong = |what: String| Error::file(path, what);
        let (places, cells, kinds) = structure(arrays, 2, 3, path)?;
        let positions: Vec<Vector> = places.as_chunks().0.iter().map(|[x, y]| [*x, *y, 0.0]).collect();
        let (n, triangles) = (positions.len(), cells.as_chunks().0.to_vec());
        let (mesh, boundary) = mesh(&positions, &triangles, &kinds).map_err(|e| wrong(e.to_string()))?;
        let dt = interval(arrays, dt, path)?;
        let mut points = Points { mesh, triangles, fields: Vec::new(), dt, boundary };
        for name in arrays.keys().filter(|name| !STRUCTURE.contains(&&name[..])) {
            let Some(values) = frames(arrays, name, n, path)? else { continue };
            let c = values.shape[2];
            refuse(c > 2, wrong, || format!("{name} has {c} components, expected 1 or 2"))?;
            let known = FIELDS.iter().find(|f| f.0 == name || f.1 == name);
            let (own, mut dimensions) = known.map_or((&name[..], [0; 7]), |f| (f.1, f.2));
            if own == "p" && arrays.contains_key("density") {
                dimensions = [1, -1, -2, 0, 0, 0, 0];
            }
            points.fields.push((FieldMeta { name: own.into(), vector: c == 2, dimensions }, values));
        }
        let frames = points.frames();
        refuse_any(points.fields.iter().find(|f| f.1.shape[0] != frames), wrong, |(meta, other)| {
            format!("{} has {} frames, another field {frames}", meta.name, other.shape[0])
        })?;
        match points.fields.is_empty() {
            true => {
                Err(wrong(format!("no array has a row for each of the {n} points in two or more frames")))
            }
            false => Ok(points),
        }
    }

    /// Number of frames.
    pub fn frames(&self) -> usize {
        self.fields.first().map_or(0, |f| f.1.shape[0])
    }

    /// Writes a trajectory; `from` and `inputs` say what it is made from.
    ///
    /// # Errors
    /// As [`Writer`]'s.
    pub fn write(&self, path: &Path, split: Split, (from, inputs): (&str, &str)) -> Result<()> {
        let options = WriteOptions {
            fields: self.fields.iter().map(|f| f.0.clone()).collect(),
            provenance: json!({ "application": "m4gn convert", "from": from, "inputs": inputs, "location": "points" }),
            split,
            overwrite: false,
        };
        let mut writer = Writer::create_copy(path, &self.mesh, &options)?;
        writer.set_triangles(&self.triangles)?;
        for frame in 0..self.frames() {
            let values = self.fields.iter().map(|(meta, array)| {
                let c = meta.components(2);
                let row = self.mesh.n_cells() * c;
                let cells: Vec<f32> = array.data[frame * row..][..row].iter().map(|v| *v as f32).collect();
                let boundary = self.boundary.iter().flat_map(|p| &cells[p * c..][..c]).copied().collect();
                Frame { cells, boundary }
            });
            writer.append(frame as f64 * self.dt, &values.collect::<Vec<_>>())?;
        }
        writer.finish()
    }
}

/// Arrays that are no fields.
pub(super) const STRUCTURE: [&str; 5] = ["mesh_pos", "pos", "cells", "faces", "node_type"];

/// Places at rest of `dim` numbers a point, cells of so many corners, and the node types.
pub(super) fn structure<'a>(
    arrays: &'a Arrays,
    dim: usize,
    corners: usize,
    path: &Path,
) -> Result<(&'a [f64], Vec<i32>, Vec<i32>)> {
    let wrong = |what: String| Error::file(path, what);
    let (name, places) = named(arrays, &["mesh_pos", "pos"], path)?;
    let places = places.fixed(name, dim, path)?;
    refuse_any(places.iter().position(|v| !v.is_finite()), wrong, |i| {
        format!("{name}: value {i} is {}, expected a finite number", places[i])
    })?;
    let n = places.len() / dim;
    let (name, cells) = named(arrays, &["cells", "faces"], path)?;
    let cells = cells.labels(name, corners, n, path)?;
    let (name, kinds) = named(arrays, &["node_type"], path)?;
    let kinds = kinds.labels(name, 1, 10, path)?;
    refuse(kinds.len() != n, wrong, || format!("{name} has {} points, expected {n}", kinds.len()))?;
    Ok((places, cells, kinds))
}

/// An array with a row a point in each of two or more frames, as `[frames, points, components]`; none of a single number, and of times.
pub(super) fn frames(arrays: &Arrays, name: &str, n: usize, path: &Path) -> Result<Option<Array>> {
    let Some(array) = arrays.get(name) else { return Ok(None) };
    let c = match array.shape[..] {
        [frames, rows] if frames > 1 && rows == n => 1,
        [frames, rows, c] if frames > 1 && rows == n && c > 0 => c,
        // A single number is a parameter.
        _ if array.data.len() == 1 || ["dt", "times"].contains(&name) => return Ok(None),
        _ => {
            let what = format!(
                "{name} has shape {:?}, expected [frames, {n}, components] with two frames or more, as all that is no mesh is a field: \
                 bring it into this shape, or take it out",
                array.shape
            );
            return Err(Error::file(path, what));
        }
    };
    let wrong = |what: String| Error::file(path, what);
    refuse_any(array.data.iter().position(|v| !(*v as f32).is_finite()), wrong, |i| {
        format!("{name}: frame {} holds {}", i / (n * c), array.data[i])
    })?;
    Ok(Some(Array { shape: vec![array.shape[0], n, c], data: array.data.clone() }))
}

/// The first of these arrays that is there, with its name.
fn named<'a>(arrays: &'a Arrays, names: &[&'static str], path: &Path) -> Result<(&'static str, &'a Array)> {
    let found = names.iter().find_map(|name| Some((*name, arrays.get(*name)?)));
    found.ok_or_else(|| {
        let there: Vec<&str> = arrays.keys().map(String::as_str).collect();
        Error::file(path, format!("no array {}; found {}", names.join(" or "), there.join(", ")))
    })
}

/// Time between frames, s: what the arrays say, which `dt` must not contradict, else `dt`. That of a quasi-static data set is 0.
pub(super) fn interval(arrays: &Arrays, dt: Option<f64>, path: &Path) -> Result<f64> {
    let positive = |dt: &f64| dt.is_finite() && *dt > 0.0;
    let mut between = None;
    if let Some(Array { data: times, .. }) = arrays.get("times")
        && let [first, .., last] = times[..]
    {
        let step = (last - first) / (times.len() - 1) as f64;
        // Archives have them in single precision, and late ones have few digits behind the point.
        let slack = 1e-3 * step + 2.0 * f64::from(f32::EPSILON) * last.abs();
        let off = |&(i, t): &(usize, &f64)| (t - first - i as f64 * step).abs() > slack;
        if let Some((i, t)) = times.iter().enumerate().find(off) {
            return Err(Error::file(path, format!("times: value {i} is {t} s: expected equal distances")));
        }
        between = Some(step);
    }
    let said = arrays.get("dt").and_then(|a| a.data.first()).copied();
    let said = [said, between].into_iter().flatten().find(positive);
    let wrong = |what: String| Error::file(path, what);
    // That of an archive is in single precision.
    refuse_any(said.zip(dt).filter(|(said, dt)| (said - dt).abs() > 1e-3 * said), wrong, |(said, dt)| {
        format!("it says that the time between frames is {said} s, and --dt is {dt}: leave --dt out")
    })?;
    let dt = said.or(dt.filter(positive)).ok_or_else(|| {
        wrong(
            "it does not say the time between frames (dt, or times, s): give a positive one with --dt".into(),
        )
    })?;
    // 0.01 in single precision is meant as 0.01.
    let short = Some(dt as f32).filter(|short| f64::from(*short) == dt);
    Ok(short.and_then(|short| short.to_string().parse().ok()).unwrap_or(dt))
}

/// `times`, and `dt` of two or more.
pub(super) fn with_times(times: &[f64]) -> Arrays {
    let mut arrays =
        Arrays::from([("times".into(), Array { shape: vec![times.len()], data: times.to_vec() })]);
    if let Some((dt, _)) = m4gn_data::interval(times) {
        arrays.insert("dt".into(), Array { shape: Vec::new(), data: vec![dt] });
    }
    arrays
}

/// The lumped mesh, and the point of each of its boundary faces.
fn mesh(positions: &[Vector], triangles: &[[i32; 3]], kinds: &[i32]) -> Result<(Mesh, Vec<usize>)> {
    let n = positions.len();
    let (mut volumes, mut areas) = (vec![0.0; n], vec![[0.0; 3]; n]);
    // Of each edge its coefficient, how many triangles have it, and the point across it in the last of them
    let mut edges: BTreeMap<[i32; 2], (f64, u32, i32)> = BTreeMap::new();
    for (i, triangle) in triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|p| positions[p as usize]);
        let (u, v) = (sub(b, a), sub(c, a));
        let area = 0.5 * (u[0] * v[1] - u[1] * v[0]).abs();
        refuse(!(area > 0.0 && area.is_finite()), Error::Mesh, || {
            format!("triangle {i} of the points {triangle:?} has the area {area} m^2")
        })?;
        for k in 0..3 {
            let [p, q, across] = [0, 1, 2].map(|j| triangle[(k + j) % 3]);
            volumes[p as usize] += area / 3.0;
            let along = sub(positions[q as usize], positions[p as usize]);
            let edge = edges.entry([p.min(q), p.max(q)]).or_default();
            *edge = (edge.0 + 2.0 / 3.0 * area / dot(along, along), edge.1 + 1, across);
        }
    }
    if let Some(p) = volumes.iter().position(|v| *v == 0.0) {
        return Err(Error::Mesh(format!("point {p} belongs to no triangle")));
    }
    for ([p, q], (_, _, across)) in edges.iter().filter(|e| e.1.1 == 1) {
        let [a, b, c] = [p, q, across].map(|p| positions[*p as usize]);
        let along = sub(b, a);
        let normal = [along[1], -along[0], 0.0];
        let outward = -dot(normal, sub(c, a)).signum();
        for end in [p, q] {
            (0..2).for_each(|d| areas[*end as usize][d] += 0.5 * outward * normal[d]);
        }
    }
    let mut boundary = Vec::new();
    let mut points = Vec::new();
    for (p, kind) in kinds.iter().enumerate().filter(|k| *k.1 != 0) {
        let patch = TYPES.iter().position(|t| t.0 == *kind).ok_or_else(|| {
            let known = TYPES.map(|t| format!("{} ({})", t.0, t.1)).join(", ");
            Error::Mesh(format!("node_type of point {p} is {kind}, expected 0 (normal), {known}"))
        })?;
        boundary.push(BoundaryFace {
            owner: p as i32,
            global: boundary.len() as i64,
            centre: positions[p],
            area: areas[p],
            coeff: norm(areas[p]).powi(2) / volumes[p],
            kind: TYPES[patch].2,
            patch: patch as i32,
        });
        points.push(p);
    }
    let mesh = Mesh {
        directions: vec![0, 1],
        cell_global: (0..n as i64).collect(),
        cell_centres: positions.to_vec(),
        cell_volumes: volumes,
        face_owner: edges.keys().map(|e| e[0]).collect(),
        face_neighbour: edges.keys().map(|e| e[1]).collect(),
        face_coeff: edges.values().map(|e| e.0).collect(),
        boundary,
        patches: TYPES.map(|t| t.1.to_string()).into(),
        ..Mesh::default()
    };
    Ok((mesh, points))
}

/// Codes of the points of triangles.
pub(crate) fn node_types(mesh: &Mesh) -> Vec<f64> {
    let code = |b: &BoundaryFace| {
        let patch = mesh.patches.get(b.patch as usize);
        TYPES.iter().find(|t| patch.is_some_and(|p| p == t.1)).map_or(b.kind as i32, |t| t.0)
    };
    let mut kinds = vec![0.0; mesh.n_cells()];
    mesh.boundary.iter().for_each(|b| kinds[b.owner as usize] = f64::from(code(b)));
    kinds
}

/// The arrays of a trajectory: at points of triangles those of DeepMind's data, else `cell_centres` with, of each boundary face, its
/// `boundary_owner`, `boundary_type` and values (`boundary_NAME`). Fields are as they were recorded.
///
/// # Errors
/// What reading the frames may fail with.
pub fn arrays(trajectory: &Trajectory) -> Result<Arrays> {
    let mesh = trajectory.mesh();
    let n = mesh.cell_global.len();
    let times = trajectory.times();
    let mut arrays = with_times(times);
    let mut add = |name: &str, shape: &[usize], data: Vec<f64>| {
        arrays.insert(name.into(), Array { shape: shape.to_vec(), data });
    };
    let triangles = trajectory.triangles();
    let at_points = !triangles.is_empty();
    let dim = if at_points { 2 } else { 3 };
    let places = mesh.cell_centres.iter().flat_map(|c| c[..dim].iter().copied());
    add(if at_points { "mesh_pos" } else { "cell_centres" }, &[n, dim], places.collect());
    if at_points {
        add("node_type", &[n, 1], node_types(mesh));
        let cells = triangles.as_flattened().iter().map(|p| f64::from(*p));
        add("cells", &[triangles.len(), 3], cells.collect());
    } else if !mesh.boundary.is_empty() {
        let b = mesh.boundary.len();
        add("boundary_owner", &[b], mesh.boundary.iter().map(|b| f64::from(b.owner)).collect());
        add("boundary_type", &[b], mesh.boundary.iter().map(|b| f64::from(b.kind as i32)).collect());
    }
    for field in trajectory.fields() {
        let frames = trajectory.recorded_frames(&field.name)?;
        let c = field.components(mesh.dim());
        let known = FIELDS.iter().find(|f| at_points && f.1 == field.name);
        let name = known.map_or(&field.name[..], |f| f.0);
        let wide = |part: fn(&Frame) -> &[f32]| frames.iter().flat_map(part).map(|v| f64::from(*v)).collect();
        add(name, &[times.len(), n, c], wide(|f| &f.cells));
        if !at_points && !mesh.boundary.is_empty() {
            add(&format!("boundary_{name}"), &[times.len(), mesh.boundary.len(), c], wide(|f| &f.boundary));
        }
    }
    Ok(arrays)
}
