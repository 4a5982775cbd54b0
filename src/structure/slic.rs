//! SLIC on modes, positions and the distance to the obstacle (eq. 7, 8, 14, Algorithm 2), in whole numbers.
//!
//! The distance of a cell from a centroid is |f - f_C| + tau |x - x_C| with f the distance to the obstacle and the
//! modes in one vector, as Algorithm 2 (line 27) and appendix B.4, which defines the variants, have it; eq. 8 adds a norm
//! of its own for the obstacle. Without the obstacle (SLIC-MD) the two are the same.
//!
//! Features are rounded to multiples of a quantum before use: sums over any number of ranks are then exact, and
//! the rounding noise of eigenvectors (which does depend on the ranks) is far below what moves a cell.

use super::obstacle;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Extent;
use m4gn_mesh::Mesh;
use m4gn_model::SegmentSpec;
use m4gn_model::modal::Modes;
use m4gn_parallel::Comm;

/// Quantum of positions and features, as a fraction of the cluster size S.
const QUANTUM: f64 = 1e-7;

/// Features of this rank's cells in quanta.
struct Features {
    /// Physics-guided features f a cell: distance to the obstacle, modes.
    guided: usize,
    /// Features a cell: the guided ones and the position in the solved directions.
    width: usize,
    /// `[n_cells x width]`, whole numbers.
    values: Vec<f64>,
    /// S in quanta.
    size: f64,
    /// How much nearer a centroid must be to take a cell away, in quanta.
    margin: f64,
    /// Weight of positions, eq. 8.
    tau: f64,
}

/// Moves cells between the `spec.count` segments of `labels`, one of each of this rank's cells, whose numbers by place are `number`, until none moves or the sweeps are used
/// up; returns the labels, and how many cells of all ranks each sweep moved. Collective.
///
/// A mode enters as S phi: a change of one root mean square of a mode counts as much as one cluster size; or as
/// `spec.mode_scale` phi. A cell goes to the nearest centroid if that is within S (Algorithm 2, line 28) and stays otherwise. A segment that
/// would lose all its cells keeps the one nearest to its centroid.
///
/// # Errors
/// [`Error::Input`] if the obstacle's distance is a feature and there is no obstacle, or if S or what modes are multiplied by is beyond numbers.
pub(super) fn refine(
    mesh: &Mesh,
    spec: &SegmentSpec,
    modes: &Modes,
    comm: &Comm,
    (number, labels): (&[i64], Vec<i32>),
) -> Result<(Vec<i32>, Vec<usize>)> {
    let features = Features::new(mesh, spec, comm, &modes.vectors)?;
    Ok(features.sweep(number, comm, spec, labels))
}

/// The default S of appendix B.4.1: extent of the domain = K S^dim.
fn default_size(mesh: &Mesh, extent: &Extent, count: usize) -> f64 {
    let sides: Vec<f64> =
        mesh.directions.iter().map(|&d| extent.high[d] - extent.low[d]).filter(|&l| l > 0.0).collect();
    match sides.len() {
        0 => 1.0,
        n => (sides.iter().product::<f64>() / count as f64).powf(1.0 / n as f64),
    }
}

impl Features {
    fn new(mesh: &Mesh, spec: &SegmentSpec, comm: &Comm, modes: &[Vec<f64>]) -> Result<Self> {
        let total = comm.total(mesh.n_cells());
        let extent = Extent::of(mesh, comm);
        let size = spec.size.unwrap_or_else(|| default_size(mesh, &extent, spec.count));
        let obstacle = obstacle::feature(mesh, spec, size, comm)?;
        let weight = spec.mode_scale.unwrap_or(size);
        // No sum over all cells may leave the integers.
        let mut largest = [0.0f64];
        for phi in modes.iter().flatten() {
            largest[0] = largest[0].max(phi.abs() * weight);
        }
        for f in &obstacle {
            largest[0] = largest[0].max(f.abs());
        }
        for &d in &mesh.directions {
            largest[0] = largest[0].max(extent.high[d] - extent.low[d]);
        }
        comm.max_f64(&mut largest);
        refuse(!largest[0].is_finite(), Error::Input, || {
            let found = format!("found {size:e} and {weight:e}");
            format!("segments.size and mode_scale: expected lengths in m like those of the mesh, {found}")
        })?;
        let room = 2f64.powi(61) / total as f64;
        // A power of two: `largest` carries rounding noise, the quantum must not.
        let quantum = (QUANTUM * size).max((largest[0] / room).log2().ceil().exp2()).max(f64::MIN_POSITIVE);
        let width = usize::from(spec.method.uses_obstacle()) + modes.len() + mesh.dim();
        let mut values = Vec::with_capacity(mesh.n_cells() * width);
        for (cell, x) in mesh.cell_centres.iter().enumerate() {
            let position = mesh.directions.iter().map(|&d| x[d] - extent.low[d]);
            let mode = modes.iter().map(|phi| phi[cell] * weight);
            let all = obstacle.get(cell).copied().into_iter().chain(mode).chain(position);
            values.extend(all.map(|f| (f / quantum).round()));
        }
        let size = size / quantum;
        Ok(Features {
            guided: width - mesh.dim(),
            width,
            values,
            size,
            margin: spec.margin * size,
            tau: spec.tau,
        })
    }

    fn of(&self, cell: usize) -> &[f64] {
        &self.values[cell * self.width..(cell + 1) * self.width]
    }

    fn sweep(
        &self,
        number: &[i64],
        comm: &Comm,
        spec: &SegmentSpec,
        mut labels: Vec<i32>,
    ) -> (Vec<i32>, Vec<usize>) {
        let mut sweeps = Vec::new();
        for _ in 0..spec.iterations {
            let centroids = self.centroids(comm, spec.count, &labels);
            let mut next = self.nearest(&labels, &centroids);
            self.keep_one_each(number, comm, spec.count, &centroids, &labels, &mut next);
            let moved = comm.total(labels.iter().zip(&next).filter(|(a, b)| a != b).count()) as usize;
            labels = next;
            sweeps.push(moved);
            if moved == 0 {
                break;
            }
        }
        (labels, sweeps)
    }

    /// Means of each segment's features `[count x width]` (eq. 7). Collective.
    fn centroids(&self, comm: &Comm, count: usize, labels: &[i32]) -> Vec<f64> {
        let stride = self.width + 1;
        let mut sums = vec![0i64; count * stride];
        for (cell, &label) in labels.iter().enumerate() {
            let sum = &mut sums[label as usize * stride..(label as usize + 1) * stride];
            sum[0] += 1;
            sum[1..].iter_mut().zip(self.of(cell)).for_each(|(s, &f)| *s += f as i64);
        }
        comm.sum_i64(&mut sums);
        sums.chunks_exact(stride)
            .flat_map(|s| s[1..].iter().map(move |&f| f as f64 / s[0].max(1) as f64))
            .collect()
    }

    /// Distance of Algorithm 2 (line 27) between two sets of features, in quanta.
    fn distance(&self, a: &[f64], b: &[f64]) -> f64 {
        let norm = |a: &[f64], b: &[f64]| {
            let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
            squares.sum::<f64>().sqrt()
        };
        let ((f, x), (g, y)) = (a.split_at(self.guided), b.split_at(self.guided));
        norm(f, g) + self.tau * norm(x, y)
    }

    /// The segment that each cell goes to: of the centroids within S of it and nearer than its own by the margin
    /// the nearest (those within the margin of that one: the first), else its own.
    ///
    /// Only centroids near the cell's own are looked at: the distance is a metric, so that a centroid farther from the
    /// own one than the sum of the cell's distances to both cannot be.
    fn nearest(&self, labels: &[i32], centroids: &[f64]) -> Vec<i32> {
        let (width, margin) = (self.width, self.margin);
        let centroid = |k: usize| &centroids[k * width..(k + 1) * width];
        let own: Vec<f64> = labels
            .iter()
            .enumerate()
            .map(|(cell, &k)| self.distance(self.of(cell), centroid(k as usize)))
            .collect();
        // How far from its own centroid the centroid of a cell's next segment can be, with room for rounding.
        let reach = |own: f64, limit: f64| (own + limit) * (1.0 + 1e-9);
        let limit = |own: f64| (own - margin).min(self.size);
        let count = centroids.len() / width;
        let mut farthest = vec![0.0f64; count];
        for (&k, &own) in labels.iter().zip(&own) {
            let farthest = &mut farthest[k as usize];
            *farthest = farthest.max(reach(own, limit(own)));
        }
        let around = |k: usize| {
            let mut near: Vec<(f64, i32)> = (0..count)
                .filter(|&j| j != k)
                .map(|j| (self.distance(centroid(k), centroid(j)), j as i32))
                .filter(|near| near.0 <= farthest[k])
                .collect();
            near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            near
        };
        let near: Vec<Vec<(f64, i32)>> =
            (0..count).map(|k| if farthest[k] > 0.0 { around(k) } else { Vec::new() }).collect();
        let mut candidates: Vec<(f64, i32)> = Vec::new();
        labels
            .iter()
            .enumerate()
            .map(|(cell, &current)| {
                let (own, x) = (own[cell], self.of(cell));
                let mut bound = limit(own);
                candidates.clear();
                for &(apart, j) in &near[current as usize] {
                    if apart > reach(own, bound) {
                        break;
                    }
                    let d = self.distance(x, centroid(j as usize));
                    if d <= self.size && d < own - margin {
                        candidates.push((d, j));
                        bound = bound.min(d + margin);
                    }
                }
                let least = candidates.iter().map(|c| c.0).fold(f64::INFINITY, f64::min);
                candidates.iter().filter(|c| c.0 <= least + margin).map(|c| c.1).min().unwrap_or(current)
            })
            .collect()
    }

    /// Gives every segment that would be empty its nearest cell of before back (of equals the one with the
    /// lowest number). Collective.
    fn keep_one_each(
        &self,
        number: &[i64],
        comm: &Comm,
        count: usize,
        centroids: &[f64],
        before: &[i32],
        next: &mut [i32],
    ) {
        // A cell that is given back may leave another segment empty; each round settles at least one for good.
        for _ in 0..count {
            let mut sizes = vec![0i64; count];
            next.iter().for_each(|&l| sizes[l as usize] += 1);
            comm.sum_i64(&mut sizes);
            if sizes.iter().all(|&s| s > 0) {
                return;
            }
            // Whole quanta: comparable between ranks.
            let steps = |cell: usize| {
                let k = before[cell] as usize;
                self.distance(self.of(cell), &centroids[k * self.width..(k + 1) * self.width]).round() as i64
            };
            let empty = |cell: usize| sizes[before[cell] as usize] == 0;
            let mut least = vec![i64::MAX; count];
            for cell in (0..before.len()).filter(|&c| empty(c)) {
                let least = &mut least[before[cell] as usize];
                *least = (*least).min(steps(cell));
            }
            comm.min_i64(&mut least);
            let mut chosen = vec![i64::MAX; count];
            for cell in (0..before.len()).filter(|&c| empty(c) && steps(c) == least[before[c] as usize]) {
                let chosen = &mut chosen[before[cell] as usize];
                *chosen = (*chosen).min(number[cell]);
            }
            comm.min_i64(&mut chosen);
            for cell in 0..before.len() {
                if empty(cell) && chosen[before[cell] as usize] == number[cell] {
                    next[cell] = before[cell];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
