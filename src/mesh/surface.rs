//! Closed triangulated surfaces: signed distance, by a tree of boxes.

use crate::vector::{Vector, bounds, cross, dot, norm, sub, widest};
use m4gn_base::{Error, Result};
use std::collections::HashMap;

/// A closed surface whose triangles turn so that normals leave the body.
#[derive(Clone, Debug)]
pub struct Surface {
    corners: Vec<[Vector; 3]>,
    /// Normals that decide the side: of the face, of its edges (0-1, 1-2, 2-0) and of its points; the sums over
    /// the triangles there, those of points weighted by angle (Baerentzen and Aanaes 2005).
    normals: Vec<[Vector; 7]>,
    nodes: Vec<Node>,
}

/// The place of a surface nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Signed distance, m: negative on the inner side.
    pub distance: f64,
    /// Unit vector in which the distance grows; the surface's normal where the point lies on it.
    pub normal: Vector,
}

/// A box around triangles `from..to`; children are the next node and `right`, a leaf has no `right`.
#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vector,
    high: Vector,
    from: usize,
    to: usize,
    right: Option<usize>,
}

const LEAF: usize = 4;

/// Whether triangles make a closed surface in which neighbours turn the same way.
///
/// # Errors
/// [`Error::Mesh`] that names the first edge where they do not.
pub fn check_closed(triangles: &[[i32; 3]]) -> Result<()> {
    let mut edges: HashMap<(i32, i32), i32> = HashMap::new();
    for t in triangles {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            let (count, sign) = if a < b { ((a, b), 1) } else { ((b, a), -1) };
            // One triangle each way: +1 - 1; other counts cannot cancel by the second sum.
            let entry = edges.entry(count).or_insert(0);
            *entry += 1000 + sign;
        }
    }
    let mut open: Vec<_> = edges.into_iter().filter(|(_, n)| *n != 2000).map(|(e, _)| e).collect();
    open.sort_unstable();
    match open.first() {
        _ if triangles.is_empty() => Err(Error::Mesh("a surface has no triangles".into())),
        None => Ok(()),
        Some((a, b)) => Err(Error::Mesh(format!(
            "a surface is not closed, or its triangles turn different ways, at the edge between points {a} and {b}"
        ))),
    }
}

impl Surface {
    /// Builds the surface of `triangles` over `points`, m.
    ///
    /// # Errors
    /// [`Error::Mesh`] when it is not closed, or a label is out of range.
    pub fn new(points: &[Vector], triangles: &[[i32; 3]]) -> Result<Self> {
        check_closed(triangles)?;
        let end = points.len();
        if let Some(bad) =
            triangles.as_flattened().iter().find(|&&p| usize::try_from(p).map_or(true, |p| p >= end))
        {
            return Err(Error::Mesh(format!("a triangle has the point {bad} of {end}")));
        }
        Ok(Self::open(points, triangles))
    }

    /// The same of triangles that need not be closed; labels are in range. Which side is which is then known near the
    /// triangles only.
    pub fn open(points: &[Vector], triangles: &[[i32; 3]]) -> Self {
        let mut order: Vec<usize> = (0..triangles.len()).collect();
        let corner = |t: usize| triangles[t].map(|p| points[p as usize]);
        let average = |[a, b, c]: [Vector; 3]| std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0);
        let middles: Vec<Vector> = (0..triangles.len()).map(|t| average(corner(t))).collect();
        let mut nodes = Vec::new();
        let normals = side_normals(points, triangles);
        build(&mut order, 0, &middles, &corner, &mut nodes);
        Surface {
            corners: order.iter().map(|&t| corner(t)).collect(),
            normals: order.iter().map(|&t| normals[t]).collect(),
            nodes,
        }
    }

    /// Distance from x to the box around the surface, m; 0 inside the box.
    pub fn beyond_box(&self, x: Vector) -> f64 {
        beyond(x, &self.nodes[0]).sqrt()
    }

    /// Signed distance, m: negative inside.
    pub fn distance(&self, x: Vector) -> f64 {
        self.foot(x).map_or(f64::INFINITY, |f| f.distance)
    }

    /// The place nearest to x; None without triangles, or for an x that is not finite.
    pub fn foot(&self, x: Vector) -> Option<Foot> {
        let mut best = (f64::INFINITY, usize::MAX, 0, [0.0; 3]);
        let mut stack = vec![0];
        while let Some(i) = stack.pop() {
            let node = &self.nodes[i];
            if beyond(x, node) >= best.0 {
                continue;
            }
            match node.right {
                Some(right) => {
                    let (a, b) = (i + 1, right);
                    let a_first = beyond(x, &self.nodes[a]) < beyond(x, &self.nodes[b]);
                    stack.extend(if a_first { [b, a] } else { [a, b] });
                }
                None => {
                    for t in node.from..node.to {
                        let (nearest, feature) = closest(x, &self.corners[t]);
                        let away = sub(x, nearest);
                        let square = dot(away, away);
                        if square < best.0 {
                            best = (square, t, feature, nearest);
                        }
                    }
                }
            }
        }
        let (square, t, feature, at) = best;
        let side = self.normals.get(t)?[feature];
        let away = sub(x, at);
        let sign = if dot(away, side) >= 0.0 { 1.0 } else { -1.0 };
        let distance = sign * square.sqrt();
        // Too near to tell a direction from rounding: the surface's own.
        let size = at.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let (from, length) =
            if distance.abs() > 1e-12 * size { (away, distance) } else { (side, norm(side)) };
        Some(Foot { distance, normal: from.map(|v| if length == 0.0 { 0.0 } else { v / length }) })
    }
}

fn build(
    order: &mut [usize],
    offset: usize,
    middles: &[Vector],
    corner: &impl Fn(usize) -> [Vector; 3],
    nodes: &mut Vec<Node>,
) {
    let [low, high] = bounds(order.iter().flat_map(|&t| corner(t)));
    let this = nodes.len();
    nodes.push(Node { low, high, from: offset, to: offset + order.len(), right: None });
    if order.len() <= LEAF {
        return;
    }
    let axis = widest(order.iter().map(|&t| middles[t]));
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| middles[a][axis].total_cmp(&middles[b][axis]));
    let (left, right) = order.split_at_mut(half);
    build(left, offset, middles, corner, nodes);
    nodes[this].right = Some(nodes.len());
    build(right, offset + half, middles, corner, nodes);
}

/// Squared distance from x to a box.
fn beyond(x: Vector, node: &Node) -> f64 {
    (0..3).map(|i| (node.low[i] - x[i]).max(x[i] - node.high[i]).max(0.0)).map(|d| d * d).sum()
}

/// The point of a triangle nearest to x, and where it lies: 0 inside, 1 to 3 edges, 4 to 6 corners.
fn closest(x: Vector, [a, b, c]: &[Vector; 3]) -> (Vector, usize) {
    // Voronoi regions of the triangle (Ericson, Real-Time Collision Detection, 5.1.5).
    let (ab, ac) = (sub(*b, *a), sub(*c, *a));
    let at = |from: &Vector, along: Vector, t: f64| std::array::from_fn(|i| from[i] + t * along[i]);
    let ax = sub(x, *a);
    let (d1, d2) = (dot(ab, ax), dot(ac, ax));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, 4);
    }
    let bx = sub(x, *b);
    let (d3, d4) = (dot(ab, bx), dot(ac, bx));
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, 5);
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (at(a, ab, d1 / (d1 - d3)), 1);
    }
    let cx = sub(x, *c);
    let (d5, d6) = (dot(ab, cx), dot(ac, cx));
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, 6);
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (at(a, ac, d2 / (d2 - d6)), 3);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (at(b, sub(*c, *b), (d4 - d3) / ((d4 - d3) + (d5 - d6))), 2);
    }
    let sum = va + vb + vc;
    let (v, w) = (vb / sum, vc / sum);
    (std::array::from_fn(|i| a[i] + ab[i] * v + ac[i] * w), 0)
}

fn side_normals(points: &[Vector], triangles: &[[i32; 3]]) -> Vec<[Vector; 7]> {
    let add = |sum: &mut Vector, n: Vector, weight: f64| {
        for i in 0..3 {
            sum[i] += weight * n[i];
        }
    };
    let mut of_point = vec![[0.0; 3]; points.len()];
    let mut of_edge: HashMap<(i32, i32), Vector> = HashMap::new();
    let mut of_face = Vec::with_capacity(triangles.len());
    let edge = |a: i32, b: i32| (a.min(b), a.max(b));
    for t in triangles {
        let p = t.map(|i| points[i as usize]);
        let n = cross(sub(p[1], p[0]), sub(p[2], p[0]));
        let length = norm(n);
        let n = n.map(|v| if length > 0.0 { v / length } else { 0.0 });
        for i in 0..3 {
            let (here, next, last) = (p[i], p[(i + 1) % 3], p[(i + 2) % 3]);
            let (u, v) = (sub(next, here), sub(last, here));
            let angle = norm(cross(u, v)).atan2(dot(u, v));
            add(&mut of_point[t[i] as usize], n, angle);
            add(of_edge.entry(edge(t[i], t[(i + 1) % 3])).or_default(), n, 1.0);
        }
        of_face.push(n);
    }
    let pack = |(t, n): (&[i32; 3], Vector)| {
        let e = |i: usize| of_edge[&edge(t[i], t[(i + 1) % 3])];
        let p = |i: usize| of_point[t[i] as usize];
        [n, e(0), e(1), e(2), p(0), p(1), p(2)]
    };
    triangles.iter().zip(of_face).map(pack).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::brick;
    use proptest::prelude::*;

    /// Signed distance to that box, in closed form.
    fn exact(size: Vector, x: Vector) -> f64 {
        let q: Vector = std::array::from_fn(|i| (x[i] - size[i] / 2.0).abs() - size[i] / 2.0);
        let outside = norm(q.map(|v| v.max(0.0)));
        outside + q[0].max(q[1]).max(q[2]).min(0.0)
    }

    #[test]
    fn surfaces_that_are_not_closed() {
        let (points, mut triangles) = brick([1.0; 3]);
        assert!(check_closed(&triangles).is_ok());
        triangles[0].swap(0, 1);
        assert!(Surface::new(&points, &triangles).unwrap_err().to_string().contains("between points"));
        triangles.remove(0);
        assert!(check_closed(&triangles).is_err());
        assert!(check_closed(&[]).is_err());
        let (points, triangles) = brick([1.0; 3]);
        assert!(Surface::new(&points[..7], &triangles).unwrap_err().to_string().contains("point 7 of 7"));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Also beside edges and corners, where the nearest triangle alone would give the wrong side.
        #[test]
        fn distance_to_a_box(size in prop::array::uniform3(0.2..3.0f64), x in prop::array::uniform3(-2.0..4.0f64)) {
            let (points, triangles) = brick(size);
            let surface = Surface::new(&points, &triangles).unwrap();
            prop_assert!((surface.distance(x) - exact(size, x)).abs() < 1e-12);
        }
    }
}
