//! Drag and lift coefficients of a patch.

use super::Options;
use super::report::{Row, both_runs};
use crate::foam_case::{Description, FoamCase};
use crate::signal;
use m4gn_base::{Error, Result};
use m4gn_mesh::vector::cross;
use m4gn_report::{Page, number, percent};
use serde::Serialize;

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

/// The patch that is taken without being named.
const DEFAULT_PATCH: &str = "cylinder";

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
        let names: Vec<&str> = description.patches.iter().map(|p| p.name.as_str()).collect();
        let velocity = inlet_velocity(case, time)?.ok_or_else(|| {
            Error::Input(format!(
                "no fluid enters {} through any of its patches ({}) at {} s, so drag has no direction. Without forces: \
                 name no patch, and call none {DEFAULT_PATCH}",
                description.path,
                names.join(", "),
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
        let speed = velocity.iter().map(|v| v * v).sum::<f64>().sqrt();
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
    let square: f64 = velocity.iter().map(|v| v * v).sum();
    Ok((square > 0.0).then_some(velocity))
}

/// Patches that fluid enters through.
fn inlet(case: &mut FoamCase, time: usize) -> Result<Vec<crate::foam_case::Flow>> {
    let patches: Vec<String> =
        case.description().patches.iter().filter(|p| p.kind == "patch").map(|p| p.name.clone()).collect();
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
    let norm = result.iter().map(|v| v * v).sum::<f64>().sqrt();
    // Adding zero makes -0 a plain 0.
    result.map(|v| v / norm.max(f64::MIN_POSITIVE) + 0.0)
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
    /// Mean drag coefficients of A and B.
    pub mean_drag: [f64; 2],
    /// Root mean squares of the lift fluctuations of A and B.
    pub lift_rms: [f64; 2],
    /// Shedding frequencies of A and B from the lift, 1/s; none where the lift does not oscillate.
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
        let along = |force: [f64; 3], n: [f64; 3]| (0..3).map(|d| force[d] * n[d]).sum::<f64>() / scale;
        let [drag, lift] = [r.drag_direction, r.lift_direction].map(|n| both.map(|force| along(force, n)));
        self.drag_a.push(drag[0]);
        self.drag_b.push(drag[1]);
        self.lift_a.push(lift[0]);
        self.lift_b.push(lift[1]);
    }

    /// Means, fluctuations and frequencies over the times.
    pub(super) fn finish(mut self, times: &[f64]) -> Self {
        let relative = |v: [f64; 2]| (v[0] != 0.0).then(|| (v[1] / v[0] - 1.0).abs());
        self.mean_drag = [&self.drag_a, &self.drag_b].map(|v| signal::mean(v));
        self.lift_rms = [&self.lift_a, &self.lift_b].map(|v| signal::fluctuation(v));
        self.drag_error = relative(self.mean_drag);
        if self.lift_rms[0] <= QUIET * self.mean_drag[0].abs() {
            return self;
        }
        self.lift_error = relative(self.lift_rms);
        let frequency = |lift: &[f64]| signal::dominant_oscillation(times, lift).map(|o| o.frequency);
        self.frequency = [frequency(&self.lift_a), frequency(&self.lift_b)];
        let scale = self.reference.length / self.reference.speed;
        self.strouhal = self.frequency.map(|f| f.map(|f| f * scale));
        if let [Some(a), Some(b)] = self.strouhal {
            self.strouhal_error = relative([a, b]);
        }
        self
    }

    pub(super) fn rows(&self) -> Vec<Row> {
        // A full run whose lift hardly changes makes no scale.
        let lift = match self.lift_error {
            Some(e) if e > MUCH => {
                let times = self.lift_rms[1] / self.lift_rms[0];
                format!("{} times the full run's", number(times, 3))
            }
            error => percent(error),
        };
        let row = |name: &str, pair, error| (name.to_string(), pair, error);
        vec![
            row("mean drag coefficient", self.mean_drag.map(Some), percent(self.drag_error)),
            row("rms lift coefficient", self.lift_rms.map(Some), lift),
            row("shedding frequency [1/s]", self.frequency, percent(self.strouhal_error)),
            row("Strouhal number", self.strouhal, percent(self.strouhal_error)),
        ]
    }

    pub(super) fn report(&self, times: &[f64], page: &mut Page) -> Result<()> {
        let r = &self.reference;
        page.paragraph(&format!(
            "Forces on patch {} from the stored p and U: pressure and viscous part, as OpenFOAM's forces function object. \
             Coefficients with speed {} m/s, length {} m, area {} m2; frequency from a least-squares sine through the lift.",
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
        // A lift that rests makes no scale
        let c = c.finish(&[1.0]);
        assert!((c.drag_error.unwrap() - 0.5).abs() < 1e-12 && c.lift_error.is_none());
    }
}
