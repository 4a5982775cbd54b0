//! `m4gn generate`: training data from OpenFOAM.

use super::{library_path, library_places, progress_bar, stop_flag, write_json};
use crate::dataset::Split;
use crate::generate::automatic_split;
use crate::generate::case::PROGRAMS;
use crate::generate::cylinder::{CaseFiles, MeshSize, Parameters};
use crate::generate::process::{Surroundings, find_program};
use crate::generate::queue::{Outcome, Queue};
use crate::{Error, Result};
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Make training data by running OpenFOAM cases with random parameters
///
/// One trajectory (an HDF5 file) a case, several cases at once. Case i of a seed is the same whatever the count.
/// What is there already is kept, so that the same command goes on where it was stopped. Needs gmsh, and icoFoam
/// and its tools in PATH.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    family: Family,
}

/// Families of cases.
#[derive(Debug, clap::Subcommand)]
enum Family {
    /// Laminar flow around a cylinder in a channel of 1.6 m x 0.41 m (the paper's CylinderFlow)
    ///
    /// Cylinder centre x 0.2 to 0.45 m, y 0.13 to 0.28 m, radius 0.035 to 0.07 m, parabolic inlet of 0.9 to 2.2 m/s
    /// on the centreline, nu 1e-3 m^2/s. Recorded are U and p at the spin-up time and --frames times after it.
    CylinderFlow(CylinderFlow),
}

#[derive(Debug, clap::Args)]
struct CylinderFlow {
    /// Number of cases
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    count: u64,
    /// Seed of the random parameters
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of the data set: 0000.h5, 0001.h5, ...
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Refinement: about 900, 1750 or 3600 triangles
    #[arg(long, value_enum, default_value_t = MeshSize::Standard)]
    mesh: MeshSize,
    /// Cases at once [default: number of cores]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=4096))]
    jobs: Option<u64>,
    /// What the trajectories are for; auto: of ten in a row one for validation, one for test
    #[arg(long, default_value = "auto", value_parser = ["auto", "train", "valid", "test"])]
    split: String,
    /// Frames after the first one
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Time between frames, s
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, value_parser = positive)]
    frame_interval: f64,
    /// Time of the first frame, s
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = positive)]
    spin_up: f64,
    /// Longest time for one tool of one case, s
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    timeout: u64,
    /// Keep the OpenFOAM cases (DIR/cases)
    #[arg(long)]
    keep_cases: bool,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v >= 1e-6 => Ok(v),
        Ok(v) => Err(format!("{v} is not a time of at least 1e-6 s")),
        Err(e) => Err(e.to_string()),
    }
}

/// Runs the command.
///
/// # Errors
/// Missing programs, a folder that cannot be used, interruption, or that every case failed.
pub fn run(args: Args) -> Result<()> {
    let Family::CylinderFlow(args) = args.family;
    let split = match args.split.as_str() {
        "auto" => None,
        name => Some(name.parse::<Split>()?),
    };
    if args.spin_up / args.frame_interval < 1.0 {
        return Err(Error::Input(
            "--spin-up must be at least one --frame-interval".into(),
        ));
    }
    let tools = Surroundings {
        stop: stop_flag()?,
        timeout: Duration::from_secs(args.timeout),
        environment: environment()?,
    };
    let folder = absolute(&args.out)?;
    let jobs = args.jobs.map_or_else(
        || std::thread::available_parallelism().map_or(1, usize::from),
        |j| j as usize,
    );
    let cases = (0..args.count)
        .map(|index| CaseFiles {
            seed: args.seed,
            index,
            parameters: Parameters::draw(args.seed, index),
            mesh: args.mesh,
            split: split.unwrap_or_else(|| automatic_split(index, args.count)),
            frames: args.frames,
            interval: args.frame_interval,
            spin_up: args.spin_up,
            command: command(&args),
        })
        .collect();
    let queue = Queue {
        cases,
        folder,
        split,
        jobs,
        keep_cases: args.keep_cases,
        tools,
    };
    let start = Instant::now();
    let mut tally = Tally::default();
    let bar = progress_bar(args.count, "trajectories");
    let result = queue.run(|case, outcome| {
        let line = tally.add(case, outcome);
        match (&bar, line) {
            (Some(bar), line) => {
                bar.inc(1);
                if let (Some(line), Outcome::Failed(_)) = (line, outcome) {
                    bar.suspend(|| eprintln!("{line}"));
                }
            }
            (None, Some(line)) => eprintln!("{line}"),
            (None, None) => {}
        }
    });
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    let seconds = start.elapsed().as_secs_f64();
    println!("{}", tally.summary(&queue, seconds));
    write_json(args.json.as_deref(), &tally.figures(&args, seconds))?;
    result?;
    if tally.failed.len() as u64 == args.count {
        return Err(Error::Input(format!(
            "all {} cases failed; the first: {}",
            args.count, tally.failed[0].1
        )));
    }
    Ok(())
}

/// The command without paths, for provenance.
fn command(args: &CylinderFlow) -> String {
    format!(
        "m4gn generate cylinder-flow --count {} --seed {} --mesh {} --split {} --frames {} --frame-interval {} --spin-up {}",
        args.count,
        args.seed,
        args.mesh.name(),
        args.split,
        args.frames,
        args.frame_interval,
        args.spin_up
    )
}

/// What the tools need: OpenFOAM's folder, and our libraries for the function object.
fn environment() -> Result<Vec<(String, OsString)>> {
    let missing: Vec<&str> = PROGRAMS
        .into_iter()
        .filter(|p| find_program(p).is_none())
        .collect();
    if !missing.is_empty() {
        return Err(Error::Input(format!(
            "{} not found in PATH: install OpenFOAM and gmsh (Debian: apt-get install openfoam gmsh), or source your \
             OpenFOAM's etc/bashrc; 'm4gn doctor' says more",
            missing.join(", ")
        )));
    }
    library_path("libm4gnFoam.so")?;
    let mut places: Vec<PathBuf> = library_places();
    places.extend(
        std::env::var_os("LD_LIBRARY_PATH")
            .iter()
            .flat_map(std::env::split_paths),
    );
    let libraries = std::env::join_paths(places).map_err(|e| {
        Error::Input(format!(
            "the folder of the libraries cannot be in LD_LIBRARY_PATH: {e}"
        ))
    })?;
    let mut variables = vec![
        ("LD_LIBRARY_PATH".to_string(), libraries),
        ("OMP_NUM_THREADS".to_string(), "1".into()),
        ("OPENBLAS_NUM_THREADS".to_string(), "1".into()),
    ];
    if std::env::var_os("WM_PROJECT_DIR").is_none_or(|v| v.is_empty()) {
        variables.push((
            "WM_PROJECT_DIR".to_string(),
            super::doctor::DEBIAN_OPENFOAM.into(),
        ));
    }
    Ok(variables)
}

/// The folder's full path, which OpenFOAM can only use without blanks and quotes.
fn absolute(folder: &Path) -> Result<PathBuf> {
    let path = std::path::absolute(folder).map_err(|e| Error::file(folder, format!("is no path: {e}")))?;
    let usable = path
        .to_str()
        .is_some_and(|p| !p.contains(|c: char| c.is_whitespace() || "\"'\\${};".contains(c)));
    if !usable {
        return Err(Error::file(
            path,
            "OpenFOAM cannot work in folders with blanks, quotes or $ in their path: choose another",
        ));
    }
    Ok(path)
}

/// What became of the cases.
#[derive(Default)]
struct Tally {
    made: Vec<serde_json::Value>,
    there: u64,
    failed: Vec<(u64, String)>,
    bytes: u64,
}

impl Tally {
    /// Counts a case; the line to print about it.
    fn add(&mut self, case: &CaseFiles, outcome: &Outcome) -> Option<String> {
        let p = &case.parameters;
        match outcome {
            Outcome::Made(made) => {
                self.bytes += made.bytes;
                self.made.push(serde_json::json!({
                    "index": case.index, "split": case.split.name(), "parameters": p, "reynolds": p.reynolds(),
                    "result": made,
                }));
                Some(format!(
                    "{:04}  {:<5}  Re {:>5.1}  {} cells  {} frames  {:.1} MB  {:.1} s",
                    case.index,
                    case.split.name(),
                    p.reynolds(),
                    made.cells,
                    made.frames,
                    made.bytes as f64 * 1e-6,
                    made.seconds
                ))
            }
            Outcome::There(_) => {
                self.there += 1;
                None
            }
            Outcome::Failed(error) => {
                self.failed.push((case.index, error.to_string()));
                Some(format!("{:04}  failed, skipped: {error}", case.index))
            }
        }
    }

    fn summary(&self, queue: &Queue, seconds: f64) -> String {
        let mut text = format!(
            "{}: {} trajectories made in {seconds:.0} s ({:.1} MB), {} there before, {} failed",
            queue.folder.display(),
            self.made.len(),
            self.bytes as f64 * 1e-6,
            self.there,
            self.failed.len()
        );
        if !self.failed.is_empty() {
            text += "; their logs are in the folder cases there, the same command tries again";
        }
        text
    }

    fn figures(&self, args: &CylinderFlow, seconds: f64) -> serde_json::Value {
        let failed: Vec<_> = self
            .failed
            .iter()
            .map(|(index, message)| serde_json::json!({"index": index, "message": message}))
            .collect();
        serde_json::json!({
            "count": args.count, "seed": args.seed, "made": self.made, "there_before": self.there, "failed": failed,
            "seconds": seconds, "bytes": self.bytes,
        })
    }
}
