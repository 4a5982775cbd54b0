//! A step of a network that lives on groups of cells: fields go there as averages, their change comes back.

use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Mesh;
use m4gn_model::{ModelSpec, Output};
use m4gn_parallel::Comm;
use m4gn_structure::coarse::Coarse;

use super::Cells;
use crate::Predict;

/// The groups, and what the network reads and writes there.
pub struct OnGroups {
    pub coarse: Coarse,
    /// Components of a state.
    width: usize,
    /// Of each output whose field is an input too: the component, and whether the output is a value, not a change.
    inputs: Vec<Option<(usize, bool)>>,
}

impl OnGroups {
    /// Groups of a resolution (m); none if there is to be none, or if the mesh is not finer. Collective; all ranks fail
    /// together.
    ///
    /// # Errors
    /// As [`Coarse::new`].
    pub fn new(mesh: &Mesh, resolution: Option<f64>, spec: &ModelSpec, comm: &Comm) -> Result<Option<Self>> {
        let Some(length) = resolution else { return Ok(None) };
        let Some(coarse) = Coarse::new(mesh, length, comm)? else {
            return Ok(None);
        };
        let (mut inputs, mut column) = (Vec::new(), 0);
        for field in &spec.fields {
            let n = field.components(spec.dim);
            if field.output != Output::None {
                let value = field.output == Output::Value;
                inputs.extend((0..n).map(|i| field.input.then_some((column + i, value))));
            }
            column += n;
        }
        Ok(Some(OnGroups { width: column, coarse, inputs }))
    }

    /// Labels of this rank's groups from labels of all cells. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of labels than cells.
    pub fn labels(&self, mesh: &Mesh, cells: &[i32], comm: &Comm) -> Result<Vec<i32>> {
        let checked = refuse(cells.len() != mesh.n_cells(), Error::Input, || {
            format!("{} segment labels for {} cells of rank {}", cells.len(), mesh.n_cells(), comm.rank())
        });
        comm.agree(checked)?;
        Ok(self.coarse.labels_of_groups(mesh, cells, comm))
    }

    /// The network's outputs at the cells, for a state of cells and boundary faces: what it changes at the groups is carried back, and what
    /// is finer than these stays. Collective.
    ///
    /// # Errors
    /// As [`Predict::predict`].
    pub fn predict(
        &self,
        comm: &Comm,
        network: &mut dyn Predict,
        domain: &Cells,
        state: &[f32],
    ) -> Result<Vec<f32>> {
        let (m, width) = (self.inputs.len(), self.width);
        let transfer = &self.coarse.transfer;
        let mut restricted = transfer.restrict(state, width, comm);
        let outputs = network.predict(comm, domain, &mut restricted.values, &[])?;
        let before: Vec<Option<usize>> = self
            .inputs
            .iter()
            .map(|input| input.and_then(|(column, value)| value.then_some(column)))
            .collect();
        let mut changes: Vec<f64> = outputs.iter().map(|&y| f64::from(y)).collect();
        for (change, row) in changes.chunks_exact_mut(m).zip(restricted.values.chunks_exact(width)) {
            for (y, column) in change.iter_mut().zip(&before) {
                *y -= column.map_or(0.0, |c| f64::from(row[c]));
            }
        }
        let walls = transfer.at_walls(state, &restricted, comm);
        let at_walls: Vec<f64> = walls
            .chunks_exact(width)
            .flat_map(|row| self.inputs.iter().map(|input| input.map_or(0.0, |(column, _)| row[column])))
            .collect();
        let fine = transfer.prolong(&changes, &at_walls, comm);
        let rows = fine.chunks_exact(m).zip(state.chunks_exact(width));
        let outputs = rows.flat_map(|(change, row)| {
            let pairs = change.iter().zip(&before);
            pairs.map(|(change, column)| (change + column.map_or(0.0, |c| f64::from(row[c]))) as f32)
        });
        Ok(outputs.collect())
    }
}
