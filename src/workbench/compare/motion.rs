//! The displacement of a solid: its range, and the motion of one cell, which is the one beside the centre of a patch, or the
//! one that moves most; its component is the one that moves most. The force on a patch is in [`super::reaction`].

use super::report::both_runs;
use super::series::{Row, relative};
use super::{Options, known};
use crate::errors::FieldErrors;
use crate::foam_case::{Description, FoamCase};
use m4gn_averages::spectrum;
use m4gn_base::{Error, Result};
use m4gn_mesh::vector::{dot, norm};
use m4gn_report::{Page, number, percent, seconds};
use serde::Serialize;

/// The figures; lists have one entry a common time after the takeover.
#[derive(Clone, Debug, Serialize)]
pub struct Motion {
    /// Largest displacement of any cell of the full run at any of the times, m: its range.
    pub displacement_range: f64,
    /// Largest over the times of the root mean square over cells of |D of B - D of A|, over the range.
    pub displacement_error_of_range: f64,
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
}

/// Displacements of both runs, time by time.
pub(super) type Fields = [Vec<Vec<[f64; 3]>>; 2];

impl Motion {
    /// From the displacements at `times`, and their errors.
    ///
    /// # Errors
    /// [`Error::Input`] for an unknown patch, or a full run that does not move.
    pub(super) fn new(
        a: &mut FoamCase,
        options: &Options,
        [full, hybrid]: &Fields,
        (takeover, times): (f64, &[f64]),
        errors: &FieldErrors,
    ) -> Result<Self> {
        let (description, centres) = (a.description().clone(), a.cell_centres()?);
        let directions = &description.directions;
        let cell = match &options.follow {
            Some(name) => beside_patch(&description, &centres, name)?,
            None => most_moved(full),
        };
        let extent = |d: usize| full.iter().fold(0.0f64, |m, f| m.max(f[cell][d].abs()));
        let component = directions.iter().copied();
        let component = component.max_by(|&p, &q| extent(p).total_cmp(&extent(q))).unwrap_or(0);
        let amplitude = extent(component);
        if amplitude <= 0.0 {
            return Err(Error::Input(format!(
                "{} does not move at {} m after {takeover} s: there is no amplitude to compare with",
                description.path,
                place(centres[cell])
            )));
        }
        let [point_a, point_b] =
            [full, hybrid].map(|all| all.iter().map(|f| f[cell][component]).collect::<Vec<_>>());
        let off: Vec<f64> = point_a.iter().zip(&point_b).map(|(p, q)| q - p).collect();
        let square = off.iter().map(|e| e * e).sum::<f64>() / off.len() as f64;
        let frequency = [&point_a, &point_b].map(|v| spectrum::frequency(times, v));
        let range = full.iter().flatten().map(|d| norm(*d)).fold(0.0, f64::max);
        let largest = errors.error.iter().copied().fold(0.0, f64::max);
        Ok(Motion {
            displacement_range: range,
            // A cell's error has as many components as there are solved directions
            displacement_error_of_range: (directions.len() as f64).sqrt() * largest / range,
            point: centres[cell],
            component,
            amplitude,
            point_error_rms: square.sqrt() / amplitude,
            point_error_max: off.iter().fold(0.0f64, |m, e| m.max(e.abs())) / amplitude,
            frequency_error: relative(frequency),
            periods: frequency[0].zip(times.last()).map(|(f, last)| f * (last - takeover)),
            frequency,
            point_a,
            point_b,
        })
    }

    pub(super) fn rows(&self) -> Vec<Row> {
        let most = |h: &[f64]| h.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let largest = [most(&self.point_a), most(&self.point_b)];
        let row = |name: &str, both, error| (name.to_string(), both, percent(error));
        vec![
            row(
                "range of D [m] (error: largest rms over the cells)",
                [Some(self.displacement_range), None],
                Some(self.displacement_error_of_range),
            ),
            row(
                "largest displacement of the cell [m]",
                largest.map(Some),
                Some((largest[1] / largest[0] - 1.0).abs()),
            ),
            row("rms error of the cell / amplitude", [None; 2], Some(self.point_error_rms)),
            row("largest error of the cell / amplitude", [None; 2], Some(self.point_error_max)),
            row("frequency [1/s]", self.frequency, self.frequency_error),
        ]
    }

    /// The cell and its component in words.
    pub(super) fn point_text(&self) -> String {
        let component = ["x", "y", "z"].get(self.component).unwrap_or(&"");
        format!("D{component} of the cell at {} m", place(self.point))
    }

    pub(super) fn report(&self, times: &[f64], page: &mut Page) -> Result<()> {
        page.paragraph(&format!(
            "Followed is {}; the amplitude is its largest displacement in the full run, {} m. Frequency from a least-squares \
             sine. The range is the largest displacement of any cell at any time, {} m: of that, the root mean square over the \
             cells of the difference's magnitude is {} at most.",
            self.point_text(),
            number(self.amplitude, 4),
            number(self.displacement_range, 4),
            percent(Some(self.displacement_error_of_range))
        ));
        let both = [&self.point_a[..], &self.point_b];
        both_runs(page, "displacement [m]", times, both, "Displacement of the cell.")
    }
}

/// A point as OpenFOAM writes it.
pub(super) fn place(point: [f64; 3]) -> String {
    format!("({})", point.map(seconds).join(" "))
}

/// The cell with the largest displacement of all times; of equal ones the first.
fn most_moved(fields: &[Vec<[f64; 3]>]) -> usize {
    let (mut cell, mut most) = (0, -1.0);
    for (i, d) in fields.iter().flat_map(|field| field.iter().enumerate()) {
        if dot(*d, *d) > most {
            (cell, most) = (i, dot(*d, *d));
        }
    }
    cell
}

/// The cell nearest to the middle of the patch's box; of equal ones the first.
fn beside_patch(description: &Description, centres: &[[f64; 3]], name: &str) -> Result<usize> {
    let patch = known(description, name)?;
    let sum = |of: &dyn Fn(usize) -> f64| (0..3).map(|d| of(d).powi(2)).sum::<f64>();
    // Cells that are symmetric to the middle differ by rounding only
    let size = sum(&|d| patch.upper[d] - patch.lower[d]);
    let (mut cell, mut least) = (0, f64::INFINITY);
    for (i, centre) in centres.iter().enumerate() {
        let square = sum(&|d| centre[d] - 0.5 * (patch.upper[d] + patch.lower[d]));
        if square < least - 1e-9 * size {
            (cell, least) = (i, square);
        }
    }
    Ok(cell)
}
