//! Samples near the obstacle, and their ways out of it.

use m4gn_mesh::surface::{Against, Foot, Surface};
use m4gn_mesh::vector::{Vector, dot};

/// Cosine to the skin's outward normal below which a direction leads into the body.
const AGAINST: f64 = -0.3;
/// Samples this near to the obstacle are kept from sinking in by a correction that is meant for others, mean edges.
pub(super) const REACH: f64 = 0.5;

/// The way out of an obstacle for a place inside: where the nearest one leads along the body's skin or out of it, the
/// nearest one of those that lead into the body, up to a little more than the `deepest` penetration. A flat top under a box is pressed down and not apart.
pub(super) fn out_of(surface: &Surface, x: Vector, foot: Foot, outward: Vector, deepest: f64) -> Foot {
    if foot.distance >= 0.0 || dot(foot.normal, outward) < AGAINST {
        return foot;
    }
    let against = Against { direction: outward, cosine: AGAINST };
    let inward = surface.foot_against(x, 1.1 * deepest, against, |_| true);
    inward.filter(|f| f.distance < 0.0).unwrap_or(foot)
}

/// What is known of the samples of a state that is being corrected.
pub(super) struct Near {
    /// A lower bound of the distance before any correction, m.
    pub(super) least: Vec<f64>,
    /// Whether a sample has been a constraint: then it stays one, or it would sink in again.
    pub(super) taken: Vec<bool>,
    /// Outward normals.
    pub(super) outward: Vec<Vector>,
    /// Deepest penetration before any correction, m.
    pub(super) deepest: f64,
}

impl Near {
    pub(super) fn new(outward: Vec<Vector>) -> Self {
        let samples = outward.len();
        Near { outward, deepest: 0.0, least: vec![f64::NEG_INFINITY; samples], taken: vec![false; samples] }
    }
}
