//! Whether a mesh hangs together.

use super::cell_graph::CellGraph;
use m4gn_mesh::Mesh;
use std::collections::HashMap;

/// How many parts a mesh has that neither an internal nor a cyclic face joins, of a mesh on one rank: 1 of most.
pub fn parts(mesh: &Mesh) -> usize {
    let own: HashMap<i64, i32> = mesh.cell_global.iter().copied().zip(0..).collect();
    let internal = mesh.face_owner.iter().zip(&mesh.face_neighbour);
    let cyclic = mesh.coupled.iter();
    let cyclic = cyclic.filter_map(|face| Some((&face.owner, own.get(&face.global)?)));
    let pairs: Vec<[i32; 2]> = internal.chain(cyclic).map(|(&a, &b)| [a, b]).collect();
    CellGraph::new(mesh.n_cells(), &pairs).pieces(|_| 0).len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_mesh::CoupledFace;

    /// Four cells in a row, without the face in the middle.
    fn halves() -> Mesh {
        Mesh {
            cell_global: vec![0, 1, 2, 3],
            cell_centres: vec![[0.0; 3]; 4],
            cell_volumes: vec![1.0; 4],
            face_owner: vec![0, 2],
            face_neighbour: vec![1, 3],
            ..Default::default()
        }
    }

    #[test]
    fn faces_join_cells() {
        let mut mesh = halves();
        assert_eq!(parts(&mesh), 2);
        mesh.face_owner.push(1);
        mesh.face_neighbour.push(2);
        assert_eq!(parts(&mesh), 1);
    }

    #[test]
    fn a_cyclic_joins_cells() {
        let mut mesh = halves();
        let side = |owner, global| CoupledFace { owner, rank: 0, global, delta: [1.0, 0.0, 0.0], coeff: 1.0 };
        mesh.coupled = vec![side(0, 3), side(3, 0)];
        assert_eq!(parts(&mesh), 1);
    }
}
