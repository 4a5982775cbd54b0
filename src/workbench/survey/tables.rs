//! The survey for people.

use super::{Cost, Entry, Survey};
use m4gn_model::SegmentMethod;
use m4gn_report::{Table, number};

impl Survey {
    /// Eigenvalues and what they cost, in a line or two; empty without modes.
    pub fn modes_text(&self) -> String {
        let values: Vec<String> = self.modes.eigenvalues.iter().map(|v| number(*v, 5)).collect();
        match values.len() {
            0 => String::new(),
            n => format!(
                "{n} modes in {}: eigenvalues [1/m2] {}\n",
                cost_text(&self.modes_cost),
                values.join(" ")
            ),
        }
    }

    /// One row a segmentation.
    pub fn table(&self) -> Table {
        let mut table = Table::new([
            "method",
            "K",
            "conductance",
            "edge cut",
            "silhouette",
            "with modes",
            "cells a segment",
            "sweeps",
            "seconds",
            "peak MiB",
        ]);
        for e in &self.entries {
            table.row([
                e.method.to_string(),
                e.count.to_string(),
                format!("{:.4}", e.quality.conductance),
                format!("{:.4}", e.quality.edge_cut_ratio),
                format!("{:.4}", e.quality.silhouette),
                e.mode_silhouette.map_or("-".into(), |s| format!("{s:.4}")),
                match e.cells {
                    [low, high] if low == high => low.to_string(),
                    [low, high] => format!("{low}-{high}"),
                },
                sweeps_text(e),
                number(e.cost.seconds, 2),
                mebibytes(e.cost.peak_memory),
            ]);
        }
        table
    }

    /// What the columns mean, methods that were left out, and the suggested numbers of segments.
    pub fn notes(&self) -> String {
        let mut text = String::new();
        if self.entries.iter().any(|e| !e.converged()) {
            text += "* the sweeps were used up before all cells stayed (--set iterations=N)\n";
        }
        if let Some(e) = self.entries.iter().find(|e| e.quality.silhouette_cells < self.n_cells) {
            text += &format!(
                "silhouettes are means over {} of {} cells\n",
                e.quality.silhouette_cells, self.n_cells
            );
        }
        for skipped in &self.skipped {
            text += &format!("{} does not apply: {}\n", skipped.method, skipped.reason);
        }
        let several = self.entries.iter().any(|e| e.count != self.entries[0].count);
        if several {
            let best = SegmentMethod::ALL.iter().filter_map(|&method| self.suggestion(method));
            let best: Vec<String> =
                best.map(|e| format!("{} for {} ({:.4})", e.count, e.method, e.quality.silhouette)).collect();
            text += &format!("suggested K, by the largest silhouette: {}\n", best.join(", "));
        }
        text
    }
}

/// "0.12 s, 61 MiB".
pub fn cost_text(cost: &Cost) -> String {
    match cost.peak_memory {
        Some(_) => format!("{} s, at most {} MiB", number(cost.seconds, 2), mebibytes(cost.peak_memory)),
        None => format!("{} s", number(cost.seconds, 2)),
    }
}

fn mebibytes(bytes: Option<u64>) -> String {
    bytes.map_or("-".into(), |b| format!("{:.0}", b as f64 / 1048576.0))
}

fn sweeps_text(e: &Entry) -> String {
    match (e.sweeps.len(), e.converged()) {
        (0, _) => "-".into(),
        (n, true) => n.to_string(),
        (n, false) => format!("{n}*"),
    }
}
