//! Drag and lift coefficients of a patch.

use super::report::both_runs;
use super::series::{FEWEST, Row, Series, relative};
use super::tables::{Table, common, over};
use super::{DEFAULT_PATCH, Options};
use crate::foam_case::{Description, FoamCase, FunctionObject, Patch};
use m4gn_base::{Error, Result, listed};
use m4gn_mesh::vector::{cross, dot, norm};
use m4gn_report::{Page, number, percent};
use serde::Serialize;
use std::path::Path;

/// What coefficients are made with: `c = F / (rho 1/2 speed^2 area)`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Reference {
    /// Patch that the forces act on.
    pub patch: String,
    /// Reference speed, m/s.
    pub speed: f64,
    /// Extent of the patch across the flow, m.
    pub length: f64,
    /// Length times extent along the span, m^2.
    pub area: f64,
    /// Unit vector of the flow.
    pub drag_direction: [f64; 3],
    /// Unit vector across it: turned by 90 degrees in 2-D, towards the second direction in 3-D.
    pub lift_direction: [f64; 3],
}

impl Reference {
    /// Reference values of the full run at time number `time`; none where there is no patch to look at.
    ///
    /// The speed is the mean over the patches through which fluid enters; its direction is that of the drag.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown patch, one without extent across the flow, or a case that no fluid enters.
    pub fn find(case: &mut FoamCase, options: &Options, time: usize) -> Result<Option<Self>> {
        let description = case.description().clone();
        let wanted = options.patch.as_deref().unwrap_or(DEFAULT_PATCH);
        if let (Err(e), given) = (super::known(&description, wanted), &options.patch) {
            return given.as_ref().map_or(Ok(None), |_| Err(e));
        }
        let velocity = inlet_velocity(case, time)?.ok_or_else(|| {
            Error::Input(format!(
                "no fluid enters {} through any of its patches ({}) at {} s, so drag has no direction",
                description.path,
                listed(description.patches.iter().map(|p| &p.name)),
                description.times[time]
            ))
        })?;
        Reference::of(&description, wanted, velocity).map(Some)
    }

    /// Reference values of a patch in a flow of this velocity, m/s.
    ///
    /// # Errors
    /// As [`Reference::find`].
    pub(super) fn of(description: &Description, wanted: &str, velocity: [f64; 3]) -> Result<Self> {
        let patch = super::known(description, wanted)?;
        let speed = norm(velocity);
        let drag_direction = velocity.map(|v| v / speed);
        let lift_direction = across(drag_direction, &description.directions);
        let extent =
            |n: [f64; 3]| (0..3).map(|d| n[d].abs() * (patch.upper[d] - patch.lower[d])).sum::<f64>();
        let span = cross(drag_direction, lift_direction);
        let length = extent(lift_direction);
        let area = length * extent(span);
        if area.is_nan() || area <= 0.0 {
            return Err(Error::Input(format!(
                "patch {wanted} of {} has no extent across the flow ({length} m); name another patch",
                description.path
            )));
        }
        Ok(Reference { patch: wanted.into(), speed, length, area, drag_direction, lift_direction })
    }
}

/// Mean velocity over the patches that fluid enters through, m/s; none where there are none.
pub(super) fn inlet_velocity(case: &mut FoamCase, time: usize) -> Result<Option<[f64; 3]>> {
    let inlets = inlet(case, time)?;
    let mean = |d: usize| inlets.iter().map(|f| f.velocity[d] * f.area).sum::<f64>();
    let area: f64 = inlets.iter().map(|f| f.area).sum();
    let velocity: [f64; 3] = std::array::from_fn(|d| mean(d) / area.max(f64::MIN_POSITIVE));
    Ok((norm(velocity) > 0.0).then_some(velocity))
}

/// Patches that fluid enters through.
fn inlet(case: &mut FoamCase, time: usize) -> Result<Vec<crate::foam_case::Flow>> {
    // A mappedPatch can be an inlet: it takes its values from a plane downstream
    let open = |p: &&Patch| ["patch", "mappedPatch"].contains(&p.kind.as_str());
    let patches: Vec<String> =
        case.description().patches.iter().filter(open).map(|p| p.name.clone()).collect();
    let mut flows = Vec::new();
    for patch in patches {
        let flow = case.flow(&patch, time)?;
        if flow.flux < 0.0 {
            flows.push(flow);
        }
    }
    // An outlet with a little backflow is none: fluid enters by at least a hundredth of the largest inflow.
    let most = flows.iter().map(|f| f.flux).fold(0.0, f64::min);
    flows.retain(|f| f.flux <= 0.01 * most);
    Ok(flows)
}

/// Unit vector across `flow`.
fn across(flow: [f64; 3], directions: &[usize]) -> [f64; 3] {
    let mut result = [0.0; 3];
    if let [i, j] = *directions {
        result[i] = -flow[j];
        result[j] = flow[i];
    } else {
        // The part of y (of z for flow along y) that is across the flow.
        let up = if flow[1].abs() < 0.9 { 1 } else { 2 };
        result[up] = 1.0;
        for d in 0..3 {
            result[d] -= flow[up] * flow[d];
        }
    }
    let length = norm(result).max(f64::MIN_POSITIVE);
    // Adding zero makes -0 a plain 0.
    result.map(|v| v / length + 0.0)
}

/// Drag and lift of both runs; lists have one entry a common time.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Forces {
    /// Patch of the forces.
    pub patch: String,
    /// Reference values of the coefficients.
    pub reference: Reference,
    /// Drag coefficient of A.
    pub drag_a: Vec<f64>,
    /// Drag coefficient of B.
    pub drag_b: Vec<f64>,
    /// Lift coefficient of A.
    pub lift_a: Vec<f64>,
    /// Lift coefficient of B.
    pub lift_b: Vec<f64>,
    /// The function object whose tables of both runs the figures below are of, with its own reference values; none: they are of the
    /// stored times.
    pub table: Option<String>,
    /// Mean drag coefficients of A and B, weighed by time; none: there are too few times.
    pub mean_drag: [Option<f64>; 2],
    /// Root mean squares of the lift fluctuations of A and B.
    pub lift_rms: [Option<f64>; 2],
    /// Shedding frequencies of A and B from the lift, 1/s; none where the lift does not oscillate, or times are too few or too far apart.
    pub frequency: [Option<f64>; 2],
    /// Strouhal numbers of A and B.
    pub strouhal: [Option<f64>; 2],
    /// |mean drag of B / mean drag of A - 1|.
    pub drag_error: Option<f64>,
    /// |lift fluctuation of B / that of A - 1|; none where the full run's lift rests.
    pub lift_error: Option<f64>,
    /// |Strouhal number of B / that of A - 1|.
    pub strouhal_error: Option<f64>,
}

/// Beyond this relative error a factor says more.
const MUCH: f64 = 10.0;

/// Strouhal numbers up to here are told from stored times: those of bluff bodies, in channels too.
const LEAST_STROUHAL: f64 = 0.4;

/// Lift fluctuations below this part of the mean drag are no oscillation.
const QUIET: f64 = 1e-4;

impl Forces {
    /// Those of no time yet.
    pub(super) fn new(reference: Reference) -> Self {
        Forces { patch: reference.patch.clone(), reference, ..Forces::default() }
    }

    /// Appends the forces of a common time: number `i` of A, `j` of B.
    pub(super) fn add(&mut self, a: &mut FoamCase, b: &mut FoamCase, (i, j): (usize, usize)) -> Result<()> {
        let both = [a.force(&self.patch, i)?.total(), b.force(&self.patch, j)?.total()];
        self.push(both);
        Ok(())
    }

    /// Appends coefficients of forces over the density, m^4/s^2.
    fn push(&mut self, both: [[f64; 3]; 2]) {
        let r = &self.reference;
        let scale = 0.5 * r.speed * r.speed * r.area;
        let [drag, lift] =
            [r.drag_direction, r.lift_direction].map(|n| both.map(|force| dot(force, n) / scale));
        self.drag_a.push(drag[0]);
        self.drag_b.push(drag[1]);
        self.lift_a.push(lift[0]);
        self.lift_b.push(lift[1]);
    }

    /// Drag and lift of both runs in the tables of a function object that looks at the patch alone, and its name.
    fn tabled(&self, cases: [&Description; 2]) -> Option<(String, [[Series; 2]; 2])> {
        let r = &self.reference;
        let find = |kind: &str, file: &str, of: &dyn Fn(&Table, &FunctionObject) -> Option<[Series; 2]>| {
            common(cases, &[kind]).filter(|f| f.patches[..] == [self.patch.clone()]).find_map(|object| {
                let [a, b] = cases.map(|c| of(&Table::read(Path::new(&c.path), &object.name, file)?, object));
                Some((object.name.clone(), [a?, b?]))
            })
        };
        find("forceCoeffs", "coefficient.dat", &|table, _| table.coefficients()).or_else(|| {
            find("forces", "force.dat", &|table, object| {
                let scale = object.density? * 0.5 * r.speed * r.speed * r.area;
                let along = |n: [f64; 3]| table.force(n.map(|d| d / scale));
                Some([along(r.drag_direction)?, along(r.lift_direction)?])
            })
        })
    }

    /// Means, fluctuations and frequencies from the takeover on, s: of tables where both runs have some, else of the stored times.
    pub(super) fn finish(mut self, cases: [&Description; 2], takeover: f64, times: &[f64]) -> Self {
        let time = self.reference.length / self.reference.speed;
        let of = |values: &[f64]| Series { times: times.to_vec(), values: values.to_vec() };
        let stored = || [[of(&self.drag_a), of(&self.lift_a)], [of(&self.drag_b), of(&self.lift_b)]];
        let (table, tabled) = self.tabled(cases).unzip();
        let [[drag_a, lift_a], [drag_b, lift_b]] = tabled.unwrap_or_else(stored);
        // A signal that is faster than half of its samples is taken for a slower one
        let longest = if table.is_some() { f64::INFINITY } else { 0.5 * time / LEAST_STROUHAL };
        let drag = over([drag_a, drag_b], takeover, longest);
        let lift = over([lift_a, lift_b], takeover, longest);
        self.table = table;
        self.mean_drag = drag.map(|s| s.mean);
        self.lift_rms = lift.map(|s| s.rms);
        self.drag_error = relative(self.mean_drag);
        let quiet = |lift: f64, drag: f64| lift <= QUIET * drag.abs();
        if self.lift_rms[0].zip(self.mean_drag[0]).is_none_or(|(lift, drag)| quiet(lift, drag)) {
            return self;
        }
        self.lift_error = relative(self.lift_rms);
        self.frequency = lift.map(|s| s.frequency);
        self.strouhal = self.frequency.map(|f| f.map(|f| f * time));
        self.strouhal_error = relative(self.strouhal);
        self
    }

    /// Where the figures are from, and why there are none.
    pub(super) fn notes(&self, times: &[f64]) -> Vec<String> {
        let mut notes = Vec::new();
        let time = self.reference.length / self.reference.speed;
        let longest = times.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
        match &self.table {
            Some(name) => notes.push(format!(
                "drag and lift: the tables of the function object {name} of both runs, weighed by time; coefficients by its own reference values"
            )),
            None if times.len() < FEWEST => notes.push(format!(
                "no mean drag, lift and frequency: {} stored times are too few, expected at least {FEWEST}; a function object forceCoeffs on \
                 patch {} in both runs tells of all time steps",
                times.len(),
                self.patch
            )),
            None if longest > 0.5 * time / LEAST_STROUHAL * (1.0 + 1e-6) => notes.push(format!(
                "no shedding frequency: stored times are up to {} s apart, and what is faster than half of that would be taken for something \
                 slower; expected at most {} s, or a function object forceCoeffs on patch {} in both runs",
                number(longest, 3),
                number(0.5 * time / LEAST_STROUHAL, 3),
                self.patch
            )),
            None => {}
        }
        if notes.is_empty() || self.table.is_some() {
            let missing = self.lift_error.is_some() && self.frequency.contains(&None);
            notes.extend(missing.then(|| {
                "no shedding frequency: the lift does not oscillate over at least 1.5 periods in both runs".into()
            }));
        }
        notes
    }

    pub(super) fn rows(&self) -> Vec<Row> {
        // A full run whose lift hardly changes makes no scale.
        let lift = match self.lift_error {
            Some(e) if e > MUCH => format!("{} times the full run's", number(e + 1.0, 3)),
            error => percent(error),
        };
        let row = |name: &str, pair, error| (name.to_string(), pair, error);
        vec![
            row("mean drag coefficient", self.mean_drag, percent(self.drag_error)),
            row("rms lift coefficient", self.lift_rms, lift),
            row("shedding frequency [1/s]", self.frequency, percent(self.strouhal_error)),
            row("Strouhal number", self.strouhal, percent(self.strouhal_error)),
        ]
    }

    pub(super) fn report(&self, times: &[f64], page: &mut Page) -> Result<()> {
        let r = &self.reference;
        page.paragraph(&format!(
            "Forces on patch {} from the stored p and U: pressure and viscous part, as OpenFOAM's forces function object. \
             Coefficients with speed {} m/s, length {} m, area {} m2. Means are weighed by time; frequency from a least-squares sine through the lift.",
            r.patch,
            number(r.speed, 4),
            number(r.length, 4),
            number(r.area, 4)
        ));
        both_runs(page, "drag coefficient", times, [&self.drag_a, &self.drag_b], "Drag.")?;
        both_runs(page, "lift coefficient", times, [&self.lift_a, &self.lift_b], "Lift.")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lift_is_across_the_flow() {
        assert_eq!(across([1.0, 0.0, 0.0], &[0, 1]), [0.0, 1.0, 0.0]);
        assert_eq!(across([0.0, 0.0, 1.0], &[0, 2]), [-1.0, 0.0, 0.0]);
        assert_eq!(across([1.0, 0.0, 0.0], &[0, 1, 2]), [0.0, 1.0, 0.0]);
        assert_eq!(across([0.0, 1.0, 0.0], &[0, 1, 2]), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn coefficients_of_a_known_force() {
        let reference = Reference {
            patch: "cylinder".into(),
            speed: 2.0,
            length: 0.1,
            area: 0.1,
            drag_direction: [1.0, 0.0, 0.0],
            lift_direction: [0.0, 1.0, 0.0],
        };
        let mut c = Forces::new(reference);
        c.push([[0.4, -0.1, 9.0], [0.2, 0.0, 0.0]]);
        assert!((c.drag_a[0] - 2.0).abs() < 1e-12 && (c.lift_a[0] + 0.5).abs() < 1e-12);
        assert!((c.drag_b[0] - 1.0).abs() < 1e-12);
        // One instant makes no mean
        let none = Description::default();
        let once = c.clone().finish([&none, &none], 0.0, &[1.0]);
        assert!(once.mean_drag == [None; 2] && once.drag_error.is_none());
        assert!(once.notes(&[1.0])[0].contains("1 stored times are too few"), "{:?}", once.notes(&[1.0]));
        // A lift that rests makes no scale
        (1..9).for_each(|_| c.push([[0.4, -0.1, 9.0], [0.2, 0.0, 0.0]]));
        let times: Vec<f64> = (1..10).map(f64::from).collect();
        let c = c.finish([&none, &none], 0.0, &times);
        assert!((c.drag_error.unwrap() - 0.5).abs() < 1e-12 && c.lift_error.is_none());
    }
}
