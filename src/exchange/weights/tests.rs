//! Weights there and back, against a network in plain loops.

use super::{Naming, StateDict, model, read, state_dict, write};
use crate::records;
use m4gn_engine::{Engine, EngineOptions, Forward};
use m4gn_mesh::NodeType;
use m4gn_model::modal::NoModes;
use m4gn_model::{Activation, Kind, Model, NodeSums, Tensor};
use m4gn_parallel::Comm;
use m4gn_samples::fails;
use m4gn_structure::Structure;
use m4gn_structure::graph::Graph;

fn mesh_graph_net() -> Model {
    let mut spec = m4gn_samples::model::spec();
    spec.architecture.kind = Kind::MeshGraphNet { layers: 2 };
    spec.architecture.activation = Activation::Silu;
    Model::random(spec, 5).unwrap()
}

/// A layer of PhysicsNeMo's in plain loops, in double precision.
fn perceptron(weights: &StateDict, name: &str, x: &[f64], norm: bool) -> Vec<f64> {
    let tensor = |i: usize, part: &str| &weights[&format!("{name}.model.{i}.{part}")];
    let (mut x, mut i) = (x.to_vec(), 0);
    while let Some(w) = weights.get(&format!("{name}.model.{i}.weight")).filter(|w| w.shape.len() == 2) {
        let rows = w.data.chunks(x.len()).zip(&tensor(i, "bias").data);
        let y =
            rows.map(|(w, b)| f64::from(*b) + w.iter().zip(&x).map(|(w, x)| f64::from(*w) * x).sum::<f64>());
        let y: Vec<f64> = y.collect();
        i += 2;
        let last = weights.get(&format!("{name}.model.{i}.weight")).is_none_or(|w| w.shape.len() != 2);
        x = if last { y } else { y.into_iter().map(|v| v / (1.0 + (-v).exp())).collect() };
    }
    if !norm {
        return x;
    }
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let deviation = (x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n + 1e-5).sqrt();
    let scaled = x.iter().zip(&tensor(i - 1, "weight").data).zip(&tensor(i - 1, "bias").data);
    scaled.map(|((v, g), b)| (v - mean) / deviation * f64::from(*g) + f64::from(*b)).collect()
}

/// PhysicsNeMo's MeshGraphNet written down from its source: node and edge features in, outputs of the first `n` nodes.
fn physicsnemo(
    weights: &StateDict,
    graph: &Graph,
    mut h: Vec<Vec<f64>>,
    mut e: Vec<Vec<f64>>,
    n: usize,
) -> Vec<f64> {
    let encode = |name: &str, rows: &mut Vec<Vec<f64>>| {
        rows.iter_mut().for_each(|x| *x = perceptron(weights, name, x, true));
    };
    encode("node_encoder", &mut h);
    encode("edge_encoder", &mut e);
    let add = |to: &mut [f64], from: &[f64]| to.iter_mut().zip(from).for_each(|(a, b)| *a += b);
    for l in (0..).step_by(2) {
        let name = |i: usize, kind: &str| format!("processor.processor_layers.{i}.{kind}_mlp");
        if !weights.contains_key(&(name(l, "edge") + ".model.0.weight")) {
            break;
        }
        let mut sums = vec![vec![0.0; h[0].len()]; h.len()];
        for ((e, s), r) in e.iter_mut().zip(&graph.senders).zip(&graph.receivers) {
            let (s, r) = (*s as usize, *r as usize);
            let x = [&e[..], &h[s], &h[r]].concat();
            add(e, &perceptron(weights, &name(l, "edge"), &x, true));
            add(&mut sums[r], e);
        }
        for (h, sum) in h.iter_mut().zip(sums) {
            let x = [&sum[..], h].concat();
            add(h, &perceptron(weights, &name(l + 1, "node"), &x, true));
        }
    }
    h.iter().take(n).flat_map(|h| perceptron(weights, "node_decoder", h, false)).collect()
}

#[test]
fn a_converted_network_answers_the_same() {
    let own = mesh_graph_net();
    let order = [NodeType::Outlet, NodeType::Wall, NodeType::Fluid, NodeType::Inlet];
    let theirs = state_dict(&own, Naming::PhysicsNemo, Some(&order)).unwrap();
    assert_eq!(model(theirs.clone(), &own, Some(&order)).unwrap().tensors, own.tensors);
    let (mesh, comm) = (m4gn_samples::mesh::triangles(4, 3, 1.0, 0.7), Comm::serial());
    let structure = Structure::new(&mesh, &own.spec, &own.spec.segments, &NoModes, None, &comm).unwrap();
    let graph = &structure.graph;
    let inputs: Vec<f32> = (0..3 * graph.n_owned).map(|i| (0.7 * i as f32).sin()).collect();
    let normal = |kind: &str, row: &[f32]| -> Vec<f64> {
        let [mean, std] = ["mean", "std"].map(|part| &own.tensors[&format!("norm.{kind}.{part}")].data);
        row.iter().zip(mean).zip(std).map(|((x, m), s)| f64::from((x - m) / s)).collect()
    };
    let types = graph.node_types.iter().map(|code| order.map(|t| f64::from(u8::from(t as i32 == *code))));
    let nodes = inputs.chunks(3).zip(types).map(|(x, t)| [&normal("node", x)[..], &t].concat()).collect();
    let edges = graph.edge_features.chunks(3).map(|x| normal("edge", x)).collect();
    let [mean, std] = ["norm.output.mean", "norm.output.std"].map(|name| &own.tensors[name].data);
    let raw = physicsnemo(&theirs, graph, nodes, edges, graph.n_cells);
    let expected = raw.iter().enumerate().map(|(i, y)| y * f64::from(std[i % 3]) + f64::from(mean[i % 3]));
    let mut found = vec![0f32; raw.len()];
    Engine::new(&own, &structure, &EngineOptions::default())
        .unwrap()
        .forward(&comm, &inputs, &mut found)
        .unwrap();
    let largest = found.iter().fold(0f32, |m, v| m.max(v.abs()));
    for (found, expected) in found.iter().zip(expected) {
        assert!((f64::from(*found) - expected).abs() < 1e-5 * f64::from(largest), "{found} {expected}");
    }
}

#[test]
fn there_and_back_is_the_same_model() {
    let folder = tempfile::tempdir().unwrap();
    let own = mesh_graph_net();
    for naming in [Naming::Own, Naming::PhysicsNemo] {
        let path = folder.path().join("w.safetensors");
        write(&state_dict(&own, naming, None).unwrap(), &path).unwrap();
        let mut like = own.clone();
        like.spec.architecture.width = 8;
        let back = model(read(&path).unwrap(), &like, None).unwrap();
        assert_eq!(back.tensors, own.tensors);
        assert_eq!(back.spec.architecture, own.spec.architecture);
    }
}

#[test]
fn weights_that_do_not_fit_are_named() {
    let own = mesh_graph_net();
    let good = state_dict(&own, Naming::PhysicsNemo, None).unwrap();
    type Change = fn(&mut StateDict);
    let changes: [(&str, Change); 6] = [
        ("'edge_encoder.model.2.bias' is missing", |t| drop(t.remove("edge_encoder.model.2.bias"))),
        ("'extra' is not part", |t| drop(t.insert("extra".into(), Tensor { shape: vec![0], data: vec![] }))),
        ("'encoder.edge.0.weight': expected [8, 3]", |t| {
            t.get_mut("edge_encoder.model.0.weight").unwrap().shape = vec![3, 8]
        }),
        ("do_concat_trick", |t| {
            drop(t.insert("a.edge_mlp.lin_src".into(), Tensor { shape: vec![0], data: vec![] }))
        }),
        ("a layer 99999999999 and ", |t| {
            let name = "processor.processor_layers.99999999999.edge_mlp.model.0.weight";
            drop(t.insert(name.into(), Tensor { shape: vec![0], data: vec![] }))
        }),
        ("a layer 99999999998 and ", |t| {
            let name = "node_decoder.model.99999999998.weight";
            drop(t.insert(name.into(), Tensor { shape: vec![0], data: vec![] }))
        }),
    ];
    for (expected, change) in changes {
        let mut tensors = good.clone();
        change(&mut tensors);
        fails(model(tensors, &own, None), &[expected]);
    }
    let mut before = own.clone();
    before.spec.architecture.micro.node_sums = NodeSums::Before;
    for refused in [
        model(good.clone(), &before, None),
        state_dict(&before, Naming::PhysicsNemo, None).map(|_| own.clone()),
    ] {
        fails(refused, &["node_sums"]);
    }
    let types = Some(&[NodeType::Wall, NodeType::Wall][..]);
    fails(model(good, &own, types), &["each of the model's node types once"]);
}

#[test]
fn what_torch_saves_is_read_and_nothing_of_it_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.pt");
    let own = mesh_graph_net();
    let theirs = state_dict(&own, Naming::PhysicsNemo, None).unwrap();
    let list = |prefix: &str| -> Vec<(String, Vec<usize>, Vec<f32>)> {
        theirs.iter().map(|(name, t)| (format!("{prefix}{name}"), t.shape.clone(), t.data.clone())).collect()
    };
    for prefix in ["", "module."] {
        let all = list(prefix);
        let all: Vec<_> = all.iter().map(|t| (&t.0[..], t.1.clone(), t.2.clone())).collect();
        std::fs::write(&path, records::zip(&records::state_dict(&all))).unwrap();
        assert_eq!(model(read(&path).unwrap(), &own, None).unwrap().tensors, own.tensors);
    }
    // A view of a column, and one beyond its storage.
    let saved = |pickle: &[u8]| {
        let files = [("a/data.pkl".to_string(), pickle.to_vec()), ("a/data/0".into(), vec![0; 24])];
        std::fs::write(&path, records::zip(&files)).unwrap();
        read(&path)
    };
    let head = b"\x80\x02}(X\x01\0\0\0wctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x06tQ";
    let tail = b"\x89}tRu.";
    let view = |numbers: &[u8]| saved(&[&head[..], numbers, tail].concat());
    assert_eq!(view(b"K\x01K\x03\x85K\x02\x85").unwrap()["w"], Tensor { shape: vec![3], data: vec![0.0; 3] });
    for (pickle, expected) in [
        (view(b"K\x02K\x03\x85K\x02\x85"), "tensor 'w': shape [3], strides [2] at 2 of 6 numbers"),
        (view(b"K\x00J\xff\xff\xff\x7f\x85K\x00\x85"), "tensor 'w': shape [2147483647]"),
        (
            saved(b"\x80\x02cposix\nsystem\nX\x02\0\0\0ls\x85R."),
            "its byte 24: it calls posix.system, which is not run",
        ),
        (saved(b"\x80\x02}."), "holds no tensors"),
        (saved(b"\x80\x02(((("), "its byte 6: 1 bytes needed, the pickle ends before"),
        (saved(b"\x80\x02\xff"), "its byte 2: pickle's operation 0xff"),
    ] {
        fails(pickle, &[expected]);
    }
}

/// However deep tuples are in each other, the file is read or refused.
#[test]
fn tuples_in_each_other_are_refused_beyond_what_weights_need() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.pt");
    let nested = |codes: &[&[u8]]| {
        let pickle = [&[&b"\x80\x02"[..]], codes, &[b"."]].concat().concat();
        std::fs::write(&path, records::zip(&[("w/data.pkl".to_string(), pickle)])).unwrap();
        read(&path).unwrap_err().to_string()
    };
    let deep = 1_000_000;
    for codes in [
        [&b")"[..], &b"\x85".repeat(deep)],
        [&b")".repeat(2 * deep), &b"\x86".repeat(deep)],
        // Marks, and the tuples that they begin
        [&b"(".repeat(deep), &b"t".repeat(deep)],
        // Each tuple kept under a number as well
        [&b")"[..], &b"\x85\x94".repeat(deep)],
    ] {
        let message = nested(&codes);
        assert!(message.contains("more than 32 tuples in each other"), "{message}");
    }
    assert!(nested(&[b")", &b"\x85".repeat(20)]).contains("holds no dict"));
}
