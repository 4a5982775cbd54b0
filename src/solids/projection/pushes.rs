//! The smallest smooth correction under contact constraints, by projected Gauss-Seidel on its dual.

use super::kernel::Compliance;
use crate::solids::{Vector, dot};
use std::collections::HashMap;

/// Linear inequalities for a correction c: `direction . sum of weight_p c_p >= least`, m.
#[derive(Clone, Debug, Default)]
pub(super) struct Constraints {
    rows: Vec<Row>,
    terms: Vec<(usize, f64)>,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    from: usize,
    to: usize,
    direction: Vector,
    least: f64,
}

/// Sweeps over all constraints at most; they are few and the kernel couples them strongly.
const SWEEPS: usize = 300;

impl Constraints {
    pub(super) fn add(
        &mut self,
        terms: impl IntoIterator<Item = (usize, f64)>,
        direction: Vector,
        least: f64,
    ) {
        let from = self.terms.len();
        self.terms.extend(terms);
        self.rows.push(Row {
            from,
            to: self.terms.len(),
            direction,
            least,
        });
    }

    /// Pushes at points, so that `compliance` times them meets every constraint to `tolerance` (m) with the smallest
    /// energy. Constraints on held points only are passed over.
    pub(super) fn solve(
        mut self,
        compliance: &Compliance,
        radius: f64,
        tolerance: f64,
    ) -> Vec<(usize, Vector)> {
        // The deepest first: what it pushes along need not be pushed again.
        self.rows.sort_by(|a, b| b.least.total_cmp(&a.least));
        let mut place: HashMap<usize, usize> = HashMap::new();
        let mut points = Vec::new();
        for (p, _) in &mut self.terms {
            let local = *place.entry(*p).or_insert_with(|| {
                points.push(*p);
                points.len() - 1
            });
            *p = local;
        }
        let n = points.len();
        let mut matrix = vec![0.0; n * n];
        for i in 0..n {
            for j in 0..=i {
                let c = compliance.between(points[i], points[j], radius);
                matrix[i * n + j] = c;
                matrix[j * n + i] = c;
            }
        }
        let mut pushes = vec![[0.0; 3]; n];
        let mut moved = vec![[0.0; 3]; n];
        let mut multiplier = vec![0.0; self.rows.len()];
        let stiff: Vec<f64> = self
            .rows
            .iter()
            .map(|row| {
                let terms = &self.terms[row.from..row.to];
                let mut sum = 0.0;
                for &(p, v) in terms {
                    for &(q, w) in terms {
                        sum += v * w * matrix[p * n + q];
                    }
                }
                sum
            })
            .collect();
        for _ in 0..SWEEPS {
            let mut worst: f64 = 0.0;
            for (k, row) in self.rows.iter().enumerate() {
                let terms = &self.terms[row.from..row.to];
                let reached: f64 = terms.iter().map(|&(p, w)| w * dot(row.direction, moved[p])).sum();
                let missing = row.least - reached;
                if (missing <= 0.0 && multiplier[k] == 0.0) || stiff[k] < LEAST {
                    continue;
                }
                let change = (missing / stiff[k]).max(-multiplier[k]);
                if change == 0.0 {
                    continue;
                }
                worst = worst.max(missing);
                multiplier[k] += change;
                for &(p, w) in terms {
                    let f = row.direction.map(|d| d * w * change);
                    for i in 0..3 {
                        pushes[p][i] += f[i];
                    }
                    for (u, &c) in moved.iter_mut().zip(&matrix[p * n..(p + 1) * n]) {
                        for i in 0..3 {
                            u[i] += c * f[i];
                        }
                    }
                }
            }
            if worst < tolerance {
                break;
            }
        }
        points.into_iter().zip(pushes).collect()
    }
}

/// Compliance of a constraint below which it counts as held.
const LEAST: f64 = 1e-4;
