//! Held displacement components.

use super::mesh::PointMesh;
use super::numbering::Numbering;
use m4gn_base::{Error, Result, refuse_any};
use m4gn_parallel::Comm;

/// Components (x, y, z) of one point's displacement that are held at 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Fixed {
    /// Local point.
    pub point: i32,
    /// Which components are held.
    pub components: [bool; 3],
}

impl Fixed {
    /// All components of a point.
    pub fn all(point: i32) -> Self {
        Fixed { point, components: [true; 3] }
    }
}

/// Held components of this rank's own points, in the order of their numbers, in the order of `mesh.directions`.
///
/// A point is held if any rank that has it says so: the rank that owns a point on a patch's rim may have none of the
/// patch's faces. Collective; all ranks fail together.
pub(super) fn held(
    mesh: &PointMesh,
    fixed: &[Fixed],
    representative: &[Option<usize>],
    free_body: bool,
    numbering: &Numbering,
    comm: &Comm,
) -> Result<Vec<[bool; 3]>> {
    let dim = mesh.dim();
    let bad = fixed.iter().find(|f| !usize::try_from(f.point).is_ok_and(|p| p < mesh.points.len()));
    comm.agree(refuse_any(bad, Error::Input, |f| {
        format!("fixed point {}: expected 0 to {}", f.point, mesh.points.len() as i64 - 1)
    }))?;
    let (mut numbers, mut flags) = (Vec::new(), Vec::new());
    for f in fixed {
        let point = representative[f.point as usize];
        if let Some(number) = point.and_then(|p| numbering.number[p]) {
            numbers.push(number);
            flags.extend(mesh.directions.iter().map(|&d| f64::from(u8::from(f.components[d]))));
        }
    }
    let sums = numbering.sum_at_owner(comm, &numbers, &flags, dim);
    let held: Vec<[bool; 3]> =
        sums.chunks_exact(dim).map(|s| [0, 1, 2].map(|d| s.get(d).is_some_and(|&v| v > 0.0))).collect();
    let count = comm.total(held.iter().flatten().filter(|h| **h).count());
    let problem = if count == 0 && !free_body {
        Err(Error::Input(
            "no displacement is held on any rank: expected the points of at least one fixed patch (fixedDisplacement, \
             or fixedValue for D); check the patches' names and types, or ask for a free body's modes"
                .into(),
        ))
    } else if count == numbering.total() * dim as i64 {
        Err(Error::Input("all displacements of all points are held: expected a body that can move".into()))
    } else {
        Ok(held)
    };
    comm.agree(problem)
}
