//! `m4gn doctor`: what is there, what is missing, and how to mend it.

use super::write_json;
use m4gn_base::{Error, Result};
use m4gn_workbench::generate::openfoam::DEBIAN_OPENFOAM;
use m4gn_workbench::generate::process::find_program;
use std::path::PathBuf;

/// Programs of OpenFOAM that the flows of 'm4gn generate' and 'm4gn hybrid' need.
const PROGRAMS: [&str; 3] = ["gmshToFoam", "changeDictionary", "icoFoam"];

/// Check what is installed, and say how to mend what is missing
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Write the findings to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One finding.
#[derive(serde::Serialize)]
struct Finding {
    what: &'static str,
    found: Option<String>,
    /// Whether the main job (a solver with the function objects) needs it.
    needed: bool,
    /// What it is for, and how to get it.
    mend: &'static str,
}

/// Runs the command.
///
/// # Errors
/// When something is missing that running a solver with the function objects needs.
pub fn run(args: Args) -> Result<()> {
    let findings = findings();
    for f in &findings {
        let state = match (&f.found, f.needed) {
            (Some(_), _) => "ok     ",
            (None, true) => "MISSING",
            (None, false) => "absent ",
        };
        println!("{state}  {:<18} {}", f.what, f.found.as_deref().unwrap_or(f.mend));
    }
    let value = serde_json::to_value(&findings).map_err(|e| Error::Internal(e.to_string()))?;
    write_json(args.json.as_deref(), &value)?;
    let missing: Vec<_> = findings.iter().filter(|f| f.needed && f.found.is_none()).map(|f| f.what).collect();
    if missing.is_empty() {
        return Ok(());
    }
    Err(Error::Input(format!("missing: {}. The lines above say how to get them", missing.join(", "))))
}

fn findings() -> Vec<Finding> {
    let program = |name: &str| find_program(name).map(|p| p.display().to_string());
    let library = |name: &str| {
        let mut files = m4gn_base::plugin::places().into_iter().map(|p| p.join(name));
        files.find(|p| p.is_file()).map(|p| p.display().to_string())
    };
    let missing_programs = PROGRAMS.iter().any(|p| find_program(p).is_none());
    let list = [
        ("m4gn", Some(format!("{} ({})", env!("CARGO_PKG_VERSION"), processor())), true, ""),
        (
            "OpenFOAM",
            openfoam(),
            true,
            "source your OpenFOAM's etc/bashrc, or 'apt-get install openfoam' and set WM_PROJECT_DIR=/usr/share/openfoam",
        ),
        (
            "OpenFOAM programs",
            (!missing_programs).then(|| PROGRAMS.join(", ")),
            true,
            "gmshToFoam, changeDictionary or icoFoam is not in PATH: source your OpenFOAM's etc/bashrc, or 'apt-get install openfoam'",
        ),
        ("libm4gn.so", library("libm4gn.so"), true, "the core that solvers load: './Allrun' builds it"),
        ("libm4gnFoam.so", library("libm4gnFoam.so"), true, "the function objects: './Allrun' builds them"),
        (
            "libm4gnAccelerators.so",
            library("libm4gnAccelerators.so"),
            true,
            "the accelerators, which libm4gnFoam.so links: './Allrun' builds them",
        ),
        (
            "modal library",
            library(m4gn_modes::eigen::LIBRARY.file),
            false,
            "segments made of modes need it (libm4gn_slepc.so, with PETSc and SLEPc): './Allrun' builds it",
        ),
        (
            "OpenFOAM bridge",
            library(m4gn_workbench::foam_case::LIBRARY.file),
            false,
            "only 'm4gn compare' needs it (libm4gn_foam_bridge.so): './Allrun' builds it",
        ),
        (
            "torch library",
            library(m4gn_engine::torch::LIBRARY.file),
            false,
            "only 'm4gn train' on a GPU and backend torch need it (libm4gn_torch.so): docs/training.md",
        ),
        ("MPI", mpi(), true, "Open MPI did not answer: 'apt-get install libopenmpi-dev openmpi-bin'"),
        ("mpirun", program("mpirun"), false, "only parallel runs need it: 'apt-get install openmpi-bin'"),
        ("HDF5", Some(hdf5_version()), true, ""),
        ("gmsh", program("gmsh"), false, "only 'm4gn generate' needs it: 'apt-get install gmsh'"),
        (
            "FElupe",
            m4gn_workbench::generate::solids::find_python().ok(),
            false,
            "only 'm4gn generate deforming-plate', 'deforming-beam' and 'stacked-beams' need it: 'setup/solids.sh' makes its environment",
        ),
    ];
    list.into_iter().map(|(what, found, needed, mend)| Finding { what, found, needed, mend }).collect()
}

/// OpenFOAM's folder, from the environment or Debian's.
fn openfoam() -> Option<String> {
    let set = m4gn_base::plugin::folder_variable("WM_PROJECT_DIR");
    let (folder, how) = match set {
        Some(folder) => (folder, "WM_PROJECT_DIR"),
        None => (PathBuf::from(DEBIAN_OPENFOAM), "Debian's; export WM_PROJECT_DIR to run solvers yourself"),
    };
    let version = std::env::var("WM_PROJECT_VERSION").map_or(String::new(), |v| format!(" {v}"));
    folder.join("etc/controlDict").is_file().then(|| format!("{}{version} ({how})", folder.display()))
}

fn mpi() -> Option<String> {
    let version = m4gn_parallel::library_version()?;
    Some(version.split(',').next().unwrap_or_default().trim().to_string())
}

fn hdf5_version() -> String {
    m4gn_data::hdf5_version()
}

/// What of the processor the native engine can use.
fn processor() -> String {
    #[cfg(target_arch = "x86_64")]
    let features = [
        ("AVX2", std::arch::is_x86_feature_detected!("avx2")),
        ("FMA", std::arch::is_x86_feature_detected!("fma")),
        ("AVX-512", std::arch::is_x86_feature_detected!("avx512f")),
        ("AVX-512 bf16", std::arch::is_x86_feature_detected!("avx512bf16")),
    ];
    #[cfg(not(target_arch = "x86_64"))]
    let features: [(&str, bool); 0] = [];
    let has: Vec<&str> = features.iter().filter(|f| f.1).map(|f| f.0).collect();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let has = if has.is_empty() { "no vector extensions known".to_string() } else { has.join(", ") };
    format!("{cores} cores, {has}")
}
