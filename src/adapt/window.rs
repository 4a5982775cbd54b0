//! Which of the solver's steps are kept as frames: at even intervals, a whole number of which is a stride, and no more than
//! fit into memory.

use super::Settings;
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// How much two numbers may differ, relative to one of them, to count as the same time step.
const SAME: f64 = 0.01;

/// A stretch of the solver: its steps between two jumps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Stretch {
    /// Steps from its begin to its first frame.
    first: usize,
    /// Frames that are kept of it.
    kept: usize,
    /// Steps so far.
    steps: usize,
    /// Time of the last step, s.
    time: f64,
}

/// The frames in memory, as the steps of the solver that they are of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Window {
    /// Most frames.
    most: usize,
    /// Longest time from the first frame to the last one, s; none: no limit.
    length: Option<f64>,
    /// The model's stride, s.
    stride: f64,
    /// The solver's time step, s, and how many of them are a stride; none until there are two steps.
    solver: Option<(f64, usize)>,
    /// Solver steps from a frame to the next.
    every: usize,
    stretches: Vec<Stretch>,
}

impl Window {
    /// Without frames. A frame has so many numbers.
    pub fn new(settings: &Settings, stride: f64, numbers: usize) -> Self {
        let room = super::ROOM / (4 * numbers.max(1));
        Window {
            most: settings.max_frames.min(room).max(3),
            length: settings.window,
            stride,
            solver: None,
            every: 1,
            stretches: Vec::new(),
        }
    }

    /// Takes note of a step of the solver, and says whether it is a frame. `begins`: it does not follow the last one.
    ///
    /// # Errors
    /// [`Error::Input`] for a time that is not later than the last one, or a time step of which no whole number is a stride.
    pub fn next(&mut self, time: f64, begins: bool) -> Result<bool> {
        let last = self.stretches.last().map(|s| s.time);
        if !time.is_finite() || last.is_some_and(|last| time <= last) {
            return Err(Error::Input(format!(
                "adapt: a frame of time {time} s after one of {} s: times must increase",
                last.unwrap_or(f64::NAN)
            )));
        }
        let step = last.map_or(f64::NAN, |last| time - last);
        let fresh = Stretch { first: 0, kept: 1, steps: 0, time };
        if begins || last.is_none() {
            self.stretches.push(fresh);
            return Ok(true);
        }
        let known = match self.solver {
            Some((known, _)) => known,
            None => {
                let count = (self.stride / step).round();
                if count < 1.0 || (count * step / self.stride - 1.0).abs() > 1e-3 {
                    return Err(Error::Input(format!(
                        "adapt: the model's stride of {} s is {:.4} of the solver's time steps of {step} s: expected a whole \
                         number of steps; set deltaT so, or leave adapt out",
                        self.stride,
                        self.stride / step
                    )));
                }
                self.solver = Some((step, count as usize));
                step
            }
        };
        if (step / known - 1.0).abs() > SAME {
            // Frames at uneven intervals teach no stride.
            self.stretches.push(fresh);
            return Ok(true);
        }
        let every = self.every;
        let Some(stretch) = self.stretches.last_mut() else {
            return Ok(false);
        };
        stretch.steps += 1;
        stretch.time = time;
        let keep = stretch.steps.is_multiple_of(every);
        if keep && stretch.kept == 0 {
            stretch.first = stretch.steps;
        }
        stretch.kept += usize::from(keep);
        Ok(keep)
    }

    /// After a frame was added: which frames stay, if some have to go.
    pub fn thin(&mut self) -> Option<Vec<bool>> {
        let mut stays = vec![true; self.frames()];
        let newest = self.stretches.last()?.time;
        if let (Some(length), Some((step, _))) = (self.length, self.solver) {
            let most = length + 0.5 * step;
            let age = |s: &Stretch, steps: usize| newest - s.time + (s.steps - steps) as f64 * step;
            self.remove(&mut stays, |s, steps| age(s, steps) <= most);
        }
        if self.frames() > self.most {
            match self.coarser() {
                Some(every) => {
                    self.remove(&mut stays, |_, steps| steps.is_multiple_of(every));
                    self.every = every;
                }
                None => {
                    // An eighth at a time, so that the others are seldom moved.
                    let surplus = self.frames() - self.most * 7 / 8;
                    let mut seen = 0;
                    self.remove(&mut stays, |_, _| {
                        seen += 1;
                        seen > surplus
                    });
                }
            }
        }
        stays.contains(&false).then_some(stays)
    }

    /// Keeps the frames of which `stay` says so, by their stretch and their steps from its begin; asked in order. Clears the
    /// flags of the others.
    fn remove(&mut self, flags: &mut [bool], mut stay: impl FnMut(&Stretch, usize) -> bool) {
        let mut left = flags.iter_mut().filter(|flag| **flag);
        for stretch in &mut self.stretches {
            let steps = (0..stretch.kept).map(|i| stretch.first + i * self.every);
            let mut kept = Vec::new();
            for steps in steps {
                let stays = stay(stretch, steps);
                if let Some(flag) = left.next() {
                    *flag = stays;
                }
                kept.extend(stays.then_some(steps));
            }
            stretch.first = kept.first().copied().unwrap_or(0);
            stretch.kept = kept.len();
        }
        // The last one may go on.
        let last = self.stretches.pop();
        self.stretches.retain(|s| s.kept > 0);
        self.stretches.extend(last);
    }

    /// The next larger interval of which a stride is a whole number.
    fn coarser(&self) -> Option<usize> {
        let (_, stride) = self.solver?;
        (self.every + 1..=stride).find(|n| stride % n == 0 && n % self.every == 0)
    }

    /// Takes the limits of another one for what comes; the frames were read from a file.
    ///
    /// # Errors
    /// What cannot be frames of the same model, for people.
    pub fn follow(&mut self, other: &Window) -> std::result::Result<(), String> {
        let whole = match self.solver {
            Some((step, stride)) => step > 0.0 && stride > 0 && stride.is_multiple_of(self.every),
            None => true,
        };
        let few = |s: &Stretch| s.kept <= super::ROOM && s.first <= s.steps && s.time.is_finite();
        let few = self.stretches.len() <= super::ROOM && self.stretches.iter().all(few);
        if !whole || !few || self.every == 0 || self.stride != other.stride {
            return Err("frames at intervals that are not those of this model".into());
        }
        (self.most, self.length) = (other.most, other.length);
        Ok(())
    }

    /// Without its frames.
    pub fn emptied(&self) -> Self {
        Window { stretches: Vec::new(), ..self.clone() }
    }

    /// Frames in memory.
    pub fn frames(&self) -> usize {
        self.stretches.iter().map(|s| s.kept).sum()
    }

    /// Frames in a stride; none until there are two steps.
    pub fn frames_a_stride(&self) -> Option<usize> {
        self.solver.map(|(_, stride)| stride / self.every)
    }

    /// The frames of each stretch, oldest first.
    pub fn stretches(&self) -> Vec<Range<usize>> {
        let mut first = 0;
        let ranges = self.stretches.iter().map(|s| {
            first += s.kept;
            first - s.kept..first
        });
        ranges.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(max_frames: usize, length: Option<f64>) -> Window {
        let settings = Settings { max_frames, window: length, ..Settings::default() };
        Window::new(&settings, 0.6, 10)
    }

    /// Times of the frames that stay, as memory would hold them.
    fn fill(w: &mut Window, steps: Range<usize>, begins: bool, held: &mut Vec<usize>) {
        let first = steps.start;
        for i in steps {
            if w.next(0.1 * i as f64, begins && i == first).unwrap() {
                held.push(i);
            }
            if let Some(stays) = w.thin() {
                assert_eq!(stays.len(), held.len());
                let mut stays = stays.iter();
                held.retain(|_| *stays.next().unwrap());
            }
            assert_eq!(held.len(), w.frames());
        }
    }

    #[test]
    fn a_full_memory_keeps_even_intervals_that_divide_the_stride() {
        let (mut w, mut held) = (window(10, None), Vec::new());
        fill(&mut w, 0..10, true, &mut held);
        assert_eq!((w.frames_a_stride(), held.len()), (Some(6), 10));
        fill(&mut w, 10..11, false, &mut held);
        assert_eq!((w.frames_a_stride(), &held[..]), (Some(3), &[0, 2, 4, 6, 8, 10][..]));
        fill(&mut w, 11..40, false, &mut held);
        assert_eq!((w.frames_a_stride(), &held[..]), (Some(1), &[0, 6, 12, 18, 24, 30, 36][..]));
        // No coarser interval is left: the oldest ones go.
        fill(&mut w, 40..70, false, &mut held);
        assert_eq!(held.last(), Some(&66));
        assert!(held.len() <= 10 && held.windows(2).all(|p| p[1] - p[0] == 6), "{held:?}");
    }

    #[test]
    fn stretches_count_their_own_steps() {
        let (mut w, mut held) = (window(8, None), Vec::new());
        fill(&mut w, 0..5, true, &mut held);
        fill(&mut w, 11..18, true, &mut held);
        // 0 2 4 of the first one, 11 13 15 17 of the second.
        assert_eq!(held, [0, 2, 4, 11, 13, 15, 17]);
        assert_eq!(w.stretches(), [0..3, 3..7]);
    }

    #[test]
    fn a_length_forgets_what_is_older() {
        let (mut w, mut held) = (window(100, Some(1.0)), Vec::new());
        fill(&mut w, 0..31, true, &mut held);
        assert_eq!(held, (20..31).collect::<Vec<_>>());
    }

    #[test]
    fn times_that_do_not_fit_are_told() {
        let mut w = window(10, None);
        w.next(0.0, false).unwrap();
        assert!(w.next(0.0, false).unwrap_err().to_string().contains("increase"));
        let error = w.next(0.25, false).unwrap_err().to_string();
        assert!(error.contains("2.4") && error.contains("deltaT"), "{error}");
        // An uneven step begins a stretch of its own.
        w.next(0.1, false).unwrap();
        w.next(0.2, false).unwrap();
        assert!(w.next(0.35, false).unwrap());
        assert_eq!(w.stretches(), [0..3, 3..4]);
    }
}
