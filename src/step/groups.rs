//! A step of a network that lives on groups of cells: fields go there as averages, their change comes back.

use m4gn_engine::Forward;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_model::{ModelSpec, Output};
use m4gn_structure::coarse::Coarse;

/// The groups, and what the network reads and writes there.
pub struct OnGroups {
    pub coarse: Coarse,
    width: usize,
    /// Of each output whose field is an input too: the input's column, and whether the output is a value, not a change.
    inputs: Vec<Option<(usize, bool)>>,
    outputs: Vec<f32>,
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
            column += if field.input { n } else { 0 };
        }
        Ok(Some(OnGroups {
            outputs: vec![0.0; coarse.mesh.n_cells() * spec.n_outputs()],
            width: spec.n_field_inputs(),
            coarse,
            inputs,
        }))
    }

    /// Labels of this rank's groups from labels of all cells. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of labels than cells.
    pub fn labels(&self, mesh: &Mesh, cells: &[i32], comm: &Comm) -> Result<Vec<i32>> {
        let checked = match cells.len() == mesh.n_cells() {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "{} segment labels for {} cells of rank {}",
                cells.len(),
                mesh.n_cells(),
                comm.rank()
            ))),
        };
        comm.agree(checked)?;
        Ok(self.coarse.labels_of_groups(mesh, cells, comm))
    }

    /// As [`Forward::forward`] on cells: `inputs` of cells and boundary faces, `outputs` of cells. What the network
    /// changes is carried back; what is finer than the groups stays. Collective.
    ///
    /// # Errors
    /// As [`Forward::forward`].
    pub fn forward(
        &mut self,
        comm: &Comm,
        network: &mut dyn Forward,
        inputs: &[f32],
        outputs: &mut [f32],
    ) -> Result<()> {
        let m = self.inputs.len();
        let transfer = &self.coarse.transfer;
        let restricted = transfer.restrict(inputs, self.width, comm);
        network.forward(comm, &restricted.values, &mut self.outputs)?;
        let before: Vec<Option<usize>> = self
            .inputs
            .iter()
            .map(|input| input.and_then(|(column, value)| value.then_some(column)))
            .collect();
        let mut changes: Vec<f64> = self.outputs.iter().map(|&y| f64::from(y)).collect();
        for (change, row) in changes
            .chunks_exact_mut(m)
            .zip(restricted.values.chunks_exact(self.width))
        {
            for (y, column) in change.iter_mut().zip(&before) {
                *y -= column.map_or(0.0, |c| f64::from(row[c]));
            }
        }
        let walls = transfer.at_walls(inputs, &restricted, comm);
        let at_walls: Vec<f64> = walls
            .chunks_exact(self.width)
            .flat_map(|row| {
                self.inputs
                    .iter()
                    .map(|input| input.map_or(0.0, |(column, _)| row[column]))
            })
            .collect();
        let fine = transfer.prolong(&changes, &at_walls, comm);
        let rows = outputs.chunks_exact_mut(m).zip(fine.chunks_exact(m));
        for ((to, change), row) in rows.zip(inputs.chunks_exact(self.width)) {
            for ((to, change), column) in to.iter_mut().zip(change).zip(&before) {
                *to = (change + column.map_or(0.0, |c| f64::from(row[c]))) as f32;
            }
        }
        Ok(())
    }
}
