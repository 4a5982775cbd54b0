//! A surrogate beside the solver: single strides, and rollouts that begin anew from the solver's fields.

use crate::candidate::Candidate;
use crate::control::{Control, StrideError};
use crate::log::Log;
use crate::schedule::Step;
use crate::settings::RideSettings;
use crate::shadow::advanced;
use crate::surrogate::{Description, Start};
use crate::tables::{Digits, row};
use crate::values::{between, rms};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_state::{Layout, Values};
use serde_json::{Map, Value, json};

/// The error that a table has for a prediction that is not finite.
const NOT_FINITE: f64 = 1e15;

/// What control would have done with the rollouts, as jumps.
#[derive(Clone, Debug, Default, PartialEq)]
struct Judged {
    /// Relative error expected after 1, 2, ... strides of the rollout.
    estimates: Vec<f64>,
    /// Strides that a jump would have had instead of the rollout.
    allowed: usize,
    /// Such jumps, those that were not allowed, those whose error was within the tolerance, and the strides of all.
    jumps: usize,
    refused: usize,
    within: usize,
    strides: usize,
}

impl Judged {
    fn begin(&mut self, control: &Control, rollout_steps: usize) {
        for (i, estimate) in self.estimates.iter_mut().enumerate() {
            *estimate = control.estimate(i + 1);
        }
        self.allowed = control.strides(rollout_steps);
        self.refused += usize::from(self.allowed == 0);
    }
}

/// The observer of one surrogate.
#[derive(Clone, Debug, Default)]
pub(crate) struct Observer {
    rollout_steps: usize,
    /// The advanced arrays where the rollout began, and at its last two times.
    first: Values,
    old: Values,
    now: Values,
    /// Strides of this rollout; 0: it begins.
    steps: usize,
    finite: bool,
    /// Sums over all times of the columns of each field, and at how many of them a stride could be taken.
    sums: Vec<[f64; 4]>,
    times: usize,
    one_steps: usize,
    /// Whether errors are kept for each cell, and told for each segment.
    write_errors: bool,
    in_segments: bool,
    /// Which one of several it is.
    name: Option<String>,
    /// The rollout minus the solver, at the last time at which they were compared, and its name.
    difference: Option<(Values, String)>,
    judged: Judged,
}

/// Where the run is, for an observer.
pub(crate) struct Now<'a> {
    /// The solver's state.
    pub state: &'a Values,
    /// What is prescribed at the end of a stride.
    pub ahead: Option<&'a Values>,
    /// The cell of each boundary face.
    pub owners: &'a [i32],
    pub digits: Digits,
    /// Arrays of the table.
    pub n_fields: usize,
}

impl Observer {
    /// Errors in segments are told of the first surrogate; rows have the name where there are several.
    pub fn new(candidate: &Candidate, settings: &RideSettings, first: bool, several: bool) -> Self {
        let rollout_steps = settings.rollout_steps;
        Observer {
            rollout_steps,
            finite: true,
            sums: vec![[0.0; 4]; candidate.describe().advances.len()],
            write_errors: settings.write_errors,
            in_segments: first && settings.write_errors,
            name: several.then(|| candidate.describe().name.clone()),
            judged: Judged { estimates: vec![f64::INFINITY; rollout_steps], ..Judged::default() },
            ..Observer::default()
        }
    }

    /// A rollout that is under way is given up.
    pub fn begin_anew(&mut self) {
        self.steps = 0;
    }

    /// What follows a step of the solver where it has arrived at the end of a stride, or where none is under way. Collective.
    pub fn arrived(
        &mut self,
        comm: &Comm,
        layout: &Layout,
        candidate: &mut Candidate,
        step: &Step,
        now: Now,
        log: &mut Log,
    ) -> Result<()> {
        if candidate.shadow.waiting {
            let fraction = candidate.shadow.fraction(step, candidate.stride());
            let solver = advanced(candidate.surrogate.as_ref(), now.state);
            let arrays = layout.pick(&candidate.surrogate.describe().advances);
            let one_step = candidate.shadow.compare(comm, &arrays, &solver, fraction);
            if let Some(control) = candidate.control.as_mut().filter(|_| !candidate.shadow.idle) {
                control.measure(&one_step)?;
            }
            if self.steps > 0 {
                self.compare(comm, layout, candidate, (&solver, &one_step, fraction), step, &now, log);
            }
            if self.steps >= self.rollout_steps || !self.finite {
                self.steps = 0;
            }
        }
        match candidate.is_ready(step.time) {
            true => {
                let duration = candidate.stride();
                let start = Start { state: now.state, ahead: now.ahead, duration };
                let bad = candidate.shadow.begin(candidate.surrogate.as_mut(), step, start)?;
                log.not_finite(&step.name, bad);
            }
            // A rollout goes on, and is compared at the ends of its strides.
            false if self.steps > 0 => {
                candidate.shadow.begin_idle(candidate.surrogate.as_ref(), step, now.state);
            }
            false => return Ok(()),
        }
        self.go_on(candidate, layout, step, &now, log)
    }

    #[allow(clippy::too_many_arguments)]
    fn compare(
        &mut self,
        comm: &Comm,
        layout: &Layout,
        candidate: &Candidate,
        (solver, one_step, fraction): (&Values, &[StrideError], f64),
        step: &Step,
        of: &Now,
        log: &mut Log,
    ) {
        let digits = of.digits;
        let description = candidate.describe();
        let arrays = layout.pick(&description.advances);
        let pairs = self.old.iter().zip(&self.now).zip(solver);
        let differences: Values = pairs
            .map(|((old, now), solver)| {
                let triples = old.iter().zip(now).zip(solver);
                triples.map(|((o, n), s)| between(*o, *n, fraction) - s).collect()
            })
            .collect();
        let rollout = rms(comm, &arrays, differences.iter().map(|d| d.iter().copied()));
        let firsts = self.first.iter().zip(solver);
        let hold_first = rms(comm, &arrays, firsts.map(|(f, s)| f.iter().zip(s).map(|(f, s)| f - s)));
        let or_not = |error: f64| if error.is_infinite() { NOT_FINITE } else { error };
        self.one_steps += usize::from(!one_step.iter().any(|e| e.error.is_nan()));
        let mut columns = vec![digits.of(step.output_time)];
        columns.extend(self.name.clone());
        columns.push(self.steps.to_string());
        let mut figures = vec![[f64::NAN; 5]; of.n_fields];
        let mut errors = Vec::new();
        for (i, sums) in self.sums.iter_mut().enumerate() {
            let rollout = if self.finite { rollout[i] } else { NOT_FINITE };
            let row = [or_not(one_step[i].error), one_step[i].change, rollout, hold_first[i]];
            figures[candidate.columns[i]] = [row[0], row[1], row[2], row[3], one_step[i].size];
            sums.iter_mut()
                .zip(row)
                .for_each(|(sum, value)| *sum += if value.is_nan() { 0.0 } else { value });
            errors.push(rollout);
        }
        columns.extend(figures.iter().flatten().map(|v| digits.of(*v)));
        if let Some(control) = &candidate.control {
            let error = control.relative(&errors).unwrap_or(f64::INFINITY);
            let estimate = self.judged.estimates[self.steps - 1];
            columns.extend([digits.of(error), digits.of(estimate)]);
            if self.steps == self.judged.allowed {
                self.judged.jumps += 1;
                self.judged.strides += self.judged.allowed;
                self.judged.within += usize::from(error <= control.settings().tolerance);
            }
        }
        log.observed += &row(&columns);
        if self.write_errors && self.finite {
            if self.in_segments {
                log.segments += &in_segments(
                    comm,
                    description,
                    layout,
                    &differences,
                    digits.of(step.output_time),
                    digits,
                );
            }
            self.difference = Some((differences, step.name.clone()));
        }
        self.times += 1;
    }

    /// A stride of the rollout, or its begin from the solver's state. Collective.
    fn go_on(
        &mut self,
        candidate: &mut Candidate,
        layout: &Layout,
        step: &Step,
        now: &Now,
        log: &mut Log,
    ) -> Result<()> {
        let Candidate { surrogate, shadow, control, .. } = candidate;
        if self.steps == 0 {
            if let Some(control) = control {
                if control.state().is_none() {
                    // Nothing can be expected yet.
                    return Ok(());
                }
                self.judged.begin(control, self.rollout_steps);
            }
            if let Some(fits) = surrogate.fits_mut() {
                fits.begin_rollout();
            }
            self.first = shadow.start.clone();
            self.old = shadow.start.clone();
            self.now = shadow.predicted.clone();
            (self.finite, self.steps) = (shadow.finite, 1);
            return Ok(());
        }
        self.old = self.now.clone();
        self.steps += 1;
        let followed = match surrogate.fits_mut() {
            Some(fits) => fits.follow(self.steps, &mut self.now),
            None => {
                let state = self.imposed(surrogate.describe(), layout, now);
                let duration = surrogate.describe().stride;
                surrogate.predict(Start { state: &state, ahead: now.ahead, duration }, &mut self.now)
            }
        };
        self.finite = followed.is_ok();
        match followed {
            Err(Error::Numerical(what)) => log.not_finite(&step.name, Some(what)),
            other => other?,
        }
        Ok(())
    }

    /// The solver's state, but for what the surrogate has advanced: boundary faces that hold no value have that of their cell.
    fn imposed(&self, description: &Description, layout: &Layout, now: &Now) -> Values {
        let mut state = now.state.clone();
        for (&array, cells) in description.advances.iter().zip(&self.old) {
            let of = &layout.arrays()[array];
            state[array].copy_from_slice(cells);
            if let (Some(boundary), Some(held)) = (layout.at_boundary(&of.name), layout.held(&of.name)) {
                let faces = now.owners.iter().zip(&now.state[held]);
                let faces = faces.map(|(&owner, &held)| (owner as usize, held == 0.0));
                let values = &now.state[boundary];
                m4gn_domain::impose(of.components, faces, cells, values, &mut state[boundary]);
            }
        }
        state
    }

    /// The rollout minus the solver at the last time at which they were compared, and the name of that time.
    pub fn difference(&self) -> Option<&(Values, String)> {
        self.difference.as_ref()
    }

    /// The same as data: means over the times, and what control would have done.
    pub fn totals(&self, candidate: &Candidate, layout: &Layout) -> Value {
        let description = candidate.describe();
        let n = self.times as f64;
        let fields = layout.pick(&description.advances).into_iter().zip(&self.sums);
        let fields: Map<String, Value> = fields
            .map(|(field, sums)| {
                let one = sums[0] / self.one_steps.max(1) as f64;
                let [_, hold, rollout, first] = sums.map(|sum| sum / n);
                let means = json!({"one_step": one, "hold": hold, "rollout": rollout, "hold_first": first});
                (field.name.clone(), means)
            })
            .collect();
        let mut totals = json!({"surrogate": description.name, "times": self.times, "errors": fields});
        if candidate.control.is_some() {
            let j = &self.judged;
            totals["rollouts"] =
                json!({"jumps": j.jumps, "strides": j.strides, "within": j.within, "refused": j.refused});
        }
        totals
    }

    /// What there is to be said at the end.
    pub fn summary(&self, who: &str, candidate: &Candidate, layout: &Layout, digits: Digits) -> String {
        if self.times == 0 {
            return format!("m4gn: {who} came to no end of a stride beside the solver; nothing observed\n\n");
        }
        let n = self.times as f64;
        let mut text =
            format!("m4gn: mean rms errors of {}, over cells and components, at {} times\n", who, self.times);
        for (field, sums) in layout.pick(&candidate.describe().advances).iter().zip(&self.sums) {
            let one = digits.of(sums[0] / self.one_steps.max(1) as f64);
            let [_, hold, rollout, first] = sums.map(|sum| digits.of(sum / n));
            text += &format!(
                "    {}: one step {one} (hold {hold}), rollout {rollout} (hold first {first})\n",
                field.name
            );
        }
        if let Some(control) = &candidate.control {
            let j = &self.judged;
            text += &format!(
                "    control would have let {} rollouts go as jumps, of {} steps in the mean: the error at the end of {} of them was \
                 within the tolerance {}; at {} other starts it would have let none go\n",
                j.jumps,
                digits.of(j.strides as f64 / j.jumps.max(1) as f64),
                j.within,
                digits.of(control.settings().tolerance),
                j.refused
            );
        }
        text + "\n"
    }
}

/// A row with the root mean square over the cells and solved components of each segment. Collective.
fn in_segments(
    comm: &Comm,
    description: &Description,
    layout: &Layout,
    differences: &Values,
    time: String,
    digits: Digits,
) -> String {
    let (count, labels) = &description.segments;
    let count = (*count).max(1);
    let label = |i: usize| labels.get(i).map_or(0, |&label| label as usize);
    let mut columns = vec![time];
    for (field, values) in layout.pick(&description.advances).iter().zip(differences) {
        let mut sums = vec![0.0; 2 * count];
        for (i, cell) in values.chunks_exact(field.components).enumerate() {
            sums[label(i)] += cell.iter().map(|v| v * v).sum::<f64>();
            sums[count + label(i)] += field.solved as f64;
        }
        comm.sum_f64(&mut sums);
        let means = (0..count).map(|k| (sums[k] / sums[count + k].max(1.0)).sqrt());
        columns.extend(means.map(|mean| digits.of(mean)));
    }
    row(&columns)
}
