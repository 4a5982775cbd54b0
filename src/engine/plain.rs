//! The network written down as the paper has it, in fp64 with straight loops: what the engine is tested against.

use m4gn_model::{Activation, Kind, M4gn, MacroSpec, Model, NodeSums};
use m4gn_structure::graph::Graph;
use m4gn_structure::{Segmentation, Sequence, Structure, Transfer};

type Rows = Vec<Vec<f64>>;

struct Plain<'a>(&'a Model);

/// The product of a row and a vector, as eight sums that do not wait for each other.
fn dot(row: &[f32], x: &[f64]) -> f64 {
    let ((rows, row_end), (xs, x_end)) = (row.as_chunks::<8>(), x.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (row, x) in rows.iter().zip(xs) {
        for ((sum, w), x) in sums.iter_mut().zip(row).zip(x) {
            *sum += f64::from(*w) * x;
        }
    }
    let end: f64 = row_end.iter().zip(x_end).map(|(w, x)| f64::from(*w) * x).sum();
    sums.iter().sum::<f64>() + end
}

impl Plain<'_> {
    fn tensor(&self, name: &str) -> Vec<f64> {
        self.0.tensor(name).unwrap().data.iter().map(|&v| v as f64).collect()
    }

    fn activate(&self, x: f64) -> f64 {
        match self.0.spec.architecture.activation {
            Activation::Relu => x.max(0.0),
            Activation::Silu => x / (1.0 + (-x).exp()),
        }
    }

    /// W x, without bias.
    fn project(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let w = &self.0.tensor(&format!("{name}.weight")).unwrap().data;
        w.chunks(x.len()).map(|row| dot(row, x)).collect()
    }

    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let b = self.tensor(&format!("{name}.bias"));
        self.project(name, x).iter().zip(b).map(|(y, b)| y + b).collect()
    }

    fn norm(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let (g, b) = (self.tensor(&format!("{name}.weight")), self.tensor(&format!("{name}.bias")));
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64;
        x.iter().zip(g).zip(b).map(|((v, g), b)| (v - mean) / (variance + 1e-5).sqrt() * g + b).collect()
    }

    fn mlp(&self, name: &str, x: &[f64], norm: bool) -> Vec<f64> {
        let h = self.0.spec.architecture.hidden_layers;
        let mut x = x.to_vec();
        for i in 0..=h {
            x = self.linear(&format!("{name}.{i}"), &x);
            if i < h {
                x = x.into_iter().map(|v| self.activate(v)).collect();
            }
        }
        if norm { self.norm(&format!("{name}.norm"), &x) } else { x }
    }

    fn normalise(&self, name: &str, x: &[f32]) -> Vec<f64> {
        let (mean, std) =
            (self.tensor(&format!("norm.{name}.mean")), self.tensor(&format!("norm.{name}.std")));
        x.iter().zip(mean).zip(std).map(|((x, m), s)| (*x as f64 - m) / s).collect()
    }

    /// eq. 3 and 4, and eq. 2 of the edges before or after.
    fn pass(&self, l: usize, graph: &Graph, h: &mut Rows, e: &mut Rows) {
        let d = self.0.spec.architecture.width;
        let mut sums = vec![vec![0.0; d * self.0.spec.architecture.edge_kinds()]; h.len()];
        let before = self.0.spec.architecture.micro.node_sums == NodeSums::Before;
        let last = l + 1 == self.0.spec.architecture.layers();
        for (i, e) in e.iter_mut().enumerate() {
            let (s, r) = (graph.senders[i] as usize, graph.receivers[i] as usize);
            let kind = d * self.kind(graph, i);
            if before {
                add(&mut sums[r][kind..kind + d], e);
            }
            // Nothing reads what the last layer would make of these.
            if !(before && last) {
                let x = [&e[..], &h[s], &h[r]].concat();
                add(e, &self.mlp(&format!("processor.{l}.edge"), &x, true));
            }
            if !before {
                add(&mut sums[r][kind..kind + d], e);
            }
        }
        self.update(l, h, sums);
    }

    /// eq. 2 of the nodes.
    fn update(&self, l: usize, h: &mut Rows, sums: Rows) {
        for (h, sum) in h.iter_mut().zip(sums) {
            let x = [&h[..], &sum].concat();
            add(h, &self.mlp(&format!("processor.{l}.node"), &x, true));
        }
    }

    /// Algorithm 2 of Cao et al. 2023, from graph l downwards.
    fn bi_stride(&self, structure: &Structure, l: usize, h: &mut Rows) {
        let graph = l.checked_sub(1).map_or(&structure.graph, |l| &structure.levels[l].graph);
        let features = self.features(graph);
        self.pass_features(l, graph, &features, h);
        let Some(level) = structure.levels.get(l) else { return };
        let mut coarse = transferred(&level.down, h);
        self.bi_stride(structure, l + 1, &mut coarse);
        let mut up = transferred(&level.up, &coarse);
        self.pass_features(2 * structure.levels.len() - l, graph, &features, &mut up);
        h.iter_mut().zip(up).for_each(|(h, up)| add(h, &up));
    }

    /// Its message passing.
    fn pass_features(&self, layer: usize, graph: &Graph, features: &Rows, h: &mut Rows) {
        let mut sums = vec![vec![0.0; self.0.spec.architecture.width]; h.len()];
        for (i, x) in features.iter().enumerate() {
            let (s, r) = (graph.senders[i] as usize, graph.receivers[i] as usize);
            let x = [&x[..], &h[s], &h[r]].concat();
            add(&mut sums[r], &self.mlp(&format!("processor.{layer}.edge"), &x, true));
        }
        self.update(layer, h, sums);
    }

    /// Gao and Ji 2019, from a graph downwards: who hears whom, and the features of these edges.
    fn u_net(&self, l: usize, graph: &Graph, features: &Rows, h: &mut Rows) {
        let layers = self.0.spec.architecture.layers();
        self.pass_features(l, graph, features, h);
        if 2 * l + 1 == layers {
            return;
        }
        let p = self.tensor(&format!("processor.{l}.score.weight"));
        let length = p.iter().map(|p| p * p).sum::<f64>().sqrt();
        let score: Vec<f64> = h.iter().map(|h| h.iter().zip(&p).map(|(h, p)| h * p / length).sum()).collect();
        // The nodes with the largest scores, and who of them can be reached in two steps, one of which may be none.
        let mut order: Vec<usize> = (0..h.len()).collect();
        order.sort_by(|&a, &b| score[b].total_cmp(&score[a]));
        let mut kept = order[..h.len().div_ceil(2)].to_vec();
        kept.sort();
        let none = vec![0.0; features.first().map_or(0, Vec::len)];
        let mut steps = vec![vec![None; h.len()]; h.len()];
        (0..h.len()).for_each(|i| steps[i][i] = Some(&none));
        for (e, x) in features.iter().enumerate() {
            steps[graph.receivers[e] as usize][graph.senders[e] as usize] = Some(x);
        }
        let (mut coarse, mut below) = (Rows::new(), Graph { row: vec![0], ..graph.clone() });
        (below.senders, below.receivers) = (Vec::new(), Vec::new());
        for (new_r, &r) in kept.iter().enumerate() {
            for (new_s, &s) in kept.iter().enumerate().filter(|(_, s)| **s != r) {
                let ways = (0..h.len()).filter_map(|m| Some((steps[r][m]?, steps[m][s]?)));
                let halves: Rows =
                    ways.map(|(a, b)| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()).collect();
                if halves.is_empty() {
                    continue;
                }
                let mean =
                    (0..none.len()).map(|c| halves.iter().map(|x| x[c]).sum::<f64>() / halves.len() as f64);
                coarse.push(mean.collect());
                below.senders.push(new_s as i32);
                below.receivers.push(new_r as i32);
            }
        }
        let gated = |&i: &usize| h[i].iter().map(|h| h * score[i].tanh()).collect();
        let mut inner: Rows = kept.iter().map(gated).collect();
        self.u_net(l + 1, &below, &coarse, &mut inner);
        kept.iter().zip(inner).for_each(|(&i, x)| add(&mut h[i], &x));
        self.pass_features(layers - 1 - l, graph, features, h);
    }

    /// Normalised features of the edges.
    fn features(&self, graph: &Graph) -> Rows {
        let features = graph.edge_features.chunks(self.0.spec.n_edge_features());
        features.map(|x| self.normalise("edge", x)).collect()
    }

    /// eq. 1 of the edges.
    fn edges(&self, graph: &Graph) -> Rows {
        let encoders = self.0.spec.architecture.edge_encoders();
        let encode = |(i, x): (usize, &Vec<f64>)| self.mlp(encoders[self.kind(graph, i)], x, true);
        self.features(graph).iter().enumerate().map(encode).collect()
    }

    /// 1 for a world edge that has weights of its own.
    fn kind(&self, graph: &Graph, edge: usize) -> usize {
        let flag = graph.edge_features[(edge + 1) * self.0.spec.n_edge_features() - 1];
        usize::from(self.0.spec.architecture.edge_kinds() > 1 && flag > 0.5)
    }

    /// All layers and the macro stage; what a node's segments add to what the decoder reads.
    fn m4gn(&self, m: &M4gn, structure: &Structure, h: &mut Rows) -> Rows {
        let (graph, view) = (&structure.graph, structure.segments.as_ref().unwrap());
        let mut e = self.edges(graph);
        (0..m.layers_before).for_each(|l| self.pass(l, graph, h, &mut e));
        let x = self.segments(&m.segment_transformer, structure, h);
        let context: Rows = (0..h.len()).map(|i| segment_of(view, &x, i)).collect();
        if m.layers_after > 0 {
            for (h, context) in h.iter_mut().zip(&context) {
                let both = [&h[..], context].concat();
                add(h, &self.linear("segment.dispatch", &both));
            }
        }
        (m.layers_before..m.layers_before + m.layers_after).for_each(|l| self.pass(l, graph, h, &mut e));
        context
    }

    /// Kipf & Welling 2016, eq. 2.
    fn convolve(&self, l: usize, graph: &Graph, h: &mut Rows) {
        let degree = |i: usize| 1.0 + f64::from(graph.row[i + 1] - graph.row[i]);
        let sums: Rows = (0..h.len())
            .map(|r| {
                let mut sum: Vec<f64> = h[r].iter().map(|x| x / degree(r)).collect();
                for e in graph.row[r] as usize..graph.row[r + 1] as usize {
                    let s = graph.senders[e] as usize;
                    let share = 1.0 / (degree(s) * degree(r)).sqrt();
                    let part: Vec<f64> = h[s].iter().map(|x| share * x).collect();
                    add(&mut sum, &part);
                }
                sum
            })
            .collect();
        for (h, sum) in h.iter_mut().zip(sums) {
            let x = self.linear(&format!("processor.{l}.convolution"), &sum);
            *h = x.into_iter().map(|v| self.activate(v)).collect();
        }
    }

    /// The last state of a gated recurrent unit that has read the nodes of a segment.
    fn recurrence(&self, sequence: &Sequence, s: usize, h: &Rows) -> Vec<f64> {
        let d = self.0.spec.architecture.width;
        let logistic = |x: f64| 1.0 / (1.0 + (-x).exp());
        let mut state = vec![0.0; d];
        for &i in &sequence.node[sequence.row[s] as usize..sequence.row[s + 1] as usize] {
            let x = self.linear("segment.recurrence.input", &h[i as usize]);
            let y = self.linear("segment.recurrence.hidden", &state);
            for (i, state) in state.iter_mut().enumerate() {
                let [reset, update] = [i, d + i].map(|i| logistic(x[i] + y[i]));
                let new = (x[2 * d + i] + reset * y[2 * d + i]).tanh();
                *state = (1.0 - update) * new + update * *state;
            }
        }
        state
    }

    /// eq. 9 to 13.
    fn segments(&self, spec: &MacroSpec, structure: &Structure, h: &Rows) -> Rows {
        let view = structure.segments.as_ref().unwrap();
        let sequence = structure.sequence_for(self.0.spec.architecture.needs()).unwrap();
        let d = self.0.spec.architecture.width;
        let mut x = vec![vec![0.0; d]; view.count];
        if let Some(sequence) = sequence {
            x = (0..view.count).map(|s| self.recurrence(sequence, s, h)).collect();
        }
        for (i, h) in h.iter().enumerate().filter(|_| sequence.is_none()) {
            for s in members(view, i) {
                let share: Vec<f64> = h.iter().map(|v| v / view.sizes[s]).collect();
                add(&mut x[s], &share);
            }
        }
        for (s, x) in x.iter_mut().enumerate() {
            *x = self.mlp("segment.encoder", x, true);
            let n = self.0.spec.n_position_features();
            if n > 0 {
                let p = &view.position[s * n..(s + 1) * n];
                let p: Vec<f64> = p.iter().map(|&v| v as f64).collect();
                add(x, &self.mlp("segment.position", &p, false));
            }
        }
        let head = d / spec.heads;
        for l in 0..spec.layers {
            let name = format!("segment.transformer.{l}");
            let normed: Rows = x.iter().map(|x| self.norm(&format!("{name}.norm1"), x)).collect();
            let [q, k, v] = ["q", "k", "v"]
                .map(|p| normed.iter().map(|x| self.project(&format!("{name}.{p}"), x)).collect::<Rows>());
            let mut out = vec![vec![0.0; d]; view.count];
            for (i, out) in out.iter_mut().enumerate() {
                for c in (0..d).step_by(head) {
                    let score = |j: usize| {
                        (c..c + head).map(|c| q[i][c] * k[j][c]).sum::<f64>() / (head as f64).sqrt()
                    };
                    let weights: Vec<f64> = (0..view.count).map(|j| score(j).exp()).collect();
                    let total: f64 = weights.iter().sum();
                    for j in 0..view.count {
                        (c..c + head).for_each(|c| out[c] += weights[j] / total * v[j][c]);
                    }
                }
            }
            for (x, out) in x.iter_mut().zip(out) {
                add(x, &self.linear(&format!("{name}.o"), &out));
                let hidden = self.linear(&format!("{name}.ffn.0"), &self.norm(&format!("{name}.norm2"), x));
                let hidden: Vec<f64> = hidden.into_iter().map(|v| self.activate(v)).collect();
                add(x, &self.linear(&format!("{name}.ffn.1"), &hidden));
            }
        }
        x
    }
}

fn add(x: &mut [f64], y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}

fn transferred(transfer: &Transfer, x: &Rows) -> Rows {
    let row = |i: usize| {
        let mut sum = vec![0.0; x[0].len()];
        for k in transfer.terms(i) {
            let part = x[transfer.from[k] as usize].iter().map(|x| f64::from(transfer.weight[k]) * x);
            add(&mut sum, &part.collect::<Vec<_>>());
        }
        sum
    };
    (0..transfer.row.len() - 1).map(row).collect()
}

fn members(view: &Segmentation, node: usize) -> Vec<usize> {
    let range = view.member_row[node] as usize..view.member_row[node + 1] as usize;
    view.member[range].iter().map(|&s| s as usize).collect()
}

/// Mean over a node's segments of h_S.
fn segment_of(view: &Segmentation, x: &Rows, node: usize) -> Vec<f64> {
    let list = members(view, node);
    let mut mean = vec![0.0; x[0].len()];
    for s in &list {
        mean.iter_mut().zip(&x[*s]).for_each(|(m, x)| *m += x / list.len() as f64);
    }
    mean
}

/// The whole step on one rank: `[n_cells x n_outputs]`, physical, changes not added.
pub fn forward(model: &Model, structure: &Structure, inputs: &[f32]) -> Vec<f64> {
    let (graph, segments) = (&structure.graph, structure.segments.as_ref());
    let spec = &model.spec;
    let net = Plain(model);
    let k = spec.n_field_inputs();
    let mut h: Rows = (0..graph.n_owned)
        .map(|i| {
            let mut x = net.normalise("node", &inputs[i * k..(i + 1) * k]);
            x.extend(spec.node_types.iter().map(|t| f64::from(*t as i32 == graph.node_types[i])));
            let n = spec.n_offset_features();
            if let Some(view) = segments {
                x.extend(view.offsets[i * n..(i + 1) * n].iter().map(|&v| f64::from(v)));
            }
            let steps = spec.architecture.micro.node_rwse_steps;
            if steps > 0 {
                let p: Vec<f64> =
                    structure.walk[i * steps..(i + 1) * steps].iter().map(|&v| v.into()).collect();
                add(&mut x, &net.mlp("encoder.position", &p, false));
            }
            net.mlp("encoder.node", &x, true)
        })
        .collect();
    let mut context = vec![vec![]; h.len()];
    match &spec.architecture.kind {
        Kind::M4gn(m) => context = net.m4gn(m, structure, &mut h),
        Kind::Eagle(m) => {
            net.m4gn(m, structure, &mut h);
        }
        Kind::MeshGraphNet { layers } => {
            let mut e = net.edges(graph);
            (0..*layers).for_each(|l| net.pass(l, graph, &mut h, &mut e));
        }
        Kind::Gcn { layers } => (0..*layers).for_each(|l| net.convolve(l, graph, &mut h)),
        Kind::GUNet { .. } => net.u_net(0, graph, &net.features(graph), &mut h),
        Kind::BsmsGnn { .. } => net.bi_stride(structure, 0, &mut h),
    }
    let (mean, std) = (net.tensor("norm.output.mean"), net.tensor("norm.output.std"));
    (0..graph.n_cells)
        .flat_map(|i| {
            let x = [&h[i][..], &context[i]].concat();
            let y = net.mlp("decoder", &x, false);
            y.into_iter().zip(&std).zip(&mean).map(|((y, s), m)| y * s + m).collect::<Vec<_>>()
        })
        .collect()
}
