//! `m4gn bench --train`: what a step of training costs on this machine, natively and by turns on libtorch.

use super::bench::{answer, phases};
use crate::output::filled;
use m4gn_engine::torch::{self, TorchTrial};
use m4gn_engine::{EngineOptions, Isa};
use m4gn_learn::NativeBackend;
use m4gn_mesh::{Error, Result};
use m4gn_workbench::bench::memory::Memory;
use m4gn_workbench::bench::{Timing, Trial, machine, processor_time, work};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time of the measurement of each side where the number of steps is not given.
const SECONDS: Duration = Duration::from_secs(6);

/// Times of steps by turns, wall and processor, s.
#[derive(Default)]
struct Times {
    wall: Vec<f64>,
    processor: f64,
}

impl Times {
    fn take(&mut self, step: impl FnOnce() -> Result<f64>) -> Result<()> {
        let (began, processor) = (Instant::now(), processor_time());
        step()?;
        self.wall.push(began.elapsed().as_secs_f64() * 1e3);
        self.processor += processor_time() - processor;
        Ok(())
    }

    fn figures(&self, trial: &Trial) -> Value {
        let (all, n) = (Timing::new(self.wall.clone()), self.wall.len().max(1) as f64);
        let samples = (trial.batch * trial.unroll) as f64;
        json!({
            "steps": self.wall.len(), "ms_per_step": all.median(), "ms_least": all.least(),
            "ms_quartiles": [all.quantile(0.25), all.quantile(0.75)],
            "processor_ms_per_step": self.processor / n * 1e3,
            "samples_per_s": samples / all.median() * 1e3,
            "samples_per_s_best": samples / all.least() * 1e3,
        })
    }
}

/// Where libtorch computes.
fn device(backend: &str) -> Result<&str> {
    match backend.split_once(':') {
        None if backend == "native" || backend == "torch" => Ok("cpu"),
        Some(("torch", device)) => Ok(device),
        _ => Err(Error::Input(format!("--backend {backend}: expected native, torch or torch:DEVICE"))),
    }
}

/// Serves another program: steps of training on one backend.
///
/// # Errors
/// As [`run`], and [`answer`].
pub fn serve(trial: &Trial, backend: &str) -> Result<()> {
    let device = device(backend)?;
    let prepared = trial.prepare()?;
    let graph = &prepared.work.train[0].structure.graph;
    let mut optimiser = prepared.optimiser();
    let description = json!({
        "parameters": optimiser.weights.len(), "nodes": graph.n_owned, "edges": graph.senders.len(),
    });
    if backend == "native" {
        let training = &prepared.config.training;
        let mut native = NativeBackend::new(training, &prepared.spec, &prepared.work, trial.threads)?;
        prepared.step(&mut native, &mut optimiser)?;
        return answer(description, || prepared.step(&mut native, &mut optimiser).map(|_| ()));
    }
    let described = serde_json::to_value(trial).map_err(|e| Error::Internal(e.to_string()))?;
    let mut torch = TorchTrial::new(&described, device)?;
    torch.step()?;
    answer(description, || torch.step().map(|_| ()))
}

/// Runs the measurement; `backend` native leaves libtorch out.
///
/// # Errors
/// For sizes out of range, or a file that cannot be written.
pub fn run(trial: &Trial, steps: Option<usize>, backend: &str, json: Option<&Path>) -> Result<()> {
    let device = device(backend)?;
    let options =
        EngineOptions { n_threads: trial.threads, precision: trial.precision(), ..EngineOptions::default() };
    let prepared = trial.prepare()?;
    let graph = &prepared.work.train[0].structure.graph;
    let described = serde_json::to_value(trial).map_err(|e| Error::Internal(e.to_string()))?;
    let mut torch = match (torch::library(), backend) {
        (Ok(_), _) => Some(TorchTrial::new(&described, device)?),
        (Err(error), "native") => {
            println!("libtorch    left out: {error}");
            None
        }
        (Err(error), _) => return Err(error),
    };
    let training = &prepared.config.training;
    let mut native = NativeBackend::new(training, &prepared.spec, &prepared.work, trial.threads)?;
    let mut optimiser = prepared.optimiser();
    let mut peak = machine::peak(&options);
    let (mut own, mut other) = (Times::default(), Times::default());
    // The first step of each is not counted: buffers are made in it.
    prepared.step(&mut native, &mut optimiser)?;
    if let Some(torch) = &mut torch {
        torch.step()?;
    }
    native.restart_clock();
    let began = Instant::now();
    let sides = if torch.is_some() { 2 } else { 1 };
    loop {
        own.take(|| prepared.step(&mut native, &mut optimiser))?;
        if let Some(torch) = &mut torch {
            other.take(|| torch.step())?;
        }
        let n = own.wall.len();
        if steps.map_or(n >= 5 && began.elapsed() >= SECONDS * sides, |most| n >= most) {
            break;
        }
    }
    // A machine that others use shows what it can do only now and then.
    for _ in 0..2 {
        let again = machine::peak(&options);
        peak.units = peak.units.max(again.units);
        peak.product = peak.product.max(again.product);
    }
    let sizes = work::Sizes {
        nodes: graph.n_owned,
        cells: graph.n_cells,
        edges: graph.senders.len(),
        segments: trial.segments.unwrap_or(0),
    };
    let list = work::step(&prepared.spec, sizes, work::Storage::of(options.precision), false);
    let samples = (trial.batch * trial.unroll) as f64;
    let forward = list.iter().map(|w| w.flops).sum::<f64>() * 1e-9 * samples;
    // Of each product of the forward pass two: by its input and by its weight.
    let flops = [0.0, forward, 2.0 * forward, 0.0];
    let n = own.wall.len().max(1) as f64;
    let clock = native.clock();
    let threads = trial.threads.min(trial.batch) as f64;
    let phases: Vec<Value> = ["weights", "forward", "backward", "sums"]
        .iter()
        .zip(clock.iter().zip(flops))
        .map(|(name, (seconds, gflop))| {
            let alone = matches!(*name, "weights" | "sums");
            let ms = seconds / n / if alone { 1.0 } else { threads } * 1e3;
            let rate = gflop / ms * 1e3;
            json!({ "phase": name, "ms": ms, "gflop": gflop, "gflops": rate, "peak_share": rate / peak.gflops() })
        })
        .collect();
    let memory = native.memory();
    let mib = |bytes: usize| bytes as f64 / (1 << 20) as f64;
    let mut figures = json!({
        "trial": described, "nodes": graph.n_owned, "edges": graph.senders.len(),
        "parameters": optimiser.weights.len(), "precision": options.precision.name(),
        "instructions": Isa::detect().name(), "gflop_per_step": 3.0 * forward,
        "gemm_peak_gflops": peak.gflops(), "native": own.figures(trial), "phases": phases,
        "weights_mib": mib(memory.0), "thread_mib": mib(memory.1), "tape_mib": mib(memory.2),
        "peak_memory_mib": Memory::read().map(|m| m.peak as f64 / (1 << 20) as f64),
    });
    let rate = 3.0 * forward / figures["native"]["ms_per_step"].as_f64().unwrap_or(f64::NAN) * 1e3;
    figures["gflops"] = json!(rate);
    figures["peak_share"] = json!(rate / peak.gflops());
    if torch.is_some() {
        figures["torch"] = other.figures(trial);
        let of = |side: &str, what: &str| figures[side][what].as_f64().unwrap_or(f64::NAN);
        let ratio = |what: &str| of("torch", what) / of("native", what);
        let ratios = json!({
            "median": ratio("ms_per_step"), "least": ratio("ms_least"), "processor": ratio("processor_ms_per_step"),
        });
        figures["train_vs_torch"] = ratios;
    }
    print(&figures);
    super::write_json(json, &figures)
}

const TEXT: &str = "\
network     {trial/layers} layers, width {trial/width}, {trial/hidden} hidden layers, {parameters} weights; {nodes} nodes, {edges} directed edges; batch {trial/batch}, {trial/unroll} steps in the loss
run         {precision}, threads: {trial/threads}, instructions: {instructions}";

const SIDE: &str = "{samples_per_s:1} samples/s; step {ms_per_step:2} ms median of {steps}, least {ms_least:2}, quartiles {ms_quartiles/0:2} and \
    {ms_quartiles/1:2}; processor {processor_ms_per_step:2} ms";

const RATIO: &str = "\
ratio       native is {median:2} times as fast as libtorch (medians), {least:2} (least), {processor:2} (processor time)";

const PARTS: &str = "\
products    {gflop_per_step:3} GFLOP, {gflops:0} GFLOP/s: {peak_share:0%} % of the peak of {gemm_peak_gflops:0} GFLOP/s
memory      {peak_memory_mib:0} MiB at most; weights {weights_mib:1} MiB, a thread {thread_mib:1} MiB and {tape_mib:1} MiB for each step in the loss
";

fn print(f: &Value) {
    println!("{}", filled(TEXT, f));
    for side in ["native", "torch"] {
        if let Some(figures) = f.get(side) {
            println!("{side:<11} {}", filled(SIDE, figures));
        }
    }
    if let Some(ratio) = f.get("train_vs_torch") {
        println!("{}", filled(RATIO, ratio));
    }
    println!("{}", filled(PARTS, f));
    println!("{}", phases(&f["phases"]));
}
