//! Whether a mesh hangs together.

use crate::Mesh;
use std::collections::HashMap;

impl Mesh {
    /// How many parts the mesh has that neither an internal nor a cyclic face joins, of a mesh on one rank: 1 of most.
    pub fn parts(&self) -> usize {
        let own: HashMap<i64, i32> = self.cell_global.iter().copied().zip(0..).collect();
        let internal = self
            .face_owner
            .iter()
            .copied()
            .zip(self.face_neighbour.iter().copied());
        let cyclic = self
            .coupled
            .iter()
            .filter_map(|face| Some((face.owner, *own.get(&face.global)?)));
        let mut parent: Vec<usize> = (0..self.n_cells()).collect();
        let mut parts = self.n_cells();
        for (a, b) in internal.chain(cyclic) {
            let (a, b) = (root(&mut parent, a as usize), root(&mut parent, b as usize));
            if a != b {
                parent[a] = b;
                parts -= 1;
            }
        }
        parts
    }
}

/// The cell that stands for the part of this one; the way to it is made shorter.
fn root(parent: &mut [usize], mut cell: usize) -> usize {
    while parent[cell] != cell {
        parent[cell] = parent[parent[cell]];
        cell = parent[cell];
    }
    cell
}

#[cfg(test)]
mod tests {
    use crate::{CoupledFace, Mesh};

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
        assert_eq!(mesh.parts(), 2);
        mesh.face_owner.push(1);
        mesh.face_neighbour.push(2);
        assert_eq!(mesh.parts(), 1);
    }

    #[test]
    fn a_cyclic_joins_cells() {
        let mut mesh = halves();
        let side = |owner, global| CoupledFace {
            owner,
            rank: 0,
            global,
            delta: [1.0, 0.0, 0.0],
            coeff: 1.0,
        };
        mesh.coupled = vec![side(0, 3), side(3, 0)];
        assert_eq!(mesh.parts(), 1);
    }
}
