//! Where unknowns are, for rules that look at positions instead of numbers.

use super::problem::Problem;
use crate::mesh::Mesh;
use crate::parallel::Comm;

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

    fn around<'a>(points: impl Iterator<Item = &'a [f64; 3]>, comm: &Comm) -> Self {
        let mut high = [f64::NEG_INFINITY; 6];
        for x in points {
            for d in 0..3 {
                high[d] = high[d].max(x[d]);
                high[3 + d] = high[3 + d].max(-x[d]);
            }
        }
        comm.max_f64(&mut high);
        Extent {
            low: [-high[3], -high[4], -high[5]],
            high: [high[0], high[1], high[2]],
        }
    }
}

/// Positions of this rank's points, or their numbers in place of positions.
pub(super) struct Frame<'a> {
    /// One a point; none: the point's number among all is its position.
    pub positions: &'a [[f64; 3]],
    /// Axes that count.
    pub axes: Vec<usize>,
    /// Box around all points.
    pub extent: Extent,
    /// Number of this rank's first point.
    pub first: usize,
}

impl<'a> Frame<'a> {
    /// Collective.
    pub fn of(problem: &'a Problem, comm: &Comm) -> Self {
        let points = problem.stiffness.n() / problem.block.max(1);
        let first = comm.exclusive_scan_i64(points as i64) as usize;
        let mut given = [problem.positions.len() as i64, points as i64];
        comm.sum_i64(&mut given);
        if given[0] == 0 {
            let high = [given[1] as f64, 0.0, 0.0];
            return Frame {
                positions: &[],
                axes: vec![0],
                extent: Extent { low: [0.0; 3], high },
                first,
            };
        }
        Frame {
            positions: &problem.positions,
            axes: vec![0, 1, 2],
            extent: Extent::around(problem.positions.iter(), comm),
            first,
        }
    }

    /// Position of this rank's point `i`.
    pub fn position(&self, i: usize) -> [f64; 3] {
        match self.positions.is_empty() {
            true => [(self.first + i) as f64 + 0.5, 0.0, 0.0],
            false => self.positions[i],
        }
    }
}
