//! The CSV log of a training: one row an interval, validation columns empty where there was none. It is the history of a
//! training over all resumptions.

use m4gn_base::{Error, Result, files};
use m4gn_learn::BestOf;
use m4gn_report::{number, percent};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Errors of a validation ([`super::errors::Figures`]) and of holding the frame that it starts from, in the units of a predicted field.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Validation {
    /// Of single steps: model, persistence.
    pub rmse_1: [f64; 2],
    /// Over the first frames of rollouts: model, the first frame held.
    pub rmse_horizon: [f64; 2],
    /// Over whole trajectories.
    pub rmse_all: [f64; 2],
}

impl Validation {
    /// Whether all rollouts stayed finite.
    pub fn is_finite(&self) -> bool {
        let all = [self.rmse_1, self.rmse_horizon, self.rmse_all];
        all.as_flattened().iter().all(|v| v.is_finite())
    }

    /// Of what a row of the log has: the model's three errors, then those of persistence.
    fn of_row(cells: &[&str; 6]) -> Option<Validation> {
        let v: Vec<f64> = cells.iter().map_while(|v| v.parse().ok()).collect();
        let v: [f64; 6] = v.try_into().ok()?;
        Some(Validation { rmse_1: [v[0], v[3]], rmse_horizon: [v[1], v[4]], rmse_all: [v[2], v[5]] })
    }

    /// As [`Validation::of_row`] reads it.
    fn to_row(self) -> [String; 6] {
        let pairs = [self.rmse_1, self.rmse_horizon, self.rmse_all];
        std::array::from_fn(|i| format!("{:.6e}", pairs[i % 3][i / 3]))
    }

    /// The three errors by name: of the model and of the frame that is held, and what holding it is called.
    fn described(&self, part: impl Fn(f64, f64, &str) -> String) -> String {
        let all = [
            ("RMSE-1", self.rmse_1, "persistence"),
            ("RMSE-50", self.rmse_horizon, "hold first"),
            ("RMSE-all", self.rmse_all, "hold first"),
        ];
        let parts = all.map(|(name, [model, held], whose)| {
            format!("{name} {} ({})", number(model, 4), part(model, held, whose))
        });
        parts.join(", ")
    }

    /// The errors, each with its percentage of holding a frame: `RMSE-1 0.001234 (12.3 % of persistence), ...`.
    pub fn relative(&self) -> String {
        self.described(|model, held, whose| format!("{} of {whose}", percent(Some(model / held))))
    }

    /// The errors, each with that of holding a frame: `RMSE-1 0.001234 (0.01002 persistence), ...`.
    pub fn absolute(&self) -> String {
        self.described(|_, held, whose| format!("{} {whose}", number(held, 4)))
    }

    /// What is compared to find the best weights, and for advice: the geometric mean of the errors of rollouts relative to holding the
    /// first frame. Infinite where a rollout left the finite numbers.
    pub fn score(&self) -> f64 {
        let ratio = |[model, held]: [f64; 2]| {
            if model.is_finite() { model / held.max(1e-30) } else { f64::INFINITY }
        };
        (ratio(self.rmse_horizon) * ratio(self.rmse_all)).sqrt()
    }

    /// Whether weights with these errors take the place of earlier ones.
    pub fn replaces(&self, earlier: Option<&Validation>, best_of: BestOf) -> bool {
        let better = |earlier: &Validation| self.score() < earlier.score();
        self.is_finite() && (best_of == BestOf::Last || earlier.is_none_or(better))
    }
}

/// Columns of a field's validation.
const ERRORS: [&str; 6] =
    ["rmse_1", "rmse_50", "rmse_all", "persistence_1", "hold_first_50", "hold_first_all"];

/// One row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Steps made.
    pub step: u64,
    /// Graphs seen times unrolled steps.
    pub samples: u64,
    /// Seconds of training, over all resumptions.
    pub seconds: f64,
    /// Learning rate.
    pub learning_rate: f64,
    /// Weighted loss, mean over the interval.
    pub loss: f64,
    /// Loss of each predicted field.
    pub losses: Vec<f64>,
    /// Mean norm of the gradient.
    pub gradient: f64,
    /// The validation at this step, of each predicted field; none where there was no validation.
    pub validations: Vec<Validation>,
}

impl Row {
    /// A line of the log, of so many predicted fields; none where it is not one.
    fn parse(line: &str, fields: usize) -> Option<Row> {
        let cells: Vec<&str> = line.split(',').collect();
        let whole = cells.len() == 6 + fields + ERRORS.len() * fields;
        let (numbers, validations) = cells.split_at_checked(6 + fields).filter(|_| whole)?;
        let number = |i: usize| numbers[i].parse::<f64>().ok();
        let validated = !validations.iter().all(|v| v.is_empty());
        let validations = match validated {
            true => validations.as_chunks().0.iter().map(Validation::of_row).collect::<Option<Vec<_>>>()?,
            false => Vec::new(),
        };
        Some(Row {
            step: numbers[0].parse().ok()?,
            samples: numbers[1].parse().ok()?,
            seconds: number(2)?,
            learning_rate: number(3)?,
            loss: number(4)?,
            losses: (5..5 + fields).map(number).collect::<Option<_>>()?,
            gradient: number(5 + fields)?,
            validations,
        })
    }
}

/// The open log file.
pub struct Journal {
    path: PathBuf,
    file: File,
    fields: usize,
    rows: Vec<Row>,
}

impl Journal {
    /// Starts a log, or carries one on: rows after `step` are dropped, they will be made again, and so is what is no row.
    pub fn open(path: &Path, fields: &[String], step: u64) -> Result<Self> {
        let fail = |e: std::io::Error| Error::file(path, format!("cannot write the training log: {e}"));
        let named = |kind: &'static str| fields.iter().map(move |f| format!("{kind}_{f}"));
        // The first field's, by which the best weights are chosen, are without its name.
        let of_field = |i: usize| {
            let field = if i == 0 { String::new() } else { format!("_{}", fields[i]) };
            ERRORS.map(|name| format!("{name}{field}"))
        };
        let names: Vec<String> = ["step", "samples", "seconds", "learning_rate", "loss"]
            .map(String::from)
            .into_iter()
            .chain(named("loss"))
            .chain(["gradient_norm".into()])
            .chain((0..fields.len()).flat_map(of_field))
            .collect();
        let mut text = names.join(",") + "\n";
        let old = match step > 0 && path.exists() {
            true => files::read_text(path)
                .map_err(|e| Error::file(path, format!("the training log cannot be read: {e}")))?,
            false => String::new(),
        };
        let mut rows = Vec::new();
        for line in old.lines().skip(1) {
            if let Some(row) = Row::parse(line, fields.len()).filter(|row| row.step <= step) {
                text += &format!("{line}\n");
                rows.push(row);
            }
        }
        files::write_whole(path, text.as_bytes())?;
        let file = OpenOptions::new().append(true).open(path).map_err(fail)?;
        Ok(Journal { path: path.to_path_buf(), file, fields: fields.len(), rows })
    }

    /// All rows, of the resumptions before as well.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Appends a row.
    pub fn append(&mut self, row: &Row) -> Result<()> {
        self.rows.push(row.clone());
        let losses: Vec<String> = row.losses.iter().map(|l| format!("{l:.6e}")).collect();
        let mut errors: Vec<String> = row.validations.iter().copied().flat_map(Validation::to_row).collect();
        errors.resize(ERRORS.len() * self.fields, String::new());
        let validation = errors.join(",");
        writeln!(
            self.file,
            "{},{},{:.1},{:.6e},{:.6e},{},{:.4e},{validation}",
            row.step,
            row.samples,
            row.seconds,
            row.learning_rate,
            row.loss,
            losses.join(","),
            row.gradient
        )
        .map_err(|e| Error::file(&self.path, format!("cannot write the training log: {e}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u64, validation: Option<Validation>) -> Row {
        Row {
            step,
            samples: 2 * step,
            seconds: 1.5,
            learning_rate: 1e-3,
            loss: 0.25,
            losses: vec![0.125, 0.0625],
            gradient: 1.0,
            validations: validation.map_or(Vec::new(), |v| vec![v; 2]),
        }
    }

    /// Displacements of micrometres.
    #[test]
    fn small_errors_keep_their_digits() {
        let v = Validation {
            rmse_1: [1.25e-6, 2.5e-6],
            rmse_horizon: [0.00125, 0.0125],
            rmse_all: [f64::INFINITY, 12345.0],
        };
        assert_eq!(
            v.relative(),
            "RMSE-1 1.250e-6 (50.0 % of persistence), RMSE-50 0.001250 (10.0 % of hold first), RMSE-all - (- of hold first)"
        );
        assert_eq!(
            v.absolute(),
            "RMSE-1 1.250e-6 (2.500e-6 persistence), RMSE-50 0.001250 (0.01250 hold first), RMSE-all - (12345 hold first)"
        );
    }

    #[test]
    fn rows_after_the_checkpoint_are_dropped() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let fields = ["U".into(), "p".into()];
        let mut journal = Journal::open(&path, &fields, 0).unwrap();
        (1..=3).for_each(|s| journal.append(&row(s, None)).unwrap());
        let text = std::fs::read_to_string(&path).unwrap();
        let columns: Vec<usize> = text.lines().map(|l| l.split(',').count()).collect();
        assert_eq!(columns, [20; 4]);
        drop(Journal::open(&path, &fields, 2).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 3);
    }

    #[test]
    fn the_best_weights_are_those_of_the_rollouts_or_the_last_ones() {
        let validation = |rmse_1, rmse_all| Validation {
            rmse_1: [rmse_1, 1.0],
            rmse_horizon: [0.5, 2.0],
            rmse_all: [rmse_all, 1.0],
        };
        let (good, bad) = (validation(0.16, 0.36), validation(0.04, 1.0));
        // sqrt(0.25 * 0.36)
        assert!((good.score() - 0.3).abs() < 1e-12);
        assert!(good.replaces(Some(&bad), BestOf::Rollouts) && !bad.replaces(Some(&good), BestOf::Rollouts));
        // The last ones, whatever they are, unless they are none
        assert!(good.replaces(Some(&bad), BestOf::Last) && bad.replaces(Some(&good), BestOf::Last));
        let diverged = Validation { rmse_1: [f64::NAN, 1.0], ..good };
        assert!(!diverged.replaces(Some(&bad), BestOf::Last) && !diverged.replaces(None, BestOf::Last));
    }

    #[test]
    fn a_log_reads_back_and_what_is_no_row_is_left_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.csv");
        let fields = ["U".into(), "p".into()];
        let validation =
            Validation { rmse_1: [0.5, 1.0], rmse_horizon: [f64::INFINITY, 2.0], rmse_all: [0.75, 4.0] };
        let rows = [row(1, None), row(2, Some(validation)), row(4, None)];
        let mut journal = Journal::open(&path, &fields, 0).unwrap();
        rows.iter().for_each(|row| journal.append(row).unwrap());
        let text = std::fs::read_to_string(&path).unwrap();
        // The last row is cut off in its middle, as by a full disk.
        std::fs::write(&path, &text[..text.len() - 10]).unwrap();
        assert_eq!(Journal::open(&path, &fields, 9).unwrap().rows(), &rows[..2]);
        let left = std::fs::read_to_string(&path).unwrap();
        assert!(left.ends_with('\n') && left.lines().count() == 3, "{left}");
        // One that cannot be read is not replaced.
        std::fs::write(&path, b"step\xff").unwrap();
        let refused = Journal::open(&path, &fields, 9).err().unwrap().to_string();
        assert!(refused.contains("log.csv: the training log cannot be read"), "{refused}");
        assert_eq!(std::fs::read(&path).unwrap(), b"step\xff");
    }
}
