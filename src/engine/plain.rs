//! The network written down as the paper has it, in fp64 with straight loops: what the engine is tested against.

use super::SegmentView;
use crate::graph::Graph;
use crate::model::{Activation, Model};

type Rows = Vec<Vec<f64>>;

struct Plain<'a>(&'a Model);

impl Plain<'_> {
    fn tensor(&self, name: &str) -> Vec<f64> {
        self.0
            .tensor(name)
            .unwrap()
            .data
            .iter()
            .map(|&v| v as f64)
            .collect()
    }

    fn activate(&self, x: f64) -> f64 {
        match self.0.spec.architecture.activation {
            Activation::Relu => x.max(0.0),
            Activation::Silu => x / (1.0 + (-x).exp()),
        }
    }

    /// W x, without bias.
    fn project(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let w = self.tensor(&format!("{name}.weight"));
        w.chunks(x.len())
            .map(|row| row.iter().zip(x).map(|(w, x)| w * x).sum())
            .collect()
    }

    fn linear(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let b = self.tensor(&format!("{name}.bias"));
        self.project(name, x).iter().zip(b).map(|(y, b)| y + b).collect()
    }

    fn norm(&self, name: &str, x: &[f64]) -> Vec<f64> {
        let (g, b) = (
            self.tensor(&format!("{name}.weight")),
            self.tensor(&format!("{name}.bias")),
        );
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64;
        x.iter()
            .zip(g)
            .zip(b)
            .map(|((v, g), b)| (v - mean) / (variance + 1e-5).sqrt() * g + b)
            .collect()
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
        if norm {
            self.norm(&format!("{name}.norm"), &x)
        } else {
            x
        }
    }

    fn normalise(&self, name: &str, x: &[f32]) -> Vec<f64> {
        let (mean, std) = (
            self.tensor(&format!("norm.{name}.mean")),
            self.tensor(&format!("norm.{name}.std")),
        );
        x.iter()
            .zip(mean)
            .zip(std)
            .map(|((x, m), s)| (*x as f64 - m) / s)
            .collect()
    }

    /// eq. 3, then eq. 2.
    fn pass(&self, l: usize, graph: &Graph, h: &mut Rows, e: &mut Rows) {
        let d = self.0.spec.architecture.width;
        let mut sums = vec![vec![0.0; d]; h.len()];
        for (i, e) in e.iter_mut().enumerate() {
            let (s, r) = (graph.senders[i] as usize, graph.receivers[i] as usize);
            let x = [&e[..], &h[s], &h[r]].concat();
            add(e, &self.mlp(&format!("processor.{l}.edge"), &x, true));
            add(&mut sums[r], e);
        }
        for (h, sum) in h.iter_mut().zip(sums) {
            let x = [&h[..], &sum].concat();
            add(h, &self.mlp(&format!("processor.{l}.node"), &x, true));
        }
    }

    /// eq. 9 to 13.
    fn segments(&self, view: &SegmentView, h: &Rows) -> Rows {
        let spec = self.0.spec.architecture.segment_transformer.as_ref().unwrap();
        let d = self.0.spec.architecture.width;
        let mut x = vec![vec![0.0; d]; view.count];
        for (i, h) in h.iter().enumerate() {
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
            let [q, k, v] = ["q", "k", "v"].map(|p| {
                normed
                    .iter()
                    .map(|x| self.project(&format!("{name}.{p}"), x))
                    .collect::<Rows>()
            });
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

fn members(view: &SegmentView, node: usize) -> Vec<usize> {
    let range = view.member_row[node] as usize..view.member_row[node + 1] as usize;
    view.member[range].iter().map(|&s| s as usize).collect()
}

/// Mean over a node's segments of h_S.
fn segment_of(view: &SegmentView, x: &Rows, node: usize) -> Vec<f64> {
    let list = members(view, node);
    let mut mean = vec![0.0; x[0].len()];
    for s in &list {
        mean.iter_mut()
            .zip(&x[*s])
            .for_each(|(m, x)| *m += x / list.len() as f64);
    }
    mean
}

/// The whole step on one rank: `[n_cells x n_outputs]`, physical, changes not added.
pub fn forward(model: &Model, graph: &Graph, segments: Option<&SegmentView>, inputs: &[f32]) -> Vec<f64> {
    let spec = &model.spec;
    let net = Plain(model);
    let (k, a) = (spec.n_field_inputs(), &spec.architecture);
    let mut h: Rows = (0..graph.n_owned)
        .map(|i| {
            let mut x = net.normalise("node", &inputs[i * k..(i + 1) * k]);
            x.extend(
                spec.node_types
                    .iter()
                    .map(|t| f64::from(*t as i32 == graph.node_types[i])),
            );
            let n = spec.n_offset_features();
            if let Some(view) = segments {
                x.extend(view.offsets[i * n..(i + 1) * n].iter().map(|&v| f64::from(v)));
            }
            net.mlp("encoder.node", &x, true)
        })
        .collect();
    let mut e: Rows = graph
        .edge_features
        .chunks(spec.n_edge_features())
        .map(|x| net.mlp("encoder.edge", &net.normalise("edge", x), true))
        .collect();
    (0..a.layers_before).for_each(|l| net.pass(l, graph, &mut h, &mut e));
    let stage = segments.map(|view| (view, net.segments(view, &h)));
    if let (Some((view, x)), true) = (&stage, a.layers_after > 0) {
        for (i, h) in h.iter_mut().enumerate() {
            let both = [&h[..], &segment_of(view, x, i)].concat();
            add(h, &net.linear("segment.dispatch", &both));
        }
    }
    (a.layers_before..a.layers_before + a.layers_after).for_each(|l| net.pass(l, graph, &mut h, &mut e));
    let (mean, std) = (net.tensor("norm.output.mean"), net.tensor("norm.output.std"));
    (0..graph.n_cells)
        .flat_map(|i| {
            let x = match &stage {
                Some((view, x)) => [&h[i][..], &segment_of(view, x, i)].concat(),
                None => h[i].clone(),
            };
            let y = net.mlp("decoder", &x, false);
            y.into_iter()
                .zip(&std)
                .zip(&mean)
                .map(|((y, s), m)| y * s + m)
                .collect::<Vec<_>>()
        })
        .collect()
}

mod tests {
    use super::*;
    use crate::engine::{Engine, EngineOptions, Forward};
    use crate::mesh::sample;
    use crate::model::{Activation, MacroSpec, tests::spec};
    use crate::parallel::Comm;

    /// Largest difference of the engine from the plain network, relative to the largest output.
    fn difference(model: &Model, overlap: bool, n_threads: usize) -> f64 {
        let comm = Comm::serial();
        let graph = Graph::new(&sample::triangles(9, 7, 1.6, 0.41), &comm).unwrap();
        let k = 5;
        let (mut member_row, mut member, mut sizes) = (vec![0u32], Vec::new(), vec![0.0; k]);
        for i in 0..graph.n_owned {
            let own = i * k / graph.n_owned;
            let mut list = vec![own as i32];
            if overlap && i % 3 == 0 {
                list.push(((own + 2) % k) as i32);
            }
            list.iter().for_each(|&s| sizes[s as usize] += 1.0);
            member.extend(list);
            member_row.push(member.len() as u32);
        }
        let wave = |n: usize, step: f32| -> Vec<f32> { (0..n).map(|i| (i as f32 * step).fract()).collect() };
        let position = wave(k * model.spec.n_position_features(), 0.37);
        let offsets = wave(graph.n_owned * model.spec.n_offset_features(), 0.73);
        let view = SegmentView {
            count: k,
            member_row: &member_row,
            member: &member,
            sizes: &sizes,
            position: &position,
            offsets: &offsets,
        };
        let view = model
            .spec
            .architecture
            .segment_transformer
            .is_some()
            .then_some(&view);
        let n = graph.n_owned * model.spec.n_field_inputs();
        let inputs: Vec<f32> = (0..n).map(|i| (i as f32 * 0.7).sin()).collect();
        let expected = forward(model, &graph, view, &inputs);
        let options = EngineOptions {
            n_threads,
            ..EngineOptions::default()
        };
        let mut engine = Engine::new(model, &graph, view, &options).unwrap();
        let mut outputs = vec![0f32; graph.n_cells * model.spec.n_outputs()];
        // Twice: nothing of the first step may leak into the second.
        for _ in 0..2 {
            outputs.fill(f32::NAN);
            engine.forward(&comm, &inputs, &mut outputs).unwrap();
        }
        let largest = expected.iter().fold(0f64, |m, v| m.max(v.abs()));
        let spread = expected.iter().fold(f64::MAX, |m, v| m.min(*v));
        assert!(
            largest - spread > 1e-2 * largest,
            "the network gives the same everywhere: nothing is tested"
        );
        outputs
            .iter()
            .zip(&expected)
            .fold(0f64, |m, (a, b)| m.max((*a as f64 - b).abs()))
            / largest
    }

    #[test]
    fn engine_and_plain_network_agree() {
        // Rounding of fp32 sums of 16 to 64 terms through about 20 layers: measured 1e-7 to 1e-6.
        const TOLERANCE: f64 = 1e-5;
        for hidden_layers in [0, 1, 2] {
            for activation in [Activation::Relu, Activation::Silu] {
                for (layers_after, width) in [(0, 8), (1, 20), (2, 64)] {
                    for rwse_steps in [0, 5] {
                        let mut s = spec();
                        s.architecture.width = width;
                        s.architecture.hidden_layers = hidden_layers;
                        s.architecture.activation = activation;
                        s.architecture.layers_after = layers_after;
                        s.architecture.segment_transformer = Some(MacroSpec {
                            layers: 2,
                            heads: 4,
                            ffn_width: 24,
                            rwse_steps,
                            centroids: layers_after == 1,
                            offsets: layers_after > 0,
                        });
                        let model = Model::random(s, 5).unwrap();
                        let error = difference(&model, rwse_steps > 0, 1 + layers_after);
                        assert!(error < TOLERANCE, "{error:e} with {:?}", model.spec.architecture);
                    }
                }
            }
        }
    }

    #[test]
    fn a_network_without_macro_stage_and_without_inputs() {
        let mut s = spec();
        s.architecture.segment_transformer = None;
        s.architecture.layers_after = 0;
        assert!(difference(&Model::random(s.clone(), 6).unwrap(), false, 1) < 1e-5);
        s.fields[0].input = false;
        s.fields[0].output = crate::model::Output::Value;
        assert!(difference(&Model::random(s, 6).unwrap(), false, 1) < 1e-5);
    }
}
