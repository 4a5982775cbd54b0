//! What a session on a large 3-D mesh costs, with a node of the network for each cell or for groups of cells: time and
//! memory of the set-up, time of a step. One line of JSON; on several ranks the largest of them.
//!
//!     large_mesh --cells 1000000 --cells-a-group 8 --precision fp32 --save one.f64
//!     mpirun -np 2 large_mesh --cells 1000000 --cells-a-group 8 --precision fp32 --compare one.f64
//!
//! A cube of hexahedra in strips over the ranks, with a flow of the scale of the cube. `--save` writes the velocity after the
//! steps in the order of the undecomposed mesh, `--compare` prints how far it is from such a file: the answer of other ranks, to 1e-5 with `--precision fp32`.

use clap::Parser;
use m4gn_engine::PrecisionChoice;
use m4gn_mesh::files::write_whole;
use m4gn_mesh::parallel::{Comm, finalize};
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_model::{Model, Resolution, SegmentMethod};
use m4gn_samples::mesh as sample;
use m4gn_step::{Field, FieldMut, Session, SessionOptions};
use m4gn_workbench::bench::memory::{Memory, restart_peak};
use m4gn_workbench::bench::{Shape, hexahedra};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(Parser)]
struct Arguments {
    /// Number of cells, as near as a cube comes.
    #[arg(long, default_value_t = 1_000_000)]
    cells: usize,
    /// Cells of a group, about; 1: no groups.
    #[arg(long, default_value_t = 1.0)]
    cells_a_group: f64,
    /// fp32, bf16 or auto.
    #[arg(long, default_value = "auto", value_parser = PrecisionChoice::parse)]
    precision: PrecisionChoice,
    #[arg(long, default_value_t = 64)]
    width: usize,
    #[arg(long, default_value_t = 8)]
    layers: usize,
    #[arg(long, default_value_t = 144)]
    segments: usize,
    #[arg(long, default_value_t = 2)]
    steps: usize,
    /// Writes the velocity after the steps to this file, double precision.
    #[arg(long)]
    save: Option<PathBuf>,
    /// A file of another run's `--save`.
    #[arg(long)]
    compare: Option<PathBuf>,
}

/// A flow of the scale of the cube.
fn velocity(x: [f64; 3]) -> [f64; 3] {
    let [a, b, c] = x.map(|x| std::f64::consts::TAU * x);
    [a.sin() * b.cos(), -a.cos() * b.sin() * c.cos(), 0.3 * c.sin()]
}

fn pressure(x: [f64; 3]) -> f64 {
    x[0] * (std::f64::consts::TAU * x[1]).cos()
}

struct Flow {
    velocity: Vec<f64>,
    pressure: Vec<f64>,
    boundary_velocity: Vec<f64>,
    boundary_pressure: Vec<f64>,
}

impl Flow {
    fn of(mesh: &Mesh) -> Self {
        Flow {
            velocity: mesh.cell_centres.iter().flat_map(|&x| velocity(x)).collect(),
            pressure: mesh.cell_centres.iter().map(|&x| pressure(x)).collect(),
            boundary_velocity: mesh.boundary.iter().flat_map(|b| velocity(b.centre)).collect(),
            boundary_pressure: mesh.boundary.iter().map(|b| pressure(b.centre)).collect(),
        }
    }

    fn step(&mut self, session: &mut Session) -> Result<()> {
        let (cells, p) = (self.velocity.clone(), self.pressure.clone());
        let fields = [
            Field { name: "U", components: 3, cells: &cells, boundary: &self.boundary_velocity },
            Field { name: "p", components: 1, cells: &p, boundary: &self.boundary_pressure },
        ];
        let mut out = [
            FieldMut { name: "U", components: 3, cells: &mut self.velocity },
            FieldMut { name: "p", components: 1, cells: &mut self.pressure },
        ];
        session.step(&fields, &mut out)
    }
}

/// The largest of all ranks. Collective.
fn largest(comm: &Comm, value: f64) -> f64 {
    let mut values = [value];
    comm.max_f64(&mut values);
    values[0]
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let done = measure(&arguments, &Comm::world()?);
    finalize();
    done
}

fn measure(arguments: &Arguments, comm: &Comm) -> Result<()> {
    let (mesh, n) = {
        let whole = hexahedra(arguments.cells)?;
        let n = whole.n_cells();
        (sample::part(&whole, &sample::strips(n, comm.size()), comm.rank()), n)
    };
    let shape = Shape {
        dim: 3,
        layers: arguments.layers,
        width: arguments.width,
        hidden_layers: 1,
        segments: Some(arguments.segments),
    };
    let mut spec = shape.spec();
    // What needs no modes: their cost is in docs/segments.md.
    spec.segments.method = SegmentMethod::Metis;
    let model = Model::random(spec, 1)?;
    let mut flow = Flow::of(&mesh);
    let memory = || Memory::read().map_or((0, 0), |m| (m.now, m.peak));
    let (before, _) = memory();
    restart_peak();
    let options = SessionOptions {
        precision: arguments.precision,
        resolution: match arguments.cells_a_group > 1.0 {
            true => Resolution::Length((arguments.cells_a_group / n as f64).cbrt()),
            false => Resolution::Off,
        },
        ..SessionOptions::default()
    };
    let start = Instant::now();
    let mut session = Session::new(comm.clone(), &mesh, &model, &options)?;
    let set_up = start.elapsed().as_secs_f64();
    let (held, peak) = memory();
    let mut times = Vec::new();
    for _ in 0..arguments.steps {
        comm.barrier();
        let start = Instant::now();
        flow.step(&mut session)?;
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    let step = times.get(times.len() / 2).copied().unwrap_or(0.0);
    let (_, peak_of_steps) = memory();
    let figures = serde_json::json!({
        "ranks": comm.size(),
        "cells": n,
        "groups": session.n_groups(),
        "segments": session.n_segments(),
        "mesh_mib": largest(comm, mib(before)),
        "set_up_s": largest(comm, set_up),
        "set_up_peak_mib": largest(comm, mib(peak.saturating_sub(before))),
        "held_mib": largest(comm, mib(held.saturating_sub(before))),
        "step_ms": 1e3 * largest(comm, step),
        "peak_mib": largest(comm, mib(peak_of_steps.max(peak).saturating_sub(before))),
    });
    let all = in_order(comm, &mesh, &flow.velocity, n);
    let Some(all) = all else { return Ok(()) };
    println!("{figures}");
    if let Some(path) = &arguments.save {
        let bytes: Vec<u8> = all.iter().flat_map(|x| x.to_le_bytes()).collect();
        write_whole(path, &bytes)?;
    }
    match &arguments.compare {
        Some(path) => compare(path, &all),
        None => Ok(()),
    }
}

/// Vectors of all cells in the order of the undecomposed mesh; on the root alone. Collective.
fn in_order(comm: &Comm, mesh: &Mesh, values: &[f64], n: usize) -> Option<Vec<f64>> {
    let (cells, values) = (comm.gather(&mesh.cell_global), comm.gather(values));
    let (cells, values) = cells.zip(values)?;
    let mut all = vec![0.0; 3 * n];
    for (cell, row) in cells.concat().iter().zip(values.concat().as_chunks::<3>().0) {
        all[3 * *cell as usize..][..3].copy_from_slice(row);
    }
    Some(all)
}

fn compare(path: &Path, all: &[f64]) -> Result<()> {
    let bytes = std::fs::read(path).map_err(|e| Error::file(path, e.to_string()))?;
    let other: Vec<f64> = bytes.as_chunks::<8>().0.iter().map(|b| f64::from_le_bytes(*b)).collect();
    if other.len() != all.len() {
        return Err(Error::file(
            path,
            format!("{} values: expected {}, of a run on as many cells", other.len(), all.len()),
        ));
    }
    let largest = all.iter().fold(0f64, |m, x| m.max(x.abs()));
    let off = all.iter().zip(&other).fold(0f64, |m, (a, b)| m.max((a - b).abs()));
    println!("largest difference {off:.3e}, of a largest value of {largest:.3e}: {:.1e}", off / largest);
    Ok(())
}
