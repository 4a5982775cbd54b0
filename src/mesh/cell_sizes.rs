//! How large the cells are, as a field that a model may have among its inputs.
//!
//! What a scheme for convection adds to the viscosity grows with the cells, so that the same flow sheds faster on a finer mesh. A network that
//! lives on groups of cells cannot see that in its graph.

use super::Mesh;
use crate::vector::norm;

/// Name of the field, which m4gn makes of the mesh where nobody else has one of this name (m).
pub const CELL_SIZE: &str = "cellSize";

impl Mesh {
    /// Mean distance of each cell's centre from those of the cells across its faces, m; 0 for a cell without neighbours.
    pub fn cell_sizes(&self) -> Vec<f64> {
        let mut sums = vec![(0.0, 0u32); self.n_cells()];
        let mut add = |cell: i32, distance: f64| {
            let sum = &mut sums[cell as usize];
            *sum = (sum.0 + distance, sum.1 + 1);
        };
        for (&a, &b) in self.face_owner.iter().zip(&self.face_neighbour) {
            let (from, to) = (self.cell_centres[a as usize], self.cell_centres[b as usize]);
            let distance = norm(std::array::from_fn(|i| to[i] - from[i]));
            add(a, distance);
            add(b, distance);
        }
        for face in &self.coupled {
            add(face.owner, norm(face.delta));
        }
        sums.iter().map(|(sum, n)| sum / f64::from((*n).max(1))).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::sample;

    /// Cells of 0.5 m by 0.25 m: a corner has one neighbour each way, the middle of the lower row two beside it and one above.
    #[test]
    fn of_a_rectangle() {
        let sizes = sample::rectangle(3, 2, 1.5, 0.5).cell_sizes();
        let middle = (0.5 + 0.5 + 0.25) / 3.0;
        assert_eq!(sizes, [0.375, middle, 0.375, 0.375, middle, 0.375]);
    }
}
