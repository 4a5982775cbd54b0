//! The page of `m4gn train --html`: where the training stands, its curves from the first step on, and its configuration.

use super::config::Config;
use super::journal::{Row, Validation};
use super::report::Report;
use m4gn_learn::BestOf;
use m4gn_mesh::{Error, Result};
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::{Chart, Page, Series, Table, number, write_file};
use std::path::{Path, PathBuf};

/// Seconds after which a browser looks for a newer page.
const REFRESH: u32 = 30;
/// Points of a curve at most, so that a page of a long training stays small.
const POINTS: usize = 500;
/// Intervals of the log over which the speed is measured: enough to hold a validation now and then.
const INTERVALS: usize = 10;

/// What the page says besides the rows of the log.
pub(super) struct TrainingPage {
    path: PathBuf,
    title: String,
    /// The configuration as TOML, with what was not given.
    config: String,
    /// What the training was begun or carried on with, a paragraph each.
    notes: Vec<String>,
    steps: u64,
    /// After which the training stops, s.
    limit: Option<f64>,
    best_of: BestOf,
    /// The predicted fields, the first of which is validated.
    fields: Vec<String>,
    /// A page that could not be written is reported once.
    reported: bool,
}

/// Whether the training goes on.
pub(super) enum State<'a> {
    /// It does.
    Running,
    /// It does not, and why.
    Ended(&'a str),
}

/// How fast a training is.
#[derive(Debug, PartialEq)]
struct Pace {
    samples_per_second: f64,
    seconds_left: f64,
}

/// Refuses a file for the page that it cannot be put into, or that is another file of the training.
///
/// # Errors
/// [`Error::Input`] or [`Error::File`] that says which.
pub(super) fn check(path: &Path, others: &[&Path]) -> Result<()> {
    let whole = |p: &Path| {
        let known = p.canonicalize().or_else(|_| {
            let folder = p.parent().filter(|f| !f.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new(".")).canonicalize()?;
            Ok::<_, std::io::Error>(folder.join(p.file_name().unwrap_or_default()))
        });
        known.unwrap_or_else(|_| p.to_path_buf())
    };
    if let Some(other) = others.iter().find(|other| whole(other) == whole(path)) {
        return Err(Error::Input(format!(
            "--html {}: the training reads or writes {} as another file; give the page a name of its own",
            path.display(),
            other.display()
        )));
    }
    // The page is written many times: a pipe or a device would hold all of them.
    if path.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir()) {
        return Err(Error::file(
            path,
            "--html: is no plain file; the page is written anew at each row of the log, expected a name for a plain file",
        ));
    }
    m4gn_mesh::files::check_writable(path)
}

impl TrainingPage {
    /// Of a training whose model goes to `out`.
    ///
    /// # Errors
    /// [`Error::Internal`] for a configuration that is no TOML.
    pub fn new(
        path: &Path,
        out: &Path,
        config: &Config,
        fields: Vec<String>,
        notes: Vec<String>,
    ) -> Result<Self> {
        let toml = toml::to_string(config).map_err(|e| Error::Internal(format!("configuration: {e}")))?;
        Ok(TrainingPage {
            path: path.to_path_buf(),
            title: format!("Training of {}", out.display()),
            config: toml,
            notes,
            steps: config.training.steps,
            limit: config.training.max_minutes.map(|minutes| 60.0 * minutes),
            best_of: config.training.best_of,
            fields,
            reported: false,
        })
    }

    /// Writes the page. A page that cannot be written is a note and no reason to end a training.
    pub fn write(&mut self, rows: &[Row], state: &State, report: &Report) {
        let written = self.page(rows, state).and_then(|page| write_file(&self.path, page.html().as_bytes()));
        if let (Err(error), false) = (&written, self.reported) {
            self.reported = true;
            report.line(&format!("note: the page of --html is out of date: {error}"));
        }
    }

    fn page(&self, rows: &[Row], state: &State) -> Result<Page> {
        let mut page = Page::new(&self.title);
        let step = rows.last().map_or(0, |row| row.step);
        match state {
            State::Running => {
                page.refresh(REFRESH);
                page.paragraph(&format!(
                    "Running: step {step} of {}. Read anew every {REFRESH} s.",
                    self.steps
                ));
            }
            State::Ended(how) => page.paragraph(&format!("Not running: {how}.")),
        }
        if let Some(last) = rows.last() {
            page.table(&self.figures(rows, last, state));
            self.curves(&mut page, rows)?;
        }
        page.heading("What is trained");
        self.notes.iter().for_each(|note| page.paragraph(note));
        page.heading("Configuration");
        page.listing(&self.config);
        Ok(page)
    }

    fn figures(&self, rows: &[Row], last: &Row, state: &State) -> Table {
        let mut table = Table::new(["at the last row of the log", ""]);
        table.row(["step", &format!("{} of {}", last.step, self.steps)]);
        table.row(["loss", &number(last.loss, 4)]);
        table.row(["norm of the gradient", &number(last.gradient, 3)]);
        table.row(["learning rate", &number(last.learning_rate, 3)]);
        let pace = self.pace(rows);
        let speed = pace.as_ref().map_or(f64::NAN, |p| p.samples_per_second);
        table.row(["samples/s", &number(speed, 3)]);
        table.row(["time of training", &duration(last.seconds)]);
        if let (State::Running, Some(pace)) = (state, &pace) {
            table.row(["time left", &duration(pace.seconds_left)]);
        }
        table
    }

    /// Speed and time left by the last intervals; none without an interval that took time.
    fn pace(&self, rows: &[Row]) -> Option<Pace> {
        let last = rows.last()?;
        let (step, samples, seconds) = match rows.len().checked_sub(1 + INTERVALS) {
            Some(first) => (rows[first].step, rows[first].samples, rows[first].seconds),
            None => (0, 0, 0.0),
        };
        let (steps, time) = (last.step.checked_sub(step)?, last.seconds - seconds);
        if steps == 0 || time <= 0.0 {
            return None;
        }
        let left = self.steps.saturating_sub(last.step) as f64 * time / steps as f64;
        let limit = self.limit.map_or(f64::INFINITY, |limit| limit - last.seconds);
        Some(Pace {
            samples_per_second: last.samples.checked_sub(samples)? as f64 / time,
            seconds_left: left.min(limit).max(0.0),
        })
    }

    fn curves(&self, page: &mut Page, rows: &[Row]) -> Result<()> {
        let mut chart = |y: &str, series: Vec<Series>, axis, caption: &str| -> Result<()> {
            let chart = Chart { x_label: "step".into(), y_label: y.into(), series, axis };
            page.svg(&chart.svg()?, caption);
            Ok(())
        };
        let curve = |name: &str, colour, of: &dyn Fn(&Row) -> f64| Series {
            name: name.into(),
            points: thinned(rows.iter().map(|row| (row.step as f64, of(row))).collect()),
            colour,
            dots: false,
        };
        let mut losses = vec![curve("loss", ORANGE, &|row| row.loss)];
        if self.fields.len() > 1 {
            for (i, (name, colour)) in self.fields.iter().zip([BLUE, GREY].into_iter().cycle()).enumerate() {
                losses.push(curve(name, colour, &|row| row.losses[i]));
            }
        }
        chart(
            "loss",
            losses,
            Axis::Logarithmic,
            "Loss, a mean over each interval of the log: the weighted sum, and each predicted field's.",
        )?;
        let ratio = |pick: fn(&Validation) -> [f64; 2]| {
            move |row: &Row| row.validation.as_ref().map_or(f64::NAN, |v| 100.0 * pick(v)[0] / pick(v)[1])
        };
        let validations: Vec<&Row> = rows.iter().filter(|row| row.validation.is_some()).collect();
        let validation = |name: &str, colour, pick| Series {
            name: name.into(),
            points: validations.iter().map(|row| (row.step as f64, ratio(pick)(row))).collect(),
            colour,
            // A single validation is a dot: a line wants two.
            dots: validations.len() == 1,
        };
        if !validations.is_empty() {
            chart(
                "RMSE / holding [%]",
                vec![
                    validation("RMSE-1", BLUE, |v| v.rmse_1),
                    validation("RMSE-50", ORANGE, |v| v.rmse_horizon),
                    validation("RMSE-all", GREY, |v| v.rmse_all),
                ],
                Axis::FromZero,
                &format!(
                    "Errors of {} on the validation trajectories over those of holding the first frame: after one step, over \
                     the validation horizon, over whole trajectories.",
                    self.fields.first().map_or("the first field", String::as_str)
                ),
            )?;
        }
        chart(
            "learning rate",
            vec![curve("learning rate", BLUE, &|row| row.learning_rate)],
            Axis::FromZero,
            "Learning rate.",
        )?;
        chart(
            "norm of the gradient",
            vec![curve("norm", BLUE, &|row| row.gradient)],
            Axis::Logarithmic,
            "Norm of the gradient before it is clipped, a mean over each interval of the log.",
        )?;
        let speeds = rows.windows(2).map(|pair| {
            let time = pair[1].seconds - pair[0].seconds;
            let samples = pair[1].samples as f64 - pair[0].samples as f64;
            (pair[1].step as f64, if time > 0.0 { samples / time } else { f64::NAN })
        });
        let speeds =
            Series { name: "samples/s".into(), points: thinned(speeds.collect()), colour: BLUE, dots: false };
        chart(
            "samples/s",
            vec![speeds],
            Axis::FromZero,
            "Graphs times unrolled steps a second, validations included.",
        )?;
        if !validations.is_empty() {
            page.heading("Validations");
            page.table(&validation_table(&validations, self.best_of));
        }
        Ok(())
    }
}

/// The last ten validations, and the best one, by what the best weights are chosen by.
fn validation_table(validations: &[&Row], best_of: BestOf) -> Table {
    let mut table = Table::new(["step", "RMSE-1", "holding", "RMSE-50", "holding", "RMSE-all", "holding"]);
    let cells = |name: String, v: &Validation| {
        let pairs = [v.rmse_1, v.rmse_horizon, v.rmse_all];
        let figures = pairs.as_flattened().iter().map(|x| number(*x, 4));
        std::iter::once(name).chain(figures).collect::<Vec<_>>()
    };
    let score = |row: &&&Row| {
        let validation = row.validation.as_ref();
        validation.map_or(f64::INFINITY, |v| v.score(best_of))
    };
    let best = match best_of {
        BestOf::Last => validations.last(),
        _ => validations.iter().min_by(|a, b| score(a).total_cmp(&score(b))),
    };
    if let Some((row, v)) = best.and_then(|row| Some((row, row.validation.as_ref()?))) {
        table.row(cells(format!("best: {}", row.step), v));
    }
    for row in validations.iter().rev().take(10) {
        if let Some(v) = &row.validation {
            table.row(cells(row.step.to_string(), v));
        }
    }
    table
}

/// Means of groups of neighbours, where there are more points than a curve shows.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let group = points.len().div_ceil(POINTS).max(1);
    let mean = |values: &[(f64, f64)]| {
        let n = values.len() as f64;
        let sum = values.iter().fold((0.0, 0.0), |sum, p| (sum.0 + p.0, sum.1 + p.1));
        (sum.0 / n, sum.1 / n)
    };
    points.chunks(group).map(mean).collect()
}

/// A time for people: `59 s`, `12 min`, `3 h 20 min`.
fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round() as u64;
    match minutes {
        _ if seconds < 60.0 => format!("{seconds:.0} s"),
        m if m < 60 => format!("{m} min"),
        m => format!("{} h {} min", m / 60, m % 60),
    }
}

#[cfg(test)]
#[path = "page_tests.rs"]
mod tests;
