//! Segmentations of one mesh side by side: methods and numbers of segments, their quality, cost, and the number of
//! segments that the silhouette suggests (paper, appendix C.3 and D.2).

mod json;
mod picture;
mod tables;

pub use picture::{Pictured, picture};
pub use tables::cost_text;

use crate::bench::memory::{Memory, restart_peak};
use crate::bench::processor_time;
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::modal::{ModalSource, Modes};
use m4gn_model::{SegmentMethod, SegmentSpec};
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_structure as segments;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Dissimilarity, Quality};
use std::time::Instant;

/// What is compared.
#[derive(Clone, Debug)]
pub struct Options {
    /// Everything but `method` and `count`, the same for all.
    pub spec: SegmentSpec,
    /// Methods, each once.
    pub methods: Vec<SegmentMethod>,
    /// Numbers of segments, ascending, each once.
    pub counts: Vec<usize>,
}

/// What something cost.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cost {
    /// Wall time, s.
    pub seconds: f64,
    /// Processor time, s.
    pub cpu_seconds: f64,
    /// Largest resident memory of the process while it was done, bytes, where the system says.
    pub peak_memory: Option<u64>,
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
}

/// One segmentation.
#[derive(Clone, Debug)]
pub struct Entry {
    /// Its method.
    pub method: SegmentMethod,
    /// K.
    pub count: usize,
    /// Conductance, edge-cut ratio, silhouette of positions.
    pub quality: Quality,
    /// Silhouette of modes and positions; none without modes.
    pub mode_silhouette: Option<f64>,
    /// Cells that each SLIC sweep moved; empty for METIS.
    pub sweeps: Vec<usize>,
    /// Cells given to another segment to make all of them connected.
    pub reassigned: usize,
    /// Time and memory, without the modes.
    pub cost: Cost,
    /// Cells of the smallest and the largest segment.
    pub cells: [usize; 2],
    /// Segment of each cell.
    pub labels: Vec<i32>,
}

impl Entry {
    /// Whether the last sweep moved no cell.
    pub fn converged(&self) -> bool {
        self.sweeps.last().is_none_or(|&moved| moved == 0)
    }
}

/// A method that this mesh has no use for.
#[derive(Clone, Debug)]
pub struct Skipped {
    /// The method.
    pub method: SegmentMethod,
    /// Why.
    pub reason: String,
}

/// The result.
#[derive(Clone, Debug)]
pub struct Survey {
    /// Cells of the mesh.
    pub n_cells: usize,
    /// Modes; none where all methods do without.
    pub modes: Modes,
    /// Time and memory of the modes.
    pub modes_cost: Cost,
    /// All segmentations: by number of segments, then by method.
    pub entries: Vec<Entry>,
    /// Methods that do not apply.
    pub skipped: Vec<Skipped>,
}

impl Survey {
    /// Segments `mesh` in all ways. `progress` is called before each with the number of those done and of all, and
    /// may stop the work.
    ///
    /// # Errors
    /// [`Error::Input`] for a number of segments out of range or if no method applies; what segmentation and
    /// `progress` fail with.
    pub fn run(
        mesh: &Mesh,
        graph: &mut Graph,
        options: &Options,
        comm: &Comm,
        mut progress: impl FnMut(usize, usize, &str) -> Result<()>,
    ) -> Result<Survey> {
        let total = options.methods.len() * options.counts.len() + 1;
        progress(0, total, "modes")?;
        let (modal, count) = (Modal(options.spec.modal()), options.spec.modes);
        let elastic = comm.agree(options.spec.is_elastic(mesh))?;
        let (modes, modes_cost) = Cost::of(|| modal.of_mesh(mesh, elastic, count, comm))?;
        let mut survey =
            Survey { n_cells: mesh.n_cells(), modes, modes_cost, entries: Vec::new(), skipped: Vec::new() };
        let mut done = 1;
        for &count in &options.counts {
            for &method in &options.methods {
                progress(done, total, &format!("{method}, K = {count}"))?;
                done += 1;
                if survey.skipped.iter().any(|s| s.method == method) {
                    continue;
                }
                let spec = SegmentSpec { method, count, ..options.spec.clone() };
                match survey.entry(mesh, graph, &spec, comm) {
                    Ok(entry) => survey.entries.push(entry),
                    Err(Error::Input(reason)) if method.uses_obstacle() => {
                        survey.skipped.push(Skipped { method, reason })
                    }
                    Err(e) => return Err(e),
                }
            }
        }
        match survey.skipped.first() {
            Some(skipped) if survey.entries.is_empty() => Err(Error::Input(skipped.reason.clone())),
            _ => Ok(survey),
        }
    }

    fn entry(&self, mesh: &Mesh, graph: &mut Graph, spec: &SegmentSpec, comm: &Comm) -> Result<Entry> {
        let (segmentation, cost) =
            Cost::of(|| segments::segment_by_modes(mesh, graph, spec, &self.modes, comm))?;
        let labels = segmentation.node_segment[..mesh.n_cells()].to_vec();
        let mut of = |d| segments::quality(mesh, graph, &labels, spec.count, d, comm);
        let quality = of(Dissimilarity::Positions)?;
        let mode_silhouette = match self.modes.vectors.is_empty() {
            true => None,
            false => Some(of(Dissimilarity::Features(&self.modes))?.silhouette),
        };
        let mut sizes = vec![0usize; spec.count];
        labels.iter().for_each(|&l| sizes[l as usize] += 1);
        Ok(Entry {
            method: spec.method,
            count: spec.count,
            quality,
            mode_silhouette,
            sweeps: segmentation.sweeps,
            reassigned: segmentation.reassigned,
            cost,
            cells: [sizes.iter().copied().min().unwrap_or(0), sizes.iter().copied().max().unwrap_or(0)],
            labels,
        })
    }

    /// The segmentation with this method and number of segments.
    pub fn find(&self, method: SegmentMethod, count: usize) -> Option<&Entry> {
        self.entries.iter().find(|e| e.method == method && e.count == count)
    }

    /// The number of segments whose silhouette is largest, of equals the smallest; a guess to begin with, as the
    /// paper's appendix D.2 has it. None for a method without entries.
    pub fn suggestion(&self, method: SegmentMethod) -> Option<&Entry> {
        let entries = self.entries.iter().filter(|e| e.method == method);
        entries.reduce(|best, e| if e.quality.silhouette > best.quality.silhouette { e } else { best })
    }
}

#[cfg(test)]
mod tests;
