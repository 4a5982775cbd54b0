//! How a session begins: model, graph, segments, network; and how it takes other weights.

use super::groups::OnGroups;
use super::moving::Moving;
use super::{Backend, Network, Session, SessionOptions, case, faces_seen_as_their_cells};
use m4gn_engine::torch::TorchBackend;
use m4gn_engine::{Engine, Forward, Precision, PrecisionChoice};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_model::{Model, ModelSpec, SegmentSpec, cell_size};
use m4gn_modes::Modal;
use m4gn_structure::{Record, Structure};
use std::path::Path;

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
        let segment_spec = comm.agree(options.segment_spec(&spec.segments))?;
        if let Some(contact) = spec.contact {
            let (moving, (n_segments, cell_segment), cell_size) =
                Moving::new(&comm, mesh, model, contact.radius, &segment_spec, options)?;
            let n_cells = mesh.cell_global.len();
            return Ok(Session {
                comm,
                directions: mesh.directions.clone(),
                n_cells,
                n_boundary: 0,
                n_segments,
                cell_segment,
                segment_record: String::new(),
                cell_size,
                read_from_cells: Vec::new(),
                network: Network::Moving(Box::new(moving)),
                groups: None,
                options: options.clone(),
                segment_spec,
                inputs: Vec::new(),
                outputs: Vec::new(),
                result: vec![0.0; n_cells * spec.n_outputs()],
                stepped: false,
                spec: spec.clone(),
            });
        }
        let groups = OnGroups::new(mesh, options.resolution.of(spec.resolution), spec, &comm)?;
        let nodes = network_nodes(mesh, groups.as_ref());
        let preset = match spec.architecture.needs().segments {
            true => preset(options.cell_segment.as_deref(), mesh.n_cells(), &comm),
            false => None,
        };
        if groups.is_some() && spec.architecture.needs().segments && preset.is_none() {
            enough(mesh, nodes, &segment_spec, &comm)?;
        }
        let structure = structure(mesh, groups.as_ref(), spec, &segment_spec, preset, &comm)?;
        let cell_segment = structure.segments.as_ref().map_or(Vec::new(), |found| {
            let labels = &found.node_segment[..nodes.n_cells()];
            match &groups {
                Some(groups) => groups.coarse.labels_of_cells(labels, &comm),
                None => labels.to_vec(),
            }
        });
        let mut handed_in = [i64::from(options.cell_segment.is_some())];
        comm.max_i64(&mut handed_in);
        let segment_record = match &structure.segments {
            Some(_) if handed_in[0] == 0 => Record::new(mesh, &segment_spec, &cell_segment, &comm)?.text()?,
            _ => String::new(),
        };
        let cell_size = cell_size(nodes, &comm);
        let network = fixed(model, &structure, options, &comm)?;
        let n_cells = mesh.n_cells();
        Ok(Session {
            comm,
            directions: mesh.directions.clone(),
            n_cells,
            n_boundary: mesh.boundary.len(),
            n_segments: structure.n_segments(),
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
            stepped: false,
            spec: spec.clone(),
        })
    }

    /// Takes other weights: those of a model of the same description, which has learned on. `mesh` is the session's.
    /// Collective; all ranks fail together, and the weights are then those from before.
    ///
    /// # Errors
    /// [`Error::Input`] for a session on libtorch, whose weights stay; [`Error::Model`] for a model of another description.
    pub fn set_weights(&mut self, mesh: &Mesh, model: &Model) -> Result<()> {
        let comm = self.comm.clone();
        comm.agree(self.check_weights(mesh, model))?;
        let labels = &self.cell_segment[..];
        if let Network::Moving(moving) = &mut self.network {
            return moving.set_weights(&comm, mesh, model, (&self.segment_spec, labels), &self.options);
        }
        let (groups, labels) = (self.groups.as_ref(), Some(labels));
        let structure = structure(mesh, groups, &self.spec, &self.segment_spec, labels, &comm)?;
        let network = fixed(model, &structure, &self.options, &comm)?;
        self.network = Network::Fixed(network);
        Ok(())
    }

    fn check_weights(&self, mesh: &Mesh, model: &Model) -> Result<()> {
        let (own, new) = (&self.spec, &model.spec);
        if self.options.backend != Backend::Native {
            return Err(Error::Input(
                "weights that change need backend native: libtorch reads them from the model's file".into(),
            ));
        }
        let same = (&own.fields, &own.architecture, &own.node_types)
            == (&new.fields, &new.architecture, &new.node_types);
        if !same || mesh.cell_global.len() != self.n_cells || mesh.boundary.len() != self.n_boundary {
            return Err(Error::Model(
                "weights of another network or for another mesh than the session's: expected the same description".into(),
            ));
        }
        Ok(())
    }
}

/// Whether there are as many groups as segments: there are fewer in a case that is far smaller than those of the training.
fn enough(mesh: &Mesh, groups: &Mesh, segments: &SegmentSpec, comm: &Comm) -> Result<()> {
    let mut total = [mesh.n_cells() as i64, groups.n_cells() as i64];
    comm.sum_i64(&mut total);
    let [cells, nodes] = total;
    if segments.count as i64 <= nodes {
        return Ok(());
    }
    Err(Error::Input(format!(
        "the {cells} cells of this case are {nodes} nodes at the network's resolution, and it has {} segments: the case is \
         far smaller than those that the model was trained on; if it shall be tried all the same, set resolution (off, or \
         a shorter length in m) or segments {{ count }} in the dictionary",
        segments.count
    )))
}

/// What the network sees: groups, or the cells themselves.
fn network_nodes<'a>(mesh: &'a Mesh, groups: Option<&'a OnGroups>) -> &'a Mesh {
    groups.map_or(mesh, |groups| &groups.coarse.mesh)
}

/// What the network that `spec` describes lives on, cut by the labels of the cells if there are any. Collective; all ranks fail
/// together.
fn structure(
    mesh: &Mesh,
    groups: Option<&OnGroups>,
    spec: &ModelSpec,
    segment_spec: &SegmentSpec,
    labels: Option<&[i32]>,
    comm: &Comm,
) -> Result<Structure> {
    let nodes = network_nodes(mesh, groups);
    let of_groups = match (groups, labels) {
        (Some(groups), Some(labels)) if spec.architecture.needs().segments => {
            Some(groups.labels(mesh, labels, comm)?)
        }
        _ => None,
    };
    let labels = of_groups.as_deref().or(labels);
    let modes = Modal(segment_spec.modal());
    Structure::new(nodes, spec, segment_spec, &modes, labels, comm)
}

/// The network on edges that stay. Collective.
fn fixed(
    model: &Model,
    structure: &Structure,
    options: &SessionOptions,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    let precision = options.precision.agreed(model.spec.precision_of_runs(), comm);
    comm.agree(network(model, structure, options, precision, comm))
}

fn network(
    model: &Model,
    structure: &Structure,
    options: &SessionOptions,
    precision: Precision,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    match &options.backend {
        Backend::Native => {
            let options = options.engine(precision);
            Ok(Box::new(Engine::new(model, structure, &options)?))
        }
        Backend::Torch(device) => {
            if options.precision == PrecisionChoice::Bf16 {
                return Err(Error::Input(
                    "precision bf16: backend torch computes in fp32; use backend native".into(),
                ));
            }
            let path = options.model.as_deref();
            let path = path.ok_or_else(|| Error::Input("backend torch needs the model's file".into()))?;
            let graph = &structure.graph;
            let lengths = (
                graph.n_owned * model.spec.n_field_inputs(),
                graph.n_cells * model.spec.n_outputs(),
            );
            Ok(Box::new(TorchBackend::new(
                path,
                structure,
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
