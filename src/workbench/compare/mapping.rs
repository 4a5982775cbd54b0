//! Values of one mesh at the cell centres of another.

use m4gn_averages::sine::eliminate;
use m4gn_mesh::nearest::Nearest;

/// Neighbours that a value is made of.
const NEIGHBOURS: usize = 12;

/// How cell values of case B become values at the cells of case A.
pub enum Mapping {
    /// The cells are the same ones in the same order.
    Same,
    /// For each cell of A, cells of B and their weights: the value of a plane (in 3-D, a linear function) through the nearest
    /// cells of B, fitted by least squares with the inverse fourth power of the distance as weight. Exact for linear fields.
    Linear(Vec<Vec<(usize, f64)>>),
}

impl Mapping {
    /// From the centres of `b` to those of `a`, m; `directions` are the solved ones.
    pub fn linear(a: &[[f64; 3]], b: &[[f64; 3]], directions: &[usize]) -> Self {
        let solved = |p: &[f64; 3]| [0, 1, 2].map(|d| if directions.contains(&d) { p[d] } else { 0.0 });
        let tree = Nearest::new(&b.iter().map(solved).collect::<Vec<_>>());
        let one = |at: &[f64; 3]| weights(at, b, &tree.several(solved(at), NEIGHBOURS), directions);
        Mapping::Linear(a.iter().map(one).collect())
    }

    /// The values at the cells of A.
    pub fn scalar(&self, values: Vec<f64>) -> Vec<f64> {
        match self {
            Mapping::Same => values,
            Mapping::Linear(rows) => {
                let sum = |row: &Vec<(usize, f64)>| row.iter().map(|&(j, w)| w * values[j]).sum();
                rows.iter().map(sum).collect()
            }
        }
    }

    /// The same for vectors.
    pub fn vector(&self, values: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        match self {
            Mapping::Same => values,
            Mapping::Linear(rows) => rows
                .iter()
                .map(|row| std::array::from_fn(|d| row.iter().map(|&(j, w)| w * values[j][d]).sum()))
                .collect(),
        }
    }
}

/// Weights of the near cells (index in `b`, squared distance), the nearest first.
fn weights(at: &[f64; 3], b: &[[f64; 3]], near: &[(usize, f64)], directions: &[usize]) -> Vec<(usize, f64)> {
    let (Some(&(nearest, least)), Some(&(_, farthest))) = (near.first(), near.last()) else {
        return Vec::new();
    };
    // Basis: 1 and the distances in the solved directions, in units of the farthest; directions that are not solved are
    // zero and get a diagonal entry, so that the matrix stays regular.
    let scale = farthest.sqrt().max(f64::MIN_POSITIVE);
    let basis = |j: usize| {
        let mut v = [1.0, 0.0, 0.0, 0.0];
        directions.iter().for_each(|&d| v[d + 1] = (b[j][d] - at[d]) / scale);
        v
    };
    let weight = |square: f64| (square / farthest.max(f64::MIN_POSITIVE) + 1e-6).powi(-2);
    let mut matrix = [[0.0; 4]; 4];
    for &(j, square) in near {
        let (v, w) = (basis(j), weight(square));
        for r in 0..4 {
            (0..4).for_each(|c| matrix[r][c] += w * v[r] * v[c]);
        }
    }
    (0..3).filter(|d| !directions.contains(d)).for_each(|d| matrix[d + 1][d + 1] = matrix[0][0]);
    let row = eliminate(matrix, [1.0, 0.0, 0.0, 0.0]);
    match row {
        Some(row) if least > 0.0 => near
            .iter()
            .map(|&(j, square)| {
                let along: f64 = row.iter().zip(basis(j)).map(|(r, v)| r * v).sum();
                (j, weight(square) * along)
            })
            .collect(),
        // On a centre, or the near cells are in a line.
        _ => vec![(nearest, 1.0)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(n: usize) -> Vec<[f64; 3]> {
        let place = |i: usize| (i as f64 + 0.5) / n as f64;
        (0..n * n).map(|i| [place(i % n), place(i / n), 0.05]).collect()
    }

    #[test]
    fn linear_fields_are_exact_and_smooth_ones_of_second_order() {
        let fine = grid(20);
        let worst = |n: usize, f: &dyn Fn(&[f64; 3]) -> f64| {
            let coarse = grid(n);
            let mapping = Mapping::linear(&fine, &coarse, &[0, 1]);
            let mapped = mapping.scalar(coarse.iter().map(f).collect());
            let errors = mapped.iter().zip(&fine).map(|(m, p)| (m - f(p)).abs());
            errors.fold(0.0, f64::max)
        };
        assert!(worst(7, &|p| 2.0 + 3.0 * p[0] - p[1]) < 1e-9);
        let wave = |p: &[f64; 3]| (3.0 * p[0]).sin() * (2.0 * p[1]).cos();
        let (coarse, finer) = (worst(7, &wave), worst(14, &wave));
        assert!(coarse < 0.06 && finer < 0.4 * coarse, "{coarse} {finer}");
    }

    #[test]
    fn the_same_mesh_and_few_cells() {
        let cells = grid(3);
        let values: Vec<[f64; 3]> = cells.iter().map(|p| [p[0], 1.0, -p[1]]).collect();
        let found = Mapping::linear(&cells, &cells, &[0, 1]).vector(values.clone());
        assert_eq!(found, values);
        assert_eq!(Mapping::Same.vector(values.clone()), values);
        let one = Mapping::linear(&cells, &cells[..1], &[0, 1]).scalar(vec![7.0]);
        assert_eq!(one, [7.0; 9]);
    }
}
