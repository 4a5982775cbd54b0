//! What predicting "nothing moves any more" scores on a trajectory: the rows every table of models is read against.

use super::gap::{Gap, Samples};
use super::moved;
use super::quality::{Comparison, Quality};
use super::{Vector, norm, sub};
use crate::Result;
use crate::dataset::{PointType, SolidTrajectory};

/// Scores of a prediction over some frames: means of the frames' figures, but `worst_gap`.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Score {
    /// Root mean square over points that are free, components and frames, m.
    pub rmse: f64,
    /// Mesh metrics, mean over the frames.
    #[serde(flatten)]
    pub quality: Quality,
}

/// Scores of the two predictions that need no model.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Holding {
    /// Each frame is predicted to be the one before it.
    pub persistence: Score,
    /// Every frame is predicted to be the first.
    pub hold_first: Score,
    /// Smallest gap of the data itself in all frames.
    pub worst_gap: Option<Gap>,
    /// Cell size that gaps are given in: mean rest length of the edges, m.
    pub cell_size: f64,
}

/// Mean rest length of the edges, m: the unit of gaps.
pub fn cell_size(positions: &[Vector], edges: &[[i32; 2]]) -> f64 {
    let length = |e: &[i32; 2]| norm(sub(positions[e[0] as usize], positions[e[1] as usize]));
    edges.iter().map(length).sum::<f64>() / edges.len().max(1) as f64
}

/// Scores a trajectory's own frames, every `stride`-th of them.
///
/// # Errors
/// When a frame cannot be read, or the obstacle is no closed surface.
pub fn score(trajectory: &SolidTrajectory, stride: usize) -> Result<Holding> {
    let body = trajectory.body();
    let fixed = |p: i32| body.types[p as usize] != PointType::Body;
    let free: Vec<usize> = (0..body.positions.len()).filter(|&p| !fixed(p as i32)).collect();
    let samples = Samples::new(&body.elements, fixed);
    let comparison = Comparison::new(&body.elements);
    let size = cell_size(&body.positions, &body.edges);
    let mut scores = [Tally::default(), Tally::default()];
    let mut worst: Option<Gap> = None;
    let mut frames: Vec<Vec<Vector>> = Vec::new();
    for k in (0..trajectory.times().len()).step_by(stride.max(1)) {
        let frame = trajectory.read_frame(k)?;
        let now = moved(&body.positions, &frame.displacement);
        if let Some(obstacle) = trajectory.obstacle() {
            let place = moved(&obstacle.positions, &frame.obstacle);
            let gap = samples.worst(&now, &place, &obstacle.triangles, size)?;
            if let Some(gap) = gap
                && worst.is_none_or(|w| gap.cells < w.cells)
            {
                worst = Some(gap);
            }
        }
        if let (Some(last), Some(first)) = (frames.last(), frames.first()) {
            for (tally, prediction) in scores.iter_mut().zip([last, first]) {
                tally.add(&free, &now, prediction, comparison.quality(&now, prediction)?);
            }
        }
        // Only the first and the last one are asked for again.
        frames.truncate(1);
        frames.push(now);
    }
    let [persistence, hold_first] = scores.map(|t| t.score(free.len()));
    Ok(Holding {
        persistence,
        hold_first,
        worst_gap: worst,
        cell_size: size,
    })
}

#[derive(Default)]
struct Tally {
    squares: f64,
    quality: Vec<Quality>,
}

impl Tally {
    fn add(&mut self, free: &[usize], truth: &[Vector], prediction: &[Vector], quality: Quality) {
        let square = |&p: &usize| sub(truth[p], prediction[p]).iter().map(|d| d * d).sum::<f64>();
        self.squares += free.iter().map(square).sum::<f64>();
        self.quality.push(quality);
    }

    fn score(self, free: usize) -> Score {
        let n = self.quality.len().max(1) as f64;
        Score {
            rmse: (self.squares / (3.0 * n * free.max(1) as f64)).sqrt(),
            quality: Quality::mean(&self.quality),
        }
    }
}
