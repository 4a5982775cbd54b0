//! A surrogate beside the solver: single strides, and rollouts that begin anew from the solver's fields.

use crate::control::{Control, StrideError};
use crate::ride::Ride;
use crate::rider::Rider;
use crate::schedule::Step;
use crate::settings::RideSettings;
use crate::shadow::Shadow;
use crate::surrogate::Surrogate;
use crate::tables::{Digits, row};
use crate::values::{Given, Values, between, places, rms};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_step::Field;

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

/// The observer of one surrogate.
#[derive(Clone, Debug)]
pub(crate) struct Observer {
    rollout_steps: usize,
    /// The advanced fields where the rollout began, and at its last two times.
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

/// Rows of the two tables, and what is to be said.
#[derive(Debug, Default)]
pub(crate) struct Observed {
    pub errors: String,
    pub segments: String,
    pub bad: Vec<String>,
}

impl Observer {
    /// Errors in segments are told of the first surrogate; rows have the name where there are several.
    pub fn new(rider: &Rider, settings: &RideSettings, first: bool, several: bool) -> Self {
        let rollout_steps = settings.rollout_steps;
        Observer {
            rollout_steps,
            first: Values::new(),
            old: Values::new(),
            now: Values::new(),
            steps: 0,
            finite: true,
            sums: vec![[0.0; 4]; rider.surrogate.advances().len()],
            times: 0,
            one_steps: 0,
            write_errors: settings.write_errors,
            in_segments: first && settings.write_errors,
            name: several.then(|| rider.surrogate.name().into()),
            difference: None,
            judged: Judged { estimates: vec![f64::INFINITY; rollout_steps], ..Judged::default() },
        }
    }

    /// What follows a step of the solver where it has arrived at the end of a stride, or where none is under way. Collective.
    #[allow(clippy::too_many_arguments)]
    pub fn arrived(
        &mut self,
        comm: &Comm,
        (surrogate, columns): (&mut dyn Surrogate, &[usize]),
        shadow: &mut Shadow,
        control: Option<&mut Control>,
        step: &Step,
        given: &Given,
        digits: (Digits, usize),
    ) -> Result<Observed> {
        let mut found = Observed::default();
        let mut control = control;
        if shadow.waiting {
            let fraction = shadow.fraction(step, surrogate.stride());
            let solver = given.values(comm, surrogate.advances())?;
            let one_step = shadow.compare(comm, surrogate, &solver, fraction);
            if let Some(control) = control.as_deref_mut().filter(|_| !shadow.idle) {
                control.measure(&one_step)?;
            }
            if self.steps > 0 {
                self.compare(
                    comm,
                    (surrogate, columns),
                    control.as_deref(),
                    (&solver, &one_step, fraction),
                    step,
                    digits,
                    &mut found,
                );
            }
            if self.steps >= self.rollout_steps || !self.finite {
                self.steps = 0;
            }
        }
        match surrogate.is_ready(step.time) {
            true => found.bad.extend(shadow.begin(comm, surrogate, step, given)?),
            // A rollout goes on, and is compared at the ends of its strides.
            false if self.steps > 0 => shadow.begin_idle(comm, surrogate, step, given)?,
            false => return Ok(found),
        }
        self.go_on(surrogate, shadow, control.as_deref(), given, &mut found)?;
        Ok(found)
    }

    #[allow(clippy::too_many_arguments)]
    fn compare(
        &mut self,
        comm: &Comm,
        (surrogate, places): (&dyn Surrogate, &[usize]),
        control: Option<&Control>,
        (solver, one_step, fraction): (&Values, &[StrideError], f64),
        step: &Step,
        (digits, n_fields): (Digits, usize),
        found: &mut Observed,
    ) {
        let fields = surrogate.advances();
        let pairs = self.old.iter().zip(&self.now).zip(solver);
        let differences: Values = pairs
            .map(|((old, now), solver)| {
                let triples = old.iter().zip(now).zip(solver);
                triples.map(|((o, n), s)| between(*o, *n, fraction) - s).collect()
            })
            .collect();
        let rollout = rms(comm, fields, differences.iter().map(|d| d.iter().copied()));
        let firsts = self.first.iter().zip(solver);
        let hold_first = rms(comm, fields, firsts.map(|(f, s)| f.iter().zip(s).map(|(f, s)| f - s)));
        let or_not = |error: f64| if error.is_infinite() { NOT_FINITE } else { error };
        self.one_steps += usize::from(!one_step.iter().any(|e| e.error.is_nan()));
        let mut columns = vec![digits.of(step.shown)];
        columns.extend(self.name.clone());
        columns.push(self.steps.to_string());
        let mut figures = vec![[f64::NAN; 5]; n_fields];
        let mut errors = Vec::new();
        for (i, sums) in self.sums.iter_mut().enumerate() {
            let rollout = if self.finite { rollout[i] } else { NOT_FINITE };
            let row = [or_not(one_step[i].error), one_step[i].change, rollout, hold_first[i]];
            figures[places[i]] = [row[0], row[1], row[2], row[3], one_step[i].size];
            sums.iter_mut()
                .zip(row)
                .for_each(|(sum, value)| *sum += if value.is_nan() { 0.0 } else { value });
            errors.push(rollout);
        }
        columns.extend(figures.iter().flatten().map(|v| digits.of(*v)));
        if let Some(control) = control {
            let error = control.relative(&errors).unwrap_or(f64::INFINITY);
            let estimate = self.judged.estimates[self.steps - 1];
            columns.extend([digits.of(error), digits.of(estimate)]);
            if self.steps == self.judged.allowed {
                self.judged.jumps += 1;
                self.judged.strides += self.judged.allowed;
                self.judged.within += usize::from(error <= control.settings().tolerance);
            }
        }
        found.errors = row(&columns);
        if self.write_errors && self.finite {
            if self.in_segments {
                found.segments = in_segments(comm, surrogate, &differences, digits.of(step.shown), digits);
            }
            self.difference = Some((differences, step.name.clone()));
        }
        self.times += 1;
    }

    /// A stride of the rollout, or its begin from the solver's fields. Collective.
    fn go_on(
        &mut self,
        surrogate: &mut dyn Surrogate,
        shadow: &Shadow,
        control: Option<&Control>,
        given: &Given,
        found: &mut Observed,
    ) -> Result<()> {
        if self.steps == 0 {
            if let Some(control) = control {
                if control.state().is_none() {
                    // Nothing can be expected yet.
                    return Ok(());
                }
                let judged = &mut self.judged;
                for (i, estimate) in judged.estimates.iter_mut().enumerate() {
                    *estimate = control.estimate(i + 1);
                }
                judged.allowed = control.strides(self.rollout_steps);
                judged.refused += usize::from(judged.allowed == 0);
            }
            surrogate.begin_rollout();
            self.first = shadow.start.clone();
            self.old = shadow.start.clone();
            self.now = shadow.predicted.clone();
            (self.finite, self.steps) = (shadow.finite, 1);
            return Ok(());
        }
        // As the solver's, but for what the surrogate has advanced.
        self.old = self.now.clone();
        let mut boundaries = Vec::new();
        for (i, field) in given.fields.iter().enumerate() {
            let own = surrogate.advances().iter().position(|a| a.name == field.name);
            boundaries.push(own.map(|own| {
                let held = given.held.get(i).copied().flatten();
                (own, impose(field, held, &self.old[own], given.owners))
            }));
        }
        let pairs = given.fields.iter().zip(&boundaries);
        let fields: Vec<Field> = pairs
            .map(|(field, own)| match own {
                Some((own, boundary)) => Field { cells: &self.old[*own], boundary, ..*field },
                None => *field,
            })
            .collect();
        let own = Given { fields: &fields, ..*given };
        self.steps += 1;
        let advanced = surrogate.advances().to_vec();
        let followed = surrogate.follow(self.steps, own.fields, &mut places(&advanced, &mut self.now));
        self.finite = followed.is_ok();
        match followed {
            Err(Error::Numerical(what)) => found.bad.push(what),
            other => other?,
        }
        Ok(())
    }

    /// The rollout minus the solver at the last time at which they were compared, and the name of that time.
    pub fn difference(&self) -> Option<&(Values, String)> {
        self.difference.as_ref()
    }

    /// What there is to be said at the end.
    pub fn summary(&self, who: &str, rider: &Rider, digits: Digits) -> String {
        if self.times == 0 {
            return format!("m4gn: {who} came to no end of a stride beside the solver; nothing observed\n\n");
        }
        let n = self.times as f64;
        let mut text =
            format!("m4gn: mean rms errors of {}, over cells and components, at {} times\n", who, self.times);
        for (field, sums) in rider.surrogate.advances().iter().zip(&self.sums) {
            let one = digits.of(sums[0] / self.one_steps.max(1) as f64);
            let [_, hold, rollout, first] = sums.map(|sum| digits.of(sum / n));
            text += &format!(
                "    {}: one step {one} (hold {hold}), rollout {rollout} (hold first {first})\n",
                field.name
            );
        }
        if let Some(control) = &rider.control {
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

impl Ride<'_> {
    /// The head of the table of errors.
    pub(crate) fn errors_head(&self) -> String {
        let digits = self.digits();
        let mut columns: Vec<String> = vec!["Time".into()];
        if self.riders.len() > 1 {
            columns.push("surrogate".into());
        }
        columns.push("steps".into());
        for field in &self.fields {
            let kinds = ["oneStep", "hold", "rollout", "holdFirst", "rms"];
            columns.extend(kinds.map(|kind| format!("{kind}({field})")));
        }
        if self.settings.control.is_some() {
            columns.extend(["error".into(), "estimate".into()]);
        }
        let mut lines = vec!["Error of the surrogate against the solver".to_string()];
        lines.extend(self.riders.iter().map(|r| r.surrogate.source()));
        let mut values: Vec<(&str, String)> =
            self.riders.iter().map(|r| ("stride (s)", digits.of(r.surrogate.stride()))).collect();
        values.push(("rolloutSteps", self.settings.rollout_steps.to_string()));
        digits.header(&lines, &values, &columns)
    }

    /// The head of the table of errors in segments; empty: it is not asked for.
    pub(crate) fn segments_head(&self) -> String {
        if !self.settings.write_errors {
            return String::new();
        }
        let surrogate = self.riders[0].surrogate.as_ref();
        let mut columns: Vec<String> = vec!["Time".into()];
        for field in surrogate.advances() {
            columns.extend((0..surrogate.segments().0.max(1)).map(|k| format!("{}:{k}", field.name)));
        }
        let lines = ["Error of the surrogate's rollout in each segment".into(), surrogate.source()];
        self.digits().header(&lines, &[], &columns)
    }
}

/// Boundary values of a field whose cells are these: the host's where they are held, else those of the face's cell.
fn impose(field: &Field, held: Option<&[i32]>, cells: &[f64], owners: &[i32]) -> Vec<f64> {
    let mut values = field.boundary.to_vec();
    if let Some(held) = held {
        let faces = owners.iter().zip(held);
        let faces = faces.map(|(&owner, &held)| (owner as usize, held == 0));
        m4gn_domain::impose(field.components, faces, cells, field.boundary, &mut values);
    }
    values
}

/// A row with the root mean square over the cells and solved components of each segment. Collective.
fn in_segments(
    comm: &Comm,
    surrogate: &dyn Surrogate,
    differences: &Values,
    time: String,
    digits: Digits,
) -> String {
    let (count, labels) = surrogate.segments();
    let count = count.max(1);
    let label = |i: usize| labels.get(i).map_or(0, |&label| label as usize);
    let mut columns = vec![time];
    for (field, values) in surrogate.advances().iter().zip(differences) {
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
