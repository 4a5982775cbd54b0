//! Is a mesh by points whole? What later code relies on is checked here, with the place named.

use super::mesh::PointMesh;
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_mesh::check::{directions, finite, length};

/// Everything that one rank can see.
pub(super) fn local(mesh: &PointMesh) -> Result<()> {
    let limit = i32::MAX as usize / 4;
    let sizes = [mesh.points.len(), mesh.face_points.len(), mesh.n_cells, mesh.n_faces()];
    refuse_any(sizes.into_iter().find(|&n| n > limit), Error::Mesh, |n| {
        format!("{n} points, faces or cells on one rank: at most {limit}; use more ranks")
    })?;
    directions(&mesh.directions, 2)?;
    length("point_global", mesh.point_global.len(), "points", mesh.points.len())?;
    mesh.points.iter().enumerate().try_for_each(|(p, x)| finite("points", p, x))?;
    faces(mesh)?;
    cells(mesh)
}

fn faces(mesh: &PointMesh) -> Result<()> {
    let (n, n_points) = (mesh.n_faces(), mesh.points.len());
    if mesh.face_start.len() != n + 1 || mesh.face_start.first() != Some(&0) {
        return Err(Error::Mesh(format!(
            "face_start has {} entries and starts at {:?}: expected {} and 0",
            mesh.face_start.len(),
            mesh.face_start.first(),
            n + 1
        )));
    }
    refuse(mesh.face_neighbour.len() > n, Error::Mesh, || {
        format!("face_neighbour has {} entries, but there are {n} faces", mesh.face_neighbour.len())
    })?;
    if let Some(f) =
        (0..n).find(|&f| mesh.face_start[f + 1].checked_sub(mesh.face_start[f]).is_none_or(|n| n < 3))
    {
        return Err(Error::Mesh(format!(
            "face {f} has {} points (face_start): expected at least 3",
            i64::from(mesh.face_start[f + 1]) - i64::from(mesh.face_start[f])
        )));
    }
    if mesh.face_start[n] as usize != mesh.face_points.len() {
        return Err(Error::Mesh(format!(
            "face_start ends at {}, but face_points has {} entries",
            mesh.face_start[n],
            mesh.face_points.len()
        )));
    }
    for f in 0..n {
        let points = mesh.face(f);
        for (i, &p) in points.iter().enumerate() {
            refuse(!usize::try_from(p).is_ok_and(|p| p < n_points), Error::Mesh, || {
                format!("face {f} names point {p}: expected 0 to {}", n_points as i64 - 1)
            })?;
            refuse(points[..i].contains(&p), Error::Mesh, || format!("face {f} names point {p} twice"))?;
        }
        let sides = [Some(mesh.face_owner[f]), mesh.face_neighbour.get(f).copied()];
        for cell in sides.into_iter().flatten() {
            refuse(!usize::try_from(cell).is_ok_and(|c| c < mesh.n_cells), Error::Mesh, || {
                format!("face {f} names cell {cell}: expected 0 to {}", mesh.n_cells as i64 - 1)
            })?;
        }
        if sides[0] == sides[1] {
            return Err(Error::Mesh(format!("face {f} has cell {} on both sides", mesh.face_owner[f])));
        }
    }
    Ok(())
}

/// Each edge of a closed surface lies between two faces that pass it in opposite directions.
fn cells(mesh: &PointMesh) -> Result<()> {
    let mut edges: Vec<(i32, i32, bool)> = Vec::new();
    for (cell, faces) in mesh.cell_faces().into_iter().enumerate() {
        if faces.len() < 4 {
            return Err(Error::Mesh(format!("cell {cell} has {} faces: expected at least 4", faces.len())));
        }
        edges.clear();
        for (f, outward) in faces {
            let points = mesh.face(f);
            for (i, &a) in points.iter().enumerate() {
                let b = points[(i + 1) % points.len()];
                edges.push((a.min(b), a.max(b), (a < b) == outward));
            }
        }
        edges.sort_unstable();
        for edge in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
            let (a, b, _) = edge[0];
            if edge.len() != 2 {
                return Err(Error::Mesh(format!(
                    "cell {cell} is not a closed surface: the edge of points {a} and {b} belongs to {} of its faces, \
                     expected 2; run checkMesh",
                    edge.len()
                )));
            }
            if edge[0].2 == edge[1].2 {
                return Err(Error::Mesh(format!(
                    "cell {cell}: the two faces at the edge of points {a} and {b} do not turn the same way; expected \
                     normals that leave the owner; run checkMesh"
                )));
            }
        }
    }
    Ok(())
}
