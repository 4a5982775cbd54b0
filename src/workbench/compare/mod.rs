//! How far a hybrid run is from the full run of the same case, and what it cost.
//!
//! Errors are root mean squares over cells and solved components, unweighted, as `m4gn validate` and `mode observe` have
//! them; over a horizon also over its stored times, as the paper's RMSE-1, RMSE-50 (50 stored times) and RMSE-all. Beside
//! the velocity, the other fields that a surrogate may predict are compared where both runs stored them. Errors count from the takeover, the last time that the
//! solver had computed before the surrogate first acted. "Hold last" keeps the full run's field of that time.
//! Of solids, [`displacement`] compares the displacement and the vibration, [`reaction`] the force on a patch.

pub mod displacement;
mod fields;
pub mod forces;
mod html;
mod mapping;
mod pairing;
pub mod reaction;
pub mod records;
pub mod signal;
mod snapshot;

pub use fields::FieldComparison;
pub use html::{picture, report};
pub use snapshot::Snapshot;

use crate::foam_case::FoamCase;
use crate::validate::rmse::{SquaredError, cumulative};
use fields::Track;
use forces::{Coefficients, Reference};
use m4gn_mesh::{Error, Result};
use m4gn_report::{Table, number, percent};
use pairing::{common_times, mapping};
use records::{Surrogate, Times};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// What the user may set.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Patch whose forces are compared; none: of a flow `cylinder` where there is one, of a solid none.
    pub patch: Option<String>,
    /// Of a solid: the patch beside whose centre a cell is followed; none: the cell that moves most.
    pub follow: Option<String>,
    /// Reference speed of the coefficients, m/s; none: mean inlet velocity of A.
    pub speed: Option<f64>,
    /// Reference length, m; none: extent of the patch across the flow.
    pub length: Option<f64>,
    /// Takeover, s; none: what the surrogate of B recorded.
    pub takeover: Option<f64>,
    /// Wall seconds of A; none: from its log, in whole seconds.
    pub wall_a: Option<f64>,
    /// Wall seconds of B; none: from its log, in whole seconds.
    pub wall_b: Option<f64>,
    /// Whether B may have another mesh: its values are interpolated onto the cells of A.
    pub interpolate: bool,
    /// Number of times that pictures are kept of.
    pub snapshots: usize,
}

/// The figures of a comparison; lists have one entry a common time after the takeover.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Folder of the full run.
    pub case_a: String,
    /// Folder of the hybrid run.
    pub case_b: String,
    /// Number of cells.
    pub cells: usize,
    /// Number of cells of B.
    pub cells_b: usize,
    /// Last time that the solver had computed before the surrogate first acted, s; the first common time without one.
    pub takeover: f64,
    /// Common times after the takeover, s.
    pub times: Vec<f64>,
    /// RMSE of the velocity over times 1 to i, m/s.
    pub velocity_rmse: Vec<f64>,
    /// The same for the full run's field at the takeover, held.
    pub hold_last_rmse: Vec<f64>,
    /// RMSE at each time alone, m/s.
    pub velocity_error: Vec<f64>,
    /// The same for the held field.
    pub hold_last_error: Vec<f64>,
    /// Root mean square of the full run's velocity over all times, m/s.
    pub velocity_rms: f64,
    /// The other fields that both runs stored at all times.
    pub fields: BTreeMap<String, FieldComparison>,
    /// Patch of the forces; none: no forces were compared.
    pub patch: Option<String>,
    /// Reference values of the coefficients.
    pub reference: Option<Reference>,
    /// Drag coefficient of A.
    pub drag_a: Vec<f64>,
    /// Drag coefficient of B.
    pub drag_b: Vec<f64>,
    /// Lift coefficient of A.
    pub lift_a: Vec<f64>,
    /// Lift coefficient of B.
    pub lift_b: Vec<f64>,
    /// Mean drag coefficients of A and B.
    pub mean_drag: Option<[f64; 2]>,
    /// Root mean squares of the lift fluctuations of A and B.
    pub lift_rms: Option<[f64; 2]>,
    /// Shedding frequencies of A and B from the lift, 1/s; none where the lift does not oscillate.
    pub frequency: [Option<f64>; 2],
    /// Strouhal numbers of A and B.
    pub strouhal: [Option<f64>; 2],
    /// |mean drag of B / mean drag of A - 1|.
    pub drag_error: Option<f64>,
    /// |lift fluctuation of B / that of A - 1|.
    pub lift_error: Option<f64>,
    /// |Strouhal number of B / that of A - 1|.
    pub strouhal_error: Option<f64>,
    /// What both runs took.
    #[serde(flatten)]
    pub cost: Cost,
    /// Replaced part of B's simulated time after start-up.
    pub replaced_fraction: Option<f64>,
    /// Summary of B's surrogate.
    pub surrogate: Option<serde_json::Value>,
}

/// What two runs took.
#[derive(Clone, Debug, Serialize)]
pub struct Cost {
    /// Wall seconds of A.
    pub wall_a: Option<f64>,
    /// Wall seconds of B.
    pub wall_b: Option<f64>,
    /// Whether both were given; the logs have whole seconds.
    pub wall_measured: bool,
    /// Processor seconds of A: `ExecutionTime` of its log, of the first rank and all its threads, in hundredths.
    pub processor_a: Option<f64>,
    /// The same of B.
    pub processor_b: Option<f64>,
}

impl Cost {
    fn of(a: &FoamCase, b: &FoamCase, options: &Options) -> Self {
        let [a, b] = [a, b].map(|case| {
            let d = case.description();
            records::times(Path::new(&d.path), &d.application)
        });
        let wall = |t: &Option<Times>| t.and_then(|t| t.wall);
        Cost {
            wall_a: options.wall_a.or_else(|| wall(&a)),
            wall_b: options.wall_b.or_else(|| wall(&b)),
            wall_measured: options.wall_a.is_some() && options.wall_b.is_some(),
            processor_a: a.map(|t| t.processor),
            processor_b: b.map(|t| t.processor),
        }
    }

    /// Rows of a table of figures: what it is, A, B, and what B gained.
    fn rows(&self) -> [(&'static str, [Option<f64>; 2], String); 2] {
        let wall = [self.wall_a, self.wall_b];
        let processor = [self.processor_a, self.processor_b];
        let name = match self.wall_measured {
            true => "wall time [s]",
            false => "wall time [s], whole seconds",
        };
        [
            (name, wall, gain(wall)),
            ("processor time [s]", processor, gain(processor)),
        ]
    }
}

/// Horizons of the table, in stored times.
const HORIZONS: [usize; 6] = [1, 2, 5, 10, 20, 50];

/// Beyond this relative error a factor says more.
const MUCH: f64 = 10.0;

/// Lift fluctuations below this part of the mean drag are no oscillation.
const QUIET: f64 = 1e-4;

/// Compares B (hybrid) with A (full). `progress(done, of)` is called once a time.
///
/// # Errors
/// Different meshes, no common times, an unknown patch, a missing or non-finite field.
pub fn compare(
    a: &mut FoamCase,
    b: &mut FoamCase,
    options: &Options,
    mut progress: impl FnMut(usize, usize),
) -> Result<(Comparison, Vec<Snapshot>)> {
    let mapping = mapping(a, b, options.interpolate)?;
    let surrogate = records::surrogate(Path::new(&b.description().path))?;
    let (hold, pairs) = common_times(a, b, options.takeover.or(surrogate.as_ref().map(|s| s.takeover)))?;
    let reference = Reference::find(a, options, hold.0)?;
    let directions = a.description().directions.clone();

    let held = components(&a.vector_field("U", hold.0)?, &directions);
    let mut tracks = Track::all(a, b, hold, &pairs)?;
    let kept = snapshot::choose(pairs.len(), options.snapshots);
    let mut snapshots = Vec::new();
    let (mut model, mut held_errors, mut squares) = (Vec::new(), Vec::new(), SquaredError::default());
    let (mut forces_a, mut forces_b) = (Coefficients::default(), Coefficients::default());
    for (done, &(i, j)) in pairs.iter().enumerate() {
        let (ua, ub) = (a.vector_field("U", i)?, mapping.vector(b.vector_field("U", j)?));
        let (va, vb) = (components(&ua, &directions), components(&ub, &directions));
        model.push(SquaredError::between(&va, &vb));
        held_errors.push(SquaredError::between(&va, &held));
        squares.add(SquaredError::between(&va, &vec![0.0; va.len()]));
        for track in &mut tracks {
            let other = mapping.scalar(b.scalar_field(track.name, j)?);
            track.add(&a.scalar_field(track.name, i)?, &other);
        }
        if let Some(reference) = &reference {
            forces_a.push(reference, a.force(&reference.patch, i)?.total());
            forces_b.push(reference, b.force(&reference.patch, j)?.total());
        }
        if kept.contains(&done) {
            snapshots.push(Snapshot::new(
                a.description().times[i],
                &va,
                &vb,
                directions.len(),
            ));
        }
        progress(done + 1, pairs.len());
    }

    let times: Vec<f64> = pairs.iter().map(|p| a.description().times[p.0]).collect();
    let mut result = Comparison {
        case_a: a.description().path.clone(),
        case_b: b.description().path.clone(),
        cells: a.description().cells,
        cells_b: b.description().cells,
        takeover: a.description().times[hold.0],
        velocity_rmse: cumulative(&model),
        hold_last_rmse: cumulative(&held_errors),
        velocity_error: model.iter().map(SquaredError::rmse).collect(),
        hold_last_error: held_errors.iter().map(SquaredError::rmse).collect(),
        velocity_rms: squares.rmse(),
        fields: tracks.into_iter().map(Track::finish).collect(),
        patch: reference.as_ref().map(|r| r.patch.clone()),
        drag_a: forces_a.drag,
        drag_b: forces_b.drag,
        lift_a: forces_a.lift,
        lift_b: forces_b.lift,
        mean_drag: None,
        lift_rms: None,
        frequency: [None; 2],
        strouhal: [None; 2],
        drag_error: None,
        lift_error: None,
        strouhal_error: None,
        cost: Cost::of(a, b, options),
        replaced_fraction: surrogate.as_ref().and_then(|s| s.replaced_fraction),
        surrogate: surrogate.map(|s: Surrogate| s.summary),
        times,
        reference,
    };
    result.judge_forces();
    Ok((result, snapshots))
}

impl Comparison {
    fn judge_forces(&mut self) {
        let Some(reference) = &self.reference else { return };
        let mean = [signal::mean(&self.drag_a), signal::mean(&self.drag_b)];
        let rms = [
            signal::fluctuation(&self.lift_a),
            signal::fluctuation(&self.lift_b),
        ];
        let relative = |v: [f64; 2]| (v[0] != 0.0).then(|| (v[1] / v[0] - 1.0).abs());
        self.mean_drag = Some(mean);
        self.lift_rms = Some(rms);
        self.drag_error = relative(mean);
        if rms[0] <= QUIET * mean[0].abs() {
            return;
        }
        self.lift_error = relative(rms);
        let frequency = |lift: &[f64]| signal::dominant_oscillation(&self.times, lift).map(|o| o.frequency);
        self.frequency = [frequency(&self.lift_a), frequency(&self.lift_b)];
        self.strouhal = self
            .frequency
            .map(|f| f.map(|f| f * reference.length / reference.speed));
        if let [Some(a), Some(b)] = self.strouhal {
            self.strouhal_error = relative([a, b]);
        }
    }

    /// Velocity errors at the horizons.
    pub fn error_table(&self) -> Table {
        error_table("U, m/s", &self.times, &self.velocity_rmse, &self.hold_last_rmse)
    }

    /// Errors of the other fields at the horizons.
    pub fn field_tables(&self) -> Vec<Table> {
        let table = |(name, f): (&String, &FieldComparison)| {
            error_table(name, &self.times, &f.rmse, &f.hold_last_rmse)
        };
        self.fields.iter().map(table).collect()
    }

    /// Forces, frequency and wall time.
    pub fn figure_table(&self) -> Table {
        let mut table = Table::new(["", "full", "hybrid", "error"]);
        let text = |v: Option<f64>| v.map_or("-".into(), |v| number(v, 4));
        let mut row = |name: &str, pair: [Option<f64>; 2], last: String| {
            table.row([name.to_string(), text(pair[0]), text(pair[1]), last]);
        };
        if self.reference.is_some() {
            row(
                "mean drag coefficient",
                pair(self.mean_drag),
                percent(self.drag_error),
            );
            // A full run whose lift hardly changes makes no scale.
            let lift = match (self.lift_error, self.lift_rms) {
                (Some(e), Some([a, b])) if e > MUCH => format!("{} times the full run's", number(b / a, 3)),
                (error, _) => percent(error),
            };
            row("rms lift coefficient", pair(self.lift_rms), lift);
            row(
                "shedding frequency [1/s]",
                self.frequency,
                percent(self.strouhal_error),
            );
            row("Strouhal number", self.strouhal, percent(self.strouhal_error));
        }
        for (name, pair, gained) in self.cost.rows() {
            row(name, pair, gained);
        }
        table
    }

    /// The comparison as the figures file: errors are relative.
    pub fn json(&self) -> Result<serde_json::Value> {
        serde_json::to_value(self).map_err(|e| Error::Internal(format!("figures of a comparison: {e}")))
    }
}

/// A time without the digits of rounding.
pub(crate) fn seconds(time: f64) -> String {
    format!("{}", (time * 1e9).round() / 1e9)
}

/// Errors of a field, in a unit, up to horizons 1, 2, 5, 10, 20, 50 and all, as far as the run goes; one entry of each list a time.
fn error_table(of: &str, times: &[f64], hybrid: &[f64], hold_last: &[f64]) -> Table {
    let mut table = Table::new([
        "horizon".to_string(),
        "until [s]".to_string(),
        format!("hybrid [{of}]"),
        format!("hold last [{of}]"),
        "ratio".to_string(),
    ]);
    let last = times.len() - 1;
    for i in HORIZONS.iter().map(|h| h - 1).filter(|&h| h < last).chain([last]) {
        let name = match i == last {
            true => format!("RMSE-all ({})", i + 1),
            false => format!("RMSE-{}", i + 1),
        };
        let (hybrid, hold) = (hybrid[i], hold_last[i]);
        let ratio = match hold > 0.0 {
            true => number(hybrid / hold, 3),
            false => "-".into(),
        };
        table.row([name, seconds(times[i]), number(hybrid, 3), number(hold, 3), ratio]);
    }
    table
}

/// How many times as fast the second run was, in words.
fn gain(wall: [Option<f64>; 2]) -> String {
    match wall {
        [Some(a), Some(b)] if b > 0.0 => format!("{} x as fast", number(a / b, 3)),
        _ => "-".into(),
    }
}

fn pair(values: Option<[f64; 2]>) -> [Option<f64>; 2] {
    values.map_or([None; 2], |v| v.map(Some))
}

/// The solved components, cell after cell.
fn components(field: &[[f64; 3]], directions: &[usize]) -> Vec<f64> {
    field
        .iter()
        .flat_map(|u| directions.iter().map(|&d| u[d]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_solved_components_count() {
        assert_eq!(
            components(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], &[0, 2]),
            [1.0, 3.0, 4.0, 6.0]
        );
    }
}
