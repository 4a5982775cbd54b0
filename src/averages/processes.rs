//! Processes with known means, for tests and the table of coverage.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// The processes that intervals are counted on.
pub const ALL: [(&str, Kind); 10] = [
    ("AR(1) 0.5", Kind::Ar(0.5)),
    ("AR(1) 0.9", Kind::Ar(0.9)),
    ("AR(1) 0.95", Kind::Ar(0.95)),
    ("AR(1) 0.99", Kind::Ar(0.99)),
    ("Ornstein-Uhlenbeck", Kind::OrnsteinUhlenbeck),
    ("long memory", Kind::LongMemory),
    ("sine with noise", Kind::Sine),
    ("modulated sine", Kind::Modulated),
    ("Lorenz x", Kind::LorenzX),
    ("Lorenz z", Kind::LorenzZ),
];

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Of this coefficient, with variance 1.
    Ar(f64),
    /// With correlation time 1 and steps between 0.02 and 0.18.
    OrnsteinUhlenbeck,
    /// Three Ornstein-Uhlenbeck processes of correlation times 0.3, 3 and 30 s.
    LongMemory,
    /// Period 1, amplitude 1, 20 rows a period, noise of 0.5.
    Sine,
    /// Period 1 with amplitude and phase that wander over some ten periods.
    Modulated,
    LorenzX,
    LorenzZ,
}

impl Kind {
    /// Mean, rms of the fluctuations, and rows for one independent sample of them.
    pub fn truth(self) -> (f64, f64, f64) {
        match self {
            Kind::Ar(a) => (2.0, 1.0, (1.0 + a) / (1.0 - a)),
            Kind::OrnsteinUhlenbeck => (2.0, 1.0, 20.0),
            Kind::LongMemory => (2.0, 1.0, 20.0 * (0.5 * 0.3 + 0.3 * 3.0 + 0.2 * 30.0)),
            Kind::Sine => (2.0, 0.75_f64.sqrt(), 20.0),
            Kind::Modulated => (2.0, 0.58_f64.sqrt(), 20.0),
            Kind::LorenzX => (0.0, 7.925, 49.5),
            Kind::LorenzZ => (23.5523, 8.620, 37.5),
        }
    }
}

/// A realisation: step and value of one row after the other.
pub struct Process {
    kind: Kind,
    rng: ChaCha8Rng,
    state: [f64; 3],
    time: f64,
    /// Offset of the first row, and time in which it falls to 1/e.
    transient: (f64, f64),
}

impl Process {
    pub fn new(kind: Kind, seed: u64, transient: bool) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let normal = [(); 3].map(|()| gauss(&mut rng));
        let mut state = normal;
        if matches!(kind, Kind::Sine | Kind::Modulated) {
            state[1] = TAU * rng.random::<f64>();
        }
        let (_, rms, rows) = kind.truth();
        let size = if transient { 5.0 * rms } else { 0.0 };
        let decay = match kind {
            Kind::Sine | Kind::Modulated => 2.0,
            Kind::LorenzX | Kind::LorenzZ => 2.0,
            Kind::Ar(_) => 2.0 * rows,
            _ => 2.0 * rows * 0.1,
        };
        let mut process = Process { kind, rng, state, time: 0.0, transient: (size, decay) };
        if matches!(kind, Kind::LorenzX | Kind::LorenzZ) {
            process.state = [normal[0] * 5.0, normal[1] * 5.0, 23.0 + 5.0 * normal[2]];
            (0..2000).for_each(|_| process.lorenz(0.01));
        }
        process
    }

    /// Step and value of the next row.
    pub fn next_row(&mut self) -> (f64, f64) {
        let (dt, value) = self.stationary();
        self.time += dt;
        (dt, value + self.transient.0 * (-self.time / self.transient.1).exp())
    }

    fn stationary(&mut self) -> (f64, f64) {
        match self.kind {
            Kind::Ar(a) => {
                self.state[0] = a * self.state[0] + (1.0 - a * a).sqrt() * gauss(&mut self.rng);
                (1.0, 2.0 + self.state[0])
            }
            Kind::OrnsteinUhlenbeck => {
                let dt = 0.02 + 0.16 * self.rng.random::<f64>();
                self.relax(0, dt, 1.0);
                (dt, 2.0 + self.state[0])
            }
            Kind::LongMemory => {
                for (i, scale) in [0.3, 3.0, 30.0].into_iter().enumerate() {
                    self.relax(i, 0.1, scale);
                }
                let [a, b, c] = self.state;
                (0.1, 2.0 + 0.5_f64.sqrt() * a + 0.3_f64.sqrt() * b + 0.2_f64.sqrt() * c)
            }
            Kind::Sine => {
                let value = (TAU * self.time + self.state[1]).sin() + 0.5 * gauss(&mut self.rng);
                (0.05, 2.0 + value)
            }
            Kind::Modulated => {
                self.relax(0, 0.05, 10.0);
                self.state[1] += TAU * 0.05 + 0.1 * 0.05_f64.sqrt() * gauss(&mut self.rng);
                (0.05, 2.0 + (1.0 + 0.4 * self.state[0]) * self.state[1].sin())
            }
            Kind::LorenzX | Kind::LorenzZ => {
                (0..2).for_each(|_| self.lorenz(0.01));
                (0.02, if self.kind == Kind::LorenzX { self.state[0] } else { self.state[2] })
            }
        }
    }

    fn relax(&mut self, i: usize, dt: f64, scale: f64) {
        let keep = (-dt / scale).exp();
        self.state[i] = keep * self.state[i] + (1.0 - keep * keep).sqrt() * gauss(&mut self.rng);
    }

    fn lorenz(&mut self, dt: f64) {
        let rate =
            |s: [f64; 3]| [10.0 * (s[1] - s[0]), s[0] * (28.0 - s[2]) - s[1], s[0] * s[1] - 8.0 / 3.0 * s[2]];
        let plus = |s: [f64; 3], k: [f64; 3], h: f64| [0, 1, 2].map(|i| s[i] + h * k[i]);
        let s = self.state;
        let k1 = rate(s);
        let k2 = rate(plus(s, k1, 0.5 * dt));
        let k3 = rate(plus(s, k2, 0.5 * dt));
        let k4 = rate(plus(s, k3, dt));
        self.state = [0, 1, 2].map(|i| s[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
    }
}

/// A number of the standard normal distribution (Box and Muller).
fn gauss(rng: &mut ChaCha8Rng) -> f64 {
    let (u, v) = (1.0 - rng.random::<f64>(), rng.random::<f64>());
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}
