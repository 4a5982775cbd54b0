//! Muon (Jordan 2024): the update of a matrix is its momentum with all singular values made alike, so that directions in
//! which the gradient is small are learned as fast as the few in which it is large.

use super::Layout;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use std::ops::Range;

/// The coefficients of one Newton-Schulz step, `a X + b X X^T X + c (X X^T)^2 X`, and the number of steps: singular values
/// from some 0.01 to 1 come to lie between 0.7 and 1.2.
const COEFFICIENTS: [f32; 3] = [3.4445, -4.7750, 2.0315];
const STEPS: usize = 5;

/// A weight matrix, row by row in the flat vector of weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Matrix {
    pub start: usize,
    pub rows: usize,
    pub columns: usize,
}

impl Matrix {
    /// Its place in the flat vector.
    pub fn range(&self) -> Range<usize> {
        self.start..self.start + self.rows * self.columns
    }
}

/// The matrices between latent vectors: all but those that read features or write outputs, whose directions have
/// different units.
pub(super) fn hidden_matrices(layout: &Layout, width: usize) -> Vec<Matrix> {
    let entries = layout.entries().iter().zip(layout.starts());
    let matrices = entries.filter_map(|((_, shape), &start)| match shape[..] {
        [rows, columns] if rows.min(columns) >= width => Some(Matrix { start, rows, columns }),
        _ => None,
    });
    matrices.collect()
}

/// Replaces a matrix, row by row, by one of the same singular vectors and singular values near 1, and scales it so that
/// the root of its mean square is about 0.2, as that of Adam's updates is (Liu et al. 2025, arXiv 2502.16982, eq. 4): both
/// can have one learning rate. A matrix of zeros stays one.
pub(super) fn orthogonalise(x: &mut [f32], rows: usize, columns: usize) {
    let length = super::norm(x);
    if length <= 0.0 || !length.is_finite() {
        return;
    }
    let scale = (1.0 / length) as f32;
    x.iter_mut().for_each(|v| *v *= scale);
    let (small, large) = (rows.min(columns), rows.max(columns));
    let wide = rows <= columns;
    let [a, b, c] = COEFFICIENTS;
    let (mut gram, mut polynomial) = (vec![0f32; small * small], vec![0f32; small * small]);
    let mut next = vec![0f32; x.len()];
    for _ in 0..STEPS {
        let short = short_side_first(x, small, large, wide);
        let product = MatMut::from_row_major_slice_mut(&mut gram, small, small);
        matmul(product, Accum::Replace, short, short.transpose(), 1.0, Par::Seq);
        let square = MatRef::from_row_major_slice(&gram, small, small);
        let product = MatMut::from_row_major_slice_mut(&mut polynomial, small, small);
        matmul(product, Accum::Replace, square, square, c, Par::Seq);
        let pairs = polynomial.iter_mut().zip(&gram);
        pairs.for_each(|(polynomial, gram)| *polynomial += b * gram);
        (0..small).for_each(|i| polynomial[i * small + i] += a);
        let polynomial = MatRef::from_row_major_slice(&polynomial, small, small);
        let product = match wide {
            true => MatMut::from_row_major_slice_mut(&mut next, small, large),
            false => MatMut::from_column_major_slice_mut(&mut next, small, large),
        };
        matmul(product, Accum::Replace, polynomial, short, 1.0, Par::Seq);
        x.copy_from_slice(&next);
    }
    let size = 0.2 * (large as f32).sqrt();
    x.iter_mut().for_each(|v| *v *= size);
}

/// A matrix or its transpose, whichever has the fewer rows, so that the products above are small.
fn short_side_first(x: &[f32], small: usize, large: usize, wide: bool) -> MatRef<'_, f32> {
    match wide {
        true => MatRef::from_row_major_slice(x, small, large),
        false => MatRef::from_column_major_slice(x, small, large),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_become_alike_in_wide_and_tall_matrices() {
        // Singular vectors (.6, .8), (-.8, .6) on the left, e1 and e3 on the right; singular values 5 and 1.
        let wide = [3.0, 0.0, -0.8, 4.0, 0.0, 0.6];
        let tall = [3.0, 4.0, 0.0, 0.0, -0.8, 0.6];
        let unit = 0.2 * 3f32.sqrt();
        let mut x = wide;
        orthogonalise(&mut x, 2, 3);
        let (first, second) = ((x[0].hypot(x[3])) / unit, (x[2].hypot(x[5])) / unit);
        assert!((0.65..1.25).contains(&first) && (0.65..1.25).contains(&second), "{x:?}");
        assert!((x[3] / x[0] - 4.0 / 3.0).abs() < 1e-4, "{x:?}");
        assert!((x[5] / x[2] + 0.75).abs() < 1e-4, "{x:?}");
        assert!(x[1].abs() < 1e-6 && x[4].abs() < 1e-6, "{x:?}");
        let mut y = tall;
        orthogonalise(&mut y, 3, 2);
        for (row, column) in [(0, 0), (0, 2), (1, 0), (1, 2)] {
            assert!((x[row * 3 + column] - y[column * 2 + row]).abs() < 1e-6, "{x:?} {y:?}");
        }
    }

    #[test]
    fn zeros_and_what_is_not_finite_are_left_as_they_are() {
        let mut zeros = [0f32; 6];
        orthogonalise(&mut zeros, 2, 3);
        assert_eq!(zeros, [0.0; 6]);
        let mut bad = [f32::NAN, 1.0, 2.0, 3.0];
        orthogonalise(&mut bad, 2, 2);
        assert!(bad[0].is_nan() && bad[1..] == [1.0, 2.0, 3.0]);
    }
}
