//! What lies behind coupled faces: cells of other ranks (ghosts), or cells of this rank through a cyclic.

use crate::{CoupledFace, Mesh};
use m4gn_base::{Error, Result};
use m4gn_parallel::{Comm, Halo};
use std::collections::HashMap;

/// Cells of other ranks that this rank's coupled faces lead to, and how their values come here.
///
/// Local nodes are this rank's cells, then its boundary faces, then ghosts by (rank, global cell).
#[derive(Clone, Debug)]
pub struct Ghosts {
    /// Rank and global number of each ghost, ascending.
    pub cells: Vec<(i32, i64)>,
    /// Local node behind each of [`Mesh::coupled`]: a ghost, or an own cell behind a cyclic.
    pub behind: Vec<i32>,
    /// Which owned values go to which rank, and where ghosts come from.
    pub halo: Halo,
}

impl Ghosts {
    /// Those of a mesh that was checked ([`Mesh::check`]). Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a coupled face whose other side is not found or has no coupled face back.
    pub fn of(mesh: &Mesh, comm: &Comm) -> Result<Self> {
        let me = comm.rank();
        let mut cells: Vec<(i32, i64)> =
            mesh.coupled.iter().filter(|c| c.rank != me).map(|c| (c.rank, c.global)).collect();
        cells.sort_unstable();
        cells.dedup();
        let halo = Halo::new(comm, &mesh.cell_global, &cells, mesh.n_nodes())?;
        let behind = comm.agree(behind(mesh, &cells, me))?;
        comm.agree(check_mirrored(mesh, &cells, &halo, me))?;
        Ok(Ghosts { cells, behind, halo })
    }

    /// Owned nodes and ghosts.
    pub fn n_local(&self, mesh: &Mesh) -> usize {
        mesh.n_nodes() + self.cells.len()
    }
}

fn behind(mesh: &Mesh, ghosts: &[(i32, i64)], me: i32) -> Result<Vec<i32>> {
    let own: HashMap<i64, i32> = match mesh.coupled.iter().any(|c| c.rank == me) {
        true => mesh.cell_global.iter().enumerate().map(|(i, &g)| (g, i as i32)).collect(),
        false => HashMap::new(),
    };
    let n_owned = mesh.n_nodes();
    let node = |c: &CoupledFace| match c.rank == me {
        true => own.get(&c.global).copied(),
        false => ghosts.binary_search(&(c.rank, c.global)).ok().map(|i| (n_owned + i) as i32),
    };
    mesh.coupled
        .iter()
        .enumerate()
        .map(|(i, c)| {
            node(c).ok_or_else(|| {
                Error::Mesh(format!(
                    "coupled_global[{i}] is {} with coupled_rank {me}, this rank, which does not own that cell",
                    c.global
                ))
            })
        })
        .collect()
}

/// A rank that we receive from must also receive from us: coupled faces have two sides.
fn check_mirrored(mesh: &Mesh, ghosts: &[(i32, i64)], halo: &Halo, me: i32) -> Result<()> {
    if let Some((rank, _)) = ghosts.iter().find(|(r, _)| !halo.sends_to(*r)) {
        let face = mesh.coupled.iter().position(|c| c.rank == *rank).unwrap_or(0);
        return Err(Error::Mesh(format!(
            "coupled face {face} of rank {me} leads to rank {rank}, which has no coupled face back: expected one \
             entry on each side"
        )));
    }
    Ok(())
}
