//! A step of a network that lives on groups of cells: fields go there as averages, their change comes back.

use m4gn_engine::Forward;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_model::{ModelSpec, Output};
use m4gn_segments::coarse::Coarse;

/// The groups, and what the network reads and writes there.
pub struct OnGroups {
    pub coarse: Coarse,
    width: usize,
    /// Of each output that is a value of a field which is an input too: the input's column.
    before: Vec<Option<usize>>,
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
        let (mut before, mut column) = (Vec::new(), 0);
        for field in &spec.fields {
            let n = field.components(spec.dim);
            if field.output != Output::None {
                let value = field.output == Output::Value && field.input;
                before.extend((0..n).map(|i| value.then_some(column + i)));
            }
            column += if field.input { n } else { 0 };
        }
        Ok(Some(OnGroups {
            outputs: vec![0.0; coarse.mesh.n_cells() * spec.n_outputs()],
            width: spec.n_field_inputs(),
            coarse,
            before,
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
        let m = self.before.len();
        let restricted = self.coarse.transfer.restrict(inputs, self.width, comm);
        network.forward(comm, &restricted, &mut self.outputs)?;
        let mut changes: Vec<f64> = self.outputs.iter().map(|&y| f64::from(y)).collect();
        let rows = changes
            .chunks_exact_mut(m)
            .zip(restricted.chunks_exact(self.width));
        for (change, before) in rows {
            for (y, column) in change.iter_mut().zip(&self.before) {
                *y -= column.map_or(0.0, |c| f64::from(before[c]));
            }
        }
        let fine = self.coarse.transfer.prolong(&changes, m, comm);
        let rows = outputs.chunks_exact_mut(m).zip(fine.chunks_exact(m));
        for ((to, change), before) in rows.zip(inputs.chunks_exact(self.width)) {
            for ((to, change), column) in to.iter_mut().zip(change).zip(&self.before) {
                *to = (change + column.map_or(0.0, |c| f64::from(before[c]))) as f32;
            }
        }
        Ok(())
    }
}
