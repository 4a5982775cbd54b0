//! A session: one model on one mesh, stepping fields by name.
//!
//! This is what the C ABI and `m4gn validate` drive. Building one makes graph, modes and segments once; a step
//! turns fields into node features, runs the network, and turns its outputs into fields again.

mod boundary;
mod case;
pub mod control;
mod field;
mod groups;
mod moving;
mod options;

pub use boundary::{copied_faces, faces_seen_as_their_cells, impose_boundary};
pub use field::{Field, FieldMut, OutputShape};
pub use options::{Backend, SessionOptions};

use field::expect_shape;
use groups::OnGroups;
use m4gn_contact::projection::ProjectionReport;
use m4gn_engine::torch::TorchBackend;
use m4gn_engine::{Engine, Forward, Precision, SegmentView};
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::{Extent, InputRange, Model, ModelSpec, Output, SegmentSpec, cell_size};
use m4gn_modes::Modal;
use m4gn_segments as segments;
use m4gn_segments::Segmentation;
use m4gn_segments::graph::Graph;
use moving::Moving;
use std::path::Path;

/// The network, on edges that stay or on edges that move with a body.
enum Network {
    Fixed(Box<dyn Forward>),
    Moving(Box<Moving>),
}

/// Reads a model on the root and hands it to all ranks. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::File`] for a model that cannot be used.
pub fn read_model(comm: &Comm, path: &Path) -> Result<Model> {
    let bytes = match comm.is_root() {
        true => Model::read_bytes(path),
        false => Ok(Vec::new()),
    };
    let mut bytes = comm.agree(bytes)?;
    comm.broadcast(&mut bytes);
    comm.agree(Model::from_bytes(&bytes, path))
}

/// One model on one mesh: fields at the cells of a mesh that does not move, or the displacement of a body at points.
pub struct Session {
    comm: Comm,
    spec: ModelSpec,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    n_segments: usize,
    cell_segment: Vec<i32>,
    /// How they were computed, to be stored with them; empty if they were handed in.
    segment_record: String,
    /// Mean distance of neighbouring cells, m.
    cell_size: f64,
    /// Boundary faces whose vectors are read from their cells, and these cells.
    read_from_cells: Vec<(usize, usize)>,
    network: Network,
    /// The way to the groups that the network lives on, where these are not the cells.
    groups: Option<OnGroups>,
    options: SessionOptions,
    segment_spec: SegmentSpec,
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
    pub fn open(comm: Comm, mesh: &Mesh, options: &SessionOptions) -> Result<Self> {
        let path = options
            .model
            .as_deref()
            .ok_or_else(|| Error::Input("model: expected the path of the model's file, found none".into()));
        let path = comm.agree(path)?;
        let model = read_model(&comm, path)?;
        Self::new(comm, mesh, &model, options)
    }

    /// Builds graph, modes and segments for a model. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Model`] when the model does not fit the case (dimension, node types); [`Error::Mesh`] for a mesh
    /// that no graph can be made of; [`Error::Input`] for options out of range, K larger than the number of cells
    /// among them; [`Error::Numerical`] when the modes cannot be computed.
    pub fn new(comm: Comm, mesh: &Mesh, model: &Model, options: &SessionOptions) -> Result<Self> {
        let spec = &model.spec;
        comm.agree(case::check(spec, mesh, options))?;
        if let Some(contact) = spec.contact {
            let (moving, (n_segments, cell_segment)) =
                Moving::new(&comm, mesh, model, contact.radius, options)?;
            let n_cells = mesh.cell_global.len();
            return Ok(Session {
                comm,
                directions: mesh.directions.clone(),
                n_cells,
                n_boundary: 0,
                n_segments,
                cell_segment,
                segment_record: String::new(),
                cell_size: 0.0,
                read_from_cells: Vec::new(),
                network: Network::Moving(Box::new(moving)),
                groups: None,
                options: options.clone(),
                segment_spec: spec.segments.clone(),
                inputs: Vec::new(),
                outputs: Vec::new(),
                result: vec![0.0; n_cells * spec.n_outputs()],
                spec: spec.clone(),
            });
        }
        let segment_spec = comm.agree(options.segment_spec(&spec.segments))?;
        let groups = OnGroups::new(mesh, options.resolution.of(spec), spec, &comm)?;
        let nodes = network_nodes(mesh, groups.as_ref());
        let (graph, segmentation) = match spec.architecture.segment_transformer() {
            Some(_) => {
                let preset = preset(options.cell_segment.as_deref(), mesh.n_cells(), &comm);
                cut(mesh, groups.as_ref(), Some(&segment_spec), preset, &comm)?
            }
            None => cut(mesh, groups.as_ref(), None, None, &comm)?,
        };
        let cell_segment = segmentation.as_ref().map_or(Vec::new(), |found| {
            let labels = &found.node_segment[..nodes.n_cells()];
            match &groups {
                Some(groups) => groups.coarse.labels_of_cells(labels, &comm),
                None => labels.to_vec(),
            }
        });
        let mut handed_in = [i64::from(options.cell_segment.is_some())];
        comm.max_i64(&mut handed_in);
        let segment_record = match &segmentation {
            Some(_) if handed_in[0] == 0 => {
                segments::Record::new(mesh, &segment_spec, &cell_segment, &comm)?.text()?
            }
            _ => String::new(),
        };
        let cell_size = cell_size(nodes, &comm);
        let network = fixed(model, nodes, &graph, segmentation.as_ref(), options, &comm)?;
        let n_cells = mesh.n_cells();
        Ok(Session {
            comm,
            directions: mesh.directions.clone(),
            n_cells,
            n_boundary: mesh.boundary.len(),
            n_segments: segmentation.as_ref().map_or(0, |s| s.count),
            segment_record,
            cell_size,
            cell_segment,
            read_from_cells: faces_seen_as_their_cells(mesh),
            network: Network::Fixed(network),
            groups,
            options: SessionOptions {
                cell_segment: None,
                ..options.clone()
            },
            segment_spec,
            inputs: vec![0.0; mesh.n_nodes() * spec.n_field_inputs()],
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

    /// How the segments were computed, to be stored with them ([`segments::Record`]); empty if they were handed in.
    pub fn segment_record(&self) -> &str {
        &self.segment_record
    }

    /// The model's segmentation with what the case sets differently.
    pub fn segment_spec(&self) -> &SegmentSpec {
        &self.segment_spec
    }

    /// Mean distance of neighbouring nodes that the network's graph was to have, m; none: a node a cell.
    pub fn resolution(&self) -> Option<f64> {
        self.options.resolution.of(&self.spec)
    }

    /// Path of the model's file; none for a model that was handed in.
    pub fn model_path(&self) -> Option<&Path> {
        self.options.model.as_deref()
    }

    /// Threads of this rank.
    pub fn threads(&self) -> usize {
        self.options.n_threads.max(1)
    }

    /// Takes other weights: those of a model of the same description, which has learned on. `mesh` is the session's.
    /// Collective; all ranks fail together, and the weights are then those from before.
    ///
    /// # Errors
    /// [`Error::Input`] for a session on libtorch or of a body at points, whose weights stay; [`Error::Model`] for a model
    /// of another description.
    pub fn set_weights(&mut self, mesh: &Mesh, model: &Model) -> Result<()> {
        let comm = self.comm.clone();
        comm.agree(self.check_weights(mesh, model))?;
        let groups = self.groups.as_ref();
        let nodes = network_nodes(mesh, groups);
        let spec = (self.n_segments > 0).then_some(&self.segment_spec);
        let (graph, segmentation) = cut(mesh, groups, spec, Some(&self.cell_segment), &comm)?;
        let options = &self.options;
        self.network = Network::Fixed(fixed(
            model,
            nodes,
            &graph,
            segmentation.as_ref(),
            options,
            &comm,
        )?);
        Ok(())
    }

    fn check_weights(&self, mesh: &Mesh, model: &Model) -> Result<()> {
        let (own, new) = (&self.spec, &model.spec);
        if matches!(self.network, Network::Moving(_)) {
            return Err(Error::Input(
                "the weights of a model of bodies at points stay as they are".into(),
            ));
        }
        if self.options.backend != Backend::Native {
            return Err(Error::Input(
                "weights that change need backend native: libtorch reads them from the model's file".into(),
            ));
        }
        let same = (&own.fields, &own.architecture, &own.node_types)
            == (&new.fields, &new.architecture, &new.node_types);
        if !same || mesh.n_cells() != self.n_cells || mesh.boundary.len() != self.n_boundary {
            return Err(Error::Model(
                "weights of another network or for another mesh than the session's: expected the same description".into(),
            ));
        }
        Ok(())
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
        if let Network::Moving(_) = &self.network {
            return self.advance_body(fields, checked);
        }
        let gathered = checked.and_then(|()| self.gather(fields));
        self.comm.agree(gathered)?;
        let Network::Fixed(network) = &mut self.network else {
            return Err(Error::Internal("a body on edges that stay".into()));
        };
        let computed = match &mut self.groups {
            Some(groups) => groups.forward(&self.comm, &mut **network, &self.inputs, &mut self.outputs),
            None => network.forward(&self.comm, &self.inputs, &mut self.outputs),
        };
        let computed = computed.and_then(|()| self.scatter(fields));
        self.comm.agree(computed)
    }

    /// As [`Session::advance`], of the one field that a model of bodies has.
    fn advance_body(&mut self, fields: &[Field], checked: Result<()>) -> Result<()> {
        let name = &self.spec.fields[0].name;
        let read = || -> Result<&[f64]> {
            checked?;
            let field = fields.iter().find(|f| f.name == name).ok_or_else(|| {
                Error::Input(format!("input field '{name}' is missing; the model moves it"))
            })?;
            expect_shape(
                name,
                "cell",
                true,
                field.components,
                field.cells.len(),
                self.n_cells,
            )?;
            Ok(field.cells)
        };
        let cells = self.comm.agree(read())?;
        self.result.copy_from_slice(cells);
        match &mut self.network {
            Network::Moving(moving) => moving.step(&self.comm, self.result.as_chunks_mut().0),
            Network::Fixed(_) => Err(Error::Internal("a body on edges that stay".into())),
        }
    }

    /// One step of a body: [`Session::set_obstacle`], then [`Session::step`] of the displacement of this rank's points,
    /// m, in place. Collective; all ranks fail together, and `displacement` is then as it was.
    ///
    /// # Errors
    /// As both.
    pub fn step_body(&mut self, displacement: &mut [[f64; 3]], obstacle: [&[[f64; 3]]; 2]) -> Result<()> {
        self.set_obstacle(obstacle[0], obstacle[1])?;
        let name = self.spec.fields[0].name.clone();
        let before = displacement.to_vec();
        let field = Field {
            name: &name,
            components: 3,
            cells: before.as_flattened(),
            boundary: &[],
        };
        let after = FieldMut {
            name: &name,
            components: 3,
            cells: displacement.as_flattened_mut(),
        };
        self.step(&[field], &mut [after])
    }

    /// Takes the displacement of the obstacle's points `[Q]` at the start and at the end of the next step, m; that of
    /// the first rank counts. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths, or a session without body; [`Error::Numerical`] for values that are not
    /// finite.
    pub fn set_obstacle(&mut self, now: &[[f64; 3]], after: &[[f64; 3]]) -> Result<()> {
        match &mut self.network {
            Network::Moving(moving) => moving.set_obstacle(&self.comm, [now, after]),
            Network::Fixed(_) => Err(Error::Input(
                "the model is of fields at cells: it knows no obstacle that moves".into(),
            )),
        }
    }

    /// What the contact projection did in the last step; none where [`SessionOptions::projection`] asks for none.
    pub fn projection(&self) -> Option<&ProjectionReport> {
        match &self.network {
            Network::Moving(moving) => moving.projection(),
            Network::Fixed(_) => None,
        }
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

    /// In which respects the mesh and the fields of the last step lie outside of what the model was trained on, one
    /// an entry, for people; empty too for a model that does not say. Collective.
    pub fn outside(&self) -> Vec<String> {
        let Some(trained_on) = &self.spec.trained_on else {
            return Vec::new();
        };
        let width = self.spec.n_field_inputs();
        let (mut inputs, mut speed, mut column) = (Vec::new(), None, 0);
        for field in self.spec.fields.iter().filter(|f| f.input) {
            let n = field.components(self.spec.dim);
            // Largest of -x, x and |x|^2
            let mut largest = [f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0];
            for row in self.inputs.chunks_exact(width) {
                let values = row[column..column + n].iter().map(|&x| f64::from(x));
                largest[2] = values.clone().map(|x| x * x).sum::<f64>().max(largest[2]);
                for x in values {
                    largest[0] = largest[0].max(-x);
                    largest[1] = largest[1].max(x);
                }
            }
            self.comm.max_f64(&mut largest);
            if field.is_velocity() && speed.is_none() {
                speed = Some(largest[2].sqrt());
            }
            inputs.push(InputRange {
                field: field.name.clone(),
                range: [-largest[0], largest[1]],
            });
            column += n;
        }
        let case = Extent {
            cell_size: self.cell_size,
            speed,
            inputs,
        };
        trained_on.outside(&case, self.spec.stride)
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

/// What the network sees: groups, or the cells themselves.
fn network_nodes<'a>(mesh: &'a Mesh, groups: Option<&'a OnGroups>) -> &'a Mesh {
    groups.map_or(mesh, |groups| &groups.coarse.mesh)
}

/// The graph of the network's nodes, and their segments where there is a specification of them, by the labels of the cells
/// if there are any. Collective; all ranks fail together.
fn cut(
    mesh: &Mesh,
    groups: Option<&OnGroups>,
    spec: Option<&SegmentSpec>,
    labels: Option<&[i32]>,
    comm: &Comm,
) -> Result<(Graph, Option<Segmentation>)> {
    let nodes = network_nodes(mesh, groups);
    let mut graph = Graph::new(nodes, comm)?;
    let Some(spec) = spec else {
        return Ok((graph, None));
    };
    let of_groups = match (groups, labels) {
        (Some(groups), Some(labels)) => Some(groups.labels(mesh, labels, comm)?),
        _ => None,
    };
    let labels = of_groups.as_deref().or(labels);
    let modes = Modal(spec.modal());
    let segmentation = segments::segment(nodes, &mut graph, spec, &modes, comm, labels)?;
    Ok((graph, Some(segmentation)))
}

/// The network on edges that stay. Collective.
fn fixed(
    model: &Model,
    mesh: &Mesh,
    graph: &Graph,
    segmentation: Option<&Segmentation>,
    options: &SessionOptions,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    let features = segmentation.map(|s| segments::features(&model.spec, mesh, s, comm));
    let features = features.unwrap_or_default();
    let view = segmentation.map(|s| SegmentView::new(s, &features));
    comm.agree(network(model, graph, view.as_ref(), options, comm))
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
            let path = options.model.as_deref();
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
