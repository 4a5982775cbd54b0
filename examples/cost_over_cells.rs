//! What a step of a model costs over the number of cells, with a node of the network for each cell and with groups of cells
//! (docs/how-it-works.md).
//!
//!     m4gn generate cylinder-flow --count 1 --seed 9 --frames 10 --spin-up 0.01 --set cells=12 --out mesh12
//!     cost_over_cells --model models/cylinder-flow.safetensors --chart cost.svg mesh*/0000.h5
//!
//! A line of JSON for each trajectory: medians of the rounds, in each of which both ways take their steps by turns.

use clap::Parser;
use m4gn_data::Trajectory;
use m4gn_engine::PrecisionChoice;
use m4gn_mesh::files::write_whole;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::{Model, Resolution};
use m4gn_report::chart::{Axis, BLUE, Chart, ORANGE, Series};
use m4gn_step::{Session, SessionOptions};
use m4gn_workbench::validate::{Scene, fits, stepper};
use std::path::{Path, PathBuf};

#[derive(Parser)]
struct Arguments {
    #[arg(long)]
    model: PathBuf,
    /// fp32, bf16 or auto.
    #[arg(long, default_value = "fp32", value_parser = PrecisionChoice::parse)]
    precision: PrecisionChoice,
    #[arg(long, default_value_t = 5)]
    rounds: usize,
    /// The figures as a chart (SVG).
    #[arg(long)]
    chart: Option<PathBuf>,
    /// Trajectories (*.h5), a mesh each.
    #[arg(required = true)]
    trajectories: Vec<PathBuf>,
}

/// Of one mesh; times in ms.
struct Cost {
    cells: usize,
    groups: usize,
    on_cells: f64,
    on_groups: f64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let model = Model::read(&arguments.model)?;
    let measured = arguments.trajectories.iter().map(|path| {
        let cost = measure(&arguments, &model, path)?;
        println!(
            "{}",
            serde_json::json!({
                "cells": cost.cells,
                "groups": cost.groups,
                "cells_ms": cost.on_cells,
                "groups_ms": cost.on_groups,
            })
        );
        Ok(cost)
    });
    let mut costs = measured.collect::<Result<Vec<Cost>>>()?;
    costs.sort_by_key(|c| c.cells);
    match &arguments.chart {
        Some(path) => write_whole(path, chart(&costs, model.spec.stride).svg()?.as_bytes()),
        None => Ok(()),
    }
}

fn measure(arguments: &Arguments, model: &Model, path: &Path) -> Result<Cost> {
    let trajectory = Trajectory::open(path)?;
    let pace = fits(model, &trajectory)?;
    let scene = Scene::read(&trajectory, &model.spec.fields, pace)?;
    let session = |resolution| {
        let options =
            SessionOptions { precision: arguments.precision, resolution, ..SessionOptions::default() };
        Session::new(Comm::serial(), trajectory.mesh(), model, &options)
    };
    let mut both = [session(Resolution::Off)?, session(Resolution::Auto)?];
    let groups = both[1].n_groups();
    let mut times = [Vec::new(), Vec::new()];
    // The first round warms the caches
    for round in 0..=arguments.rounds {
        for (session, times) in both.iter_mut().zip(&mut times) {
            let mut seconds = (0.0, 0);
            let steps = (0, pace.steps);
            let ended = scene.roll(
                steps,
                &mut stepper(session, &trajectory, &mut Vec::new()),
                &mut seconds,
                &mut |_, _| Ok(()),
            )?;
            if let Some(why) = ended {
                return Err(Error::Numerical(format!("{}: {why}", path.display())));
            }
            if round > 0 {
                times.push(1e3 * seconds.0 / seconds.1 as f64);
            }
        }
    }
    let [on_cells, on_groups] = times.map(|mut t| {
        t.sort_by(f64::total_cmp);
        t[t.len() / 2]
    });
    Ok(Cost { cells: trajectory.mesh().n_cells(), groups, on_cells, on_groups })
}

fn chart(costs: &[Cost], stride: f64) -> Chart {
    let cells: Vec<f64> = costs.iter().map(|c| c.cells as f64).collect();
    let series = |name: &str, value: &dyn Fn(&Cost) -> f64, colour| {
        Series::new(name, &cells, &costs.iter().map(value).collect::<Vec<_>>(), colour)
    };
    Chart {
        x_label: "cells".into(),
        y_label: format!("ms for {stride} s"),
        series: vec![
            series("node a cell", &|c| c.on_cells, ORANGE),
            series("groups", &|c| c.on_groups, BLUE),
        ],
        axis: Axis::BothLogarithmic,
    }
}
