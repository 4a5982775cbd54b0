//! Recording from all ranks of a solver: gathered to the root in the undecomposed mesh's order, written there.

use super::{FieldMeta, Frame, WriteOptions, Writer};
use m4gn_base::{Error, Result};
use m4gn_mesh::whole::whole_mesh;
use m4gn_mesh::{Field, Mesh};
use m4gn_parallel::Comm;
use std::path::Path;

/// A trajectory being recorded by all ranks of a communicator.
///
/// All methods but [`Recorder::n_frames`] are collective and give the same class of result on every rank.
/// Dropped before [`Recorder::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Recorder {
    comm: Comm,
    fields: Vec<FieldMeta>,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    n_frames: usize,
    root: Option<Root>,
}

/// What the root has: the file, and where each rank's rows go.
#[derive(Debug)]
struct Root {
    writer: Writer,
    /// For each rank, the global numbers of its cells.
    cells: Vec<Vec<i64>>,
    /// For each rank, the global numbers of its boundary faces.
    boundary: Vec<Vec<i64>>,
    n_cells: usize,
    n_boundary: usize,
}

impl Recorder {
    /// Starts a file. Collective.
    ///
    /// # Errors
    /// As [`Mesh::check`]; what [`Writer::create`] says.
    pub fn create(comm: &Comm, mesh: &Mesh, path: &Path, options: &WriteOptions) -> Result<Self> {
        mesh.check(comm)?;
        let cells = comm.gather(&mesh.cell_global);
        let numbers: Vec<i64> = mesh.boundary.iter().map(|f| f.global).collect();
        let boundary = comm.gather(&numbers);
        let root = match (cells, boundary, whole_mesh(comm, mesh)) {
            (Some(cells), Some(boundary), Some(whole)) => {
                let (n_cells, n_boundary) = (whole.n_cells(), whole.boundary.len());
                Writer::create(path, &whole, options)
                    .map(|writer| Some(Root { writer, cells, boundary, n_cells, n_boundary }))
            }
            _ => Ok(None),
        };
        Ok(Recorder {
            root: comm.agree(root)?,
            comm: comm.clone(),
            fields: options.fields.clone(),
            directions: mesh.directions.clone(),
            n_cells: mesh.n_cells(),
            n_boundary: mesh.boundary.len(),
            n_frames: 0,
        })
    }

    /// Appends a frame with all fields, by name. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Numerical`] leave the recording as it was; after [`Error::File`] it is
    /// given up (see [`Writer::append`]).
    pub fn append(&mut self, time: f64, values: &[Field]) -> Result<()> {
        let local = self.comm.agree(self.select(values))?;
        let gathered = self.comm.gather(&local);
        let result = match (&mut self.root, gathered) {
            (Some(root), Some(ranks)) => {
                let widths: Vec<usize> =
                    self.fields.iter().map(|f| f.components(self.directions.len())).collect();
                root.frames(&ranks, &widths).and_then(|frames| root.writer.append(time, &frames))
            }
            _ => Ok(()),
        };
        self.comm.agree(result)?;
        self.n_frames += 1;
        Ok(())
    }

    /// Number of frames so far.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Completes the file and gives it its final name. Collective; appending is an error afterwards.
    ///
    /// # Errors
    /// What [`Writer::finish`] says.
    pub fn finish(&mut self) -> Result<()> {
        let result = self.root.as_mut().map_or(Ok(()), |root| root.writer.finish());
        self.comm.agree(result)
    }

    /// This rank's values as they are stored: for each field its cells, then its boundary faces.
    fn select(&self, values: &[Field]) -> Result<Vec<f32>> {
        let mut local = Vec::new();
        for field in &self.fields {
            let name = &field.name;
            let given = values
                .iter()
                .find(|v| v.name == name)
                .ok_or_else(|| Error::Input(format!("field {name} is missing from the frame")))?;
            let c = if field.vector { 3 } else { 1 };
            let (n, b) = (c * self.n_cells, c * self.n_boundary);
            if given.components != c || given.cells.len() != n || given.boundary.len() != b {
                return Err(Error::Input(format!(
                    "field {name}: {} components with {} cell and {} boundary values, expected {c}, {n} and {b}",
                    given.components,
                    given.cells.len(),
                    given.boundary.len()
                )));
            }
            for part in [given.cells, given.boundary] {
                if field.vector {
                    local.extend(
                        part.chunks_exact(3).flat_map(|v| self.directions.iter().map(|&d| v[d] as f32)),
                    );
                } else {
                    local.extend(part.iter().map(|&v| v as f32));
                }
            }
        }
        Ok(local)
    }
}

impl Root {
    /// Puts what the ranks sent into the undecomposed order.
    fn frames(&self, ranks: &[Vec<f32>], widths: &[usize]) -> Result<Vec<Frame>> {
        let mut frames: Vec<Frame> = widths
            .iter()
            .map(|c| Frame { cells: vec![0.0; self.n_cells * c], boundary: vec![0.0; self.n_boundary * c] })
            .collect();
        for (rank, values) in ranks.iter().enumerate() {
            let mut rest = values.as_slice();
            for (frame, &c) in frames.iter_mut().zip(widths) {
                for (target, rows) in
                    [(&mut frame.cells, &self.cells[rank]), (&mut frame.boundary, &self.boundary[rank])]
                {
                    let Some((part, after)) = rest.split_at_checked(rows.len() * c) else {
                        return Err(Error::Internal(format!("rank {rank} sent {} values", values.len())));
                    };
                    for (row, value) in rows.iter().zip(part.chunks_exact(c)) {
                        let start = *row as usize * c;
                        target[start..start + c].copy_from_slice(value);
                    }
                    rest = after;
                }
            }
        }
        Ok(frames)
    }
}
