//! A hybrid run of a solid against the full run: the displacement everywhere, and the motion of one cell.
//!
//! Displacement errors are counted as those of the velocity are ([`super`]). The cell is the one beside the centre of a
//! patch, or the one that moves most; its component is the one that moves most. The force on a patch is in
//! [`super::reaction`].

use super::pairing::{common_times, same_mesh};
use super::reaction::{Reaction, Track, known};
use super::{Cost, components, error_table, pair, records, seconds, signal};
use crate::foam_case::FoamCase;
use crate::validate::rmse::{SquaredError, cumulative};
use m4gn_mesh::{Error, Result};
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::{Chart, Page, Series, Table, number, percent};
use serde::Serialize;
use std::path::Path;

/// Name of a displacement's field.
pub const FIELD: &str = "D";

/// The figures; lists have one entry a common time after the takeover.
#[derive(Clone, Debug, Serialize)]
pub struct Motion {
    /// Folder of the full run.
    pub case_a: String,
    /// Folder of the hybrid run.
    pub case_b: String,
    /// Number of cells.
    pub cells: usize,
    /// Last time that the solver had computed before the surrogate first acted, s; the first common time without one.
    pub takeover: f64,
    /// Common times after the takeover, s.
    pub times: Vec<f64>,
    /// RMSE of the displacement over times 1 to i, m.
    pub displacement_rmse: Vec<f64>,
    /// The same for the full run's field at the takeover, held.
    pub hold_last_rmse: Vec<f64>,
    /// RMSE at each time alone, m.
    pub displacement_error: Vec<f64>,
    /// Root mean square of the full run's displacement over all times, m.
    pub displacement_rms: f64,
    /// Largest displacement of any cell of the full run at any of the times, m: its range.
    pub displacement_range: f64,
    /// Largest over the times of the root mean square over cells of |D of B - D of A|, over the range.
    pub displacement_error_of_range: f64,
    /// Force on the patch that was named; none: none was.
    pub reaction: Option<Reaction>,
    /// Centre of the cell that is followed, m.
    pub point: [f64; 3],
    /// Component that is followed: 0, 1, 2 for x, y, z.
    pub component: usize,
    /// Displacement of the cell in A, m.
    pub point_a: Vec<f64>,
    /// Displacement of the cell in B, m.
    pub point_b: Vec<f64>,
    /// Largest displacement of the cell in A, m.
    pub amplitude: f64,
    /// Root mean square of B - A at the cell, over the amplitude.
    pub point_error_rms: f64,
    /// Largest |B - A| at the cell, over the amplitude.
    pub point_error_max: f64,
    /// Frequencies of A and B from the cell's displacement, 1/s; none where it does not oscillate.
    pub frequency: [Option<f64>; 2],
    /// |frequency of B / that of A - 1|.
    pub frequency_error: Option<f64>,
    /// Periods of A since the takeover.
    pub periods: Option<f64>,
    /// What both runs took.
    #[serde(flatten)]
    pub cost: Cost,
    /// Replaced part of B's simulated time after start-up.
    pub replaced_fraction: Option<f64>,
    /// Summary of B's surrogate.
    pub surrogate: Option<serde_json::Value>,
}

/// Whether a case is a solid's: it has a displacement and no pressure at its last time. (The velocity `U` does not tell:
/// solids4foam writes that of the solid.)
///
/// # Errors
/// [`Error::File`] when the case cannot be read.
pub fn is_solid(case: &mut FoamCase) -> Result<bool> {
    let Some(last) = case.description().times.len().checked_sub(1) else {
        return Ok(false);
    };
    Ok(case.has_field(FIELD, last)? && !case.has_field("p", last)?)
}

/// Compares B (hybrid) with A (full). `progress(done, of)` is called once a time. Of the options, those of coefficients
/// and pictures have no meaning here.
///
/// # Errors
/// Different meshes, no common times, an unknown patch, a missing or non-finite field, a full run that does not move.
pub fn compare(
    a: &mut FoamCase,
    b: &mut FoamCase,
    options: &super::Options,
    mut progress: impl FnMut(usize, usize),
) -> Result<Motion> {
    same_mesh(a, b)?;
    let surrogate = records::surrogate(Path::new(&b.description().path))?;
    let (hold, pairs) = common_times(a, b, options.takeover.or(surrogate.as_ref().map(|s| s.takeover)))?;
    let description = a.description().clone();
    let directions = &description.directions;
    let centres = a.cell_centres()?;

    let mut forces = match &options.patch {
        Some(patch) => {
            let jumps = surrogate.as_ref().map_or(Vec::new(), |s| s.jumps.clone());
            Some(Track::new(a, b, patch, jumps)?)
        }
        None => None,
    };
    let held = components(&a.vector_field(FIELD, hold.0)?, directions);
    let (mut hybrid, mut holding, mut all) = (Vec::new(), Vec::new(), SquaredError::default());
    let (mut full_fields, mut hybrid_fields) = (Vec::new(), Vec::new());
    for (done, &(i, j)) in pairs.iter().enumerate() {
        let (da, db) = (a.vector_field(FIELD, i)?, b.vector_field(FIELD, j)?);
        let (va, vb) = (components(&da, directions), components(&db, directions));
        hybrid.push(SquaredError::between(&va, &vb));
        holding.push(SquaredError::between(&va, &held));
        all.add(SquaredError::between(&va, &vec![0.0; va.len()]));
        if let Some(forces) = &mut forces {
            forces.add(a, b, (i, j))?;
        }
        full_fields.push(da);
        hybrid_fields.push(db);
        progress(done + 1, pairs.len());
    }

    let cell = match &options.follow {
        Some(name) => beside_patch(&description, &centres, name)?,
        None => most_moved(&full_fields),
    };
    let component = directions
        .iter()
        .copied()
        .max_by(|&p, &q| extent(&full_fields, cell, p).total_cmp(&extent(&full_fields, cell, q)))
        .unwrap_or(0);
    let history = |fields: &[Vec<[f64; 3]>]| fields.iter().map(|f| f[cell][component]).collect::<Vec<_>>();
    let (point_a, point_b) = (history(&full_fields), history(&hybrid_fields));
    let amplitude = extent(&full_fields, cell, component);
    if amplitude <= 0.0 {
        return Err(Error::Input(format!(
            "{} does not move at {:?} m after {} s: there is no amplitude to compare with",
            description.path, centres[cell], description.times[hold.0]
        )));
    }
    let times: Vec<f64> = pairs.iter().map(|p| description.times[p.0]).collect();
    let errors: Vec<f64> = point_a.iter().zip(&point_b).map(|(p, q)| q - p).collect();
    let square = errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64;
    let frequency = [&point_a, &point_b]
        .map(|history| signal::dominant_oscillation(&times, history).map(|o| o.frequency));
    let takeover = description.times[hold.0];
    let error: Vec<f64> = hybrid.iter().map(SquaredError::rmse).collect();
    let range = largest(&full_fields);
    Ok(Motion {
        case_a: description.path.clone(),
        case_b: b.description().path.clone(),
        cells: description.cells,
        takeover,
        displacement_rmse: cumulative(&hybrid),
        hold_last_rmse: cumulative(&holding),
        displacement_rms: all.rmse(),
        displacement_range: range,
        // A cell's error has as many components as there are solved directions
        displacement_error_of_range: (directions.len() as f64).sqrt()
            * error.iter().copied().fold(0.0, f64::max)
            / range,
        displacement_error: error,
        reaction: forces.map(Track::finish),
        point: centres[cell],
        component,
        amplitude,
        point_error_rms: square.sqrt() / amplitude,
        point_error_max: errors.iter().fold(0.0f64, |m, e| m.max(e.abs())) / amplitude,
        frequency_error: match frequency {
            [Some(p), Some(q)] => Some((q / p - 1.0).abs()),
            _ => None,
        },
        periods: frequency[0]
            .zip(times.last())
            .map(|(f, last)| f * (last - takeover)),
        frequency,
        point_a,
        point_b,
        cost: Cost::of(a, b, options),
        replaced_fraction: surrogate.as_ref().and_then(|s| s.replaced_fraction),
        surrogate: surrogate.map(|s| s.summary),
        times,
    })
}

/// Largest |displacement| of a cell in a component, m.
fn extent(fields: &[Vec<[f64; 3]>], cell: usize, component: usize) -> f64 {
    fields.iter().fold(0.0, |m, f| m.max(f[cell][component].abs()))
}

/// Largest displacement of any cell at any time, m.
fn largest(fields: &[Vec<[f64; 3]>]) -> f64 {
    let squares = fields
        .iter()
        .flatten()
        .map(|d| d.iter().map(|v| v * v).sum::<f64>());
    squares.fold(0.0, f64::max).sqrt()
}

/// The cell with the largest displacement of all times; of equal ones the first.
fn most_moved(fields: &[Vec<[f64; 3]>]) -> usize {
    let (mut cell, mut most) = (0, -1.0);
    for field in fields {
        for (i, d) in field.iter().enumerate() {
            let square = d.iter().map(|v| v * v).sum::<f64>();
            if square > most {
                (cell, most) = (i, square);
            }
        }
    }
    cell
}

/// The cell nearest to the middle of the patch's box; of equal ones the first.
fn beside_patch(
    description: &crate::foam_case::Description,
    centres: &[[f64; 3]],
    name: &str,
) -> Result<usize> {
    let patch = known(description, name)?;
    let distance = |c: &[f64; 3]| {
        (0..3)
            .map(|d| (c[d] - 0.5 * (patch.lower[d] + patch.upper[d])).powi(2))
            .sum::<f64>()
    };
    // Cells that are symmetric to the middle differ by rounding only
    let size: f64 = (0..3).map(|d| (patch.upper[d] - patch.lower[d]).powi(2)).sum();
    let (mut cell, mut least) = (0, f64::INFINITY);
    for (i, centre) in centres.iter().enumerate() {
        let square = distance(centre);
        if square < least - 1e-9 * size {
            (cell, least) = (i, square);
        }
    }
    Ok(cell)
}

impl Motion {
    /// Displacement errors at the horizons.
    pub fn error_table(&self) -> Table {
        error_table("D, m", &self.times, &self.displacement_rmse, &self.hold_last_rmse)
    }

    /// Motion of the cell, frequency and wall time.
    pub fn figure_table(&self) -> Table {
        let mut table = Table::new(["", "full", "hybrid", "error"]);
        let text = |v: Option<f64>| v.map_or("-".into(), |v| number(v, 4));
        let mut row = |name: &str, both: [Option<f64>; 2], last: String| {
            table.row([name.to_string(), text(both[0]), text(both[1]), last]);
        };
        let most = |h: &[f64]| h.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let largest = [most(&self.point_a), most(&self.point_b)];
        row(
            "range of D [m] (error: largest rms over the cells)",
            [Some(self.displacement_range), None],
            percent(Some(self.displacement_error_of_range)),
        );
        row(
            "largest displacement of the cell [m]",
            pair(Some(largest)),
            percent(Some((largest[1] / largest[0] - 1.0).abs())),
        );
        row(
            "rms error of the cell / amplitude",
            [None; 2],
            percent(Some(self.point_error_rms)),
        );
        row(
            "largest error of the cell / amplitude",
            [None; 2],
            percent(Some(self.point_error_max)),
        );
        row("frequency [1/s]", self.frequency, percent(self.frequency_error));
        for (name, both, error) in self.reaction.iter().flat_map(Reaction::rows) {
            row(&name, both, error);
        }
        for (name, pair, gained) in self.cost.rows() {
            row(name, pair, gained);
        }
        table
    }

    /// The cell and its component in words.
    pub fn point_text(&self) -> String {
        let [x, y, z] = self.point.map(seconds);
        format!(
            "{FIELD}{} of the cell at ({x} {y} {z}) m",
            ["x", "y", "z"].get(self.component).unwrap_or(&"")
        )
    }

    /// The figures file: errors are relative.
    pub fn json(&self) -> Result<serde_json::Value> {
        serde_json::to_value(self).map_err(|e| Error::Internal(format!("figures of a comparison: {e}")))
    }

    /// The report.
    pub fn report(&self) -> Result<Page> {
        let mut page = Page::new("Hybrid run against the full run");
        if let Some(fraction) = self.replaced_fraction {
            page.paragraph(&format!(
                "The surrogate replaced {} of the simulated time after start-up.",
                percent(Some(fraction))
            ));
        }
        page.heading("Motion and wall time");
        page.paragraph(&format!(
            "Followed is {}, from the takeover at {} s on; the amplitude is its largest displacement in the full run, {} m. \
             Frequency from a least-squares sine.",
            self.point_text(),
            seconds(self.takeover),
            number(self.amplitude, 4)
        ));
        page.table(&self.figure_table());
        let chart = |y: &str, series, axis| Chart {
            x_label: "t [s]".into(),
            y_label: y.into(),
            series,
            axis,
        };
        let motion = vec![
            Series::new("full", &self.times, &self.point_a, BLUE),
            Series::new("hybrid", &self.times, &self.point_b, ORANGE),
        ];
        page.svg(
            &chart("displacement [m]", motion, Axis::Range).svg()?,
            "Displacement of the cell.",
        );
        page.heading("Displacement error");
        page.paragraph(&format!(
            "Root mean square over {} cells and the solved components. Hold last: the full run's field at the takeover, \
             kept. The full run's own root-mean-square displacement is {} m, its range, the largest displacement of any cell at \
             any time, {} m: of that, the root mean square over the cells of the difference's magnitude is {} at most.",
            self.cells,
            number(self.displacement_rms, 3),
            number(self.displacement_range, 4),
            percent(Some(self.displacement_error_of_range))
        ));
        page.table(&self.error_table());
        let errors = vec![
            Series::new("hold last", &self.times, &self.hold_last_rmse, GREY),
            Series::new("hybrid", &self.times, &self.displacement_rmse, ORANGE),
        ];
        page.svg(
            &chart("RMSE of D up to t [m]", errors, Axis::FromZero).svg()?,
            "Error over all stored times up to t.",
        );
        if let Some(reaction) = &self.reaction {
            reaction.report(&mut page)?;
        }
        page.heading("Where this comes from");
        page.paragraph(&format!("Full: {}. Hybrid: {}.", self.case_a, self.case_b));
        if let Some(summary) = &self.surrogate {
            page.listing(&serde_json::to_string_pretty(summary).unwrap_or_default());
        }
        Ok(page)
    }
}
