//! The order of places: by the third direction, then the second, then the first, which is how blockMesh numbers a block along the axes. What
//! is numbered by it depends neither on the numbering that a mesh came with nor on the ranks.

use m4gn_mesh::vector::{Vector, bounds, norm, sub};

/// Places closer than this in a direction, over the diagonal of the box around all, are one there: centres that are computed from
/// faces in another order differ by rounding. A multiple of pi, so that no regular mesh has its places on the bounds between two.
const NEAR: f64 = std::f64::consts::PI * 1e-9;

/// Position of each place in the line of all of them; of those at one place in the order of `number`.
pub(super) fn line(places: &[Vector], number: &[i64]) -> Vec<i64> {
    let [low, high] = bounds(places.iter().copied());
    let unit = NEAR * norm(sub(high, low));
    let whole = |x: f64| if unit > 0.0 { (x / unit).round() as i64 } else { 0 };
    let key = |&p: &Vector| {
        let [x, y, z] = sub(p, low).map(whole);
        [z, y, x]
    };
    let keys: Vec<[i64; 3]> = places.iter().map(key).collect();
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by_key(|&i| (keys[i], number[i]));
    let mut position = vec![0; keys.len()];
    (0..).zip(order).for_each(|(at, i)| position[i] = at);
    position
}

#[cfg(test)]
mod tests {
    use super::line;

    #[test]
    fn by_directions_but_for_rounding_then_by_number() {
        // The third and the fifth have one y but for rounding, the last is where the first is.
        let places = [[3.0, 0.0], [1.0, 2.0], [2.0, 1.0], [0.0, 5.0], [2.0 + 1e-12, 0.5], [3.0, 0.0]];
        let places = places.map(|[y, x]| [x, y, 0.0]);
        assert_eq!(line(&places, &[0, 1, 2, 3, 4, 5]), [4, 1, 3, 0, 2, 5]);
        assert_eq!(line(&places, &[9, 1, 2, 3, 4, 5]), [5, 1, 3, 0, 2, 4]);
        assert_eq!(line(&[[1.0; 3]; 3], &[2, 0, 1]), [2, 0, 1]);
        assert!(line(&[], &[]).is_empty());
    }

    /// Centres of a regular mesh that are off by rounding stand in the same order.
    #[test]
    fn rounding_moves_no_place() {
        for n in [64, 100, 128, 365, 1000] {
            let at = |k: usize, off: f64| {
                let (i, j) = (k / n, k % n);
                [
                    (j as f64 + 0.5) * 1.2 / n as f64 * (1.0 - off),
                    (i as f64 + 0.5) * 1.6 / n as f64 * (1.0 + off),
                    0.0,
                ]
            };
            let cells = n * n.min(40);
            let number: Vec<i64> = (0..cells as i64).collect();
            let wave = |k: usize| (k as f64 * 0.7).sin() * 4e-16;
            let even: Vec<_> = (0..cells).map(|k| at(k, 0.0)).collect();
            let off: Vec<_> = (0..cells).map(|k| at(k, wave(k))).collect();
            assert_eq!(line(&even, &number), number);
            assert_eq!(line(&off, &number), number);
        }
    }
}
