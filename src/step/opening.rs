//! How a session begins: model, graph, segments, network.

use super::{Backend, Session, SessionOptions, Stepper};
use m4gn_base::{Error, Result};
use m4gn_domain::{Domain, HostOptions};
use m4gn_engine::torch::TorchBackend;
use m4gn_engine::{Engine, Forward, PrecisionChoice};
use m4gn_mesh::Mesh;
use m4gn_model::Model;
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
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
    /// Builds graph, modes and segments for a model. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Model`] when the model does not fit the case (dimension, node types); [`Error::Mesh`] for a mesh
    /// that no graph can be made of; [`Error::Input`] for options out of range, K larger than the number of cells
    /// among them; [`Error::Numerical`] when the modes cannot be computed.
    pub fn new(comm: Comm, mesh: &Mesh, model: &Model, options: &SessionOptions) -> Result<Self> {
        let spec = &model.spec;
        let segment_spec = comm.agree(options.segment_spec(&spec.segments))?;
        let hosted = HostOptions {
            segments: &segment_spec,
            resolution: options.resolution.of(spec.resolution),
            labels: options.cell_segment.as_deref(),
            modes: &Modal(segment_spec.modal()),
        };
        let hosted = m4gn_domain::open(mesh, spec, &hosted, &comm)?;
        let (host, structure) = (hosted.host, hosted.structure);
        let network = network(model, host.domain(), &structure, options, &comm)?;
        let n_cells = mesh.cell_global.len();
        Ok(Session {
            directions: mesh.directions.clone(),
            n_cells,
            n_boundary: mesh.boundary.len(),
            n_segments: hosted.n_segments,
            cell_segment: hosted.node_segment,
            segment_record: hosted.segment_record,
            cell_size: hosted.cell_size,
            stepper: Stepper::new(host.domain(), &structure, spec, network),
            host,
            solid: options.solid.clone(),
            result: vec![0.0; n_cells * spec.n_outputs()],
            stepped: false,
            spec: spec.clone(),
            comm,
        })
    }
}

/// The network of a session. Collective; all ranks fail together.
fn network(
    model: &Model,
    domain: &dyn Domain,
    structure: &Structure,
    options: &SessionOptions,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    let precision = options.precision.agreed(model.spec.precision_of_runs(), comm);
    let made = || -> Result<Box<dyn Forward>> {
        match &options.backend {
            Backend::Native => {
                let options = options.engine(precision, domain);
                Ok(Box::new(Engine::new(model, structure, &options)?))
            }
            Backend::Torch(_) if domain.moves() => Err(Error::Input(
                "backend torch: a body's edges change with every step; use backend native".into(),
            )),
            Backend::Torch(device) => on_torch(model, structure, options, device.as_deref(), comm),
        }
    };
    comm.agree(made())
}

fn on_torch(
    model: &Model,
    structure: &Structure,
    options: &SessionOptions,
    device: Option<&str>,
    comm: &Comm,
) -> Result<Box<dyn Forward>> {
    if options.precision == PrecisionChoice::Bf16 {
        return Err(Error::Input(
            "precision bf16: backend torch computes in fp32; use backend native".into(),
        ));
    }
    let (graph, spec) = (&structure.graph, &model.spec);
    let lengths = (graph.n_owned * spec.n_field_inputs(), graph.n_cells * spec.n_outputs());
    let backend = TorchBackend::new(model, structure, lengths, device, comm)?;
    Ok(Box::new(backend))
}
