//! How hard the solver of a solid works, from its log: correctors of its time steps, and steps that end at their cap.
//!
//! solidDisplacementFoam prints the solves of each corrector, and nothing of how they ended; solids4foam prints the number
//! of the last one, or that they reached their most. Of another log nothing is told. Correctors of m4gnAnderson, which solves
//! a step before it begins, count as those of that step.

use crate::compare::log::{self, Line};
use crate::foam_case::{CorrectorLimits, FoamCase};
use m4gn_mesh::Result;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Steps of the solver that are looked at after each jump.
const AFTER: usize = 5;

/// A time step of the solver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Step {
    time: f64,
    /// Correctors; none where the log does not tell.
    correctors: Option<usize>,
    /// Whether they ended at the most that there may be; none where the log does not tell.
    at_cap: Option<bool>,
    /// Number of jumps before it.
    jumps: usize,
}

/// What a log says of the correctors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Correctors {
    /// Time steps of the solver.
    pub steps: usize,
    /// Most correctors of a step (`nCorrectors`).
    pub cap: Option<usize>,
    /// Mean over the steps.
    pub mean: Option<f64>,
    /// Steps that ended at the cap.
    pub at_cap: Option<usize>,
    /// Those of them at whose time the full run's step did not; none of the full run.
    pub at_cap_alone: Option<usize>,
    /// Mean over the first five steps after each jump (fewer where the next one came before).
    pub after: Option<f64>,
    /// Mean over the full run's steps of the same times.
    pub after_in_full: Option<f64>,
    /// Jumps after which there were steps that both runs have.
    pub hand_backs: usize,
}

/// The steps of a run and where their correctors end.
pub(super) struct Worked {
    steps: Vec<Step>,
    limits: CorrectorLimits,
}

impl Worked {
    /// Of a case that was run; none where there is no log of its solver, or no word of correctors in it.
    ///
    /// # Errors
    /// Of a case that cannot be read.
    pub fn of(case: &Path, solver: &str) -> Result<Option<Self>> {
        let Ok(text) = std::fs::read(case.join(format!("log.{solver}"))) else {
            return Ok(None);
        };
        let text = String::from_utf8_lossy(&text);
        if steps_of(&text, CorrectorLimits::default()).is_none() {
            return Ok(None);
        }
        let limits = FoamCase::open(case)?.corrector_limits()?;
        Ok(steps_of(&text, limits).map(|steps| Worked { steps, limits }))
    }

    /// Of the full run.
    pub fn alone(&self) -> Correctors {
        Correctors::of_full(&self.steps, self.limits)
    }

    /// Beside the full run.
    pub fn beside(&self, full: &Self) -> Correctors {
        Correctors::beside(&full.steps, &self.steps, self.limits)
    }
}

fn steps_of(text: &str, limits: CorrectorLimits) -> Option<Vec<Step>> {
    let (mut steps, mut jumps, mut ahead) = (Vec::new(), 0, 0);
    // Between two steps others solve too: the smoothing after a jump, function objects.
    let mut open: Option<(f64, Counter)> = None;
    for line in log::lines(text) {
        match line {
            Line::Begins(time) => {
                let ahead = std::mem::take(&mut ahead);
                let counter = Counter { ahead, ..Counter::default() };
                open = Some((time, counter));
            }
            Line::Done(_) => {
                if let Some((time, counter)) = open.take() {
                    steps.push(counter.step(time, jumps, limits));
                }
            }
            Line::Other(line) if line.starts_with("m4gn: jumped ") => jumps += 1,
            Line::Other(line) => {
                if let Some(rest) = line.strip_prefix("m4gn: the next time step is solved in ") {
                    ahead = rest.split(' ').next().and_then(|n| n.parse().ok()).unwrap_or(0);
                } else if let Some((_, counter)) = &mut open {
                    counter.line(line);
                }
            }
        }
    }
    let told = |s: &Step| s.correctors.is_some() || s.at_cap.is_some();
    steps.iter().any(told).then_some(steps)
}

/// What the lines of one step say.
#[derive(Default)]
struct Counter {
    /// solids4foam: loops that ended before, number of the present one's last corrector that was printed, and whether one
    /// said that it reached the most.
    loops: usize,
    last: Option<usize>,
    reached: bool,
    /// Correctors of m4gnAnderson.
    ahead: usize,
    /// solidDisplacementFoam: solves of each component, and their last initial residuals.
    solves: [usize; 3],
    residuals: [f64; 3],
}

impl Counter {
    fn line(&mut self, line: &str) {
        if line.starts_with("Corr, res,") {
            self.loops += usize::from(self.last.is_some() || self.reached);
        } else if line.contains("Max iterations reached within") {
            self.reached = true;
        } else if let Some((component, residual)) = solve(line) {
            self.solves[component] += 1;
            self.residuals[component] = residual;
        } else if let Some((number, rest)) = line.split_once(", ")
            && let Ok(number) = number.parse()
            && rest.split(',').count() >= 3
        {
            self.last = Some(number);
        }
    }

    fn step(self, time: f64, jumps: usize, limits: CorrectorLimits) -> Step {
        let solved = self.solves.into_iter().max().filter(|n| *n > 0);
        let (correctors, at_cap) = match (self.last, solved) {
            // Several loops in a step: which of them took what is not told in the same way
            _ if self.loops > 0 => (None, Some(self.reached)),
            // Numbers begin with 0. At the cap only every so many-th is printed.
            _ if self.reached => (limits.most, Some(true)),
            (Some(last), _) => (Some(last + 1), Some(false)),
            (None, Some(n)) => {
                let residual = self.residuals.into_iter().fold(0.0, f64::max);
                // Where only one is allowed there is no tolerance to be reached
                let limits = limits.most.filter(|most| *most > 1).zip(limits.tolerance);
                let at_cap = limits.map(|(most, tolerance)| n >= most && residual > tolerance);
                (Some(n), at_cap)
            }
            (None, None) => (None, None),
        };
        Step { time, correctors: correctors.map(|own| own + self.ahead), at_cap, jumps }
    }
}

/// `DICPCG:  Solving for Dx, Initial residual = 1e-3, ...`: number of the component and residual.
fn solve(line: &str) -> Option<(usize, f64)> {
    let rest = line.split_once("Solving for D")?.1;
    let component = "xyz".find(rest.chars().next()?)?;
    let residual = rest[1..].strip_prefix(", Initial residual = ")?;
    Some((component, residual.split(',').next()?.trim().parse().ok()?))
}

/// Mean of the correctors that are known; none where one is not, or there is none.
fn mean(steps: &[&Step]) -> Option<f64> {
    let all: Option<Vec<usize>> = steps.iter().map(|s| s.correctors).collect();
    let all = all.filter(|a| !a.is_empty())?;
    Some(all.iter().sum::<usize>() as f64 / all.len() as f64)
}

/// The full run's step at the time of one of another run: nearer than a tenth of the full run's step.
fn at<'a>(full: &'a [Step], time: f64) -> Option<&'a Step> {
    let i = full.partition_point(|s| s.time < time);
    let near = |s: &&&Step| (s.time - time).abs();
    let neighbours = [i.checked_sub(1).and_then(|i| full.get(i)), full.get(i)];
    let found: &'a Step = neighbours.iter().flatten().min_by(|a, b| near(a).total_cmp(&near(b)))?;
    let spacing = full.windows(2).map(|w| w[1].time - w[0].time).fold(f64::INFINITY, f64::min);
    (near(&&found) <= 0.1 * spacing).then_some(found)
}

impl Correctors {
    /// Of the full run.
    fn of_full(steps: &[Step], limits: CorrectorLimits) -> Self {
        let caps: Option<Vec<bool>> = steps.iter().map(|s| s.at_cap).collect();
        Correctors {
            steps: steps.len(),
            cap: limits.most,
            mean: mean(&steps.iter().collect::<Vec<_>>()),
            at_cap: caps.map(|caps| caps.iter().filter(|c| **c).count()),
            ..Correctors::default()
        }
    }

    /// Of another run of the same case.
    fn beside(full: &[Step], steps: &[Step], limits: CorrectorLimits) -> Self {
        let whole = Correctors::of_full(steps, limits);
        let capped = steps.iter().filter(|s| s.at_cap == Some(true));
        let alone = capped.map(|s| Some(!at(full, s.time).map_or(Some(false), |f| f.at_cap)?));
        let alone: Option<Vec<bool>> = alone.collect();
        let (mut after, mut after_in_full, mut hand_backs) = (Vec::new(), Vec::new(), 0);
        for first in
            (0..steps.len()).filter(|&i| steps[i].jumps > i.checked_sub(1).map_or(0, |b| steps[b].jumps))
        {
            let window = steps[first..].iter().take(AFTER);
            let window = window.take_while(|s| s.jumps == steps[first].jumps);
            let both: Vec<_> = window.filter_map(|s| Some((s, at(full, s.time)?))).collect();
            hand_backs += usize::from(!both.is_empty());
            after.extend(both.iter().map(|b| b.0));
            after_in_full.extend(both.iter().map(|b| b.1));
        }
        Correctors {
            at_cap_alone: whole.at_cap.and(alone).map(|alone| alone.iter().filter(|a| **a).count()),
            after: mean(&after),
            after_in_full: mean(&after_in_full),
            hand_backs,
            ..whole
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAP: CorrectorLimits = CorrectorLimits { most: Some(4), tolerance: Some(1e-6) };

    /// A step of solidDisplacementFoam with these last residuals of its correctors, in x; in y they are smaller.
    fn stock(time: f64, residuals: &[f64]) -> String {
        let solves = residuals.iter().map(|r| {
            let line = |c: &str, r: f64| {
                format!("DICPCG:  Solving for D{c}, Initial residual = {r}, Final residual = 1e-9, No Iterations 3\n")
            };
            line("x", *r) + &line("y", 0.1 * r)
        });
        let solves: String = solves.collect();
        format!("Iteration: {time}\n\n{solves}ExecutionTime = 1 s  ClockTime = 1 s\n\n")
    }

    fn jumped() -> &'static str {
        "m4gn: jumped 18 steps of 0.02 s to time 0.5 in 0.1 s\n\nDICPCG:  Solving for Dx, Initial residual = 1, Final \
         residual = 0.1, No Iterations 1\n\n"
    }

    #[test]
    fn stock_solver_on_paper() {
        let full: String = (1..=12).map(|i| stock(0.1 * f64::from(i), &[1e-3, 1e-5, 1e-7])).collect();
        let full = steps_of(&full, CAP).unwrap();
        let found = Correctors::of_full(&full, CAP);
        assert_eq!(
            (found.steps, found.mean, found.at_cap, found.at_cap_alone),
            (12, Some(3.0), Some(0), None)
        );
        // The cap and not the tolerance; the cap and the tolerance in the same corrector; one corrector; then the end
        let hybrid = stock(0.1, &[1e-3, 1e-5, 1e-7])
            + jumped()
            + &stock(0.6, &[1e-2, 1e-3, 1e-4, 1e-5])
            + &stock(0.7, &[1e-2, 1e-3, 1e-4, 1e-7])
            + jumped()
            + &stock(1.2, &[1e-7]);
        let hybrid = steps_of(&hybrid, CAP).unwrap();
        let found = Correctors::beside(&full, &hybrid, CAP);
        assert_eq!((found.steps, found.at_cap, found.at_cap_alone), (4, Some(1), Some(1)));
        assert_eq!((found.after, found.after_in_full, found.hand_backs), (Some(3.0), Some(3.0), 2));
        // Where the full run stops there as well the step is none of the surrogate's
        let mut hard = full.clone();
        hard[5].at_cap = Some(true);
        assert_eq!(Correctors::beside(&hard, &hybrid, CAP).at_cap_alone, Some(0));
        // A cap that is not known says nothing of it
        let unknown = CorrectorLimits::default();
        let steps = steps_of(&stock(0.1, &[1e-3; 4]), unknown).unwrap();
        let found = Correctors::of_full(&steps, unknown);
        assert_eq!((found.mean, found.at_cap), (Some(4.0), None));
    }

    #[test]
    fn five_steps_after_a_jump_and_no_more() {
        let full: String = (1..=20).map(|i| stock(0.1 * f64::from(i), &[1e-7])).collect();
        let tail: String = (6..=12).map(|i| stock(0.1 * f64::from(i), &vec![1e-7; i as usize])).collect();
        let loose = CorrectorLimits { most: Some(100), ..CAP };
        let full = steps_of(&full, loose).unwrap();
        let hybrid = steps_of(&(stock(0.1, &[1e-7]) + jumped() + &tail), loose).unwrap();
        let found = Correctors::beside(&full, &hybrid, loose);
        // 6, 7, 8, 9 and 10
        assert_eq!((found.after, found.after_in_full), (Some(8.0), Some(1.0)));
    }

    #[test]
    fn solids4foam_says_how_they_ended() {
        let text = "Time = 0.005\n\nEvolving solid solver\nSolving the total Lagrangian form of the momentum equation for D\n    \
             Corr, res, relRes, matRes, iters\n    100, 1e-3, 2e-3, 0, 4\n    Both residuals have converged\n    \
             136, 9.1e-07, 8e-07, 0, 1\n\nExecutionTime = 1.2 s  ClockTime = 1 s\n\n\
             Time = 0.01\n\n    Corr, res, relRes, matRes, iters\n    100, 1e-3, 2e-3, 0, 4\n--> FOAM Warning : Max \
             iterations reached within momentum loop\nExecutionTime = 1.9 s  ClockTime = 2 s\n\n\
             m4gn: jumped 10 steps of 0.02 s to time 0.21 in 0.01 s; gap 0.001\n\n\
             Time = 0.215\n\n    Corr, res, relRes, matRes, iters\n    The solver residual has converged\n    \
             2, 9.1e-07, 8e-07, 0, 1\n\nExecutionTime = 2 s  ClockTime = 2 s\n\n";
        let most = CorrectorLimits { most: Some(200), tolerance: None };
        let steps = steps_of(text, most).unwrap();
        let found: Vec<_> = steps.iter().map(|s| (s.time, s.correctors, s.at_cap, s.jumps)).collect();
        assert_eq!(
            found,
            [
                (0.005, Some(137), Some(false), 0),
                (0.01, Some(200), Some(true), 0),
                (0.215, Some(3), Some(false), 1)
            ]
        );
        let found = Correctors::of_full(&steps, most);
        assert_eq!((found.at_cap, found.mean), (Some(1), Some(340.0 / 3.0)));
        // Solved ahead by m4gnAnderson: counted with the step
        let ahead = text
            .replace("Time = 0.215", "m4gn: the next time step is solved in 40 correctors\n\nTime = 0.215");
        let correctors: Vec<_> = steps_of(&ahead, most).unwrap().iter().map(|s| s.correctors).collect();
        assert_eq!(correctors, [Some(137), Some(200), Some(43)]);
        // Without the most that there may be the steps at it are counted all the same, and no mean is made up
        let steps = steps_of(text, CorrectorLimits::default()).unwrap();
        let found = Correctors::of_full(&steps, CorrectorLimits::default());
        assert_eq!((found.at_cap, found.mean), (Some(1), None));
    }

    #[test]
    fn other_logs_tell_nothing() {
        let flow = "Time = 1\n\nCourant Number mean: 0.1 max: 0.9\nsmoothSolver:  Solving for Ux, Initial residual = 1, Final \
             residual = 1e-6, No Iterations 3\nExecutionTime = 1 s  ClockTime = 1 s\n";
        assert_eq!(steps_of(flow, CAP), None);
        assert_eq!(steps_of("", CAP), None);
    }
}
