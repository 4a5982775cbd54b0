//! `m4gn generate vibrating-beam`.

use super::Common;
use super::openfoam::{environment, plain_path};
use crate::Result;
use crate::generate::beam::{BeamFiles, PROGRAMS, Parameters};
use serde_json::json;

/// Free vibration of a clamped beam of 0.6 m x 0.06 m with OpenFOAM's solidDisplacementFoam
///
/// Plane stress, E 1 MPa, nu 0.3, rho 1000 kg/m^3, 40 x 8 cells; the first bending mode has 0.86 Hz. The motion begins
/// as a mixture of the first three bending modes, with up to 25, 2 and 0.3 mm at the tip and random phases. Recorded
/// are D and its rate ddt(D) at 0.02 s and --frames times after it, every 0.01 s; the solver's step is 0.001 s. Needs
/// solidDisplacementFoam, blockMesh and setExprFields in PATH.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    common: Common,
    /// Frames after the first one
    #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
}

/// Runs the command.
///
/// # Errors
/// As [`super::run`].
pub(super) fn run(args: Args) -> Result<()> {
    let environment = environment(&PROGRAMS)?;
    let folder = plain_path(&args.common.out)?;
    let command = format!(
        "m4gn generate vibrating-beam --count {} --seed {} --split {} --frames {}",
        args.common.count, args.common.seed, args.common.split, args.frames
    );
    let case = |index, split| BeamFiles {
        seed: args.common.seed,
        index,
        parameters: Parameters::draw(args.common.seed, index),
        split,
        frames: args.frames,
        command: command.clone(),
    };
    args.common.make(
        folder,
        environment,
        case,
        |case, made| {
            let [a, b, c] = case.parameters.amplitude.map(|a| 1e3 * a);
            let line = format!(
                "{:04}  {:<5}  modes of {a:.2}, {b:.2}, {c:.3} mm  {} cells  {} frames  {:.1} MB  {:.1} s",
                case.index,
                case.split.name(),
                made.figures.cells,
                made.figures.frames,
                made.bytes as f64 * 1e-6,
                made.seconds
            );
            let entry = json!({
                "index": case.index, "split": case.split.name(), "parameters": case.parameters, "result": made,
            });
            (line, entry)
        },
        |_| (String::new(), json!({})),
    )
}
