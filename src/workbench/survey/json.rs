//! The survey for programs.

use super::{Cost, Entry, Survey};
use m4gn_model::SegmentMethod;
use serde_json::{Value, json};

impl Survey {
    /// `{"eigenvalues": [...], "methods": [{"method", "k", "conductance", "edge_cut_ratio", "silhouette", ...}],
    /// "skipped": [{"method", "reason"}], "suggested": {method: k}, ...}`; eigenvalues in 1/m^2, ascending.
    pub fn json(&self) -> Value {
        let suggested: serde_json::Map<String, Value> = SegmentMethod::ALL
            .iter()
            .filter_map(|&m| Some((m.name().to_string(), self.suggestion(m)?.count.into())))
            .collect();
        let skipped: Vec<Value> =
            self.skipped.iter().map(|s| json!({ "method": s.method.name(), "reason": s.reason })).collect();
        json!({
            "cells": self.n_cells,
            "eigenvalues": self.modes.eigenvalues,
            "modes": cost(&self.modes_cost),
            "methods": self.entries.iter().map(entry).collect::<Vec<_>>(),
            "skipped": skipped,
            "suggested": suggested,
        })
    }
}

fn entry(e: &Entry) -> Value {
    json!({
        "method": e.method.name(),
        "k": e.count,
        "conductance": e.quality.conductance,
        "edge_cut_ratio": e.quality.edge_cut_ratio,
        "silhouette": e.quality.silhouette,
        "silhouette_with_modes": e.mode_silhouette,
        "silhouette_cells": e.quality.silhouette_cells,
        "sweeps": e.sweeps.len(),
        "converged": e.converged(),
        "reassigned": e.reassigned,
        "smallest": e.cells[0],
        "largest": e.cells[1],
        "seconds": e.cost.seconds,
        "cpu_seconds": e.cost.cpu_seconds,
        "peak_memory_bytes": e.cost.peak_memory,
    })
}

fn cost(cost: &Cost) -> Value {
    json!({ "seconds": cost.seconds, "cpu_seconds": cost.cpu_seconds, "peak_memory_bytes": cost.peak_memory })
}
