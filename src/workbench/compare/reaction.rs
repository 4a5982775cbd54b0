//! The force on a patch of a solid in both runs: the integral of the stored stress over the patch.
//!
//! Of a displacement alone no force is guessed: times at which one of the two runs stores no stress of that time are left
//! out, and counted.

use super::known;
use super::report::{both_runs, figures};
use super::series::Row;
use crate::decisions::later;
use crate::foam_case::{self, FoamCase, Unknown};
use m4gn_base::{Result, listed};
use m4gn_mesh::vector::{dot, norm, sub};
use m4gn_report::{Page, percent};
use serde::Serialize;
use std::collections::BTreeMap;

/// The forces of both runs, at the common times at which both have one; what a patch's surroundings pull the body with, N.
#[derive(Clone, Debug, Serialize)]
pub struct Reaction {
    /// The patch.
    pub patch: String,
    /// Times at which both runs have a force, s.
    pub times: Vec<f64>,
    /// Force in A, N.
    pub force_a: Vec<[f64; 3]>,
    /// Force in B, N.
    pub force_b: Vec<[f64; 3]>,
    /// Root mean squares over the times of the forces' magnitudes, A and B, N.
    pub rms: Option<[f64; 2]>,
    /// Largest magnitudes, A and B, N.
    pub largest: Option<[f64; 2]>,
    /// Root mean square of |B - A| over that of A; none where A has no force.
    pub error_rms: Option<f64>,
    /// Largest |B - A| over the largest |A|.
    pub error_max: Option<f64>,
    /// Times of these that B's solver computed, and not its surrogate.
    pub times_of_solver: usize,
    /// Root mean square of |B - A| over that of A, over these.
    pub error_rms_of_solver: Option<f64>,
    /// Root mean square of |B - A| over the range of A: the largest difference of a component between two times.
    pub error_of_range: Option<f64>,
    /// The same at the times that B's surrogate computed.
    pub error_of_range_of_surrogate: Option<f64>,
    /// Common times that were left out, with their number and why.
    pub left_out: Vec<LeftOut>,
}

/// Times at which there is no force.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// `full` or `hybrid`: the run that does not say it.
    pub run: &'static str,
    /// Why.
    pub why: &'static str,
    /// How many.
    pub times: usize,
}

/// Forces while the times go by.
#[derive(Default)]
pub(super) struct Track {
    patch: String,
    times: Vec<f64>,
    forces: [Vec<[f64; 3]>; 2],
    left_out: BTreeMap<(&'static str, Unknown), usize>,
    /// Begin and end of each jump of B, s.
    jumps: Vec<[f64; 2]>,
}

impl Track {
    /// Nothing yet.
    ///
    /// # Errors
    /// [`Error::Input`] for a patch that one of the cases does not have.
    pub fn new(a: &FoamCase, b: &FoamCase, patch: &str, jumps: Vec<[f64; 2]>) -> Result<Self> {
        known(a.description(), patch)?;
        known(b.description(), patch)?;
        Ok(Track { patch: patch.into(), jumps, ..Track::default() })
    }

    /// Adds a common time: number `i` of A, `j` of B.
    pub fn add(&mut self, a: &mut FoamCase, b: &mut FoamCase, (i, j): (usize, usize)) -> Result<()> {
        let both = [a.reaction(&self.patch, i)?, b.reaction(&self.patch, j)?];
        self.push(a.description().times[i], both);
        Ok(())
    }

    fn push(&mut self, time: f64, both: [foam_case::Reaction; 2]) {
        use foam_case::Reaction::{Force, Unknown};
        match both {
            [Force(a), Force(b)] => {
                self.times.push(time);
                self.forces[0].push(a);
                self.forces[1].push(b);
            }
            // A time counts once: the full run's want comes first.
            [Unknown(why), _] => *self.left_out.entry(("full", why)).or_default() += 1,
            [_, Unknown(why)] => *self.left_out.entry(("hybrid", why)).or_default() += 1,
        }
    }

    /// The comparison.
    pub fn finish(self) -> Reaction {
        let [a, b] = self.forces;
        let difference: Vec<[f64; 3]> = a.iter().zip(&b).map(|(a, b)| sub(*b, *a)).collect();
        let some = !a.is_empty();
        let rms = some.then(|| [rms(&a), rms(&b)]);
        let largest = some.then(|| [largest(&a), largest(&b)]);
        let over = |error: f64, of: Option<[f64; 2]>| Some(error / of.filter(|of| of[0] > 0.0)?[0]);
        let within = |t: f64, [begun, end]: &[f64; 2]| later(t, *begun) && !later(t, *end);
        let (surrogate, solver): (Vec<usize>, Vec<usize>) =
            (0..self.times.len()).partition(|&i| self.jumps.iter().any(|jump| within(self.times[i], jump)));
        let at = |of: &[usize], all: &[[f64; 3]]| self::rms(&of.iter().map(|&i| all[i]).collect::<Vec<_>>());
        let range = Some([range(&a); 2]);
        let of_surrogate = (!surrogate.is_empty()).then(|| at(&surrogate, &difference));
        Reaction {
            times_of_solver: solver.len(),
            error_rms_of_solver: over(at(&solver, &difference), Some([at(&solver, &a); 2])),
            error_of_range: over(self::rms(&difference), range),
            error_of_range_of_surrogate: of_surrogate.and_then(|error| over(error, range)),
            error_rms: over(self::rms(&difference), rms),
            error_max: over(self::largest(&difference), largest),
            patch: self.patch,
            times: self.times,
            force_a: a,
            force_b: b,
            rms,
            largest,
            left_out: self
                .left_out
                .into_iter()
                .map(|((run, why), times)| LeftOut { run, why: why.text(), times })
                .collect(),
        }
    }
}

fn rms(forces: &[[f64; 3]]) -> f64 {
    (forces.iter().map(|f| dot(*f, *f)).sum::<f64>() / forces.len().max(1) as f64).sqrt()
}

fn largest(forces: &[[f64; 3]]) -> f64 {
    forces.iter().map(|f| norm(*f)).fold(0.0, f64::max)
}

/// Of the component that varies most.
fn range(forces: &[[f64; 3]]) -> f64 {
    let extent = |d: usize| {
        let all = forces.iter().map(|f| f[d]);
        all.clone().fold(f64::NEG_INFINITY, f64::max) - all.fold(f64::INFINITY, f64::min)
    };
    (0..3).map(extent).fold(0.0, f64::max)
}

impl Reaction {
    /// Rows of a table of figures: what it is, A and B, and the error.
    pub(super) fn rows(&self) -> Vec<Row> {
        let row = |what: &str, both: Option<[f64; 2]>, error| {
            let name = format!("{what} reaction force on {} [N]", self.patch);
            (name, both.map_or([None; 2], |v| v.map(Some)), percent(error))
        };
        let mut rows = vec![row("rms", self.rms, self.error_rms)];
        // Without jumps the two are the same
        if self.times_of_solver < self.times.len() {
            let name = "    the same at the times of the solver alone".to_string();
            rows.push((name, [None; 2], percent(self.error_rms_of_solver)));
        }
        rows.push(row("largest", self.largest, self.error_max));
        let of_range = |name: &str, error| (name.to_string(), [None; 2], percent(error));
        rows.push(of_range("rms error of the force over the full run's range", self.error_of_range));
        if self.times_of_solver < self.times.len() {
            let error = self.error_of_range_of_surrogate;
            rows.push(of_range("    the same at the times of the surrogate", error));
        }
        rows
    }

    /// What was left out, in words; none where nothing was.
    pub fn left_out_text(&self) -> Option<String> {
        let left: usize = self.left_out.iter().map(|l| l.times).sum();
        if left == 0 {
            return None;
        }
        let parts = self.left_out.iter().map(|l| {
            let times = if l.times == 1 { "time" } else { "times" };
            format!("{} {times} where {} in the {} run", l.times, l.why, l.run)
        });
        Some(format!(
            "reaction force on {}: compared at {} of {} times; left out: {}",
            self.patch,
            self.times.len(),
            self.times.len() + left,
            listed(parts)
        ))
    }

    /// A section of the report: the figures, and a chart for each direction in which the full run has a force.
    pub(super) fn report(&self, page: &mut Page) -> Result<()> {
        page.heading("Reaction force");
        page.paragraph(&format!(
            "Integral of the stored stress sigma over patch {}, with large strains over its deformed areas: what holds the \
             body there pulls it with. The errors are those of the vector: root mean square over the times, and largest, \
             over those of the full run; and root mean square over the range of the full run's force, the largest difference of a \
             component between two times.",
            self.patch
        ));
        if let Some(text) = self.left_out_text() {
            page.paragraph(&format!("{text}."));
        }
        page.table(&figures(self.rows()));
        for d in (0..3).filter(|&d| self.force_a.iter().any(|f| f[d] != 0.0)) {
            let [a, b] = [&self.force_a, &self.force_b].map(|f| f.iter().map(|v| v[d]).collect::<Vec<_>>());
            let label = format!("force along {} [N]", ["x", "y", "z"][d]);
            let caption = format!("Reaction force on {}.", self.patch);
            both_runs(page, &label, &self.times, [&a, &b], &caption)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foam_case::Reaction::{Force, Unknown as Without};

    fn track() -> Track {
        Track { patch: "clamp".into(), jumps: vec![[0.15, 0.25]], ..Track::default() }
    }

    /// Full: 3 and 5 N; hybrid: off by 1 N across in the first, by 2 N along in the second.
    #[test]
    fn errors_are_those_of_the_vector() {
        let mut t = track();
        t.push(0.1, [Force([3.0, 0.0, 0.0]), Force([3.0, 1.0, 0.0])]);
        t.push(0.2, [Force([0.0, 3.0, 4.0]), Force([0.0, 4.2, 5.6])]);
        let found = t.finish();
        let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-12;
        assert!(near(found.rms.map(|r| r[0]), 17.0_f64.sqrt()), "{found:?}");
        assert!(near(found.error_rms, (2.5_f64 / 17.0).sqrt()), "{found:?}");
        assert!(near(found.error_max, 2.0 / 5.0), "{found:?}");
        assert!(near(found.largest.map(|r| r[1]), 7.0), "{found:?}");
        assert_eq!((found.times.len(), found.left_out_text()), (2, None));
        // The second is the surrogate's: 1 N of 3 N are left
        assert_eq!(found.times_of_solver, 1);
        assert!(near(found.error_rms_of_solver, 1.0 / 3.0), "{found:?}");
        // The full run's z goes from 0 to 4 N
        assert!(near(found.error_of_range, 2.5_f64.sqrt() / 4.0), "{found:?}");
        assert!(near(found.error_of_range_of_surrogate, 0.5), "{found:?}");
        assert_eq!(found.rows().len(), 5);
    }

    #[test]
    fn times_without_a_stress_are_left_out_and_told() {
        let mut t = track();
        let force = Force([1.0, 0.0, 0.0]);
        t.push(0.1, [force, force]);
        t.push(0.2, [force, Without(Unknown::Stale)]);
        t.push(0.3, [force, Without(Unknown::Stale)]);
        t.push(0.4, [Without(Unknown::Missing), Without(Unknown::Stale)]);
        let found = t.finish();
        assert_eq!((found.times.as_slice(), found.error_rms), (&[0.1][..], Some(0.0)));
        // One time has no range
        assert_eq!((found.error_of_range, found.error_of_range_of_surrogate), (None, None));
        let text = found.left_out_text().unwrap();
        assert_eq!(
            text,
            "reaction force on clamp: compared at 1 of 4 times; left out: 1 time where no sigma is stored in the full run, 2 \
             times where sigma was not advanced by the surrogate in the hybrid run"
        );

        // None is left: there is no figure, and none is made up
        let mut t = track();
        t.push(0.1, [force, Without(Unknown::Missing)]);
        let found = t.finish();
        assert!(found.error_rms.is_none() && found.error_max.is_none() && found.rms.is_none());
        assert!(found.rows().iter().all(|(_, both, error)| both == &[None; 2] && error == "-"));
    }

    /// A full run without any force makes no scale.
    #[test]
    fn no_force_is_no_scale() {
        let mut t = track();
        t.push(0.1, [Force([0.0; 3]), Force([1.0, 0.0, 0.0])]);
        let found = t.finish();
        assert_eq!((found.error_rms, found.error_max), (None, None));
        assert_eq!(found.rms, Some([0.0, 1.0]));
    }
}
