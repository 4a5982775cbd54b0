//! `m4gn hybrid`: many unseen cases of a family, hybrid runs against the full solver.

use super::generate::folder::SetArgs;
use super::{claim_outputs, stop_flag, write_json};
use m4gn_base::{Error, Result, refuse};
use m4gn_workbench::generate::family::Family;
use m4gn_workbench::generate::openfoam::{environment, plain_path};
use m4gn_workbench::generate::parameter::Settings;
use m4gn_workbench::generate::process::Surroundings;
use m4gn_workbench::hybrid::{
    self, DrawResult, Kind, Plan, Variant, case_table, failures, remarks, summary, summary_tables, variants,
};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Run many unseen cases of a family with and without the surrogate, and compare: errors, forces, times
///
/// Of each draw the plain solver runs once over the whole time span, then the hybrids with the family's schedule (a network's, the dmd
/// surrogate's, both), each --variant and each cheaper plain solver. What is finished is kept in --out, so that the same command goes on where it was stopped; a run
/// that was made with other settings is made anew. Exit status 1 if any run failed. See docs/how-to/measure-a-surrogate.md.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The network (*.safetensors); without it the dmd surrogate alone is run
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Family of cases: its name, or a folder with family.toml
    #[arg(long, default_value = "cylinder-flow")]
    family: PathBuf,
    /// Number of draws
    #[arg(long, default_value_t = 12, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    count: u64,
    /// Seed of the draws: another one than the training data's
    #[arg(long, default_value_t = 4321)]
    seed: u64,
    #[command(flatten)]
    set: SetArgs,
    /// A further hybrid, of the network or, without --model, of the dmd surrogate: FILE has entries for the function object m4gnSurrogate, which replace or join the usual ones; parameters
    /// of its case can follow, NAME=FILE,PARAMETER=VALUE,...
    #[arg(long, value_name = "NAME=FILE")]
    variant: Vec<String>,
    /// A plain solver to compare with: one of the family's by name, or NAME=PARAMETER=VALUE,...; none: no plain solver
    /// [default: all of the family's]
    #[arg(long, value_name = "NAME[=SETTINGS]")]
    baseline: Vec<String>,
    /// The solver is alone before, s [default: the family's]
    #[arg(long, value_name = "SECONDS", value_parser = crate::number::time)]
    takeover: Option<f64>,
    /// End of the runs, s [default: the family's]
    #[arg(long, value_name = "SECONDS", value_parser = crate::number::time)]
    end: Option<f64>,
    /// Folder of the runs and results
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Draws at once; above 1, times disturb each other
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=4096))]
    jobs: u64,
    /// Longest time for one program of one case, s
    #[arg(long, value_name = "SECONDS", default_value_t = 3600)]
    timeout: u64,
    /// End each run but the full one where it knows the family's figures, and compare these in place of the fields: the time to the answer
    #[arg(long)]
    answers: bool,
    /// Keep the folders of the runs
    #[arg(long)]
    keep_cases: bool,
    /// Write all figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Write a page with a chart and tables to this file, self-contained
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
}

pub fn run(args: Args) -> Result<()> {
    let _claimed = claim_outputs([args.json.as_deref(), args.html.as_deref()], [args.model.as_deref()])?;
    let plan = plan(&args)?;
    let order = plan.schedule.order_by.clone().unwrap_or("case".into());
    let names: Vec<String> = plan.variants.iter().map(|v| v.name.clone()).collect();
    let results = hybrid::run(&plan, |line| eprintln!("{line}"))?;

    println!(
        "whole %, whole wall %: processor and wall time of the whole run, with start-up and loading, over the full run's; stretch %: \
         processor time after the takeover. first stride, first jump, end: error of the velocity, or of a solid's displacement, over cells and \
         stored times from the takeover up to there, over that of holding the field of the takeover; D, cell: error of the displacement over \
         its root mean square, and that of the cell that moves most; forces and frequency against the full run\n"
    );
    println!("{}", case_table(&results, &names, &order));
    remarks(&results).iter().for_each(|line| println!("{line}"));
    for (title, table) in summary_tables(&results, &names, &order) {
        println!("{title}\n{table}");
    }
    write_json(args.json.as_deref(), &figures(&plan, &results, &names)?)?;
    if let Some(path) = &args.html {
        hybrid::report(&plan, &results, &names, &order)?.write(path)?;
    }
    let failed = failures(&results);
    let count = failed.len();
    refuse(count > 0, Error::Input, || format!("{count} runs failed:\n  {}", failed.join("\n  ")))
}

fn plan(args: &Args) -> Result<Plan> {
    let family = Family::find(&args.family)?;
    let mut schedule = family.hybrid.clone().ok_or_else(|| {
        Error::Input(format!(
            "family {} says nothing of hybrid runs: its family.toml needs a table [hybrid] (docs/reference/families.md)",
            family.name
        ))
    })?;
    schedule.start_up = args.takeover.unwrap_or(schedule.start_up);
    let asked = match (args.answers, &schedule.answers) {
        (true, None) => {
            return Err(Error::Input(format!(
                "--answers: family {} names no figures: its family.toml needs a table [hybrid.answers] (docs/reference/families.md)",
                family.name
            )));
        }
        (asked, answers) => answers.as_ref().filter(|_| asked),
    };
    schedule.end = args.end.unwrap_or(asked.map_or(schedule.end, |a| a.end));
    schedule.check()?;
    let model = args.model.as_deref().map(plain_path).transpose()?;
    if let Some(model) = model.as_ref().filter(|m| !m.is_file()) {
        return Err(Error::file(model, "there is no such file: expected a model (*.safetensors)"));
    }
    let kinds = (model.is_some(), args.answers);
    let variants = variants(&family, &schedule, kinds, &args.variant, &args.baseline)?;
    if variants.is_empty() {
        return Err(Error::Input(format!(
            "nothing is run of family {} beside the full solver: expected --model, --variant or --baseline",
            family.name
        )));
    }
    let settings: Settings = args.set.set.iter().cloned().collect();
    let first = family.draw(args.seed, 0, &schedule.settings(&settings))?;
    Ok(Plan {
        settings,
        model,
        seed: args.seed,
        count: args.count,
        variants,
        folder: plain_path(&args.out)?,
        jobs: args.jobs as usize,
        keep_cases: args.keep_cases,
        answers: args.answers,
        tools: Surroundings {
            stop: stop_flag()?,
            timeout: Duration::from_secs(args.timeout),
            asks: false,
            environment: environment(&family.programs(&first)?)?,
        },
        family,
        schedule,
    })
}

fn figures(plan: &Plan, results: &[DrawResult], names: &[String]) -> Result<Value> {
    let s = &plan.schedule;
    let variant = |v: &Variant| {
        let settings = v.kind.settings().iter();
        let settings: Vec<String> = settings.map(|(name, setting)| format!("{name}={setting}")).collect();
        match &v.kind {
            Kind::Hybrid { surrogates, entries, .. } => {
                json!({ "name": v.name, "surrogates": surrogates, "entries": entries, "settings": settings })
            }
            Kind::Plain(_) => json!({ "name": v.name, "settings": settings }),
        }
    };
    let settings = plan.settings.iter().map(|(name, v)| format!("{name}={v}"));
    let cases =
        serde_json::to_value(results).map_err(|e| Error::Internal(format!("figures of hybrid runs: {e}")))?;
    Ok(json!({
        "family": plan.family.name, "model": plan.model, "seed": plan.seed, "count": plan.count,
        "settings": settings.collect::<Vec<_>>(),
        "schedule": {
            "start_up": s.start_up, "end": s.end, "interval": s.interval, "solver_time": s.solver_time,
            "surrogate_steps": s.surrogate_steps, "patch": s.patch, "order_by": s.order_by,
        },
        "variants": plan.variants.iter().map(variant).collect::<Vec<_>>(),
        "summary": summary(results, names),
        "cases": cases,
    }))
}
