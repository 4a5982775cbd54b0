//! The tch model against the native engine on the same weights, bfloat16 against fp32, and unions
//! of graphs against single ones.

use m4gn_engine::backward::Layout;
use m4gn_engine::{Engine, EngineOptions, Forward};
use m4gn_mesh::Mesh;
use m4gn_model::{
    Activation, Architecture, Kind, M4gn, MacroSpec, MicroSpec, Model, ModelSpec, NodeSums, SegmentMethod,
    SegmentSpec,
};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_structure::Structure;
use m4gn_torch::inference::Inference;
use m4gn_torch::network::{Network, Topology};
use m4gn_torch::samples::HostGraph;
use m4gn_torch::weights::Weights;
use tch::{Device, Tensor};

fn spec(architecture: Architecture, overlap: usize) -> ModelSpec {
    ModelSpec {
        stride: 0.05,
        architecture,
        segments: SegmentSpec { method: SegmentMethod::Metis, count: 6, overlap, ..Default::default() },
        ..m4gn_samples::model::spec()
    }
}

/// What a network lives on.
fn structure(spec: &ModelSpec, mesh: &Mesh) -> Structure {
    let modal = m4gn_modes::Modal::default();
    Structure::new(mesh, spec, &spec.segments, &modal, None, &Comm::serial()).unwrap()
}

fn host(spec: &ModelSpec, mesh: &Mesh) -> HostGraph {
    HostGraph::new(&structure(spec, mesh), spec).unwrap()
}

/// A network with every part in it.
fn whole(width: usize) -> ModelSpec {
    let stage =
        MacroSpec { layers: 2, heads: 4, ffn_width: 48, rwse_steps: 3, centroids: true, offsets: true };
    let kind = Kind::M4gn(M4gn { layers_before: 2, layers_after: 2, segment_transformer: stage });
    spec(network(width, 1, Activation::Relu, kind), 1)
}

fn network(width: usize, hidden_layers: usize, activation: Activation, kind: Kind) -> Architecture {
    Architecture { width, hidden_layers, activation, micro: MicroSpec::default(), kind }
}

fn fields(nodes: i64) -> Tensor {
    (Tensor::arange(nodes * 3, (tch::Kind::Float, Device::Cpu)) * 0.37).sin().view([nodes, 3])
}

/// Outputs and the gradient of their mean square.
fn pass(spec: &ModelSpec, graph: &Topology, half: bool) -> (Tensor, Tensor) {
    let layout = Layout::new(spec);
    let model = Model::random(spec.clone(), 7).unwrap();
    let leaf = Tensor::from_slice(&layout.flatten(&model).unwrap()).set_requires_grad(true);
    let weights = Weights::new(&layout, &leaf, half);
    let network = Network::new(&spec.architecture, &weights);
    let output = network.forward(graph, &fields(graph.nodes), &(&graph.edges * 20.0));
    output.square().mean(tch::Kind::Float).backward();
    (output.detach(), leaf.grad())
}

fn relative(a: &Tensor, b: &Tensor) -> f64 {
    (a - b).norm().double_value(&[]) / b.norm().double_value(&[])
}

#[test]
fn bfloat16_is_near_fp32() {
    for width in [64, 24] {
        let spec = whole(width);
        let graph = host(&spec, &sample::triangles(14, 9, 1.6, 0.41));
        let graph = HostGraph::union(&[&graph], &spec, Device::Cpu);
        let (full, half) = (pass(&spec, &graph, false), pass(&spec, &graph, true));
        assert!(relative(&half.0, &full.0) < 0.03, "outputs, width {width}");
        assert!(relative(&half.1, &full.1) < 0.1, "gradients, width {width}");
    }
}

#[test]
fn a_union_of_graphs_is_its_graphs() {
    let spec = whole(24);
    let hosts =
        [sample::triangles(14, 9, 1.6, 0.41), sample::rectangle(7, 5, 1.0, 0.41)].map(|m| host(&spec, &m));
    let union = HostGraph::union(&[&hosts[0], &hosts[1]], &spec, Device::Cpu);
    let layout = Layout::new(&spec);
    let model = Model::random(spec.clone(), 7).unwrap();
    let flat = Tensor::from_slice(&layout.flatten(&model).unwrap());
    let weights = Weights::new(&layout, &flat, false);
    let network = Network::new(&spec.architecture, &weights);
    let single = hosts.each_ref().map(|h| {
        let graph = HostGraph::union(&[h], &spec, Device::Cpu);
        (network.forward(&graph, &fields(graph.nodes), &graph.edges), graph)
    });
    // Cells of both, then boundary nodes of both.
    let part = |cells: bool, (_, graph): &(Tensor, Topology)| {
        let (first, count) = if cells { (0, graph.cells) } else { (graph.cells, graph.nodes - graph.cells) };
        fields(graph.nodes).narrow(0, first, count)
    };
    let inputs = Tensor::cat(
        &[part(true, &single[0]), part(true, &single[1]), part(false, &single[0]), part(false, &single[1])],
        0,
    );
    let both = network.forward(&union, &inputs, &union.edges);
    let expected = Tensor::cat(&[&single[0].0, &single[1].0], 0);
    assert!(relative(&both, &expected) < 1e-5);
}

/// Largest difference of the two backends, relative to the largest output.
fn difference(spec: &ModelSpec) -> f64 {
    let model = Model::random(spec.clone(), 7).unwrap();
    let comm = Comm::serial();
    let mesh = sample::triangles(14, 9, 1.6, 0.41);
    let structure = structure(spec, &mesh);
    let graph = &structure.graph;
    let inputs: Vec<f32> = (0..graph.n_owned * 3).map(|i| (i as f32 * 0.37).sin()).collect();
    let (mut native, mut torch) = (vec![0f32; graph.n_cells * 3], vec![0f32; graph.n_cells * 3]);
    Engine::new(&model, &structure, &EngineOptions::default())
        .unwrap()
        .forward(&comm, &inputs, &mut native)
        .unwrap();
    Inference::new(&model, &structure, Device::Cpu).unwrap().step(&inputs, &mut torch).unwrap();
    let largest = native.iter().fold(0f32, |m, v| m.max(v.abs()));
    assert!(largest > 1e-3 && largest.is_finite(), "outputs that say nothing: {largest}");
    let worst = native.iter().zip(&torch).fold(0f32, |m, (a, b)| m.max((a - b).abs()));
    (worst / largest) as f64
}

#[test]
fn native_engine_and_tch_model_agree() {
    let stage = |layers, rwse_steps| {
        let geometry = rwse_steps > 0;
        MacroSpec { layers, heads: 4, ffn_width: 48, rwse_steps, centroids: geometry, offsets: geometry }
    };
    let around = |layers_before, layers_after, segment_transformer| M4gn {
        layers_before,
        layers_after,
        segment_transformer,
    };
    let (relu, silu) = (Activation::Relu, Activation::Silu);
    for (kind, activation, hidden_layers, overlap) in [
        (Kind::MeshGraphNet { layers: 3 }, relu, 1, 0),
        (Kind::Gcn { layers: 2 }, silu, 1, 0),
        (Kind::BsmsGnn { levels: 3 }, relu, 2, 0),
        (Kind::BsmsGnn { levels: 9 }, silu, 1, 0),
        (Kind::GUNet { levels: 4 }, silu, 1, 0),
        (Kind::Eagle(around(2, 1, stage(2, 3))), relu, 1, 0),
        (Kind::Eagle(around(1, 2, stage(1, 0))), silu, 2, 2),
        (Kind::M4gn(around(3, 0, stage(2, 0))), relu, 2, 0),
        (Kind::M4gn(around(2, 2, stage(2, 5))), silu, 1, 0),
        (Kind::M4gn(around(2, 1, stage(1, 0))), relu, 1, 2),
    ] {
        let architecture = network(32, hidden_layers, activation, kind);
        let none = MicroSpec::default();
        let [before, walk] =
            [MicroSpec { node_sums: NodeSums::Before, ..none }, MicroSpec { node_rwse_steps: 6, ..none }];
        for micro in [none, before, walk] {
            let mut spec = spec(architecture.clone(), overlap);
            spec.architecture.micro = micro;
            if spec.check().is_err() {
                assert!(!architecture.passes_messages(), "{architecture:?} takes no {micro:?}");
                continue;
            }
            let relative = difference(&spec);
            // fp32 sums in different orders, over a few layers.
            assert!(relative < 1e-5, "{relative:e} for {:?}, overlap {overlap}", spec.architecture);
        }
    }
}
