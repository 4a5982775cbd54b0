//! Whether cells stay valid, and taking back a correction where they do not.

use crate::dataset::Body;
use crate::solids::{Vector, cross, dot, sub};

/// Part of its rest value that the determinant at a corner of a cell must keep.
const FLOOR: f64 = 0.05;
/// A correction is taken back by this factor at a time.
const BACK: f64 = 0.7;
/// Times at most; then it is taken back wholly.
const ROUNDS: usize = 24;

/// The corners of cells where three edges meet: all but the tips of pyramids.
#[derive(Clone, Debug)]
pub(super) struct Corners {
    corners: Vec<Corner>,
}

#[derive(Clone, Copy, Debug)]
struct Corner {
    cell: usize,
    /// The corner, then the other ends of its edges.
    points: [usize; 4],
    /// Determinant of the edges at rest, m^3.
    rest: f64,
}

impl Corner {
    fn determinant(&self, x: &[Vector]) -> f64 {
        let [a, b, c, d] = self.points.map(|p| x[p]);
        dot(sub(b, a), cross(sub(c, a), sub(d, a)))
    }

    /// Whether a correction turned it inside out, or nearly so, or made worse what was so before.
    fn is_spoiled(&self, before: &[Vector], after: &[Vector]) -> bool {
        if self.points.iter().all(|&p| before[p] == after[p]) {
            return false;
        }
        let sign = self.rest.signum();
        let (was, is) = (sign * self.determinant(before), sign * self.determinant(after));
        let slack = 1e-9 * self.rest.abs();
        is < FLOOR * self.rest.abs() && is < was - slack
    }
}

impl Corners {
    pub(super) fn new(body: &Body) -> Self {
        let mut corners = Vec::new();
        for e in 0..body.elements.len() {
            let of = body.elements.points_of(e);
            let edges = body.elements.kind[e].edges();
            for (i, &corner) in of.iter().enumerate() {
                let ends = edges.iter().filter_map(|&[a, b]| match i {
                    i if i == a => Some(of[b] as usize),
                    i if i == b => Some(of[a] as usize),
                    _ => None,
                });
                let ends: Vec<usize> = ends.collect();
                let [b, c, d] = ends[..] else { continue };
                let mut one = Corner {
                    cell: e,
                    points: [corner as usize, b, c, d],
                    rest: 0.0,
                };
                one.rest = one.determinant(&body.positions);
                corners.push(one);
            }
        }
        Corners { corners }
    }

    /// Whether every cell is as valid at `after` as at `before`.
    pub(super) fn keep(&self, before: &[Vector], after: &[Vector]) -> bool {
        !self.corners.iter().any(|c| c.is_spoiled(before, after))
    }

    /// Takes `correction` of `before` back until cells are valid. Returns the number of cells where it was.
    pub(super) fn pull_back(&self, before: &[Vector], correction: &mut [Vector]) -> usize {
        let mut touched = Vec::new();
        for round in 0.. {
            let after = super::sum(before, correction);
            let spoiled: Vec<&Corner> = self
                .corners
                .iter()
                .filter(|c| c.is_spoiled(before, &after))
                .collect();
            if spoiled.is_empty() {
                break;
            }
            let mut points: Vec<usize> = spoiled.iter().flat_map(|c| c.points).collect();
            points.sort_unstable();
            points.dedup();
            let factor = if round < ROUNDS { BACK } else { 0.0 };
            for p in points {
                correction[p] = correction[p].map(|v| factor * v);
            }
            touched.extend(spoiled.iter().map(|c| c.cell));
        }
        touched.sort_unstable();
        touched.dedup();
        touched.len()
    }
}
