//! What to change where a training goes wrong, told once: a loss that grows, gradients far beyond their limit, validations
//! that become worse.

use super::log::Row;
use m4gn_learn::{BestOf, Schedule, TrainingConfig};
use m4gn_report::number;

/// Rows of the log whose mean is compared: single ones vary with the examples that were drawn.
const ROWS: usize = 10;
/// How many times its lowest the loss is when it is told.
const GROWTH: f64 = 3.0;
/// How many times `gradient_clip` the norms of the gradient are when it is told.
const BEYOND: f64 = 10.0;
/// Validations in a row that are worse than the best one, and by how much, when it is told.
const WORSE: (usize, f64) = (5, 1.1);

/// What was told already.
#[derive(Debug, Default)]
pub(super) struct Advice {
    told: [bool; 3],
}

impl Advice {
    /// Notes after the last of these rows, which are all of the log.
    pub fn look(&mut self, rows: &[Row], t: &TrainingConfig) -> Vec<String> {
        let found = [loss(rows, t), gradient(rows, t), validation(rows, t)];
        let new = found.into_iter().zip(&mut self.told).filter_map(|(text, told)| {
            let text = text.filter(|_| !*told);
            *told |= text.is_some();
            text
        });
        new.collect()
    }
}

/// A loss that has grown, while the normalisers and the unrolled steps, by which it changes too, stayed.
fn loss(rows: &[Row], t: &TrainingConfig) -> Option<String> {
    let first = |row: &Row| row.step.saturating_sub(t.log_interval);
    // Where the schedule goes by time, that of the row's end.
    let unroll_at = |step: u64, row: &Row| t.unroll_at(t.place(step, row.seconds));
    let last = rows.last()?;
    let unroll = unroll_at(last.step.checked_sub(1)?, last);
    let alike = |row: &&Row| first(row) >= t.normaliser_steps && unroll_at(first(row), row) == unroll;
    let start = rows.len() - rows.iter().rev().take_while(alike).count();
    let means = rows[start..].windows(ROWS).map(|rows| {
        let sum: f64 = rows.iter().map(|row| row.loss).sum();
        (rows[ROWS - 1].step, sum / ROWS as f64)
    });
    let means: Vec<(u64, f64)> = means.collect();
    let now = means.last()?.1;
    let lowest = means.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (now > GROWTH * lowest.1).then(|| {
        format!(
            "note: the loss has grown from {} at step {} to {} (means of {ROWS} rows of the log): lower learning_rate{}, and carry \
             on with --resume; the best weights so far are kept",
            number(lowest.1, 3),
            lowest.0,
            number(now, 3),
            match t.gradient_clip == 0.0 {
                true => ", or set gradient_clip",
                false => "",
            }
        )
    })
}

/// Norms of the gradient that are far beyond the limit, so that all updates are of the same length.
fn gradient(rows: &[Row], t: &TrainingConfig) -> Option<String> {
    let last = &rows[rows.len().checked_sub(ROWS)?..];
    let settled = t.normaliser_steps.max(t.warmup_steps);
    let beyond = |row: &Row| {
        row.step.saturating_sub(t.log_interval) >= settled && row.gradient > BEYOND * t.gradient_clip
    };
    (t.gradient_clip > 0.0 && last.iter().all(beyond)).then(|| {
        let mean = last.iter().map(|row| row.gradient).sum::<f64>() / ROWS as f64;
        format!(
            "note: the norm of the gradient is {} (mean of {ROWS} rows of the log) and gradient_clip {}: all updates are scaled down to \
             the same length. Raise gradient_clip towards the usual norm, or lower learning_rate if the loss does not fall",
            number(mean, 3),
            t.gradient_clip
        )
    })
}

/// Validations that are all worse than an earlier one.
fn validation(rows: &[Row], t: &TrainingConfig) -> Option<String> {
    let (count, factor) = WORSE;
    let validation = |row: &Row| Some((row.step, row.validations.first()?.score()));
    let scores: Vec<(u64, f64)> = rows.iter().filter_map(validation).collect();
    let (before, last) = scores.split_at(scores.len().checked_sub(count)?);
    let best = before.iter().min_by(|a, b| a.1.total_cmp(&b.1))?;
    last.iter().all(|(_, score)| *score > factor * best.1).then(|| {
        format!(
            "note: the last {count} validations are worse than that of step {}{}: lower learning_rate; if the loss still falls, the \
             model learns its training trajectories by heart: more trajectories, more noise, a smaller width",
            best.0,
            if t.best_of == BestOf::Last { "" } else { ", whose weights are kept" }
        )
    })
}

/// What is said where the time has run out, with what of the schedule was not come to.
pub(super) fn stopped(t: &TrainingConfig, step: u64) -> String {
    let unreached = match t.schedule {
        Schedule::Updates => TrainingConfig { steps: step, ..t.clone() }.unreached(),
        Schedule::Time => Vec::new(),
    };
    match unreached.is_empty() {
        true => format!("stopped at step {step}: max_minutes reached"),
        false => format!(
            "stopped at step {step}: max_minutes reached; {}: --resume with more minutes, or a schedule of {step} steps",
            unreached.join("; ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::super::log::Validation;
    use super::*;

    fn row(step: u64, loss: f64, gradient: f64, score: Option<f64>) -> Row {
        Row {
            step,
            samples: step,
            seconds: step as f64,
            learning_rate: 1e-3,
            loss,
            losses: vec![loss],
            gradient,
            validations: Vec::from_iter(score.map(|score| Validation {
                rmse_1: [1.0, 1.0],
                rmse_horizon: [score, 1.0],
                rmse_all: [score, 1.0],
            })),
        }
    }

    fn settings() -> TrainingConfig {
        TrainingConfig {
            normaliser_steps: 100,
            gradient_clip: 1.0,
            log_interval: 100,
            unroll: vec![[0, 1], [5000, 2]],
            ..TrainingConfig::default()
        }
    }

    /// All that is told, row by row, with the number of the row.
    fn advice_by_row(rows: &[Row], t: &TrainingConfig) -> Vec<(usize, String)> {
        let mut advice = Advice::default();
        let each = (1..=rows.len()).flat_map(|n| {
            let new = advice.look(&rows[..n], t);
            new.into_iter().map(move |text| (n, text))
        });
        each.collect()
    }

    #[test]
    fn a_loss_that_grows_is_told_once() {
        // Ten rows of 1, then 10 each: the mean is 1 + 0.9 n after n of them, above 3 from the third.
        let loss = |i: u64| if i < 11 { 1.0 } else { 10.0 };
        let rows: Vec<Row> = (1..40).map(|i| row(100 * i, loss(i - 1), 0.1, None)).collect();
        let advice = advice_by_row(&rows, &settings());
        assert_eq!(advice.len(), 1, "{advice:?}");
        assert_eq!(advice[0].0, 14);
        assert!(advice[0].1.contains("from 1.00 at step 1100 to 3.70"), "{advice:?}");
        assert!(advice[0].1.contains("lower learning_rate, and"), "{advice:?}");
        // What grows since more steps are unrolled, or while the normalisers change, is none.
        let rows: Vec<Row> =
            (40..62).map(|i| row(100 * i, if i > 50 { 10.0 } else { 1.0 }, 0.1, None)).collect();
        assert_eq!(advice_by_row(&rows, &settings()), []);
        let late = TrainingConfig { normaliser_steps: 5000, unroll: vec![[0, 1]], ..settings() };
        assert_eq!(advice_by_row(&rows, &late), []);
        let free = TrainingConfig { unroll: vec![[0, 1]], gradient_clip: 0.0, ..settings() };
        assert!(advice_by_row(&rows, &free)[0].1.contains("or set gradient_clip"));
    }

    #[test]
    fn gradients_far_beyond_their_limit_are_told_once() {
        let rows: Vec<Row> = (1..20).map(|i| row(100 * i, 1.0, 11.0, None)).collect();
        let advice = advice_by_row(&rows, &settings());
        assert_eq!((advice.len(), advice[0].0), (1, 11), "{advice:?}");
        assert!(advice[0].1.contains("is 11.0") && advice[0].1.contains("gradient_clip 1:"), "{advice:?}");
        let calm: Vec<Row> = (1..20).map(|i| row(100 * i, 1.0, 9.0, None)).collect();
        assert_eq!(advice_by_row(&calm, &settings()), []);
        let free = TrainingConfig { gradient_clip: 0.0, ..settings() };
        assert_eq!(advice_by_row(&rows, &free), []);
    }

    #[test]
    fn validations_that_stay_worse_are_told_once() {
        let scores = |scores: &[f64]| -> Vec<Row> {
            let steps = (1..).map(|i| 100 * i);
            let rows = scores.iter().zip(steps).map(|(score, step)| row(step, 1.0, 0.1, Some(*score)));
            rows.collect()
        };
        let advice = advice_by_row(&scores(&[0.9, 0.5, 0.6, 0.6, 0.6, 0.7, f64::INFINITY, 0.8]), &settings());
        assert_eq!((advice.len(), advice[0].0), (1, 7), "{advice:?}");
        assert!(advice[0].1.contains("that of step 200"), "{advice:?}");
        // One of five is as good.
        assert_eq!(advice_by_row(&scores(&[0.5, 0.6, 0.6, 0.54, 0.6, 0.6]), &settings()), []);
    }

    #[test]
    fn time_that_runs_out_before_the_schedule_is_told() {
        let t =
            TrainingConfig { steps: 1000, decay_steps: 1000, unroll: vec![], ..TrainingConfig::default() };
        assert!(stopped(&t, 400).contains("the decay of the learning rate ends at step 1000"));
        assert_eq!(stopped(&t, 1000), "stopped at step 1000: max_minutes reached");
        let t = TrainingConfig { schedule: Schedule::Time, ..t };
        assert_eq!(stopped(&t, 400), "stopped at step 400: max_minutes reached");
    }
}
