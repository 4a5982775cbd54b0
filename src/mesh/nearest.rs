//! Nearest neighbours among points: a k-d tree.

use crate::vector::{Vector, dot, sub, widest};

/// Points in a balanced tree: the middle of each range splits it by the coordinate in which it is widest.
#[derive(Clone, Debug)]
pub struct Nearest {
    /// Points, and their places among those that were given.
    points: Vec<(Vector, usize)>,
    axis: Vec<u8>,
}

impl Nearest {
    /// Builds the tree.
    pub fn new(points: &[Vector]) -> Self {
        let numbered = points.iter().copied().zip(0..);
        let mut tree = Nearest { points: numbered.collect(), axis: vec![0; points.len()] };
        let mut ranges = vec![(0, points.len())];
        while let Some((from, to)) = ranges.pop() {
            if to - from < 2 {
                continue;
            }
            let axis = widest(tree.points[from..to].iter().map(|p| p.0));
            let middle = (from + to) / 2;
            tree.points[from..to]
                .select_nth_unstable_by(middle - from, |a, b| a.0[axis].total_cmp(&b.0[axis]));
            tree.axis[middle] = axis as u8;
            ranges.extend([(from, middle), (middle + 1, to)]);
        }
        tree
    }

    /// Squared distance to the nearest point, m^2; infinite where there are no points. That of a plain search bit by
    /// bit, in whatever order the points came.
    pub fn distance_squared(&self, x: Vector) -> f64 {
        self.find(x).0
    }

    /// The nearest point, by its place among those that were given; none where no distance is finite.
    pub fn nearest(&self, x: Vector) -> Option<usize> {
        let (distance, place) = self.find(x);
        distance.is_finite().then_some(place)
    }

    fn find(&self, x: Vector) -> (f64, usize) {
        let (mut best, mut place) = (f64::INFINITY, 0);
        self.search(x, best, |number, distance| {
            (best, place) = (distance, number);
            distance
        });
        (best, place)
    }

    /// So many of the nearest points, or all: their places among those that were given, and squared distances, m^2, ascending.
    pub fn several(&self, x: Vector, count: usize) -> Vec<(usize, f64)> {
        let mut found: Vec<(usize, f64)> = Vec::new();
        self.search(x, if count > 0 { f64::INFINITY } else { 0.0 }, |number, distance| {
            found.truncate(count - 1);
            found.insert(found.partition_point(|f| f.1 <= distance), (number, distance));
            if found.len() < count { f64::INFINITY } else { found[count - 1].1 }
        });
        found
    }

    /// Points whose squared distance is below `limit`, m^2: `look` takes their places among those that were given and their squared
    /// distances, and gives the limit from then on.
    pub fn search(&self, x: Vector, mut limit: f64, mut look: impl FnMut(usize, f64) -> f64) {
        // Ranges still to be searched, with the squared distance to the plane in front of them
        let mut ranges = vec![(0, self.points.len(), 0.0)];
        while let Some((from, to, least)) = ranges.pop() {
            if from >= to || least >= limit {
                continue;
            }
            let middle = (from + to) / 2;
            let ((p, number), axis) = (self.points[middle], usize::from(self.axis[middle]));
            let d = sub(x, p);
            let distance = dot(d, d);
            if distance < limit {
                limit = look(number, distance);
            }
            let (near, far) = if d[axis] < 0.0 {
                ((from, middle), (middle + 1, to))
            } else {
                ((middle + 1, to), (from, middle))
            };
            ranges.push((far.0, far.1, d[axis] * d[axis]));
            ranges.push((near.0, near.1, least));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn no_points() {
        assert_eq!(Nearest::new(&[]).distance_squared([0.0; 3]), f64::INFINITY);
        assert_eq!(Nearest::new(&[]).nearest([0.0; 3]), None);
    }

    #[test]
    fn many_points_in_one_place() {
        let tree = Nearest::new(&[[1.0; 3]; 5000]);
        assert_eq!(tree.distance_squared([1.0, 1.0, 3.0]), 4.0);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        /// Against looking at all points; coordinates from a coarse lattice, so that many are equal.
        #[test]
        fn as_looking_at_all(points in prop::collection::vec(prop::array::uniform3(0..6i32), 1..80),
                             x in prop::array::uniform3(-2.0..8.0f64)) {
            let points: Vec<Vector> = points.iter().map(|p| p.map(f64::from)).collect();
            let square = |p: &Vector| { let d = sub(x, *p); dot(d, d) };
            let plain = points.iter().map(square).fold(f64::INFINITY, f64::min);
            let tree = Nearest::new(&points);
            prop_assert_eq!(tree.distance_squared(x), plain);
            prop_assert_eq!(square(&points[tree.nearest(x).unwrap()]), plain);
            let mut all: Vec<f64> = points.iter().map(square).collect();
            all.sort_by(f64::total_cmp);
            for count in [0, 1, 12, 80] {
                let several = tree.several(x, count);
                prop_assert!(several.iter().all(|&(place, d)| square(&points[place]) == d));
                let found: Vec<f64> = several.iter().map(|s| s.1).collect();
                prop_assert_eq!(&found[..], &all[..count.min(all.len())]);
                let places: std::collections::HashSet<usize> = several.iter().map(|s| s.0).collect();
                prop_assert_eq!(places.len(), found.len());
            }
        }
    }
}
