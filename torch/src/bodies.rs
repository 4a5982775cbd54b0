//! Trajectories of bodies at points as samples: points are the cells, the obstacle's points the boundary.

use crate::config::Config;
use crate::samples::{HostGraph, Parts, Sample};
use m4gn::dataset::{Body, Obstacle, PointType, SolidTrajectory};
use m4gn::graph::contact::ContactGraph;
use m4gn::mesh::NodeType;
use m4gn::model::{FieldSpec, ModelSpec};
use m4gn::modes::ModalOptions;
use m4gn::parallel::Comm;
use m4gn::solids::part::BodyPart;
use m4gn::solids::segments;
use m4gn::{Error, Result};
use std::path::Path;
use std::sync::Arc;
use tch::{Device, Kind, Tensor};

/// What the data say about a model of bodies.
pub fn describe(config: &Config) -> ModelSpec {
    let fields = config.model.fields.iter().map(|f| FieldSpec {
        name: f.name.clone(),
        vector: true,
        dimensions: [0, 1, 0, 0, 0, 0, 0],
        input: f.input,
        output: f.output,
    });
    ModelSpec {
        format: 1,
        dim: 3,
        stride: config.model.stride,
        fields: fields.collect(),
        node_types: Vec::new(),
        architecture: config.architecture(),
        contact: config.contact,
        segments: config.segments.clone(),
        training: serde_json::Value::Null,
    }
}

/// Types of the nodes of a trajectory.
pub fn node_types(trajectory: &SolidTrajectory) -> Vec<NodeType> {
    let mut types = vec![NodeType::Body];
    if trajectory.body().types.contains(&PointType::Handle) {
        types.push(NodeType::Handle);
    }
    if trajectory.obstacle().is_some() {
        types.push(NodeType::Obstacle);
    }
    types
}

/// Reads a trajectory and makes its graph and segments with the core crate's own functions.
pub fn read(trajectory: &SolidTrajectory, path: &Path, spec: &ModelSpec, device: Device) -> Result<Sample> {
    let here = |e: Error| Error::file(path, e.to_string());
    let mut sample = sample(trajectory.body(), trajectory.obstacle(), spec, device).map_err(here)?;
    let n_frames = trajectory.times().len();
    let nodes = sample.hosts[0].cells + sample.hosts[0].boundary;
    let mut values = Vec::with_capacity(n_frames * nodes * 3);
    for frame in trajectory.read_frames(0, 1, n_frames)? {
        values.extend(frame.displacement.iter().chain(&frame.obstacle).flatten());
    }
    if let Some(at) = values.iter().position(|v: &f32| !v.is_finite()) {
        return Err(Error::file(
            path,
            format!(
                "frame {} holds a value that is not finite: generate this trajectory again",
                at / (3 * nodes)
            ),
        ));
    }
    sample.frames = Tensor::from_slice(&values).view([n_frames as i64, nodes as i64, 3]);
    sample.n_frames = n_frames;
    Ok(sample)
}

/// The graph and segments of a body, without frames.
pub fn sample(body: &Body, obstacle: Option<&Obstacle>, spec: &ModelSpec, device: Device) -> Result<Sample> {
    let comm = Comm::serial();
    let radius = spec.contact.map_or(0.0, |c| c.radius);
    let part = BodyPart::whole(body, obstacle)?;
    let contact = ContactGraph::new(&part, radius, &comm)?;
    let settings = &spec.segments;
    let modes = match settings.method.uses_modes() && settings.count > 1 {
        true => Some(segments::modes(body, settings, &ModalOptions::default())?),
        false => None,
    };
    let (segmentation, features) = segments::segment(&part, &contact, spec, settings, modes.as_ref(), &comm)?;
    let edges = contact.mesh_edges();
    let senders: Vec<i32> = edges.iter().map(|e| e.sender).collect();
    let receivers: Vec<i32> = edges.iter().map(|e| e.receiver).collect();
    let rest: Vec<f32> = edges.iter().flat_map(|e| e.rest.map(|v| v as f32)).collect();
    let graph = contact.graph();
    let parts = Parts {
        n_cells: graph.n_cells,
        node_types: &graph.node_types,
        senders: &senders,
        receivers: &receivers,
        edge_features: &rest,
        segments: segmentation.count,
        member_row: &segmentation.member_row,
        member: &segmentation.member,
        sizes: &segmentation.sizes,
        position: &features.position,
        offsets: &features.offsets,
    };
    let host = HostGraph::new(&parts, spec)?;
    let reflected = host.reflected(spec);
    let (n, all) = (graph.n_cells, graph.n_owned);
    let held: Vec<f32> = body
        .types
        .iter()
        .map(|t| if *t == PointType::Handle { 1.0 } else { 0.0 })
        .collect();
    let boundary = all - n;
    let mirrored = contact.reflected();
    Ok(Sample {
        topologies: [&host, &reflected].map(|h| HostGraph::union(&[h], spec, device)),
        hosts: [host, reflected].map(Arc::new),
        owners: Tensor::from_slice(&vec![0i64; boundary]).to_device(device),
        copies: Tensor::from_slice(&vec![0f32; 3 * boundary])
            .view([-1, 3])
            .to_device(device),
        held: Some(Tensor::from_slice(&held).view([-1, 1]).to_device(device)),
        frames: Tensor::zeros([0, all as i64, 3], (Kind::Float, Device::Cpu)),
        n_frames: 0,
        contact: Some([contact, mirrored].map(Arc::new)),
    })
}
