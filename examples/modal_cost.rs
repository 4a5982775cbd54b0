//! What the modes and the segments of a large mesh cost: seconds and peak memory of this process, as one line of JSON.
//! `bench/modes.py` runs it beside scipy and pymetis.

use clap::{Parser, ValueEnum};
use m4gn_mesh::Mesh;
use m4gn_mesh::parallel::Comm;
use m4gn_model::SegmentSpec;
use m4gn_model::modal::{ModalOptions, ModalSolver};
use m4gn_modes::Modal;
use m4gn_modes::{Mass, laplacian, laplacian_modes};
use m4gn_samples::mesh as sample;
use m4gn_structure::graph::Graph;
use m4gn_structure::segment;
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Clone, Copy, ValueEnum)]
enum Cells {
    Quads,
    Triangles,
    Hexahedra,
    Disk,
}

#[derive(Parser)]
struct Arguments {
    /// Number of cells, as near as the shape allows.
    #[arg(long, default_value_t = 200_000)]
    cells: usize,
    #[arg(long, value_enum, default_value = "quads")]
    shape: Cells,
    #[arg(long, default_value_t = 6)]
    modes: usize,
    /// Segments K; 0: modes only.
    #[arg(long, default_value_t = 36)]
    segments: usize,
    /// auto, direct or iterative; of runs without segments.
    #[arg(long, default_value = "auto")]
    solver: String,
    /// PETSc options; of runs without segments.
    #[arg(long, default_value = "")]
    petsc: String,
    /// Writes the matrices to this HDF5 file (CSR: indptr, indices, data, volumes) and does nothing else.
    #[arg(long)]
    export: Option<PathBuf>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    let mesh = mesh(&arguments);
    let comm = Comm::serial();
    if let Some(path) = &arguments.export {
        return export(&mesh, &comm, path);
    }
    let start = Instant::now();
    let mut graph = Graph::new(&mesh, &comm)?;
    let graph_time = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let found = match arguments.segments {
        0 => {
            let options = ModalOptions {
                solver: ModalSolver::parse(&arguments.solver)?,
                petsc: arguments.petsc,
                ..ModalOptions::fixed(arguments.modes)
            };
            let modes = laplacian_modes(&mesh, &comm, &options)?;
            serde_json::json!({ "eigenvalues": modes.eigenvalues })
        }
        count => {
            let spec = SegmentSpec { count, modes: arguments.modes, ..Default::default() };
            let segments = segment(&mesh, &mut graph, &spec, &Modal::default(), &comm, None)?;
            serde_json::json!({ "segments": segments.count })
        }
    };
    let mut line = serde_json::json!({
        "cells": mesh.n_cells(),
        "graph_s": graph_time,
        "seconds": start.elapsed().as_secs_f64(),
        "peak_mb": peak_mb(),
    });
    if let (Some(line), Some(found)) = (line.as_object_mut(), found.as_object()) {
        line.extend(found.clone());
    }
    println!("{line}");
    Ok(())
}

fn mesh(arguments: &Arguments) -> Mesh {
    let root = |n: f64, power: f64| n.powf(power).round().max(1.0) as usize;
    let cells = arguments.cells as f64;
    match arguments.shape {
        Cells::Quads => sample::rectangle(root(2.0 * cells, 0.5), root(cells / 2.0, 0.5), 2.0, 1.0),
        Cells::Triangles => sample::triangles(root(cells, 0.5), root(cells / 4.0, 0.5), 2.0, 1.0),
        Cells::Hexahedra => sample::block([root(cells, 1.0 / 3.0); 3], [2.0, 1.0, 0.7]),
        Cells::Disk => sample::disk(root(cells / 4.0, 0.5), 2 * root(4.0 * cells, 0.5), 1.0),
    }
}

fn export(mesh: &Mesh, comm: &Comm, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
    let problem = laplacian(mesh, comm)?;
    let rows: Vec<i64> = problem.stiffness.row.iter().map(|&r| r as i64).collect();
    let file = hdf5::File::create(path)?;
    file.new_dataset_builder().with_data(&rows).create("indptr")?;
    let (column, value) = (&problem.stiffness.column, &problem.stiffness.value);
    file.new_dataset_builder().with_data(column).create("indices")?;
    file.new_dataset_builder().with_data(value).create("data")?;
    if let Mass::Diagonal(volumes) = &problem.mass {
        file.new_dataset_builder().with_data(volumes).create("volumes")?;
    }
    Ok(())
}

/// Peak resident memory of this process (VmHWM), MB.
fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kb = line.and_then(|l| l.split_whitespace().next()?.parse::<f64>().ok());
    kb.map_or(f64::NAN, |kb| kb / 1024.0)
}
