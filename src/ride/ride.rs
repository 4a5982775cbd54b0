//! The state machine: what a host tells, and what it is to do next.

use crate::control::Control;
use crate::jump::Jump;
use crate::log::Log;
use crate::observe::Observer;
use crate::quantities::Quantities;
use crate::rider::Rider;
use crate::schedule::{Schedule, Step};
use crate::settings::{AdaptEntries, Mode, RideSettings};
use crate::surrogate::Surrogate;
use crate::tables::Digits;
use crate::totals::Totals;
use crate::values::Given;
use crate::watch::Watch;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;

/// What a host is to do next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// Let the solver make a step, and tell with [`Ride::solved`].
    Solve,
    /// Ask with [`Ride::decide`].
    Decide,
    /// Take a stride with [`Ride::stride`].
    Stride,
    /// Advance the time and the fields to what was predicted, and tell with [`Ride::advanced`].
    Advance,
    /// Leave the fields as a state that the solver carries on from, and tell with [`Ride::handed_back`].
    HandBack,
}

/// An answer of the ride.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// What to do next.
    pub action: Action,
    /// Which surrogate jumps.
    pub surrogate: usize,
    /// Strides of the jump that are left; of [`Action::HandBack`] those that a run which is carried on from here takes: it was stopped.
    pub strides: usize,
    /// Of [`Action::Advance`]: time by which the stride advances, s.
    pub duration: f64,
    /// And the steps of the solver that it stands for.
    pub solver_steps: i64,
    /// Whether one stride is left of the jump: the next state is handed back.
    pub last_but_one: bool,
    /// Whether the next call is to be given the fields.
    pub fields: bool,
    /// Whether the arrays of the state are wanted by [`Ride::record`] first.
    pub arrays: bool,
    /// Steps of the solver since the last jump; -1: there was none.
    pub since: i64,
    /// Within a jump the solver's time step, s; else 0.
    pub delta_t: f64,
    /// Whether a surrogate has taken a stride, beside the solver or in its place.
    pub stepped: bool,
}

/// Where the run is.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Phase {
    /// The solver works.
    Solving,
    /// It has made a step, or a run was carried on behind one.
    Deciding,
    /// Strides are taken.
    Jumping(Jump),
    /// A stride was predicted.
    Advancing(Jump),
    /// The state is being handed back.
    HandingBack(Jump),
}

/// A hybrid run.
pub struct Ride<'a> {
    pub(crate) comm: Comm,
    pub(crate) settings: RideSettings,
    pub(crate) adapt: AdaptEntries,
    pub(crate) schedule: Schedule,
    pub(crate) riders: Vec<Rider<'a>>,
    /// Fields of the tables: those of all surrogates.
    pub(crate) fields: Vec<String>,
    pub(crate) watch: Watch,
    pub(crate) quantities: Quantities,
    pub(crate) totals: Totals,
    /// Number of this rank's rows in the undecomposed mesh.
    pub(crate) global: Vec<i64>,
    /// Rows of the undecomposed mesh.
    pub(crate) rows: usize,
    /// Time from which the solver's steps are frames, s.
    pub(crate) adapt_start: f64,
    /// Index of the time step at which the solver last took over.
    pub(crate) handed_back: i64,
    pub(crate) phase: Phase,
    /// As the host told last.
    pub(crate) step: Step,
    /// Whether a surrogate has taken a stride.
    pub(crate) stepped: bool,
    pub(crate) log: Log,
}

impl<'a> Ride<'a> {
    /// Of surrogates on the host's mesh, from the present time on. `global`: the numbers of this rank's rows (cells) in the undecomposed
    /// mesh, in whose order a state is written. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that do not fit the surrogates.
    pub fn new(
        comm: Comm,
        surrogates: Vec<Box<dyn Surrogate + 'a>>,
        settings: RideSettings,
        global: Vec<i64>,
        start: Step,
    ) -> Result<Self> {
        let digits = Digits(settings.write_precision);
        let adapt = settings.adapt_entries()?;
        let observing = settings.mode == Mode::Observe;
        if surrogates.is_empty() || surrogates.len() > 1 && !observing && settings.control.is_none() {
            return Err(Error::Input(match surrogates.len() {
                0 => "ride: expected at least one surrogate".into(),
                n => format!(
                    "ride: {n} surrogates: which one jumps is chosen by what they are off by beside the solver, which control measures; \
                     give control, or one surrogate"
                ),
            }));
        }
        let mut rows = [global.len() as i64];
        comm.sum_i64(&mut rows);
        let mut settings = settings;
        watch_alike(&surrogates, &mut settings)?;
        let mut fields: Vec<String> = Vec::new();
        for advanced in surrogates.iter().flat_map(|s| s.advances()) {
            if !fields.contains(&advanced.name) {
                fields.push(advanced.name.clone());
            }
        }
        let mut log = Log::default();
        let mut riders = Vec::new();
        for surrogate in surrogates {
            let stride = surrogate.stride();
            if stride < start.delta_t * (1.0 - 1e-6) {
                return Err(Error::Input(format!(
                    "the stride of {}, {} s, is shorter than the solver's time step, {} s: nothing can be compared, or saved",
                    surrogate.source(),
                    digits.of(stride),
                    digits.of(start.delta_t)
                )));
            }
            riders.push(Rider::new(surrogate, &settings, &fields, &mut log)?);
        }
        let first_time = settings.time_start.unwrap_or(start.time);
        let schedule = Schedule {
            start: settings.time_start.unwrap_or(f64::NEG_INFINITY),
            end: settings.time_end.unwrap_or(f64::INFINITY),
            solver_steps: settings.solver_steps.unwrap_or(1) as i64,
            surrogate_steps: settings.surrogate_steps.unwrap_or(1),
        };
        let before = (first_time - start.time).max(0.0);
        let adapt_start = adapt.start.unwrap_or(start.time + before / 3.0);
        Ok(Ride {
            comm,
            schedule,
            riders,
            fields,
            watch: Watch::default(),
            quantities: Quantities::default(),
            totals: Totals::default(),
            global,
            rows: rows[0] as usize,
            adapt_start,
            handed_back: start.index,
            phase: Phase::Solving,
            step: start,
            stepped: false,
            log,
            adapt,
            settings,
        })
    }

    /// What was set.
    pub fn settings(&self) -> &RideSettings {
        &self.settings
    }

    /// Figures of tables and messages.
    pub(crate) fn digits(&self) -> Digits {
        Digits(self.settings.write_precision)
    }

    /// The solver has made a step. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] within a jump, and for times that do not increase.
    pub fn solved(&mut self, step: Step) -> Result<Answer> {
        match self.phase {
            Phase::Solving | Phase::Deciding => {}
            _ => return Err(self.out_of_turn("solved")),
        }
        if !(step.time.is_finite()
            && step.delta_t > 0.0
            && step.delta_t.is_finite()
            && step.time > self.step.time)
        {
            return Err(Error::Input(format!(
                "ride: a step of {} s to time {} s after {} s: times must increase",
                step.delta_t, step.time, self.step.time
            )));
        }
        self.check_interval(&step)?;
        if let Some(correctors) = step.correctors {
            let said = self.watch.stepped(&step.name, correctors);
            self.log.judged(said);
        }
        if self.log.waited_for.is_some() {
            self.totals.waited += step.time - self.step.time;
        }
        self.step = step;
        self.phase = Phase::Deciding;
        Ok(self.deciding())
    }

    /// An observer that does not see the solver's steps compares where no stride ends, and errors are then those of an interpolation.
    fn check_interval(&self, step: &Step) -> Result<()> {
        let interval = step.time - self.step.time;
        let measured = self.settings.mode == Mode::Observe || self.settings.control.is_some();
        // A change of deltaT changes one interval as well.
        let skipped = step.index - self.step.index > 1 && interval > 1.5 * step.delta_t;
        if !(measured && skipped) || self.schedule.is_over(step) || !self.schedule.has_begun(step) {
            return Ok(());
        }
        let misses = |steps: f64| (steps - steps.round()).abs() >= 1e-3 * steps.max(1.0) || steps <= 0.5;
        let strides = self.riders.iter().map(|r| r.surrogate.stride());
        match strides.map(|s| (s, s / interval)).find(|(_, steps)| misses(*steps)) {
            Some((stride, steps)) => Err(Error::Input(format!(
                "ride: from time {} to {} it saw no step of the solver, and a stride of {} s is {} of such intervals: strides would be \
                 compared where none ends. Execute it at each step (executeInterval 1), or at intervals that divide a stride",
                self.step.name,
                step.name,
                self.digits().of(stride),
                self.digits().of(steps)
            ))),
            None => Ok(()),
        }
    }

    pub(crate) fn deciding(&self) -> Answer {
        Answer {
            fields: self.wants_fields(),
            arrays: self.riders.iter().any(|r| r.surrogate.records(&self.step)),
            ..self.answer(Action::Decide)
        }
    }

    /// An answer with what is known anywhere.
    pub(crate) fn answer(&self, action: Action) -> Answer {
        let jump = match &self.phase {
            Phase::Jumping(jump) | Phase::Advancing(jump) | Phase::HandingBack(jump) => Some(jump),
            _ => None,
        };
        Answer {
            action,
            surrogate: jump.map_or(0, |jump| jump.surrogate),
            strides: jump.map_or(0, |_| self.left().max(0) as usize),
            delta_t: jump.map_or(0.0, |jump| jump.delta_t),
            stepped: self.stepped,
            duration: match (action, jump) {
                (Action::Stride, Some(jump)) => self.riders[jump.surrogate].surrogate.stride(),
                _ => 0.0,
            },
            solver_steps: 0,
            last_but_one: false,
            arrays: false,
            fields: action == Action::Stride || action == Action::HandBack && self.wants_fields_after(),
            since: match self.totals.jumps {
                0 => -1,
                _ => self.step.index - self.handed_back,
            },
        }
    }

    fn wants_fields(&self) -> bool {
        let step = &self.step;
        let frame = self.is_learning() && self.riders.iter().any(|r| r.surrogate.learns());
        let due = |r: &Rider| r.can_begin(step) || r.has_arrived(step) || r.surrogate.records(step);
        let due = self.riders.iter().any(due);
        let observed = self.settings.mode == Mode::Observe && self.is_on();
        frame || due && (observed || self.is_controlled())
    }

    fn wants_fields_after(&self) -> bool {
        self.is_learning() && self.riders.iter().any(|r| r.surrogate.learns()) || self.is_controlled()
    }

    /// Whether the surrogates have their time.
    fn is_on(&self) -> bool {
        !self.schedule.is_over(&self.step) && self.schedule.has_begun(&self.step)
    }

    /// Whether the solver's steps are frames.
    pub(crate) fn is_learning(&self) -> bool {
        let can = |r: &Rider| r.surrogate.can_learn();
        let begun = |r: &Rider| r.surrogate.has_begun();
        self.adapt.wanted
            && self.riders.iter().any(can)
            && !self.schedule.is_over(&self.step)
            && (self.riders.iter().any(begun) || self.step.time >= self.adapt_start - 0.5 * self.step.delta_t)
    }

    /// Whether strides are taken beside the solver for jumps.
    pub(crate) fn is_controlled(&self) -> bool {
        let measured = |r: &Rider| self.schedule.is_measured(&self.step, r.surrogate.stride());
        self.settings.mode == Mode::Replace
            && self.settings.control.is_some()
            && self.riders.iter().any(measured)
    }

    pub(crate) fn out_of_turn(&self, call: &str) -> Error {
        let expected = match self.phase {
            Phase::Solving => "solved",
            Phase::Deciding => "decide",
            Phase::Jumping(_) => "stride",
            Phase::Advancing(_) => "advanced",
            Phase::HandingBack(_) => "handed_back",
        };
        Error::Input(format!("ride: {call} was called where {expected} is due"))
    }

    /// What follows a step of the solver. The fields are those after it; they may be left out where the answer before says so.
    /// Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that do not fit; [`Error::Numerical`] where a surrogate stays bad and the settings say stop; what
    /// learning may fail with.
    pub fn decide(&mut self, given: &Given) -> Result<Answer> {
        if self.phase != Phase::Deciding {
            return Err(self.out_of_turn("decide"));
        }
        self.frame(false, given)?;
        let answer = self.decided(given);
        self.tell_measured();
        self.tell_waiting();
        answer
    }

    fn decided(&mut self, given: &Given) -> Result<Answer> {
        let controlled = self.is_controlled();
        if controlled {
            self.measure(given)?;
        }
        if self.is_on() {
            match self.settings.mode {
                Mode::Observe => self.observe(given)?,
                Mode::Replace => {
                    if let Some(jump) = self.next_jump()? {
                        self.phase = Phase::Jumping(jump);
                        return Ok(self.answer(Action::Stride));
                    }
                }
            }
        }
        if controlled {
            self.begin_shadows(false, given)?;
        }
        self.phase = Phase::Solving;
        Ok(self.answer(Action::Solve))
    }

    /// The present fields are a frame. Collective.
    pub(crate) fn frame(&mut self, begins: bool, given: &Given) -> Result<()> {
        if self.is_learning() {
            for rider in self.riders.iter_mut().filter(|r| r.surrogate.learns()) {
                rider.surrogate.frame(self.step.time, begins, given.fields)?;
            }
        }
        Ok(())
    }

    /// Mode observe. Collective.
    fn observe(&mut self, given: &Given) -> Result<()> {
        let digits = self.digits();
        if self.riders.iter().all(|r| r.observer.is_none()) {
            self.learn(self.settings.rollout_steps)?;
            let several = self.riders.len() > 1;
            for (i, rider) in self.riders.iter_mut().enumerate() {
                rider.observer = Some(Observer::new(rider, &self.settings, i == 0, several));
            }
            self.log.observed_head = [self.errors_head(), self.segments_head()];
        }
        for rider in &mut self.riders {
            if rider.shadow.waiting && !rider.has_arrived(&self.step) {
                continue;
            }
            let Some(observer) = &mut rider.observer else {
                continue;
            };
            let found = observer.arrived(
                &self.comm,
                (rider.surrogate.as_mut(), &rider.columns[..]),
                &mut rider.shadow,
                rider.control.as_mut(),
                &self.step,
                given,
                (digits, self.fields.len()),
            )?;
            self.stepped |= rider.shadow.waiting;
            self.log.observed += &found.errors;
            self.log.segments += &found.segments;
            found.bad.into_iter().for_each(|bad| self.log.not_finite(&self.step.name, Some(bad)));
        }
        Ok(())
    }

    /// A round of learning for jumps of so many strides. Collective.
    pub(crate) fn learn(&mut self, strides: usize) -> Result<()> {
        if !self.is_learning() {
            return Ok(());
        }
        for rider in &mut self.riders {
            if !rider.surrogate.learns() {
                continue;
            }
            let Some(lesson) = rider.surrogate.learn(strides)? else {
                continue;
            };
            self.totals.learned(&lesson);
            self.log.lesson(&lesson, self.totals.adapt_seconds, self.step.wall);
            if let Some(path) = self.adapt.write_model.as_ref().filter(|_| lesson.used) {
                rider.surrogate.write_model(path)?;
            }
        }
        Ok(())
    }

    /// The controller of a surrogate; none: there is none.
    pub fn control(&self, surrogate: usize) -> Option<&Control> {
        self.riders.get(surrogate)?.control.as_ref()
    }

    /// The rollout of an observed surrogate minus the solver at the cells of each advanced field, and the name of the time at which they
    /// were compared last; none before.
    pub fn difference(&self, surrogate: usize) -> Option<(&[Vec<f64>], &str)> {
        let (values, time) = self.riders.get(surrogate)?.observer.as_ref()?.difference()?;
        Some((values, time))
    }
}

/// Surrogates are compared by the same fields: where none are named, the first that all of them advance.
fn watch_alike(surrogates: &[Box<dyn Surrogate + '_>], settings: &mut RideSettings) -> Result<()> {
    let Some(control) = settings.control.as_mut().filter(|c| c.fields.is_none() && surrogates.len() > 1)
    else {
        return Ok(());
    };
    let advances = |s: &dyn Surrogate, name: &str| s.advances().iter().any(|a| a.name == name);
    let first =
        surrogates[0].advances().iter().find(|a| surrogates.iter().all(|s| advances(s.as_ref(), &a.name)));
    match first {
        Some(field) => control.fields = Some(vec![field.name.clone()]),
        None => {
            let all = surrogates.iter().map(|s| {
                let names: Vec<&str> = s.advances().iter().map(|a| a.name.as_str()).collect();
                format!("{} advances {}", s.name(), names.join(" "))
            });
            return Err(Error::Input(format!(
                "ride: surrogates are compared by what they are off by in the same field, and there is none that all advance: {}",
                all.collect::<Vec<_>>().join(", ")
            )));
        }
    }
    Ok(())
}
