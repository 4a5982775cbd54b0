//! The level of a pressure: an incompressible flow knows the differences of its pressure alone.

use crate::FieldSpec;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_parallel::Comm;

/// Whether a field has a level that its flow does not know: a kinematic pressure (`p`, `p_rgh`).
pub fn has_level(name: &str, vector: bool, dimensions: [i32; 7]) -> bool {
    !vector && dimensions == [0, 2, -2, 0, 0, 0, 0] && (name == "p" || name.starts_with("p_"))
}

impl FieldSpec {
    /// As [`has_level`].
    pub fn has_level(&self) -> bool {
        has_level(&self.name, self.vector, self.dimensions)
    }
}

/// Where a level is read: halfway between the least and the largest value at the outlets, or, where there is none, the mean over the
/// volume. Networks see a pressure without it.
#[derive(Clone, Debug)]
pub struct Level {
    /// Boundary faces of this rank; none on any rank: the volumes count.
    outlets: Vec<usize>,
    volumes: Option<Vec<f64>>,
}

impl Level {
    /// Of this rank's part of a mesh. Collective.
    pub fn new(mesh: &Mesh, comm: &Comm) -> Self {
        let faces = mesh.boundary.iter().enumerate();
        let outlets: Vec<usize> =
            faces.filter(|(_, face)| face.kind == NodeType::Outlet).map(|(i, _)| i).collect();
        let mut count = [outlets.len() as i64];
        comm.sum_i64(&mut count);
        Level { outlets, volumes: (count[0] == 0).then(|| mesh.cell_volumes.clone()) }
    }

    /// Of a field with these values at cells and boundary faces. Collective.
    pub fn of<T: Copy + Into<f64>>(&self, cells: &[T], boundary: &[T], comm: &Comm) -> f64 {
        match &self.volumes {
            Some(volumes) => {
                let pairs = || volumes.iter().zip(cells);
                let mut sums = [pairs().map(|(v, &p)| v * p.into()).sum::<f64>(), volumes.iter().sum()];
                comm.sum_f64(&mut sums);
                if sums[1] > 0.0 { sums[0] / sums[1] } else { 0.0 }
            }
            None => {
                let mut ends = [f64::NEG_INFINITY; 2];
                for &face in &self.outlets {
                    let p = boundary[face].into();
                    ends = [f64::max(ends[0], -p), f64::max(ends[1], p)];
                }
                comm.max_f64(&mut ends);
                0.5 * (ends[1] - ends[0])
            }
        }
    }

    /// Takes the level off values of one rank that has the whole mesh.
    pub fn take_off(&self, cells: &mut [f32], boundary: &mut [f32]) {
        let level = self.of(cells, boundary, &Comm::serial());
        let values = cells.iter_mut().chain(boundary);
        values.for_each(|p| *p = (f64::from(*p) - level) as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    #[test]
    fn a_constant_comes_off_with_outlets_and_without() {
        let mut mesh = sample::rectangle(4, 3, 1.0, 1.0);
        let cells: Vec<f64> = (0..mesh.cell_volumes.len()).map(|i| (0.3 * i as f64).sin()).collect();
        let at = |b: &m4gn_mesh::BoundaryFace| match b.kind {
            NodeType::Outlet => 2.0,
            _ => cells[b.owner as usize],
        };
        let boundary: Vec<f64> = mesh.boundary.iter().map(at).collect();
        let comm = Comm::serial();
        assert_eq!(Level::new(&mesh, &comm).of(&cells, &boundary, &comm), 2.0);
        mesh.boundary.iter_mut().for_each(|b| b.kind = NodeType::Wall);
        let mean = cells.iter().sum::<f64>() / cells.len() as f64;
        let closed = Level::new(&mesh, &comm);
        assert!((closed.of(&cells, &boundary, &comm) - mean).abs() < 1e-14);
        let single = |values: &[f64]| values.iter().map(|&v| v as f32 + 4.0).collect::<Vec<f32>>();
        let (mut c, mut b) = (single(&cells), single(&boundary));
        closed.take_off(&mut c, &mut b);
        assert!(c.iter().zip(&cells).all(|(a, b)| (f64::from(*a) - (b - mean)).abs() < 1e-6));
        assert!(b.iter().zip(&boundary).all(|(a, b)| (f64::from(*a) - (b - mean)).abs() < 1e-6));
    }

    #[test]
    fn kinematic_pressures_alone_have_a_level() {
        let kinematic = [0, 2, -2, 0, 0, 0, 0];
        assert!(has_level("p", false, kinematic) && has_level("p_rgh", false, kinematic));
        assert!(!has_level("k", false, kinematic) && !has_level("p", false, [1, -1, -2, 0, 0, 0, 0]));
    }
}
