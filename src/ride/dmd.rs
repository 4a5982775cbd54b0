//! Higher-order dynamic mode decomposition of the run's own states, as a surrogate.

use crate::dmd_settings::DmdSettings;
use crate::fit_control::FitControl;
use crate::interval::Interval;
use crate::registry::Making;
use crate::schedule::Step;
use crate::settings::Mode;
use crate::surrogate::{Description, Growth, Resumed, Start, Surrogate};
use m4gn_base::{Error, Result, refuse};
use m4gn_dmd::{Combination, OnlineDmd, Outlook, Restored, Settings, Settle, State};
use m4gn_state::{Array, Layout, Place, Role, Values};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

#[path = "dmd_fields.rs"]
mod fields;

/// What rounding makes of a number of strides, s/s.
pub(crate) fn rounded(strides: f64) -> f64 {
    // The times of a run that is carried on have other last bits, and what is predicted has not.
    (strides * 1e9).round() / 1e9
}

/// Names of the arrays that are prescribed in time at faces: what a flow is driven by.
fn prescribed_in_time(layout: &Layout) -> Vec<&str> {
    let all = layout.arrays().iter();
    all.filter(|a| a.role == Role::Prescribed && a.place == Place::Faces).map(|a| a.name.as_str()).collect()
}

/// What is kept for a run that is carried on, beside the snapshots.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RestartState {
    fit: State,
    /// Strides of the jump that is going on, whole or not.
    pub ahead: f64,
    /// Time from which predictions begin, s, and how long after the present snapshot that is, in strides.
    pub begin: f64,
    pub offset: f64,
    /// Whether the next snapshot is the first one after a jump.
    pub jumped: bool,
    pub interval: Interval,
    /// What is known of the wave of the start-up, the change that is due, and how the run would have gone on without the last one.
    pub settle: Settle,
    pub cut: Option<Outlook>,
    pub before: Option<Outlook>,
}

/// The decomposition in a run.
pub struct DmdSurrogate {
    pub(crate) description: Description,
    layout: Arc<Layout>,
    /// Of each array that a fit knows its place in the layout.
    pub(crate) places: Vec<usize>,
    pub(crate) online: OnlineDmd,
    pub(crate) settings: DmdSettings,
    /// Those of a fit with inputs.
    driven: DmdSettings,
    /// When it is fitted, used and dropped.
    pub(crate) control: FitControl,
    pub(crate) now: RestartState,
    predicted: Option<Combination>,
    /// Strides that it is ahead of where it was predicted from.
    taken: f64,
    /// The last step of the solver, s.
    delta_t: f64,
    /// Where the rollout beside the solver began, and how long after that snapshot, in strides.
    rollout: Option<(Outlook, f64)>,
}

/// Makes it, for the registry. Collective.
///
/// # Errors
/// [`Error::Input`] for settings and arrays that cannot be.
pub(crate) fn make(of: &Making) -> Result<Box<dyn Surrogate>> {
    let settings = of.settings.dmd.clone().unwrap_or_default();
    let observes = of.settings.mode == Mode::Observe;
    DmdSurrogate::new(of, settings, observes).map(|made| Box::new(made) as Box<dyn Surrogate>)
}

impl DmdSurrogate {
    fn new(of: &Making, settings: DmdSettings, observes: bool) -> Result<Self> {
        let (comm, layout) = (of.comm, of.layout);
        let inputs = prescribed_in_time(layout);
        let settings = settings.with_inputs(!inputs.is_empty());
        let places: Vec<usize> =
            (0..layout.arrays().len()).filter(|&i| layout.arrays()[i].role != Role::Held).collect();
        let advances = layout.measured();
        let interval = Interval::first(settings.snapshot_interval, of.start.delta_t);
        // A rollout beside the solver needs the snapshots of its start until its end.
        let held = match observes {
            true => settings.window(),
            false if settings.cut_transient => Settle::STATES,
            false => 0,
        };
        let arrays: Vec<Array> = layout.pick(&places).into_iter().cloned().collect();
        let rest = settings.rest(&arrays)?;
        let own = Settings { interval, storage: settings.storage, fit: settings.fit(), held, rest };
        let online = OnlineDmd::new(comm, arrays, own)?;
        let mut bytes = [online.snapshots().memory() as f64];
        comm.sum_f64(&mut bytes);
        let note = format!(
            "m4gn: the dmd surrogate keeps up to {} states {interval} s apart: {:.1} MiB on all ranks{}\n\n",
            settings.window(),
            bytes[0] / f64::from(1 << 20),
            match inputs.is_empty() {
                true => String::new(),
                false => format!("; inputs that are known beforehand: {}", inputs.join(", ")),
            }
        );
        let identity = DmdSettings { file: None, keep: true, write_modes: 0, ..settings.clone() };
        let description = Description {
            name: "dmd".into(),
            source: "dmd, fitted to the run's own states".into(),
            digest: format!("{:08x}", crc32fast::hash(format!("{identity:?}").as_bytes())),
            stride: interval,
            growth: vec![Growth::None; advances.len()],
            advances,
            reads: Vec::new(),
            is_whole: true,
            segments: Default::default(),
            note,
        };
        Ok(DmdSurrogate {
            description,
            layout: layout.clone(),
            places,
            online,
            driven: settings.clone().driven(),
            control: FitControl::new(&settings),
            settings,
            now: RestartState {
                begin: of.start.time,
                interval: Interval::new(of.start.delta_t),
                ..RestartState::default()
            },
            predicted: None,
            taken: 0.0,
            delta_t: of.start.delta_t,
            rollout: None,
        })
    }

    /// This rank's file of snapshots; none: they are not kept.
    fn file(&self) -> Option<PathBuf> {
        let mut name = self.settings.file.clone()?.into_os_string();
        name.push(format!(".{}", self.online.snapshots().comm().rank()));
        Some(name.into())
    }

    pub(crate) fn other_interval(&self, delta_t: f64) -> Option<f64> {
        self.now.interval.other(self.settings.snapshot_interval, self.description.stride, delta_t)
    }
}

impl Surrogate for DmdSurrogate {
    fn describe(&self) -> &Description {
        &self.description
    }

    fn predict(&mut self, start: Start, next: &mut Values) -> Result<()> {
        let taken = start.duration / self.description.stride;
        let strides = rounded(self.now.offset + self.now.ahead + taken);
        self.online.resolves(strides)?;
        let prediction = self.later(strides)?;
        if let Some(ahead) = start.ahead {
            self.check_prescribed(&prediction, ahead)?;
        }
        self.put(&prediction, next)?;
        (self.predicted, self.taken) = (Some(prediction), taken);
        Ok(())
    }

    fn carry(&self, next: &mut [&mut [f64]]) {
        let Some(prediction) = &self.predicted else { return };
        for (f, &array) in self.places.iter().enumerate() {
            let role = self.layout.arrays()[array].role;
            if role == Role::Carried {
                self.online.field(f, prediction, next[array]);
            }
        }
    }

    fn advanced(&mut self) {
        self.now.ahead += self.taken;
    }

    fn handed_back(&mut self, time: f64, own: bool) {
        if !own {
            self.control.jumped_by_others += (time - self.now.begin) / self.description.stride;
        }
        self.now.begin = time;
        let ahead = rounded(self.now.offset + std::mem::take(&mut self.now.ahead));
        if self.now.cut.take().is_some() && own {
            self.online.break_off();
            if !self.now.settle.is_open() {
                self.release();
            }
        } else {
            // What another surrogate has made is no state of the solver.
            if !(own && self.online.jump(ahead, time, self.delta_t)) {
                self.online.break_off();
            }
            self.release();
        }
        self.now.offset = self.online.since(time).unwrap_or(0.0).max(0.0);
        self.now.jumped = true;
    }

    fn fits(&self) -> Option<&DmdSurrogate> {
        Some(self)
    }

    fn fits_mut(&mut self) -> Option<&mut DmdSurrogate> {
        Some(self)
    }

    fn save(&self) -> Result<Option<Vec<u8>>> {
        let Some(file) = self.file() else {
            return Ok(None);
        };
        let state = RestartState { fit: self.online.save(&file)?, ..self.now.clone() };
        let bytes = serde_json::to_vec(&state);
        bytes.map(Some).map_err(|e| Error::Internal(format!("the state of dmd as JSON: {e}")))
    }

    fn restore(&mut self, saved: &[u8], at: &Resumed) -> Result<Option<String>> {
        let saved: RestartState =
            serde_json::from_slice(saved).map_err(|e| Error::Input(format!("the state of dmd: {e}")))?;
        let Some(file) = self.file() else {
            return Ok(Some("it keeps no states".into()));
        };
        if !at.holds {
            self.online.begin_beside(&file, &saved.fit);
            return Ok(None);
        }
        match self.online.restore(&file, saved.fit)? {
            Restored::Whole => {
                self.description.stride = self.online.settings().interval;
                self.now = RestartState { fit: State::default(), ..saved };
                if rounded(at.later / self.description.stride) != 0.0 {
                    self.online.shift(at.later);
                    self.now.begin += at.later;
                }
                self.delta_t = at.step.delta_t;
                self.online.hold(self.now.before.as_ref());
                if self.now.settle.has_settled() {
                    self.online.keep_size();
                }
                if at.solves {
                    let arrays: Vec<&[f64]> = self.places.iter().map(|&i| at.state[i]).collect();
                    self.online.stand(at.step.time, at.step.delta_t, &arrays);
                }
                Ok(None)
            }
            Restored::Superseded => Ok(Some(format!(
                "the states of the fit at time {} have made room for later ones",
                at.step.name
            ))),
            Restored::Lost(loss) => Err(Error::Input(format!(
                "{loss}: start from an earlier time, or remove the state of this run there, and the schedule begins anew"
            ))),
        }
    }
}

/// What a ride asks of a fit. When it is made, used and dropped is decided in [`crate::fit_control`].
impl DmdSurrogate {
    /// By what rules that is decided.
    pub(crate) fn rules(&self) -> &DmdSettings {
        match self.online.fitted() {
            Some(fit) if fit.model.inputs() > 0 => &self.driven,
            _ => &self.settings,
        }
    }

    /// Whether the state after this step of the solver is wanted.
    pub(crate) fn wants(&self, step: &Step) -> bool {
        self.other_interval(step.delta_t).is_some()
            || self.online.wants(step.time, step.delta_t)
            || self.online.is_between(step.time, step.delta_t)
    }

    /// The solver has made this step, whose state is taken, if it was wanted.
    pub(crate) fn stepped(&mut self, step: &Step) {
        self.delta_t = step.delta_t;
        self.now.interval.step(step.delta_t);
    }

    /// States are so far apart from here on, s: what was learned of others is dropped.
    pub(crate) fn begin_anew(&mut self, interval: f64, time: f64) {
        self.online.begin_anew(interval, time);
        self.description.stride = interval;
        let RestartState { begin, interval, settle, .. } = std::mem::take(&mut self.now);
        // A start-up that was done with, or left alone, stays so
        let settle = Some(settle).filter(Settle::is_over).unwrap_or_default();
        self.now = RestartState { begin, interval, settle, ..RestartState::default() };
        self.rollout = None;
    }

    /// Whether a stride is due that changes the state: the start-up is cut short.
    pub(crate) fn cuts(&self) -> bool {
        self.now.cut.is_some()
    }

    /// That stride is not taken.
    pub(crate) fn leave_uncut(&mut self) {
        if self.now.cut.take().is_some() {
            self.release();
        }
    }

    /// Whether the start-up is being cut short, so that no jump in time is to come in between.
    pub(crate) fn waits(&self) -> bool {
        self.settings.cut_transient && self.now.settle.waits()
    }

    /// Fits the last snapshots, and gives the modes; none where there are too few without a gap, or nothing varies.
    pub(crate) fn fit(&mut self) -> Option<Vec<m4gn_dmd::Mode>> {
        self.online.fit()?;
        let modes = self.online.modes();
        let fit = self.online.fitted()?;
        if self.settings.snapshot_interval.is_none() {
            let present = self.description.stride;
            let holds = fit.tail_error() < self.settings.fit_tolerance;
            if self.now.interval.take(&modes, present, holds) && holds {
                // It is right at its states alone: between them harmonics would be waves of other frequencies.
                self.online.forget();
                return None;
            }
        }
        Some(modes)
    }

    /// Whether there is one.
    pub(crate) fn has_fit(&self) -> bool {
        self.online.fitted().is_some()
    }

    /// Whether a stride can be taken from the state at this time, s: that of the step at which a snapshot came, or that a jump ended with.
    pub(crate) fn is_ready(&self, time: f64) -> bool {
        let here = (time - self.now.begin).abs() < 1e-6 * self.description.stride;
        here && self.has_fit() && self.online.outlook().is_some()
    }

    /// Of each array that it advances the least change that errors are over, root mean square over nodes and solved components.
    pub(crate) fn least_changes(&self) -> Vec<f64> {
        let all = self.online.least_changes();
        self.description.advances.iter().map(|&array| all[self.own(array)]).collect()
    }

    /// A rollout beside the solver begins at the present state, with the stride that [`Surrogate::predict`] takes from it.
    pub(crate) fn begin_rollout(&mut self) {
        self.rollout = self.online.outlook().map(|outlook| (outlook, self.now.offset));
        self.online.hold(self.rollout.as_ref().map(|(outlook, _)| outlook));
    }

    /// One of its further strides, the second or a later one. [`Error::Numerical`] for a result that must not be used.
    pub(crate) fn follow(&mut self, stride: usize, next: &mut Values) -> Result<()> {
        let Some((outlook, offset)) = &self.rollout else {
            return Err(Error::Numerical("dmd has no rollout to go on with".into()));
        };
        let prediction = self.online.later(outlook, offset + stride as f64)?;
        self.put(&prediction, next)
    }

    /// All arrays of the state so many seconds before the present one of a jump. [`Error::Input`] where nothing was predicted.
    pub(crate) fn earlier(&self, before: f64, out: &mut [&mut [f64]]) -> Result<()> {
        refuse(!(before.is_finite() && before >= 0.0), Error::Input, || {
            format!("dmd: an old level {before} s before the present: expected 0 s or more")
        })?;
        let present = self.now.offset + self.now.ahead;
        let state = self.later(present - before / self.description.stride);
        let state = state.map_err(|e| Error::Input(format!("dmd: an old level: {e}")))?;
        for (f, &array) in self.places.iter().enumerate() {
            if self.layout.arrays()[array].role != Role::Prescribed && !out[array].is_empty() {
                self.online.field(f, &state, out[array]);
            }
        }
        Ok(())
    }
}
