//! The choice of a fit: among a few shapes, the one that best predicts the last snapshots of the window from those before.

use crate::dmd::{Delayed, Dmd, Shape, Window};
use crate::driven::{Driven, DrivenShape, Split};
use crate::fit::{FieldError, Fit, FitSettings, Model, errors};
use crate::snapshots::{Combination, Snapshots};
use m4gn_state::Role;

/// Errors of the tail below this are rounding.
const SAME: f64 = 1e-6;

/// A candidate is better than one before it if its error is below this times the other's.
const BETTER: f64 = 0.95;

/// States and directions to choose from with inputs: as few as there can be, since each product with an input is one more to learn.
pub(crate) const DRIVEN_DELAYS: [usize; 2] = [2, 4];
const DRIVEN_RANKS: [usize; 2] = [20, 50];

/// States that a fit with inputs needs at least, and those that are held back from it at least: as many as a first jump has by default, since
/// what a few states say of an input fails soon.
const DRIVEN_LEAST: usize = 40;
const DRIVEN_TAIL: usize = 10;

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

/// Squares of prediction minus state over the tail, and the predictions: the first `window.len() - tail` snapshots predict the others.
pub(crate) fn score(window: &Window, dmd: &Dmd, tail: usize) -> (f64, Vec<Vec<f64>>) {
    let first = window.len() - tail;
    let history: Vec<&[f64]> = (first - dmd.shape.delays..first).map(|i| &window.row(i)[..first]).collect();
    let amplitudes = dmd.amplitudes(&history);
    let predictions: Vec<Vec<f64>> = (1..=tail).map(|s| dmd.weights(&amplitudes, s as f64)).collect();
    (off(window, &predictions), predictions)
}

/// The same with inputs; none where the fit does not reach the end of the tail.
fn driven_score(
    window: &Window,
    inputs: &Window,
    driven: &Driven,
    tail: usize,
) -> Option<(f64, Vec<Vec<f64>>)> {
    let first = window.len() - tail;
    let from = first - driven.shape.delays;
    let inputs: Vec<Vec<f64>> = (from..window.len()).map(|i| driven.input(&inputs.row(i)[..first])).collect();
    let rests: Vec<Vec<f64>> =
        (from..first).zip(&inputs).map(|(i, v)| driven.rest(&window.row(i)[..first], v)).collect();
    let rests = driven.follow(&rests, &inputs).ok()?;
    let pairs = rests.iter().zip(&inputs).skip(driven.shape.delays);
    let predictions: Vec<Vec<f64>> = pairs.map(|(z, v)| driven.weights(z, v)).collect();
    Some((off(window, &predictions), predictions))
}

/// Squares of predictions minus states over the tail.
fn off(window: &Window, predictions: &[Vec<f64>]) -> f64 {
    let first = window.len() - predictions.len();
    let square = |(s, w): (usize, &Vec<f64>)| {
        let mut d = w.clone();
        d.resize(window.len(), 0.0);
        d[first + s] -= 1.0;
        let product = |i: usize| window.row(i).iter().zip(&d).map(|(p, y)| p * y).sum::<f64>();
        d.iter().enumerate().map(|(i, x)| x * product(i)).sum::<f64>().max(0.0)
    };
    let sum: f64 = predictions.iter().enumerate().map(square).sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

/// What was tried.
#[derive(Clone, Copy)]
enum Tried {
    Free(Shape),
    Driven(DrivenShape),
}

/// A shape that was tried on the window without its tail.
struct Candidate {
    /// Square of the tail's error over that of holding.
    score: f64,
    shape: Tried,
    /// Number of its snapshots in the list of those that were looked at.
    last: usize,
    /// Weights of the snapshots for each of the tail.
    predictions: Vec<Vec<f64>>,
}

impl Candidate {
    /// Of states that are all the same: the tail is the mean of those before.
    fn still(last: usize, length: usize, tail: usize) -> Self {
        let first = length - tail;
        let shape = Tried::Free(Shape { delays: 1, rank: 0, growing: false });
        Candidate { score: 0.0, shape, last, predictions: vec![vec![1.0 / first as f64; first]; tail] }
    }
}

/// The last snapshots, as many as a candidate has.
struct Last {
    numbers: Vec<i64>,
    slots: Vec<usize>,
    variation: Vec<f64>,
    whole: Window,
    /// Of what is prescribed alone; none where that does not vary.
    inputs: Option<Window>,
}

impl Last {
    fn new(snapshots: &Snapshots, length: usize, least: &[f64]) -> Self {
        let entries = &snapshots.entries[snapshots.entries.len() - length..];
        let (numbers, slots): (Vec<i64>, Vec<usize>) = entries.iter().map(|e| (e.number, e.slot)).unzip();
        let variation = variations(snapshots, &slots, least);
        let whole = window(snapshots, &slots, &numbers, &variation);
        let prescribed = prescribed(snapshots, &variation);
        let varies = prescribed.iter().any(|v| *v > 0.0);
        let inputs = varies.then(|| window(snapshots, &slots, &numbers, &prescribed));
        Last { numbers, slots, variation, whole, inputs }
    }

    /// The decomposition of this shape.
    fn model(&self, shape: Tried) -> Option<Model> {
        match shape {
            Tried::Free(shape) if shape.rank == 0 => Some(Model::Free(Dmd::still(self.whole.len()))),
            Tried::Free(Shape { delays, rank, growing }) => {
                Delayed::new(&self.whole, delays, rank)?.modes(rank, growing).map(Model::Free)
            }
            Tried::Driven(shape) => {
                Split::new(&self.whole, self.inputs.as_ref()?, shape.rank)?.fit(shape).map(Model::Driven)
            }
        }
    }
}

/// Of each field what it varies by where it is prescribed; 0 for the others.
pub(crate) fn prescribed(snapshots: &Snapshots, variation: &[f64]) -> Vec<f64> {
    let fields = snapshots.fields().iter().zip(variation);
    fields.map(|(f, v)| if f.role == Role::Prescribed { *v } else { 0.0 }).collect()
}

/// The best fit of the last snapshots; a later candidate must be clearly better than the ones before, so that rounding chooses none; none where there are too few without a gap, or nothing has varied.
/// `least`: of each field the square of the least change that errors are over.
pub(crate) fn choose(snapshots: &Snapshots, settings: &FitSettings, least: &[f64]) -> Option<Fit> {
    let numbers: Vec<i64> = snapshots.numbers().collect();
    let gap = numbers.windows(2).rposition(|p| p[1] - p[0] != 1).map_or(0, |i| i + 1);
    let stretch = numbers.len() - gap;
    let mut best: Option<Candidate> = None;
    let mut all: Vec<Last> = Vec::new();
    for length in lengths(stretch, settings).into_iter().filter(|_| stretch >= settings.min_snapshots) {
        let place = all.len();
        all.push(Last::new(snapshots, length, least));
        let last = &all[place];
        let (whole, variation) = (&last.whole, &last.variation);
        if whole.is_still() {
            let moved = variation.iter().any(|v| *v > 0.0);
            best = moved.then(|| Candidate::still(place, length, settings.hold_out));
            break;
        }
        let first = length - settings.hold_out;
        let part = whole.part(0..first);
        let floor: f64 = variation.iter().zip(least).filter(|(v, _)| **v > 0.0).map(|(v, r)| r / v).sum();
        // Squares of windows of another length are over another variation.
        let scale = 1.0 / hold(whole, settings.hold_out).max(settings.hold_out as f64 * floor);
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
                    if let Some(dmd) = delayed.modes(rank, growing) {
                        let shape = Tried::Free(Shape { delays, rank, growing });
                        let scored = score(whole, &dmd, settings.hold_out);
                        better(&mut best, scored, scale, (shape, place));
                    }
                }
            }
        }
    }
    let length = numbers.len().min(settings.window);
    if best.as_ref().is_none_or(|b| b.score > 0.0) && length >= settings.min_snapshots.max(DRIVEN_LEAST) {
        let tail = settings.hold_out.max(DRIVEN_TAIL);
        let place = all.iter().position(|last| last.numbers.len() == length).unwrap_or(all.len());
        if place == all.len() {
            all.push(Last::new(snapshots, length, least));
        }
        driven((&all[place], place), stretch.min(length), tail, &mut best);
    }
    let Candidate { shape, last, predictions, .. } = best?;
    let last = all.swap_remove(last);
    let model = last.model(shape)?;
    let Last { numbers, slots, variation, .. } = last;
    let mut least = least.to_vec();
    if let Model::Driven(_) = model {
        // What an input does at a moment may be little.
        let strides = predictions.len() as i64;
        let of = |f: usize| {
            (1..=strides).map(|s| typical(snapshots, (&numbers, &slots), f, s)).sum::<f64>() / strides as f64
        };
        let measured = variation.iter().enumerate().filter(|(_, v)| **v > 0.0);
        measured.for_each(|(f, _)| least[f] = least[f].max(of(f)));
    }
    let tail = tail_errors(snapshots, &slots, &variation, &least, &predictions);
    Some(Fit { model, numbers, slots, variation, held_back: predictions.len(), tail })
}

/// Takes a candidate that is clearly better than those before. `scored`: square of its error over the tail, and its predictions.
fn better(
    best: &mut Option<Candidate>,
    (sum, predictions): (f64, Vec<Vec<f64>>),
    scale: f64,
    (shape, last): (Tried, usize),
) {
    let score = (sum * scale).max(SAME * SAME);
    if best.as_ref().is_none_or(|b| score < BETTER * BETTER * b.score) {
        *best = Some(Candidate { score, shape, last, predictions });
    }
}

/// The candidates with inputs, where they vary: of all states that are kept, since few that follow each other are enough. `stretch`: those
/// without a gap at the end.
fn driven((last, place): (&Last, usize), stretch: usize, tail: usize, best: &mut Option<Candidate>) {
    let length = last.whole.len();
    let first = length - tail;
    let (whole, Some(inputs)) = (&last.whole, &last.inputs) else { return };
    let split = Split::new(&whole.part(0..first), &inputs.part(0..first), DRIVEN_RANKS[1]);
    let Some(split) = split.filter(|_| stretch >= driven_stretch(tail)) else { return };
    let scale = 1.0 / hold(whole, tail);
    for products in [false, true] {
        for delays in DRIVEN_DELAYS {
            for rank in DRIVEN_RANKS {
                let shape = DrivenShape { delays, rank, products };
                let fit = split.fit(shape);
                if let Some(scored) = fit.and_then(|fit| driven_score(whole, inputs, &fit, tail)) {
                    better(best, scored, scale, (Tried::Driven(shape), place));
                }
            }
        }
    }
}

/// States without a gap at the end that a fit with inputs needs.
pub(crate) fn driven_stretch(hold_out: usize) -> usize {
    hold_out.max(DRIVEN_TAIL) + DRIVEN_DELAYS[1]
}

/// Mean square of what field `f` changes by over so many strides, in the stretches of these states; 0 where there are none.
pub(crate) fn typical(
    snapshots: &Snapshots,
    (numbers, slots): (&[i64], &[usize]),
    f: usize,
    strides: i64,
) -> f64 {
    let (table, c) = (&snapshots.products[f], snapshots.capacity());
    let apart = |i: &usize, j: &usize| numbers[*j] - numbers[*i] == strides;
    let pairs = (0..slots.len())
        .filter_map(|i| (i + 1..slots.len()).find(|j| apart(&i, j)).map(|j| (slots[i], slots[j])));
    let squares = pairs.map(|(a, b)| table[a * c + a] - 2.0 * table[a * c + b] + table[b * c + b]);
    let (sum, count) = squares.fold((0.0, 0), |(sum, n), square| (sum + square.max(0.0), n + 1));
    sum / f64::from(count.max(1))
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

/// Square of the error of holding the last state before the tail.
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
    let first = slots.len() - predictions.len();
    let single = |slot: usize| spread(snapshots, &[slot], &[1.0]);
    let pairs: Vec<(Combination, Combination)> = predictions
        .iter()
        .zip(&slots[first..])
        .map(|(w, &slot)| (spread(snapshots, slots, w), single(slot)))
        .collect();
    let held = single(slots[first - 1]);
    errors(snapshots.fields(), variation, |f| {
        let mean = |of: &dyn Fn(&Combination, &Combination) -> f64| {
            let sum: f64 = pairs.iter().map(|(p, x)| of(p, x)).sum();
            sum / pairs.len() as f64
        };
        let held = mean(&|_, x| snapshots.distance(f, &held, x));
        [mean(&|p, x| snapshots.distance(f, p, x)), held.max(least[f])]
    })
}

/// Weights of a window's snapshots as a combination by slots.
pub(crate) fn spread(snapshots: &Snapshots, slots: &[usize], weights: &[f64]) -> Combination {
    let mut c = vec![0.0; snapshots.capacity()];
    slots.iter().zip(weights).for_each(|(s, w)| c[*s] = *w);
    Combination(c)
}
