//! `m4gn generate FAMILY`: a family of OpenFOAM cases that is a folder of data.

use super::Common;
use clap::{CommandFactory, FromArgMatches};
use m4gn_base::Result;
use m4gn_workbench::generate::case::FamilyCase;
use m4gn_workbench::generate::family::{self, Family, settings_text};
use m4gn_workbench::generate::openfoam::{environment, plain_path};
use m4gn_workbench::generate::parameter::{Setting, parse_setting};
use serde_json::json;
use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;

/// Options beside the family.
#[derive(Debug, clap::Parser)]
#[command(no_binary_name = true)]
struct Args {
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    set: SetArgs,
    /// Frames after the first one [default: the family's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: Option<u32>,
    /// Time between frames, s [default: the family's]
    #[arg(long, value_name = "SECONDS", value_parser = crate::number::time)]
    frame_interval: Option<f64>,
    /// Time of the first frame, s [default: the family's]
    #[arg(long, value_name = "SECONDS", value_parser = crate::number::time)]
    spin_up: Option<f64>,
}

/// Settings of parameters.
#[derive(Debug, clap::Args)]
pub(crate) struct SetArgs {
    /// Sets a parameter of the family, or draws it between two values; may be given several times
    #[arg(long, value_name = "NAME=VALUE|LOW:HIGH", value_parser = parse_setting)]
    pub(crate) set: Vec<(String, Setting)>,
}

/// Runs the command: the family, then its options. Bad usage ends the program with status 2.
pub(super) fn run(arguments: &[OsString]) -> Result<()> {
    let (name, options) = arguments
        .split_first()
        .ok_or_else(|| m4gn_base::Error::Internal("a family without a name".into()))?;
    let family = Family::find(Path::new(name))?;
    let command = Args::command()
        .bin_name(format!("m4gn generate {}", name.to_string_lossy()))
        .about(family.about.clone())
        .long_about(format!("{}\n\n{}", family.about, family.details.trim()))
        .after_help(format!("Parameters (--set NAME=VALUE):\n{}", family.parameter_help()));
    let args = command
        .try_get_matches_from(options)
        .and_then(|m| Args::from_arg_matches(&m))
        .unwrap_or_else(|e| e.exit());
    make(args, family)
}

fn make(args: Args, family: Family) -> Result<()> {
    let frames = args.frames.unwrap_or(family.recording.frames);
    let interval = args.frame_interval.unwrap_or(family.recording.interval);
    let spin_up = args.spin_up.unwrap_or(family.recording.spin_up);
    family::times(interval, spin_up)?;
    let settings = args.set.set.into_iter().collect();
    // Settings that no case can have are told before anything is looked for.
    let first = family.draw(args.common.seed, 0, &settings)?;
    let environment = environment(&family.programs(&first)?)?;
    let folder = plain_path(&args.common.out)?;
    family.check_outside(&folder)?;
    // Without paths, for provenance
    let command = format!(
        "m4gn generate {} --count {} --seed {} --split {} --frames {frames} --frame-interval {interval} --spin-up {spin_up}{}",
        family.name,
        args.common.count,
        args.common.seed,
        args.common.split,
        settings_text(&settings)
    );
    let family = Arc::new(family);
    let case = |index, split| {
        Ok(FamilyCase {
            family: family.clone(),
            seed: args.common.seed,
            index,
            draw: family.draw(args.common.seed, index, &settings)?,
            split,
            frames,
            interval,
            spin_up,
            command: command.clone(),
        })
    };
    args.common.make(folder, environment, case, |case, made| {
        let line = format!(
            "{:04}  {:<5}  {}  {} cells  {} frames  {:.1} MB  {:.1} s",
            case.index,
            case.split.name(),
            case.draw.text(&case.family.label),
            made.figures.cells,
            made.figures.frames,
            made.bytes as f64 * 1e-6,
            made.seconds
        );
        let parameters: serde_json::Map<_, _> =
            case.draw.values.iter().map(|(name, value)| (name.clone(), json!(value))).collect();
        let derived: serde_json::Map<_, _> = case
            .family
            .derived
            .iter()
            .filter(|d| d.record)
            .map(|d| (d.name.clone(), json!(case.draw.variables[&d.name])))
            .collect();
        let entry = json!({
            "index": case.index, "split": case.split.name(), "parameters": parameters, "derived": derived,
            "result": made,
        });
        (line, entry)
    })
}
