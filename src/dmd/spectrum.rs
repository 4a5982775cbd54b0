//! The modes of a fit as an engineer reads them: frequency, growth rate, amplitude, share of the energy.

use crate::choose::spread;
use crate::dmd::Dmd;
use crate::online::OnlineDmd;
use crate::snapshots::Combination;
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
    /// Its number among the eigenvalues; of a pair, that of the first.
    pub number: usize,
}

impl Dmd {
    /// Whether mode `k` is one of a pair that oscillates.
    pub(crate) fn oscillates(&self, k: usize) -> bool {
        let [re, im] = self.eigenvalues()[k];
        im != 0.0 && im.atan2(re).abs() > STILL
    }

    /// The modes at present, largest share of the energy first. `interval`: time between snapshots, s; `fields`: how many the
    /// products are sums of, each over what it varies by. Modes are not orthogonal, so that shares tell the large from the small and no more.
    pub fn spectrum(&self, amplitudes: &[[f64; 2]], interval: f64, fields: usize) -> Vec<Mode> {
        let squares: Vec<f64> = amplitudes.iter().map(|a| a[0] * a[0] + a[1] * a[1]).collect();
        let whole: f64 = squares.iter().sum();
        let pairs = self.eigenvalues().iter().zip(&squares).enumerate();
        let mut modes: Vec<Mode> = pairs
            // Of a pair the one above the real axis stands for both.
            .filter(|(_, ([re, im], _))| im.atan2(*re) >= -STILL)
            .map(|(number, ([re, im], square))| {
                let angle = im.atan2(*re);
                let oscillates = self.oscillates(number);
                let both = if oscillates { 2.0 * square } else { *square };
                // A delayed state has `delays` states; a wave of amplitude 1 has a mean square of 1/2.
                let mean_square = both / (self.shape.delays * fields) as f64;
                Mode {
                    frequency: if oscillates { angle / (TAU * interval) } else { 0.0 },
                    growth_rate: re.hypot(*im).ln() / interval,
                    amplitude: (if oscillates { 2.0 } else { 1.0 } * mean_square).sqrt(),
                    energy: if whole > 0.0 { both / whole } else { 0.0 },
                    number,
                }
            })
            .collect();
        modes.sort_by(|a, b| b.energy.total_cmp(&a.energy));
        modes
    }
}

impl OnlineDmd {
    /// What of the state `strides` after the present sample does not oscillate, and the same with what a mode that does ([`Mode::number`]) adds to it
    /// then, and a quarter of its period before that. None: there is no such mode now.
    pub fn mode(&self, number: usize, strides: f64) -> Option<[Combination; 3]> {
        let outlook = self.outlook()?;
        let (dmd, amplitudes) = outlook.waves()?;
        let modes = dmd.eigenvalues().len();
        let shape = |k: usize| dmd.shape_of(amplitudes, k, strides);
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x + y).collect::<Vec<f64>>();
        let mean = vec![1.0 / dmd.snapshots() as f64; dmd.snapshots()];
        let still = (0..modes).filter(|k| !dmd.oscillates(*k)).fold(mean, |all, k| sum(&all, &shape(k)[0]));
        let [real, imaginary] = (number < modes && dmd.oscillates(number)).then(|| shape(number))?;
        let (real, imaginary) = (sum(&still, &real), sum(&still, &imaginary));
        Some([still, real, imaginary].map(|weights| spread(self.snapshots(), outlook.slots(), &weights)))
    }
}
