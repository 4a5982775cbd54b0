//! Distance to the obstacle: the feature of SLIC-MDOD_l and SLIC-MDOD_e (eq. 14).

use m4gn_base::{Error, Result};
use m4gn_mesh::Extent;
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::{BoundaryFace, Mesh, NodeType};
use m4gn_model::{SegmentMethod, SegmentSpec};
use m4gn_parallel::{Comm, everywhere};
use std::collections::BTreeSet;

/// Distances count as at least this fraction of S: the logarithm of zero is not a feature.
const LEAST: f64 = 1e-6;

/// Shortest distance from each of this rank's cell centres to a face centre of the obstacle, in the solved
/// directions, m. Collective; exact, so the same on any number of ranks.
///
/// The obstacle is what [`SegmentSpec::obstacles`] says. Cyclics are not looked through.
///
/// # Errors
/// [`Error::Input`] if no face is of the obstacle.
pub fn obstacle_distance(mesh: &Mesh, obstacles: &[String], comm: &Comm) -> Result<Vec<f64>> {
    let solved = |x: &[f64; 3]| [0, 1, 2].map(|d| if mesh.directions.contains(&d) { x[d] } else { 0.0 });
    let faces = obstacle_faces(mesh, obstacles, comm)?;
    let own: Vec<f64> = faces.iter().flat_map(|b| solved(&b.centre)).collect();
    let all = everywhere(comm, &own);
    let tree = Nearest::new(all.as_chunks::<3>().0);
    Ok(mesh.cell_centres.iter().map(|x| tree.distance_squared(solved(x)).sqrt()).collect())
}

/// The feature f^obs of each of this rank's cells, m: S log(d/l) or S exp(-d/l), with l the spec's
/// `distance_scale` or S, so that a change by a factor e of the distance, or by one length l at the obstacle, counts
/// about as one cluster size. With `distance_scale` 0 log d and exp(-d), d in metres. Empty for the other methods.
/// Collective.
pub(super) fn feature(mesh: &Mesh, spec: &SegmentSpec, size: f64, comm: &Comm) -> Result<Vec<f64>> {
    if !spec.method.uses_obstacle() {
        return Ok(Vec::new());
    }
    let (factor, length) = match spec.distance_scale {
        None => (size, size),
        Some(0.0) => (1.0, 1.0),
        Some(length) => (size, length),
    };
    let of = |d: f64| {
        let d = d.max(LEAST * size) / length;
        factor
            * match spec.method {
                SegmentMethod::SlicLog => d.ln(),
                _ => (-d).exp(),
            }
    };
    let distances = obstacle_distance(mesh, &spec.obstacles, comm)?;
    Ok(distances.into_iter().map(of).collect())
}

/// This rank's faces of the obstacle. Collective.
fn obstacle_faces<'a>(mesh: &'a Mesh, obstacles: &[String], comm: &Comm) -> Result<Vec<&'a BoundaryFace>> {
    let patch = |b: &BoundaryFace| mesh.patches[b.patch as usize].as_str();
    let found = |faces: Vec<&'a BoundaryFace>| {
        let mut count = [faces.len() as i64];
        comm.sum_i64(&mut count);
        (count[0] > 0).then_some(faces)
    };
    let all = |wanted: &dyn Fn(&BoundaryFace) -> bool| mesh.boundary.iter().filter(|b| wanted(b)).collect();
    if !obstacles.is_empty() {
        return match found(all(&|b| obstacles.iter().any(|name| name == patch(b)))) {
            Some(faces) => Ok(faces),
            None => Err(Error::Input(format!(
                "no face belongs to the obstacle {}: expected some of the patches {}",
                obstacles.join(", "),
                names(comm, mesh.boundary.iter().map(patch))
            ))),
        };
    }
    if let Some(faces) = found(all(&|b| b.kind == NodeType::Obstacle)) {
        return Ok(faces);
    }
    let extent = Extent::of(mesh, comm);
    let is_wall = |b: &BoundaryFace| b.kind == NodeType::Wall;
    let at_box = |b: &BoundaryFace| {
        mesh.directions.iter().any(|&d| {
            let (low, high) = (extent.low[d], extent.high[d]);
            (b.centre[d] - low).min(high - b.centre[d]) <= 1e-9 * (high - low)
        })
    };
    let outer = union(comm, mesh.boundary.iter().filter(|b| is_wall(b) && at_box(b)).map(patch));
    if let Some(faces) = found(all(&|b| is_wall(b) && !outer.contains(patch(b)))) {
        return Ok(faces);
    }
    found(all(&is_wall)).ok_or_else(|| {
        Error::Input(format!(
            "the mesh has no obstacle to take distances from: expected boundary faces of node type obstacle or wall, \
             found {}; name the obstacle's patches, or choose the method slic-md or metis",
            names(comm, mesh.boundary.iter().map(|b| b.kind.name()))
        ))
    })
}

/// The different words of all ranks. Collective.
fn union<'a>(comm: &Comm, words: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    let own: BTreeSet<&str> = words.collect();
    let bytes: Vec<u8> = own.iter().flat_map(|w| w.bytes().chain([0])).collect();
    let all = String::from_utf8_lossy(&everywhere(comm, &bytes)).into_owned();
    all.split_terminator('\0').map(str::to_string).collect()
}

/// As [`union`], for a message.
fn names<'a>(comm: &Comm, words: impl Iterator<Item = &'a str>) -> String {
    let all = union(comm, words);
    match all.is_empty() {
        true => "none".into(),
        false => all.into_iter().collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    fn distances(mesh: &Mesh, obstacles: &[&str]) -> Result<Vec<f64>> {
        let names: Vec<String> = obstacles.iter().map(|n| n.to_string()).collect();
        obstacle_distance(mesh, &names, &Comm::serial())
    }

    /// Four unit cells in a row with inlet, outlet and walls all around.
    fn row() -> Mesh {
        sample::rectangle(4, 1, 4.0, 1.0)
    }

    #[test]
    fn named_patches_then_obstacles_then_walls() {
        let mut mesh = row();
        // Inlet at (0, 0.5), cells at (0.5, 0.5) and on.
        assert_eq!(distances(&mesh, &["inlet"]).unwrap(), [0.5, 1.5, 2.5, 3.5]);
        assert_eq!(distances(&mesh, &[]).unwrap(), [0.5; 4]);
        let message = distances(&mesh, &["cylinder"]).unwrap_err().to_string();
        assert!(message.contains("cylinder: expected some of the patches inlet, outlet, walls"), "{message}");
        let outlet = mesh.boundary.iter_mut().find(|b| b.patch == 1);
        outlet.unwrap().kind = NodeType::Obstacle;
        assert_eq!(distances(&mesh, &[]).unwrap(), [3.5, 2.5, 1.5, 0.5]);
    }

    #[test]
    fn walls_inside_the_box_are_the_obstacle() {
        // 3 x 3 grid whose middle cell is cut out: faces of the hole are a patch of their own.
        let mut mesh = sample::rectangle(3, 3, 3.0, 3.0);
        mesh.patches.push("hole".into());
        let face = mesh.boundary[0].clone();
        for centre in [[1.0, 1.5, 0.0], [2.0, 1.5, 0.0], [1.5, 1.0, 0.0], [1.5, 2.0, 0.0]] {
            mesh.boundary.push(BoundaryFace {
                centre,
                kind: NodeType::Wall,
                patch: 3,
                global: mesh.boundary.len() as i64,
                ..face.clone()
            });
        }
        let found = distances(&mesh, &[]).unwrap();
        let corner = 0.5f64.hypot(1.0);
        assert_eq!(found[..3], [corner, 0.5, corner]);
    }

    #[test]
    fn a_mesh_without_walls_is_refused_by_its_node_types() {
        let mesh = sample::chain(4, 4.0);
        let message = distances(&mesh, &[]).unwrap_err().to_string();
        assert!(message.contains("found inlet, outlet"), "{message}");
    }

    #[test]
    fn features_on_paper() {
        let mesh = row();
        let comm = Comm::serial();
        let of = |method, distance_scale| {
            let spec =
                SegmentSpec { method, distance_scale, obstacles: vec!["inlet".into()], ..Default::default() };
            feature(&mesh, &spec, 2.0, &comm).unwrap()
        };
        assert!(of(SegmentMethod::Slic, None).is_empty());
        assert_eq!(of(SegmentMethod::SlicLog, None)[1], 2.0 * 0.75f64.ln());
        assert_eq!(of(SegmentMethod::SlicExp, None)[1], 2.0 * (-0.75f64).exp());
        assert_eq!(of(SegmentMethod::SlicExp, Some(0.5))[1], 2.0 * (-3.0f64).exp());
        assert_eq!(of(SegmentMethod::SlicLog, Some(0.0))[1], 1.5f64.ln());
        assert_eq!(of(SegmentMethod::SlicExp, Some(0.0))[1], (-1.5f64).exp());
    }

    #[test]
    fn the_logarithm_at_the_obstacle_itself_is_finite() {
        let mut mesh = row();
        mesh.boundary[0].centre = mesh.cell_centres[0];
        let spec = SegmentSpec {
            method: SegmentMethod::SlicLog,
            obstacles: vec!["inlet".into()],
            ..Default::default()
        };
        let found = feature(&mesh, &spec, 2.0, &Comm::serial()).unwrap();
        assert!((found[0] - 2.0 * 1e-6f64.ln()).abs() < 1e-9, "{found:?}");
    }
}
