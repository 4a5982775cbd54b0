//! What predicting "nothing moves any more" scores on a trajectory: the rows every table of models is read against.

use crate::errors::SquaredError;
use crate::validate::{Pace, Scene};
use m4gn_data::Trajectory;
use m4gn_domain::body::gap::Gap;
use m4gn_domain::body::quality::Quality;
use m4gn_mesh::{Error, Result};
use m4gn_model::{FieldSpec, Output};

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

/// Scores a body's own frames, every `stride`-th of them.
///
/// # Errors
/// [`Error::File`] for a trajectory at cells; when a frame cannot be read, or the obstacle is no closed surface.
pub fn score(trajectory: &Trajectory, stride: usize) -> Result<Holding> {
    let displacement = trajectory.fields().iter().map(|f| FieldSpec {
        name: f.name.clone(),
        vector: f.vector,
        dimensions: f.dimensions,
        input: false,
        output: Output::Delta,
    });
    let displacement: Vec<FieldSpec> = displacement.filter(|f| f.name == "D").collect();
    let frames = stride.max(1);
    let pace = Pace { interval: 0.0, frames, steps: (trajectory.times().len() - 1) / frames };
    let scene = Scene::read(trajectory, &displacement, pace)?;
    let shape = scene.shape().filter(|_| !displacement.is_empty()).ok_or_else(|| {
        Error::file(
            trajectory.path(),
            "expected a trajectory at points (a deforming body) with its displacement D",
        )
    })?;
    let held = |from: &dyn Fn(usize) -> usize| -> Result<Score> {
        let (mut error, mut quality) = (SquaredError::default(), Vec::new());
        for frame in 1..=pace.steps {
            let prediction = scene.truth(0, from(frame));
            error.add(scene.error(0, prediction, frame));
            quality.push(shape.quality(scene.truth(0, frame), prediction)?);
        }
        Ok(Score { rmse: error.rmse(), quality: Quality::mean(&quality) })
    };
    let gaps = (0..=pace.steps).map(|k| shape.gap(scene.truth(0, k), scene.motion(k)));
    let gaps: Vec<Gap> = gaps.filter_map(Result::transpose).collect::<Result<_>>()?;
    Ok(Holding {
        persistence: held(&|frame| frame - 1)?,
        hold_first: held(&|_| 0)?,
        worst_gap: gaps.into_iter().min_by(|a, b| a.cells.total_cmp(&b.cells)),
        cell_size: shape.cell,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/solid.h5");

    /// The obstacle's facets lie inside the sphere that the simulation knew, so the gap is at least the recorded one.
    #[test]
    fn persistence_and_the_worst_gap() {
        let t = Trajectory::open(FILE).unwrap();
        let scores = score(&t, 1).unwrap();
        let gap = scores.worst_gap.unwrap().cells;
        let recorded = t.provenance()["worst_gap"].as_f64().unwrap();
        assert!((recorded - 1e-9..0.15).contains(&gap), "{gap}, recorded {recorded}");
        let (a, b) = (scores.persistence, scores.hold_first);
        assert!(0.0 < a.rmse && a.rmse < b.rmse, "{a:?} {b:?}");
        assert!(0.0 < a.quality.gf_h && a.quality.gf_h < b.quality.gf_h);
        assert!(b.quality.mc > 0.0 && b.quality.ar > 0.0 && b.quality.inverted == 0.0);
        // Hold first at stride 3: its Hausdorff distance is at most the largest displacement
        let last = t.read_frame("D", 3).unwrap().cells;
        let last = last.as_chunks::<3>().0;
        let length = |u: &[f32; 3]| u.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
        let largest = last.iter().map(length).fold(0.0, f64::max);
        let end = score(&t, 3).unwrap().hold_first;
        assert!(end.quality.gf_h <= largest && end.quality.gf_h > 0.3 * largest);
        let squares: f64 = last.iter().map(|u| length(u).powi(2)).sum();
        assert!((end.rmse - (squares / 24.0).sqrt()).abs() < 1e-12);
    }
}
