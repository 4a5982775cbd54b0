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
    volumes: Option<Volumes>,
}

/// Volumes of this rank's cells, their sum over all ranks, and the number of all ranks' cells.
#[derive(Clone, Debug)]
struct Volumes {
    cells: Vec<f64>,
    sum: f64,
    count: i64,
}

impl Level {
    /// Of this rank's part of a mesh. Collective.
    pub fn new(mesh: &Mesh, comm: &Comm) -> Self {
        let faces = mesh.boundary.iter().enumerate();
        let outlets: Vec<usize> =
            faces.filter(|(_, face)| face.kind == NodeType::Outlet).map(|(i, _)| i).collect();
        let mut counts = [outlets.len() as i64, mesh.n_cells() as i64];
        comm.sum_i64(&mut counts);
        let [open, count] = counts;
        let cells = mesh.cell_volumes.clone();
        let sum = |cells: &[f64]| exact_sum(cells.iter().copied(), count, comm);
        Level { outlets, volumes: (open == 0).then(|| Volumes { sum: sum(&cells), cells, count }) }
    }

    /// Of a field with these values at cells and boundary faces. The same bits on any number of ranks; allocates nothing. Collective.
    pub fn of<T: Copy + Into<f64>>(&self, cells: &[T], boundary: &[T], comm: &Comm) -> f64 {
        match &self.volumes {
            Some(volumes) if volumes.sum > 0.0 => {
                let terms = volumes.cells.iter().zip(cells).map(|(v, &p)| v * p.into());
                exact_sum(terms, volumes.count, comm) / volumes.sum
            }
            Some(_) => 0.0,
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

    /// Boundary faces that it is read at, where there are any on any rank.
    pub fn outlets(&self) -> &[usize] {
        &self.outlets
    }

    /// Volumes of the cells that it is the mean over, where there is no outlet.
    pub fn volumes(&self) -> Option<&[f64]> {
        self.volumes.as_ref().map(|volumes| &volumes.cells[..])
    }

    /// What [`Level::of`] is by these values, of one rank that has the whole mesh: nodes, cells and then boundary faces, and shares.
    pub fn shares<T: Copy + Into<f64>>(&self, cells: &[T], boundary: &[T]) -> Vec<(usize, f64)> {
        let at = |face: &&usize| -> f64 { boundary[**face].into() };
        match &self.volumes {
            Some(volumes) => {
                let all = volumes.sum;
                let share =
                    |(cell, volume): (usize, &f64)| (cell, if all > 0.0 { volume / all } else { 0.0 });
                volumes.cells.iter().enumerate().map(share).collect()
            }
            None => {
                let order = |a: &&usize, b: &&usize| at(a).total_cmp(&at(b));
                let ends = [self.outlets.iter().min_by(order), self.outlets.iter().max_by(order)];
                ends.into_iter().flatten().map(|face| (cells.len() + face, 0.5)).collect()
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

/// The sum of at most `count` terms of all ranks, each rounded to a whole multiple of one power of two: the same in any order. Not a
/// number where a term is none. Collective.
fn exact_sum(terms: impl Iterator<Item = f64> + Clone, count: i64, comm: &Comm) -> f64 {
    let size = |x: f64| if x.is_finite() { x.abs() } else { f64::INFINITY };
    let mut largest = [terms.clone().map(size).fold(0.0, f64::max)];
    comm.max_f64(&mut largest);
    let [largest] = largest;
    if largest == 0.0 || largest.is_infinite() {
        return if largest == 0.0 { 0.0 } else { f64::NAN };
    }
    // The sum stays below 2^62
    let digits = (60 - largest.log2().floor() as i32 - (count as f64).log2().ceil() as i32).min(1000);
    let mut sum = [terms.map(|x| (x * 2f64.powi(digits)).round() as i64).sum::<i64>()];
    comm.sum_i64(&mut sum);
    sum[0] as f64 * 2f64.powi(-digits)
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
