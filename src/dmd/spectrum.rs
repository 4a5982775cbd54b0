//! The modes of a fit as an engineer reads them: frequency, growth rate, amplitude, share of the energy.

use crate::dmd::Dmd;
use std::f64::consts::TAU;

/// Angle of a stride below which a mode does not oscillate: rounding.
const STILL: f64 = 1e-9;

/// A mode, or a pair of conjugate ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Hz; 0 for a mode that does not oscillate.
    pub frequency: f64,
    /// Of its amplitude, 1/s: below 0 for one that decays.
    pub growth_rate: f64,
    /// At present, over the root mean square of what the fields of the window vary by.
    pub amplitude: f64,
    /// Of the sum of squared amplitudes of all modes, at present.
    pub energy: f64,
}

impl Dmd {
    /// The modes at present, largest share of the energy first. `interval`: time between snapshots, s. Modes are not orthogonal, so that shares
    /// tell the large from the small and no more.
    pub fn spectrum(&self, amplitudes: &[[f64; 2]], interval: f64) -> Vec<Mode> {
        let squares: Vec<f64> = amplitudes.iter().map(|a| a[0] * a[0] + a[1] * a[1]).collect();
        let whole: f64 = squares.iter().sum();
        let pairs = self.eigenvalues().iter().zip(&squares);
        let mut modes: Vec<Mode> = pairs
            // Of a pair the one above the real axis stands for both.
            .filter(|([re, im], _)| im.atan2(*re) >= -STILL)
            .map(|([re, im], square)| {
                let angle = im.atan2(*re);
                let oscillates = angle > STILL && *im != 0.0;
                let both = if oscillates { 2.0 * square } else { *square };
                // A delayed state has `delays` states; a wave of amplitude 1 has a mean square of 1/2.
                let mean_square = both / self.shape.delays as f64;
                Mode {
                    frequency: if oscillates { angle / (TAU * interval) } else { 0.0 },
                    growth_rate: re.hypot(*im).ln() / interval,
                    amplitude: (if oscillates { 2.0 } else { 1.0 } * mean_square).sqrt(),
                    energy: if whole > 0.0 { both / whole } else { 0.0 },
                }
            })
            .collect();
        modes.sort_by(|a, b| b.energy.total_cmp(&a.energy));
        modes
    }
}
