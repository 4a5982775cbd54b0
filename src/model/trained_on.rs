//! What a model was trained on, as far as a case can be compared with it: part of a model's description.

use crate::solid::{Range, Solid, range};
use m4gn_mesh::Mesh;
use m4gn_mesh::vector::{norm, sub};
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};

/// What lies outside a range by more than this share of it is reported.
const MARGIN: f64 = 0.25;

/// Values of an input field in the data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputRange {
    /// Name of the field.
    pub field: String,
    /// Of all its components.
    pub range: Range,
}

/// Ranges over the trajectories that a model was trained on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainedOn {
    /// Mean distance of neighbouring nodes of a mesh, m.
    pub cell_size: Range,
    /// Largest speed of a trajectory, m/s; none without a velocity.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<Range>,
    /// Courant number of the stride: largest speed times the stride over the mean distance.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub courant: Option<Range>,
    /// Of each field that is an input.
    pub inputs: Vec<InputRange>,
    /// Of a solid, what its solvers said of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid: Option<Solid>,
}

/// The same of one case, or of one trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Extent {
    /// As [`TrainedOn::cell_size`].
    pub cell_size: f64,
    /// As [`TrainedOn::speed`].
    pub speed: Option<f64>,
    /// As [`TrainedOn::inputs`]; none before any field was seen.
    pub inputs: Vec<InputRange>,
    /// As [`TrainedOn::solid`].
    pub solid: Option<Solid>,
}

impl Extent {
    fn courant(&self, stride: f64) -> Option<f64> {
        self.speed.map(|speed| speed * stride / self.cell_size)
    }
}

/// Mean distance of neighbouring cells, m; 0 where there are no neighbours. Collective.
pub fn cell_size(mesh: &Mesh, comm: &Comm) -> f64 {
    let mut sums = [0.0, 0.0];
    for (&a, &b) in mesh.face_owner.iter().zip(&mesh.face_neighbour) {
        sums[0] += norm(sub(mesh.cell_centres[b as usize], mesh.cell_centres[a as usize]));
        sums[1] += 1.0;
    }
    // Seen from both sides
    for face in &mesh.coupled {
        sums[0] += 0.5 * norm(face.delta);
        sums[1] += 0.5;
    }
    comm.sum_f64(&mut sums);
    match sums[1] > 0.0 {
        true => sums[0] / sums[1],
        false => 0.0,
    }
}

fn widen(range: &mut Range, value: f64) {
    range[0] = range[0].min(value);
    range[1] = range[1].max(value);
}

impl TrainedOn {
    /// Over the trajectories; none if there are none, or none with neighbouring cells.
    pub fn over(trajectories: &[Extent], stride: f64) -> Option<Self> {
        let nothing = || [f64::INFINITY, f64::NEG_INFINITY];
        let (mut size, mut speed, mut courant) = (nothing(), nothing(), nothing());
        let mut inputs: Vec<InputRange> = trajectories.first()?.inputs.clone();
        for t in trajectories.iter().filter(|t| t.cell_size > 0.0) {
            widen(&mut size, t.cell_size);
            if let (Some(v), Some(c)) = (t.speed, t.courant(stride)) {
                widen(&mut speed, v);
                widen(&mut courant, c);
            }
            for (all, one) in inputs.iter_mut().zip(&t.inputs) {
                widen(&mut all.range, one.range[0]);
                widen(&mut all.range, one.range[1]);
            }
        }
        let mut solid = trajectories[0].solid.clone();
        for t in &trajectories[1..] {
            solid = match (solid, &t.solid) {
                (Some(mut all), Some(one)) => {
                    all.widen(one);
                    Some(all)
                }
                // Nothing can be said of all where one says nothing.
                _ => None,
            };
        }
        let some = |range: Range| (range[0] <= range[1]).then_some(range);
        Some(TrainedOn { cell_size: some(size)?, speed: some(speed), courant: some(courant), inputs, solid })
    }

    /// Quantities and their ranges, for people.
    pub fn described(&self) -> Vec<[String; 2]> {
        let mut lines = vec![["distance of cells, m".to_string(), range(self.cell_size)]];
        let flow = [("largest speed, m/s", self.speed), ("Courant number of the stride", self.courant)];
        for (what, values) in flow {
            lines.extend(values.map(|values| [what.to_string(), range(values)]));
        }
        let inputs = self.inputs.iter();
        lines.extend(inputs.map(|input| [input.field.clone(), range(input.range)]));
        lines.extend(self.solid.iter().flat_map(Solid::described));
        lines
    }

    /// In which respects a case lies outside, one a line for people; empty: in none.
    pub fn outside(&self, case: &Extent, stride: f64) -> Vec<String> {
        let mut found = Vec::new();
        let mut compare = |what: &str, unit: &str, range: Option<Range>, value: Option<f64>| {
            if let (Some([low, high]), Some(value)) = (range, value)
                && (value < low / (1.0 + MARGIN) || value > high * (1.0 + MARGIN))
            {
                found.push(format!(
                    "{what} is {value:.3e}{unit}, and the model was trained on {low:.3e} to {high:.3e}{unit}"
                ));
            }
        };
        compare("the mean distance of neighbouring cells", " m", Some(self.cell_size), Some(case.cell_size));
        compare("the largest speed", " m/s", self.speed, case.speed);
        compare("the Courant number of the stride", "", self.courant, case.courant(stride));
        if let (Some(trained), Some(case)) = (&self.solid, &case.solid) {
            found.extend(trained.outside(case));
        }
        for input in &case.inputs {
            let Some(trained) = self.inputs.iter().find(|i| i.field == input.field) else {
                continue;
            };
            let ([low, high], [lowest, highest]) = (trained.range, input.range);
            let slack = MARGIN * (high - low);
            // Not finite is outside.
            if !(lowest >= low - slack && highest <= high + slack) {
                found.push(format!(
                    "{} is {lowest:.3e} to {highest:.3e}, and the model was trained on {low:.3e} to {high:.3e}",
                    input.field
                ));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    fn extent(cell_size: f64, speed: f64, range: Range) -> Extent {
        Extent {
            cell_size,
            speed: Some(speed),
            inputs: vec![InputRange { field: "U".into(), range }],
            solid: None,
        }
    }

    #[test]
    fn what_is_outside_is_named_and_what_is_inside_is_not() {
        let data = [extent(0.01, 1.0, [-0.5, 1.0]), extent(0.02, 2.0, [-1.0, 2.0])];
        let trained = TrainedOn::over(&data, 0.05).unwrap();
        assert_eq!(trained.cell_size, [0.01, 0.02]);
        assert_eq!(trained.courant, Some([5.0, 5.0]));
        assert_eq!(trained.inputs[0].range, [-1.0, 2.0]);
        let none: [String; 0] = [];
        assert_eq!(trained.outside(&extent(0.015, 1.5, [0.0, 1.5]), 0.05), none);
        // Within the margin
        assert_eq!(trained.outside(&extent(0.0195, 2.1, [-1.5, 2.5]), 0.05), none);
        let far = trained.outside(&extent(0.005, 4.0, [-1.0, 4.0]), 0.05);
        assert_eq!(far.len(), 4, "{far:?}");
        assert!(far[0].contains("5.000e-3 m") && far[0].contains("1.000e-2 to 2.000e-2 m"), "{far:?}");
        assert!(
            far[1].contains("largest speed") && far[2].contains("Courant number") && far[3].contains("U is")
        );
        assert_eq!(trained.outside(&extent(0.015, 1.5, [f64::NAN, 1.0]), 0.05).len(), 1);
        let json = serde_json::to_string(&trained).unwrap();
        assert_eq!(serde_json::from_str::<TrainedOn>(&json).unwrap(), trained);
    }

    #[test]
    fn a_solid_is_compared_where_all_trajectories_know_theirs() {
        let solid = |poisson| Some(Solid { poisson: Some([poisson, poisson]), ..Solid::default() });
        let of = |solid| Extent { solid, ..extent(0.01, 1.0, [0.0, 1.0]) };
        let trained = TrainedOn::over(&[of(solid(0.3)), of(solid(0.4))], 0.05).unwrap();
        assert_eq!(trained.outside(&of(solid(0.35)), 0.05).len(), 0);
        let found = trained.outside(&of(solid(0.1)), 0.05);
        assert_eq!(found, ["Poisson's ratio is 1.000e-1, and the model was trained on 3.000e-1 to 4.000e-1"]);
        assert_eq!(trained.outside(&of(None), 0.05).len(), 0);
        let lines: Vec<String> = trained.described().iter().map(|l| l.join(": ")).collect();
        assert_eq!(
            lines,
            [
                "distance of cells, m: 1.000e-2",
                "largest speed, m/s: 1.000e0",
                "Courant number of the stride: 5.000e0",
                "U: 0.000e0 to 1.000e0",
                "Poisson's ratio: 3.000e-1 to 4.000e-1",
            ]
        );
        let unknown = TrainedOn::over(&[of(solid(0.3)), of(None)], 0.05).unwrap();
        assert_eq!(unknown.outside(&of(solid(0.1)), 0.05).len(), 0);
    }

    #[test]
    fn distances_on_paper() {
        let mesh = sample::rectangle(4, 2, 1.0, 1.0);
        // Six faces at 0.25, four at 0.5
        let mean = cell_size(&mesh, &Comm::serial());
        assert!((mean - (6.0 * 0.25 + 4.0 * 0.5) / 10.0).abs() < 1e-12, "{mean}");
        assert_eq!(TrainedOn::over(&[], 0.1), None);
    }
}
