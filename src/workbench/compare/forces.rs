//! Drag and lift coefficients of a patch.

use super::Options;
use crate::foam_case::FoamCase;
use m4gn_mesh::{Error, Result};
use serde::Serialize;

/// What coefficients are made with: `c = F / (rho 1/2 speed^2 area)`.
#[derive(Clone, Debug, Serialize)]
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
    pub fn find(case: &mut FoamCase, options: &Options, time: usize) -> Result<Option<Self>> {
        let description = case.description().clone();
        let names = || {
            description
                .patches
                .iter()
                .map(|p| p.name.as_str())
                .collect::<Vec<_>>()
                .join(", ")
        };
        let wanted = options.patch.as_deref().unwrap_or(DEFAULT_PATCH);
        let patch = match (super::reaction::known(&description, wanted), &options.patch) {
            (Ok(patch), _) => patch,
            (Err(_), None) => return Ok(None),
            (Err(e), Some(_)) => return Err(e),
        };
        let inlets = inlet(case, time)?;
        let mean = |d: usize| inlets.iter().map(|f| f.velocity[d] * f.area).sum::<f64>();
        let area: f64 = inlets.iter().map(|f| f.area).sum();
        let velocity: [f64; 3] = std::array::from_fn(|d| mean(d) / area.max(f64::MIN_POSITIVE));
        let speed = velocity.iter().map(|v| v * v).sum::<f64>().sqrt();
        if speed.is_nan() || speed <= 0.0 {
            return Err(Error::Input(format!(
                "no fluid enters {} through any of its patches ({}) at {} s, so drag has no direction. Without forces: \
                 name no patch, and call none {DEFAULT_PATCH}",
                description.path,
                names(),
                description.times[time]
            )));
        }
        let drag_direction = velocity.map(|v| v / speed);
        let lift_direction = across(drag_direction, &description.directions);
        let extent = |n: [f64; 3]| {
            (0..3)
                .map(|d| n[d].abs() * (patch.upper[d] - patch.lower[d]))
                .sum::<f64>()
        };
        let span = [
            drag_direction[1] * lift_direction[2] - drag_direction[2] * lift_direction[1],
            drag_direction[2] * lift_direction[0] - drag_direction[0] * lift_direction[2],
            drag_direction[0] * lift_direction[1] - drag_direction[1] * lift_direction[0],
        ];
        let length = options.length.unwrap_or_else(|| extent(lift_direction));
        let area = length * extent(span);
        if area.is_nan() || area <= 0.0 {
            return Err(Error::Input(format!(
                "patch {wanted} of {} has no extent across the flow ({length} m); give --length",
                description.path
            )));
        }
        let speed = options.speed.unwrap_or(speed);
        Ok(Some(Reference {
            patch: wanted.into(),
            speed,
            length,
            area,
            drag_direction,
            lift_direction,
        }))
    }
}

/// Patches that fluid enters through.
fn inlet(case: &mut FoamCase, time: usize) -> Result<Vec<crate::foam_case::Flow>> {
    let patches: Vec<String> = case
        .description()
        .patches
        .iter()
        .filter(|p| p.kind == "patch")
        .map(|p| p.name.clone())
        .collect();
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

/// Coefficients over time.
#[derive(Clone, Debug, Default)]
pub struct Coefficients {
    /// Drag.
    pub drag: Vec<f64>,
    /// Lift.
    pub lift: Vec<f64>,
}

impl Coefficients {
    /// Appends those of a force over the density, m^4/s^2.
    pub fn push(&mut self, reference: &Reference, force: [f64; 3]) {
        let scale = 0.5 * reference.speed * reference.speed * reference.area;
        let along = |n: [f64; 3]| (0..3).map(|d| force[d] * n[d]).sum::<f64>() / scale;
        self.drag.push(along(reference.drag_direction));
        self.lift.push(along(reference.lift_direction));
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
        let mut c = Coefficients::default();
        c.push(&reference, [0.4, -0.1, 9.0]);
        assert!((c.drag[0] - 2.0).abs() < 1e-12 && (c.lift[0] + 0.5).abs() < 1e-12);
    }
}
