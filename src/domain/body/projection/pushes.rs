//! The smallest smooth correction under contact constraints, by projected Gauss-Seidel on its dual.

use super::kernel::Compliance;
use m4gn_mesh::vector::{Vector, dot};
use std::collections::HashMap;

/// Linear inequalities for a correction c: `direction . sum of weight_p c_p >= least`, m.
#[derive(Clone, Debug, Default)]
pub(super) struct Constraints {
    rows: Vec<Row>,
    terms: Vec<(usize, f64)>,
}

#[derive(Clone, Copy, Debug)]
struct Row {
    sample: usize,
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
        sample: usize,
        terms: impl IntoIterator<Item = (usize, f64)>,
        direction: Vector,
        least: f64,
    ) {
        let from = self.terms.len();
        self.terms.extend(terms);
        self.rows.push(Row { sample, from, to: self.terms.len(), direction, least });
    }

    /// Pushes at points, so that `compliance` times them meets every constraint to `tolerance` (m) with the smallest
    /// energy. Constraints on held points only are passed over. `multipliers` of the samples, where they are known from
    /// constraints much like these, are where it starts, and come back as they are now.
    pub(super) fn solve(
        mut self,
        compliance: &Compliance,
        radius: f64,
        tolerance: f64,
        multipliers: &mut HashMap<usize, f64>,
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
        let of = |row: &Row| multipliers.get(&row.sample).copied().unwrap_or(0.0);
        let mut multiplier: Vec<f64> = self.rows.iter().map(of).collect();
        for (row, &m) in self.rows.iter().zip(&multiplier).filter(|(_, m)| **m > 0.0) {
            for &(p, w) in &self.terms[row.from..row.to] {
                (0..3).for_each(|i| pushes[p][i] += row.direction[i] * w * m);
            }
        }
        for (p, f) in pushes.iter().enumerate().filter(|(_, f)| **f != [0.0; 3]) {
            shift(&mut moved, &matrix[p * n..(p + 1) * n], *f);
        }
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
        let mut work = 0;
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
                // Neither too near nor needlessly far: let be
                if (change * stiff[k]).abs() < NEGLECT * tolerance {
                    continue;
                }
                worst = worst.max(missing);
                multiplier[k] += change;
                work += n * terms.len();
                for &(p, w) in terms {
                    let f = row.direction.map(|d| d * w * change);
                    for i in 0..3 {
                        pushes[p][i] += f[i];
                    }
                    shift(&mut moved, &matrix[p * n..(p + 1) * n], f);
                }
            }
            if worst < tolerance || work > WORK {
                break;
            }
        }
        *multipliers = self.rows.iter().map(|r| r.sample).zip(multiplier).collect();
        points.into_iter().zip(pushes).collect()
    }
}

/// Moves points by a column of the compliance times a push.
fn shift(moved: &mut [Vector], column: &[f64], push: Vector) {
    for (u, &c) in moved.iter_mut().zip(column) {
        for i in 0..3 {
            u[i] += c * push[i];
        }
    }
}

/// Numbers changed at most; some hundredths of a second. Only constraints that contradict one another need so many.
const WORK: usize = 10_000_000;
/// Part of the tolerance by which a constraint is let be.
const NEGLECT: f64 = 0.2;

/// Compliance of a constraint below which it counts as held.
const LEAST: f64 = 1e-4;
