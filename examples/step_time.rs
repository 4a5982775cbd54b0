//! Prints the time of one engine step on a channel of triangles, for networks of the sizes that are trained here, and
//! where it goes: `step_time [CELLS [THREADS]]`.

use m4gn_engine::{Engine, EngineOptions, Forward, Phase, Precision, Profile, SegmentView};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{NodeType, sample};
use m4gn_model::{
    Activation, Architecture, FieldSpec, Kind, M4gn, MacroSpec, Model, ModelSpec, Output, SegmentSpec,
};
use m4gn_segments::graph::Graph;
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
    println!(
        "width hidden layers activation precision  ms/step  GFLOP/s  edge blocks: share of time, GFLOP/s a thread"
    );
    for (width, hidden_layers, layers) in [(64, 1, 8), (128, 1, 8), (128, 2, 7), (128, 2, 15)] {
        for activation in [Activation::Relu, Activation::Silu] {
            let model = Model::random(spec(width, hidden_layers, layers, activation), 1)?;
            for precision in [Precision::Fp32, Precision::Bf16] {
                let (ms, profile) = measure(&model, &graph, &comm, threads, precision)?;
                let rate = profile.flops.iter().sum::<f64>() / ms / 1e6;
                let share = profile.phases[Phase::Edges as usize] / profile.phases.iter().sum::<f64>();
                println!(
                    "{width:5} {hidden_layers:6} {layers:6} {activation:>10?} {:>9} {ms:8.2} {rate:8.0} {:10.0} % {:6.0}",
                    precision.name(),
                    100.0 * share,
                    profile.gflops(Phase::Edges),
                );
                if std::env::var_os("PHASES").is_some() {
                    for phase in Phase::ALL {
                        let seconds = profile.phases[phase as usize] / profile.steps as f64;
                        println!(
                            "{:>40} {:7.3} ms {:6.0} GFLOP/s",
                            phase.name(),
                            1e3 * seconds,
                            profile.gflops(phase)
                        );
                    }
                }
            }
        }
    }
    Ok(())
}

/// Best of several runs, ms, and the profile of all.
fn measure(
    model: &Model,
    graph: &Graph,
    comm: &Comm,
    n_threads: usize,
    precision: Precision,
) -> m4gn_mesh::Result<(f64, Profile)> {
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
        n_threads,
        precision,
        profile: true,
        ..EngineOptions::default()
    };
    let mut engine = Engine::new(model, graph, Some(&view), &options)?;
    let inputs = vec![0.5; graph.n_owned * model.spec.n_field_inputs()];
    let mut outputs = vec![0.0; graph.n_cells * model.spec.n_outputs()];
    let mut best = f64::MAX;
    for _ in 0..50 {
        let start = Instant::now();
        engine.forward(comm, &inputs, &mut outputs)?;
        best = best.min(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok((best, engine.profile().unwrap_or_default()))
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
            kind: Kind::M4gn(M4gn {
                layers_before: layers / 2,
                layers_after: layers - layers / 2,
                segment_transformer: MacroSpec {
                    layers: 2,
                    heads: 4,
                    ffn_width: 2 * width,
                    rwse_steps: 0,
                    centroids: false,
                    offsets: false,
                },
            }),
        },
        contact: None,
        resolution: None,
        segments: SegmentSpec::default(),
        trained_on: None,
        calibration: None,
        training: serde_json::Value::Null,
    }
}
