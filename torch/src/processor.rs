//! What stands between the encoder of the nodes and the decoder, on libtorch: one function a kind of network.

use crate::contact::host;
use crate::network::{Links, Network, Rows, Topology, pick, sum_into};
use m4gn_model::{Kind, M4gn};
use m4gn_structure::Pooled;
use tch::Tensor;

/// From the nodes' latents and the normalised edge features to what the decoder reads, a row a cell.
pub fn run(network: &Network, graph: &Topology, h: Rows, edges: &Tensor) -> Tensor {
    let rows = match &network.architecture().kind {
        Kind::M4gn(m) | Kind::Eagle(m) => with_segments(m, network, graph, h, edges),
        Kind::MeshGraphNet { layers } => messages(*layers, network, graph, h, edges),
        Kind::Gcn { layers } => convolutions(*layers, network, graph, h.full),
        Kind::BsmsGnn { levels } => bi_stride(*levels, network, graph, h, edges),
        Kind::GUNet { levels } => graph_u_net(*levels, network, graph, h, edges),
    };
    rows.narrow(0, 0, graph.cells)
}

/// Message passing (eq. 2, 3) around the macro stage (eq. 9 to 13), or EAGLE's (Janny et al. 2023).
fn with_segments(m: &M4gn, network: &Network, graph: &Topology, mut h: Rows, edges: &Tensor) -> Tensor {
    let mut e = network.encode_edges(graph, edges);
    for l in 0..m.layers_before {
        network.message_passing(l, graph, &mut h, &mut e);
    }
    let segments = network.segment_transformer(&m.segment_transformer, graph, &h.full);
    let context = network.to_nodes(graph, &segments);
    if m.layers_after > 0 {
        h = network.dispatch(&h, &context);
    }
    for l in m.layers_before..m.layers_before + m.layers_after {
        network.message_passing(l, graph, &mut h, &mut e);
    }
    match network.architecture().decodes_segments() {
        true => Tensor::cat(&[h.full, context], 1),
        false => h.full,
    }
}

/// Message passing alone.
fn messages(layers: usize, network: &Network, graph: &Topology, mut h: Rows, edges: &Tensor) -> Tensor {
    let mut e = network.encode_edges(graph, edges);
    for l in 0..layers {
        network.message_passing(l, graph, &mut h, &mut e);
    }
    h.full
}

/// Graph convolutions (Kipf & Welling 2016).
fn convolutions(layers: usize, network: &Network, graph: &Topology, mut h: Tensor) -> Tensor {
    let ones = Tensor::ones([graph.receivers.size()[0], 1], (h.kind(), h.device()));
    let scale: Tensor = (sum_into(graph.nodes, &ones, &graph.receivers) + 1.0).rsqrt();
    for l in 0..layers {
        let scaled = h * &scale;
        let sums = sum_into(graph.nodes, &pick(&scaled, &graph.senders), &graph.receivers);
        h = network.convolution(l, &((scaled + sums) * &scale));
    }
    h
}

/// BSMS-GNN (Cao et al. 2023).
fn bi_stride(levels: usize, network: &Network, graph: &Topology, mut h: Rows, edges: &Tensor) -> Tensor {
    let links: Vec<_> =
        std::iter::once(graph.links()).chain(graph.levels.iter().map(|l| l.links())).collect();
    let counts: Vec<i64> = links.iter().map(|l| l.senders.size()[0]).collect();
    let features = edges.split_with_sizes(&counts[..], 0);
    let mut left = Vec::new();
    for (l, links) in links.iter().enumerate() {
        network.feature_passing(l, *links, &mut h, &features[l]);
        if let Some(level) = graph.levels.get(l) {
            let terms = pick(&h.full, &level.finer) * &*level.share;
            left.push(h.full);
            h = network.rows(sum_into(level.nodes, &terms, &level.coarse));
        }
    }
    for (l, before) in left.iter().enumerate().rev() {
        let level = &graph.levels[l];
        let terms = pick(&h.full, &level.coarse) * &*level.share;
        h = network.rows(sum_into(links[l].nodes, &terms, &level.finer));
        network.feature_passing(2 * levels - l, links[l], &mut h, &features[l]);
        h = network.rows(h.full + before);
    }
    h.full
}

/// A graph as it is at a step, its features, and which nodes of the finer one it has.
struct Floor {
    nodes: i64,
    ends: [Vec<i32>; 2],
    senders: Tensor,
    receivers: Tensor,
    features: Tensor,
    choice: Vec<[u32; 2]>,
    kept: Option<Tensor>,
}

impl Floor {
    fn links(&self) -> Links<'_> {
        Links { nodes: self.nodes, senders: &self.senders, receivers: &self.receivers, is_world: None }
    }

    /// The graph of the nodes with the largest scores.
    fn below(&self, scores: &Tensor) -> Self {
        let device = scores.device();
        // Scores are finite numbers in fp32, which can be read.
        let scores = host(scores).unwrap_or_default();
        let Pooled { kept, graph, edges } =
            Pooled::new((&self.ends[0], &self.ends[1]), &self.choice, &scores);
        let index = |list: Vec<i64>| Tensor::from_slice(&list).to_device(device);
        let wide = |list: &[i32]| index(list.iter().map(|&i| i64::from(i)).collect());
        let rows = 0..graph.senders.len();
        let row = rows.flat_map(|e| edges.terms(e).map(move |_| e as i64)).collect();
        let share = Tensor::from_slice(&edges.weight).view([-1, 1]).to_device(device);
        let terms = pick(&self.features, &wide(&edges.from)) * share;
        Floor {
            nodes: kept.len() as i64,
            senders: wide(&graph.senders),
            receivers: wide(&graph.receivers),
            features: sum_into(graph.senders.len() as i64, &terms, &index(row)),
            choice: kept.iter().map(|&i| self.choice[i as usize]).collect(),
            kept: Some(index(kept.iter().map(|&i| i64::from(i)).collect())),
            ends: [graph.senders, graph.receivers],
        }
    }
}

/// g-U-Net (Gao and Ji 2019).
fn graph_u_net(levels: usize, network: &Network, graph: &Topology, mut h: Rows, edges: &Tensor) -> Tensor {
    let list = |t: &Tensor| Vec::<i64>::try_from(t).unwrap_or_default().iter().map(|&i| i as i32).collect();
    let mut floors = vec![Floor {
        nodes: graph.nodes,
        ends: [list(&graph.senders), list(&graph.receivers)],
        senders: graph.senders.shallow_clone(),
        receivers: graph.receivers.shallow_clone(),
        features: edges.shallow_clone(),
        choice: graph.choice.clone(),
        kept: None,
    }];
    let mut left = Vec::new();
    for l in 0..=levels {
        network.feature_passing(l, floors[l].links(), &mut h, &floors[l].features);
        if l < levels {
            let scores = network.scores(l, &h);
            let below = floors[l].below(&scores.detach().view([-1]));
            if let Some(kept) = &below.kept {
                left.push(h.full.shallow_clone());
                h = network.rows(pick(&h.full, kept) * pick(&scores, kept).tanh());
            }
            floors.push(below);
        }
    }
    for (l, before) in left.iter().enumerate().rev() {
        let floor = &floors[l];
        if let Some(kept) = &floors[l + 1].kept {
            h = network.rows(before + sum_into(floor.nodes, &h.full, kept));
        }
        network.feature_passing(2 * levels - l, floor.links(), &mut h, &floor.features);
    }
    h.full
}
