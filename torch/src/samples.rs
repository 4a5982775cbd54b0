//! Trajectories in memory: fields as tensors, graphs and segments made by the core crate, batches of both.

use crate::network::{Level, Sequence, Topology};
use crate::rollout::{Boundary, State};
use crate::shared::Shared;
use m4gn_base::{Error, Result};
use m4gn_domain::{Domain, MeshEdge, moves};
use m4gn_model::ModelSpec;
use m4gn_structure::Structure;
use std::sync::Arc;
use tch::{Device, Kind, Tensor};

/// A graph on the host, with what a network reads of it, from which unions are made.
#[derive(Clone)]
pub struct HostGraph {
    /// Cells.
    pub cells: usize,
    /// Boundary nodes.
    pub boundary: usize,
    /// Its edges have rows of [`edge_width`]: features, or, of a body, positions of the senders from the receivers at rest.
    structure: Structure,
    /// Place of each node's type among the model's.
    types: Vec<usize>,
}

/// One recorded trajectory; clones are handles on the same data.
#[derive(Clone)]
pub struct Sample {
    /// The graph and its reflection, for unions with others.
    pub hosts: [Arc<HostGraph>; 2],
    /// The graph and its reflection alone, on the device.
    pub topologies: [Topology; 2],
    /// How boundary values follow cell values.
    pub boundary: Boundary,
    /// What it is the tensors of; its frames are in memory or on disk.
    recorded: Arc<m4gn_learn::samples::Sample>,
    /// The domain, and its reflection.
    pub domains: [Arc<dyn Domain>; 2],
}

/// Numbers an edge in [`Topology::edges`]: features, or, of a body, its three components at rest.
pub fn edge_width(spec: &ModelSpec) -> usize {
    match moves(spec) {
        true => spec.dim,
        false => spec.n_edge_features(),
    }
}

impl HostGraph {
    /// Of a serial structure.
    ///
    /// Errors: [`Error::Model`] for a node type that the model does not know, or segments without what it reads of them.
    pub fn new(structure: &Structure, spec: &ModelSpec) -> Result<Self> {
        let (graph, needs) = (&structure.graph, spec.architecture.needs());
        let segments = structure.segments_for(needs)?;
        if let Some(s) = segments {
            let found = (s.position.len(), s.offsets.len());
            let expected = (s.count * spec.n_position_features(), graph.n_owned * spec.n_offset_features());
            if found != expected {
                return Err(Error::Model(format!(
                    "{} positional features and {} offsets of the segments: the model needs {} and {}",
                    found.0, found.1, expected.0, expected.1
                )));
            }
        }
        let place = |&code: &i32| spec.place_of_type(code);
        Ok(HostGraph {
            cells: graph.n_cells,
            boundary: graph.n_owned - graph.n_cells,
            types: graph.node_types[..graph.n_owned].iter().map(place).collect::<Result<_>>()?,
            structure: Structure {
                graph: graph.clone(),
                segments: segments.cloned(),
                sequence: structure.sequence_for(needs)?.cloned(),
                levels: structure.levels_for(needs)?.to_vec(),
                walk: structure.walk_for(needs)?.to_vec(),
                place: structure.place.clone(),
            },
        })
    }

    /// Takes the edges of a body's mesh, which stay, in place of those of its graph at rest, where world edges are among them.
    fn set_edges(&mut self, edges: &[MeshEdge]) {
        let graph = &mut self.structure.graph;
        graph.senders = edges.iter().map(|e| e.sender).collect();
        graph.receivers = edges.iter().map(|e| e.receiver).collect();
        graph.edge_features = edges.iter().flat_map(|e| e.rest.map(|v| v as f32)).collect();
    }

    /// The disjoint union of graphs: all their cells, then all their boundary nodes.
    pub fn union(graphs: &[&HostGraph], spec: &ModelSpec, device: Device) -> Topology {
        let cells: usize = graphs.iter().map(|g| g.cells).sum();
        let nodes = cells + graphs.iter().map(|g| g.boundary).sum::<usize>();
        let width = spec.n_static_features();
        // A body's obstacle is one more.
        let count = graphs.iter().map(|g| g.structure.n_segments()).max().unwrap_or(0);
        let (mut first_cell, mut first_boundary) = (0, cells);
        let (mut senders, mut receivers, mut edges) = (vec![], vec![], vec![]);
        let (mut member_node, mut member_segment) = (vec![], vec![]);
        let (mut segment_weight, mut position, mut absent) = (vec![], vec![], vec![]);
        let mut sequences: Vec<Vec<i64>> = Vec::new();
        let (mut fixed, mut node_weight) = (vec![0f32; nodes * width], vec![1f32; nodes]);
        let mut choice = vec![[0; 2]; nodes];
        let (steps, n_offsets) = (spec.architecture.micro.node_rwse_steps, spec.n_offset_features());
        let mut walk = vec![0f32; nodes * steps];
        for (g, graph) in graphs.iter().enumerate() {
            let Structure { graph: own, segments, sequence, walk: of_nodes, .. } = &graph.structure;
            let chosen = graph.structure.choice();
            let place = |node: usize| match node < graph.cells {
                true => first_cell + node,
                false => first_boundary + node - graph.cells,
            };
            let placed =
                |list: &[i32]| -> Vec<i64> { list.iter().map(|&n| place(n as usize) as i64).collect() };
            senders.extend(placed(&own.senders));
            receivers.extend(placed(&own.receivers));
            edges.extend_from_slice(&own.edge_features);
            for (node, &kind) in graph.types.iter().enumerate() {
                let to = place(node);
                choice[to] = [g as u32, chosen[node][1]];
                fixed[to * width + kind] = 1.0;
                walk[to * steps..][..steps].copy_from_slice(&of_nodes[node * steps..][..steps]);
            }
            if let Some(s) = segments {
                for (node, row) in s.member_row.windows(2).enumerate() {
                    let (to, members) = (place(node), &s.member[row[0] as usize..row[1] as usize]);
                    member_node.extend(members.iter().map(|_| to as i64));
                    member_segment.extend(members.iter().map(|&m| (g * count) as i64 + i64::from(m)));
                    node_weight[to] = 1.0 / members.len().max(1) as f32;
                    fixed[(to + 1) * width - n_offsets..][..n_offsets]
                        .copy_from_slice(&s.offsets[node * n_offsets..][..n_offsets]);
                }
                segment_weight.extend(s.sizes.iter().map(|&n| if n > 0.0 { (1.0 / n) as f32 } else { 0.0 }));
                position.extend_from_slice(&s.position);
                absent.resize(g * count + s.count, 0f32);
            }
            if let Some(s) = sequence {
                sequences.extend(s.row.windows(2).map(|w| placed(&s.node[w[0] as usize..w[1] as usize])));
                // Any node: what comes of it is read by none.
                sequences.resize((g + 1) * count, vec![first_cell as i64]);
            }
            segment_weight.resize((g + 1) * count, 0.0);
            position.resize((g + 1) * count * spec.n_position_features(), 0.0);
            absent.resize((g + 1) * count, f32::NEG_INFINITY);
            first_cell += graph.cells;
            first_boundary += graph.boundary;
        }
        let levels = Self::levels(graphs, &mut edges, edge_width(spec), device);
        let total = (graphs.len() * count) as i64;
        let own_rows =
            member_node.iter().enumerate().all(|(i, &n)| n == i as i64) && member_node.len() == nodes;
        let n_position = spec.n_position_features() as i64;
        let to = |t: Tensor| Shared::from(t.to_device(device));
        Topology {
            graphs: graphs.len() as i64,
            nodes: nodes as i64,
            cells: cells as i64,
            segments: count as i64,
            absent: absent
                .contains(&f32::NEG_INFINITY)
                .then(|| to(Tensor::from_slice(&absent).view([graphs.len() as i64, 1, 1, count as i64]))),
            senders: to(Tensor::from_slice(&senders)),
            receivers: to(Tensor::from_slice(&receivers)),
            edges: to(Tensor::from_slice(&edges).view([-1, edge_width(spec) as i64])),
            is_world: moves(spec)
                .then(|| Tensor::zeros([edges.len() as i64 / 3, 1], (Kind::Float, device)).into()),
            fixed: to(Tensor::from_slice(&fixed).view([nodes as i64, width as i64])),
            member_node: if own_rows { None } else { Some(to(Tensor::from_slice(&member_node))) },
            member_segment: to(Tensor::from_slice(&member_segment)),
            segment_weight: to(Tensor::from_slice(&segment_weight).view([-1, 1])),
            node_weight: to(Tensor::from_slice(&node_weight).view([-1, 1])),
            sequence: sequence(&sequences, device),
            position: if n_position > 0 {
                Some(to(Tensor::from_slice(&position).view([total, n_position])))
            } else {
                None
            },
            levels,
            choice,
            walk: (steps > 0).then(|| to(Tensor::from_slice(&walk).view([nodes as i64, steps as i64]))),
        }
    }

    /// The coarser graphs of a union, whose nodes are those of one graph after those of the other; the features of their edges are
    /// appended.
    fn levels(graphs: &[&HostGraph], edges: &mut Vec<f32>, width: usize, device: Device) -> Vec<Level> {
        let cells: usize = graphs.iter().map(|g| g.cells).sum();
        let mut finer_place: Vec<Vec<i64>> = Vec::new();
        let (mut first_cell, mut first_boundary) = (0, cells as i64);
        for g in graphs {
            let boundary = first_boundary..first_boundary + g.boundary as i64;
            let cells = first_cell..first_cell + g.cells as i64;
            (first_cell, first_boundary) = (cells.end, boundary.end);
            finer_place.push(cells.chain(boundary).collect());
        }
        let to = |list: Vec<i64>| Shared::from(Tensor::from_slice(&list).to_device(device));
        let level = |l: usize| {
            let (mut senders, mut receivers, mut finer, mut coarse) = (vec![], vec![], vec![], vec![]);
            let (mut share, mut nodes) = (Vec::new(), 0);
            for (places, g) in finer_place.iter_mut().zip(graphs) {
                let m4gn_structure::Level { graph, down, .. } = &g.structure.levels[l];
                senders.extend(graph.senders.iter().map(|&s| nodes + i64::from(s)));
                receivers.extend(graph.receivers.iter().map(|&r| nodes + i64::from(r)));
                let features = graph.edge_features.len() / graph.senders.len().max(1);
                // Of a body the vector at rest, which comes first.
                edges.extend(graph.edge_features.chunks(features.max(1)).flat_map(|row| &row[..width]));
                finer.extend(down.from.iter().map(|&i| places[i as usize]));
                for row in 0..graph.n_owned {
                    coarse.extend(down.terms(row).map(|_| nodes + row as i64));
                }
                share.extend_from_slice(&down.weight);
                *places = (nodes..nodes + graph.n_owned as i64).collect();
                nodes += graph.n_owned as i64;
            }
            Level {
                nodes,
                senders: to(senders),
                receivers: to(receivers),
                finer: to(finer),
                coarse: to(coarse),
                share: Tensor::from_slice(&share).view([-1, 1]).to_device(device).into(),
            }
        };
        (0..graphs.first().map_or(0, |g| g.structure.levels.len())).map(level).collect()
    }
}

/// Rows of nodes, as long as the longest of them.
fn sequence(rows: &[Vec<i64>], device: Device) -> Option<Sequence> {
    let longest = rows.iter().map(Vec::len).max()?;
    let nodes: Vec<i64> =
        rows.iter().flat_map(|r| (0..longest).map(|t| r.get(t).map_or(r[0], |&n| n))).collect();
    let last: Vec<i64> = rows.iter().map(|r| r.len() as i64 - 1).collect();
    let to =
        |values: &[i64], width: i64| Tensor::from_slice(values).view([-1, width]).to_device(device).into();
    Some(Sequence { nodes: to(&nodes, longest as i64), last: to(&last, 1) })
}

impl Sample {
    /// The tensors of a trajectory.
    ///
    /// Errors: [`Error::Model`] for a node type that the model does not know.
    pub fn new(sample: &Arc<m4gn_learn::samples::Sample>, spec: &ModelSpec, device: Device) -> Result<Self> {
        let domains = [sample.domain.clone(), sample.domain.reflected()].map(Arc::from);
        let graph = |structure: &Structure, domain: &Arc<dyn Domain>| {
            let mut host = HostGraph::new(structure, spec)?;
            // World edges come with each state.
            if let Some(edges) = domain.mesh_edges() {
                host.set_edges(edges);
            }
            Ok(host)
        };
        let host = graph(&sample.structure, &domains[0])?;
        let reflected = graph(&sample.structure.reflected(spec), &domains[1])?;
        let of_node = |node| (0..sample.width).map(move |i| sample.domain.is_held(node, i));
        let held: Vec<bool> = (0..host.cells).flat_map(of_node).collect();
        let floats = |flags: &[bool]| -> Vec<f32> { flags.iter().map(|&f| f32::from(u8::from(f))).collect() };
        let boundary = sample.domain.boundary();
        let owners: Vec<i64> = boundary.owners().map(|o| o as i64).collect();
        let width = sample.width as i64;
        Ok(Sample {
            topologies: [&host, &reflected].map(|h| HostGraph::union(&[h], spec, device)),
            boundary: Boundary {
                owners: Tensor::from_slice(&owners).to_device(device).into(),
                copies: Tensor::from_slice(&floats(boundary.follows()))
                    .view([-1, width])
                    .to_device(device)
                    .into(),
                held: held
                    .contains(&true)
                    .then(|| Tensor::from_slice(&floats(&held)).view([-1, width]).to_device(device).into()),
            },
            recorded: sample.clone(),
            domains,
            hosts: [host, reflected].map(Arc::new),
        })
    }

    /// The domain, or its reflection.
    pub fn domain(&self, mirror: bool) -> &dyn Domain {
        &*self.domains[usize::from(mirror)]
    }

    /// All fields of a frame on the device.
    ///
    /// Errors: [`Error::File`] where the frame has to be read, and cannot be.
    pub fn frame(&self, frame: usize, device: Device) -> Result<State> {
        let all = Tensor::from_slice(&self.recorded.frame(frame)?);
        let all = all.view([-1, self.recorded.width as i64]).to_device(device);
        let (cells, boundary) = (self.hosts[0].cells as i64, self.hosts[0].boundary as i64);
        Ok(State { cells: all.narrow(0, 0, cells), boundary: all.narrow(0, cells, boundary) })
    }
}
