//! Mode observe in a ride: when rollouts beside the solver are compared, and the tables of their errors.

use crate::observe::{Now, Observer};
use crate::ride::Ride;
use m4gn_base::Result;

impl Ride<'_> {
    /// Mode observe. Collective.
    pub(crate) fn observe(&mut self) -> Result<()> {
        let digits = self.digits();
        if self.candidates.iter().all(|c| c.observer.is_none()) {
            let several = self.candidates.len() > 1;
            for (i, candidate) in self.candidates.iter_mut().enumerate() {
                candidate.observer = Some(Observer::new(candidate, &self.settings, i == 0, several));
            }
            // An observer's tables are there from its begin.
            (self.log.observed, self.log.segments) = (self.errors_head(), self.segments_head());
        }
        for i in 0..self.candidates.len() {
            let candidate = &self.candidates[i];
            let due = match candidate.shadow.waiting {
                true => candidate.has_arrived(&self.step),
                false => candidate.can_begin(&self.step),
            };
            if !due {
                continue;
            }
            let ahead = self.ahead(i, false, self.candidates[i].stride())?;
            let candidate = &mut self.candidates[i];
            let Some(mut observer) = candidate.observer.take() else { continue };
            let arrived = observer.arrived(
                &self.comm,
                &self.layout,
                candidate,
                &self.step,
                Now {
                    state: &self.present,
                    ahead: ahead.as_ref(),
                    owners: &self.owners,
                    digits,
                    n_fields: self.fields.len(),
                },
                &mut self.log,
            );
            candidate.observer = Some(observer);
            arrived?;
            self.stepped |= self.candidates[i].shadow.waiting;
        }
        Ok(())
    }

    /// The rollout of an observed surrogate minus the solver, of an array that it advances, and the name of the time at which they were
    /// compared last; none before.
    pub fn difference(&self, surrogate: usize, array: usize) -> Option<(&[f64], &str)> {
        let candidate = self.candidates.get(surrogate)?;
        let place = candidate.describe().advances.iter().position(|&a| a == array)?;
        let (values, time) = candidate.observer.as_ref()?.difference()?;
        Some((&values[place], time))
    }

    /// The head of the table of errors.
    fn errors_head(&self) -> String {
        let digits = self.digits();
        let mut columns: Vec<String> = vec!["Time".into()];
        if self.candidates.len() > 1 {
            columns.push("surrogate".into());
        }
        columns.push("steps".into());
        for field in self.layout.pick(&self.fields) {
            let kinds = ["oneStep", "hold", "rollout", "holdFirst", "rms"];
            columns.extend(kinds.map(|kind| format!("{kind}({})", field.name)));
        }
        if self.settings.control.is_some() {
            columns.extend(["error".into(), "estimate".into()]);
        }
        let mut lines = vec!["Error of the surrogate against the solver".to_string()];
        lines.extend(self.candidates.iter().map(|c| c.describe().source.clone()));
        let mut values: Vec<(&str, String)> =
            self.candidates.iter().map(|c| ("stride (s)", digits.of(c.stride()))).collect();
        values.push(("rolloutSteps", self.settings.rollout_steps.to_string()));
        digits.header(&lines, &values, &columns)
    }

    /// The head of the table of errors in segments; empty: it is not asked for.
    fn segments_head(&self) -> String {
        if !self.settings.write_errors {
            return String::new();
        }
        let description = self.candidates[0].describe();
        let mut columns: Vec<String> = vec!["Time".into()];
        for field in self.layout.pick(&description.advances) {
            columns.extend((0..description.segments.0.max(1)).map(|k| format!("{}:{k}", field.name)));
        }
        let lines = ["Error of the surrogate's rollout in each segment".into(), description.source.clone()];
        self.digits().header(&lines, &[], &columns)
    }
}
