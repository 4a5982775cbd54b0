//! What came of a campaign: a table of all figures, and a page.

use super::record::{Cost, DONE, Figure, Record, State};
use super::settings::Quantity;
use super::table::{NAME, OF_RESULTS, csv_text, number as as_number};
use super::{Campaign, Unit};
use m4gn_base::{Result, files, listed};
use m4gn_report::chart::{Axis, BLUE, ORANGE};
use m4gn_report::{Chart, Page, Series, Table, number};
use std::collections::BTreeSet;
use std::path::PathBuf;

/// What was written.
#[derive(Clone, Debug)]
pub struct Report {
    /// The table of all figures.
    pub csv: PathBuf,
    /// The page.
    pub html: PathBuf,
    /// Runs that are there, and all.
    pub there: (usize, usize),
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// A run and what it left.
struct Run {
    name: String,
    unit: Unit,
    record: Record,
}

/// Writes `results.csv` and `report.html` of the runs that are there.
///
/// # Errors
/// [`m4gn_base::Error::File`] for a record that is damaged, and where a file cannot be written.
pub fn report(campaign: &Campaign) -> Result<Report> {
    let (mut runs, mut notes, mut failed) = (Vec::new(), Vec::new(), 0.0);
    let mut units = campaign.units();
    units.sort_by_key(|u| (u.row, u.check));
    for &unit in &units {
        let name = campaign.name(unit);
        match campaign.state(unit)? {
            State::Done(record) => {
                let unknown = record.quantities.iter().filter(|(_, f)| f.known == Some(false));
                let unknown = listed(unknown.map(|(quantity, _)| quantity));
                if !unknown.is_empty() {
                    notes.push(format!("{name}: {unknown} not known within the tolerance at the end"));
                }
                runs.push(Run { name, unit, record: *record });
            }
            State::Stale(what) => {
                notes.push(format!("{name} is left out, as it was made with another content of: {what}"))
            }
            State::Failed(why, seconds) => {
                failed += seconds;
                notes.push(format!("{name} failed: {why}"));
            }
            State::Missing => {}
        }
    }
    let (csv, html) = (campaign.folder.join("results.csv"), campaign.folder.join("report.html"));
    files::write_whole(&csv, results(campaign, &runs)?.as_bytes())?;
    let compared = compared(&runs, &campaign.settings.quantity);
    notes.extend(compared.iter().filter(|c| c.holds == Some(false)).map(|c| {
        format!(
            "{} of {}: the run and its check differ by {}, more than their intervals",
            c.quantity,
            c.run,
            number(c.difference, 3)
        )
    }));
    page(campaign, &runs, &compared, &notes, (units.len(), failed))?.write(&html)?;
    Ok(Report { csv, html, there: (runs.len(), units.len()), notes })
}

/// A row for each run and figure.
fn results(campaign: &Campaign, runs: &[Run]) -> Result<String> {
    let parameters = &campaign.table.parameters;
    let header = [NAME].into_iter().chain(parameters.iter().map(String::as_str)).chain(OF_RESULTS);
    let mut rows = vec![header.map(String::from).collect::<Vec<_>>()];
    for Run { unit, record: r, .. } in runs {
        let start = if unit.check { "check".into() } else { r.start.to_string() };
        for (quantity, figure) in &r.quantities {
            let known = figure.known.map_or(String::new(), |k| k.to_string());
            let mut row = vec![r.case_name.clone()];
            row.extend(campaign.table.rows[unit.row].values.iter().cloned());
            row.extend([
                quantity.clone(),
                figure.value.to_string(),
                figure.half_width.map_or(String::new(), |h| h.to_string()),
                known,
                start.clone(),
            ]);
            row.extend([r.cost.solver, r.cost.surrogate, r.end_time].map(|v| v.to_string()));
            rows.push(row);
        }
    }
    csv_text(rows)
}

/// A figure of a run beside that of its check.
struct Compared {
    run: String,
    quantity: String,
    own: Figure,
    check: Figure,
    difference: f64,
    /// None: one of both has no interval.
    holds: Option<bool>,
}

/// Share of a quantity's tolerance that a run and its check may differ by whatever their intervals: those of a steady flow are smaller than what a linear
/// solver leaves.
const LITTLE: f64 = 0.01;

fn compared(runs: &[Run], quantities: &[Quantity]) -> Vec<Compared> {
    let mut found = Vec::new();
    for check in runs.iter().filter(|r| r.unit.check) {
        let Some(own) = runs.iter().find(|r| !r.unit.check && r.unit.row == check.unit.row) else { continue };
        for (quantity, &figure) in &own.record.quantities {
            let Some(&of_check) = check.record.quantities.get(quantity) else { continue };
            let difference = (figure.value - of_check.value).abs();
            let halves = figure.half_width.zip(of_check.half_width);
            let asked = quantities.iter().find(|q| q.name == *quantity);
            let little = LITTLE * asked.and_then(|q| q.tolerance_at(of_check.value)).unwrap_or(0.0);
            let holds = halves.map(|(own, check)| difference <= own.hypot(check).max(little));
            found.push(Compared {
                run: own.name.clone(),
                quantity: quantity.clone(),
                own: figure,
                check: of_check,
                difference,
                holds,
            });
        }
    }
    found
}

/// `failed`: processor time of the runs that failed, s.
fn page(
    campaign: &Campaign,
    runs: &[Run],
    compared: &[Compared],
    notes: &[String],
    (all, failed): (usize, f64),
) -> Result<Page> {
    let case = campaign.settings.case.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut page = Page::new(&format!("Campaign of {case}"));
    let sum = |of: &dyn Fn(&Run) -> f64| -> f64 { runs.iter().map(of).sum() };
    let total = |check: bool| sum(&|r| if r.unit.check == check { r.record.cost.total() } else { 0.0 });
    page.paragraph(&format!(
        "{} of {all} runs are there. They took {} s of processor time, their checks {} s, those that failed {} s.",
        runs.len(),
        number(total(false), 4),
        number(total(true), 4),
        number(failed, 4)
    ));
    if !notes.is_empty() {
        page.listing(&notes.join("\n"));
    }
    page.heading("Response");
    let percent = 100.0 * campaign.settings.confidence;
    for quantity in &campaign.settings.quantity {
        for (i, parameter) in campaign.table.parameters.iter().enumerate() {
            if let Some(chart) = response(campaign, runs, &quantity.name, i) {
                page.svg(
                    &chart.svg()?,
                    &format!("{} over {parameter}: values with their {percent} % intervals.", quantity.name),
                );
            }
        }
    }
    if !compared.is_empty() {
        page.heading("Checks");
        page.paragraph(
            "Runs that were made twice: as all others, and cold and plain and to the end. A figure holds where both differ by no more than the \
             root of the sum of the squares of their half-widths, or than a hundredth of its tolerance. This is not known where one has no interval.",
        );
        let mut table = Table::new(["run", "quantity", "value", "check", "difference", "holds"]);
        for c in compared {
            let holds = c.holds.map_or("not known", |holds| if holds { "yes" } else { "no" });
            table.row([
                c.run.clone(),
                c.quantity.clone(),
                c.own.to_string(),
                c.check.to_string(),
                number(c.difference, 3),
                holds.into(),
            ]);
        }
        page.table(&table);
    }
    page.heading("Cost");
    let costs = |check: bool| -> Vec<f64> {
        let mut some: Vec<&Run> = runs.iter().filter(|r| r.unit.check == check).collect();
        let ended =
            |r: &&Run| campaign.folder_of(r.unit).join(DONE).metadata().and_then(|m| m.modified()).ok();
        some.sort_by_key(ended);
        some.iter().map(|r| r.record.cost.total()).collect()
    };
    if let Some(of) = balance(&costs(false), &costs(true)) {
        let (cold, checks) = (number(of.cold, 3), of.checks);
        page.paragraph(&format!(
            "A cold plain run to the end takes {cold} s of processor time (checks made: {checks}). {} such runs take {} s, where these took {} s, \
             {} s with their checks and those that failed. {}.",
            of.runs,
            number(of.runs as f64 * of.cold, 3),
            number(of.own, 3),
            number(of.own + of.cold * checks as f64 + failed, 3),
            of.breakeven.map_or("They have not yet saved what the checks took".into(), |n| format!(
                "With the checks, they pay from run {n} on"
            ))
        ));
    }
    page.paragraph("Processor seconds. Of those of the solver, the surrogate's strides and hand-overs stand beside them.");
    page.table(&cost(campaign, runs));
    Ok(page)
}

/// A figure over a parameter, a dot and a bar a run; none where no run has it, or the parameter is a word or always the same.
fn response(campaign: &Campaign, runs: &[Run], quantity: &str, parameter: usize) -> Option<Chart> {
    let points = |check: bool| -> Vec<(f64, Figure)> {
        let of = |r: &Run| {
            let x = as_number(&campaign.table.rows[r.unit.row].values[parameter])?;
            Some((x, *r.record.quantities.get(quantity)?))
        };
        runs.iter().filter(|r| r.unit.check == check).filter_map(of).collect()
    };
    let mut series = Vec::new();
    let mut places = BTreeSet::new();
    for (name, check, colour) in [("runs", false, BLUE), ("checks", true, ORANGE)] {
        let mut all = points(check);
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        if all.is_empty() {
            continue;
        }
        places.extend(all.iter().map(|(x, _)| x.to_bits()));
        let (x, y): (Vec<f64>, Vec<f64>) = all.iter().map(|(x, f)| (*x, f.value)).unzip();
        series.push(Series { dots: true, ..Series::new(name, &x, &y, colour) });
        // A point that is none ends each bar
        let bars = all.iter().flat_map(|(x, f)| {
            let half = f.half_width.unwrap_or(f64::NAN);
            [(*x, f.value - half), (*x, f.value + half), (f64::NAN, f64::NAN)]
        });
        series.push(Series {
            points: bars.collect(),
            ..Series::new(&format!("interval of {name}"), &[], &[], colour)
        });
    }
    (places.len() > 1).then(|| Chart {
        x_label: campaign.table.parameters[parameter].clone(),
        y_label: quantity.into(),
        series,
        axis: Axis::Range,
    })
}

/// What runs took beside what cold plain ones would.
#[derive(Debug, PartialEq)]
struct Balance {
    runs: usize,
    checks: usize,
    /// Of a check, on average, and of all runs, s.
    cold: f64,
    own: f64,
    /// Runs from which on they and all checks take less than as many cold ones.
    breakeven: Option<usize>,
}

/// Of what runs took, in the order in which they ended, and their checks; none without a check.
fn balance(own: &[f64], checks: &[f64]) -> Option<Balance> {
    let all: f64 = checks.iter().sum();
    let cold = all / checks.len() as f64;
    let saved = own.iter().scan(-all, |saved, cost| {
        *saved += cold - cost;
        Some(*saved)
    });
    let behind = saved.collect::<Vec<f64>>().iter().rposition(|s| *s < 0.0).map_or(0, |i| i + 1);
    (!checks.is_empty()).then(|| Balance {
        runs: own.len(),
        checks: checks.len(),
        cold,
        own: own.iter().sum(),
        breakeven: (behind < own.len()).then_some(behind + 1),
    })
}

fn cost(campaign: &Campaign, runs: &[Run]) -> Table {
    let own = [
        "start",
        "why",
        "end time [s]",
        "prepare",
        "start [s]",
        "solver",
        "of it surrogate",
        "states",
        "wall [s]",
    ];
    let parameters = campaign.table.parameters.iter().map(String::as_str);
    let mut table = Table::new(["run"].into_iter().chain(parameters).chain(own));
    let parts: [fn(&Cost) -> f64; 6] =
        [|c| c.prepare + c.tried, |c| c.start, |c| c.solver, |c| c.surrogate, |c| c.states, |c| c.wall];
    for Run { name, unit, record: r } in runs {
        let mut row = vec![name.clone()];
        row.extend(campaign.table.rows[unit.row].values.iter().cloned());
        row.extend([r.start.to_string(), r.start.note.clone().unwrap_or_default(), number(r.end_time, 3)]);
        row.extend(parts.map(|part| number(part(&r.cost), 3)));
        table.row(row);
    }
    let mut sum = vec!["all".to_string()];
    sum.resize(table.headers.len() - parts.len(), String::new());
    sum.extend(parts.map(|part| number(runs.iter().map(|r| part(&r.record.cost)).sum(), 3)));
    table.row(sum);
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(name: &str, check: bool, value: f64) -> Run {
        let figure = Figure { value, half_width: Some(0.3), known: Some(true) };
        let record = Record { quantities: [("Cd".to_string(), figure)].into(), ..Record::default() };
        Run { name: name.into(), unit: Unit { row: 0, check }, record }
    }

    #[test]
    fn a_run_that_is_off_its_check_by_more_than_both_intervals_is_told() {
        let of = |value: f64| compared(&[run("a", false, 2.0), run("a", true, value)], &[]).pop().unwrap();
        assert_eq!((of(2.4).holds, of(2.45).holds), (Some(true), Some(false)));
        let mut short = run("a", true, 9.0);
        short.record.quantities.values_mut().for_each(|f| f.half_width = None);
        assert_eq!(
            compared(&[run("a", false, 2.0), short], &[])[0].holds,
            None,
            "a check without an interval says nothing"
        );
        assert!((of(2.45).difference - 0.45).abs() < 1e-12);
        assert!(compared(&[run("a", true, 1.0)], &[]).is_empty(), "the run itself is not there yet");
        let steady = |check: bool, value: f64| {
            let mut run = run("a", check, value);
            run.record.quantities.values_mut().for_each(|f| f.half_width = Some(0.0));
            run
        };
        let asked = Quantity { name: "Cd".into(), relative: Some(0.01), ..Quantity::default() };
        let of = |value: f64| {
            compared(&[steady(false, value), steady(true, 2.0)], std::slice::from_ref(&asked))[0].holds
        };
        assert_eq!((of(2.0001), of(2.0003)), (Some(true), Some(false)));
    }

    #[test]
    fn runs_pay_once_they_have_saved_what_checks_took() {
        let found = balance(&[10.0, 4.0, 2.0, 2.0], &[10.0]).unwrap();
        assert_eq!((found.cold, found.own, found.breakeven), (10.0, 18.0, Some(3)));
        assert_eq!(balance(&[10.0, 4.0], &[10.0]).unwrap().breakeven, None);
        assert_eq!(balance(&[10.0], &[]), None);
    }
}
