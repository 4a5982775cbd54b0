//! The choice of a fit: among a few shapes, the one that best predicts the last snapshots of the window from those before.

use crate::dmd::{Delayed, Dmd, Shape, Window};
use crate::snapshots::{Combination, Snapshots};
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// Errors of the tail below this are rounding.
const SAME: f64 = 1e-6;

/// A candidate is better than one before it if its error is below this times the other's.
const BETTER: f64 = 0.95;

/// What fits are made of.
#[derive(Clone, Debug, PartialEq)]
pub struct FitSettings {
    /// Snapshots in a fit at most.
    pub window: usize,
    /// Snapshots without a gap, the last one included, that a fit needs at least.
    pub min_snapshots: usize,
    /// Snapshots at the end of the window that the choice is made by.
    pub hold_out: usize,
    /// Delays to choose from.
    pub delays: Vec<usize>,
    /// Ranks to choose from.
    pub svd_rank: Vec<usize>,
    /// Whether modes may grow; none: the tail says.
    pub unstable_modes: Option<bool>,
}

impl Default for FitSettings {
    fn default() -> Self {
        FitSettings {
            window: 40,
            min_snapshots: 40,
            hold_out: 5,
            delays: vec![5, 8, 12],
            svd_rank: vec![12, 30],
            unstable_modes: None,
        }
    }
}

impl FitSettings {
    /// Checks the numbers against each other.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was found and what is expected.
    pub fn check(&self) -> Result<()> {
        let bad = |text: String| Err(Error::Input(format!("dmd: {text}")));
        if self.hold_out == 0 {
            return bad("holdOut 0: expected at least 1 snapshot".into());
        }
        if self.delays.is_empty() || self.delays.contains(&0) {
            return bad(format!("delays {:?}: expected numbers of states, at least 1", self.delays));
        }
        if self.svd_rank.is_empty() || self.svd_rank.contains(&0) {
            return bad(format!("svdRank {:?}: expected numbers of directions, at least 1", self.svd_rank));
        }
        let fewest =
            self.hold_out.saturating_add(2).saturating_add(self.delays.iter().min().copied().unwrap_or(1));
        if self.min_snapshots < fewest {
            return bad(format!(
                "minSnapshots {}: expected at least {fewest}: holdOut, the fewest delays, and 2 states to learn from",
                self.min_snapshots
            ));
        }
        if self.window < self.min_snapshots || self.window > 1000 {
            return bad(format!(
                "window {}: expected minSnapshots ({}) to 1000 snapshots",
                self.window, self.min_snapshots
            ));
        }
        Ok(())
    }
}

/// How far a prediction of a field is off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FieldError {
    /// The field.
    pub name: String,
    /// Root mean square of prediction minus solver, over the field's variation in the window.
    pub error: f64,
    /// The same of the state that the prediction began from: what holding it would be off by, at least the least change that errors are over.
    pub hold: f64,
}

/// A decomposition of a window, and what it was chosen by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fit {
    /// The decomposition of the whole window.
    pub dmd: Dmd,
    /// Sample numbers of the window.
    pub numbers: Vec<i64>,
    /// Their slots.
    pub(crate) slots: Vec<usize>,
    /// Mean square of what each field varies by, at least the least change that errors are over; 0 for those that do not or are not measured.
    pub(crate) variation: Vec<f64>,
    /// Of the held-back tail, over all its snapshots.
    pub tail: Vec<FieldError>,
}

impl Fit {
    /// Mean square of what a field varies by, at least the least change that errors are over; 0 for one that does not.
    pub fn variation(&self, field: usize) -> f64 {
        self.variation[field]
    }

    /// Error of the tail over that of holding, all fields that vary together.
    pub fn tail_error(&self) -> f64 {
        relative(&self.tail)
    }
}

/// Errors over what holding would be off by, of all fields together; 0 where nothing changes.
pub fn relative(errors: &[FieldError]) -> f64 {
    let sum = |of: fn(&FieldError) -> f64| errors.iter().map(|e| of(e).powi(2)).sum::<f64>();
    match (sum(|e| e.error), sum(|e| e.hold)) {
        (e, h) if h > 0.0 => (e / h).sqrt(),
        (0.0, _) => 0.0,
        _ => f64::INFINITY,
    }
}

/// Products of the states in these slots, each field over its variation.
pub(crate) fn window(snapshots: &Snapshots, slots: &[usize], numbers: &[i64], variation: &[f64]) -> Window {
    let c = snapshots.capacity();
    let mut products = vec![0.0; slots.len() * slots.len()];
    for (table, v) in snapshots.products.iter().zip(variation).filter(|(_, v)| **v > 0.0) {
        for (row, a) in products.chunks_exact_mut(slots.len()).zip(slots) {
            for (p, b) in row.iter_mut().zip(slots) {
                *p += table[a * c + b] / v;
            }
        }
    }
    Window::new(numbers.to_vec(), products)
}

/// Squares of prediction minus state and of holding over the tail: the first `window.len() - tail` snapshots predict the others.
pub(crate) fn score(window: &Window, dmd: &Dmd, tail: usize) -> (f64, Vec<Vec<f64>>) {
    let first = window.len() - tail;
    let history: Vec<&[f64]> = (first - dmd.shape.delays..first).map(|i| &window.row(i)[..first]).collect();
    let amplitudes = dmd.amplitudes(&history);
    let mut sum = 0.0;
    let predictions = (0..tail).map(|s| {
        let w = dmd.weights(&amplitudes, (s + 1) as f64);
        let mut d = w.clone();
        d.resize(window.len(), 0.0);
        d[first + s] -= 1.0;
        let square: f64 = d
            .iter()
            .enumerate()
            .map(|(i, x)| x * window.row(i).iter().zip(&d).map(|(p, y)| p * y).sum::<f64>())
            .sum();
        sum += square.max(0.0);
        w
    });
    let predictions = predictions.collect();
    (if sum.is_finite() { sum } else { f64::INFINITY }, predictions)
}

/// A shape that was tried on the window without its tail.
struct Candidate {
    /// Square of the tail's error over that of holding.
    score: f64,
    shape: Shape,
    length: usize,
    /// Weights of the snapshots for each of the tail.
    predictions: Vec<Vec<f64>>,
}

impl Candidate {
    /// Of states that are all the same: the tail is the mean of those before.
    fn still(length: usize, tail: usize) -> Self {
        let first = length - tail;
        let shape = Shape { delays: 1, rank: 0, growing: false };
        Candidate { score: 0.0, shape, length, predictions: vec![vec![1.0 / first as f64; first]; tail] }
    }
}

/// The best fit of the last snapshots; a later candidate must be clearly better than the ones before, so that rounding chooses none; none where there are too few without a gap, or nothing has varied.
/// `least`: of each field the square of the least change that errors are over.
pub(crate) fn choose(snapshots: &Snapshots, settings: &FitSettings, least: &[f64]) -> Option<Fit> {
    let all: Vec<(i64, usize)> = snapshots.entries.iter().map(|e| (e.number, e.slot)).collect();
    let gap = all.windows(2).rposition(|p| p[1].0 - p[0].0 != 1).map_or(0, |i| i + 1);
    let stretch = all.len() - gap;
    if stretch < settings.min_snapshots {
        return None;
    }
    let mut best: Option<Candidate> = None;
    for length in lengths(stretch, settings) {
        let (numbers, slots): (Vec<i64>, Vec<usize>) = all[all.len() - length..].iter().copied().unzip();
        let variation = variations(snapshots, &slots, least);
        let whole = window(snapshots, &slots, &numbers, &variation);
        if whole.is_still() {
            let moved = variation.iter().any(|v| *v > 0.0);
            best = moved.then(|| Candidate::still(length, settings.hold_out));
            break;
        }
        let part = whole.part(0..length - settings.hold_out);
        let floor: f64 = variation.iter().zip(least).filter(|(v, _)| **v > 0.0).map(|(v, r)| r / v).sum();
        // Squares of windows of another length are over another variation.
        let scale = 1.0 / hold(&whole, settings.hold_out).max(settings.hold_out as f64 * floor);
        let most = settings.svd_rank.iter().copied().max()?;
        for &delays in settings.delays.iter().filter(|q| *q + 2 + settings.hold_out <= length) {
            let Some(delayed) = Delayed::new(&part, delays, most) else {
                continue;
            };
            let mut tried = Vec::new();
            for &rank in &settings.svd_rank {
                let rank = rank.min(delayed.rank());
                for growing in [false, true] {
                    if settings.unstable_modes.is_some_and(|g| g != growing)
                        || tried.contains(&(rank, growing))
                    {
                        continue;
                    }
                    tried.push((rank, growing));
                    let Some(dmd) = delayed.modes(rank, growing) else {
                        continue;
                    };
                    let (sum, predictions) = score(&whole, &dmd, settings.hold_out);
                    let score = (sum * scale).max(SAME * SAME);
                    if best.as_ref().is_none_or(|b| score < BETTER * BETTER * b.score) {
                        let shape = Shape { delays, rank, growing };
                        best = Some(Candidate { score, shape, length, predictions });
                    }
                }
            }
        }
    }
    let Candidate { shape, length, predictions, .. } = best?;
    let (numbers, slots): (Vec<i64>, Vec<usize>) = all[all.len() - length..].iter().copied().unzip();
    let variation = variations(snapshots, &slots, least);
    let whole = window(snapshots, &slots, &numbers, &variation);
    let dmd = match shape.rank {
        0 => Dmd::still(length),
        rank => Delayed::new(&whole, shape.delays, rank)?.modes(rank, shape.growing)?,
    };
    let tail = tail_errors(snapshots, &slots, &variation, least, &predictions);
    Some(Fit { dmd, numbers, slots, variation, tail })
}

/// Windows to choose from.
fn lengths(stretch: usize, settings: &FitSettings) -> Vec<usize> {
    let longest = stretch.min(settings.window);
    let mut lengths = vec![longest];
    let shorter = longest * 2 / 3;
    if shorter >= settings.min_snapshots {
        lengths.push(shorter);
    }
    lengths
}

pub(crate) fn variations(snapshots: &Snapshots, slots: &[usize], least: &[f64]) -> Vec<f64> {
    least.iter().enumerate().map(|(f, least)| snapshots.variation(f, slots).max(*least)).collect()
}

/// Square of what holding the last state before the tail is off by.
pub(crate) fn hold(window: &Window, tail: usize) -> f64 {
    let a = window.len() - tail - 1;
    let square = |b: usize| window.row(a)[a] - 2.0 * window.row(a)[b] + window.row(b)[b];
    (a + 1..window.len()).map(square).sum::<f64>().max(f64::MIN_POSITIVE)
}

fn tail_errors(
    snapshots: &Snapshots,
    slots: &[usize],
    variation: &[f64],
    least: &[f64],
    predictions: &[Vec<f64>],
) -> Vec<FieldError> {
    let tail = predictions.len();
    let first = slots.len() - tail;
    let single = |slot: usize| spread(snapshots, &[slot], &[1.0]);
    let pairs: Vec<(Combination, Combination)> = predictions
        .iter()
        .zip(&slots[first..])
        .map(|(w, &slot)| (spread(snapshots, slots, w), single(slot)))
        .collect();
    let held = single(slots[first - 1]);
    let fields = snapshots.fields().iter().enumerate();
    fields
        .filter(|(f, _)| variation[*f] > 0.0)
        .map(|(f, field)| {
            let mean = |of: &dyn Fn(&Combination, &Combination) -> f64| {
                let sum: f64 = pairs.iter().map(|(p, x)| of(p, x)).sum();
                sum / tail as f64
            };
            let over = |square: f64| (square / variation[f]).sqrt();
            FieldError {
                name: field.name.clone(),
                error: over(mean(&|p, x| snapshots.distance(f, p, x))),
                hold: over(mean(&|_, x| snapshots.distance(f, &held, x)).max(least[f])),
            }
        })
        .collect()
}

/// Weights of a window's snapshots as a combination by slots.
pub(crate) fn spread(snapshots: &Snapshots, slots: &[usize], weights: &[f64]) -> Combination {
    let mut c = vec![0.0; snapshots.capacity()];
    slots.iter().zip(weights).for_each(|(s, w)| c[*s] = *w);
    Combination(c)
}
