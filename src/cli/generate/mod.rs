//! `m4gn generate`: training data by running solvers.

pub(crate) mod folder;
mod solids;
mod tally;

use super::{claim_outputs, progress_bar, stop_flag, write_json};
use m4gn_base::Result;
use m4gn_data::Split;
use m4gn_workbench::generate::automatic_split;
use m4gn_workbench::generate::process::Surroundings;
use m4gn_workbench::generate::queue::{Case, Made, Outcome, Queue};
use m4gn_workbench::generate::solids::Family as Body;
use serde_json::Value;
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tally::Tally;

/// Make training data by simulating cases with random parameters
///
/// One trajectory (an HDF5 file) a case, several cases at once. Case i of a seed is the same whatever the count.
/// What is there already is kept, so that the same command goes on where it was stopped.
///
/// Beside the commands below, FAMILY is a family of OpenFOAM cases (cylinder-flow, vibrating-beam), or a folder of your own
/// with a file family.toml: 'm4gn generate cylinder-flow --help' lists its parameters, docs/reference/families.md describes the file.
#[derive(Debug, clap::Args)]
#[command(override_usage = "m4gn generate FAMILY --count N --out DIR [OPTIONS]")]
pub struct Args {
    #[command(subcommand)]
    family: Family,
}

/// Families of cases.
#[derive(Debug, clap::Subcommand)]
enum Family {
    /// Hyperelastic plates with holes, pressed by a rigid obstacle (the paper's DeformingPlate)
    ///
    /// Plates of 8 to 12 cm x 4 to 6 cm x 4 to 8 mm with one to three holes, held at both ends, at one end or all round;
    /// a sphere, cylinder or rounded block is pressed into them and slides. Tetrahedra, about 1271 points; neo-Hookean,
    /// E 1 MPa, nu 0.4 unless set, rho 1000 kg/m^3; quasi-static, frictionless. A draw that has no quasi-static path (the body snaps
    /// or slips off) is drawn again and counted. Needs gmsh, and the Python environment that setup/solids.sh makes.
    DeformingPlate(solids::SolidArgs),
    /// Nearly incompressible beams, pressed by a rigid obstacle (the paper's DeformingBeam)
    ///
    /// Tapered and bowed beams of 8 to 12 cm, held at one end, at both, or propped; a cylinder, sphere or rounded block is
    /// pressed into them and slides or turns. Wedges, about 1542 points; material and the rest as for deforming-plate.
    DeformingBeam {
        #[command(flatten)]
        solid: solids::SolidArgs,
        /// The paper's DeformingBeam (large): twice the length, 1.5 times the height, cells of the same size, about 4540
        /// points
        #[arg(long)]
        large: bool,
    },
    #[command(external_subcommand)]
    Folder(Vec<OsString>),
}

/// Options of every family.
#[derive(Debug, clap::Args)]
struct Common {
    /// Number of cases
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    count: u64,
    /// Seed of the random parameters
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of the data set: 0000.h5, 0001.h5, ...
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Cases at once [default: number of cores]
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..=4096))]
    jobs: Option<u64>,
    /// What the trajectories are for; auto: of ten in a row one for validation, one for test
    #[arg(long, default_value = "auto", value_parser = ["auto", "train", "valid", "test"])]
    split: String,
    /// Longest time for one program of one case, s
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    timeout: u64,
    /// Keep the folders of the cases (DIR/cases)
    #[arg(long)]
    keep_cases: bool,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub(crate) fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(v) if v.is_finite() && v >= 1e-6 => Ok(v),
        Ok(v) => Err(format!("{v} is not a time of at least 1e-6 s")),
        Err(e) => Err(e.to_string()),
    }
}

/// Runs the command.
///
/// # Errors
/// Missing programs, a folder that cannot be used, interruption, or a case that failed.
pub fn run(args: Args) -> Result<()> {
    match args.family {
        Family::DeformingPlate(solid) => solids::run(&solid, Body::DeformingPlate, false),
        Family::DeformingBeam { solid, large } => solids::run(&solid, Body::DeformingBeam, large),
        Family::Folder(arguments) => folder::run(&arguments),
    }
}

impl Common {
    /// Makes the cases `case(index, split)` in `folder`. `describe` gives the line that a made case prints and its
    /// entry among the figures.
    fn make<C: Case>(
        &self,
        folder: PathBuf,
        environment: Vec<(String, OsString)>,
        case: impl Fn(u64, Split) -> Result<C>,
        describe: impl Fn(&C, &Made<C::Figures>) -> (String, Value),
    ) -> Result<()> {
        let split: Option<Split> = match self.split.as_str() {
            "auto" => None,
            name => Some(name.parse()?),
        };
        let _claimed = claim_outputs([self.json.as_deref()], [])?;
        let jobs = self
            .jobs
            .map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), |j| j as usize);
        let cases = (0..self.count)
            .map(|index| case(index, split.unwrap_or_else(|| automatic_split(index, self.count))))
            .collect::<Result<_>>()?;
        let queue = Queue {
            cases,
            folder,
            split,
            jobs,
            keep_cases: self.keep_cases,
            tools: Surroundings {
                stop: stop_flag()?,
                timeout: Duration::from_secs(self.timeout),
                asks: false,
                environment,
            },
        };
        let start = Instant::now();
        let mut tally = Tally::default();
        let bar = progress_bar(self.count, "trajectories");
        let result = queue.run(|case, outcome| {
            let line = match outcome {
                Outcome::Made(made) => {
                    let (line, entry) = describe(case, made);
                    tally.bytes += made.bytes;
                    tally.made.push(entry);
                    Some(line)
                }
                Outcome::There(_) => {
                    tally.there += 1;
                    None
                }
                Outcome::Failed(error) => Some(tally.failed(case.index(), error)),
            };
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
        bar.iter().for_each(|b| b.finish_and_clear());
        let seconds = start.elapsed().as_secs_f64();
        println!("{}", tally.summary(&queue.folder, seconds));
        write_json(self.json.as_deref(), &tally.figures(self.count, self.seed, seconds))?;
        result?;
        tally.fail_if_any(self.count)
    }
}
