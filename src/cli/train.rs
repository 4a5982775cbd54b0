//! `m4gn train`: fits a model to a data set, on the native engine or, in libm4gn_torch.so, on libtorch.

use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_train::{Request, train_native};
use std::path::PathBuf;

/// Train a model on recorded trajectories
///
/// Writes the best model so far to OUT, and beside it a checkpoint (.checkpoint) and a log (.csv). Ctrl-C saves
/// a checkpoint; --resume carries on exactly where it stopped. Under mpirun every rank takes its share of each batch.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of trajectories (*.h5), or one trajectory
    #[arg(long)]
    data: PathBuf,
    /// Training configuration (TOML)
    #[arg(long)]
    config: PathBuf,
    /// Model file to write
    #[arg(long)]
    out: PathBuf,
    /// Start from the weights and normalisers of this model (*.safetensors): fine-tuning
    #[arg(long, value_name = "MODEL")]
    from: Option<PathBuf>,
    /// What computes: native, or torch (libtorch) [default: native; torch where --device is not cpu]
    #[arg(long, value_name = "native|torch")]
    backend: Option<String>,
    /// cpu, cuda or cuda:N
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Carry on from the checkpoint beside OUT, or start if there is none
    #[arg(long)]
    resume: bool,
    /// Worker threads of each rank; as many as cores and graphs in a batch allow by default
    #[arg(long)]
    threads: Option<usize>,
    /// Memory that the frames of each rank may take, GB; of trajectories beyond it, frames are read when they are needed
    /// [default: half of the free memory, shared by the ranks of the machine]
    #[arg(long, value_name = "GB")]
    memory: Option<f64>,
    /// Steps, in place of training.steps; 0 with --from: only write the ranges of the data into a copy of the model
    #[arg(long)]
    steps: Option<u64>,
    /// Seed, in place of training.seed
    #[arg(long)]
    seed: Option<u64>,
    /// Write the figures to this file
    #[arg(long)]
    json: Option<PathBuf>,
}

/// Runs the command; of several ranks that fail one has the message, the others [`Error::OtherRank`].
pub fn run(args: Args) -> Result<()> {
    let native = match (args.backend.as_deref(), args.device.as_str()) {
        (Some("native"), "cpu") | (None, "cpu") => true,
        (Some("native"), device) => {
            return Err(Error::Input(format!(
                "--device {device}: the native backend runs on cpu; use --backend torch"
            )));
        }
        (Some("torch") | None, _) => false,
        (Some(other), _) => {
            return Err(Error::Input(format!("--backend {other}: expected native or torch")));
        }
    };
    let comm = match n_ranks() > 1 {
        true => Comm::world()?,
        false => Comm::serial(),
    };
    let stop = super::stop_flag()?;
    let request = Request {
        data: args.data,
        config: args.config,
        out: args.out,
        device: Some(args.device),
        from: args.from,
        resume: args.resume,
        threads: args.threads.or((comm.size() > 1).then_some(1)),
        memory: args.memory,
        steps: args.steps,
        seed: args.seed,
        json: args.json,
    };
    let result = match native {
        true => train_native(&request, stop, &comm).map(|_| ()),
        false if comm.size() > 1 => Err(Error::Input(format!(
            "--backend torch trains on one rank, found {}; use --backend native, or run without mpirun",
            comm.size()
        ))),
        false => serde_json::to_value(&request)
            .map_err(|e| Error::Input(format!("a path: {e}")))
            .and_then(|request| m4gn_engine::torch::train(&request, stop)),
    };
    one_message(&comm, result)
}

/// Leaves the message to the lowest rank that has one of its own.
fn one_message(comm: &Comm, result: Result<()>) -> Result<()> {
    let own = matches!(&result, Err(e) if !matches!(e, Error::OtherRank { .. }));
    let mut first = [i64::from(if own { comm.rank() } else { i32::MAX })];
    comm.min_i64(&mut first);
    match result {
        Err(_) if first[0] != i64::from(comm.rank()) => {
            Err(Error::OtherRank { rank: first[0] as i32, message: String::new() })
        }
        result => result,
    }
}

/// Ranks that this program was started with, as the launchers of OpenMPI, MPICH and Slurm tell.
fn n_ranks() -> usize {
    ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS"]
        .iter()
        .find_map(|name| std::env::var(name).ok()?.parse().ok())
        .unwrap_or(1)
}
