//! Trajectories in memory: fields as tensors, graphs and segments made by the core crate, batches of both.

use crate::config::Config;
use crate::network::Topology;
use crate::rollout::Boundary;
use m4gn::dataset::Trajectory;
use m4gn::graph::Graph;
use m4gn::graph::contact::ContactGraph;
use m4gn::mesh::NodeType;
use m4gn::model::{ModalOperator, ModelSpec, Output, SegmentSpec};
use m4gn::parallel::Comm;
use m4gn::segments;
use m4gn::step::{copied_faces, faces_seen_as_their_cells};
use m4gn::{Error, Result};
use std::path::Path;
use std::sync::Arc;
use tch::{Device, Kind, Tensor};

/// Index lists and features of one graph on the host, from which unions are made.
#[derive(Clone)]
pub struct HostGraph {
    /// Cells.
    pub cells: usize,
    /// Boundary nodes.
    pub boundary: usize,
    /// Segments, K.
    pub segments: usize,
    /// Senders, receivers: node numbers with cells first.
    senders: Vec<i64>,
    receivers: Vec<i64>,
    /// Rows of [`edge_width`]: features, or, of a body, positions of the senders from the receivers at rest.
    edges: Vec<f32>,
    /// Node features that do not change with time: one-hot type, offset from the segment's centroid.
    fixed: Vec<f32>,
    member_node: Vec<i64>,
    member_segment: Vec<i64>,
    segment_weight: Vec<f32>,
    node_weight: Vec<f32>,
    position: Vec<f32>,
}

/// A serial graph and its segments as slices; the last six are empty without a macro stage.
pub struct Parts<'a> {
    /// Cells, the first nodes.
    pub n_cells: usize,
    /// Type code of each node.
    pub node_types: &'a [i32],
    /// Sending node of each edge.
    pub senders: &'a [i32],
    /// Receiving node of each edge.
    pub receivers: &'a [i32],
    /// Physical edge features `[E x (dim + 1)]`.
    pub edge_features: &'a [f32],
    /// Segments, K.
    pub segments: usize,
    /// Segments of node i: `member[member_row[i]..member_row[i + 1]]`.
    pub member_row: &'a [u32],
    /// Segment numbers.
    pub member: &'a [i32],
    /// Members of each segment.
    pub sizes: &'a [f64],
    /// Positional encoding `[K x n_position_features]`; empty without one.
    pub position: &'a [f32],
    /// Offsets from the segments' centroids `[N x n_offset_features]`; empty without them.
    pub offsets: &'a [f32],
}

/// One recorded trajectory.
pub struct Sample {
    /// The graph and its reflection, for unions with others.
    pub hosts: [Arc<HostGraph>; 2],
    /// The graph and its reflection alone, on the device.
    pub topologies: [Topology; 2],
    /// Owner cell of each boundary node, `[B]`.
    pub owners: Tensor,
    /// 1 where a boundary value is its owner's (outflow, symmetry), 0 where it is prescribed, `[B x components]`.
    pub copies: Tensor,
    /// 1 for points that are held, 0 for those that move, `[C x 1]`; none for cells.
    pub held: Option<Tensor>,
    /// All fields of all frames: cells then boundary nodes, `[T x (C + B) x components]`.
    pub(crate) frames: Tensor,
    /// Number of frames.
    pub n_frames: usize,
    /// A body at points, and its reflection.
    pub contact: Option<[Arc<ContactGraph>; 2]>,
}

/// Numbers an edge in [`Topology::edges`]: features, or, of a body, its three components at rest.
pub fn edge_width(spec: &ModelSpec) -> usize {
    match spec.contact {
        Some(_) => spec.dim,
        None => spec.n_edge_features(),
    }
}

/// Components of the fields: which are inputs, which outputs, and how.
#[derive(Clone, Debug)]
pub struct Components {
    /// Components of all fields together.
    pub count: usize,
    /// Field of each component.
    pub field: Vec<usize>,
    /// Components that are inputs.
    pub inputs: Vec<usize>,
    /// Components that are predicted.
    pub outputs: Vec<usize>,
    /// Components that change sign under reflection in the second direction.
    pub odd: Vec<bool>,
}

impl Components {
    /// Counts the components of a model's fields.
    pub fn new(spec: &ModelSpec) -> Self {
        let mut c = Components {
            count: 0,
            field: vec![],
            inputs: vec![],
            outputs: vec![],
            odd: vec![],
        };
        for (f, field) in spec.fields.iter().enumerate() {
            for i in 0..field.components(spec.dim) {
                if field.input {
                    c.inputs.push(c.count);
                }
                if field.output != Output::None {
                    c.outputs.push(c.count);
                }
                c.field.push(f);
                c.odd.push(field.vector && i == 1);
                c.count += 1;
            }
        }
        c
    }
}

impl HostGraph {
    /// Turns a serial graph and its segments into index lists.
    ///
    /// Errors: [`Error::Model`] for a node type that the model does not know.
    pub fn new(parts: &Parts, spec: &ModelSpec) -> Result<Self> {
        let nodes = parts.node_types.len();
        let (width, n_offsets) = (spec.n_static_features(), spec.n_offset_features());
        let expected = (parts.segments * spec.n_position_features(), nodes * n_offsets);
        if (parts.position.len(), parts.offsets.len()) != expected {
            return Err(Error::Model(format!(
                "{} positional features and {} offsets of the segments: the model needs {} and {}",
                parts.position.len(),
                parts.offsets.len(),
                expected.0,
                expected.1
            )));
        }
        let mut fixed = vec![0.0; nodes * width];
        for (node, &code) in parts.node_types.iter().enumerate() {
            let kind = NodeType::from_code(code)?;
            let at = spec.node_types.iter().position(|&t| t == kind).ok_or_else(|| {
                let known: Vec<&str> = spec.node_types.iter().map(|t| t.name()).collect();
                Error::Model(format!(
                    "a node of type {}: the model knows {}",
                    kind.name(),
                    known.join(", ")
                ))
            })?;
            fixed[node * width + at] = 1.0;
            fixed[node * width + width - n_offsets..][..n_offsets]
                .copy_from_slice(&parts.offsets[node * n_offsets..][..n_offsets]);
        }
        let mut member_node = Vec::new();
        let mut node_weight = Vec::with_capacity(nodes);
        for node in 0..nodes {
            let row = |i: usize| parts.member_row.get(i).map_or(0, |&r| r as usize);
            let members = row(node)..row(node + 1);
            member_node.extend(members.clone().map(|_| node as i64));
            node_weight.push(1.0 / members.len().max(1) as f32);
        }
        Ok(HostGraph {
            cells: parts.n_cells,
            boundary: nodes - parts.n_cells,
            segments: parts.segments,
            senders: parts.senders.iter().map(|&i| i as i64).collect(),
            receivers: parts.receivers.iter().map(|&i| i as i64).collect(),
            edges: parts.edge_features.to_vec(),
            fixed,
            member_node,
            member_segment: parts.member.iter().map(|&s| s as i64).collect(),
            segment_weight: parts
                .sizes
                .iter()
                .map(|&n| if n > 0.0 { (1.0 / n) as f32 } else { 0.0 })
                .collect(),
            node_weight,
            position: parts.position.to_vec(),
        })
    }

    /// The graph reflected in the second direction.
    pub fn reflected(&self, spec: &ModelSpec) -> Self {
        let mut graph = self.clone();
        let negate = |values: &mut [f32], width: usize, column: usize| {
            values
                .iter_mut()
                .skip(column)
                .step_by(width.max(1))
                .for_each(|v| *v = -*v);
        };
        negate(&mut graph.edges, edge_width(spec), 1);
        if spec.n_offset_features() > 0 {
            negate(
                &mut graph.fixed,
                spec.n_static_features(),
                spec.node_types.len() + 1,
            );
        }
        if let Some(stage) = spec
            .architecture
            .segment_transformer
            .as_ref()
            .filter(|m| m.centroids)
        {
            negate(
                &mut graph.position,
                spec.n_position_features(),
                stage.rwse_steps + 1,
            );
        }
        graph
    }

    /// The disjoint union of graphs: all their cells, then all their boundary nodes.
    pub fn union(graphs: &[&HostGraph], spec: &ModelSpec, device: Device) -> Topology {
        let cells: usize = graphs.iter().map(|g| g.cells).sum();
        let nodes = cells + graphs.iter().map(|g| g.boundary).sum::<usize>();
        let width = spec.n_static_features();
        let count = graphs.first().map_or(0, |g| g.segments);
        let (mut first_cell, mut first_boundary) = (0, cells);
        let (mut senders, mut receivers, mut edges) = (vec![], vec![], vec![]);
        let (mut member_node, mut member_segment) = (vec![], vec![]);
        let (mut segment_weight, mut position) = (vec![], vec![]);
        let (mut fixed, mut node_weight) = (vec![0f32; nodes * width], vec![0f32; nodes]);
        for (g, graph) in graphs.iter().enumerate() {
            let place = |node: i64| {
                let node = node as usize;
                (if node < graph.cells {
                    first_cell + node
                } else {
                    first_boundary + node - graph.cells
                }) as i64
            };
            senders.extend(graph.senders.iter().map(|&n| place(n)));
            receivers.extend(graph.receivers.iter().map(|&n| place(n)));
            edges.extend_from_slice(&graph.edges);
            member_node.extend(graph.member_node.iter().map(|&n| place(n)));
            member_segment.extend(graph.member_segment.iter().map(|&s| s + (g * count) as i64));
            segment_weight.extend_from_slice(&graph.segment_weight);
            position.extend_from_slice(&graph.position);
            for node in 0..graph.cells + graph.boundary {
                let to = place(node as i64) as usize;
                node_weight[to] = graph.node_weight[node];
                fixed[to * width..][..width].copy_from_slice(&graph.fixed[node * width..][..width]);
            }
            first_cell += graph.cells;
            first_boundary += graph.boundary;
        }
        let total = (graphs.len() * count) as i64;
        let own_rows =
            member_node.iter().enumerate().all(|(i, &n)| n == i as i64) && member_node.len() == nodes;
        let n_position = spec.n_position_features() as i64;
        let to = |t: Tensor| t.to_device(device);
        Topology {
            graphs: graphs.len() as i64,
            nodes: nodes as i64,
            cells: cells as i64,
            segments: count as i64,
            senders: to(Tensor::from_slice(&senders)),
            receivers: to(Tensor::from_slice(&receivers)),
            edges: to(Tensor::from_slice(&edges).view([-1, edge_width(spec) as i64])),
            is_world: spec
                .contact
                .map(|_| Tensor::zeros([edges.len() as i64 / 3, 1], (Kind::Float, device))),
            fixed: to(Tensor::from_slice(&fixed).view([nodes as i64, width as i64])),
            member_node: if own_rows {
                None
            } else {
                Some(to(Tensor::from_slice(&member_node)))
            },
            member_segment: to(Tensor::from_slice(&member_segment)),
            segment_weight: to(Tensor::from_slice(&segment_weight).view([-1, 1])),
            node_weight: to(Tensor::from_slice(&node_weight).view([-1, 1])),
            position: if n_position > 0 {
                Some(to(Tensor::from_slice(&position).view([total, n_position])))
            } else {
                None
            },
        }
    }
}

impl Sample {
    /// Reads a trajectory and makes its graph and segments with the core crate's own functions.
    pub fn read(trajectory: &Trajectory, path: &Path, spec: &ModelSpec, device: Device) -> Result<Self> {
        let comm = Comm::serial();
        let mesh = trajectory.mesh();
        let here = |e: Error| Error::file(path, e.to_string());
        let mut graph = Graph::new(mesh, &comm).map_err(here)?;
        let segmentation = segments::segment(mesh, &mut graph, &spec.segments, &comm, None).map_err(here)?;
        let features = segments::features(spec, mesh, &segmentation, &comm);
        let parts = Parts {
            n_cells: graph.n_cells,
            node_types: &graph.node_types[..graph.n_owned],
            senders: &graph.senders,
            receivers: &graph.receivers,
            edge_features: &graph.edge_features,
            segments: segmentation.count,
            member_row: &segmentation.member_row,
            member: &segmentation.member,
            sizes: &segmentation.sizes,
            position: &features.position,
            offsets: &features.offsets,
        };
        let host = HostGraph::new(&parts, spec).map_err(here)?;
        let reflected = host.reflected(spec);
        let components = Components::new(spec);
        let (nodes, width, n_frames) = (mesh.n_nodes(), components.count, trajectory.times().len());
        let mut values = vec![0f32; n_frames * nodes * width];
        let mut copies = vec![0f32; mesh.boundary.len() * width];
        let as_cells = faces_seen_as_their_cells(mesh);
        let mut first = 0;
        for field in &spec.fields {
            let n = field.components(spec.dim);
            let frames = trajectory.read_frames(&field.name, 0, 1, n_frames)?;
            for (t, frame) in frames.iter().enumerate() {
                let rows = frame.cells.chunks_exact(n).chain(frame.boundary.chunks_exact(n));
                for (node, row) in rows.enumerate() {
                    values[(t * nodes + node) * width + first..][..n].copy_from_slice(row);
                }
            }
            if field.vector {
                for (t, (face, cell)) in (0..n_frames).flat_map(|t| as_cells.iter().map(move |&f| (t, f))) {
                    let at = |node: usize| (t * nodes + node) * width + first;
                    values.copy_within(at(cell)..at(cell) + n, at(mesh.n_cells() + face));
                }
            }
            let pairs = frames.iter().map(|f| (&f.cells[..], &f.boundary[..]));
            for (face, copy) in copied_faces(mesh, field.vector, pairs).into_iter().enumerate() {
                copies[face * width + first..][..n].fill(if copy { 1.0 } else { 0.0 });
            }
            first += n;
        }
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            let frame = at / (nodes * width);
            return Err(Error::file(
                path,
                format!("frame {frame} holds a value that is not finite: generate this trajectory again"),
            ));
        }
        let owners: Vec<i64> = mesh.boundary.iter().map(|b| b.owner as i64).collect();
        Ok(Sample {
            topologies: [&host, &reflected].map(|h| HostGraph::union(&[h], spec, device)),
            hosts: [host, reflected].map(Arc::new),
            owners: Tensor::from_slice(&owners).to_device(device),
            copies: Tensor::from_slice(&copies)
                .view([-1, width as i64])
                .to_device(device),
            held: None,
            frames: Tensor::from_slice(&values).view([n_frames as i64, nodes as i64, width as i64]),
            n_frames,
            contact: None,
        })
    }

    /// Another handle on the same data, for another thread.
    pub fn share(&self) -> Self {
        Sample {
            hosts: self.hosts.clone(),
            topologies: [0, 1].map(|i| self.topologies[i].share()),
            owners: self.owners.shallow_clone(),
            copies: self.copies.shallow_clone(),
            held: self.held.as_ref().map(Tensor::shallow_clone),
            frames: self.frames.shallow_clone(),
            n_frames: self.n_frames,
            contact: self.contact.clone(),
        }
    }

    /// The body at points, or its reflection; none of cells.
    pub fn body(&self, mirror: bool) -> Option<&ContactGraph> {
        self.contact.as_ref().map(|c| &*c[usize::from(mirror)])
    }

    /// How boundary values follow cell values.
    pub fn boundary(&self) -> Boundary {
        Boundary {
            owners: self.owners.shallow_clone(),
            copies: self.copies.shallow_clone(),
            held: self.held.as_ref().map(Tensor::shallow_clone),
        }
    }

    /// All fields of a frame on the device: `([C x components], [B x components])`.
    pub fn frame(&self, frame: usize, device: Device) -> (Tensor, Tensor) {
        let all = self.frames.get(frame as i64).to_device(device);
        let (cells, boundary) = (self.hosts[0].cells as i64, self.hosts[0].boundary as i64);
        (all.narrow(0, 0, cells), all.narrow(0, cells, boundary))
    }
}

/// What the data say about a model: dimensions, fields, node types, and the stride in frames.
pub fn describe(config: &Config, first: &Trajectory, path: &Path) -> Result<ModelSpec> {
    let mesh = first.mesh();
    let mut fields = Vec::new();
    for wanted in &config.model.fields {
        let found = first
            .fields()
            .iter()
            .find(|f| f.name == wanted.name)
            .ok_or_else(|| {
                let names: Vec<&str> = first.fields().iter().map(|f| f.name.as_str()).collect();
                Error::file(
                    path,
                    format!(
                        "no field `{}`, which model.fields asks for; there are {}",
                        wanted.name,
                        names.join(", ")
                    ),
                )
            })?;
        fields.push(m4gn::model::FieldSpec {
            name: found.name.clone(),
            vector: found.vector,
            dimensions: found.dimensions,
            input: wanted.input,
            output: wanted.output,
        });
    }
    Ok(ModelSpec {
        format: 1,
        dim: mesh.dim(),
        stride: config.model.stride,
        fields,
        node_types: Vec::new(),
        architecture: config.architecture(),
        contact: None,
        segments: SegmentSpec {
            operator: Some(match config.segments.is_elastic(mesh)? {
                true => ModalOperator::Elastic,
                false => ModalOperator::Laplacian,
            }),
            ..config.segments.clone()
        },
        training: serde_json::Value::Null,
    })
}

/// Frames in one model step: the stride over the frame interval, which must be a whole number.
pub fn frames_a_step(times: &[f64], stride: f64, path: &Path) -> Result<usize> {
    let count = times.len();
    if count < 2 {
        return Err(Error::file(
            path,
            format!("{count} frames: at least two are needed to learn from"),
        ));
    }
    let interval = (times[count - 1] - times[0]) / (count - 1) as f64;
    let uneven = times
        .windows(2)
        .any(|w| ((w[1] - w[0]) / interval - 1.0).abs() > 1e-3);
    let steps = stride / interval;
    if uneven || steps < 0.5 || (steps - steps.round()).abs() > 1e-3 * steps {
        return Err(Error::file(
            path,
            format!(
                "frames every {interval:.6} s{}: model.stride = {stride} s must be a multiple of an even interval",
                if uneven { " on average, not evenly" } else { "" }
            ),
        ));
    }
    Ok(steps.round() as usize)
}
