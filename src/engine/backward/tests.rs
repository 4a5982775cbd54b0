//! Gradients against central differences of the plain network in fp64, on every switch and instruction set.

use super::*;
use crate::plain;
use crate::tests::{instruction_sets, mesh, networks, structure};
use m4gn_model::{Activation, Model};
use m4gn_samples::distance;
use m4gn_structure::Structure;

/// A model on a small channel of triangles, and a loss: a fixed weight for each output.
struct Case {
    model: Model,
    structure: Structure,
    inputs: Vec<f32>,
    loss: Vec<f32>,
}

fn wave(n: usize, step: f32) -> Vec<f32> {
    (0..n).map(|i| (i as f32 * step + 0.3).sin()).collect()
}

impl Case {
    fn new(spec: ModelSpec, overlap: bool) -> Self {
        let structure = structure(&spec, &mesh(&spec, [4, 3, 2]), overlap);
        let graph = &structure.graph;
        Case {
            inputs: wave(graph.n_owned * spec.n_field_inputs(), 0.7),
            loss: wave(graph.n_cells * spec.n_outputs(), 1.9),
            structure,
            model: Model::random(spec, 5).unwrap(),
        }
    }

    /// The loss by the plain network.
    fn plain(&self, model: &Model, structure: &Structure, inputs: &[f32]) -> f64 {
        let s = Scales::of_model(model).unwrap();
        let m = s.output.mean.len();
        let y = plain::forward(model, structure, inputs);
        let normalised = y.iter().enumerate().map(|(i, y)| {
            let (mean, std) = (s.output.mean[i % m], s.output.std[i % m]);
            (y - f64::from(mean)) / f64::from(std)
        });
        normalised.zip(&self.loss).map(|(y, w)| y * f64::from(*w)).sum()
    }

    /// Loss, gradient and gradient of the inputs; twice, so that what the first one left is seen.
    fn gradient(&self, precision: Precision, isa: Isa) -> (f64, Vec<f32>, InputGradient) {
        let mut network = trainable(&self.model.spec, precision, Some(isa)).unwrap();
        network.load(&network.layout().flatten(&self.model).unwrap()).unwrap();
        let graph = TrainGraph::new(&self.model.spec, &self.structure).unwrap();
        let (mut worker, scales) = (network.worker(), Scales::of_model(&self.model).unwrap());
        let mut outputs = vec![0.0; self.loss.len()];
        let mut inputs =
            InputGradient { nodes: vec![f32::NAN; self.inputs.len()], edges: Some(graph.no_edge_gradient()) };
        inputs.edges.iter_mut().flatten().for_each(|e| e.fill(f32::NAN));
        let mut flat = Vec::new();
        for at in [1, 0] {
            flat = vec![0.0; network.layout().len()];
            network.forward(&mut worker, at, &graph, &scales, &self.inputs, &mut outputs);
            network.backward(&mut worker, at, &graph, &scales, &self.loss, Some(&mut inputs));
            network.flush(&mut worker, &mut flat);
        }
        let loss = outputs.iter().zip(&self.loss).map(|(y, w)| f64::from(*y) * f64::from(*w)).sum();
        (loss, flat, inputs)
    }
}

fn length(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// A step along the gradient, and one across, of this size.
fn steps(gradient: &[f32], size: f32) -> [Vec<f32>; 2] {
    let largest = gradient.iter().fold(f32::MIN_POSITIVE, |m, g| m.max(g.abs()));
    [
        gradient.iter().map(|g| size * g / largest).collect(),
        wave(gradient.len(), 2.3).iter().map(|w| size * w).collect(),
    ]
}

/// Checks a gradient by `loss(x)`, in fp64, at x plus and minus steps.
fn check(what: &str, x: &[f32], gradient: &[f32], loss: impl Fn(&[f32]) -> f64) {
    let wide: Vec<f64> = gradient.iter().map(|g| f64::from(*g)).collect();
    for step in steps(gradient, 2e-6) {
        let at = |sign: f32| -> Vec<f32> { x.iter().zip(&step).map(|(x, s)| x + sign * s).collect() };
        let (plus, minus) = (at(1.0), at(-1.0));
        // What the step really is after rounding.
        let moved = plus.iter().zip(&minus);
        let moved: Vec<f64> = moved.map(|(a, b)| f64::from(*a) - f64::from(*b)).collect();
        let expected = loss(&plus) - loss(&minus);
        let found: f64 = wide.iter().zip(&moved).map(|(g, d)| g * d).sum();
        let size = length(&wide) * length(&moved);
        assert!(
            (found - expected).abs() <= 1e-4 * size + 1e-12,
            "{what}: {found:e} where differences say {expected:e}; of {size:e}"
        );
    }
}

/// Every switch with an activation that has no kinks: of one with kinks, fp32 and fp64 see arguments on different sides of zero
/// (libtorch, which sees what the engine sees, is the sharp test of it). Not of width 64: the time of differences grows with the width's
/// square, and the comparison of instruction sets has all widths.
#[test]
fn gradients_are_those_of_differences() {
    for (name, mut spec, overlap) in networks() {
        if spec.architecture.width != 64 {
            spec.architecture.activation = Activation::Silu;
            differences(&name, Case::new(spec, overlap));
        }
    }
}

fn differences(name: &str, mut case: Case) {
    // Gains of one and biases of zero would hide what is left out.
    for (at, tensor) in case.model.tensors.values_mut().enumerate() {
        if tensor.shape.len() == 1 {
            let shift = wave(tensor.data.len(), 0.9 + at as f32);
            tensor.data.iter_mut().zip(shift).for_each(|(x, s)| *x += 0.2 * s);
        }
    }
    let (loss, flat, inputs) = case.gradient(Precision::Fp32, Isa::detect());
    let plain = case.plain(&case.model, &case.structure, &case.inputs);
    assert!((loss - plain).abs() < 1e-4 * (1.0 + plain.abs()), "{name}: {loss} {plain}");
    let layout = Layout::new(&case.model.spec);
    for (tensor, shape) in layout.entries() {
        let start = layout.find(tensor).unwrap().0;
        let n: usize = shape.iter().product();
        let weights = &case.model.tensors[tensor].data;
        let own = &flat[start..start + n];
        check(&format!("{name}: {tensor}"), weights, own, |x| {
            let mut model = case.model.clone();
            model.tensors.get_mut(tensor).unwrap().data = x.to_vec();
            case.plain(&model, &case.structure, &case.inputs)
        });
    }
    check(&format!("{name}: inputs"), &case.inputs, &inputs.nodes, |x| {
        case.plain(&case.model, &case.structure, x)
    });
    fn of_edges(structure: &mut Structure, l: usize) -> &mut Vec<f32> {
        let level = l.checked_sub(1).map(|l| &mut structure.levels[l].graph);
        &mut level.unwrap_or(&mut structure.graph).edge_features
    }
    for (l, by_features) in inputs.edges.unwrap().iter().enumerate() {
        let features = of_edges(&mut case.structure.clone(), l).clone();
        check(&format!("{name}: edges of graph {l}"), &features, by_features, |x| {
            let mut structure = case.structure.clone();
            *of_edges(&mut structure, l) = x.to_vec();
            case.plain(&case.model, &structure, &case.inputs)
        });
    }
}

#[test]
fn instruction_sets_and_precisions_agree() {
    for (name, spec, overlap) in networks() {
        let case = Case::new(spec, overlap);
        let (_, expected, by_inputs) = case.gradient(Precision::Fp32, Isa::portable());
        for isa in instruction_sets() {
            let (_, found, inputs) = case.gradient(Precision::Fp32, isa);
            let off = distance(&found, &expected);
            assert!(off < 1e-5, "{name}, {}: {off:e}", isa.name());
            assert!(distance(&inputs.nodes, &by_inputs.nodes) < 1e-5);
            // A few units of eight bits say little about narrow and deep networks; libtorch's bf16 is compared in torch/tests.
            let a = &case.model.spec.architecture;
            if a.width < 20 || a.layers() > 7 || a.needs().whole {
                continue;
            }
            let (_, found, _) = case.gradient(Precision::Bf16, isa);
            let off = distance(&found, &expected);
            assert!((1e-5..0.3).contains(&off), "{name}, bf16 {}: {off:e}", isa.name());
        }
    }
}
