//! The box around a mesh.

use crate::Mesh;
use crate::vector::bounds;
use m4gn_parallel::Comm;

/// Box around all cell centres and boundary face centres, over all ranks, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Lowest coordinates.
    pub low: [f64; 3],
    /// Highest coordinates.
    pub high: [f64; 3],
}

impl Extent {
    /// The box of this mesh. Collective; exact, so the same on any number of ranks.
    pub fn of(mesh: &Mesh, comm: &Comm) -> Self {
        let faces = mesh.boundary.iter().map(|b| &b.centre);
        Self::around(mesh.cell_centres.iter().chain(faces), comm)
    }

    /// The box around all ranks' points. Collective.
    pub fn around<'a>(points: impl Iterator<Item = &'a [f64; 3]>, comm: &Comm) -> Self {
        let [low, high] = bounds(points.copied());
        let mut sides = [high, low.map(|x| -x)];
        comm.max_f64(sides.as_flattened_mut());
        Extent { low: sides[1].map(|x| -x), high: sides[0] }
    }
}
