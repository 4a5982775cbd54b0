//! `m4gn generate cylinder-flow`.

use super::openfoam::{environment, plain_path};
use super::{Common, positive};
use crate::generate::case::PROGRAMS;
use crate::generate::cylinder::{CaseFiles, MeshSize, Parameters};
use crate::{Error, Result};
use serde_json::json;

/// Laminar flow around a cylinder in a channel of 1.6 m x 0.41 m (the paper's CylinderFlow)
///
/// Cylinder centre x 0.2 to 0.45 m, y 0.13 to 0.28 m, radius 0.035 to 0.07 m, parabolic inlet of 0.9 to 2.2 m/s
/// on the centreline, nu 1e-3 m^2/s. Recorded are U and p at the spin-up time and --frames times after it. Needs
/// gmsh, and icoFoam and its tools, in PATH.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    common: Common,
    /// Refinement: about 900, 1750 or 3600 triangles
    #[arg(long, value_enum, default_value_t = MeshSize::Standard)]
    mesh: MeshSize,
    /// Frames after the first one
    #[arg(long, default_value_t = 600, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Time between frames, s
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, value_parser = positive)]
    frame_interval: f64,
    /// Time of the first frame, s
    #[arg(long, value_name = "SECONDS", default_value_t = 1.0, value_parser = positive)]
    spin_up: f64,
}

/// Runs the command.
///
/// # Errors
/// As [`super::run`].
pub(super) fn run(args: Args) -> Result<()> {
    if args.spin_up / args.frame_interval < 1.0 {
        return Err(Error::Input(
            "--spin-up must be at least one --frame-interval".into(),
        ));
    }
    let environment = environment(&PROGRAMS)?;
    let folder = plain_path(&args.common.out)?;
    let case = |index, split| CaseFiles {
        seed: args.common.seed,
        index,
        parameters: Parameters::draw(args.common.seed, index),
        mesh: args.mesh,
        split,
        frames: args.frames,
        interval: args.frame_interval,
        spin_up: args.spin_up,
        command: command(&args),
    };
    args.common.make(
        folder,
        environment,
        case,
        |case, made| {
            let p = &case.parameters;
            let line = format!(
                "{:04}  {:<5}  Re {:>5.1}  {} cells  {} frames  {:.1} MB  {:.1} s",
                case.index,
                case.split.name(),
                p.reynolds(),
                made.figures.cells,
                made.figures.frames,
                made.bytes as f64 * 1e-6,
                made.seconds
            );
            let entry = json!({
                "index": case.index, "split": case.split.name(), "parameters": p, "reynolds": p.reynolds(),
                "result": made,
            });
            (line, entry)
        },
        |_| (String::new(), json!({})),
    )
}

/// The command without paths, for provenance.
fn command(args: &Args) -> String {
    format!(
        "m4gn generate cylinder-flow --count {} --seed {} --mesh {} --split {} --frames {} --frame-interval {} --spin-up {}",
        args.common.count,
        args.common.seed,
        args.mesh.name(),
        args.common.split,
        args.frames,
        args.frame_interval,
        args.spin_up
    )
}
