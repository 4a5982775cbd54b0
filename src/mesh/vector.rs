//! Vectors in space.

/// A point or a vector in space.
pub type Vector = [f64; 3];

/// a - b.
pub fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Scalar product.
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Length.
pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// Lowest and highest coordinates of points; infinite, the lowest above the highest, where there are none.
pub fn bounds(points: impl Iterator<Item = Vector>) -> [Vector; 2] {
    points.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], x| {
        [std::array::from_fn(|i| low[i].min(x[i])), std::array::from_fn(|i| high[i].max(x[i]))]
    })
}

/// The coordinate in which finite points lie farthest apart.
pub fn widest(points: impl Iterator<Item = Vector>) -> usize {
    let [low, high] = bounds(points);
    let sides = sub(high, low);
    (0..3).max_by(|&a, &b| sides[a].total_cmp(&sides[b])).unwrap_or(0)
}

/// Positions of points that moved from `rest` by `displacement`, m.
pub fn moved<T: Copy + Into<f64>>(rest: &[[f64; 3]], displacement: &[[T; 3]]) -> Vec<[f64; 3]> {
    rest.iter().zip(displacement).map(|(x, u)| std::array::from_fn(|i| x[i] + u[i].into())).collect()
}
