//! What the network of a body was off by over the stride before a solver handed over, and is off by in the strides that follow.

use m4gn_mesh::vector::Vector;
use m4gn_parallel::Comm;

/// How far off the network may be over the stride before, as a share of the change that it says, to be corrected by half of that. An error as
/// large as the change is one of an event, of a body that is touched for the first time, and says nothing of the next stride.
const LIMIT: f64 = 0.5;

/// Below this share of the error the network is left alone.
const LEAST: f64 = 1e-3;

/// The correction of the network's change of the displacement.
///
/// In contact that goes on evenly, the network is off by nearly the same in each stride. So the change of the first stride after a
/// hand-over is corrected by what the network was off by over the solver's last stride, and those that follow by less and less of it.
#[derive(Debug)]
pub struct Correction {
    /// What part of the correction of a stride goes into the next one, 0 to 1 ([`m4gn_model::Calibration::carried`]).
    decay: f64,
    /// What the network was off by at the host's own points, m.
    error: Vec<Vector>,
    /// The part of it that goes into the next stride; 0: none.
    weight: f64,
}

impl Correction {
    /// Without a hand-over yet.
    pub fn new(decay: f64) -> Self {
        Correction { decay, error: Vec::new(), weight: 0.0 }
    }

    /// Leaves the network alone until the next hand-over: the state is another one, or the network is.
    pub fn forget(&mut self) {
        self.weight = 0.0;
    }

    /// Takes the change over the stride before a hand-over, m, as it was and as the network says. Collective.
    pub fn measure(&mut self, comm: &Comm, (was, said): (&[Vector], &[Vector])) {
        let pairs = was.iter().zip(said);
        self.error = pairs.map(|(a, b)| std::array::from_fn(|i| a[i] - b[i])).collect();
        let square = |rows: &[Vector]| rows.as_flattened().iter().map(|v| v * v).sum::<f64>();
        let mut squares = [square(&self.error), square(said)];
        comm.sum_f64(&mut squares);
        let limit = LIMIT.powi(4) * squares[1].powi(2);
        self.weight = match squares[0] {
            0.0 => 0.0,
            error => limit / (limit + error.powi(2)),
        };
    }

    /// What the next change is to be corrected by, while the obstacle moves from `before` to `now` and `after` in the stride before and
    /// this one: all of what was measured where it goes on as it did, less where it does not, and from stride to stride. None where
    /// that is nothing.
    pub fn next(&mut self, [before, now, after]: [&[Vector]; 3]) -> Option<(f64, &[Vector])> {
        let weight = self.weight * evenness(before, now, after);
        self.weight = self.decay * weight;
        (weight > LEAST).then_some((weight, &self.error[..]))
    }
}

/// How evenly the obstacle goes on: 1 with the motion of the stride before, 0 where it begins, stops or turns back. 1 without obstacle.
fn evenness(before: &[Vector], now: &[Vector], after: &[Vector]) -> f64 {
    let size = |of: &dyn Fn(usize, usize) -> f64| {
        let values = (0..now.len()).flat_map(|q| (0..3).map(move |k| of(q, k).powi(2)));
        values.sum::<f64>().sqrt()
    };
    let behind = size(&|q, k| now[q][k] - before[q][k]);
    let ahead = size(&|q, k| after[q][k] - now[q][k]);
    let turn = size(&|q, k| after[q][k] - 2.0 * now[q][k] + before[q][k]);
    match behind.max(ahead) {
        0.0 => 1.0,
        largest => (1.0 - turn / largest).max(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const EVENLY: [f64; 3] = [0.0, -1.0, -2.0];

    fn next(correction: &mut Correction, at: [f64; 3]) -> f64 {
        let [before, now, after] = at.map(|z| [[0.0, 0.0, z]]);
        correction.next([&before, &now, &after]).map_or(0.0, |(w, e)| w * e[0][0])
    }

    #[test]
    fn a_small_error_goes_on_and_dies_away() {
        let mut c = Correction::new(0.5);
        assert_eq!(next(&mut c, EVENLY), 0.0);
        c.measure(&Comm::serial(), (&[[1.1, 0.0, 0.0]], &[[1.0, 0.0, 0.0]]));
        // 0.5^4 / (0.5^4 + 0.1^4)
        let first = 0.1 * 0.0625 / 0.0626;
        for part in [1.0, 0.5, 0.25] {
            assert!((next(&mut c, EVENLY) - part * first).abs() < 1e-12);
        }
        c.forget();
        assert_eq!(next(&mut c, EVENLY), 0.0);
    }

    #[test]
    fn an_error_as_large_as_the_change_does_not_go_on() {
        let mut c = Correction::new(0.9);
        c.measure(&Comm::serial(), (&[[0.0; 3]], &[[1.0, 0.0, 0.0]]));
        assert!((next(&mut c, EVENLY) + 1.0 / 17.0).abs() < 1e-12);
        // Of a network that says nothing there is nothing that it could be measured by.
        c.measure(&Comm::serial(), (&[[1.0, 0.0, 0.0]], &[[0.0; 3]]));
        assert_eq!(next(&mut c, EVENLY), 0.0);
        c.measure(&Comm::serial(), (&[[0.0; 3]], &[[0.0; 3]]));
        assert_eq!(next(&mut c, EVENLY), 0.0);
    }

    #[test]
    fn an_obstacle_that_goes_on_otherwise_ends_it() {
        let measured = || {
            let mut c = Correction::new(1.0);
            c.measure(&Comm::serial(), (&[[1.0, 0.0, 0.0]], &[[0.999_999, 0.0, 0.0]]));
            c
        };
        for (at, part) in [
            (EVENLY, 1.0),
            ([0.0, -1.0, -1.5], 0.5),
            ([0.0, -1.0, 0.0], 0.0),
            ([0.0, 0.0, -1.0], 0.0),
            ([0.0, 0.0, 0.0], 1.0),
        ] {
            let mut c = measured();
            assert!((next(&mut c, at) - part * 1e-6).abs() < 1e-12, "{at:?}");
            // What a stride lost does not come back.
            assert!((next(&mut c, EVENLY) - part * 1e-6).abs() < 1e-12, "{at:?}");
        }
    }
}
