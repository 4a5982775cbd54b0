//! Whether cells stay valid, and taking back a correction where they do not.

use m4gn_mesh::body::Body;
use m4gn_mesh::vector::{Vector, cross, dot, sub};

/// Part of its rest value that the determinant at a corner of a cell should keep; half of what it was, where that is less.
const FLOOR: f64 = 0.05;
/// The part below which a correction is taken back.
const LAST: f64 = 0.01;
/// A correction is taken back by this factor at a time.
const BACK: f64 = 0.7;
/// Times that loose points are moved along.
const EASING: usize = 30;
/// Edges over which it comes back to its full size.
const TAPER: u32 = 2;
/// Times at most; then it is taken back wholly.
const ROUNDS: usize = 24;

/// The corners of cells where three edges meet: all but the tips of pyramids.
#[derive(Clone, Debug)]
pub(super) struct Corners {
    corners: Vec<Corner>,
    edges: Vec<[usize; 2]>,
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

    /// Whether a correction turned it inside out, or nearly so. What was so before is not the correction's doing.
    fn is_spoiled(&self, before: &[Vector], after: &[Vector], floor: f64) -> bool {
        if self.points.iter().all(|&p| before[p] == after[p]) {
            return false;
        }
        let sign = self.rest.signum();
        let (was, is) = (sign * self.determinant(before), sign * self.determinant(after));
        was > 0.0 && is < (floor * self.rest.abs()).min(0.5 * was)
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
        Corners {
            corners,
            edges: body.edges.iter().map(|e| e.map(|p| p as usize)).collect(),
        }
    }

    /// Number of corners of cells that were valid at `before` and are not at `after`.
    pub(super) fn spoiled(&self, before: &[Vector], after: &[Vector]) -> usize {
        let spoiled = self.corners.iter().filter(|c| c.is_spoiled(before, after, FLOOR));
        spoiled.count()
    }

    /// Lets points that need not be where they are go along with those that must (`firm`: pushed or held), until cells are
    /// valid or it does not help: a correction that is the same at all points of a cell does not change its shape.
    pub(super) fn ease(&self, before: &[Vector], correction: &mut [Vector], firm: &[bool]) {
        for _ in 0..EASING {
            let after = super::sum(before, correction);
            let spoiled = self
                .corners
                .iter()
                .filter(|c| c.is_spoiled(before, &after, FLOOR));
            let spoiled: Vec<&Corner> = spoiled.collect();
            if spoiled.is_empty() {
                break;
            }
            for corner in spoiled {
                let (fixed, loose): (Vec<usize>, Vec<usize>) = corner.points.iter().partition(|&&p| firm[p]);
                let leading = if fixed.is_empty() {
                    &corner.points[..]
                } else {
                    &fixed
                };
                let mean: Vector = std::array::from_fn(|i| {
                    leading.iter().map(|&p| correction[p][i]).sum::<f64>() / leading.len() as f64
                });
                for p in loose {
                    (0..3).for_each(|i| correction[p][i] += 0.5 * (mean[i] - correction[p][i]));
                }
            }
        }
    }

    /// Takes `correction` of `before` back until cells are valid, less and less around them. Returns the number of
    /// cells on whose account it was.
    pub(super) fn pull_back(&self, before: &[Vector], correction: &mut [Vector]) -> usize {
        let whole = correction.to_vec();
        let mut part = vec![1.0f64; whole.len()];
        let mut touched = Vec::new();
        for round in 0.. {
            let after = super::sum(before, correction);
            let spoiled = self.corners.iter().filter(|c| c.is_spoiled(before, &after, LAST));
            let spoiled: Vec<&Corner> = spoiled.collect();
            if spoiled.is_empty() {
                break;
            }
            let factor = if round < ROUNDS { BACK } else { 0.0 };
            let mut points: Vec<usize> = spoiled.iter().flat_map(|c| c.points).collect();
            points.sort_unstable();
            points.dedup();
            points.into_iter().for_each(|p| part[p] *= factor);
            for _ in 0..TAPER {
                for &[a, b] in &self.edges {
                    let most = 1.0 / f64::from(TAPER);
                    part[a] = part[a].min(part[b] + most);
                    part[b] = part[b].min(part[a] + most);
                }
            }
            for ((c, w), p) in correction.iter_mut().zip(&whole).zip(&part) {
                *c = w.map(|v| p * v);
            }
            touched.extend(spoiled.iter().map(|c| c.cell));
        }
        touched.sort_unstable();
        touched.dedup();
        touched.len()
    }
}
