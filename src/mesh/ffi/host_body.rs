//! A body that deforms, as a host describes it.

use super::host::{MeshData, count, slice, vectors};
use crate::body::{BodyShare, Material, Obstacle};
use crate::elements::ElementKind;
use crate::{Mesh, NodeType};
use m4gn_base::{Error, Result, refuse, refuse_any};

/// The body's points as cells. What they are together is checked when the session is made.
///
/// # Safety
/// The struct's pointers must be what `m4gn.h` says.
pub(super) unsafe fn mesh(data: &MeshData, directions: Vec<usize>, n: usize) -> Result<Mesh> {
    for (name, found) in [
        ("n_faces", data.n_faces),
        ("n_boundary", data.n_boundary),
        ("n_coupled", data.n_coupled),
        ("n_modes", data.n_modes),
    ] {
        if found != 0 {
            return Err(Error::Input(format!(
                "{name} is {found}: expected 0 for a body, whose edges follow from its elements (cell_type is given)"
            )));
        }
    }
    refuse(directions != [0, 1, 2], Error::Input, || {
        format!("directions {directions:?}: expected 0, 1, 2 for a body at points")
    })?;
    // SAFETY: the lengths are those that the header gives for each array; the host keeps them valid for the call.
    unsafe {
        let type_of = |(i, &code): (usize, &i32)| {
            NodeType::from_code(code).map_err(|e| Error::Mesh(format!("cell_type[{i}]: {e}")))
        };
        let types = slice("cell_type", data.cell_type, n)?;
        let count_elements = count("n_elements", data.n_elements)?;
        let kind_of = |(e, &code): (usize, &i32)| {
            ElementKind::from_code(code).map_err(|err| Error::Mesh(format!("element_kind[{e}]: {err}")))
        };
        let kind = slice("element_kind", data.element_kind, count_elements)?;
        let kind: Vec<ElementKind> = kind.iter().enumerate().map(kind_of).collect::<Result<_>>()?;
        let corners = kind.iter().map(|k| k.n_points()).sum();
        let material = vectors("element_material", data.element_material, count_elements)?;
        let material = material.iter().map(|&[young, poisson, density]| Material { young, poisson, density });
        Ok(Mesh {
            directions,
            cell_global: slice("cell_global", data.cell_global, n)?.to_vec(),
            cell_centres: vectors("cell_centres", data.cell_centres, n)?.to_vec(),
            body: Some(BodyShare {
                types: types.iter().enumerate().map(type_of).collect::<Result<_>>()?,
                points: slice("element_points", data.element_points, corners)?.to_vec(),
                material: material.collect(),
                kind,
            }),
            obstacle: obstacle(data)?,
            ..Mesh::default()
        })
    }
}

/// # Safety
/// As [`mesh`].
unsafe fn obstacle(data: &MeshData) -> Result<Option<Obstacle>> {
    let n = count("n_obstacle", data.n_obstacle)?;
    let m = count("n_obstacle_triangles", data.n_obstacle_triangles)?;
    if n == 0 && m == 0 {
        return Ok(None);
    }
    // SAFETY: as in `mesh`.
    let (positions, labels) = unsafe {
        (
            vectors("obstacle_positions", data.obstacle_positions, n)?,
            slice("obstacle_triangles", data.obstacle_triangles, 3 * m)?,
        )
    };
    refuse_any(positions.iter().position(|x| x.iter().any(|v| !v.is_finite())), Error::Mesh, |i| {
        format!("obstacle_positions[{i}] is {:?}: expected finite numbers", positions[i])
    })?;
    refuse_any(labels.iter().position(|&p| p < 0 || p as usize >= n), Error::Mesh, |i| {
        format!("obstacle_triangles[{i}] is {}: expected 0 to {}", labels[i], n as i64 - 1)
    })?;
    Ok(Some(Obstacle { positions: positions.to_vec(), triangles: labels.as_chunks().0.to_vec() }))
}
