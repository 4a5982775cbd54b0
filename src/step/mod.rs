//! A session: one model on one mesh, stepping fields by name.
//!
//! This is what the C ABI and `m4gn validate` drive. Building one makes graph, modes and segments once; a step
//! turns fields into node features, runs the network, and turns its outputs into fields again.

mod body;
mod boundary;
mod case;
mod field;
mod options;

pub use body::BodySession;
pub use boundary::{copied_faces, faces_seen_as_their_cells, impose_boundary};
pub use field::{Field, FieldMut, OutputShape};
pub use options::{Backend, SessionOptions};

use crate::engine::torch::TorchBackend;
use crate::engine::{Engine, Forward, Precision, SegmentView};
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::model::{Model, ModelSpec, Output};
use crate::parallel::Comm;
use crate::segments;
use crate::{Error, Result};
use field::expect_shape;
use std::path::Path;

/// One model on one mesh.
pub struct Session {
    comm: Comm,
    spec: ModelSpec,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    n_segments: usize,
    cell_segment: Vec<i32>,
    /// Boundary faces whose vectors are read from their cells, and these cells.
    read_from_cells: Vec<(usize, usize)>,
    network: Box<dyn Forward>,
    /// Node features without the type `[n_owned x n_field_inputs]`.
    inputs: Vec<f32>,
    /// `[n_cells x n_outputs]`
    outputs: Vec<f32>,
    /// Fields at the end of the step, solved components only `[n_cells x n_outputs]`.
    result: Vec<f64>,
}

impl Session {
    /// Reads the model on the root, hands it to all ranks, and builds the session. Collective; all ranks fail
    /// together.
    ///
    /// # Errors
    /// [`Error::File`] for a model that cannot be used; otherwise as [`Session::new`].
    pub fn open(comm: Comm, mesh: &Mesh, path: &Path, options: &SessionOptions) -> Result<Self> {
        let bytes = if comm.is_root() {
            Model::read_bytes(path)
        } else {
            Ok(Vec::new())
        };
        let mut bytes = comm.agree(bytes)?;
        comm.broadcast(&mut bytes);
        let model = comm.agree(Model::from_bytes(&bytes, path))?;
        drop(bytes);
        let options = SessionOptions {
            model_path: Some(path.to_path_buf()),
            ..options.clone()
        };
        Self::new(comm, mesh, &model, &options)
    }

    /// Builds graph, modes and segments for a model. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Model`] when the model does not fit the case (dimension, node types); [`Error::Mesh`] for a mesh
    /// that no graph can be made of; [`Error::Input`] for options out of range, K larger than the number of cells
    /// among them; [`Error::Numerical`] when the modes cannot be computed.
    pub fn new(comm: Comm, mesh: &Mesh, model: &Model, options: &SessionOptions) -> Result<Self> {
        let spec = &model.spec;
        comm.agree(case::check(spec, mesh))?;
        let segment_spec = comm.agree(options.segment_spec(&spec.segments))?;
        let mut graph = Graph::new(mesh, &comm)?;
        let segmentation = match spec.architecture.segment_transformer {
            Some(_) => {
                let preset = preset(options.cell_segment.as_deref(), mesh.n_cells(), &comm);
                Some(segments::segment_with(
                    mesh,
                    &mut graph,
                    &segment_spec,
                    &options.modal,
                    &comm,
                    preset,
                )?)
            }
            None => None,
        };
        let network = {
            let features = segmentation
                .as_ref()
                .map(|s| segments::features(spec, mesh, s, &comm))
                .unwrap_or_default();
            let view = segmentation.as_ref().map(|s| SegmentView::new(s, &features));
            comm.agree(network(model, &graph, view.as_ref(), options, &comm))?
        };
        let n_cells = mesh.n_cells();
        Ok(Session {
            comm,
            directions: mesh.directions.clone(),
            n_cells,
            n_boundary: mesh.boundary.len(),
            n_segments: segmentation.as_ref().map_or(0, |s| s.count),
            cell_segment: segmentation.map_or(Vec::new(), |s| s.node_segment[..n_cells].to_vec()),
            read_from_cells: faces_seen_as_their_cells(mesh),
            network,
            inputs: vec![0.0; graph.n_owned * spec.n_field_inputs()],
            outputs: vec![0.0; n_cells * spec.n_outputs()],
            result: vec![0.0; n_cells * spec.n_outputs()],
            spec: spec.clone(),
        })
    }

    /// The model's description.
    pub fn spec(&self) -> &ModelSpec {
        &self.spec
    }

    /// Cells of this rank.
    pub fn n_cells(&self) -> usize {
        self.n_cells
    }

    /// Boundary faces of this rank.
    pub fn n_boundary(&self) -> usize {
        self.n_boundary
    }

    /// Segments K; 0 for a model without a macro stage.
    pub fn n_segments(&self) -> usize {
        self.n_segments
    }

    /// Segment of each of this rank's cells; empty for a model without a macro stage.
    pub fn cell_segment(&self) -> &[i32] {
        &self.cell_segment
    }

    /// The ranks of this session.
    pub fn comm(&self) -> &Comm {
        &self.comm
    }

    /// One step: reads every input field at time t, writes every output field's cells at t + stride. Collective;
    /// all ranks fail together, and nothing is written then.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that are missing or have other components or lengths; [`Error::Numerical`] for
    /// values that are not finite, going in or coming out.
    pub fn step(&mut self, fields: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let shapes = out.iter().map(|o| OutputShape {
            name: o.name,
            components: o.components,
            len: o.cells.len(),
        });
        let checked = self.check_outputs(shapes);
        self.advance(fields, checked)?;
        for o in out {
            self.write(o);
        }
        Ok(())
    }

    /// The part of [`Session::step`] that reads: computes the result and keeps it. `checked` is the caller's own
    /// finding so far, that the ranks agree on with theirs. Collective.
    ///
    /// # Errors
    /// As [`Session::step`].
    pub fn advance(&mut self, fields: &[Field], checked: Result<()>) -> Result<()> {
        let gathered = checked.and_then(|()| self.gather(fields));
        self.comm.agree(gathered)?;
        let computed = self.network.forward(&self.comm, &self.inputs, &mut self.outputs);
        let computed = computed.and_then(|()| self.scatter(fields));
        self.comm.agree(computed)
    }

    /// Whether the arrays are those of all predicted fields.
    ///
    /// # Errors
    /// [`Error::Input`] naming the field that is missing, unknown, or of another shape.
    pub fn check_outputs<'a>(&self, out: impl Iterator<Item = OutputShape<'a>> + Clone) -> Result<()> {
        for o in out.clone() {
            let field = self
                .spec
                .fields
                .iter()
                .find(|f| f.name == o.name && f.output != Output::None);
            let Some(field) = field else {
                return Err(Error::Input(format!(
                    "the model does not predict '{}'; it predicts {}",
                    o.name,
                    self.names(true)
                )));
            };
            expect_shape(o.name, "output", field.vector, o.components, o.len, self.n_cells)?;
        }
        for field in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            if !out.clone().any(|o| o.name == field.name) {
                return Err(Error::Input(format!(
                    "no array for the predicted field '{}'",
                    field.name
                )));
            }
        }
        Ok(())
    }

    /// Writes the kept result of one field, whose shape was checked.
    pub fn write(&self, out: &mut FieldMut) {
        let Some(first) = self.output_column(out.name) else {
            return;
        };
        let m = self.spec.n_outputs();
        for (row, result) in out
            .cells
            .chunks_exact_mut(out.components)
            .zip(self.result.chunks_exact(m))
        {
            match out.components {
                1 => row[0] = result[first],
                _ => self
                    .directions
                    .iter()
                    .enumerate()
                    .for_each(|(i, &d)| row[d] = result[first + i]),
            }
        }
    }

    /// Node features from fields.
    fn gather(&mut self, fields: &[Field]) -> Result<()> {
        let width = self.spec.n_field_inputs();
        let mut column = 0;
        for spec in self.spec.fields.iter().filter(|f| f.input) {
            let field = fields.iter().find(|f| f.name == spec.name).ok_or_else(|| {
                Error::Input(format!(
                    "input field '{}' is missing; the model reads {}",
                    spec.name,
                    self.names(false)
                ))
            })?;
            let (name, c) = (field.name, field.components);
            expect_shape(name, "cell", spec.vector, c, field.cells.len(), self.n_cells)?;
            expect_shape(
                name,
                "boundary",
                spec.vector,
                c,
                field.boundary.len(),
                self.n_boundary,
            )?;
            let scalar = [0];
            let directions = if spec.vector {
                &self.directions[..]
            } else {
                &scalar
            };
            let rows = field.cells.chunks_exact(c).chain(field.boundary.chunks_exact(c));
            for (node, (to, from)) in self.inputs.chunks_exact_mut(width).zip(rows).enumerate() {
                for (i, &d) in directions.iter().enumerate() {
                    if !from[d].is_finite() {
                        let place = place(node, self.n_cells);
                        return Err(Error::Numerical(format!(
                            "input field '{name}' is {} at {place}",
                            from[d]
                        )));
                    }
                    to[column + i] = from[d] as f32;
                }
            }
            if spec.vector {
                let columns = column..column + directions.len();
                for &(face, cell) in &self.read_from_cells {
                    let (from, to) = (cell * width, (self.n_cells + face) * width);
                    self.inputs
                        .copy_within(from + columns.start..from + columns.end, to + columns.start);
                }
            }
            column += directions.len();
        }
        Ok(())
    }

    /// Fields at the new time from the network's outputs and the fields of now.
    fn scatter(&mut self, fields: &[Field]) -> Result<()> {
        let m = self.spec.n_outputs();
        let mut column = 0;
        for spec in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            let scalar = [0];
            let directions = if spec.vector {
                &self.directions[..]
            } else {
                &scalar
            };
            let old = match spec.output {
                Output::Delta => fields.iter().find(|f| f.name == spec.name),
                _ => None,
            };
            for (i, &d) in directions.iter().enumerate() {
                let rows = self.result.chunks_exact_mut(m).zip(self.outputs.chunks_exact(m));
                for (cell, (result, output)) in rows.enumerate() {
                    let before = old.map_or(0.0, |f| f.cells[cell * f.components + d]);
                    let after = before + f64::from(output[column + i]);
                    if !after.is_finite() {
                        return Err(Error::Numerical(format!(
                            "the model's '{}' is {after} at {}: the state has left what it was trained on; hand \
                             back to the solver sooner",
                            spec.name,
                            place(cell, self.n_cells)
                        )));
                    }
                    result[column + i] = after;
                }
            }
            column += directions.len();
        }
        Ok(())
    }

    fn output_column(&self, name: &str) -> Option<usize> {
        let mut column = 0;
        for f in self.spec.fields.iter().filter(|f| f.output != Output::None) {
            if f.name == name {
                return Some(column);
            }
            column += f.components(self.spec.dim);
        }
        None
    }

    fn names(&self, outputs: bool) -> String {
        let wanted = self.spec.fields.iter().filter(|f| {
            if outputs {
                f.output != Output::None
            } else {
                f.input
            }
        });
        wanted.map(|f| f.name.as_str()).collect::<Vec<_>>().join(", ")
    }
}

fn network(
    model: &Model,
    graph: &Graph,
    view: Option<&SegmentView>,
    options: &SessionOptions,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    match &options.backend {
        Backend::Native => Ok(Box::new(Engine::new(model, graph, view, &options.engine())?)),
        Backend::Torch(device) => {
            if options.precision != Precision::Fp32 {
                return Err(Error::Input(format!(
                    "precision {}: backend torch computes in fp32; use backend native",
                    options.precision.name()
                )));
            }
            let path = options.model_path.as_deref();
            let path = path.ok_or_else(|| Error::Input("backend torch needs the model's file".into()))?;
            let lengths = (
                graph.n_owned * model.spec.n_field_inputs(),
                graph.n_cells * model.spec.n_outputs(),
            );
            Ok(Box::new(TorchBackend::new(
                path,
                graph,
                view,
                lengths,
                device.as_deref(),
                comm,
            )?))
        }
    }
}

/// The labels handed in. A rank without cells has labels, none, exactly if another rank has some. Collective.
fn preset<'a>(labels: Option<&'a [i32]>, n_cells: usize, comm: &Comm) -> Option<&'a [i32]> {
    let mut any = [i64::from(labels.is_some())];
    comm.max_i64(&mut any);
    if n_cells > 0 {
        labels
    } else {
        (any[0] != 0).then_some(&[])
    }
}

fn place(node: usize, n_cells: usize) -> String {
    match node.checked_sub(n_cells) {
        None => format!("cell {node}"),
        Some(face) => format!("boundary face {face}"),
    }
}

#[cfg(test)]
mod tests;
