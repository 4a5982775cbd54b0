//! SLIC on modes and positions (eq. 7, 8, Algorithm 2), in integers.
//!
//! Features are rounded to multiples of a quantum before use: sums over any number of ranks are then exact, and
//! the rounding noise of eigenvectors (which does depend on the ranks) is far below what moves a cell.

use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::model::SegmentSpec;
use crate::modes::{Extent, ModalOptions, laplacian_modes};
use crate::parallel::Comm;
use crate::{Error, Result};

/// Quantum of positions and features, as a fraction of the cluster size S.
const QUANTUM: f64 = 1e-7;

/// A centroid must be nearer by this fraction of S to take a cell away: ties of symmetric meshes stay where they
/// are instead of following the last bit of an eigenvector.
const MARGIN: f64 = 1e-5;

/// Features of this rank's cells in quanta: modes, then positions.
struct Features {
    /// Mode features a cell.
    modes: usize,
    /// Features a cell: modes and solved directions.
    width: usize,
    /// `[n_cells x width]`.
    values: Vec<i64>,
    /// S in quanta.
    size: f64,
    /// Weight of positions, eq. 8.
    tau: f64,
}

/// Moves cells between the `spec.count` segments of `labels` until none moves or the sweeps are used up.
/// Collective.
///
/// A mode enters as S phi: a change of one root mean square of a mode counts as much as one cluster size. A cell
/// goes to the nearest centroid if that is within S (Algorithm 2, line 28) and stays otherwise. A segment that
/// would lose all its cells keeps the one nearest to its centroid.
pub(super) fn refine(
    mesh: &Mesh,
    graph: &mut Graph,
    spec: &SegmentSpec,
    comm: &Comm,
    labels: Vec<i32>,
) -> Result<Vec<i32>> {
    check(spec)?;
    let mut total = [mesh.n_cells() as i64];
    comm.sum_i64(&mut total);
    if spec.count == 1 || spec.count as i64 == total[0] {
        return Ok(labels);
    }
    let modes = laplacian_modes(mesh, graph, comm, &ModalOptions::fixed(spec.modes))?;
    let features = Features::new(mesh, spec, comm, &modes.vectors, total[0]);
    Ok(features.sweep(mesh, comm, spec, labels))
}

fn check(spec: &SegmentSpec) -> Result<()> {
    if !(spec.tau.is_finite() && spec.tau >= 0.0) {
        return Err(Error::Input(format!(
            "tau is {}: expected a finite number, not negative",
            spec.tau
        )));
    }
    match spec.size {
        Some(s) if !(s.is_finite() && s > 0.0) => Err(Error::Input(format!(
            "segment size S is {s} m: expected a positive finite length"
        ))),
        _ => Ok(()),
    }
}

/// The default S of appendix B.4.1: extent of the domain = K S^dim.
fn default_size(mesh: &Mesh, extent: &Extent, count: usize) -> f64 {
    let sides: Vec<f64> = mesh
        .directions
        .iter()
        .map(|&d| extent.high[d] - extent.low[d])
        .filter(|&l| l > 0.0)
        .collect();
    match sides.len() {
        0 => 1.0,
        n => (sides.iter().product::<f64>() / count as f64).powf(1.0 / n as f64),
    }
}

impl Features {
    fn new(mesh: &Mesh, spec: &SegmentSpec, comm: &Comm, modes: &[Vec<f64>], n_global: i64) -> Self {
        let extent = Extent::of(mesh, comm);
        let size = spec
            .size
            .unwrap_or_else(|| default_size(mesh, &extent, spec.count));
        // No sum over all cells may leave the integers.
        let mut largest = [0.0f64];
        for phi in modes.iter().flatten() {
            largest[0] = largest[0].max(phi.abs() * size);
        }
        for &d in &mesh.directions {
            largest[0] = largest[0].max(extent.high[d] - extent.low[d]);
        }
        comm.max_f64(&mut largest);
        let room = 2f64.powi(61) / n_global as f64;
        // A power of two: `largest` carries rounding noise, the quantum must not.
        let quantum = (QUANTUM * size).max((largest[0] / room).log2().ceil().exp2());
        let width = modes.len() + mesh.dim();
        let mut values = Vec::with_capacity(mesh.n_cells() * width);
        for (cell, x) in mesh.cell_centres.iter().enumerate() {
            values.extend(
                modes
                    .iter()
                    .map(|phi| (phi[cell] * size / quantum).round() as i64),
            );
            values.extend(
                mesh.directions
                    .iter()
                    .map(|&d| ((x[d] - extent.low[d]) / quantum).round() as i64),
            );
        }
        Features {
            modes: modes.len(),
            width,
            values,
            size: size / quantum,
            tau: spec.tau,
        }
    }

    fn of(&self, cell: usize) -> &[i64] {
        &self.values[cell * self.width..(cell + 1) * self.width]
    }

    fn sweep(&self, mesh: &Mesh, comm: &Comm, spec: &SegmentSpec, mut labels: Vec<i32>) -> Vec<i32> {
        for _ in 0..spec.iterations {
            let centroids = self.centroids(comm, spec.count, &labels);
            let mut next: Vec<i32> = (0..labels.len())
                .map(|cell| self.nearest(cell, labels[cell], &centroids))
                .collect();
            self.keep_one_each(mesh, comm, spec.count, &centroids, &labels, &mut next);
            let mut moved = [labels.iter().zip(&next).filter(|(a, b)| a != b).count() as i64];
            comm.sum_i64(&mut moved);
            labels = next;
            if moved[0] == 0 {
                break;
            }
        }
        labels
    }

    /// Means of each segment's features `[count x width]` (eq. 7). Collective.
    fn centroids(&self, comm: &Comm, count: usize, labels: &[i32]) -> Vec<f64> {
        let stride = self.width + 1;
        let mut sums = vec![0i64; count * stride];
        for (cell, &label) in labels.iter().enumerate() {
            let sum = &mut sums[label as usize * stride..(label as usize + 1) * stride];
            sum[0] += 1;
            sum[1..].iter_mut().zip(self.of(cell)).for_each(|(s, f)| *s += f);
        }
        comm.sum_i64(&mut sums);
        sums.chunks_exact(stride)
            .flat_map(|s| s[1..].iter().map(move |&f| f as f64 / s[0].max(1) as f64))
            .collect()
    }

    /// Distance of eq. 8, in quanta.
    fn distance(&self, cell: usize, centroid: &[f64]) -> f64 {
        let square = |(&f, c): (&i64, &f64)| (f as f64 - c).powi(2);
        let (f, x) = self.of(cell).split_at(self.modes);
        let (cf, cx) = centroid.split_at(self.modes);
        f.iter().zip(cf).map(square).sum::<f64>().sqrt()
            + self.tau * x.iter().zip(cx).map(square).sum::<f64>().sqrt()
    }

    fn nearest(&self, cell: usize, current: i32, centroids: &[f64]) -> i32 {
        let own = &centroids[current as usize * self.width..(current as usize + 1) * self.width];
        let mut best = (self.distance(cell, own), current);
        for (k, centroid) in centroids.chunks_exact(self.width).enumerate() {
            let d = self.distance(cell, centroid);
            if d < best.0 - MARGIN * self.size {
                best = (d, k as i32);
            }
        }
        if best.0 <= self.size { best.1 } else { current }
    }

    /// Gives every segment that would be empty its nearest cell of before back (of equals the one with the
    /// lowest global number). Collective.
    fn keep_one_each(
        &self,
        mesh: &Mesh,
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
                self.distance(cell, &centroids[k * self.width..(k + 1) * self.width])
                    .round() as i64
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
                *chosen = (*chosen).min(mesh.cell_global[cell]);
            }
            comm.min_i64(&mut chosen);
            for cell in 0..before.len() {
                if empty(cell) && chosen[before[cell] as usize] == mesh.cell_global[cell] {
                    next[cell] = before[cell];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample;

    fn spec(count: usize, modes: usize) -> SegmentSpec {
        SegmentSpec {
            count,
            modes,
            ..Default::default()
        }
    }

    fn refined(mesh: &Mesh, spec: &SegmentSpec, labels: &[i32]) -> Result<Vec<i32>> {
        let comm = Comm::serial();
        let mut graph = Graph::new(mesh, &comm)?;
        refine(mesh, &mut graph, spec, &comm, labels.to_vec())
    }

    #[test]
    fn two_blobs_are_found_from_a_poor_start() {
        let mut mesh = sample::chain(8, 8.0);
        // Two groups of four cells, 10 m apart.
        mesh.cell_centres[4..].iter_mut().for_each(|x| x[0] += 10.0);
        let spec = SegmentSpec {
            size: Some(20.0),
            ..spec(2, 0)
        };
        assert_eq!(
            refined(&mesh, &spec, &[0, 0, 0, 1, 0, 1, 1, 1]).unwrap(),
            [0, 0, 0, 0, 1, 1, 1, 1]
        );
        // One sweep on paper: centroids 11.2 / 4 + ..., all cells farther than S stay.
        let spec = SegmentSpec {
            size: Some(1e-3),
            ..spec
        };
        assert_eq!(
            refined(&mesh, &spec, &[0, 0, 0, 1, 0, 1, 1, 1]).unwrap(),
            [0, 0, 0, 1, 0, 1, 1, 1]
        );
    }

    #[test]
    fn the_sign_change_of_the_second_mode_cuts_a_chain_in_half() {
        let mesh = sample::chain(10, 1.0);
        let spec = SegmentSpec {
            tau: 0.0,
            size: Some(1.0),
            ..spec(2, 2)
        };
        let labels = refined(&mesh, &spec, &[0, 0, 0, 0, 0, 0, 0, 1, 1, 1]).unwrap();
        assert_eq!(labels, [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
    }

    #[test]
    fn a_segment_keeps_its_nearest_cell() {
        // Segment 1 has cells 0 and 5 and its centroid in the middle of segment 0: all would leave it.
        let mesh = sample::chain(6, 6.0);
        let spec = SegmentSpec {
            size: Some(10.0),
            iterations: 1,
            ..spec(3, 0)
        };
        let labels = refined(&mesh, &spec, &[1, 0, 0, 2, 2, 1]).unwrap();
        assert!((0..3).all(|k| labels.contains(&k)), "{labels:?}");
    }

    #[test]
    fn sizes_and_weights_are_checked() {
        let mesh = sample::chain(6, 6.0);
        for bad in [
            SegmentSpec {
                tau: -1.0,
                ..spec(2, 0)
            },
            SegmentSpec {
                tau: f64::NAN,
                ..spec(2, 0)
            },
            SegmentSpec {
                size: Some(0.0),
                ..spec(2, 0)
            },
            spec(2, 6),
        ] {
            assert!(matches!(
                refined(&mesh, &bad, &[0, 0, 0, 1, 1, 1]),
                Err(Error::Input(_))
            ));
        }
    }

    #[test]
    fn the_default_size_is_that_of_the_paper() {
        let mesh = sample::rectangle(16, 4, 1.6, 0.41);
        let extent = Extent::of(&mesh, &Comm::serial());
        assert!((default_size(&mesh, &extent, 36) - (0.656f64 / 36.0).sqrt()).abs() < 1e-12);
    }
}
