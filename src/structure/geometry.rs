//! Where segments lie: the geometric part of the positional encoding (section 3.4.1 leaves the choice open).

use super::Segmentation;
use m4gn_mesh::Mesh;
use m4gn_model::{MacroSpec, ModelSpec};
use m4gn_parallel::Comm;

impl Segmentation {
    /// Adds what the network that `spec` describes reads of the segments besides their members: `position` and `offsets`.
    /// Collective.
    pub fn encode(&mut self, spec: &ModelSpec, mesh: &Mesh, comm: &Comm) {
        let Some(stage) = spec.architecture.segment_transformer() else {
            return;
        };
        self.position = self.rwse(stage.rwse_steps);
        if stage.centroids || stage.offsets {
            self.add_centroids(stage, mesh, comm);
        }
    }

    /// Adds the centroids to `position`, and the `offsets` from them, as far as the stage has them. Collective.
    fn add_centroids(&mut self, stage: &MacroSpec, mesh: &Mesh, comm: &Comm) {
        let (k, dim) = (self.count, mesh.dim());
        let place = |x: &[f64; 3], i: usize| x[mesh.directions[i]];
        // Sums over cells: boundary faces belong to their owner's segment and do not move its centroid.
        let mut sums = vec![0.0; k * (dim + 1)];
        for (cell, x) in mesh.cell_centres.iter().enumerate() {
            let row = &mut sums[self.node_segment[cell] as usize * (dim + 1)..][..dim + 1];
            (0..dim).for_each(|i| row[i] += place(x, i));
            row[dim] += 1.0;
        }
        comm.sum_f64(&mut sums);
        let centroids: Vec<f64> = sums
            .chunks_exact(dim + 1)
            .flat_map(|row| row[..dim].iter().map(|s| s / row[dim].max(1.0)))
            .collect();
        let total: f64 = sums.chunks_exact(dim + 1).map(|row| row[dim]).sum();
        let centre: Vec<f64> = (0..dim)
            .map(|i| sums.chunks_exact(dim + 1).map(|row| row[i]).sum::<f64>() / total.max(1.0))
            .collect();
        let from_centre: Vec<f64> =
            centroids.chunks_exact(dim).flat_map(|c| c.iter().zip(&centre).map(|(c, m)| c - m)).collect();
        let spread = rms(from_centre.iter().map(|v| v * v).sum(), k as f64);

        let cell_offset = |cell: usize, x: &[f64; 3]| -> Vec<f64> {
            let s = self.node_segment[cell] as usize;
            (0..dim).map(|i| place(x, i) - centroids[s * dim + i]).collect()
        };
        let mut square = [mesh
            .cell_centres
            .iter()
            .enumerate()
            .map(|(cell, x)| cell_offset(cell, x).iter().map(|v| v * v).sum::<f64>())
            .sum::<f64>()];
        comm.sum_f64(&mut square);
        let size = rms(square[0], total);

        if stage.centroids {
            let steps = stage.rwse_steps;
            let walk = std::mem::take(&mut self.position);
            self.position = (0..k)
                .flat_map(|s| {
                    let centroid = from_centre[s * dim..(s + 1) * dim].iter();
                    let walk = walk[s * steps..(s + 1) * steps].iter().copied();
                    walk.chain(centroid.map(|v| (v / spread) as f32))
                })
                .collect();
        }
        if stage.offsets {
            let cells = mesh.cell_centres.iter().enumerate();
            let cells = cells.flat_map(|(cell, x)| cell_offset(cell, x));
            let faces = mesh.boundary.iter();
            let faces = faces.flat_map(|b| cell_offset(b.owner as usize, &b.centre));
            self.offsets = cells.chain(faces).map(|v| (v / size) as f32).collect();
        }
    }
}

/// Root of the mean square, 1 where nothing varies (a single segment has no distance from the centre).
fn rms(sum: f64, count: f64) -> f64 {
    let value = (sum / count.max(1.0)).sqrt();
    if value > 0.0 { value } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Graph;
    use crate::segment;
    use m4gn_modes::Modal;
    use m4gn_samples::mesh as sample;
    use m4gn_samples::model::spec;

    /// Four cells in a row of unit squares, two segments: centroids at 1 and 3, centre 2, cells half a unit from
    /// their centroid.
    #[test]
    fn a_row_of_four_cells() {
        let comm = Comm::serial();
        let mesh = sample::rectangle(4, 1, 4.0, 1.0);
        let mut graph = Graph::new(&mesh, &comm).unwrap();
        let mut s = spec();
        s.segments.count = 2;
        let mut found =
            segment(&mesh, &mut graph, &s.segments, &Modal::default(), &comm, Some(&[0, 0, 1, 1])).unwrap();
        let stage = &mut s.architecture.m4gn_mut().unwrap().segment_transformer;
        stage.rwse_steps = 0;
        found.encode(&s, &mesh, &comm);
        assert_eq!(found.position, [-1.0, 0.0, 1.0, 0.0]);
        assert_eq!(found.offsets[..8], [-1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0]);
        assert_eq!(found.offsets.len(), 2 * graph.n_owned);
    }
}
