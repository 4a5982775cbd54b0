//! Which cells form a group: METIS on the undecomposed graph of cells numbered by their places, without the couplings of cyclic patches.

use crate::cell_graph::{CellGraph, by_place, counted};
use crate::partition::partition_finely;
use m4gn_base::Result;
use m4gn_mesh::vector::norm;
use m4gn_mesh::{Ghosts, Mesh};
use m4gn_model::cell_size;
use m4gn_parallel::{Comm, everywhere};

/// What lies behind each coupled face: the other cell's number, and how far a cyclic patch shifts it.
#[derive(Debug)]
pub(super) struct Links {
    /// Global number of the cell behind each of [`Mesh::coupled`].
    pub cell: Vec<i64>,
    /// From where that cell is to where this side sees it, m; exactly 0 but for cyclic patches.
    pub shift: Vec<[f64; 3]>,
    ghosts: Ghosts,
}

impl Links {
    /// Collective; all ranks fail together.
    pub fn new(mesh: &Mesh, comm: &Comm) -> Result<Self> {
        let mut ghosts = Ghosts::of(mesh, comm)?;
        let mut centres = vec![0f32; 3 * ghosts.n_local(mesh)];
        for (row, centre) in centres.chunks_exact_mut(3).zip(&mesh.cell_centres) {
            (0..3).for_each(|i| row[i] = centre[i] as f32);
        }
        ghosts.halo.exchange_f32(comm, &mut centres, 3);
        let shift = mesh.coupled.iter().zip(&ghosts.behind).map(|(face, &node)| {
            let here = mesh.cell_centres[face.owner as usize];
            let there = &centres[3 * node as usize..][..3];
            let shift: [f64; 3] = std::array::from_fn(|i| here[i] + face.delta[i] - f64::from(there[i]));
            // The other centre came in single precision.
            let largest = norm(here).max(norm(face.delta));
            match norm(shift) > 1e-5 * largest.max(f64::MIN_POSITIVE) && norm(shift) > 0.1 * norm(face.delta)
            {
                true => shift,
                false => [0.0; 3],
            }
        });
        Ok(Links {
            cell: mesh.coupled.iter().map(|face| face.global).collect(),
            shift: shift.collect(),
            ghosts,
        })
    }

    /// Values behind each coupled face from values of this rank's cells. Collective.
    pub fn behind(&self, mesh: &Mesh, cells: &[i32], comm: &Comm) -> Vec<i32> {
        let mut values = vec![0i64; self.ghosts.n_local(mesh)];
        values.iter_mut().zip(cells).for_each(|(v, &c)| *v = i64::from(c));
        self.ghosts.halo.clone().exchange_i64(comm, &mut values, 1);
        let behind = self.ghosts.behind.iter();
        behind.map(|&node| values[node as usize] as i32).collect()
    }
}

/// The group of each of this rank's cells, numbered by the places of their first cells, and the number of groups; none where the mesh is about
/// as coarse as that. Collective; all ranks fail together.
pub(super) fn agglomerate(
    mesh: &Mesh,
    links: &Links,
    edge_length: f64,
    comm: &Comm,
) -> Result<Option<(Vec<i32>, usize)>> {
    let n = comm.total(mesh.n_cells()) as usize;
    let ratio = (cell_size(mesh, comm) / edge_length).min(1.0);
    let wanted = (n as f64 * ratio.powi(mesh.dim() as i32)).round().max(1.0) as usize;
    if 4 * wanted > 3 * n {
        return Ok(None);
    }
    counted(mesh, comm)?;
    let number: Vec<i32> = by_place(mesh, comm).into_iter().map(|i| i as i32).collect();
    let behind = links.behind(mesh, &number, comm);
    let mut pairs: Vec<i32> = Vec::new();
    for (&a, &b) in mesh.face_owner.iter().zip(&mesh.face_neighbour) {
        pairs.extend([a, b].map(|c| number[c as usize]));
    }
    for ((face, other), shift) in mesh.coupled.iter().zip(behind).zip(&links.shift) {
        let own = number[face.owner as usize];
        if own < other && *shift == [0.0; 3] {
            pairs.extend([own, other]);
        }
    }
    let pairs = comm.gather(&pairs);
    let found = match pairs {
        Some(pairs) => {
            let graph = CellGraph::new(n, pairs.concat().as_chunks::<2>().0);
            partition_finely(&graph, wanted).map(in_order)
        }
        None => Ok(Vec::new()),
    };
    let mut labels = comm.agree(found)?;
    comm.broadcast(&mut labels);
    let count = labels.iter().max().map_or(0, |&last| last as usize + 1);
    let own = number.iter().map(|&cell| labels[cell as usize]);
    Ok(Some((own.collect(), count)))
}

/// The same groups, numbered as they first occur.
fn in_order(mut labels: Vec<i32>) -> Vec<i32> {
    let mut number = vec![-1; labels.len()];
    let mut next = 0;
    for label in &mut labels {
        let number = &mut number[*label as usize];
        if *number < 0 {
            *number = next;
            next += 1;
        }
        *label = *number;
    }
    labels
}

/// Rows of numbers of all ranks, in the order of the ranks. Collective.
pub(super) fn all_rows<const N: usize>(comm: &Comm, rows: &[[f64; N]]) -> Vec<[f64; N]> {
    let all = everywhere(comm, rows.as_flattened());
    all.as_chunks::<N>().0.to_vec()
}
