//! Where segments lie: the geometric part of the positional encoding (section 3.4.1 leaves the choice open).

use super::Segmentation;
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_model::ModelSpec;

/// What a network reads of the segments besides their members.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SegmentFeatures {
    /// `[K x n_position_features]`: random walk, then the centroid from the domain's centre over the centroids' rms
    /// distance from it.
    pub position: Vec<f32>,
    /// `[n_owned x n_offset_features]`: a node's displacement from its segment's centroid over the rms displacement.
    pub offsets: Vec<f32>,
}

/// The features that `spec` asks for. Collective.
pub fn features(spec: &ModelSpec, mesh: &Mesh, segments: &Segmentation, comm: &Comm) -> SegmentFeatures {
    let Some(stage) = spec.architecture.segment_transformer() else {
        return SegmentFeatures::default();
    };
    let walk = segments.rwse(stage.rwse_steps);
    if !stage.centroids && !stage.offsets {
        return SegmentFeatures {
            position: walk,
            offsets: Vec::new(),
        };
    }
    let (k, dim) = (segments.count, mesh.dim());
    let place = |x: &[f64; 3], i: usize| x[mesh.directions[i]];
    // Sums over cells: boundary faces belong to their owner's segment and do not move its centroid.
    let mut sums = vec![0.0; k * (dim + 1)];
    for (cell, x) in mesh.cell_centres.iter().enumerate() {
        let row = &mut sums[segments.node_segment[cell] as usize * (dim + 1)..][..dim + 1];
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
    let from_centre: Vec<f64> = centroids
        .chunks_exact(dim)
        .flat_map(|c| c.iter().zip(&centre).map(|(c, m)| c - m))
        .collect();
    let spread = rms(from_centre.iter().map(|v| v * v).sum(), k as f64);

    let cell_offset = |cell: usize, x: &[f64; 3]| -> Vec<f64> {
        let s = segments.node_segment[cell] as usize;
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

    let position = if stage.centroids {
        let steps = stage.rwse_steps;
        (0..k)
            .flat_map(|s| {
                let centroid = from_centre[s * dim..(s + 1) * dim]
                    .iter()
                    .map(|v| (v / spread) as f32);
                walk[s * steps..(s + 1) * steps]
                    .iter()
                    .copied()
                    .chain(centroid)
                    .collect::<Vec<_>>()
            })
            .collect()
    } else {
        walk
    };
    let offsets = if stage.offsets {
        let cells = mesh
            .cell_centres
            .iter()
            .enumerate()
            .flat_map(|(cell, x)| cell_offset(cell, x));
        let faces = mesh
            .boundary
            .iter()
            .flat_map(|b| cell_offset(b.owner as usize, &b.centre));
        cells.chain(faces).map(|v| (v / size) as f32).collect()
    } else {
        Vec::new()
    };
    SegmentFeatures { position, offsets }
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
    use m4gn_mesh::sample;
    use m4gn_model::sample::spec;
    use m4gn_modes::Modal;

    /// Four cells in a row of unit squares, two segments: centroids at 1 and 3, centre 2, cells half a unit from
    /// their centroid.
    #[test]
    fn a_row_of_four_cells() {
        let comm = Comm::serial();
        let mesh = sample::rectangle(4, 1, 4.0, 1.0);
        let mut graph = Graph::new(&mesh, &comm).unwrap();
        let mut s = spec();
        s.segments.count = 2;
        let segments = segment(
            &mesh,
            &mut graph,
            &s.segments,
            &Modal::default(),
            &comm,
            Some(&[0, 0, 1, 1]),
        )
        .unwrap();
        let stage = &mut s.architecture.m4gn_mut().unwrap().segment_transformer;
        stage.rwse_steps = 0;
        let found = features(&s, &mesh, &segments, &comm);
        assert_eq!(found.position, [-1.0, 0.0, 1.0, 0.0]);
        assert_eq!(found.offsets[..8], [-1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0]);
        assert_eq!(found.offsets.len(), 2 * graph.n_owned);
    }
}
