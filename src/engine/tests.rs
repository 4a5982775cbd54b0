//! The engine against the plain network, in every instruction set that this processor has.

use super::*;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::modal::NoModes;
use m4gn_model::{Activation, Kind, M4gn, MacroSpec, ModelSpec, NodeSums, Output, WorldEdges};
use m4gn_samples::mesh as sample;
use m4gn_samples::model::{bodies_of_other_kinds, spec};
use m4gn_structure::Segmentation;

const K: usize = 5;

/// Segments of a graph, with nodes of two segments where there is overlap.
pub(super) fn segments(spec: &ModelSpec, graph: &Graph, overlap: bool) -> Segmentation {
    let (mut member_row, mut member) = (vec![0u32], Vec::new());
    for i in 0..graph.n_owned {
        let own = i * K / graph.n_owned;
        member.push(own as i32);
        if overlap && i % 3 == 0 {
            member.push(((own + 2) % K) as i32);
        }
        member_row.push(member.len() as u32);
    }
    let wave = |n: usize, step: f32| -> Vec<f32> { (0..n).map(|i| (i as f32 * step).fract()).collect() };
    Segmentation {
        position: wave(K * spec.n_position_features(), 0.37),
        offsets: wave(graph.n_owned * spec.n_offset_features(), 0.73),
        ..Segmentation::of_members(K, member_row, member)
    }
}

/// A small mesh in the directions of a model.
pub(super) fn mesh(spec: &ModelSpec, n: [usize; 3]) -> Mesh {
    match spec.dim {
        3 => sample::block([n[0] - 3, n[1] - 2, n[2]], [1.0, 0.8, 0.6]),
        _ => sample::triangles(n[0], n[1], 1.6, 0.41),
    }
}

/// The small network of bodies with encoders of its own for world edges.
pub(super) fn apart() -> ModelSpec {
    let mut s = m4gn_samples::model::bodies();
    s.architecture.micro.world_edges = WorldEdges::Apart;
    s
}

/// Makes points of a body of the nodes, and world edges of those edges that point along x: features by the edges' vectors.
fn touch(spec: &ModelSpec, graph: &mut Graph) {
    if spec.contact.is_none() {
        return;
    }
    graph.node_types.fill(NodeType::Body as i32);
    widen(graph, 0.01);
}

/// Features of a body's edges by the edges' vectors: of a world edge where these point along x by more than that.
fn widen(graph: &mut Graph, world: f32) {
    let features = graph.edge_features.chunks(4).flat_map(|x| {
        let is_world = if x[0] > world { 1.0 } else { 0.0 };
        (0..12).map(|i| x[i % 4] + 0.1 * i as f32).chain([is_world]).collect::<Vec<_>>()
    });
    graph.edge_features = features.collect();
}

/// What a model lives on, with segments that no mesh has.
pub(super) fn structure(spec: &ModelSpec, mesh: &Mesh, overlap: bool) -> Structure {
    let mut bare = spec.clone();
    if spec.architecture.needs().segments {
        bare.architecture.kind = Kind::MeshGraphNet { layers: 1 };
    }
    let mut made = Structure::new(mesh, &bare, &spec.segments, &NoModes, None, &Comm::serial()).unwrap();
    touch(spec, &mut made.graph);
    if spec.contact.is_some() {
        made.levels.iter_mut().for_each(|level| widen(&mut level.graph, f32::MAX));
    }
    let stage = spec.architecture.needs().segments.then(|| segments(spec, &made.graph, overlap));
    let needs = spec.architecture.needs();
    let sequence = Structure::sequence_of(stage.as_ref(), needs, mesh, &Comm::serial()).unwrap();
    Structure { segments: stage, sequence, ..made }
}

/// A model on a channel of triangles.
struct Case {
    model: Model,
    structure: Structure,
    inputs: Vec<f32>,
}

impl Case {
    fn new(spec: ModelSpec, overlap: bool) -> Self {
        let structure = structure(&spec, &mesh(&spec, [9, 7, 3]), overlap);
        let n = structure.graph.n_owned * spec.n_field_inputs();
        Case {
            structure,
            model: Model::random(spec, 5).unwrap(),
            inputs: (0..n).map(|i| (i as f32 * 0.7).sin()).collect(),
        }
    }

    fn plain(&self) -> Vec<f64> {
        let expected = plain::forward(&self.model, &self.structure, &self.inputs);
        let largest = expected.iter().fold(0f64, |m, v| m.max(v.abs()));
        let least = expected.iter().fold(f64::MAX, |m, v| m.min(*v));
        assert!(largest - least > 1e-2 * largest, "the network gives the same everywhere: nothing is tested");
        expected
    }

    fn run(&self, options: &EngineOptions, keep_encoded: usize) -> Vec<f32> {
        let mut engine = Engine::with_limit(&self.model, &self.structure, options, keep_encoded).unwrap();
        let mut outputs = vec![0f32; self.structure.graph.n_cells * self.model.spec.n_outputs()];
        // Twice: nothing of the first step may leak into the second.
        for _ in 0..2 {
            outputs.fill(f32::NAN);
            engine.forward(&Comm::serial(), &self.inputs, &mut outputs).unwrap();
        }
        outputs
    }
}

/// Largest difference, relative to the largest value.
fn difference(found: &[f32], expected: &[f64]) -> f64 {
    let largest = expected.iter().fold(0f64, |m, v| m.max(v.abs()));
    let pairs = found.iter().zip(expected);
    pairs.fold(0f64, |m, (a, b)| m.max((f64::from(*a) - b).abs())) / largest
}

fn options(isa: Isa, precision: Precision) -> EngineOptions {
    EngineOptions { isa: Some(isa), precision, ..EngineOptions::default() }
}

pub(super) fn instruction_sets() -> Vec<Isa> {
    let available = Isa::available();
    for name in ["avx2", "avx512", "avx512-bf16", "amx"] {
        if !available.iter().any(|isa| isa.name() == name) {
            println!("{name}: not tested, this processor does not have it");
        }
    }
    available
}

fn m4gn(s: &mut ModelSpec) -> &mut M4gn {
    s.architecture.m4gn_mut().unwrap()
}

/// Networks of all kinds, and each switch with the others as they are in the first; whether segments overlap.
pub(super) fn networks() -> Vec<(String, ModelSpec, bool)> {
    let mut all = Vec::new();
    let mut add = |name: &str, overlap: bool, change: &dyn Fn(&mut ModelSpec)| {
        let mut s = spec();
        change(&mut s);
        all.push((name.to_string(), s, overlap));
    };
    add("small", false, &|_| ());
    add("overlap", true, &|_| ());
    for hidden in [2, 3] {
        add("hidden layers", true, &|s| s.architecture.hidden_layers = hidden);
    }
    for hidden in [1, 2] {
        add("silu", true, &|s| {
            s.architecture.activation = Activation::Silu;
            s.architecture.hidden_layers = hidden;
        });
    }
    for (width, heads) in [(20, 4), (64, 4), (81, 3)] {
        add("width", false, &|s| {
            s.architecture.width = width;
            let m = &mut m4gn(s).segment_transformer;
            (m.heads, m.layers, m.ffn_width) = (heads, 2, 24);
        });
    }
    add("paper's order", false, &|s| m4gn(s).layers_after = 0);
    add("all layers after", true, &|s| {
        (m4gn(s).layers_before, m4gn(s).layers_after) = (0, 2);
    });
    add("no encodings", false, &|s| {
        let m = &mut m4gn(s).segment_transformer;
        (m.rwse_steps, m.centroids, m.offsets) = (0, false, false);
    });
    add("no transformer layers", false, &|s| {
        let m = &mut m4gn(s).segment_transformer;
        (m.layers, m.heads) = (1, 1);
    });
    add("mesh-graph-net", false, &|s| {
        s.architecture.kind = Kind::MeshGraphNet { layers: 2 };
    });
    let (whole, alone) = (spec().architecture.kind, |layers| Kind::MeshGraphNet { layers });
    for (kind, width, overlap) in [
        (alone(1), 8, false),
        (alone(3), 8, false),
        (alone(2), 81, false),
        (whole.clone(), 8, false),
        (whole.clone(), 8, true),
    ] {
        add("node sums before", overlap, &|s| {
            s.architecture.micro.node_sums = NodeSums::Before;
            (s.architecture.kind, s.architecture.width) = (kind.clone(), width);
        });
    }
    for (layers, width) in [(1, 8), (3, 8), (3, 81)] {
        add("gcn", false, &|s| {
            (s.architecture.kind, s.architecture.width) = (Kind::Gcn { layers }, width);
        });
    }
    for (levels, width, hidden) in [(1, 8, 1), (1, 8, 2), (3, 20, 1), (6, 8, 1), (9, 81, 1)] {
        add("bsms-gnn", false, &|s| {
            (s.architecture.kind, s.architecture.width) = (Kind::BsmsGnn { levels }, width);
            s.architecture.hidden_layers = hidden;
        });
    }
    for (width, heads, overlap) in [(8, 1, false), (8, 4, false), (20, 4, true), (81, 1, true)] {
        add("eagle", overlap, &|s| {
            m4gn(s).segment_transformer.heads = heads;
            (s.architecture.kind, s.architecture.width) = (Kind::Eagle(m4gn(s).clone()), width);
        });
    }
    for (levels, width, hidden) in [(1, 8, 1), (1, 8, 2), (3, 20, 1), (4, 20, 1)] {
        add("g-u-net", false, &|s| {
            (s.architecture.kind, s.architecture.width) = (Kind::GUNet { levels }, width);
            s.architecture.hidden_layers = hidden;
        });
    }
    for (kind, width, hidden, overlap) in [
        (whole.clone(), 8, 1, false),
        (whole.clone(), 8, 1, true),
        (Kind::Gcn { layers: 2 }, 8, 2, false),
        (alone(2), 81, 1, false),
    ] {
        add("node positions", overlap, &|s| {
            s.architecture.micro.node_rwse_steps = 6;
            (s.architecture.kind, s.architecture.width) = (kind.clone(), width);
            s.architecture.hidden_layers = hidden;
        });
    }
    for other in bodies_of_other_kinds() {
        add("bodies", false, &|s| *s = other.clone());
    }
    for (sums, width, overlap) in [
        (NodeSums::After, 8, false),
        (NodeSums::After, 8, true),
        (NodeSums::Before, 8, false),
        (NodeSums::Before, 81, false),
    ] {
        add("world edges apart", overlap, &|s| {
            *s = apart();
            s.architecture.micro.node_sums = sums;
            if width == 81 {
                (s.architecture.kind, s.architecture.width) = (alone(2), width);
            }
        });
    }
    add("values", false, &|s| {
        s.fields[0].output = Output::Value;
        s.fields[1].output = Output::None;
    });
    add("what is given and what is predicted", false, &|s| {
        (s.fields[0].input, s.fields[0].output) = (false, Output::Value);
    });
    all
}

/// Each entry of the lists with each, and networks of all kinds.
fn specs() -> Vec<(ModelSpec, bool)> {
    let mut all: Vec<(ModelSpec, bool)> =
        networks().into_iter().map(|(_, s, overlap)| (s, overlap)).collect();
    // A few units of eight bits say little about its gradient
    let mut deep = spec();
    (deep.architecture.width, deep.architecture.hidden_layers) = (20, 2);
    deep.architecture.kind = Kind::BsmsGnn { levels: 3 };
    all.push((deep, false));
    for hidden_layers in [1, 2, 3] {
        for activation in [Activation::Relu, Activation::Silu] {
            for (layers_after, width) in [(0, 8), (1, 20), (2, 64), (0, 128), (1, 81)] {
                let mut s = spec();
                s.architecture.width = width;
                s.architecture.hidden_layers = hidden_layers;
                s.architecture.activation = activation;
                let rwse_steps = if width == 64 { 5 } else { 0 };
                let m4gn = s.architecture.m4gn_mut().unwrap();
                m4gn.layers_after = layers_after;
                m4gn.segment_transformer = MacroSpec {
                    layers: 2,
                    heads: if width == 81 { 3 } else { 4 },
                    ffn_width: 24,
                    rwse_steps,
                    centroids: layers_after == 1,
                    offsets: layers_after > 0,
                };
                all.push((s, layers_after > 0));
            }
        }
    }
    all
}

#[test]
fn fp32_is_the_plain_network_to_rounding() {
    // fp32 sums of up to 128 terms through about 20 layers: measured 1e-7 to 2e-6.
    let mut worst = 0f64;
    for (spec, overlap) in specs() {
        let case = Case::new(spec, overlap);
        let expected = case.plain();
        for isa in instruction_sets() {
            let found = case.run(&options(isa, Precision::Fp32), usize::MAX);
            let error = difference(&found, &expected);
            worst = worst.max(error);
            let shape = &case.model.spec.architecture;
            assert!(error < 1e-5, "{}: {error:e} with {shape:?}", isa.name());
        }
    }
    println!("worst {worst:e}");
}

#[test]
fn bf16_is_the_plain_network_to_its_rounding_on_every_instruction_set() {
    // A bf16 is good to 4e-3; random networks keep the size of what goes through them.
    let (mut worst, mut apart) = (0f64, 0f64);
    for (spec, overlap) in specs() {
        if spec.architecture.needs().whole {
            let message = Engine::new(
                &Model::random(spec.clone(), 5).unwrap(),
                &structure(&spec, &mesh(&spec, [9, 7, 3]), false),
                &options(Isa::detect(), Precision::Bf16),
            )
            .err()
            .unwrap()
            .to_string();
            assert!(message.contains("g-u-net") && message.contains("fp32"), "{message}");
            continue;
        }
        let case = Case::new(spec, overlap);
        let expected = case.plain();
        let portable = case.run(&options(Isa::portable(), Precision::Bf16), usize::MAX);
        let reference: Vec<f64> = portable.iter().map(|&v| f64::from(v)).collect();
        for isa in instruction_sets() {
            let found = case.run(&options(isa, Precision::Bf16), usize::MAX);
            let shape = &case.model.spec.architecture;
            let error = difference(&found, &expected);
            worst = worst.max(error);
            assert!(error < 0.06, "{}: {error:e} with {shape:?}", isa.name());
            // The instruction sets round the same numbers; where sums differ in the last place, few round apart.
            let error = difference(&found, &reference);
            apart = apart.max(error);
            assert!(error < 0.02, "{} from portable: {error:e} with {shape:?}", isa.name());
        }
    }
    println!("worst {worst:e}, apart {apart:e}");
}

#[test]
fn threads_and_the_place_of_encoded_edges_do_not_change_a_bit() {
    for (spec, overlap) in specs().into_iter().step_by(7) {
        let case = Case::new(spec, overlap);
        for precision in [Precision::Fp32, Precision::Bf16] {
            if check_precision(&case.model.spec, precision).is_err() {
                continue;
            }
            let one = options(Isa::detect(), precision);
            let expected = case.run(&one, usize::MAX);
            assert_eq!(case.run(&one, 0), expected);
            for n_threads in [2, 3] {
                assert_eq!(case.run(&EngineOptions { n_threads, ..one }, usize::MAX), expected);
            }
        }
    }
}

#[test]
fn a_profile_adds_up() {
    let case = Case::new(spec(), true);
    let options = EngineOptions { profile: true, ..options(Isa::detect(), Precision::Bf16) };
    let mut engine = Engine::new(&case.model, &case.structure, &options).unwrap();
    let mut outputs = vec![0f32; case.structure.graph.n_cells * case.model.spec.n_outputs()];
    for _ in 0..3 {
        engine.forward(&Comm::serial(), &case.inputs, &mut outputs).unwrap();
    }
    let profile = engine.profile().unwrap();
    assert_eq!(profile.steps, 3);
    let sum: f64 = profile.phases.iter().sum();
    assert!(sum > 0.0 && sum <= profile.seconds, "{profile:?}");
    let (graph, a) = (&case.structure.graph, &case.model.spec.architecture);
    let rows = graph.senders.len() * (1 + a.hidden_layers) + graph.n_owned;
    let flops = (a.layers() * rows * 2 * a.width * a.width) as f64;
    assert_eq!(profile.flops[Phase::Edges as usize], flops);
}

#[test]
fn graphs_and_lengths_that_do_not_fit_are_refused() {
    let mut case = Case::new(spec(), false);
    let options = EngineOptions::default();
    let mut engine = Engine::new(&case.model, &case.structure, &options).unwrap();
    assert!(matches!(engine.forward(&Comm::serial(), &case.inputs[1..], &mut []), Err(Error::Input(_))));
    let bare = Structure { segments: None, ..case.structure.clone() };
    assert!(matches!(Engine::new(&case.model, &bare, &options), Err(Error::Model(_))));
    case.structure.graph.senders[0] = case.structure.graph.n_local as i32;
    assert!(matches!(Engine::new(&case.model, &case.structure, &options), Err(Error::Internal(_))));
    case.structure.graph.edge_features.pop();
    assert!(matches!(Engine::new(&case.model, &case.structure, &options), Err(Error::Model(_))));
}

#[test]
fn another_numbering_of_the_cells_gives_the_same_to_rounding() {
    let (flow, m4gn) = (spec(), spec().architecture.m4gn().unwrap().clone());
    let with = |kind: Kind| {
        let mut s = flow.clone();
        s.architecture.kind = kind;
        s
    };
    let mut before = flow.clone();
    before.architecture.micro.node_sums = NodeSums::Before;
    let mut walk = flow.clone();
    walk.architecture.micro.node_rwse_steps = 6;
    for spec in [
        with(Kind::MeshGraphNet { layers: 2 }),
        walk,
        with(Kind::Gcn { layers: 2 }),
        with(Kind::BsmsGnn { levels: 5 }),
        with(Kind::GUNet { levels: 3 }),
        with(Kind::Eagle(m4gn)),
        flow,
        before,
        apart(),
    ] {
        renumber(spec);
    }
}

fn renumber(mut s: ModelSpec) {
    let mesh = mesh(&s, [9, 7, 3]);
    let n = mesh.n_cells();
    let (other, [cells, faces]) = sample::renumbered(&mesh, 5);
    s.segments.count = K;
    let labels: Vec<i32> = (0..n).map(|cell| (cell * K / n) as i32).collect();
    let moved: Vec<i32> = cells.iter().map(|&cell| labels[cell]).collect();
    let cut = |mesh: &Mesh, labels: &[i32]| {
        let mut made =
            Structure::new(mesh, &s, &s.segments, &NoModes, Some(labels), &Comm::serial()).unwrap();
        touch(&s, &mut made.graph);
        made
    };
    let mut case = Case { structure: cut(&mesh, &labels), ..Case::new(s.clone(), false) };
    let options = options(Isa::detect(), Precision::Fp32);
    let expected = case.run(&options, usize::MAX);
    let (k, m) = (s.n_field_inputs(), s.n_outputs());
    let nodes = cells.iter().copied().chain(faces.iter().map(|face| n + face));
    case.inputs = nodes.flat_map(|node| case.inputs[node * k..][..k].to_vec()).collect();
    case.structure = cut(&other, &moved);
    let found = case.run(&options, usize::MAX);
    let expected: Vec<f64> = cells.iter().flat_map(|&c| &expected[c * m..][..m]).map(|&y| y.into()).collect();
    let error = difference(&found, &expected);
    assert!(error < 1e-5, "{error:e} of {:?}", s.architecture);
}
