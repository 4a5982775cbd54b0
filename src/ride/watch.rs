//! How hard the solver works in its first steps after a jump.
//!
//! A solver that stops at its cap of correctors has not solved its equations. If it does so in one of the first five steps after a jump, and
//! the median of its steps before was below the cap, the next jumps have half as many strides; if the jump was of one, there are no more.

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Steps of the solver that are watched after a jump.
const AFTER: usize = 5;

/// Steps of the solver before a jump whose median is taken, at most.
const BEFORE: usize = 50;

/// The watch over the solver's correctors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Watch {
    /// Correctors of the last steps, but for the first ones after a jump.
    before: Vec<usize>,
    /// Correctors of the first steps after the last jump.
    after: Vec<usize>,
    /// Whether some of these are still to come.
    watching: bool,
    /// Strides of the last jump.
    jump: usize,
    /// Most strides of the next jump; none: no limit.
    most: Option<usize>,
    /// The solver's cap.
    cap: usize,
    /// Jumps that were judged, those after which the solver stopped at its cap, and the sums of the medians before and the means after.
    judged: usize,
    capped: usize,
    sums: [f64; 2],
}

/// What is to be said of a jump.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// For the log.
    pub note: String,
    /// Where there are no more jumps.
    pub warning: Option<String>,
    /// The same as data.
    pub decided: Value,
}

impl Watch {
    /// The solver has made a step with so many correctors, at most so many.
    pub fn stepped(&mut self, time: &str, [made, most]: [usize; 2]) -> Option<Judgement> {
        self.cap = most;
        if self.watching {
            self.after.push(made);
            return (self.after.len() == AFTER).then(|| self.judge(time)).flatten();
        }
        if self.before.len() == BEFORE {
            self.before.remove(0);
        }
        self.before.push(made);
        None
    }

    /// A jump of so many strides has ended.
    pub fn handed_back(&mut self, strides: usize) {
        self.jump = strides;
        self.after.clear();
        self.watching = true;
    }

    /// Most strides of the jump that may begin now, where so many are wanted.
    pub fn most(&mut self, time: &str, wanted: usize) -> (usize, Option<Judgement>) {
        // It may come before five steps of the solver.
        let judgement = self.watching.then(|| self.judge(time)).flatten();
        (self.most.map_or(wanted, |most| wanted.min(most)), judgement)
    }

    fn judge(&mut self, time: &str) -> Option<Judgement> {
        self.watching = false;
        let mut sorted = self.before.clone();
        sorted.sort_unstable();
        let usual = *sorted.get(sorted.len().checked_sub(1)? / 2)?;
        if self.after.is_empty() {
            return None;
        }
        let n = self.after.len() as f64;
        self.judged += 1;
        self.sums[0] += usual as f64;
        self.sums[1] += self.after.iter().map(|&made| made as f64 / n).sum::<f64>();
        let list: Vec<String> = self.after.iter().map(usize::to_string).collect();
        let mut note = format!(
            "m4gn: correctors of the solver's first steps after the jump: {}; median of the steps before it: {usual}\n\n",
            list.join(" ")
        );
        // Without correctors (1) there is no tolerance to be reached.
        let cap = self.cap;
        let mut warning = None;
        if cap >= 2 && usual < cap && self.after.iter().any(|&made| made >= cap) {
            self.capped += 1;
            let most = self.jump / 2;
            self.most = Some(most);
            match most {
                0 => {
                    warning = Some(format!(
                        "The solver stopped at its cap of {cap} correctors (nCorrectors) up to time {time}, after a jump of one step of \
                         the surrogate; a median of {usual} was enough before. The run goes on with the solver alone\n    Allow more \
                         correctors, or a smaller error of what is handed back: a lower fitTolerance of dmd"
                    ));
                }
                _ => {
                    note += &format!(
                        "m4gn: the solver stopped at its cap of {cap} correctors after a jump of {} steps: the next jumps have {most} \
                         at most\n\n",
                        self.jump
                    );
                }
            }
        }
        let decided = json!({"before": usual, "after": self.after, "cap": cap, "most": self.most});
        Some(Judgement { note, warning, decided })
    }

    /// Jumps that were judged, the means over them of the median before and of the mean after, and how many led to the cap; none where
    /// none was judged.
    pub fn summary(&self) -> Option<(usize, [f64; 2], usize)> {
        let n = self.judged as f64;
        (self.judged > 0).then(|| (self.judged, self.sums.map(|sum| sum / n), self.capped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A watch that has seen steps of these correctors, and then a jump of so many strides.
    fn jumped(before: &[usize], strides: usize) -> Watch {
        let mut watch = Watch::default();
        for &made in before {
            assert_eq!(watch.stepped("0", [made, 10]), None);
        }
        watch.handed_back(strides);
        watch
    }

    fn steps(watch: &mut Watch, after: &[usize]) -> Option<Judgement> {
        let judgement = after.iter().filter_map(|&made| watch.stepped("1.5", [made, 10]));
        judgement.last()
    }

    #[test]
    fn a_solver_that_does_not_stop_at_its_cap_is_let_be() {
        let mut watch = jumped(&[2, 9, 4], 7);
        let judgement = steps(&mut watch, &[5, 6, 7, 8, 9]).unwrap();
        assert!(
            judgement.note.contains("jump: 5 6 7 8 9; median of the steps before it: 4"),
            "{judgement:?}"
        );
        assert_eq!((watch.most("2", 7), judgement.warning), ((7, None), None));
        assert_eq!(watch.summary(), Some((1, [4.0, 7.0], 0)));
        // The steps behind the fifth are again those before a jump.
        assert_eq!(steps(&mut watch, &[10, 10]), None);
    }

    #[test]
    fn one_that_does_makes_the_next_jumps_shorter_until_there_are_none() {
        let mut watch = jumped(&[4], 3);
        let judgement = steps(&mut watch, &[4, 4, 10, 4, 4]).unwrap();
        assert!(judgement.note.contains("a jump of 3 steps: the next jumps have 1 at most"), "{judgement:?}");
        assert_eq!(watch.most("2", 7), (1, None));
        watch.handed_back(1);
        let (most, judgement) = {
            watch.stepped("2.5", [10, 10]);
            watch.most("2.6", 7)
        };
        // Judged by one step, since the next jump comes at once.
        assert_eq!(most, 0);
        let warning = judgement.unwrap().warning.unwrap();
        assert!(warning.contains("up to time 2.6, after a jump of one step"), "{warning}");
        assert_eq!(watch.summary(), Some((2, [4.0, (26.0 / 5.0 + 10.0) / 2.0], 2)));
    }

    #[test]
    fn without_a_cap_or_where_it_was_reached_before_nothing_follows() {
        for (before, cap) in [(vec![1], 1), (vec![10, 10], 10)] {
            let mut watch = Watch::default();
            for made in before {
                watch.stepped("0", [made, cap]);
            }
            watch.handed_back(4);
            for _ in 0..5 {
                watch.stepped("1", [cap, cap]);
            }
            assert_eq!(watch.most("2", 7).0, 7);
            assert_eq!(watch.summary().unwrap().2, 0);
        }
        // Nothing was seen before, or nothing after.
        assert_eq!(steps(&mut jumped(&[], 4), &[10; 5]), None);
        assert_eq!(jumped(&[4], 4).most("1", 7), (7, None));
        assert_eq!(jumped(&[4], 4).summary(), None);
    }

    #[test]
    fn the_median_is_of_the_last_fifty_steps() {
        let mut before = vec![9; 60];
        before.extend([3; 30]);
        let mut watch = jumped(&before, 1);
        assert!(steps(&mut watch, &[3; 5]).unwrap().note.contains("before it: 3"));
    }
}
