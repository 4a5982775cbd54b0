//! `m4gn check`: does a case fit?

use super::{claim_outputs, stop_flag, write_json};
use m4gn_base::{Error, Result, listed};
use m4gn_report::number;
use m4gn_workbench::check::{self, Case, Checked, Finding, Plan};
use std::path::PathBuf;

/// Say whether a case fits: what would be handed over, what is refused and why
///
/// The case's own solver runs a few steps in a copy of it, with the function object m4gnSurrogate, which jumps once: what is refused and handed over is
/// decided by the code that decides it in a run. The case stays as it is. Its own function objects are kept, but those of m4gn. A case without
/// a mesh is made ready by the commands of its Allrun before the solver, else by blockMesh. One whose mesh or fields are in the folders of its ranks alone
/// runs on these. Exit status 0: it fits; 1: it does not, with the reason, or it could not be told in this time. See docs/how-to/check-a-case.md.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of an OpenFOAM case, or a family of cases: its name, or a folder with family.toml
    #[arg(value_name = "CASE|FAMILY", value_parser = |text: &str| Case::find(text.as_ref()))]
    case: Case,
    /// Check this model as well (*.safetensors)
    #[arg(long, value_name = "FILE", value_parser = file, conflicts_with = "config")]
    model: Option<PathBuf>,
    /// Check a network of this training configuration (TOML) as well, with random weights
    #[arg(long, value_name = "FILE", value_parser = file)]
    config: Option<PathBuf>,
    /// Wall time of the solver for each surrogate, s
    #[arg(long, value_name = "SECONDS", default_value_t = 6, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    seconds: u64,
    /// Write what was found to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn file(text: &str) -> std::result::Result<PathBuf, String> {
    let path = PathBuf::from(text);
    path.is_file().then_some(path).ok_or_else(|| "there is no such file".into())
}

pub fn run(args: Args) -> Result<()> {
    let _claimed = claim_outputs(
        [args.json.as_deref()],
        [Some(args.case.folder()), args.model.as_deref(), args.config.as_deref()],
    )?;
    let plan = Plan {
        case: args.case,
        model: args.model,
        config: args.config,
        seconds: args.seconds,
        stop: stop_flag()?,
    };
    let checked = check::run(&plan).map_err(of_seconds)?;
    tell(&checked);
    write_json(args.json.as_deref(), &checked)?;
    let unfit = checked.findings.iter().filter(|f| f.why.is_some());
    let (open, refused): (Vec<&Finding>, Vec<&Finding>) = unfit.partition(|f| f.open);
    for (some, what) in [(refused, "does not fit"), (open, "it cannot be told yet whether it fits")] {
        if !some.is_empty() {
            let names = listed(some.iter().map(|f| &f.surrogate));
            return Err(Error::Input(format!("{}: {what} ({names})", checked.case)));
        }
    }
    Ok(())
}

/// The time of programs follows from `--seconds`.
fn of_seconds(error: Error) -> Error {
    let own = |message: String| message.replace("--timeout", "--seconds");
    match error {
        Error::Input(message) => Error::Input(own(message)),
        Error::File { path, message } => Error::File { path, message: own(message) },
        error => error,
    }
}

fn tell(checked: &Checked) {
    let line = |what: &str, text: &str| println!("  {what:<14}{text}");
    let first = &checked.findings[0].report;
    println!("{}: {}", checked.case, checked.application);
    checked.notes.iter().for_each(|note| line("note", note));
    if !first.surrogate.is_empty() {
        let ranks = if first.ranks > 1 { format!(" on {} ranks", first.ranks) } else { String::new() };
        let (start, end, step) = (first.start_time, first.end_time, number(first.delta_t, 3));
        line("run", &format!("{} cells{ranks}, {start} to {end} s, time step {step} s", first.cells));
    }
    for finding in &checked.findings {
        println!("{}: {}", finding.surrogate, finding.verdict());
        of(finding, &line);
    }
    if !first.patches.is_empty() {
        println!("patches of a network's graph");
        first.patches.iter().for_each(|(name, p)| line(name, &format!(" {} ({})", p.node_type, p.kind)));
        if !first.types_refused.is_empty() {
            line("refused", &first.types_refused);
        }
    }
}

fn of(finding: &Finding, line: &dyn Fn(&str, &str)) {
    let report = &finding.report;
    let list = |what: &str, names: &[String]| {
        if !names.is_empty() {
            line(what, &names.join(", "));
        }
    };
    list("handed over", &report.handed_over);
    list("with them", &report.beside);
    list("frozen", &report.frozen);
    finding.notes.iter().for_each(|note| line("said", note));
    if report.steps_after > 0 {
        line(
            "then",
            &format!(
                "{} further steps of the solver, up to time {} s",
                report.steps_after,
                number(report.time, 3)
            ),
        );
    }
    if let Some(seconds) = report.a_step() {
        line("a step", &format!("{} s of wall time", number(seconds, 2)));
    }
    if finding.surrogate == "dmd" && !report.handed_over.is_empty() {
        dmd(finding, line);
    } else if report.memory_after > report.memory_before {
        line(
            "memory",
            &format!(
                "{} MiB beyond the solver's first {}",
                mib(report.memory_after - report.memory_before),
                mib(report.memory_before)
            ),
        );
    }
}

fn dmd(finding: &Finding, line: &dyn Fn(&str, &str)) {
    let report = &finding.report;
    match report.suggestion() {
        Some(s) => {
            line("suggested", &format!("{}: {}", s.entries(), s.why));
            let memory = mib(report.window_memory(s.window));
            line("memory", &format!("up to {memory} MiB on all ranks for a window of {}", s.window));
            if let Some(seconds) = finding.stride {
                line("a stride", &format!("{} s with that window", number(seconds, 2)));
            }
        }
        None => {
            line("suggested", "nothing: the run has too few time steps for a window of states and a jump")
        }
    }
}

fn mib(bytes: f64) -> String {
    format!("{:.1}", bytes / f64::from(1 << 20))
}
