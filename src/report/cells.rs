//! Which cell of a 2-D mesh each pixel of a picture shows.

use super::{
    picture::Scale,
    raster::{PAPER, Raster, Rgb},
};
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::{BoundaryFace, Mesh};

/// Samples a pixel has in each direction; their mean smooths edges.
const SAMPLES: usize = 2;

/// The colour of values that are none (NaN).
const NO_VALUE: Rgb = [170, 170, 170];

/// Which cell each sample of a picture shows.
#[derive(Clone, Debug)]
pub struct CellMap {
    /// Pixels a row.
    pub width: usize,
    /// Rows of pixels.
    pub height: usize,
    /// `[SAMPLES height x SAMPLES width]`, from the top; -1 outside the mesh.
    cells: Vec<i32>,
}

impl CellMap {
    /// From the cells' polygons (`start[i]..start[i + 1]` of `points`, m), `width` pixels wide. None without area.
    pub fn from_polygons(start: &[usize], points: &[[f64; 2]], width: usize) -> Option<Self> {
        let (mut map, grid) = Self::blank(points, width)?;
        for (cell, range) in start.windows(2).enumerate() {
            let Some(corners) = points.get(range[0]..range[1]).filter(|c| c.len() > 2) else {
                continue;
            };
            let corners: Vec<[f64; 2]> = corners.iter().map(|p| grid.sample(*p)).collect();
            map.fill(&corners, cell as i32);
        }
        Some(map)
    }

    /// From cell centres (m): each sample shows the nearest cell, unless it lies outside the nearest boundary face,
    /// given as its centre and outward normal.
    pub fn from_centres(
        centres: &[[f64; 2]],
        boundary: &[([f64; 2], [f64; 2])],
        width: usize,
    ) -> Option<Self> {
        let corners: Vec<[f64; 2]> = centres.iter().copied().chain(boundary.iter().map(|b| b.0)).collect();
        let (mut map, grid) = Self::blank(&corners, width)?;
        let space = |p: &[f64; 2]| [p[0], p[1], 0.0];
        let near_cell = Nearest::new(&centres.iter().map(space).collect::<Vec<_>>());
        let near_face = Nearest::new(&boundary.iter().map(|b| space(&b.0)).collect::<Vec<_>>());
        for j in 0..SAMPLES * map.height {
            for i in 0..SAMPLES * map.width {
                let x = grid.position(i, j);
                let outside = near_face.nearest(space(&x)).is_some_and(|face| {
                    let (centre, normal) = boundary[face];
                    (x[0] - centre[0]) * normal[0] + (x[1] - centre[1]) * normal[1] > 0.0
                });
                if let Some(cell) = near_cell.nearest(space(&x)).filter(|_| !outside) {
                    map.cells[j * SAMPLES * map.width + i] = cell as i32;
                }
            }
        }
        Some(map)
    }

    /// From a 2-D mesh that comes without the shapes of its cells, as [`CellMap::from_centres`]. None in 3-D.
    pub fn from_mesh(mesh: &Mesh, width: usize) -> Option<Self> {
        let [i, j] = mesh.directions[..] else {
            return None;
        };
        let flat = |p: &[f64; 3]| [p[i], p[j]];
        let centres: Vec<[f64; 2]> = mesh.cell_centres.iter().map(flat).collect();
        let face = |b: &BoundaryFace| {
            // Outward as seen from the owner, whatever the file says: a picture must not fall to pieces over a sign.
            let (centre, owner, area) = (flat(&b.centre), centres[b.owner as usize], flat(&b.area));
            // A point of the boundary lies where its owner does.
            let inward = (centre[0] - owner[0]) * area[0] + (centre[1] - owner[1]) * area[1] < 0.0;
            (centre, area.map(|a| if inward { -a } else { a }))
        };
        let boundary: Vec<_> = mesh.boundary.iter().map(face).collect();
        Self::from_centres(&centres, &boundary, width)
    }

    fn blank(points: &[[f64; 2]], width: usize) -> Option<(Self, Grid)> {
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick);
        let (left, right) = (bound(0, f64::min)?, bound(0, f64::max)?);
        let (bottom, top) = (bound(1, f64::min)?, bound(1, f64::max)?);
        if !(right > left && top > bottom) {
            return None;
        }
        // A very tall domain gets a narrower picture.
        let (aspect, requested) = ((top - bottom) / (right - left), width);
        if !aspect.is_finite() || aspect == 0.0 {
            return None;
        }
        let width = if aspect > 2.0 { (2.0 * width as f64 / aspect) as usize } else { width }.max(8);
        // One that is narrower than eight pixels then is drawn wider than it is.
        let height = ((width as f64 * aspect).round() as usize).clamp(8, 2 * requested.max(8));
        let scale = [(SAMPLES * width) as f64 / (right - left), (SAMPLES * height) as f64 / (top - bottom)];
        let cells = vec![-1; SAMPLES * SAMPLES * width * height];
        let map = CellMap { width, height, cells };
        Some((map, Grid { left, top, scale }))
    }

    /// Fills a polygon, given in samples, by the even-odd rule at sample centres.
    fn fill(&mut self, corners: &[[f64; 2]], cell: i32) {
        let (columns, rows) = (SAMPLES * self.width, SAMPLES * self.height);
        let low = corners.iter().map(|c| c[1]).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(|c| c[1]).fold(f64::NEG_INFINITY, f64::max);
        let mut crossings = Vec::new();
        for row in (low - 0.5).max(0.0) as usize..((high + 0.5).max(0.0) as usize).min(rows) {
            let y = row as f64 + 0.5;
            crossings.clear();
            for (k, a) in corners.iter().enumerate() {
                let b = corners[(k + 1) % corners.len()];
                if (a[1] <= y) != (b[1] <= y) {
                    // From below whatever the direction: neighbours then agree on their common edge to the last bit.
                    let (a, b) = if a[1] <= y { (*a, b) } else { (b, *a) };
                    crossings.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                }
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let first = (pair[0] - 0.5).ceil().max(0.0) as usize;
                let last = ((pair[1] - 0.5).ceil().max(0.0) as usize).min(columns);
                for column in first..last {
                    self.cells[row * columns + column] = cell;
                }
            }
        }
    }

    /// Paints `values`, one a cell, with the upper left corner at `left`, `top`.
    pub fn paint(&self, raster: &mut Raster, left: usize, top: usize, values: &[f64], scale: &Scale) {
        for y in 0..self.height {
            for x in 0..self.width {
                let mut sum = [0u32; 3];
                for j in 0..SAMPLES {
                    for i in 0..SAMPLES {
                        let sample = (SAMPLES * y + j) * SAMPLES * self.width + SAMPLES * x + i;
                        let value = usize::try_from(self.cells[sample]).ok().and_then(|c| values.get(c));
                        let colour = match value {
                            None => PAPER,
                            Some(v) if v.is_nan() => NO_VALUE,
                            Some(&v) => scale.colour(v),
                        };
                        sum.iter_mut().zip(colour).for_each(|(s, c)| *s += u32::from(c));
                    }
                }
                raster.set(left + x, top + y, sum.map(|s| (s / (SAMPLES * SAMPLES) as u32) as u8));
            }
        }
    }
}

/// From metres to samples.
struct Grid {
    left: f64,
    top: f64,
    scale: [f64; 2],
}

impl Grid {
    fn sample(&self, p: [f64; 2]) -> [f64; 2] {
        [(p[0] - self.left) * self.scale[0], (self.top - p[1]) * self.scale[1]]
    }

    fn position(&self, i: usize, j: usize) -> [f64; 2] {
        [self.left + (i as f64 + 0.5) / self.scale[0], self.top - (j as f64 + 0.5) / self.scale[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(map: &CellMap, cell: i32) -> f64 {
        map.cells.iter().filter(|&&c| c == cell).count() as f64 / map.cells.len() as f64
    }

    #[test]
    fn polygons_cover_their_area() {
        // A square cut along its diagonal into two triangles.
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let map = CellMap::from_polygons(&[0, 3, 6], &points, 100).unwrap();
        assert_eq!((map.width, map.height), (100, 100));
        assert!((shares(&map, 0) - 0.5).abs() < 0.01 && (shares(&map, 1) - 0.5).abs() < 0.01);
        assert!(shares(&map, -1) < 1e-9);
    }

    /// Cells in a column: however long it is, the picture has a bounded size, and each end shows its cell.
    #[test]
    fn a_long_domain_has_a_bounded_picture() {
        for length in [1e3, 1e7, 1e300] {
            let points =
                [[0.0, 0.0], [1.0, 0.0], [1.0, length], [0.0, length], [0.0, -length], [1.0, -length]];
            let corners: Vec<[f64; 2]> = [0, 1, 2, 3, 4, 5, 1, 0].map(|p| points[p]).into();
            let map = CellMap::from_polygons(&[0, 4, 8], &corners, 520).unwrap();
            assert_eq!((map.width, map.height), (8, 1040), "{length}");
            assert!((shares(&map, 0) - 0.5).abs() < 0.01 && (shares(&map, 1) - 0.5).abs() < 0.01);
        }
    }

    #[test]
    fn points_of_the_boundary_are_faces_at_their_own_places() {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let face = |p: usize| BoundaryFace {
            owner: p as i32,
            global: p as i64,
            centre: corners[p],
            area: corners[p].map(|x| x - 0.5),
            coeff: 1.0,
            kind: m4gn_mesh::NodeType::Wall,
            patch: 0,
        };
        let mesh = Mesh {
            directions: vec![0, 1],
            cell_centres: corners.to_vec(),
            boundary: (0..4).map(face).collect(),
            ..Mesh::default()
        };
        let map = CellMap::from_mesh(&mesh, 40).unwrap();
        assert_eq!([-1, 0, 1, 2, 3].map(|cell| shares(&map, cell)), [0.0, 0.25, 0.25, 0.25, 0.25]);
    }

    #[test]
    fn nearest_cells_stay_inside_the_boundary() {
        // Unit square of 20 x 20 cells with a hole of radius 0.2 in the middle.
        let inside = |p: &[f64; 2]| (p[0] - 0.5).hypot(p[1] - 0.5) > 0.2;
        let centres: Vec<[f64; 2]> = (0..400)
            .map(|k| [(k % 20) as f64 / 20.0 + 0.025, (k / 20) as f64 / 20.0 + 0.025])
            .filter(inside)
            .collect();
        let mut boundary: Vec<_> = (0..40)
            .map(|k| (k as f64 / 40.0 * std::f64::consts::TAU).sin_cos())
            .map(|(s, c)| ([0.5 + 0.2 * c, 0.5 + 0.2 * s], [-c, -s]))
            .collect();
        for k in 0..20 {
            let t = (k as f64 + 0.5) / 20.0;
            boundary.extend([
                ([t, 0.0], [0.0, -1.0]),
                ([t, 1.0], [0.0, 1.0]),
                ([0.0, t], [-1.0, 0.0]),
                ([1.0, t], [1.0, 0.0]),
            ]);
        }
        let map = CellMap::from_centres(&centres, &boundary, 120).unwrap();
        let hole = std::f64::consts::PI * 0.04;
        assert!((shares(&map, -1) - hole).abs() < 0.01, "{}", shares(&map, -1));
    }
}
