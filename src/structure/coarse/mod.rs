//! A graph of the network's own resolution: cells agglomerated into groups, and the way of fields to the groups and back.
//!
//! A network that lives on groups of a given edge length costs the same on a finer mesh and meets there the graph that
//! it was trained on. Fields go to the groups as averages ([`Transfer::restrict`]); the change that the network predicts
//! comes back linearly within each group, its mean kept exactly ([`Transfer::prolong`]), so that what is finer than the
//! groups stays in the solver's own fields.
//!
//! The groups are a [`Mesh`] like any other: centres, volumes, merged faces and boundary faces. Graph, modes, segments and
//! network are made of it by what makes them of a solver's mesh. Groups do not depend on the number of ranks; a group may
//! straddle ranks, and its node lives with the rank of its lowest cell.

mod gradients;
mod groups;
mod merged;
#[cfg(test)]
mod tests;
mod transfer;

pub use transfer::{Restricted, Transfer};

use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::{ElasticModes, Mesh};
use m4gn_parallel::Comm;

/// Groups of cells as a mesh of their own, and how fields get there and back.
#[derive(Clone, Debug)]
pub struct Coarse {
    /// This rank's part of the mesh of groups.
    pub mesh: Mesh,
    /// Group of each of this rank's cells, in the groups' global numbering.
    pub group: Vec<i32>,
    /// Groups of all ranks.
    pub n_groups: usize,
    /// Restriction and prolongation.
    pub transfer: Transfer,
}

impl Coarse {
    /// Agglomerates a mesh so that neighbouring groups are on average `edge_length` (m) apart; none where the mesh is about
    /// as coarse as that, with less than 4 cells for 3 groups. Collective; all ranks fail together.
    ///
    /// Groups have about equal numbers of cells, so that they are finer where the mesh is finer.
    ///
    /// # Errors
    /// [`Error::Input`] for an edge length that is not positive; [`Error::Mesh`] for a mesh without cells, such as a body at points;
    /// what METIS may fail with.
    pub fn new(mesh: &Mesh, edge_length: f64, comm: &Comm) -> Result<Option<Self>> {
        comm.agree(refuse(!(edge_length > 0.0 && edge_length.is_finite()), Error::Input, || {
            format!("resolution: expected a positive length in m, found {edge_length}")
        }))?;
        mesh.check(comm)?;
        let links = groups::Links::new(mesh, comm)?;
        let Some((group, n_groups)) = groups::agglomerate(mesh, &links, edge_length, comm)? else {
            return Ok(None);
        };
        let merged = merged::Merged::new(mesh, &links, &group, n_groups, comm);
        let transfer = Transfer::new(mesh, &group, &merged, comm);
        let elastic = mesh.elastic.as_ref().map(|fine| ElasticModes {
            eigenvalues: fine.eigenvalues.clone(),
            vectors: fine.vectors.iter().map(|mode| transfer.means(mode, comm)).collect(),
        });
        Ok(Some(Coarse { mesh: Mesh { elastic, ..merged.part(comm.rank()) }, transfer, group, n_groups }))
    }

    /// The label of each of this rank's groups from labels of the cells: that of the group's lowest cell. Collective.
    pub fn labels_of_groups(&self, mesh: &Mesh, cells: &[i32], comm: &Comm) -> Vec<i32> {
        let mut lowest = vec![i64::MAX; self.n_groups];
        for (&group, &cell) in self.group.iter().zip(&mesh.cell_global) {
            let lowest = &mut lowest[group as usize];
            *lowest = (*lowest).min(cell);
        }
        comm.min_i64(&mut lowest);
        let mut labels = vec![i64::MIN; self.n_groups];
        for ((&group, cell), &label) in self.group.iter().zip(&mesh.cell_global).zip(cells) {
            if lowest[group as usize] == *cell {
                labels[group as usize] = i64::from(label);
            }
        }
        comm.max_i64(&mut labels);
        let own = self.mesh.cell_global.iter();
        own.map(|&g| i32::try_from(labels[g as usize]).unwrap_or(-1)).collect()
    }

    /// The label of each of this rank's cells from labels of this rank's groups. Collective.
    pub fn labels_of_cells(&self, groups: &[i32], comm: &Comm) -> Vec<i32> {
        let mut labels = vec![i64::MIN; self.n_groups];
        for (&group, &label) in self.mesh.cell_global.iter().zip(groups) {
            labels[group as usize] = i64::from(label);
        }
        comm.max_i64(&mut labels);
        let cells = self.group.iter();
        cells.map(|&g| i32::try_from(labels[g as usize]).unwrap_or(-1)).collect()
    }
}
