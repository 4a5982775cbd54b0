//! The comparison as tables and as a page with charts and pictures.

use super::series::Row;
use super::{Comparison, DEFAULT_PATCH, tables};
use crate::errors::FieldErrors;
use crate::foam_case::Polygons;
use m4gn_base::Result;
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::{CellMap, Chart, Page, Series, Snapshot, Table, figure, number, percent, seconds};

/// Horizons of the tables, in stored times.
const HORIZONS: [usize; 6] = [1, 2, 5, 10, 20, 50];

pub(super) fn figures(rows: Vec<Row>) -> Table {
    let mut table = Table::new(["", "full", "hybrid", "error"]);
    for (name, both, error) in rows {
        let [a, b] = both.map(|v| figure(v, 4));
        table.row([name, a, b, error]);
    }
    table
}

/// A chart of something over time in both runs.
pub(super) fn both_runs(
    page: &mut Page,
    label: &str,
    times: &[f64],
    [a, b]: [&[f64]; 2],
    caption: &str,
) -> Result<()> {
    let series = vec![Series::new("full", times, a, BLUE), Series::new("hybrid", times, b, ORANGE)];
    over_time(page, label, series, Axis::Range, caption)
}

fn over_time(page: &mut Page, label: &str, series: Vec<Series>, axis: Axis, caption: &str) -> Result<()> {
    let chart = Chart { x_label: "t [s]".into(), y_label: label.into(), series, axis };
    page.svg(&chart.svg()?, caption);
    Ok(())
}

/// Errors of a field, in a unit, up to horizons 1, 2, 5, 10, 20, 50 and all, as far as the run goes.
fn error_table(of: &str, times: &[f64], errors: &FieldErrors) -> Table {
    let mut table = Table::new([
        "horizon".to_string(),
        "until [s]".to_string(),
        format!("hybrid [{of}]"),
        format!("hold last [{of}]"),
        "ratio".to_string(),
    ]);
    let last = times.len() - 1;
    for i in HORIZONS.iter().map(|h| h - 1).filter(|&h| h < last).chain([last]) {
        let name = match i == last {
            true => format!("RMSE-all ({})", i + 1),
            false => format!("RMSE-{}", i + 1),
        };
        let (hybrid, hold) = (errors.rmse[i], errors.hold_last_rmse[i]);
        let ratio = figure((hold > 0.0).then(|| hybrid / hold), 3);
        table.row([name, seconds(times[i]), number(hybrid, 3), number(hold, 3), ratio]);
    }
    table
}

impl Comparison {
    /// Errors at the horizons, a table a field, the headline's first.
    pub fn error_tables(&self) -> Vec<Table> {
        let [_, field, unit] = self.names();
        let headline = error_table(&format!("{field}, {unit}"), &self.times, &self.headline);
        let others = self.fields.iter();
        let others = others.map(|(name, f)| error_table(name, &self.times, f));
        std::iter::once(headline).chain(others).collect()
    }

    /// Forces, motion and frequency.
    pub fn figure_table(&self) -> Option<Table> {
        let forces = self.forces.iter().flat_map(|f| f.rows());
        let motion = self.motion.iter().flat_map(|m| m.rows());
        let reaction = self.reaction.iter().flat_map(|r| r.rows());
        let rows: Vec<Row> = forces.chain(motion).chain(reaction).chain(tables::rows(&self.probes)).collect();
        (!rows.is_empty()).then(|| figures(rows))
    }

    /// What the tables do not say, a line each.
    pub fn notes(&self) -> Vec<String> {
        let mut notes: Vec<String> = self.cost.note().into_iter().collect();
        if let Some(motion) = &self.motion {
            notes.push(format!("followed: {}", motion.point_text()));
            notes.extend(self.reaction.as_ref().and_then(|r| r.left_out_text()));
            notes.push(match motion.periods {
                Some(periods) => format!("over {} periods", number(periods, 3)),
                None => "no frequency: the cell does not oscillate over at least 1.5 periods".into(),
            });
        }
        notes.extend(self.replaced());
        notes.extend(self.phase_free.map(|free| {
            let [_, field, unit] = self.names();
            let last = self.headline.error.last().copied().unwrap_or_default();
            format!(
                "the last {field} has an error of {} {unit}, or {} {unit} but for a phase that is {} of a period {}",
                number(last, 3),
                number(free.error, 3),
                number(free.shift.abs(), 2),
                if free.shift < 0.0 { "behind" } else { "ahead" },
            )
        }));
        notes.extend(self.forces.iter().flat_map(|f| f.notes(&self.times)));
        notes.extend(self.no_forces.iter().map(|why| format!("no forces on patch {DEFAULT_PATCH}: {why}")));
        notes
    }

    fn replaced(&self) -> Option<String> {
        let fraction = Some(self.replaced_fraction?);
        Some(format!("replaced {} of the simulated time after start-up", percent(fraction)))
    }

    /// The report, with the magnitudes of the headline in both runs and their difference, one row a snapshot, where there is a 2-D mesh.
    ///
    /// # Errors
    /// Of a chart or a picture that cannot be made.
    pub fn report(&self, polygons: &Polygons, snapshots: &[Snapshot]) -> Result<Page> {
        let mut page = Page::new("Hybrid run against the full run");
        let [name, field, unit] = self.names();
        page.heading("Time");
        page.table(&self.cost.table());
        self.notes().iter().for_each(|line| page.paragraph(&format!("{line}.")));

        page.heading(&format!("Error of the {name}"));
        page.paragraph(&format!(
            "Root mean square over {} cells and the solved components{}, over the stored times from the takeover at {} s up to the \
             horizon. Hold last: the full run's field at the takeover, kept. The full run's own root-mean-square {name} \
             is {} {unit}.",
            self.cells,
            if self.fields.contains_key("sigma") { " (of sigma all nine)" } else { "" },
            seconds(self.takeover),
            number(self.headline.rms, 3)
        ));
        self.error_tables().iter().for_each(|t| page.table(t));
        let h = &self.headline;
        let charts = [
            (
                format!("error of {field} [{unit}]"),
                [&h.hold_last_error, &h.error],
                "Error at each stored time.",
            ),
            (
                format!("RMSE of {field} up to t [{unit}]"),
                [&h.hold_last_rmse, &h.rmse],
                "The same over all stored times up to t.",
            ),
        ];
        for (label, [hold, hybrid], caption) in charts {
            let series = vec![
                Series::new("hold last", &self.times, hold, GREY),
                Series::new("hybrid", &self.times, hybrid, ORANGE),
            ];
            over_time(&mut page, &label, series, Axis::FromZero, caption)?;
        }

        page.heading("Fields");
        match CellMap::new(&polygons.start, &polygons.points).filter(|_| !snapshots.is_empty()) {
            Some(map) => page.snapshots(&map, ["full", "hybrid"], [field, unit], snapshots)?,
            None => page.paragraph("Pictures are drawn of 2-D flows (with empty patches) only."),
        }

        if let Some(table) = self.figure_table() {
            page.heading("Forces and motion");
            page.table(&table);
        }
        if let Some(forces) = &self.forces {
            forces.report(&self.times, &mut page)?;
        }
        if let Some(motion) = &self.motion {
            motion.report(&self.times, &mut page)?;
        }
        if let Some(reaction) = &self.reaction {
            reaction.report(&mut page)?;
        }

        page.heading("Where this comes from");
        page.paragraph(&format!("Full: {}. Hybrid: {}.", self.case_a, self.case_b));
        if let Some(summary) = &self.surrogate {
            page.listing(&serde_json::to_string_pretty(summary).unwrap_or_default());
        }
        Ok(page)
    }
}
