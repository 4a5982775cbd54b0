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
/// Times that the displacement around cells that came inside out is smoothed, before the region grows by an edge.
const SMOOTHINGS: usize = 30;
/// Times that the region grows.
const GROWTHS: usize = 20;
/// Of these, after how many points of cells that are still inside out go with the held ones.
const PATIENT: usize = 4;
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

/// Moves the loose points of a corner by `part` of the way to the mean of `of` at the firm ones (of all, where none is).
fn follow(corner: &Corner, firm: &[bool], of: &mut [Vector], part: f64) {
    let (fixed, loose): (Vec<usize>, Vec<usize>) = corner.points.iter().partition(|&&p| firm[p]);
    let leading = if fixed.is_empty() { &corner.points[..] } else { &fixed };
    let mean: Vector =
        std::array::from_fn(|i| leading.iter().map(|&p| of[p][i]).sum::<f64>() / leading.len() as f64);
    for p in loose {
        (0..3).for_each(|i| of[p][i] += part * (mean[i] - of[p][i]));
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
                let mut one = Corner { cell: e, points: [corner as usize, b, c, d], rest: 0.0 };
                one.rest = one.determinant(&body.positions);
                corners.push(one);
            }
        }
        Corners { corners, edges: body.edges.iter().map(|e| e.map(|p| p as usize)).collect() }
    }

    /// Number of corners of cells that were valid at `before` and are not at `after`.
    pub(super) fn spoiled(&self, before: &[Vector], after: &[Vector]) -> usize {
        let spoiled = self.corners.iter().filter(|c| c.is_spoiled(before, after, FLOOR));
        spoiled.count()
    }

    /// Brings cells that came inside out back: the displacement of their points becomes that of their neighbours, smoother and
    /// smoother, over a region that grows until each cell is valid; `held` points stay, and where that does not suffice, points
    /// beside them go with them. Returns the number of cells that came inside out.
    ///
    /// A line of held points alone does not hold a body: what is smooth around it changes there from cell to cell as a logarithm does.
    /// A displacement that hardly differs from neighbour to neighbour turns no cell inside out, whatever it is: this makes a state
    /// that a solver, and the network itself, can go on from, and not one that is nearer to the truth.
    pub(super) fn untangle(&self, rest: &[Vector], displacement: &mut [Vector], held: &[bool]) -> usize {
        let tangled = |u: &[Vector], floor: f64| -> Vec<&Corner> {
            let now = super::sum(rest, u);
            let found =
                self.corners.iter().filter(|c| c.rest.signum() * c.determinant(&now) < floor * c.rest.abs());
            found.collect()
        };
        let mut found = tangled(displacement, 0.0);
        let mut cells: Vec<usize> = found.iter().map(|c| c.cell).collect();
        cells.sort_unstable();
        cells.dedup();
        if cells.is_empty() {
            return 0;
        }
        let mut region = vec![false; rest.len()];
        let mut firm = held.to_vec();
        for growth in 0..GROWTHS {
            if found.is_empty() {
                break;
            }
            if growth >= PATIENT {
                let stiff: Vec<&Corner> =
                    found.iter().copied().filter(|c| c.points.iter().any(|&p| firm[p])).collect();
                for corner in stiff {
                    follow(corner, &firm, displacement, 1.0);
                    corner.points.iter().for_each(|&p| firm[p] = true);
                }
            }
            found.iter().flat_map(|c| c.points).for_each(|p| region[p] = true);
            let inner = region.clone();
            let reached = self.edges.iter().filter(|[a, b]| inner[*a] || inner[*b]);
            reached.flatten().for_each(|&p| region[p] = true);
            let is_free: Vec<bool> = region.iter().zip(&firm).map(|(r, f)| *r && !f).collect();
            self.smooth(displacement, &is_free);
            found = tangled(displacement, FLOOR);
        }
        cells.len()
    }

    /// Moves each free point half of the way to the mean of its neighbours, [`SMOOTHINGS`] times.
    fn smooth(&self, of: &mut [Vector], is_free: &[bool]) {
        let near = self.edges.iter().filter(|[a, b]| is_free[*a] || is_free[*b]);
        let near: Vec<[usize; 2]> = near.copied().collect();
        for _ in 0..SMOOTHINGS {
            let mut around = vec![([0.0; 3], 0.0); of.len()];
            for &[a, b] in &near {
                for (to, from) in [(a, b), (b, a)] {
                    (0..3).for_each(|i| around[to].0[i] += of[from][i]);
                    around[to].1 += 1.0;
                }
            }
            for p in (0..of.len()).filter(|&p| is_free[p]) {
                let (total, count) = around[p];
                (0..3).for_each(|i| of[p][i] += 0.5 * (total[i] / count - of[p][i]));
            }
        }
    }

    /// Lets points that need not be where they are go along with those that must (`firm`: pushed or held), until cells are
    /// valid or it does not help: a correction that is the same at all points of a cell does not change its shape.
    pub(super) fn ease(&self, before: &[Vector], correction: &mut [Vector], firm: &[bool]) {
        for _ in 0..EASING {
            let after = super::sum(before, correction);
            let spoiled = self.corners.iter().filter(|c| c.is_spoiled(before, &after, FLOOR));
            let spoiled: Vec<&Corner> = spoiled.collect();
            if spoiled.is_empty() {
                break;
            }
            for corner in spoiled {
                follow(corner, firm, correction, 0.5);
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

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::NodeType;
    use m4gn_samples::bodies as sample;

    fn volumes(body: &Body, u: &[Vector]) -> Vec<f64> {
        body.elements.measures(&crate::body::projection::sum(&body.positions, u))
    }

    /// A block stretched by a tenth, of which one point inside was thrown over two cells, and one of the held ones stays: all cells
    /// are valid after, what is farther than three cells off is as it was to the bit, and a block without such a point wholly.
    #[test]
    fn a_thrown_point_comes_back() {
        let mut body = sample::block([8, 8, 8], [8.0; 3]);
        for (x, kind) in body.positions.iter().zip(&mut body.types) {
            *kind = if x[2] == 0.0 { NodeType::Handle } else { NodeType::Body };
        }
        let held: Vec<bool> = body.types.iter().map(|t| *t != NodeType::Body).collect();
        let stretched: Vec<Vector> = body.positions.iter().map(|x| [0.0, 0.0, 0.1 * x[2]]).collect();
        let corners = Corners::new(&body);

        let mut same = stretched.clone();
        assert_eq!(corners.untangle(&body.positions, &mut same, &held), 0);
        assert_eq!(same, stretched);

        for centre in [[4.0, 4.0, 4.0], [4.0, 4.0, 1.0], [0.0, 4.0, 8.0]] {
            let thrown = body.positions.iter().position(|x| *x == centre).unwrap();
            let mut u = stretched.clone();
            u[thrown] = [2.2, -0.3, -2.0];
            assert!(volumes(&body, &u).iter().any(|v| *v < 0.0), "{centre:?}");
            assert!(corners.untangle(&body.positions, &mut u, &held) > 0);
            assert!(volumes(&body, &u).iter().all(|v| *v > 0.2), "{centre:?}");
            for (p, x) in body.positions.iter().enumerate() {
                let far = (0..3).any(|i| (x[i] - centre[i]).abs() > 3.0);
                assert!(!(far || held[p]) || u[p] == stretched[p], "{centre:?} {x:?}");
            }
        }
    }

    /// A block that is held along one edge and has gone two cells beyond it everywhere else.
    #[test]
    fn cells_beside_a_held_line_come_back() {
        let body = sample::block([10, 10, 3], [10.0, 10.0, 3.0]);
        let held: Vec<bool> = body.positions.iter().map(|x| x[0] == 0.0 && x[1] == 0.0).collect();
        let mut u: Vec<Vector> = held.iter().map(|h| if *h { [0.0; 3] } else { [-2.0, -2.0, 0.0] }).collect();
        assert!(volumes(&body, &u).iter().any(|v| *v < 0.0));
        assert!(Corners::new(&body).untangle(&body.positions, &mut u, &held) > 0);
        let least = volumes(&body, &u).into_iter().fold(f64::INFINITY, f64::min);
        assert!(least > 0.0, "{least}");
        assert!(u.iter().zip(&held).all(|(u, h)| !h || *u == [0.0; 3]));
    }
}
