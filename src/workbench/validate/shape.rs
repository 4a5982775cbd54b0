//! What is measured of a domain with elements beside its fields: how its shape differs from the true one, and the gap to the obstacle.

use m4gn_base::Result;
use m4gn_data::Trajectory;
use m4gn_domain::body::gap::{Gap, Samples, cell_size};
use m4gn_domain::body::quality::{Comparison, Quality};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::surface::Surface;
use m4gn_mesh::vector::{Vector, moved};

/// A body and the obstacle that may touch it.
pub struct Shape<'a> {
    body: &'a Body,
    obstacle: Option<&'a Obstacle>,
    samples: Samples,
    comparison: Comparison<'a>,
    /// Unit of gaps: mean length of the edges at rest, m.
    pub cell: f64,
    /// Points that are free to move; the others count in no error.
    pub free: Vec<usize>,
}

impl<'a> Shape<'a> {
    /// That of a trajectory at points; none where the fields are at cells.
    pub fn new(trajectory: &'a Trajectory) -> Option<Self> {
        let body = trajectory.body()?;
        let is_free = |p: &usize| body.types[*p] == NodeType::Body;
        Some(Shape {
            obstacle: trajectory.obstacle(),
            samples: Samples::new(&body.elements, |p| !is_free(&(p as usize))),
            comparison: Comparison::new(&body.elements),
            cell: cell_size(&body.positions, &body.edges),
            free: (0..body.positions.len()).filter(is_free).collect(),
            body,
        })
    }

    /// Mesh metrics of a displacement against the true one, both `[N x 3]`, m.
    ///
    /// # Errors
    /// As [`Comparison::quality`].
    pub fn quality(&self, truth: &[f64], found: &[f64]) -> Result<Quality> {
        let [truth, found] = [truth, found].map(|u| moved(&self.body.positions, u.as_chunks().0));
        self.comparison.quality(&truth, &found)
    }

    /// Smallest gap to the obstacle at a displacement `[N x 3]` and one of the obstacle's points, m; none without one.
    ///
    /// # Errors
    /// As [`Surface::new`].
    pub fn gap(&self, found: &[f64], motion: &[Vector]) -> Result<Option<Gap>> {
        let Some(obstacle) = self.obstacle else {
            return Ok(None);
        };
        let places = moved(&self.body.positions, found.as_chunks().0);
        let surface = Surface::new(&moved(&obstacle.positions, motion), &obstacle.triangles)?;
        Ok(self.samples.worst(&places, &surface, self.cell))
    }
}
