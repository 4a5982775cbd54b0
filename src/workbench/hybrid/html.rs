//! The results as a page: error over processor time, tables.

use super::tables::{case_table, failures, remarks, summary_tables, whole_time};
use super::{DrawResult, Plan};
use m4gn_base::Result;
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::{Chart, Page, Series};

/// Colours of the variants, by turns (Okabe and Ito).
const COLOURS: [(u8, u8, u8); 7] =
    [ORANGE, BLUE, (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233), GREY];

/// Smaller errors are drawn as this one: zero, of a run that is the full one, has no logarithm.
const LEAST_ERROR: f64 = 1e-3;
/// The same of figures.
const LEAST_ANSWER: f64 = 1e-5;

/// The page.
///
/// # Errors
/// Of a chart that cannot be drawn.
pub fn report(plan: &Plan, results: &[DrawResult], variants: &[String], order: &str) -> Result<Page> {
    let s = &plan.schedule;
    let mut page = Page::new(&format!("{}: hybrid runs against the full solver", plan.family.name));
    if plan.answers {
        page.paragraph(&format!(
            "{} draws of seed {}, from rest up to {} s at the latest. Each run but the full one ends where it knows the family's figures. Errors are \
             those of the figures, over the full run's; times are those of the whole run over the full run's.",
            plan.count, plan.seed, s.end
        ));
    } else {
        page.paragraph(&format!(
            "{} draws of seed {}: the solver alone up to {} s, then by turns {} s of the solver and {} strides of the surrogate, up to {} s. \
             Errors, of the velocity or of a solid's displacement, are root mean squares over cells, components and stored times, over those of holding the full run's last \
             field before the first jump. Times of the whole run count start-up and loading; the stretch is what comes after the takeover; both are over the full run's. Forces are relative \
             to the full run's.",
            plan.count, plan.seed, s.start_up, s.solver_time, s.surrogate_steps, s.end
        ));
    }
    page.heading("Error against processor time");
    let least_error = if plan.answers { LEAST_ANSWER } else { LEAST_ERROR };
    let series = variants.iter().enumerate().map(|(i, name)| {
        let points = results.iter().filter_map(|d| {
            let run = d.runs.get(name)?;
            let score = run.score.as_ref()?;
            let error = if plan.answers { score.answer } else { score.end };
            Some((100.0 * whole_time(d, run, |c| c.processor)?, error?.max(least_error)))
        });
        Series {
            name: name.clone(),
            points: points.collect(),
            colour: COLOURS[i % COLOURS.len()],
            dots: true,
        }
    });
    let chart = Chart {
        x_label: "processor time of the whole run / full run [%]".into(),
        y_label: if plan.answers { "largest error of a figure" } else { "error / hold last" }.into(),
        series: series.collect(),
        // Variants are factors apart: a plain solver may have a tenth of the error.
        axis: Axis::Logarithmic,
    };
    page.svg(
        &chart.svg()?,
        &format!(
            "A dot a case, both axes logarithmic (errors below {least_error} are drawn there). Left and low is better{}",
            if plan.answers { "." } else { "; 1 is as bad as holding the last field." }
        ),
    );
    page.heading("Each variant");
    for (title, table) in summary_tables(results, variants, order) {
        page.paragraph(&title);
        page.table(&table);
    }
    page.heading("Each case");
    page.table(&case_table(results, variants, order));
    let remarks = remarks(results);
    if !remarks.is_empty() {
        page.listing(&remarks.join("\n"));
    }
    let failed = failures(results);
    if !failed.is_empty() {
        page.heading("Failed");
        page.listing(&failed.join("\n"));
    }
    Ok(page)
}
