//! `m4gn bench`: what a step of a network costs on this machine.

use crate::bench::{self, Runs, Segments, Shape, Timing, machine, memory, memory::Memory, work};
use crate::dataset::Trajectory;
use crate::engine::torch::TorchBackend;
use crate::engine::{Engine, EngineOptions, Forward, Precision};
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::model::Model;
use crate::parallel::Comm;
use crate::step::Backend;
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};
use safetensors::{Dtype, tensor::TensorView};
use serde_json::{Value, json};
use std::io::{BufRead, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Measure a step of a network: time, work, memory, and what part of the machine's peak that is
///
/// Without --model, a network with random weights; without --data, a made graph: an O-mesh of triangles with the
/// points as nodes, or with --hex a cube of hexahedra with the cells as nodes. The peaks of matrix products and of
/// the memory are measured in the same run.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Model (*.safetensors) [default: random weights of the shape below]
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Take the mesh of this trajectory (*.h5)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["nodes", "hex"])]
    data: Option<PathBuf>,
    /// Size of the made graph: points, or cells with --hex
    #[arg(long, value_name = "N", default_value_t = 1900)]
    nodes: usize,
    /// A cube of hexahedra, in three dimensions
    #[arg(long)]
    hex: bool,
    /// Message-passing layers
    #[arg(long, value_name = "L", default_value_t = 7, conflicts_with = "model")]
    layers: usize,
    /// Latent width
    #[arg(long, value_name = "W", default_value_t = 128, conflicts_with = "model")]
    width: usize,
    /// Hidden layers of each perceptron
    #[arg(long, value_name = "H", default_value_t = 2, conflicts_with = "model")]
    hidden: usize,
    /// Add the paper's segment transformer, with this many segments (the paper's is 36)
    #[arg(long, value_name = "K", conflicts_with = "model")]
    segments: Option<usize>,
    /// Threads
    #[arg(long, value_name = "T", default_value_t = 1)]
    threads: usize,
    /// fp32 or bf16
    #[arg(long, value_name = "P", default_value = "fp32")]
    precision: String,
    /// What runs the network: native, torch, torch:DEVICE
    #[arg(long, default_value = "native")]
    backend: String,
    /// Steps to time [default: as many as fit into 4 s, at least five]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write model.safetensors and graph.safetensors with inputs and outputs to this folder, for other programs
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Serve another program: a line with a description, then for each line 'run' on standard input the ms of a step
    #[arg(long, conflicts_with_all = ["json", "export", "steps"])]
    worker: bool,
}

/// Time of the measurement where the number of steps is not given.
const SECONDS: Duration = Duration::from_secs(4);

/// Most threads.
const MAX_THREADS: usize = 1024;

/// A network and a graph to run it on.
struct Workload {
    model: Model,
    /// File of the model, where it has one.
    path: Option<PathBuf>,
    mesh: Option<Mesh>,
    nodes: usize,
    comm: Comm,
}

/// A graph with its segments.
struct Case {
    graph: Graph,
    segments: Option<Segments>,
}

/// Runs the command.
///
/// # Errors
/// For options that do not go together, a model that does not fit the mesh, or a file that cannot be read or written.
pub fn run(args: Args) -> Result<()> {
    if !(1..=MAX_THREADS).contains(&args.threads) {
        return Err(Error::Input(format!(
            "--threads {}: expected 1 to {MAX_THREADS}",
            args.threads
        )));
    }
    if args.steps == Some(0) {
        return Err(Error::Input("--steps 0: expected a positive number".into()));
    }
    let options = EngineOptions {
        n_threads: args.threads,
        precision: Precision::parse(&args.precision)?,
        ..EngineOptions::default()
    };
    let backend = Backend::parse(&args.backend)?;
    let workload = Workload::new(&args)?;
    if let Some(folder) = &args.export {
        return export(&workload, folder);
    }
    let backend = match &backend {
        Backend::Native => None,
        Backend::Torch(device) => Some(device.as_deref()),
    };
    match (args.worker, backend) {
        (true, None) => serve(&workload, |case| workload.native(case, &options)),
        (true, Some(device)) => serve(&workload, |case| workload.torch(case, device, args.threads)),
        (false, None) => measure(&workload, &args, &options),
        (false, Some(device)) => measure_torch(&workload, &args, device),
    }
}

impl Workload {
    fn new(args: &Args) -> Result<Self> {
        let comm = Comm::serial();
        let mesh = match (&args.data, args.hex) {
            (Some(path), _) => Some(Trajectory::open(path)?.mesh().clone()),
            (None, true) => Some(bench::hexahedra(args.nodes)?),
            (None, false) => None,
        };
        let model = match &args.model {
            Some(path) => Model::read(path)?,
            None => {
                let shape = Shape {
                    dim: mesh.as_ref().map_or(2, Mesh::dim),
                    layers: args.layers,
                    width: args.width,
                    hidden_layers: args.hidden,
                    segments: args.segments,
                };
                Model::random(shape.spec(), 1)?
            }
        };
        Ok(Workload {
            model,
            path: args.model.clone(),
            mesh,
            nodes: args.nodes,
            comm,
        })
    }

    fn case(&self) -> Result<Case> {
        let spec = &self.model.spec;
        let Some(mesh) = &self.mesh else {
            let graph = bench::o_mesh(self.nodes, &self.comm)?;
            let segments = Segments::consecutive(spec, graph.n_owned)?;
            return Ok(Case { graph, segments });
        };
        let mut graph = Graph::new(mesh, &self.comm)?;
        let segments = Segments::of_mesh(spec, mesh, &mut graph, &self.comm)?;
        Ok(Case { graph, segments })
    }

    fn native(&self, case: &Case, options: &EngineOptions) -> Result<Box<dyn Forward>> {
        let view = case.segments.as_ref().map(Segments::view);
        Ok(Box::new(Engine::new(
            &self.model,
            &case.graph,
            view.as_ref(),
            options,
        )?))
    }

    /// The model on libtorch, which takes its number of threads from the environment when it is loaded.
    fn torch(&self, case: &Case, device: Option<&str>, threads: usize) -> Result<Box<dyn Forward>> {
        if std::env::var("OMP_NUM_THREADS").ok().as_deref() != Some(&threads.to_string()) {
            return Err(Error::Input(format!(
                "backend torch takes its threads from the environment: set OMP_NUM_THREADS={threads}"
            )));
        }
        let view = case.segments.as_ref().map(Segments::view);
        let lengths = self.lengths(&case.graph);
        let folder = tempfile::tempdir().map_err(|e| Error::file("temporary folder", e.to_string()))?;
        let path = match &self.path {
            Some(path) => path.clone(),
            None => {
                let path = folder.path().join("model.safetensors");
                self.model.write(&path)?;
                path
            }
        };
        let made = TorchBackend::new(&path, &case.graph, view.as_ref(), lengths, device, &self.comm)?;
        Ok(Box::new(made))
    }

    /// Lengths of the inputs and the outputs of a step.
    fn lengths(&self, graph: &Graph) -> (usize, usize) {
        let spec = &self.model.spec;
        (
            graph.n_owned * spec.n_field_inputs(),
            graph.n_cells * spec.n_outputs(),
        )
    }

    /// Physical inputs of the size that the model was trained on.
    fn inputs(&self, graph: &Graph) -> Result<Vec<f32>> {
        let mean = &self.model.tensor("norm.node.mean")?.data;
        let std = &self.model.tensor("norm.node.std")?.data;
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(2);
        let (n, k) = (self.lengths(graph).0, mean.len().max(1));
        Ok((0..n)
            .map(|i| mean[i % k] + std[i % k] * rng.random_range(-1.7f32..1.7))
            .collect())
    }

    fn parameters(&self) -> usize {
        let weights = self
            .model
            .tensors
            .iter()
            .filter(|(name, _)| !name.starts_with("norm."));
        weights.map(|(_, t)| t.data.len()).sum()
    }

    fn describe(&self, graph: &Graph) -> Value {
        let a = &self.model.spec.architecture;
        json!({
            "nodes": graph.n_owned, "cells": graph.n_cells, "edges": graph.senders.len(),
            "parameters": self.parameters(), "width": a.width, "hidden_layers": a.hidden_layers,
            "layers": a.layers_before + a.layers_after,
        })
    }
}

/// Everything about the native engine.
fn measure(workload: &Workload, args: &Args, options: &EngineOptions) -> Result<()> {
    let spec = &workload.model.spec;
    let before = Memory::read();
    memory::restart_peak();
    let case = workload.case()?;
    let sizes = work::Sizes {
        nodes: case.graph.n_owned,
        cells: case.graph.n_cells,
        edges: case.graph.senders.len(),
        segments: case.segments.as_ref().map_or(0, Segments::count),
    };
    let description = workload.describe(&case.graph);
    let (inputs, mut outputs) = (
        workload.inputs(&case.graph)?,
        vec![0.0; workload.lengths(&case.graph).1],
    );
    let mut network = workload.native(&case, options)?;
    // A session keeps no graph beside its network.
    drop(case);
    network.forward(&workload.comm, &inputs, &mut outputs)?;
    let after = Memory::read();

    let case = workload.case()?;
    let thin = Case {
        graph: bench::thinned(&case.graph),
        segments: case.segments,
    };
    let thin_edges = thin.graph.senders.len();
    let mut thin_network = workload.native(&thin, options)?;
    let mut thin_outputs = outputs.clone();
    drop((thin, case.graph));
    let mut peak = machine::Peak::new(options)?;
    let runs = args.steps.map_or(Runs::For(SECONDS), Runs::Exactly);
    let timings = bench::alternate(
        runs,
        &mut [
            &mut || network.forward(&workload.comm, &inputs, &mut outputs),
            &mut || thin_network.forward(&workload.comm, &inputs, &mut thin_outputs),
            &mut || peak.probe(),
        ],
    )?;
    drop((network, thin_network));
    let bandwidth = machine::bandwidth(args.threads, 10);

    let phases = work::phases(spec, sizes, storage(options.precision));
    let flops: f64 = phases.iter().map(|p| p.flops).sum();
    let bytes: f64 = phases.iter().map(|p| p.bytes).sum();
    let step = &timings[0];
    let seconds = step.median() * 1e-3;
    let layers = spec.architecture.layers_before + spec.architecture.layers_after;
    // What the edges beyond one a node cost, for all of them.
    let edge_seconds = (seconds - timings[1].median() * 1e-3) / (sizes.edges - thin_edges).max(1) as f64
        * sizes.edges as f64;
    let edge_flops = layers as f64 * sizes.edges as f64 * work::edge_flops(spec);
    let gemm_peak = peak.best();
    let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
    let beyond = after.zip(before).map(|(a, b)| mib(a.peak.saturating_sub(b.now)));
    let figures = json!({
        "network": description, "precision": options.precision.name(), "threads": args.threads,
        "instructions": peak.instructions(), "steps": step.count(),
        "ms_per_step": step.median(), "ms_least": step.least(), "ms_quartiles": [step.quantile(0.25), step.quantile(0.75)],
        "gflop_per_step": flops * 1e-9, "gflops": flops / seconds * 1e-9,
        "gemm_peak_gflops": gemm_peak * 1e-9, "peak_share": flops / seconds / gemm_peak,
        "edge_block_ms": edge_seconds * 1e3, "edge_block_gflops": edge_flops / edge_seconds * 1e-9,
        "edge_block_share": edge_flops / edge_seconds / gemm_peak,
        "gbytes_per_step": bytes * 1e-9, "gbytes_per_s": bytes / seconds * 1e-9,
        "bandwidth_gbytes_per_s": bandwidth * 1e-9, "bandwidth_share": bytes / seconds / bandwidth,
        "peak_memory_mib": after.map(|m| mib(m.peak)), "mesh_memory_mib": before.map(|m| mib(m.now)),
        "memory_beyond_mesh_mib": beyond,
        "phases": phases,
    });
    print(&figures, &phases);
    super::write_json(args.json.as_deref(), &figures)
}

fn print(f: &Value, phases: &[work::Phase]) {
    let n = |key: &str| f[key].as_f64().unwrap_or(f64::NAN);
    let network = &f["network"];
    println!(
        "network     {} layers, width {}, {} hidden layers, {} parameters; {} nodes, {} directed edges",
        network["layers"],
        network["width"],
        network["hidden_layers"],
        network["parameters"],
        network["nodes"],
        network["edges"]
    );
    println!(
        "run         {} on {} threads, {}, {} steps by turns with the peak's loop",
        f["precision"].as_str().unwrap_or_default(),
        f["threads"],
        f["instructions"].as_str().unwrap_or_default(),
        f["steps"]
    );
    println!(
        "step        {:.2} ms median; least {:.2}, quartiles {:.2} and {:.2}",
        n("ms_per_step"),
        n("ms_least"),
        f["ms_quartiles"][0].as_f64().unwrap_or(f64::NAN),
        f["ms_quartiles"][1].as_f64().unwrap_or(f64::NAN)
    );
    println!(
        "products    {:.3} GFLOP: {:.0} GFLOP/s, {:.0} % of the {:.0} GFLOP/s of an n x 128 x 128 product",
        n("gflop_per_step"),
        n("gflops"),
        100.0 * n("peak_share"),
        n("gemm_peak_gflops")
    );
    println!(
        "edge block  {:.2} ms: {:.0} GFLOP/s, {:.0} % of that peak",
        n("edge_block_ms"),
        n("edge_block_gflops"),
        100.0 * n("edge_block_share")
    );
    println!(
        "memory      {:.3} GB a step: {:.1} GB/s, {:.0} % of the {:.1} GB/s of a triad",
        n("gbytes_per_step"),
        n("gbytes_per_s"),
        100.0 * n("bandwidth_share"),
        n("bandwidth_gbytes_per_s")
    );
    println!(
        "            {:.0} MiB at most, {:.0} MiB beyond the mesh",
        n("peak_memory_mib"),
        n("memory_beyond_mesh_mib")
    );
    let total: f64 = phases.iter().map(|p| p.flops).sum();
    for p in phases {
        println!(
            "  {:<28} {:8.3} GFLOP {:3.0} %  {:8.3} GB",
            p.name,
            p.flops * 1e-9,
            100.0 * p.flops / total,
            p.bytes * 1e-9
        );
    }
}

/// Time and memory of the model on libtorch.
fn measure_torch(workload: &Workload, args: &Args, device: Option<&str>) -> Result<()> {
    let case = workload.case()?;
    let (inputs, mut outputs) = (
        workload.inputs(&case.graph)?,
        vec![0.0; workload.lengths(&case.graph).1],
    );
    let mut network = workload.torch(&case, device, args.threads)?;
    let runs = args.steps.map_or(Runs::For(SECONDS), Runs::Exactly);
    let mut step = || network.forward(&workload.comm, &inputs, &mut outputs);
    let timings = bench::alternate(runs, &mut [&mut step])?;
    let step: &Timing = &timings[0];
    let peak = Memory::read().map(|m| m.peak as f64 / (1 << 20) as f64);
    println!(
        "step        {:.2} ms median; least {:.2}, quartiles {:.2} and {:.2} (libtorch, {} steps)",
        step.median(),
        step.least(),
        step.quantile(0.25),
        step.quantile(0.75),
        step.count()
    );
    let figures = json!({
        "network": workload.describe(&case.graph), "threads": args.threads, "steps": step.count(),
        "ms_per_step": step.median(), "ms_least": step.least(),
        "ms_quartiles": [step.quantile(0.25), step.quantile(0.75)], "peak_memory_mib": peak,
    });
    super::write_json(args.json.as_deref(), &figures)
}

/// Answers each `run` with the time of a step, ms, until the input ends.
fn serve(workload: &Workload, make: impl Fn(&Case) -> Result<Box<dyn Forward>>) -> Result<()> {
    let case = workload.case()?;
    let (inputs, mut outputs) = (
        workload.inputs(&case.graph)?,
        vec![0.0; workload.lengths(&case.graph).1],
    );
    let mut network = make(&case)?;
    network.forward(&workload.comm, &inputs, &mut outputs)?;
    let failed = |e: std::io::Error| Error::file("standard output", e.to_string());
    let mut out = std::io::stdout().lock();
    let mut say = |line: String| writeln!(out, "{line}").and_then(|()| out.flush()).map_err(failed);
    say(workload.describe(&case.graph).to_string())?;
    for line in std::io::stdin().lock().lines() {
        match line
            .map_err(|e| Error::file("standard input", e.to_string()))?
            .trim()
        {
            "run" => {
                let began = Instant::now();
                network.forward(&workload.comm, &inputs, &mut outputs)?;
                say(format!("{:.6}", began.elapsed().as_secs_f64() * 1e3))?;
            }
            "quit" => break,
            other => return Err(Error::Input(format!("expected run or quit, found '{other}'"))),
        }
    }
    Ok(())
}

/// The model, the graph, inputs, and what the plain path of the engine makes of them.
fn export(workload: &Workload, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| Error::file(folder, format!("cannot be made: {e}")))?;
    let case = workload.case()?;
    let graph = &case.graph;
    let (n_inputs, n_outputs) = workload.lengths(graph);
    let inputs = workload.inputs(graph)?;
    let mut outputs = vec![0.0; n_outputs];
    workload
        .native(&case, &EngineOptions::default())?
        .forward(&workload.comm, &inputs, &mut outputs)?;
    workload.model.write(folder.join("model.safetensors"))?;
    let spec = &workload.model.spec;
    let kinds: Vec<i32> = graph.node_types[..graph.n_owned]
        .iter()
        .map(|&code| {
            let at = spec.node_types.iter().position(|t| *t as i32 == code);
            at.map(|i| i as i32)
                .ok_or_else(|| Error::Model(format!("the model does not know node type {code}")))
        })
        .collect::<Result<_>>()?;
    let float = |data: &[f32], width: usize| {
        let bytes = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        (Dtype::F32, vec![data.len() / width.max(1), width], bytes)
    };
    let integer = |data: &[i32]| {
        let bytes = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        (Dtype::I32, vec![data.len()], bytes)
    };
    let tensors = [
        ("senders", integer(&graph.senders)),
        ("receivers", integer(&graph.receivers)),
        ("node_types", integer(&kinds)),
        (
            "edge_features",
            float(&graph.edge_features, spec.n_edge_features()),
        ),
        ("inputs", float(&inputs, n_inputs / graph.n_owned.max(1))),
        ("outputs", float(&outputs, spec.n_outputs())),
    ];
    write_tensors(&folder.join("graph.safetensors"), &tensors)?;
    println!("{}", workload.describe(graph));
    Ok(())
}

/// Tensors as type, shape and little-endian values.
fn write_tensors(path: &Path, tensors: &[(&str, (Dtype, Vec<usize>, Vec<u8>))]) -> Result<()> {
    let failed = |e: &dyn std::fmt::Display| Error::file(path, format!("cannot be written: {e}"));
    let views = tensors
        .iter()
        .map(|(name, (kind, shape, data))| {
            let view = TensorView::new(*kind, shape.clone(), data);
            view.map(|v| (*name, v)).map_err(|e| failed(&e))
        })
        .collect::<Result<Vec<_>>>()?;
    let bytes = safetensors::serialize(views, None).map_err(|e| failed(&e))?;
    std::fs::write(path, bytes).map_err(|e| failed(&e))
}

/// What the engine keeps of latents in memory.
fn storage(precision: Precision) -> work::Storage {
    match precision {
        Precision::Fp32 => work::Storage {
            edge: 4,
            node: 4,
            sender: 4,
        },
        Precision::Bf16 => work::Storage {
            edge: 2,
            node: 4,
            sender: 2,
        },
    }
}
