//! `m4gn generate`: training data by running solvers.

pub(crate) mod folder;
mod solids;

use super::{claim_outputs, progress_bar, stop_flag, write_json};
use m4gn_base::{Error, Result, refuse};
use m4gn_data::Split;
use m4gn_workbench::generate::automatic_split;
use m4gn_workbench::generate::process::Surroundings;
use m4gn_workbench::generate::queue::{Case, Made, Outcome, Queue};
use m4gn_workbench::generate::solids::Family as Body;
use serde_json::{Value, json};
use std::ffi::OsString;
use std::path::PathBuf;
use std::time::{Duration, Instant};

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
        let (mut made, mut there, mut bytes, mut failed) = (Vec::new(), 0_u64, 0_u64, Vec::new());
        let bar = progress_bar(self.count, "trajectories");
        let result = queue.run(|case, outcome| {
            bar.iter().for_each(|b| b.inc(1));
            let line = match outcome {
                Outcome::Made(one) => {
                    let (line, entry) = describe(case, one);
                    bytes += one.bytes;
                    made.push(entry);
                    line
                }
                Outcome::There => {
                    there += 1;
                    return;
                }
                Outcome::Failed(error) => {
                    failed.push((case.index(), error.to_string()));
                    format!("{:04}  failed, skipped: {error}", case.index())
                }
            };
            match (&bar, outcome) {
                (Some(bar), Outcome::Failed(_)) => bar.suspend(|| eprintln!("{line}")),
                (Some(_), _) => {}
                (None, _) => eprintln!("{line}"),
            }
        });
        bar.iter().for_each(|b| b.finish_and_clear());
        let (seconds, count) = (start.elapsed().as_secs_f64(), self.count);
        println!(
            "{}: {} trajectories made in {seconds:.0} s ({:.1} MB), {there} there before, {} failed{}",
            queue.folder.display(),
            made.len(),
            bytes as f64 * 1e-6,
            failed.len(),
            match failed.is_empty() {
                true => "",
                false => "; their logs are in the folder cases there, the same command tries again",
            }
        );
        let told: Vec<Value> =
            failed.iter().map(|(index, message)| json!({ "index": index, "message": message })).collect();
        let figures = json!({
            "count": count, "seed": self.seed, "made": made, "there_before": there, "failed": told,
            "seconds": seconds, "bytes": bytes,
        });
        write_json(self.json.as_deref(), &figures)?;
        result?;
        let cases: String =
            failed.iter().map(|(index, message)| format!("\n  {index:04}: {message}")).collect();
        refuse(!failed.is_empty(), Error::Input, || {
            format!("{} of {count} cases failed:{cases}", failed.len())
        })
    }
}
