//! `m4gn campaign`: runs of one case over its parameters.

use super::stop_flag;
use m4gn_base::{Error, Result};
use m4gn_workbench::campaign::sampling::{Method, Parameter};
use m4gn_workbench::campaign::{self, Campaign, Order, Request};
use m4gn_workbench::generate::openfoam::surroundings;
use std::path::PathBuf;
use std::time::Duration;

/// Make runs of a case over its parameters, each of which starts from its sisters and ends when its figures are known
///
/// 'init' makes a folder with campaign.toml and parameters.csv of a case, 'run' makes what is missing, 'report' writes results.csv and report.html.
/// 'one' makes a single run, for Slurm arrays, Snakemake and other loops. See docs/how-to/run-a-campaign.md.
#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, clap::Subcommand)]
enum Verb {
    Init(Init),
    One(One),
    Run(Run),
    /// Say which runs are there, and what is the matter with the others
    Status(Store),
    /// Write results.csv and report.html of the runs that are there
    Report(Store),
}

/// Make a campaign of a case
///
/// Each parameter is used by a file of the case as $NAME, below #include "<system>/simulationParameters".
#[derive(Debug, clap::Args)]
struct Init {
    /// Folder of an OpenFOAM case
    #[arg(value_name = "CASE")]
    case: PathBuf,
    /// Folder for the campaign
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// A parameter with its range or its values; may be given several times
    #[arg(long = "parameter", value_name = "NAME=LOW:HIGH|NAME=V1,V2,...")]
    parameters: Vec<Parameter>,
    /// How values are chosen [default: grid of lists, sobol with a range]
    #[arg(long, value_enum)]
    sampling: Option<Sampling>,
    /// Runs, or values of each range in a grid
    #[arg(long, value_name = "N", default_value_t = 16)]
    count: usize,
    /// Seed of the draw
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Ranks of the solver [default: as the case's Allrun]
    #[arg(long, value_name = "N")]
    ranks: Option<usize>,
}

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Sampling {
    /// The i-th values of all lists together
    List,
    /// Every value with every other
    Grid,
    /// Scrambled Sobol points
    Sobol,
    /// A Latin hypercube
    LatinHypercube,
}

/// Where a campaign is.
#[derive(Debug, clap::Args)]
struct Store {
    /// Folder of the campaign
    #[arg(long = "store", value_name = "FOLDER", default_value = ".")]
    folder: PathBuf,
}

/// Make one run, start to finish; one that is there is left as it is
#[derive(Debug, clap::Args)]
struct One {
    /// Its name in parameters.csv
    #[arg(value_name = "NAME", required_unless_present = "dakota")]
    name: Option<String>,
    /// Take its values from Dakota's parameters file, and write its figures to Dakota's results file
    #[arg(long, num_args = 2, value_names = ["PARAMETERS", "RESULTS"], conflicts_with_all = ["name", "check"])]
    dakota: Option<Vec<PathBuf>>,
    /// Make the run's check: cold, plain and to the end
    #[arg(long)]
    check: bool,
    /// Make it again if it was made from other contents of the case or the campaign
    #[arg(long)]
    anew: bool,
    /// The program that started this one has claimed the run's folder
    #[arg(long, hide = true, conflicts_with = "dakota")]
    claimed: bool,
    #[command(flatten)]
    store: Store,
}

/// Make all runs that are missing, spread over the parameters first, then where the finished ones foretell worst
///
/// Stopped at any moment, it goes on with the same command. Several may work on one campaign. A run that fails is reported, and the others go on;
/// exit status 1 then.
#[derive(Debug, clap::Args)]
struct Run {
    /// Runs at once [default: jobs of campaign.toml]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Part i of n of the runs
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<(usize, usize)>,
    /// Make runs again that were made from other contents of the case or the campaign
    #[arg(long)]
    anew: bool,
    /// Make runs again that failed
    #[arg(long)]
    retry: bool,
    #[command(flatten)]
    store: Store,
}

fn shard(text: &str) -> std::result::Result<(usize, usize), String> {
    let number = |t: &str| t.parse::<usize>().ok().filter(|n| *n > 0);
    let parts = text.split_once('/').and_then(|(i, n)| number(i).zip(number(n)));
    parts.filter(|(i, n)| i <= n).ok_or_else(|| "expected I/N with I from 1 to N".into())
}

/// Runs the command; runs that failed are told after all others.
pub fn run(args: Args) -> Result<()> {
    let mut tools = surroundings(stop_flag()?, Duration::from_secs(86_400))?;
    let mut say = |line: &str| println!("{line}");
    match args.verb {
        Verb::Init(args) => {
            let method = args.sampling.map(|s| match s {
                Sampling::List => Method::List,
                Sampling::Grid => Method::Grid,
                Sampling::Sobol => Method::Sobol,
                Sampling::LatinHypercube => Method::LatinHypercube,
            });
            let out = args.out.display().to_string();
            let request = Request {
                case: args.case,
                out: args.out,
                parameters: args.parameters,
                method,
                count: args.count,
                seed: args.seed,
                ranks: args.ranks,
            };
            let found = campaign::init(&request, &tools)?;
            found.notes.iter().for_each(|note| println!("note: {note}"));
            println!(
                "{} runs; look at {out}/campaign.toml and {out}/parameters.csv, then: m4gn campaign run --store {out}",
                found.runs
            );
            Ok(())
        }
        Verb::One(args) => {
            let folder = &args.store.folder;
            let (name, made) = match args.dakota.as_deref() {
                Some([parameters, results]) => campaign::dakota::evaluate(
                    (folder, parameters, results),
                    args.anew,
                    &mut tools,
                    &mut say,
                )?,
                _ => {
                    let campaign = Campaign::open(folder, &mut tools)?;
                    let unit = campaign.unit(&args.name.unwrap_or_default(), args.check)?;
                    let made = match args.claimed {
                        true => campaign::one_claimed(&campaign, unit, args.anew, &tools)?,
                        false => campaign::one(&campaign, unit, args.anew, &tools, &mut say)?,
                    };
                    (campaign.name(unit), made)
                }
            };
            let there = if made.before { "is there: " } else { "" };
            println!("{name}: {there}{}", campaign::line(&made.record));
            Ok(())
        }
        Verb::Run(args) => {
            let campaign = Campaign::open(&args.store.folder, &mut tools)?;
            let order = Order {
                jobs: args.jobs.map(usize::from),
                shard: args.shard,
                anew: args.anew,
                retry: args.retry,
            };
            match campaign::run(&campaign, order, &tools, &mut say)? {
                (0, _) => Ok(()),
                (failed, all) => Err(Error::Input(format!("{failed} of {all} runs failed, as told above"))),
            }
        }
        Verb::Status(args) => {
            let (table, there) = campaign::status(&Campaign::open(&args.folder, &mut tools)?)?;
            print!("{table}");
            println!("{there} of {} runs are there", table.rows.len());
            Ok(())
        }
        Verb::Report(args) => {
            let report = campaign::report(&Campaign::open(&args.folder, &mut tools)?)?;
            report.notes.iter().for_each(|note| println!("note: {note}"));
            let (there, all) = report.there;
            println!("{there} of {all} runs: {}, {}", report.csv.display(), report.html.display());
            Ok(())
        }
    }
}
