//! Coarser graphs of a body (BSMS-GNN). They are those of its mesh at rest, obstacle included, and stay; the deformation of their edges is
//! that of each state. World edges are of the finest graph alone.

use super::graph::{Body, MeshEdge, N_FEATURES, by_ends, mesh_features};
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_mesh::vector::norm;
use m4gn_parallel::Comm;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Level, bi_stride};

impl Body {
    /// `count` coarser graphs at rest. `mesh` is this rank's dual mesh, `graph` the body's. Collective; all ranks fail together.
    ///
    /// # Errors
    /// As [`bi_stride`].
    pub(super) fn coarser(
        &self,
        mesh: &Mesh,
        graph: &Graph,
        count: usize,
        comm: &Comm,
    ) -> Result<Vec<Level>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let vector = |e: &MeshEdge| [e.rest[0], e.rest[1], e.rest[2], norm(e.rest)].map(|v| v as f32);
        let mut at_rest = Graph {
            row: Vec::new(),
            senders: self.edges.iter().map(|e| e.sender).collect(),
            receivers: self.edges.iter().map(|e| e.receiver).collect(),
            edge_features: self.edges.iter().flat_map(vector).collect(),
            ..graph.clone()
        };
        let mut levels = bi_stride(mesh, &mut at_rest, count, comm)?;
        for Level { graph, .. } in &mut levels {
            let rows = graph.edge_features.as_chunks::<4>().0.iter();
            graph.edge_features = rows.flat_map(|&[x, y, z, _]| mesh_features([x, y, z], [0.0; 3])).collect();
        }
        Ok(levels)
    }
}

/// What the edges of a level are shorter by than those that they are sums of.
fn scales() -> impl Iterator<Item = f32> {
    std::iter::successors(Some(0.5), |scale| Some(0.5 * scale))
}

/// Gives coarser graphs the features of their edges at a displacement of all local nodes of the finest graph, m: a node moves by the mean
/// of the nodes that it stands for. Collective.
pub fn strain(comm: &Comm, displacement: &[f32], levels: &mut [Level]) {
    let mut finer: Vec<f32>;
    let mut from = displacement;
    for (Level { graph, down, .. }, scale) in levels.iter_mut().zip(scales()) {
        let mut own = vec![0.0; 3 * graph.n_local];
        down.add(0..graph.n_owned, 3, from, &mut own);
        graph.halo.exchange_f32(comm, &mut own, 3);
        let ends = graph.senders.iter().zip(&graph.receivers);
        for (row, (&s, &r)) in graph.edge_features.as_chunks_mut::<N_FEATURES>().0.iter_mut().zip(ends) {
            let added = |i: usize| scale * (own[3 * s as usize + i] - own[3 * r as usize + i]);
            *row = mesh_features([row[0], row[1], row[2]], std::array::from_fn(added));
        }
        finer = own;
        from = &finer;
    }
}

/// Adds the derivatives by the features of [`strain`] to that by the displacement. On one rank.
pub fn strain_backward(levels: &[Level], d_features: &[Vec<f32>], d_displacement: &mut [f32]) {
    let each = levels.iter().zip(d_features).zip(scales());
    let mut own: Vec<Vec<f32>> = each
        .map(|((Level { graph, .. }, d), scale)| {
            let mut own = vec![0.0; 3 * graph.n_local];
            by_ends(graph, d, scale, &mut own);
            own
        })
        .collect();
    for (l, level) in levels.iter().enumerate().rev() {
        let (finer, coarse) = own.split_at_mut(l);
        let finer = finer.last_mut().map_or(&mut *d_displacement, |f| f);
        level.up.add(0..finer.len() / 3, 3, &coarse[0], finer);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::part::BodyPart;
    use m4gn_samples::bodies as sample;

    /// Means keep what is linear: a stretch and a shear of body and obstacle are those of all edges, on every graph.
    #[test]
    fn an_even_deformation_is_that_of_every_coarser_edge() {
        let (body, obstacle) =
            (sample::block([4, 2, 2], [2.0, 1.0, 1.0]), sample::octahedron([1.0, 0.5, 1.8], 0.5));
        let part = BodyPart::whole(&body, Some(&obstacle)).unwrap();
        let (own, graph) = Body::new(&part, &sample::spec(0.6), &Comm::serial()).unwrap();
        let mut levels = own.coarser(&part.mesh, &graph, 2, &Comm::serial()).unwrap();
        let deform = |x: [f32; 3]| [0.1 * x[0] + 0.05 * x[2], -0.2 * x[1], 0.02 * x[0]];
        let places = body.positions.iter().chain(&obstacle.positions);
        let displacement: Vec<f32> = places.flat_map(|x| deform(x.map(|v| v as f32))).collect();
        assert_eq!(displacement.len(), 3 * graph.n_local);
        strain(&Comm::serial(), &displacement, &mut levels);
        for level in &levels {
            let rows = level.graph.edge_features.as_chunks::<N_FEATURES>().0;
            assert!(rows.len() > 8, "{}", rows.len());
            for row in rows {
                let added = deform([row[0], row[1], row[2]]);
                let off = (0..3).map(|i| (row[4 + i] - added[i]).abs()).fold(0.0, f32::max);
                assert!(off < 1e-6, "{row:?}");
                assert_eq!(row[8..], [0.0; 5]);
            }
        }
    }
}
