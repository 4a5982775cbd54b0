//! Trajectories of m4gn as files that other programs read.

use super::{bodies, npz, points};
use m4gn_base::{Error, Result};
use m4gn_data::Trajectory;
use m4gn_mesh::vector::moved;
use m4gn_report::{Grid, series, write_file};
use std::path::Path;

/// Writes the arrays of [`bodies::arrays`] or [`points::arrays`] as a NumPy archive.
///
/// # Errors
/// When a frame cannot be read, or the file cannot be written.
pub fn to_npz(trajectory: &Trajectory, path: &Path) -> Result<()> {
    let whole = ["cells", "node_type", "boundary_owner", "boundary_type", "obstacle_triangles"];
    let arrays = match bodies::arrays(trajectory)? {
        Some(arrays) => arrays,
        None => points::arrays(trajectory)?,
    };
    npz::write(path, &arrays, &whole)
}

/// Writes a series for ParaView: `NAME.pvd`, and beside it `NAME_0000.vtu` and so on, a frame each with all fields at the nodes (and, of triangles, their `node_type`): over the
/// triangles or the elements of which they are points (moved by a body's `D`), or as points alone.
///
/// # Errors
/// As [`to_npz`].
pub fn to_vtu(trajectory: &Trajectory, path: &Path) -> Result<()> {
    let mesh = trajectory.mesh();
    let grid = match (trajectory.body(), trajectory.triangles()) {
        (Some(body), _) => Grid::of_elements(&body.elements),
        (None, []) => Grid::of_points(mesh.cell_centres.len()),
        (None, triangles) => Grid::of_triangles(triangles),
    };
    let frames = trajectory.fields().iter().map(|f| Ok((f, trajectory.recorded_frames(&f.name)?)));
    let fields: Vec<_> = frames.collect::<Result<_>>()?;
    let kinds = if trajectory.triangles().is_empty() { vec![] } else { points::node_types(mesh) };
    let times: Vec<_> = trajectory.times().iter().copied().enumerate().collect();
    if times.is_empty() {
        return Err(Error::file(trajectory.path(), "has no frame"));
    }
    for (i, file) in series::begin(path, &times)?.into_iter().enumerate() {
        let values = fields.iter().map(|(field, frames)| {
            let cells: Vec<f64> = frames[i].cells.iter().map(|v| f64::from(*v)).collect();
            if !field.vector {
                return (&field.name[..], 1, cells);
            }
            let mut rows = vec![[0.0; 3]; mesh.cell_centres.len()];
            for (row, value) in rows.iter_mut().zip(cells.chunks_exact(mesh.dim())) {
                mesh.directions.iter().zip(value).for_each(|(&d, v)| row[d] = *v);
            }
            (&field.name[..], 3, rows.into_flattened())
        });
        let values: Vec<(&str, usize, Vec<f64>)> = values.collect();
        let displacement = trajectory.body().and(values.iter().find(|v| v.0 == "D"));
        let places = match displacement {
            Some((_, _, d)) => moved(&mesh.cell_centres, d.as_chunks::<3>().0),
            None => mesh.cell_centres.clone(),
        };
        let kinds = (!kinds.is_empty()).then_some(("node_type", 1, &kinds[..]));
        let shown: Vec<_> = values.iter().map(|(name, c, v)| (*name, *c, &v[..])).chain(kinds).collect();
        write_file(&file, grid.vtu(&places, &shown)?.as_bytes())?;
    }
    Ok(())
}
