//! Prints the time of one engine step on a channel of triangles, for the networks that are trained here:
//! `step_time [CELLS [THREADS]]`.

use m4gn::engine::{Engine, EngineOptions, Forward, SegmentView};
use m4gn::graph::Graph;
use m4gn::mesh::{NodeType, sample};
use m4gn::model::{Activation, Architecture, FieldSpec, MacroSpec, Model, ModelSpec, Output, SegmentSpec};
use m4gn::parallel::Comm;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let cells: usize = arguments.next().map_or(Ok(1700), |s| s.parse())?;
    let threads: usize = arguments.next().map_or(Ok(1), |s| s.parse())?;
    let ny = ((cells as f64 / 2.0 * 0.41 / 1.6).sqrt().round() as usize).max(1);
    let mesh = sample::triangles((cells / 2 / ny).max(1), ny, 1.6, 0.41);
    let comm = Comm::serial();
    let graph = Graph::new(&mesh, &comm)?;
    println!(
        "{} nodes, {} edges, {threads} threads",
        graph.n_owned,
        graph.senders.len()
    );
    println!("width hidden layers activation   ms/step  GFLOP/s");
    for (width, hidden_layers, layers) in [(64, 1, 8), (64, 2, 8), (128, 1, 8), (128, 2, 7)] {
        for activation in [Activation::Relu, Activation::Silu] {
            let model = Model::random(spec(width, hidden_layers, layers, activation), 1)?;
            let ms = measure(&model, &graph, &comm, threads)?;
            let rate = work(&graph, width, hidden_layers, layers) / ms / 1e6;
            println!("{width:5} {hidden_layers:6} {layers:6} {activation:>10?} {ms:9.2} {rate:8.0}");
        }
    }
    Ok(())
}

/// Best of several runs, ms.
fn measure(model: &Model, graph: &Graph, comm: &Comm, threads: usize) -> m4gn::Result<f64> {
    const K: usize = 36;
    let member_row: Vec<u32> = (0..=graph.n_owned as u32).collect();
    let member: Vec<i32> = (0..graph.n_owned)
        .map(|i| (i * K / graph.n_owned) as i32)
        .collect();
    let sizes = vec![graph.n_owned as f64 / K as f64; K];
    let view = SegmentView {
        count: K,
        member_row: &member_row,
        member: &member,
        sizes: &sizes,
        position: &[],
        offsets: &[],
    };
    let options = EngineOptions {
        n_threads: threads,
        ..EngineOptions::default()
    };
    let mut engine = Engine::new(model, graph, Some(&view), &options)?;
    let inputs = vec![0.5; graph.n_owned * model.spec.n_field_inputs()];
    let mut outputs = vec![0.0; graph.n_cells * model.spec.n_outputs()];
    let mut best = f64::MAX;
    for _ in 0..30 {
        let start = Instant::now();
        engine.forward(comm, &inputs, &mut outputs)?;
        best = best.min(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(best)
}

/// Floating-point operations of the message passing, which is nearly all.
fn work(graph: &Graph, width: usize, hidden_layers: usize, layers: usize) -> f64 {
    let square = (2 * width * width) as f64;
    let (nodes, edges, h) = (
        graph.n_owned as f64,
        graph.senders.len() as f64,
        hidden_layers as f64,
    );
    layers as f64 * square * (edges * (1.0 + h) + nodes * (2.0 + 2.0 + h))
}

fn spec(width: usize, hidden_layers: usize, layers: usize, activation: Activation) -> ModelSpec {
    let field = |name: &str, vector, output| FieldSpec {
        name: name.into(),
        vector,
        dimensions: [0; 7],
        input: true,
        output,
    };
    ModelSpec {
        format: 1,
        dim: 2,
        stride: 0.01,
        fields: vec![field("U", true, Output::Delta), field("p", false, Output::Value)],
        node_types: NodeType::ALL.to_vec(),
        architecture: Architecture {
            width,
            hidden_layers,
            activation,
            layers_before: layers / 2,
            layers_after: layers - layers / 2,
            segment_transformer: Some(MacroSpec {
                layers: 2,
                heads: 4,
                ffn_width: 2 * width,
                rwse_steps: 0,
                centroids: false,
                offsets: false,
            }),
        },
        segments: SegmentSpec::default(),
        training: serde_json::Value::Null,
    }
}
