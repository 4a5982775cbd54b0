//! Points within a radius: a grid of cubes as wide as the radius.

use crate::vector::{Vector, dot, sub};
use std::collections::HashMap;

/// Points by the cube that they lie in.
#[derive(Clone, Debug)]
pub struct Within {
    radius: f64,
    points: Vec<Vector>,
    cubes: HashMap<[i64; 3], Vec<u32>>,
}

impl Within {
    /// Sorts finite points into cubes of side `radius`, m.
    pub fn new(points: &[Vector], radius: f64) -> Self {
        let mut cubes: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
        for (i, x) in points.iter().enumerate() {
            cubes.entry(cube(x, radius)).or_default().push(i as u32);
        }
        Within { radius, points: points.to_vec(), cubes }
    }

    /// The points nearer to `x` than the radius, ascending, appended to `found`.
    pub fn query(&self, x: Vector, found: &mut Vec<u32>) {
        let first = found.len();
        let [i, j, k] = cube(&x, self.radius);
        for a in i - 1..=i + 1 {
            for b in j - 1..=j + 1 {
                for c in k - 1..=k + 1 {
                    let near = self.cubes.get(&[a, b, c]).into_iter().flatten();
                    found.extend(near.filter(|&&p| {
                        let d = sub(self.points[p as usize], x);
                        dot(d, d) < self.radius * self.radius
                    }));
                }
            }
        }
        found[first..].sort_unstable();
    }
}

/// Far positions share the last cubes: their distances are still looked at.
fn cube(x: &Vector, side: f64) -> [i64; 3] {
    let most = (i64::MAX / 4) as f64;
    x.map(|v| (v / side).floor().clamp(-most, most) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn finds_what_a_plain_search_finds() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let points: Vec<Vector> =
            (0..400).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
        for radius in [0.05, 0.3, 5.0] {
            let grid = Within::new(&points, radius);
            for x in &points[..60] {
                let mut found = vec![9];
                grid.query(*x, &mut found);
                let plain = (0..400u32).filter(|&p| {
                    let d = sub(points[p as usize], *x);
                    dot(d, d) < radius * radius
                });
                assert_eq!(found[1..], plain.collect::<Vec<_>>());
            }
        }
    }
}
