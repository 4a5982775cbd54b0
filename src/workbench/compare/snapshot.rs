//! Velocity magnitudes at a few times, kept for pictures.

/// |U| of both runs at a time, and the magnitude of their difference, m/s.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// Time, s.
    pub time: f64,
    /// |U| of the full run.
    pub full: Vec<f64>,
    /// |U| of the hybrid run.
    pub hybrid: Vec<f64>,
    /// |U hybrid - U full|.
    pub difference: Vec<f64>,
}

impl Snapshot {
    /// From the solved components of both velocities, `dim` a cell.
    pub(super) fn new(time: f64, full: &[f64], hybrid: &[f64], dim: usize) -> Self {
        let magnitude = |u: &[f64]| u.chunks_exact(dim).map(norm).collect();
        let difference: Vec<f64> = full.iter().zip(hybrid).map(|(a, b)| b - a).collect();
        Snapshot {
            time,
            full: magnitude(full),
            hybrid: magnitude(hybrid),
            difference: magnitude(&difference),
        }
    }
}

fn norm(u: &[f64]) -> f64 {
    u.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// `count` indices below `n`: the last one, and before it ones at halving distance from the start.
pub(super) fn choose(n: usize, count: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> =
        (0..count).map(|k| (n >> k).max(1)).map(|h| h - 1).filter(|&i| i < n).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magnitudes_on_paper() {
        let s = Snapshot::new(1.0, &[3.0, 4.0, 0.0, 1.0], &[3.0, 4.0, 1.0, 0.0], 2);
        assert_eq!((s.full, s.hybrid), (vec![5.0, 1.0], vec![5.0, 1.0]));
        assert!((s.difference[1] - 2.0_f64.sqrt()).abs() < 1e-15 && s.difference[0] == 0.0);
    }

    #[test]
    fn chosen_times() {
        assert_eq!(choose(100, 3), [24, 49, 99]);
        assert_eq!(choose(1, 3), [0]);
        assert!(choose(0, 3).is_empty() && choose(5, 0).is_empty());
    }
}
