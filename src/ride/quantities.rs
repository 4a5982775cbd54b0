//! What other parts of a run report of each state (a drag, a probe), and how far jumps may go by it.
//!
//! A host tells the values after each step of the solver and after each stride. Where a jump ends, the value of its last state is compared
//! with the one that the solver's first two steps from there lead back to, relative to the root mean square of what the solver's values
//! vary by about their mean. Beyond the tolerance the next jump has half as many strides at most, and none any more after one of a single
//! stride; within it, half as many again as the last one that was limited.

use crate::watch::Judgement;
use m4gn_base::settings;
use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::VecDeque;

/// Values of the solver that a variation is taken over, at most.
const WINDOW: usize = 2000;

/// Of a value: what it differs by below this is rounding.
const ROUNDING: f64 = 1e-12;

settings! {
    /// A result of another function object whose error is limited.
    pub struct QuantitySettings in "quantities" {
        /// Name of the function object whose result it is.
        pub object: String;
        /// Name of the result.
        pub result: String;
        /// Largest error at the end of a jump, over the result's variation.
        pub tolerance: f64;
    }
}

impl QuantitySettings {
    pub(crate) fn check(&self) -> Result<()> {
        match self.tolerance.is_finite()
            && self.tolerance > 0.0
            && !self.object.is_empty()
            && !self.result.is_empty()
        {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "ride: quantities: object '{}', result '{}', tolerance {}: expected two names and an error above 0, such as 0.01",
                self.object, self.result, self.tolerance
            ))),
        }
    }
}

/// One of them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Track {
    /// Of the solver.
    values: VecDeque<f64>,
    /// Of the last state.
    last: Option<f64>,
    /// The largest error at the end of a jump so far, over the variation.
    worst: f64,
}

impl Track {
    /// Root mean square about the mean; 0 where that is rounding.
    fn variation(&self) -> f64 {
        let n = self.values.len().max(1) as f64;
        let mean = self.values.iter().sum::<f64>() / n;
        let square = self.values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
        if square > (ROUNDING * mean).powi(2) { square.sqrt() } else { 0.0 }
    }
}

/// The quantities of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Quantities {
    /// Object and result of each.
    names: Vec<[String; 2]>,
    tracks: Vec<Track>,
    /// Of the state that a jump ended with, and of the solver's first step from it; none where they are no numbers. Times of both, s.
    handed_back: Vec<Option<f64>>,
    first: Vec<Option<f64>>,
    times: [f64; 2],
    /// Strides of the jump that is judged.
    jump: usize,
    /// Most strides of the next jump; none: no limit.
    most: Option<usize>,
    judged: usize,
    beyond: usize,
    /// Number of the time step whose values were reported last.
    pub index: Option<i64>,
}

impl Quantities {
    /// Nothing is known of these yet.
    pub fn new(settings: &[QuantitySettings]) -> Self {
        let names = settings.iter().map(|s| [s.object.clone(), s.result.clone()]).collect();
        Quantities { names, tracks: vec![Track::default(); settings.len()], ..Quantities::default() }
    }

    /// Goes on from those of another run, if they are the same results.
    pub fn carry_on(&mut self, saved: Quantities) {
        if saved.names == self.names {
            *self = saved;
        }
    }

    /// The values after the present state: of the solver, or of a stride. `time`: s, and its name. Says what came of a comparison.
    pub fn reported(
        &mut self,
        settings: &[QuantitySettings],
        values: &[f64],
        solver: bool,
        time: (f64, &str),
    ) -> Option<Judgement> {
        let mut judgement = None;
        if solver && !self.handed_back.is_empty() {
            match self.first.is_empty() {
                true => {
                    self.first = values.iter().map(|v| v.is_finite().then_some(*v)).collect();
                    self.times[1] = time.0;
                }
                false => judgement = Some(self.judge(settings, values, time)),
            }
        }
        for (track, &value) in self.tracks.iter_mut().zip(values) {
            track.last = value.is_finite().then_some(value);
            if solver && value.is_finite() {
                if track.values.len() == WINDOW {
                    track.values.pop_front();
                }
                track.values.push_back(value);
            }
        }
        judgement
    }

    /// A jump of so many strides has ended with the state that was reported last, of this time, s.
    pub fn handed_back(&mut self, strides: usize, time: f64) {
        (self.jump, self.times[0]) = (strides, time);
        self.first.clear();
        self.handed_back = self.tracks.iter().map(|t| t.last).collect();
    }

    /// Most strides of a jump, where so many are wanted.
    pub fn most(&self, wanted: usize) -> usize {
        self.most.map_or(wanted, |most| wanted.min(most))
    }

    fn judge(
        &mut self,
        settings: &[QuantitySettings],
        second: &[f64],
        (now, time): (f64, &str),
    ) -> Judgement {
        let (handed, first) = (std::mem::take(&mut self.handed_back), std::mem::take(&mut self.first));
        // Solvers adjust their steps
        let [begun, stepped] = self.times;
        let steps = (stepped - begun) / (now - stepped);
        let (mut errors, mut decided, mut beyond) = (Vec::new(), Vec::new(), false);
        for (i, s) in settings.iter().enumerate() {
            let variation = self.tracks[i].variation();
            let off = match (handed[i], first[i]) {
                (Some(handed), Some(first)) => {
                    let off = (handed - first + steps * (second[i] - first)).abs();
                    // What the solver holds to the last digits, such as a flow rate, comes out of a jump with other ones
                    if off <= ROUNDING * handed.abs() { 0.0 } else { off }
                }
                _ => f64::INFINITY,
            };
            let error = match (off, variation) {
                (0.0, _) => 0.0,
                (off, v) if off.is_finite() && v > 0.0 => off / v,
                _ => f64::INFINITY,
            };
            // JSON, which the state is kept in, has no infinity.
            self.tracks[i].worst = self.tracks[i].worst.max(error).min(f64::MAX);
            beyond |= error > s.tolerance;
            decided.push(
                json!({"object": s.object, "result": s.result, "error": error, "tolerance": s.tolerance}),
            );
            errors.push(format!(
                "{} of {} had an error of {error:.2e} of what it varies by (tolerance {})",
                s.result, s.object, s.tolerance
            ));
        }
        self.judged += 1;
        let mut note = format!("m4gn: time {time}: at the end of the jump {}", errors.join("; "));
        let mut warning = None;
        if beyond {
            self.beyond += 1;
            let most = self.jump / 2;
            self.most = Some(most);
            note += &format!("; the next jumps have {most} strides at most");
            if most == 0 {
                warning = Some(format!(
                    "At time {time} a jump of one stride left a quantity further off than its tolerance allows: {}. The run goes on with the \
                     solver alone\n    Raise the tolerance, or leave the quantity out",
                    errors.join("; ")
                ));
            }
        } else if let Some(most) = self.most.filter(|most| *most > 0 && self.jump >= *most) {
            self.most = Some(most + most.div_ceil(2));
        }
        let decided = json!({"quantities": decided, "beyond": beyond, "most": self.most});
        Judgement { note: note + "\n\n", warning, decided }
    }

    /// Entries of the summary: of each quantity the worst error at the end of a jump, then how many jumps were judged and beyond.
    pub fn summary(&self, settings: &[QuantitySettings]) -> Vec<(String, f64)> {
        if self.judged == 0 {
            return Vec::new();
        }
        let worst = settings.iter().zip(&self.tracks);
        let mut all: Vec<(String, f64)> =
            worst.map(|(s, t)| (format!("worst_{}_{}", s.object, s.result), t.worst.min(1e15))).collect();
        all.push(("quantities_judged".into(), self.judged as f64));
        all.push(("quantities_beyond".into(), self.beyond as f64));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> Vec<QuantitySettings> {
        vec![QuantitySettings { object: "forces".into(), result: "Cd".into(), tolerance: 0.05 }]
    }

    /// Forty steps of the solver about 3, of a variation of 1.
    fn after_steps() -> Quantities {
        let mut q = Quantities::new(&settings());
        for i in 0..40 {
            let judgement = q.reported(&settings(), &[if i % 2 == 0 { 2.0 } else { 4.0 }], true, (1.0, "1"));
            assert_eq!(judgement, None);
        }
        q
    }

    fn jump(q: &mut Quantities, strides: usize, ends: f64, steps: [f64; 2]) -> Judgement {
        q.reported(&settings(), &[ends], false, (2.0, "2"));
        q.handed_back(strides, 2.0);
        assert_eq!(q.reported(&settings(), &[steps[0]], true, (2.125, "2.125")), None);
        q.reported(&settings(), &[steps[1]], true, (2.25, "2.25")).unwrap()
    }

    #[test]
    fn the_end_of_a_jump_is_compared_with_what_the_solver_leads_back_to() {
        let mut q = after_steps();
        assert_eq!(q.most(60), 60);
        // On the line through the solver's steps: nothing is off.
        let held = jump(&mut q, 60, 3.0, [3.1, 3.2]);
        assert!(held.note.contains("Cd of forces") && held.warning.is_none(), "{held:?}");
        assert_eq!(q.most(60), 60);
        // A tenth of the variation is beyond a twentieth.
        jump(&mut q, 60, 3.1, [3.0, 3.0]);
        assert_eq!(q.most(60), 30);
        jump(&mut q, 30, 3.0, [3.0, 3.0]);
        assert_eq!(q.most(60), 45);
        let summary = q.summary(&settings());
        assert_eq!(summary[0].0, "worst_forces_Cd");
        assert!((summary[0].1 - 0.1).abs() < 0.02, "{summary:?}");
        assert_eq!((summary[1].1, summary[2].1), (3.0, 1.0));
    }

    #[test]
    fn a_constant_that_a_jump_rounds_otherwise_is_held() {
        let mut q = Quantities::new(&settings());
        for _ in 0..9 {
            q.reported(&settings(), &[0.3], true, (1.0, "1"));
        }
        let held = jump(&mut q, 8, 0.1 + 0.2, [0.3, 0.3]);
        assert!(held.warning.is_none() && q.most(60) == 60, "{held:?}");
        jump(&mut q, 8, 0.3 + 1e-9, [0.3, 0.3]);
        assert_eq!(q.most(60), 4);
    }

    #[test]
    fn steps_that_are_adjusted_lead_back_to_the_same() {
        let mut q = after_steps();
        q.reported(&settings(), &[3.0], false, (2.0, "2"));
        q.handed_back(60, 2.0);
        q.reported(&settings(), &[3.25], true, (2.25, "2.25"));
        q.reported(&settings(), &[4.0], true, (3.0, "3"));
        assert!(q.most(60) == 60 && q.summary(&settings())[0].1 < 1e-12);
    }

    #[test]
    fn what_is_no_number_is_kept_for_a_run_that_is_carried_on() {
        let mut q = after_steps();
        jump(&mut q, 8, f64::NAN, [3.0, 3.0]);
        // What never varied, and is off after a jump.
        q.tracks[0].values = [1.0; 9].into();
        jump(&mut q, 8, 2.0, [1.0, 1.0]);
        q.reported(&settings(), &[f64::INFINITY], false, (3.0, "3"));
        q.handed_back(4, 3.0);
        q.reported(&settings(), &[f64::NAN], true, (3.1, "3.1"));
        let text = serde_json::to_string(&q).unwrap();
        assert_eq!(serde_json::from_str::<Quantities>(&text).unwrap(), q, "{text}");
    }

    #[test]
    fn other_results_begin_anew_in_a_run_that_is_carried_on() {
        let mut saved = after_steps();
        saved.handed_back(4, 2.0);
        let lift = QuantitySettings { result: "Cl".into(), ..settings().remove(0) };
        let both = [settings(), vec![lift]].concat();
        let mut q = Quantities::new(&both);
        q.carry_on(saved.clone());
        assert_eq!(q, Quantities::new(&both));
        for time in [2.1, 2.2] {
            assert_eq!(q.reported(&both, &[3.0, 0.1], true, (time, "2")), None);
        }
        let mut q = Quantities::new(&settings());
        q.carry_on(saved.clone());
        assert_eq!(q, saved);
    }

    #[test]
    fn after_a_single_stride_beyond_there_are_no_more_jumps() {
        let mut q = after_steps();
        let held = jump(&mut q, 1, 4.0, [3.0, 3.0]);
        assert!(held.warning.is_some_and(|w| w.contains("solver alone")));
        assert_eq!(q.most(60), 0);
        // What is not reported is no value within a tolerance.
        let mut q = after_steps();
        jump(&mut q, 8, f64::NAN, [3.0, 3.0]);
        assert_eq!(q.most(60), 4);
    }
}
