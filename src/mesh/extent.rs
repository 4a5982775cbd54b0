//! The box around a mesh.

use crate::Mesh;
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
        let mut high = [f64::NEG_INFINITY; 6];
        for x in points {
            for d in 0..3 {
                high[d] = high[d].max(x[d]);
                high[3 + d] = high[3 + d].max(-x[d]);
            }
        }
        comm.max_f64(&mut high);
        Extent { low: [-high[3], -high[4], -high[5]], high: [high[0], high[1], high[2]] }
    }
}
