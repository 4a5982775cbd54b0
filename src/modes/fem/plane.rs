//! 2-D: the polygons of a mesh that is one cell thick.

use super::mesh::{Cell, PointMesh};
use m4gn_base::{Error, Result};
use m4gn_mesh::vector::{cross, sub};

/// A 2-D mesh seen from the third direction.
pub(super) struct Section {
    /// For each point the local point of its pair, front and back, that has the lower global number.
    pub twin: Vec<Option<usize>>,
    /// The polygons, of points that are their own twin.
    pub cells: Vec<Cell>,
}

/// The polygons of a mesh with two solved directions.
///
/// Each cell has two faces whose normals point mostly along the third direction (those on `empty` patches); the
/// edges between the two faces pair the points.
pub(super) fn section(mesh: &PointMesh) -> Result<Section> {
    let (i, j) = (mesh.directions[0], mesh.directions[1]);
    let third = 3 - i - j;
    let mut twin: Vec<Option<usize>> = vec![None; mesh.points.len()];
    let mut pair = |a: usize, b: usize| -> Result<()> {
        let low = if mesh.point_global[a] < mesh.point_global[b] { a } else { b };
        for p in [a, b] {
            if twin[p].is_some_and(|t| t != low) {
                return Err(Error::Mesh(format!(
                    "point {p} is joined with more than one point across the third direction: a 2-D mesh must be \
                     one cell thick; run checkMesh"
                )));
            }
            twin[p] = Some(low);
        }
        Ok(())
    };
    let mut fronts = Vec::with_capacity(mesh.n_cells);
    for (cell, faces) in mesh.cell_faces().into_iter().enumerate() {
        let across: Vec<(usize, bool)> = faces
            .iter()
            .copied()
            .filter(|&(f, _)| {
                let n = area(mesh, f);
                n[third].abs() > n[i].abs().max(n[j].abs())
            })
            .collect();
        let [front, back] = across[..] else {
            return Err(Error::Mesh(format!(
                "cell {cell} has {} faces across the third direction ({}): expected 2, as every cell between empty \
                 patches has; for a 3-D mesh give three directions",
                across.len(),
                ["x", "y", "z"][third]
            )));
        };
        let (front_points, back_points) = (mesh.face(front.0), mesh.face(back.0));
        if front_points.len() != back_points.len() {
            return Err(Error::Mesh(format!(
                "cell {cell} has {} points in front and {} at the back: a 2-D mesh must be one cell thick",
                front_points.len(),
                back_points.len()
            )));
        }
        for &(f, _) in faces.iter().filter(|&&(f, _)| f != front.0 && f != back.0) {
            let points = mesh.face(f);
            for (k, &a) in points.iter().enumerate() {
                let b = points[(k + 1) % points.len()];
                if front_points.contains(&a) && back_points.contains(&b)
                    || front_points.contains(&b) && back_points.contains(&a)
                {
                    pair(a as usize, b as usize)?;
                }
            }
        }
        fronts.push(front.0);
    }
    let mut cells = Vec::with_capacity(mesh.n_cells);
    for (cell, front) in fronts.into_iter().enumerate() {
        let twins: Option<Vec<usize>> = mesh.face(front).iter().map(|&p| twin[p as usize]).collect();
        let Some(mut points) = twins else {
            return Err(Error::Mesh(format!(
                "cell {cell} has points that no edge joins across the third direction: a 2-D mesh must be one cell \
                 thick; run checkMesh"
            )));
        };
        if signed_area(mesh, &points, i, j) < 0.0 {
            points.reverse();
        }
        let n = points.len();
        cells.push(Cell { points, faces: (0..n).map(|k| vec![k, (k + 1) % n]).collect() });
    }
    Ok(Section { twin, cells })
}

/// Area vector of a face, m^2.
fn area(mesh: &PointMesh, f: usize) -> [f64; 3] {
    let x: Vec<[f64; 3]> = mesh.face(f).iter().map(|&p| mesh.points[p as usize]).collect();
    let triangle = |side: &[[f64; 3]]| cross(sub(side[0], x[0]), sub(side[1], x[0]));
    x[1..].windows(2).map(triangle).fold([0.0; 3], |sum, n| [0, 1, 2].map(|d| sum[d] + 0.5 * n[d]))
}

fn signed_area(mesh: &PointMesh, points: &[usize], i: usize, j: usize) -> f64 {
    let n = points.len();
    (0..n)
        .map(|k| {
            let (a, b) = (mesh.points[points[k]], mesh.points[points[(k + 1) % n]]);
            0.5 * (a[i] * b[j] - a[j] * b[i])
        })
        .sum()
}
