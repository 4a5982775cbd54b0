//! `m4gn generate cylinder-flow`.

use super::super::{library_path, library_places};
use super::{Common, absolute, one_thread, positive};
use crate::generate::case::PROGRAMS;
use crate::generate::cylinder::{CaseFiles, MeshSize, Parameters};
use crate::generate::process::find_program;
use crate::{Error, Result};
use serde_json::json;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

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
    let environment = environment()?;
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
    let mut variables = one_thread();
    variables.push(("LD_LIBRARY_PATH".to_string(), libraries));
    if std::env::var_os("WM_PROJECT_DIR").is_none_or(|v| v.is_empty()) {
        variables.push((
            "WM_PROJECT_DIR".to_string(),
            super::super::doctor::DEBIAN_OPENFOAM.into(),
        ));
    }
    Ok(variables)
}

/// The folder's full path, which OpenFOAM can only use without blanks and quotes.
fn plain_path(folder: &Path) -> Result<PathBuf> {
    let path = absolute(folder)?;
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
