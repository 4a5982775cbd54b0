//! Nearest of many points, exactly: a k-d tree.

/// Points in a balanced tree: the middle one of a range halves it along one direction.
#[derive(Debug)]
pub(super) struct Tree {
    points: Vec<[f64; 3]>,
    /// Direction along which the middle point of a range halves it.
    axis: Vec<u8>,
}

impl Tree {
    /// A tree of finite points; their order does not matter.
    pub fn new(mut points: Vec<[f64; 3]>) -> Self {
        let mut axis = vec![0; points.len()];
        let mut ranges = vec![(0, points.len())];
        while let Some((first, end)) = ranges.pop() {
            if end - first < 2 {
                continue;
            }
            let part = &mut points[first..end];
            let side = |d: usize| {
                let (low, high) = part
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                        (low.min(x[d]), high.max(x[d]))
                    });
                high - low
            };
            let longest = (1..3).fold(0, |a, d| if side(d) > side(a) { d } else { a });
            let middle = part.len() / 2;
            part.select_nth_unstable_by(middle, |a, b| a[longest].total_cmp(&b[longest]));
            axis[first + middle] = longest as u8;
            ranges.extend([(first, first + middle), (first + middle + 1, end)]);
        }
        Tree { points, axis }
    }

    /// Distance from `x` to the nearest point; infinite without points. The square's terms are added in the order of
    /// the directions, so that the answer is that of a plain search, bit by bit.
    pub fn distance(&self, x: &[f64; 3]) -> f64 {
        let mut best = f64::INFINITY;
        self.search(x, 0, self.points.len(), &mut best);
        best.sqrt()
    }

    fn search(&self, x: &[f64; 3], mut first: usize, mut end: usize, best: &mut f64) {
        while first < end {
            let middle = first + (end - first) / 2;
            let point = &self.points[middle];
            *best = best.min((0..3).map(|d| (x[d] - point[d]).powi(2)).sum());
            let off = x[self.axis[middle] as usize] - point[self.axis[middle] as usize];
            let (near, far) = match off < 0.0 {
                true => ((first, middle), (middle + 1, end)),
                false => ((middle + 1, end), (first, middle)),
            };
            self.search(x, near.0, near.1, best);
            if off * off >= *best {
                return;
            }
            (first, end) = far;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn no_point_and_one() {
        assert_eq!(Tree::new(Vec::new()).distance(&[1.0, 2.0, 3.0]), f64::INFINITY);
        assert_eq!(Tree::new(vec![[0.0, 0.0, 4.0]]).distance(&[3.0, 0.0, 0.0]), 5.0);
        // All in one place, more than any bucket.
        assert_eq!(Tree::new(vec![[1.0; 3]; 5000]).distance(&[1.0, 1.0, 3.0]), 2.0);
    }

    proptest! {
        #[test]
        fn the_same_as_a_plain_search(
            points in prop::collection::vec([-4i32..5, -4i32..5, -2i32..3], 1..200),
            asked in prop::collection::vec([-6.0f64..6.0, -6.0f64..6.0, -6.0f64..6.0], 1..20),
        ) {
            // A coarse lattice: many ties and many points in one place.
            let points: Vec<[f64; 3]> = points.iter().map(|p| p.map(|v| f64::from(v) * 0.7)).collect();
            let tree = Tree::new(points.clone());
            for x in &asked {
                let plain = points
                    .iter()
                    .map(|p| (0..3).map(|d| (x[d] - p[d]).powi(2)).sum::<f64>())
                    .fold(f64::INFINITY, f64::min)
                    .sqrt();
                prop_assert_eq!(tree.distance(x), plain);
            }
        }
    }
}
