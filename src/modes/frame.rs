//! Where unknowns are, for rules that look at positions instead of numbers.

use super::problem::Problem;
use m4gn_mesh::Extent;
use m4gn_parallel::Comm;

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
            return Frame { positions: &[], axes: vec![0], extent: Extent { low: [0.0; 3], high }, first };
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
