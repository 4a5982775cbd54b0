//! Training on several ranks against the same training on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3.
//! Without mpirun this is a run on one rank.

#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_samples::{distance, training as sample};
use m4gn_train::checkpoint::Checkpoint;
use m4gn_train::{Request, train_native};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::AtomicU8;

/// Sums of the batch come in another order, and Adam divides by what is small.
const TOLERANCE: f64 = 1e-4;

fn main() -> ExitCode {
    ranks::run("mpi_train", run)
}

/// The first rank's folder, on all ranks.
fn folder(comm: &Comm) -> Result<(Option<tempfile::TempDir>, PathBuf)> {
    let own = match comm.is_root() {
        true => Some(tempfile::tempdir().map_err(|e| Error::file("temporary folder", e.to_string()))?),
        false => None,
    };
    let mut path =
        own.as_ref().map_or_else(Vec::new, |f| f.path().to_string_lossy().into_owned().into_bytes());
    comm.broadcast(&mut path);
    Ok((own, PathBuf::from(String::from_utf8_lossy(&path).into_owned())))
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text).map_err(|e| Error::file(path, e.to_string()))
}

fn run(comm: &Comm) -> Result<Vec<String>> {
    let (_own, folder) = folder(comm)?;
    let data = folder.join("data");
    let config = folder.join("config.toml");
    if comm.is_root() {
        std::fs::create_dir(&data).map_err(|e| Error::file(&data, e.to_string()))?;
        sample::write_data(&data, 3)?;
        let text = sample::config("validation_interval = 6\ncheckpoint_interval = 3");
        let text = text.replace("batch_size = 3", "batch_size = 6");
        write(&config, &text.replace("micro_batch = 2", "micro_batch = 1"))?;
    }
    comm.barrier();
    let request = |name: &str, steps: u64| sample::request_of(&folder, &config, name, steps);
    // Bit for bit, as the first rank sees it.
    let same = |a: &Request, b: &Request| -> Result<bool> {
        let [a, b] = [Checkpoint::read(&a.checkpoint())?, Checkpoint::read(&b.checkpoint())?];
        Ok((a.weights, a.first, a.second, a.average) == (b.weights, b.first, b.second, b.average))
    };
    let go = AtomicU8::new(0);
    let mut failures = Vec::new();

    // All ranks together, and the first one alone.
    let together = request("together", 12);
    train_native(&together, &go, comm)?;
    if comm.is_root() {
        let alone = request("alone", 12);
        train_native(&alone, &go, &Comm::serial())?;
        let (a, b) = (Checkpoint::read(&together.checkpoint())?, Checkpoint::read(&alone.checkpoint())?);
        let off = distance(&a.weights, &b.weights);
        if comm.size() == 1 && off > 0.0 || off > TOLERANCE {
            failures.push(format!("weights are {off:e} from those of one rank"));
        }
        if distance(&a.weights, &a.first) < 0.1 || a.progress.updates != 10 {
            failures.push(format!("{} updates: nothing was learned", a.progress.updates));
        }
        let (best, expected) = (a.progress.best, b.progress.best);
        match (best, expected) {
            (Some((_, a)), Some((_, b))) if (a.score() / b.score() - 1.0).abs() < 1e-3 => {}
            other => failures.push(format!("validations differ: {other:?}")),
        }
    }
    comm.barrier();

    // In two parts: bit for bit the same as at once on this number of ranks.
    let mut parts = request("parts", 5);
    train_native(&parts, &go, comm)?;
    parts.resume = true;
    parts.steps = Some(12);
    train_native(&parts, &go, comm)?;
    if comm.is_root() && !same(&together, &parts)? {
        failures.push("resumed weights differ".into());
    }

    // A checkpoint that one rank does not see.
    let mut unseen = parts.clone();
    if comm.size() > 1 && comm.rank() == comm.size() - 1 {
        unseen.out = folder.join("unseen.safetensors");
    }
    match train_native(&unseen, &go, comm) {
        Ok(_) if comm.size() == 1 => {}
        Err(e) if e.to_string().contains("checkpoint 12") => {}
        other => failures.push(format!("a checkpoint that one rank does not see: {other:?}")),
    }

    // With frames read from the files, on some ranks or on all: bit for bit as from memory.
    for (name, memory) in [("disk", Some(0.0)), ("some", (comm.rank() % 2 == 0).then_some(0.0))] {
        let mut streamed = request(name, 12);
        streamed.memory = memory;
        train_native(&streamed, &go, comm)?;
        if comm.is_root() && !same(&together, &streamed)? {
            failures.push(format!("{name}: weights of frames that were read from files differ"));
        }
    }
    comm.barrier();

    // Interrupted on one rank, all save and stop.
    let stopped = request("stopped", 12);
    let stop = AtomicU8::new(u8::from(comm.rank() == comm.size() - 1));
    match train_native(&stopped, &stop, comm) {
        Err(Error::Interrupted(_) | Error::OtherRank { .. }) => {}
        other => failures.push(format!("an interruption on one rank ended as {other:?}")),
    }

    // What is wrong on one rank ends all.
    let mut wrong = request("wrong", 4);
    if comm.rank() == comm.size() - 1 {
        wrong.data = folder.join("nowhere");
    }
    match train_native(&wrong, &go, comm) {
        Ok(_) => failures.push("a rank without data was not noticed".into()),
        Err(e) if e.to_string().contains("nowhere") => {}
        Err(e) => failures.push(format!("the message of a rank without data: {e}")),
    }

    // More ranks than graphs in a batch.
    if comm.size() > 1 {
        comm.barrier();
        let text = std::fs::read_to_string(&config).map_err(|e| Error::file(&config, e.to_string()))?;
        comm.barrier();
        if comm.is_root() {
            write(&config, &text.replace("batch_size = 6", "batch_size = 1"))?;
        }
        comm.barrier();
        match train_native(&request("few", 4), &go, comm) {
            Err(e) if e.to_string().contains("training.batch_size") => {}
            other => failures.push(format!("a batch of one graph on several ranks: {other:?}")),
        }
    }
    comm.barrier();
    Ok(failures)
}
