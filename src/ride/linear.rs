//! The surrogate that is fitted to the run's own states: when it is fitted, and how far it lets itself jump.
//!
//! A fit is used if it predicts the held-back end of its window to a share of what holding the last state would be off by, and waiting
//! would not better it. A jump has `initialJump` strides. A stride beside the solver after the jump that agrees to twice that share lets the next one
//! be longer; one that agrees to the tolerance lets it be shorter; else the solver goes on until a new fit holds.

use crate::dmd_settings::DmdSettings;
use crate::schedule::Step;
use crate::surrogate::{Advanced, Surrogate};
use m4gn_linear::{Combination, Field as Array, Linear, Outlook, Settings, State, relative};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_step::{Field, FieldMut};
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::PathBuf;

/// Strides of the solver that an interval has where nothing is said.
const STEPS: f64 = 25.0;

/// Tries before a fit that must not have been much worse, for it to be taken as what can be had.
const WAITED: usize = 3;

/// Errors fall where a try's is below this times an earlier one's.
const FALLS: f64 = 0.7;

/// Error below which later fits are likely to hold.
const PROMISING: f64 = 0.2;

/// What is kept for a run that is carried on, beside the snapshots.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    linear: State,
    /// Strides of the jump that is going on.
    ahead: usize,
    /// Time from which predictions begin, s, and how long after the present sample that is, in strides.
    begin: f64,
    offset: f64,
    /// Strides that the next jump may have.
    length: f64,
    /// What the next sample is compared with, and whether it follows a jump.
    trial: Option<(Combination, bool)>,
    /// Samples since the last try of a fit.
    tried: usize,
    /// Errors of the tail in the last tries since a fit was dropped; last, of the fit in use.
    errors: Vec<f64>,
    /// Strides that others have jumped since a fit was far off, and how many they may before the solver goes on for a fit.
    others: f64,
    turn: f64,
}

/// A dmd surrogate in a run.
pub struct Fitted {
    linear: Linear,
    settings: DmdSettings,
    advanced: Vec<Advanced>,
    /// Which array each advanced field is.
    places: Vec<usize>,
    interval: f64,
    kept: Kept,
    /// What the last step predicted, and the advanced fields of it.
    predicted: Option<(Combination, Vec<Vec<f64>>)>,
    /// What the inputs will be at the end of the next stride.
    inputs: Vec<Vec<f64>>,
    /// Where the rollout beside the solver began, and how long after that sample, in strides.
    rollout: Option<(Outlook, f64)>,
    /// What is still to be said.
    note: String,
    /// Whether it was said what a state costs.
    timed: bool,
}

impl Fitted {
    /// Of the state's arrays on this rank. `advanced`: those that are fields at the mesh's rows; `observes`: rollouts go on beside the
    /// solver. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] for settings and arrays that cannot be.
    pub fn new(
        comm: &Comm,
        arrays: Vec<Array>,
        advanced: Vec<Advanced>,
        settings: DmdSettings,
        observes: bool,
        start: &Step,
    ) -> Result<Self> {
        let place = |a: &Advanced| {
            let found = arrays.iter().position(|f| f.name == a.name);
            found.ok_or_else(|| Error::Input(format!("dmd: no array {} among those of the state", a.name)))
        };
        let places: Vec<usize> = comm.agree(advanced.iter().map(place).collect::<Result<_>>())?;
        let held = if observes { settings.window } else { 0 };
        let interval = settings.snapshot_interval.unwrap_or(STEPS * start.delta_t);
        let own = Settings { interval, storage: settings.storage, fit: settings.fit(), held };
        let linear = Linear::new(comm, arrays, own)?;
        let mut bytes = [linear.snapshots().memory() as f64];
        comm.sum_f64(&mut bytes);
        let note = format!(
            "m4gn: the dmd surrogate keeps up to {} states {interval} s apart: {:.1} MiB on all ranks\n\n",
            settings.window,
            bytes[0] / f64::from(1 << 20)
        );
        Ok(Fitted {
            linear,
            kept: Kept {
                begin: start.time,
                length: settings.initial_jump as f64,
                turn: settings.window as f64,
                ..Kept::default()
            },
            settings,
            advanced,
            places,
            interval,
            predicted: None,
            inputs: Vec::new(),
            rollout: None,
            note,
            timed: false,
        })
    }

    /// Tries a fit. Says what came of it.
    fn fit(&mut self, step: &Step) -> String {
        self.kept.tried = 0;
        let tolerance = self.settings.jump_tolerance;
        let Some(fit) = self.linear.fit() else {
            self.far_off();
            return String::new();
        };
        let (error, shape, n) = (fit.tail_error(), fit.dmd.shape, fit.numbers.len());
        let (tail, modes) = (self.settings.hold_out, if shape.growing { "kept" } else { "clipped" });
        let fields: Vec<String> = fit.tail.iter().map(|e| format!("{} {:.2e}", e.name, e.error)).collect();
        let settled = error < self.settings.fit_tolerance || settled(&self.kept.errors, error);
        let surplus = (self.kept.errors.len() + 1).saturating_sub(WAITED);
        self.kept.errors.drain(..surplus);
        // JSON, which the state is kept in, has no infinity; it is one where the last states are all the same.
        self.kept.errors.push(error.min(f64::MAX));
        let holds = error < tolerance && settled;
        if !holds {
            self.linear.forget();
        }
        match error < PROMISING {
            // Where a fit holds, or will, the others' turn is over: what they make is no state of the solver, and the window would begin anew.
            true => (self.kept.others, self.kept.turn) = [self.settings.window as f64; 2].into(),
            false => self.far_off(),
        }
        self.kept.length = self.settings.initial_jump as f64;
        let mut said = format!(
            "m4gn: time {}: fit of {n} states, {} delays, rank {}, growth {modes}: its last {tail} states, held back, are off by {error:.3} of \
             what holding would be (of the variation: {}); {}\n\n",
            step.name,
            shape.delays,
            shape.rank,
            fields.join(", "),
            match (holds, settled) {
                (true, _) => "it is used",
                (_, true) => "the solver goes on",
                _ => "the solver goes on while it gets better",
            }
        );
        if holds && !std::mem::replace(&mut self.timed, true) {
            let seconds = self.linear.seconds_a_state();
            let _ = write!(
                said,
                "m4gn: each state of the window adds {seconds:.1e} s to a stride of the fit\n\n"
            );
        }
        said
    }

    /// No fit is near: the others have a turn, and a longer one where they had waited for this fit.
    fn far_off(&mut self) {
        if self.kept.others >= self.kept.turn {
            self.kept.turn *= 2.0;
        }
        self.kept.others = 0.0;
    }

    /// Error of a stride beside the solver up to which the present fit is as good as when it was first used: twice what it was used with.
    fn limit(&self) -> f64 {
        let used = self.kept.errors.last().map_or(0.0, |e| 2.0 * e);
        used.max(self.settings.fit_tolerance).min(self.settings.jump_tolerance)
    }

    /// Compares the present sample with what was predicted of it. Says what came of it.
    fn compare(&mut self, step: &Step) -> String {
        let Some((prediction, jumped)) = self.kept.trial.take() else {
            return String::new();
        };
        let error = self.linear.errors(&prediction, 1).map_or(f64::INFINITY, |e| relative(&e));
        let mut said = format!(
            "m4gn: time {}: a stride of the fit beside the solver was off by {error:.3} of what holding would be",
            step.name
        );
        let good = error < self.limit();
        if jumped && error < self.settings.jump_tolerance {
            let growth = if good { self.settings.jump_growth } else { 1.0 / self.settings.jump_growth };
            let (first, longest) = (self.settings.initial_jump as f64, self.settings.max_jump as f64);
            self.kept.length = (self.kept.length * growth).clamp(first, longest);
            let _ = write!(said, "; the next jump may have {} strides", self.kept.length as usize);
        } else if !good {
            self.kept.errors.clear();
            self.linear.forget();
            said += "; the fit is dropped";
        }
        said + "\n\n"
    }
}

/// Whether a fit with this error of the tail need not wait for a better one: the last tries were hardly worse. A wake that settles gives
/// better fits with every period, while noise is the same in all.
pub(crate) fn settled(tries: &[f64], error: f64) -> bool {
    let last = tries.len().checked_sub(WAITED).map(|from| &tries[from..]);
    last.is_some_and(|last| last.iter().all(|e| error > FALLS * e))
}

impl Surrogate for Fitted {
    fn name(&self) -> &str {
        "dmd"
    }

    fn source(&self) -> String {
        "dmd, fitted to the run's own states".into()
    }

    fn digest(&self) -> String {
        let own = DmdSettings { file: None, ..self.settings.clone() };
        format!("{:08x}", crc32fast::hash(format!("{own:?} {}", self.interval).as_bytes()))
    }

    fn stride(&self) -> f64 {
        self.interval
    }

    fn advances(&self) -> &[Advanced] {
        &self.advanced
    }

    /// How far it goes it says itself.
    fn growth(&self, _: &str) -> Option<Vec<f64>> {
        Some(vec![1.0; self.settings.max_jump])
    }

    /// At the step at which a sample came, or that a jump ended with: predictions begin from there.
    fn is_ready(&self, time: f64) -> bool {
        let here = (time - self.kept.begin).abs() < 1e-6 * self.interval;
        here && self.linear.fitted().is_some() && self.linear.predict(1.0).is_some()
    }

    fn wants_solver(&self) -> bool {
        self.linear.fitted().is_none() && self.kept.others >= self.kept.turn
    }

    fn allows(&self, most: usize) -> usize {
        match self.linear.fitted() {
            Some(_) => most.min(self.kept.length as usize),
            None => 0,
        }
    }

    fn records(&self, step: &Step) -> bool {
        self.linear.wants(step.time, step.delta_t)
    }

    fn record(&mut self, step: &Step, arrays: &[&[f64]]) -> Result<String> {
        let samples = self.linear.offer(step.time, step.delta_t, arrays)?;
        let mut said = std::mem::take(&mut self.note);
        if samples == 0 {
            return Ok(said);
        }
        self.kept.begin = step.time;
        self.kept.offset = self.linear.since(step.time).unwrap_or(0.0).max(0.0);
        said += &self.compare(step);
        self.kept.tried += samples;
        let (stretch, least) = (self.linear.stretch(), self.settings.min_snapshots());
        if stretch >= least && (self.kept.tried >= self.settings.refit_interval || stretch == least) {
            said += &self.fit(step);
        }
        self.kept.trial = self.linear.predict(1.0).map(|p| (p, false));
        Ok(said)
    }

    fn step(&mut self, _: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let strides = self.kept.offset + (self.kept.ahead + 1) as f64;
        let prediction = self.linear.predict(strides);
        let prediction = prediction
            .ok_or_else(|| Error::Numerical("the dmd surrogate has no fit to predict with".into()))?;
        self.check_inputs(&prediction)?;
        let values = self.put(&prediction, out)?;
        self.predicted = Some((prediction, values));
        Ok(())
    }

    fn begin_rollout(&mut self) {
        self.rollout = self.linear.outlook().map(|outlook| (outlook, self.kept.offset));
        self.linear.hold(self.rollout.as_ref().map(|(outlook, _)| outlook));
    }

    fn follow(&mut self, stride: usize, _: &[Field], out: &mut [FieldMut]) -> Result<()> {
        let Some((outlook, offset)) = &self.rollout else {
            return Err(Error::Numerical("the dmd surrogate has no rollout to go on with".into()));
        };
        let prediction = self.linear.later(outlook, offset + stride as f64);
        self.put(&prediction, out).map(|_| ())
    }

    fn inputs(&mut self, arrays: &[&[f64]]) -> Result<()> {
        let fields = self.linear.snapshots().fields().iter().filter(|f| f.input);
        if !fields.map(|f| f.len).eq(arrays.iter().map(|a| a.len())) {
            return Err(Error::Input("dmd: the arrays are not the inputs of the state".into()));
        }
        self.inputs = arrays.iter().map(|a| a.to_vec()).collect();
        Ok(())
    }

    fn arrays(&self, before: f64, out: &mut [&mut [f64]]) -> Result<()> {
        let present = self.kept.offset + self.kept.ahead as f64;
        let earlier = (before > 0.0).then(|| self.linear.predict(present - before / self.interval)).flatten();
        // The advanced fields of the last prediction are there already.
        let (prediction, values) = match (&earlier, &self.predicted) {
            (Some(earlier), _) => (earlier, None),
            (None, Some((last, values))) if before <= 0.0 => (last, Some(values)),
            _ => return Err(Error::Input("dmd: nothing was predicted".into())),
        };
        let fields = self.linear.snapshots().fields();
        if out.len() != fields.len() || out.iter().zip(fields).any(|(o, f)| o.len() != f.len) {
            return Err(Error::Input("dmd: the arrays are not those of the state".into()));
        }
        for (f, o) in out.iter_mut().enumerate() {
            match (values, self.places.iter().position(|place| *place == f)) {
                (Some(values), Some(i)) => o.copy_from_slice(&values[i]),
                _ => self.linear.field(f, prediction, o),
            }
        }
        Ok(())
    }

    fn advanced(&mut self) {
        self.kept.ahead += 1;
    }

    fn handed_back(&mut self, time: f64, own: bool) {
        if !own {
            self.kept.others += (time - self.kept.begin) / self.interval;
        }
        self.kept.begin = time;
        let strides = std::mem::take(&mut self.kept.ahead);
        // What another surrogate has made is no state of the solver.
        if !(own && self.linear.jump(strides)) {
            self.linear.break_off();
        }
        self.kept.trial = self.linear.predict(1.0).map(|p| (p, true));
    }

    fn state(&self) -> Result<Option<Vec<u8>>> {
        let Some(file) = self.file() else {
            return Ok(None);
        };
        let kept = Kept { linear: self.linear.save(&file)?, ..self.kept.clone() };
        let bytes = serde_json::to_vec(&kept);
        bytes.map(Some).map_err(|e| Error::Internal(format!("the state of the dmd surrogate as JSON: {e}")))
    }

    fn restore(&mut self, state: &[u8]) -> Result<()> {
        let kept: Kept = serde_json::from_slice(state)
            .map_err(|e| Error::Input(format!("the state of the dmd surrogate: {e}")))?;
        let Some(file) = self.file() else {
            return Ok(());
        };
        let said = self.linear.restore(&file, kept.linear)?;
        self.kept = Kept { linear: State::default(), ..kept };
        match said.is_empty() {
            true => Ok(()),
            false => Err(Error::Input(format!(
                "{said}: start from an earlier time, or remove the state of this run there, and the schedule begins anew"
            ))),
        }
    }
}

impl Fitted {
    /// The advanced fields of a prediction go where they are wanted. Collective.
    fn put(&self, prediction: &Combination, out: &mut [FieldMut]) -> Result<Vec<Vec<f64>>> {
        let mut values: Vec<Vec<f64>> = out.iter().map(|o| vec![0.0; o.cells.len()]).collect();
        for (v, &place) in values.iter_mut().zip(&self.places) {
            self.linear.field(place, prediction, v);
        }
        let finite = values.iter().flatten().all(|v| v.is_finite());
        let finite = finite
            .then_some(())
            .ok_or_else(|| Error::Numerical("the dmd surrogate's prediction is not finite".into()));
        self.linear.snapshots().comm().agree(finite)?;
        for (o, v) in out.iter_mut().zip(&values) {
            o.cells.copy_from_slice(v);
        }
        Ok(values)
    }

    /// [`Error::Numerical`] where a prediction is off from what the inputs will be by more than `jumpTolerance` of their variation. Collective.
    fn check_inputs(&mut self, prediction: &Combination) -> Result<()> {
        let given = std::mem::take(&mut self.inputs);
        let snapshots = self.linear.snapshots();
        let fields = snapshots.fields().iter().enumerate().filter(|(_, f)| f.input);
        for ((f, field), values) in fields.zip(&given) {
            let mut predicted = vec![0.0; field.len];
            self.linear.field(f, prediction, &mut predicted);
            let off = predicted.iter().zip(values).map(|(a, b)| (a - b).powi(2));
            let mut sums = [off.sum(), values.iter().map(|v| v * v).sum::<f64>()];
            snapshots.comm().sum_f64(&mut sums);
            let variation = self.linear.fitted().map_or(0.0, |fit| fit.variation(f));
            let share = (sums[0] / variation.max(1e-12 * sums[1])).sqrt();
            if sums[0] > 0.0 && share > self.settings.jump_tolerance {
                return Err(Error::Numerical(format!(
                    "the input {} will be other than the fit says of it: the solver goes on",
                    field.name
                )));
            }
        }
        Ok(())
    }

    /// This rank's file of snapshots.
    fn file(&self) -> Option<PathBuf> {
        let mut name = self.settings.file.as_ref()?.clone().into_os_string();
        name.push(format!(".{}", self.linear.snapshots().comm().rank()));
        Some(name.into())
    }
}
