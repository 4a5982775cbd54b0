//! How good a segmentation is: conductance, edge-cut ratio and silhouette score (appendix C.3, eq. 18 to 20).
//!
//! The graph of these figures has the cells as its nodes and the faces between cells as its edges: what was cut.
//! Boundary faces always lie with their cell and would only dilute the figures.

use super::preset_labels;
use crate::graph::Graph;
use m4gn_base::Result;
use m4gn_mesh::{Extent, Mesh};
use m4gn_parallel::{Comm, everywhere};

/// Silhouettes of meshes of at most this many cells are exact.
const EXACT: i64 = 20_000;

/// About this many cells are looked at, against all others, on larger meshes. The standard error of the mean is
/// below 1 / sqrt(SAMPLE), since a silhouette lies between -1 and 1.
const SAMPLE: f64 = 4_000.0;

/// Cells whose distances are summed up between two reductions.
const BLOCK: usize = 256;

/// Steps of a silhouette: sums of whole steps do not depend on their order.
const STEPS: f64 = (1u64 << 40) as f64;

/// The three figures of appendix C.3.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Mean over the segments of eq. 18, edges that leave a segment over the smaller of its and the others' sum of
    /// degrees; 0 for a segment without edges. Lower is better.
    pub conductance: f64,
    /// Edges between segments over all edges (eq. 19); 0 without edges. Lower is better.
    pub edge_cut_ratio: f64,
    /// Mean silhouette (eq. 20), -1 to 1. A cell that is a segment of its own has 0, as in scikit-learn, and so has
    /// every cell where there is one segment. Higher is better.
    pub silhouette: f64,
    /// Cells that `silhouette` is the mean of: all up to 20,000, a sample of about 4,000 above.
    pub silhouette_cells: usize,
}

/// Quality of the segmentation with `labels`, the segment (0 to `count` - 1, none empty) of each of this rank's
/// cells. Collective; the same on all ranks and for any number of them.
///
/// The silhouette's dissimilarity, which the paper leaves open, is the distance of the cells' centres in the solved directions.
/// Distances across a cyclic are those of the positions as they are. The sample of a large mesh is a function of
/// the cells' global numbers. Cost: N^2 (N x 4,000 for a sample) distances.
///
/// # Errors
/// [`m4gn_base::Error::Input`] for labels out of range or missing.
pub fn quality(mesh: &Mesh, graph: &mut Graph, labels: &[i32], count: usize, comm: &Comm) -> Result<Quality> {
    let labels = preset_labels(mesh, labels, count, comm)?;
    let (conductance, edge_cut_ratio) = edges(graph, &labels, count, comm);
    let points = Points::new(mesh, comm);
    let (silhouette, silhouette_cells) = points.silhouette(mesh, &labels, count, comm);
    Ok(Quality { conductance, edge_cut_ratio, silhouette, silhouette_cells })
}

/// Mean conductance (eq. 18) and edge-cut ratio (eq. 19). Collective.
fn edges(graph: &mut Graph, labels: &[i32], count: usize, comm: &Comm) -> (f64, f64) {
    let mut segment = vec![-1i64; graph.n_local];
    segment.iter_mut().zip(labels).for_each(|(s, &l)| *s = i64::from(l));
    graph.halo.exchange_i64(comm, &mut segment, 1);
    // Degrees, then edges that leave, of each segment: each edge is seen from both ends.
    let mut sums = vec![0i64; 2 * count];
    for (&sender, &receiver) in graph.senders.iter().zip(&graph.receivers) {
        let (to, from) = (segment[receiver as usize], segment[sender as usize]);
        if to >= 0 && from >= 0 {
            sums[to as usize] += 1;
            sums[count + to as usize] += i64::from(to != from);
        }
    }
    comm.sum_i64(&mut sums);
    let (volumes, cuts) = sums.split_at(count);
    let total: i64 = volumes.iter().sum();
    let conductance = volumes.iter().zip(cuts).map(|(&volume, &cut)| match cut {
        0 => 0.0,
        _ => cut as f64 / volume.min(total - volume) as f64,
    });
    let ratio = cuts.iter().sum::<i64>() as f64 / total.max(1) as f64;
    (conductance.sum::<f64>() / count as f64, ratio)
}

/// Cells as points of a Euclidean space, on this rank.
struct Points {
    /// Coordinates of all cells, one list a dimension.
    coordinates: Vec<Vec<f64>>,
    /// Power of two that distances are multiples of after rounding: sums over all cells are exact.
    quantum: f64,
}

impl Points {
    fn new(mesh: &Mesh, comm: &Comm) -> Self {
        let coordinates: Vec<Vec<f64>> =
            mesh.directions.iter().map(|&d| mesh.cell_centres.iter().map(|x| x[d]).collect()).collect();
        let mut total = [mesh.n_cells() as f64];
        comm.sum_f64(&mut total);
        let Extent { low, high } = Extent::around(mesh.cell_centres.iter(), comm);
        let diagonal = mesh.directions.iter().map(|&d| (high[d] - low[d]).powi(2)).sum::<f64>().sqrt();
        let least = diagonal * total[0] / 2f64.powi(51);
        Points { coordinates, quantum: if least > 0.0 { least.log2().ceil().exp2() } else { 1.0 } }
    }

    /// Mean silhouette and the number of cells that it is the mean of. Collective.
    fn silhouette(&self, mesh: &Mesh, labels: &[i32], count: usize, comm: &Comm) -> (f64, usize) {
        let total = comm.total(labels.len());
        let asked: Vec<usize> =
            (0..labels.len()).filter(|&cell| chosen(mesh.cell_global[cell], total)).collect();
        let width = self.coordinates.len();
        let rows: Vec<f64> =
            asked.iter().flat_map(|&cell| self.coordinates.iter().map(move |x| x[cell])).collect();
        let rows = everywhere(comm, &rows);
        let own = everywhere(comm, &asked.iter().map(|&cell| labels[cell]).collect::<Vec<_>>());

        let mut sizes = vec![0i64; count];
        labels.iter().for_each(|&l| sizes[l as usize] += 1);
        let sorted = Sorted::new(&self.coordinates, labels, &sizes);
        comm.sum_i64(&mut sizes);
        let mut steps = 0i64;
        let mut sums = vec![0.0; BLOCK * count];
        for (rows, own) in rows.chunks(BLOCK * width).zip(own.chunks(BLOCK)) {
            let sums = &mut sums[..own.len() * count];
            for (row, sums) in rows.chunks_exact(width).zip(sums.chunks_exact_mut(count)) {
                sorted.distances(row, 1.0 / self.quantum, sums);
            }
            comm.sum_f64(sums);
            for (&own, sums) in own.iter().zip(sums.chunks_exact(count)) {
                steps += (silhouette(own as usize, sums, &sizes) * STEPS).round() as i64;
            }
        }
        (steps as f64 / STEPS / own.len().max(1) as f64, own.len())
    }
}

/// Whether the silhouette of this cell is asked for.
fn chosen(global: i64, total: i64) -> bool {
    total <= EXACT || (hash(global as u64) as f64) < SAMPLE / total as f64 * 2f64.powi(64)
}

/// SplitMix64: neighbouring numbers fall far apart, so that no pattern of the numbering shows.
fn hash(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// (b - a) / max(a, b) from the sums of a cell's distances to the members of each segment.
fn silhouette(own: usize, sums: &[f64], sizes: &[i64]) -> f64 {
    if sizes[own] < 2 {
        return 0.0;
    }
    let a = sums[own] / (sizes[own] - 1) as f64;
    let b = (0..sums.len())
        .filter(|&k| k != own)
        .map(|k| sums[k] / sizes[k] as f64)
        .fold(f64::INFINITY, f64::min);
    match a.max(b) {
        m if m > 0.0 && m.is_finite() => (b - a) / m,
        _ => 0.0,
    }
}

/// This rank's cells in the order of their segments.
struct Sorted {
    coordinates: Vec<Vec<f64>>,
    /// Cells of segment k: `first[k]..first[k + 1]`.
    first: Vec<usize>,
}

impl Sorted {
    fn new(coordinates: &[Vec<f64>], labels: &[i32], sizes: &[i64]) -> Self {
        let mut first = vec![0; sizes.len() + 1];
        for (k, &size) in sizes.iter().enumerate() {
            first[k + 1] = first[k] + size as usize;
        }
        let mut order: Vec<usize> = (0..labels.len()).collect();
        order.sort_by_key(|&cell| labels[cell]);
        Sorted {
            coordinates: coordinates.iter().map(|x| order.iter().map(|&cell| x[cell]).collect()).collect(),
            first,
        }
    }

    /// Sums of the distances from a point to the cells of each segment, each rounded to a whole quantum.
    fn distances(&self, point: &[f64], per_quantum: f64, sums: &mut [f64]) {
        const LANES: usize = 32;
        /// Adding and taking away 1.5 x 2^52 rounds to a whole number.
        const ROUND: f64 = 6_755_399_441_055_744.0;
        for (sum, run) in sums.iter_mut().zip(self.first.windows(2)) {
            let mut total = 0.0;
            let mut at = run[0];
            while at < run[1] {
                let n = LANES.min(run[1] - at);
                let mut squares = [0.0; LANES];
                for (x, &p) in self.coordinates.iter().zip(point) {
                    for (s, &x) in squares.iter_mut().zip(&x[at..at + n]) {
                        *s += (x - p) * (x - p);
                    }
                }
                for s in &mut squares {
                    *s = (s.sqrt() * per_quantum + ROUND) - ROUND;
                }
                // Whole numbers below 2^52: their sum is exact in any order.
                let mut lanes = [0.0; 8];
                for part in squares.as_chunks::<8>().0 {
                    lanes.iter_mut().zip(part).for_each(|(l, s)| *l += s);
                }
                total += lanes.iter().sum::<f64>();
                at += n;
            }
            *sum = total;
        }
    }
}

#[cfg(test)]
mod tests;
