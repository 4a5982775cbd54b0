//! The state machine: what a host tells, and what follows from it.

use crate::answer::{Action, Answer, Phase};
use crate::candidate::Candidate;
use crate::conditions::Conditions;
use crate::decisions::Decisions;
use crate::log::Log;
use crate::quantities::Quantities;
use crate::registry::{Making, NETWORK, find};
use crate::schedule::{Schedule, Step};
use crate::settings::{Mode, RideSettings};
use crate::surrogate::Surrogate;
use crate::tables::Digits;
use crate::totals::Totals;
use crate::watch::Watch;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_state::{Layout, Role, Values};
use std::sync::Arc;

/// Says what the prescribed arrays will be a time from now on, s: it fills those, and leaves the others. All ranks call it.
pub type Ahead<'a> = Box<dyn FnMut(f64, &mut Values) -> Result<()> + 'a>;

/// What a host brings along.
pub struct Host<'a> {
    /// The arrays of its state.
    pub layout: Arc<Layout>,
    /// The surrogate `network`.
    pub network: Option<Box<dyn Surrogate + 'a>>,
    /// None: prescribed values do not change.
    pub ahead: Option<Ahead<'a>>,
    /// Numbers of this rank's nodes in the undecomposed mesh, in whose order a state is written.
    pub global: Vec<i64>,
    /// The cell of each boundary face.
    pub owners: Vec<i32>,
}

/// A hybrid run.
pub struct Ride<'a> {
    pub(crate) comm: Comm,
    pub(crate) settings: RideSettings,
    pub(crate) schedule: Schedule,
    pub(crate) layout: Arc<Layout>,
    pub(crate) candidates: Vec<Candidate<'a>>,
    pub(crate) ahead: Option<Ahead<'a>>,
    /// The state as it was given last, of those arrays that surrogates read or are measured by.
    pub(crate) present: Values,
    used: Vec<bool>,
    /// Arrays of the tables: those of all surrogates.
    pub(crate) fields: Vec<usize>,
    pub(crate) watch: Watch,
    pub(crate) quantities: Quantities,
    pub(crate) totals: Totals,
    /// What the run is made under, as the host told last.
    pub(crate) conditions: Conditions,
    /// Number of this rank's rows in the undecomposed mesh.
    pub(crate) global: Vec<i64>,
    /// The cell of each boundary face.
    pub(crate) owners: Vec<i32>,
    /// Rows of the undecomposed mesh.
    pub(crate) rows: usize,
    /// Index of the time step at which the solver last took over.
    pub(crate) handed_back: i64,
    pub(crate) phase: Phase,
    /// As the host told last.
    pub(crate) step: Step,
    /// Whether a surrogate has taken a stride.
    pub(crate) stepped: bool,
    pub(crate) log: Log,
    pub(crate) decisions: Decisions,
}

impl<'a> Ride<'a> {
    /// With the surrogates that the settings name, from the present time on. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for settings that do not fit the surrogates.
    pub fn new(comm: Comm, host: Host<'a>, settings: RideSettings, start: Step) -> Result<Self> {
        let digits = Digits(settings.write_precision);
        let Host { layout, mut network, ahead, global, owners } = host;
        comm.agree_with(Ok(()), &layout.shared())?;
        let mut surrogates: Vec<Box<dyn Surrogate + 'a>> = Vec::new();
        for name in &settings.surrogates {
            let making = Making { comm: &comm, layout: &layout, settings: &settings, start: &start };
            surrogates.push(match (&name[..] == NETWORK, find(name)) {
                (true, _) => network.take().ok_or_else(|| {
                    Error::Input("ride: surrogates: network is named, and the host has none".into())
                })?,
                (false, Some(make)) => make(&making)?,
                (false, None) => return Err(Error::Input(format!("ride: there is no surrogate {name}"))),
            });
        }
        if network.is_some() {
            return Err(Error::Input("ride: the host has a network, and surrogates does not name it".into()));
        }
        let observing = settings.mode == Mode::Observe;
        if surrogates.len() > 1 && !observing && settings.control.is_none() {
            return Err(Error::Input(format!(
                "ride: {} surrogates: which one jumps is decided by their errors beside the solver, which control measures; give control, \
                 or one surrogate",
                surrogates.len()
            )));
        }
        let alike = watched_alike(&surrogates, &layout, &settings)?;
        let rows = comm.total(global.len()) as usize;
        let (mut fields, mut used) = (Vec::new(), vec![false; layout.arrays().len()]);
        for description in surrogates.iter().map(|s| s.describe()) {
            description.advances.iter().chain(&description.reads).for_each(|&i| used[i] = true);
            for &array in &description.advances {
                if !fields.contains(&array) {
                    fields.push(array);
                }
            }
            let stride = description.stride;
            if stride < start.delta_t * (1.0 - 1e-6) {
                return Err(Error::Input(format!(
                    "the stride of {}, {} s, is shorter than the solver's time step, {} s: nothing can be compared, or saved",
                    description.source,
                    digits.of(stride),
                    digits.of(start.delta_t)
                )));
            }
        }
        if observing {
            let held = layout.arrays().iter().zip(&mut used).filter(|(a, _)| a.role == Role::Held);
            held.for_each(|(_, used)| *used = true);
        }
        let mut log = Log::default();
        let candidates =
            surrogates.into_iter().map(|s| Candidate::new(s, &settings, &layout, &fields, &alike, &mut log));
        let candidates = candidates.collect::<Result<_>>()?;
        let schedule = Schedule {
            start: settings.time_start.unwrap_or(f64::NEG_INFINITY),
            end: settings.time_end.unwrap_or(f64::INFINITY),
            solver_steps: settings.solver_steps.unwrap_or(1) as i64,
            surrogate_steps: settings.surrogate_steps.unwrap_or(1),
        };
        let present = layout.arrays().iter().zip(&used);
        let present = present.map(|(a, &used)| vec![0.0; if used { a.numbers() } else { 0 }]).collect();
        let decisions = Decisions::new(settings.decisions.clone().filter(|_| comm.is_root()), &start);
        Ok(Ride {
            comm,
            decisions,
            schedule,
            layout,
            candidates,
            ahead,
            present,
            used,
            fields,
            watch: Watch::default(),
            quantities: Quantities::new(&settings.quantities),
            conditions: Conditions::default(),
            totals: Totals::default(),
            global,
            owners,
            rows,
            handed_back: start.index,
            phase: Phase::Solving,
            step: start,
            stepped: false,
            log,
            settings,
        })
    }

    /// The arrays of the state.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// What the run is made under, as the text of a JSON object: texts, and lists of figures of fields, by what they are. It is saved with the
    /// state, and what was fitted and measured under others is not taken up ([`load`](Self::load)). The same on all ranks. Not collective.
    ///
    /// # Errors
    /// [`Error::Input`] for another text.
    pub fn made_under(&mut self, conditions: &str) -> Result<()> {
        self.conditions = Conditions::parse(conditions)?;
        Ok(())
    }

    /// Figures of tables and messages.
    pub(crate) fn digits(&self) -> Digits {
        Digits(self.settings.write_precision)
    }

    /// Whether [`solved`](Self::solved) is to be given the state after this step. Not collective.
    pub fn wants(&self, step: &Step) -> bool {
        let on = self.is_on(step);
        // A stride beside the solver begins or ends here, or a jump that was waited for may begin.
        let one =
            |c: &Candidate| c.can_begin(step) || c.has_arrived(step) || c.fresh && c.is_ready(step.time);
        let due = self.candidates.iter().any(one);
        let measured = match (self.settings.mode, &self.settings.control) {
            (Mode::Observe, _) => on && due,
            (Mode::Replace, Some(_)) => self.is_measured(step) && due,
            (Mode::Replace, None) => on && step.index - self.handed_back >= self.schedule.solver_steps,
        };
        measured || self.candidates.iter().any(|c| c.wants(step))
    }

    /// The solver has made a step. The state is that after it; it may be left out where [`wants`](Self::wants) says so. Collective; all ranks
    /// fail together.
    ///
    /// # Errors
    /// [`Error::Input`] within a jump, for times that do not increase, and for a state that does not fit or is missing;
    /// [`Error::Numerical`] where the surrogates stay bad and the settings say stop.
    pub fn solved(&mut self, step: Step, state: Option<&[&[f64]]>) -> Result<Answer> {
        if self.phase != Phase::Solving {
            return Err(self.out_of_turn("solved"));
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
        let wanted = self.wants(&step);
        let state = self.checked("solved", state, wanted)?;
        if let Some(correctors) = step.correctors {
            let judgement = self.watch.stepped(&step.name, correctors);
            self.log.judged(&step, "correctors", judgement, &mut self.decisions);
        }
        self.step = step;
        if let Some(state) = state.filter(|_| wanted) {
            self.keep(state);
            let replaces = self.is_on(&self.step) && self.settings.mode == Mode::Replace;
            let cuts = replaces && self.step.index - self.handed_back >= self.schedule.solver_steps;
            for candidate in &mut self.candidates {
                let stride = candidate.stride();
                let cuts = cuts && self.schedule.fits(&self.step, self.step.delta_t, stride, 1.0);
                if let Some(fits) = candidate.surrogate.fits_mut()
                    && fits.wants(&self.step)
                {
                    let (text, void) = fits.observe(&self.step, state, cuts, &mut self.decisions)?;
                    self.log.text += &text;
                    if void {
                        candidate.begin_anew();
                    }
                }
            }
        }
        let fits = self.candidates.iter_mut().filter_map(|c| c.surrogate.fits_mut());
        fits.for_each(|fits| fits.stepped(&self.step));
        self.log_modes();
        let answer = self.decided();
        self.tell_measured();
        self.tell_begun();
        answer
    }

    /// A state that is wanted must be there, and fit. Collective where it is wanted.
    pub(crate) fn checked<'s>(
        &self,
        call: &str,
        state: Option<&'s [&'s [f64]]>,
        wanted: bool,
    ) -> Result<Option<&'s [&'s [f64]]>> {
        if wanted {
            let missing = || {
                Error::Input(format!(
                    "ride: {call} needs the state, as the ride has said, and was given none"
                ))
            };
            self.comm.agree(state.ok_or_else(missing).and_then(|s| self.layout.check(s)))?;
        }
        Ok(state)
    }

    /// The present state is this one.
    pub(crate) fn keep(&mut self, state: &[&[f64]]) {
        for ((to, from), _) in self.present.iter_mut().zip(state).zip(&self.used).filter(|(_, used)| **used) {
            to.copy_from_slice(from);
        }
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
        let strides = self.candidates.iter().map(|c| c.stride());
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

    /// Whether the surrogates have their time at this step.
    fn is_on(&self, step: &Step) -> bool {
        !self.schedule.is_over(step) && self.schedule.has_begun(step)
    }

    /// Whether strides beside the solver are of use.
    pub(crate) fn is_measured(&self, step: &Step) -> bool {
        self.candidates.iter().any(|c| self.schedule.is_measured(step, c.stride()))
    }

    /// What follows a step of the solver. Collective.
    fn decided(&mut self) -> Result<Answer> {
        let controlled = self.is_controlled();
        if controlled {
            self.measure()?;
        }
        if self.is_on(&self.step) && self.settings.mode == Mode::Observe {
            self.observe()?;
        }
        let answer = self.begun()?;
        if controlled && answer.action == Action::Solve {
            self.begin_shadows(false)?;
        }
        Ok(answer)
    }

    /// A jump, where one is due. Collective.
    pub(crate) fn begun(&mut self) -> Result<Answer> {
        if self.is_on(&self.step)
            && self.settings.mode == Mode::Replace
            && let Some(jump) = self.next_jump()?
        {
            self.phase = Phase::Jumping(jump);
            return Ok(self.answer(Action::Stride));
        }
        Ok(self.answer(Action::Solve))
    }
}

/// Surrogates are compared by the same arrays: names of those that all of them advance.
fn watched_alike(
    surrogates: &[Box<dyn Surrogate + '_>],
    layout: &Layout,
    settings: &RideSettings,
) -> Result<Vec<String>> {
    let name = |array: usize| layout.arrays()[array].name.clone();
    let of = |s: &dyn Surrogate| -> Vec<String> { s.describe().advances.iter().map(|&a| name(a)).collect() };
    let mut alike = of(surrogates[0].as_ref());
    alike.retain(|name| surrogates.iter().all(|s| of(s.as_ref()).contains(name)));
    if alike.is_empty() && settings.control.as_ref().is_some_and(|control| control.fields.is_none()) {
        let all: Vec<String> = surrogates
            .iter()
            .map(|s| format!("{} advances {}", s.describe().name, of(s.as_ref()).join(" ")))
            .collect();
        return Err(Error::Input(format!(
            "ride: surrogates are compared by their errors in the same field, and there is none that all advance: {}",
            all.join(", ")
        )));
    }
    Ok(alike)
}
