//! Pairs of matrices with eigenvalues known on paper.

use m4gn_modes::{Mass, Problem, Rows};
use std::ops::Range;

/// These points' rows of a matrix of constant bands below, on and above the diagonal, one such band matrix for each unknown of a point.
pub fn bands(own: Range<i64>, points: i64, band: [f64; 3], weight: &[f64]) -> Rows {
    let mut rows = Rows { row: vec![0], ..Default::default() };
    for i in own {
        for (c, w) in weight.iter().enumerate() {
            for (j, b) in (i - 1..=i + 1).zip(band) {
                if (0..points).contains(&j) && b != 0.0 {
                    rows.column.push(j * weight.len() as i64 + c as i64);
                    rows.value.push(b * w);
                }
            }
            rows.row.push(rows.column.len());
        }
    }
    rows
}

/// One unknown a point; without a mass, 1 each.
pub fn problem(stiffness: Rows, mass: Option<Rows>) -> Problem {
    let mass = mass.map_or_else(|| Mass::Diagonal(vec![1.0; stiffness.n()]), Mass::Matrix);
    Problem { mass, stiffness, block: 1, positions: Vec::new(), shift: None }
}
