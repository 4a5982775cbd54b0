//! One segmentation of a mesh: its modes, its quality (paper, appendix C.3), and what it cost.

use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_model::SegmentSpec;
use m4gn_model::modal::{ModalSource, Modes};
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_report::number;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Quality, Segmentation, quality, segment_by_modes};
use m4gn_workbench::bench::memory::{Memory, restart_peak};
use m4gn_workbench::bench::processor_time;
use serde_json::{Value, json};
use std::fmt;
use std::time::Instant;

/// What something cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Wall time, s.
    seconds: f64,
    /// Processor time, s.
    cpu_seconds: f64,
    /// Largest resident memory of the process while it was done, bytes, where the system says.
    peak_memory: Option<u64>,
}

impl Cost {
    /// Of `work`.
    pub fn of<T>(work: impl FnOnce() -> Result<T>) -> Result<(T, Cost)> {
        restart_peak();
        let (start, before) = (Instant::now(), processor_time());
        let result = work()?;
        let cost = Cost {
            seconds: start.elapsed().as_secs_f64(),
            cpu_seconds: processor_time() - before,
            peak_memory: Memory::read().map(|m| m.peak),
        };
        Ok((result, cost))
    }

    fn json(&self) -> Value {
        json!({ "seconds": self.seconds, "cpu_seconds": self.cpu_seconds, "peak_memory_bytes": self.peak_memory })
    }
}

/// "0.12 s, at most 61 MiB".
impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{} s", number(self.seconds, 2))?;
        self.peak_memory.map_or(Ok(()), |b| write!(f, ", at most {:.0} MiB", b as f64 / 1048576.0))
    }
}

/// A segmentation.
pub struct Cut {
    /// Modes of the mesh.
    pub modes: Modes,
    /// Segment of each cell.
    pub labels: Vec<i32>,
    /// Directions of a mode of an elastic body, each of which is a vector of `modes`; none of modes of the Laplacian.
    directions: Option<usize>,
    spec: SegmentSpec,
    quality: Quality,
    segmentation: Segmentation,
    /// Of the modes, and of the segments without the modes.
    cost: [Cost; 2],
}

impl Cut {
    /// Cuts the mesh as `spec` says.
    pub fn new(mesh: &Mesh, graph: &mut Graph, spec: &SegmentSpec, comm: &Comm) -> Result<Self> {
        let elastic = comm.agree(spec.is_elastic(mesh))?;
        let (modes, for_modes) = Cost::of(|| Modal(spec.modal()).of_mesh(mesh, elastic, spec.modes, comm))?;
        let (segmentation, for_segments) = Cost::of(|| segment_by_modes(mesh, graph, spec, &modes, comm))?;
        let labels = segmentation.node_segment[..mesh.n_cells()].to_vec();
        let quality = quality(mesh, graph, &labels, spec.count, comm)?;
        let cost = [for_modes, for_segments];
        let directions = elastic.then_some(mesh.dim());
        Ok(Cut { modes, labels, directions, spec: spec.clone(), quality, segmentation, cost })
    }

    /// Eigenvalues, ascending, one of each mode, and their unit.
    pub fn eigenvalues(&self) -> (Vec<f64>, &'static str) {
        let (directions, unit) = self.directions.map_or((1, "1/m2"), |n| (n, "1/s2"));
        (self.modes.eigenvalues.iter().step_by(directions.max(1)).copied().collect(), unit)
    }

    /// Whether the last sweep moved nothing.
    fn converged(&self) -> bool {
        self.segmentation.sweeps.last().is_none_or(|&moved| moved == 0)
    }

    /// Cells of the smallest and of the largest segment.
    fn sizes(&self) -> [usize; 2] {
        let mut sizes = vec![0; self.spec.count];
        self.labels.iter().for_each(|&l| sizes[l as usize] += 1);
        [sizes.iter().copied().min().unwrap_or(0), sizes.iter().copied().max().unwrap_or(0)]
    }

    /// For people.
    pub fn text(&self) -> String {
        let (values, unit) = self.eigenvalues();
        let values: Vec<String> = values.iter().map(|v| number(*v, 5)).collect();
        let mut text = match values.len() {
            0 => String::new(),
            n => format!("{n} modes in {}: eigenvalues [{unit}] {}\n", self.cost[0], values.join(" ")),
        };
        let (q, [smallest, largest], cells) = (&self.quality, self.sizes(), self.labels.len());
        text += &format!(
            "{}, {} segments of {smallest} to {largest} cells in {}: conductance {:.4}, edge cut {:.4}, silhouette {:.4}\n",
            self.spec.method, self.spec.count, self.cost[1], q.conductance, q.edge_cut_ratio, q.silhouette
        );
        if self.spec.method.uses_modes() {
            let share = 100.0 * self.segmentation.moved as f64 / cells as f64;
            text += &format!("{} % of the cells are not where METIS had put them\n", number(share, 2));
        }
        if q.silhouette_cells < cells {
            text += &format!("the silhouette is the mean over {} of {cells} cells\n", q.silhouette_cells);
        }
        if !self.converged() {
            let sweeps = self.segmentation.sweeps.len();
            text +=
                &format!("the {sweeps} sweeps were used up before all cells stayed (--set iterations=N)\n");
        }
        text
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let [smallest, largest] = self.sizes();
        json!({
            "cells": self.labels.len(),
            "eigenvalues": self.eigenvalues().0,
            "method": self.spec.method.name(),
            "k": self.spec.count,
            "conductance": self.quality.conductance,
            "edge_cut_ratio": self.quality.edge_cut_ratio,
            "silhouette": self.quality.silhouette,
            "silhouette_cells": self.quality.silhouette_cells,
            "sweeps": self.segmentation.sweeps.len(),
            "converged": self.converged(),
            "moved": self.segmentation.moved,
            "reassigned": self.segmentation.reassigned,
            "smallest": smallest,
            "largest": largest,
            "modes_cost": self.cost[0].json(),
            "segments_cost": self.cost[1].json(),
        })
    }
}
