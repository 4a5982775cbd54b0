//! `m4gn generate deforming-plate` and `deforming-beam`.

use super::Common;
use crate::number::{poisson, time};
use m4gn_base::plugin::homes;
use m4gn_base::{Error, Result, listed};
use m4gn_workbench::generate::openfoam::{absolute, one_thread};
use m4gn_workbench::generate::process::find_program;
use m4gn_workbench::generate::queue::Made;
use m4gn_workbench::generate::solids::{Family, POISSON, Request, find_python};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub(super) struct SolidArgs {
    #[command(flatten)]
    common: Common,
    /// About how many points a body has [default: as many as in the paper]
    #[arg(long, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    points: Option<u32>,
    /// Poisson's ratio of the material, 0 to 0.49
    #[arg(long, default_value_t = POISSON, value_parser = poisson)]
    poisson: f64,
    /// Frames after the first one; the obstacle's whole way is divided by them
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    frames: u32,
    /// Time between frames, s; it scales velocities and changes nothing else
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, value_parser = time)]
    frame_interval: f64,
}

/// Makes bodies of a family.
pub(super) fn run(solid: &SolidArgs, family: Family, large: bool) -> Result<()> {
    let common = &solid.common;
    if find_program("gmsh").is_none() {
        return Err(Error::Input("gmsh not found in PATH: install it (Debian: apt-get install gmsh)".into()));
    }
    let python = find_python()?;
    let mut environment = one_thread();
    environment.push(("PYTHONPATH".to_string(), package()?.into()));
    environment.push(("PYTHONDONTWRITEBYTECODE".to_string(), "1".into()));
    let command = format!(
        "m4gn generate {}{}{}{} --count {} --seed {} --split {} --frames {} --frame-interval {}",
        family.name(),
        if large { " --large" } else { "" },
        solid.points.map_or(String::new(), |n| format!(" --points {n}")),
        match solid.poisson == POISSON {
            true => String::new(),
            false => format!(" --poisson {}", solid.poisson),
        },
        common.count,
        common.seed,
        common.split,
        solid.frames,
        solid.frame_interval
    );
    let case = |index, split| {
        Ok(Request {
            family,
            large,
            seed: common.seed,
            index,
            points: solid.points,
            poisson: solid.poisson,
            split,
            frames: solid.frames,
            interval: solid.frame_interval,
            command: command.clone(),
            python: python.clone(),
        })
    };
    common.make(absolute(&common.out)?, environment, case, describe)
}

fn describe(case: &Request, made: &Made<Map<String, Value>>) -> (String, Value) {
    let f = &made.figures;
    let line = format!(
        "{:04}  {:<5}  {} points  {} redraws  worst gap {:+.4} cells  {:.1} MB  {:.1} s",
        case.index,
        case.split.name(),
        f.get("points").and_then(Value::as_u64).unwrap_or_default(),
        f.get("redraws").and_then(Value::as_array).map_or(0, Vec::len),
        f.get("worst_gap").and_then(Value::as_f64).unwrap_or(f64::NAN),
        made.bytes as f64 * 1e-6,
        made.seconds
    );
    (line, json!({"index": case.index, "split": case.split.name(), "result": made}))
}

/// The folder that holds the package `m4gn_solids`: beside the libraries.
fn package() -> Result<PathBuf> {
    let folders: Vec<PathBuf> = homes().into_iter().map(|home| home.join("tools")).collect();
    let is_there = |p: &&PathBuf| Path::new(p).join("m4gn_solids/__main__.py").is_file();
    folders.iter().find(is_there).cloned().ok_or_else(|| {
        let tried = listed(folders.iter().map(|p| p.display()));
        Error::Input(format!(
            "the Python package m4gn_solids was not found in {tried}: set M4GN_HOME to the checkout"
        ))
    })
}
