//! Trajectories of either kind.

use super::points::SolidTrajectory;
use super::schema::Split;
use super::source::Opened;
use super::trajectory::Trajectory;
use crate::Result;
use std::path::Path;

/// A trajectory of either kind.
#[derive(Clone, Debug)]
pub enum Recorded {
    /// At cells: a flow.
    Cells(Trajectory),
    /// At points: a deforming body.
    Points(SolidTrajectory),
}

impl Recorded {
    /// Opens a file of either kind.
    ///
    /// # Errors
    /// As [`Trajectory::open`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let opened = Opened::new(path.as_ref())?;
        Ok(if opened.at_points {
            Recorded::Points(SolidTrajectory::read(opened)?)
        } else {
            Recorded::Cells(Trajectory::read(opened)?)
        })
    }

    /// Times of the frames, s, increasing.
    pub fn times(&self) -> &[f64] {
        match self {
            Recorded::Cells(t) => t.times(),
            Recorded::Points(t) => t.times(),
        }
    }

    /// What the trajectory is for.
    pub fn split(&self) -> Split {
        match self {
            Recorded::Cells(t) => t.split(),
            Recorded::Points(t) => t.split(),
        }
    }

    /// Where the trajectory came from.
    pub fn provenance(&self) -> &serde_json::Value {
        match self {
            Recorded::Cells(t) => t.provenance(),
            Recorded::Points(t) => t.provenance(),
        }
    }
}
