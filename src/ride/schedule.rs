//! When the solver works, and when a surrogate may.

/// What a host tells of the time at which it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// Time, s.
    pub time: f64,
    /// The solver's time step, s; not read within a jump.
    pub delta_t: f64,
    /// Time at which the run ends, s.
    pub end_time: f64,
    /// Number of the solver's time step, in which a stride counts as the steps that it stands for.
    pub index: i64,
    /// Name of the time in messages.
    pub name: String,
    /// The time as tables have it.
    pub output_time: f64,
    /// Correctors that the solver took in this step, and its cap; none of a solver that has none.
    pub correctors: Option<[usize; 2]>,
    /// Time after which the next state of a jump is wanted, s: a fit says it of any time; 0: at the end of its stride.
    pub within: f64,
}

/// The part of the schedule that the settings fix.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// The solver is alone before, s.
    pub start: f64,
    /// And after, s.
    pub end: f64,
    /// Steps of the solver before each jump.
    pub solver_steps: i64,
    /// Most strides of a jump.
    pub surrogate_steps: usize,
}

impl Schedule {
    /// Whether the solver is alone from here on.
    pub fn is_over(&self, step: &Step) -> bool {
        step.time > self.end + 0.5 * step.delta_t
    }

    /// Whether the surrogate may work from here on.
    pub fn has_begun(&self, step: &Step) -> bool {
        step.time >= self.start - 0.5 * step.delta_t
    }

    /// Whether strides beside the solver are of use: from early enough before the first jump for one.
    pub fn is_measured(&self, step: &Step, stride: f64) -> bool {
        let half = 0.5 * step.delta_t;
        step.time > self.start - 1.5 * stride - half && step.time < self.end + half
    }

    /// Whether there is room behind a time for so many strides, or steps of a length, that leave the solver, whose time step is `delta_t`, the
    /// last step.
    pub fn fits(&self, step: &Step, delta_t: f64, stride: f64, strides: f64) -> bool {
        step.time + strides * stride < (self.end + delta_t).min(step.end_time) - 0.5 * delta_t
    }

    /// Whether it is the end of the run that leaves no room, and not the end of the schedule: the run was stopped, or has come to
    /// its end.
    pub fn is_stopped(&self, step: &Step, delta_t: f64, stride: f64) -> bool {
        let endless = Step { end_time: f64::INFINITY, ..step.clone() };
        !self.fits(step, delta_t, stride, 1.0) && self.fits(&endless, delta_t, stride, 1.0)
    }
}

/// Steps of the solver that a stride stands for.
pub fn steps_of(stride: f64, delta_t: f64) -> i64 {
    ((stride / delta_t).round() as i64).max(1)
}

/// Time to the next state of a jump of a fit, s: that which is wanted, but no more steps of the solver than come to the end of the stride, of
/// which `rest` is left.
pub fn duration(within: f64, rest: f64, delta_t: f64) -> f64 {
    // The last of them may be stretched to a time to write
    let (steps, most) = (steps_of(within, delta_t) as f64, (rest / delta_t - 1e-6).ceil().max(1.0));
    match within > 0.0 {
        true => within * (most / steps).min(1.0),
        false => rest,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::toy::at;

    fn schedule() -> Schedule {
        Schedule { start: 1.0, end: 2.0, solver_steps: 5, surrogate_steps: 4 }
    }

    #[test]
    fn start_and_end_are_met_within_half_a_step() {
        let s = schedule();
        let step = |time| at(time, 0.1, 9.0, 0);
        assert!(!s.has_begun(&step(0.9)) && s.has_begun(&step(0.96)) && s.has_begun(&step(1.0)));
        assert!(!s.is_over(&step(2.04)) && s.is_over(&step(2.06)));
        // A stride of 0.2 and a half of one before the start.
        assert!(!s.is_measured(&step(0.6), 0.2) && s.is_measured(&step(0.7), 0.2));
        assert!(s.is_measured(&step(2.04), 0.2) && !s.is_measured(&step(2.06), 0.2));
    }

    #[test]
    fn a_stride_leaves_the_solver_the_last_step() {
        let s = schedule();
        let fits = |time, end, n| s.fits(&at(time, 0.1, end, 0), 0.1, 0.2, n);
        assert!(fits(1.6, 9.0, 2.0), "to the end of the schedule");
        assert!(!fits(1.7, 9.0, 2.0) && fits(1.7, 9.0, 1.0));
        assert!(fits(1.6, 1.9, 1.0) && !fits(1.6, 1.8, 1.0), "the solver ends the run");
        assert!(s.is_stopped(&at(1.6, 0.1, 1.8, 0), 0.1, 0.2));
        assert!(!s.is_stopped(&at(1.6, 0.1, 1.9, 0), 0.1, 0.2), "there is room");
        assert!(!s.is_stopped(&at(1.95, 0.1, 2.0, 0), 0.1, 0.2), "the schedule is over");
    }

    #[test]
    fn a_part_of_a_stride_ends_at_a_step_of_the_solver() {
        assert_eq!(duration(0.0, 0.25, 0.1), 0.25, "nothing is wanted before its end");
        assert_eq!(duration(0.1, 0.25, 0.1), 0.1);
        assert_eq!(duration(0.07, 0.25, 0.1), 0.07, "a time to write");
        assert_eq!(duration(0.13, 0.05, 0.1), 0.13, "a step that is stretched to one");
        assert!((duration(9.0, 0.25, 0.1) - 0.3).abs() < 1e-12, "three steps come to its end");
        assert!((duration(9.0, 0.3 + 1e-12, 0.1) - 0.3).abs() < 1e-12, "rounding");
        assert_eq!(duration(9.0, 0.01, 0.1), 0.1);
    }

    #[test]
    fn a_stride_is_at_least_a_step() {
        assert_eq!([steps_of(0.05, 0.002), steps_of(0.1, 0.3)], [25, 1]);
    }
}
