//! Fields without what changes from cell to cell: each cell has the value of the polynomial of second order that fits the cell and
//! its neighbours over three faces best.
//!
//! What a network does not see from a graph of cells, and what no two meshes of a flow have in common, is the pattern that the
//! solver's schemes make at the scale of a cell (central differences of convection at high cell Peclet numbers). Smooth fields,
//! which the mesh resolves, stay as they are to the third order in the cell size; of what changes its sign from cell to cell,
//! three quarters of the square go, so that the part that is left out is a lower bound.

use faer::Mat;
use m4gn_domain::Kind;
use m4gn_mesh::Mesh;

/// Faces between a cell and those that its value is fitted to.
const HOPS: usize = 3;

/// The fits of all cells of a mesh.
#[derive(Clone, Debug)]
pub(super) struct Smoothing {
    /// Cells that a cell's value is fitted to, and their weights.
    fits: Vec<Vec<(usize, f64)>>,
}

impl Smoothing {
    /// For a mesh of cells; none for a body at points.
    pub fn new(mesh: &Mesh) -> Option<Self> {
        if Kind::of_mesh(mesh).moves() {
            return None;
        }
        let mut neighbours = vec![Vec::new(); mesh.n_cells()];
        for (&a, &b) in mesh.face_owner.iter().zip(&mesh.face_neighbour) {
            neighbours[a as usize].push(b as usize);
            neighbours[b as usize].push(a as usize);
        }
        let fit = |cell: usize| {
            let mut stencil = vec![cell];
            for _ in 0..HOPS {
                let next = stencil.iter().flat_map(|&n| &neighbours[n]).copied();
                let next: Vec<usize> = next.collect();
                stencil.extend(next);
                stencil.sort_unstable();
                stencil.dedup();
            }
            weights(mesh, cell, &stencil)
        };
        Some(Smoothing { fits: (0..mesh.n_cells()).map(fit).collect() })
    }

    /// A field of rows of `width` values.
    pub fn apply(&self, values: &[f64], width: usize) -> Vec<f64> {
        let mut smooth = vec![0.0; values.len()];
        for (to, fit) in smooth.chunks_exact_mut(width).zip(&self.fits) {
            for &(cell, weight) in fit {
                let row = &values[cell * width..(cell + 1) * width];
                to.iter_mut().zip(row).for_each(|(to, x)| *to += weight * x);
            }
        }
        smooth
    }
}

/// What each cell of the stencil counts in the polynomial's value at the cell; the cell alone where there are too few of them.
fn weights(mesh: &Mesh, cell: usize, stencil: &[usize]) -> Vec<(usize, f64)> {
    let offset = |other: usize, d: usize| mesh.cell_centres[other][d] - mesh.cell_centres[cell][d];
    let directions = &mesh.directions;
    let dim = directions.len();
    let terms = 1 + dim + dim * (dim + 1) / 2;
    let size = stencil
        .iter()
        .flat_map(|&o| directions.iter().map(move |&d| offset(o, d).abs()))
        .fold(f64::MIN_POSITIVE, f64::max);
    let monomial = |row: usize, term: usize| {
        let x = |i: usize| offset(stencil[row], directions[i]) / size;
        match term {
            0 => 1.0,
            t if t <= dim => x(t - 1),
            t => {
                let pairs = (0..dim).flat_map(|i| (i..dim).map(move |j| (i, j)));
                pairs.skip(t - 1 - dim).map(|(i, j)| x(i) * x(j)).next().unwrap_or(0.0)
            }
        }
    };
    let alone = vec![(cell, 1.0)];
    if stencil.len() <= terms {
        return alone;
    }
    let Ok(decomposition) = Mat::from_fn(stencil.len(), terms, monomial).thin_svd() else {
        return alone;
    };
    // The polynomial's constant, from the values: the first row of the pseudoinverse.
    let inverse = decomposition.pseudoinverse();
    let weights = stencil.iter().enumerate().map(|(i, &o)| (o, inverse[(0, i)]));
    weights.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    #[test]
    fn what_the_mesh_resolves_stays_and_what_changes_from_cell_to_cell_goes() {
        let mesh = sample::triangles(12, 8, 1.5, 1.0);
        let smoothing = Smoothing::new(&mesh).unwrap();
        let parabola = |x: &[f64; 3]| 1.0 + x[0] - 2.0 * x[1] + 3.0 * x[0] * x[1] - x[1] * x[1];
        let smooth: Vec<f64> = mesh.cell_centres.iter().map(parabola).collect();
        let found = smoothing.apply(&smooth, 1);
        let off = found.iter().zip(&smooth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-10, "{off:e}");
        // The two triangles of a rectangle differ: three quarters of the square go.
        let rough: Vec<f64> = (0..mesh.n_cells()).map(|c| if c % 2 == 0 { 1.0 } else { -1.0 }).collect();
        // Cells with all their neighbours.
        let inner: Vec<usize> = (0..mesh.n_cells())
            .filter(|&c| {
                (0.3..1.2).contains(&mesh.cell_centres[c][0]) && (0.3..0.7).contains(&mesh.cell_centres[c][1])
            })
            .collect();
        let found = smoothing.apply(&rough, 1);
        let left = inner.iter().map(|&c| found[c].abs()).fold(0.0, f64::max);
        assert!(inner.len() > 20 && left < 0.5, "{left} of {}", inner.len());
    }

    #[test]
    fn rows_of_three_are_smoothed_each_by_itself_and_few_cells_not_at_all() {
        let mesh = sample::triangles(1, 1, 1.0, 1.0);
        let smoothing = Smoothing::new(&mesh).unwrap();
        let values = [1.0, 2.0, 3.0, -4.0, 5.0, 0.5];
        assert_eq!(smoothing.apply(&values, 3), values);
        let mesh = sample::triangles(6, 4, 1.0, 1.0);
        let smoothing = Smoothing::new(&mesh).unwrap();
        let one: Vec<f64> = (0..mesh.n_cells()).map(|c| (c as f64).sin()).collect();
        let three: Vec<f64> = one.iter().flat_map(|&x| [x, 2.0 * x, 0.0]).collect();
        let (one, three) = (smoothing.apply(&one, 1), smoothing.apply(&three, 3));
        for (x, row) in one.iter().zip(three.chunks_exact(3)) {
            assert!((row[0] - x).abs() < 1e-14 && (row[1] - 2.0 * x).abs() < 1e-13 && row[2] == 0.0);
        }
    }
}
