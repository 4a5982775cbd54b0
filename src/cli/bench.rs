//! `m4gn bench`: what a step of a network costs on this machine.

use crate::output::filled;
use m4gn_base::{Error, Result, settings};
use m4gn_data::Trajectory;
use m4gn_engine::torch::TorchTrial;
use m4gn_engine::{EngineOptions, Forward, Isa, Phase, Precision};
use m4gn_learn::NativeBackend;
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_report::Table;
use m4gn_step::Backend;
use m4gn_structure::Structure;
use m4gn_workbench::bench::memory::{self, Memory};
use m4gn_workbench::bench::{self, Runs, Source, Trial, Workload};
use serde_json::{Value, json};
use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Measure a step of a network: time, work, memory, and what part of the machine's peak that is
///
/// Without --model, a network with random weights; without --data, a made graph: an O-mesh of triangles with the
/// points as nodes, or with --hex a cube of hexahedra with the cells as nodes. The peak of matrix products is
/// measured in the same run.
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
    /// portable, avx2, avx512, avx512-bf16 or amx [default: the widest that the processor has]
    #[arg(long, value_name = "SET", conflicts_with = "train")]
    instructions: Option<String>,
    /// With --worker, what runs the network: native, torch, torch:DEVICE
    #[arg(long, default_value = "native", requires = "worker")]
    backend: String,
    /// Steps to time [default: as many as fit into 4 s, at least five]
    #[arg(long, value_name = "N", value_parser = crate::number::count)]
    steps: Option<usize>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write model.safetensors and graph.safetensors with inputs and outputs to this folder, for other programs
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// With --worker, a step of training in place of one of the network: forward, backward and update
    #[arg(long, requires = "worker", conflicts_with_all = ["model", "data", "export"])]
    train: bool,
    /// With --train: graphs in a batch
    #[arg(long, value_name = "B", default_value_t = 2, requires = "train")]
    batch: usize,
    /// With --train: model steps in the loss
    #[arg(long, value_name = "N", default_value_t = 1, requires = "train")]
    unroll: usize,
    /// Serve another program: a line with a description, then for each line 'run' on standard input the wall time and
    /// the processor time of a step, ms
    #[arg(long, conflicts_with_all = ["json", "export", "steps"])]
    worker: bool,
}

/// Time of the measurement where the number of steps is not given.
const SECONDS: Duration = Duration::from_secs(4);

/// Most threads.
const MAX_THREADS: usize = 1024;

pub fn run(args: Args) -> Result<()> {
    if !(1..=MAX_THREADS).contains(&args.threads) {
        return Err(Error::Input(format!("--threads {}: expected 1 to {MAX_THREADS}", args.threads)));
    }
    let options = EngineOptions {
        n_threads: args.threads,
        precision: settings::read("precision", &args.precision.as_str().into())?,
        isa: args.instructions.as_deref().map(Isa::parse).transpose()?,
        ..EngineOptions::default()
    };
    let backend = Backend::parse(&args.backend)?;
    if args.train {
        return serve_training(&args.trial(&options), &backend);
    }
    let workload = workload(&args, &options)?;
    if let Some(folder) = &args.export {
        println!("{}", bench::export(&workload, folder)?);
        return Ok(());
    }
    match (args.worker, &backend) {
        (false, _) => measure(&workload, &args, &options),
        (true, Backend::Native) => serve(&workload, |structure| workload.engine(structure, &options)),
        (true, Backend::Torch(device)) => {
            serve(&workload, |structure| workload.torch(structure, device.as_deref(), args.threads))
        }
    }
}

impl Args {
    fn trial(&self, options: &EngineOptions) -> Trial {
        Trial {
            nodes: self.nodes,
            hex: self.hex,
            layers: self.layers,
            width: self.width,
            hidden: self.hidden,
            segments: self.segments,
            batch: self.batch,
            unroll: self.unroll,
            threads: self.threads,
            bf16: options.precision == Precision::Bf16,
        }
    }
}

fn workload(args: &Args, options: &EngineOptions) -> Result<Workload> {
    let source = match &args.data {
        Some(path) => Source::Mesh(Box::new(Trajectory::open(path)?.cells()?.clone())),
        None => Source::made(args.nodes, args.hex)?,
    };
    let model = match &args.model {
        Some(path) => Model::read(path)?,
        None => Model::random(args.trial(options).spec(source.dim()), 1)?,
    };
    Ok(Workload { model, source, comm: Comm::serial() })
}

/// Everything about the native engine.
fn measure(workload: &Workload, args: &Args, options: &EngineOptions) -> Result<()> {
    let options = EngineOptions { profile: true, ..*options };
    let before = Memory::read();
    memory::restart_peak();
    let structure = workload.structure()?;
    let description = workload.describe(&structure.graph);
    let (inputs, mut outputs) = workload.values(&structure.graph)?;
    let mut network = workload.engine(&structure, &options)?;
    // A session keeps no graph beside its network.
    drop(structure);
    let runs = args.steps.map_or(Runs::For(SECONDS), Runs::Exactly);
    let mut peak = bench::peak(&options);
    let step = runs.time(|| network.forward(&workload.comm, &inputs, &mut outputs))?;
    let after = Memory::read();
    let profile = network.profile().unwrap_or_default();
    drop(network);
    // A machine that others use shows what it can do only now and then.
    for _ in 0..2 {
        let again = bench::peak(&options);
        peak.units = peak.units.max(again.units);
        peak.product = peak.product.max(again.product);
    }
    let gflop = profile.flops.iter().sum::<f64>() * 1e-9;
    let seconds = step.median() * 1e-3;
    // Of a thread that does nothing else: its share of the machine's peak, and of the profiled time.
    let (threads, steps) = (args.threads as f64, profile.steps.max(1) as f64);
    // What other programs left of the processor while the steps ran: the peak is of moments in which they left all.
    let available = (step.busy / threads).min(1.0);
    let phases = Phase::ALL.iter().zip(profile.phases).zip(profile.flops).filter(|(_, flops)| *flops > 0.0);
    let phases: Vec<Value> = phases
        .map(|((phase, time), flops)| {
            let ms = time / steps / threads * 1e3;
            let gflops = flops * 1e-6 / ms;
            json!({
                "phase": phase.name(), "ms": ms, "gflop": flops * 1e-9, "gflops": gflops, "peak_share": gflops / peak.gflops(),
            })
        })
        .collect();
    let edges = phases.iter().find(|p| p["phase"] == Phase::Edges.name());
    let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
    let figures = json!({
        "network": description, "precision": options.precision.name(), "threads": args.threads,
        "instructions": options.isa.unwrap_or_else(Isa::detect).name(), "steps": step.count(),
        "ms_per_step": step.median(), "ms_least": step.least(),
        "ms_quartiles": [step.quantile(0.25), step.quantile(0.75)],
        "gflop_per_step": gflop, "gflops": gflop / seconds,
        "gemm_peak_gflops": peak.gflops(), "gemm_product_gflops": peak.product, "peak_share": gflop / seconds / peak.gflops(),
        "edge_block_share": edges.map(|e| e["peak_share"].clone()),
        "processor_share": available, "ms_of_processor": step.median() * available, "peak_share_of_processor_time": gflop / seconds / peak.gflops() / available,
        "edge_block_share_of_processor_time":
            edges.and_then(|e| e["peak_share"].as_f64()).map(|share| share / available),
        "peak_memory_mib": after.map(|m| mib(m.peak)), "mesh_memory_mib": before.map(|m| mib(m.now)),
        "memory_beyond_mesh_mib": after.zip(before).map(|(a, b)| mib(a.peak.saturating_sub(b.now))),
        "profiled_ms": profile.seconds / steps * 1e3, "phases": phases,
    });
    print(&figures);
    super::write_json(args.json.as_deref(), &figures)
}

const TEXT: &str = "\
network     {network/layers} layers, width {network/width}, {network/hidden_layers} hidden layers, {network/parameters} parameters; {network/nodes} nodes, {network/edges} directed edges
run         {precision}, threads: {threads}, instructions: {instructions}
step        {ms_per_step:2} ms, median of {steps}; least {ms_least:2}, quartiles {ms_quartiles/0:2} and {ms_quartiles/1:2}";

const SHARED: &str = "            others used the processor: it ran {processor_share:0%} % of the time, {ms_of_processor:2} ms a step; of its time, \
    {peak_share_of_processor_time:0%} % of the peak, and {edge_block_share_of_processor_time:0%} % in the edge blocks";

const PARTS: &str = "\
products    {gflop_per_step:3} GFLOP, {gflops:0} GFLOP/s: {peak_share:0%} % of the peak of {gemm_peak_gflops:0} GFLOP/s (n x 128 x 128 alone: {gemm_product_gflops:0})
memory      {peak_memory_mib:0} MiB at most, {memory_beyond_mesh_mib:0} MiB of it beyond the mesh
";

fn print(f: &Value) {
    println!("{}", filled(TEXT, f));
    if f["processor_share"].as_f64().is_some_and(|share| share < 0.97) {
        println!("{}", filled(SHARED, f));
    }
    println!("{}", filled(PARTS, f));
    println!("{}", phases(&f["phases"]));
}

/// Times and work of the phases of a step.
fn phases(list: &Value) -> Table {
    let columns = [
        ("phase", "{phase}"),
        ("ms", "{ms:2}"),
        ("GFLOP", "{gflop:3}"),
        ("GFLOP/s", "{gflops:0}"),
        ("of peak", "{peak_share:0%} %"),
    ];
    let mut table = Table::new(columns.iter().map(|c| c.0));
    for phase in list.as_array().into_iter().flatten() {
        table.row(columns.iter().map(|c| filled(c.1, phase)));
    }
    table
}

/// A step of a network for another program.
fn serve<N: Forward>(workload: &Workload, make: impl Fn(&Structure) -> Result<N>) -> Result<()> {
    let structure = workload.structure()?;
    let (inputs, mut outputs) = workload.values(&structure.graph)?;
    let mut network = make(&structure)?;
    network.forward(&workload.comm, &inputs, &mut outputs)?;
    answer(workload.describe(&structure.graph), || network.forward(&workload.comm, &inputs, &mut outputs))
}

/// A step of training for another program.
fn serve_training(trial: &Trial, backend: &Backend) -> Result<()> {
    let prepared = trial.prepare()?;
    let graph = &prepared.work.train[0].structure.graph;
    let mut optimiser = prepared.optimiser();
    let description = json!({
        "parameters": optimiser.weights.len(), "nodes": graph.n_owned, "edges": graph.senders.len(),
    });
    if let Backend::Torch(device) = backend {
        let described = serde_json::to_value(trial).map_err(|e| Error::Internal(e.to_string()))?;
        let mut torch = TorchTrial::new(&described, device.as_deref().unwrap_or("cpu"))?;
        torch.step()?;
        return answer(description, || torch.step().map(|_| ()));
    }
    let (training, spec, work) = (&prepared.training, &prepared.spec, &prepared.work);
    let mut native = NativeBackend::new(training, spec, work, trial.threads)?;
    prepared.step(&mut native, &mut optimiser)?;
    answer(description, || prepared.step(&mut native, &mut optimiser).map(|_| ()))
}

/// Says the description, then answers each `run` with the wall time and the processor time of a step, ms, until the input ends.
fn answer(description: Value, mut step: impl FnMut() -> Result<()>) -> Result<()> {
    let failed = |e: std::io::Error| Error::file("standard output", e.to_string());
    let mut out = std::io::stdout().lock();
    let mut say = |line: String| writeln!(out, "{line}").and_then(|()| out.flush()).map_err(failed);
    say(description.to_string())?;
    for line in std::io::stdin().lock().lines() {
        match line.map_err(|e| Error::file("standard input", e.to_string()))?.trim() {
            "run" => {
                let (began, processor) = (Instant::now(), bench::processor_time());
                step()?;
                let (wall, processor) = (began.elapsed().as_secs_f64(), bench::processor_time() - processor);
                say(format!("{:.6} {:.6}", wall * 1e3, processor * 1e3))?;
            }
            "quit" => break,
            other => return Err(Error::Input(format!("expected run or quit, found '{other}'"))),
        }
    }
    Ok(())
}
