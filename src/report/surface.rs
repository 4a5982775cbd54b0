//! Surfaces in space, seen from far away: which triangle each pixel of a picture shows, and how light it is.

use super::cells::{CellMap, SAMPLES};
use m4gn_mesh::vector::{Vector, cross, dot, norm, sub};

/// Where the eye is, seen from the middle: above, in front, a little to the side.
const EYE: Vector = [-0.4, -1.0, 0.6];
/// Where the light comes from.
const LAMP: Vector = [-0.3, -0.7, 1.0];

/// An orthographic view that holds everything there is to show, so that pictures of different times compare.
#[derive(Clone, Debug)]
pub struct View {
    right: Vector,
    up: Vector,
    eye: Vector,
    /// Along right and up, m.
    corner: [f64; 2],
    /// Pixels a metre.
    scale: f64,
    width: usize,
    height: usize,
}

impl View {
    /// A view of all `points` (m), `width` pixels wide. None without extent.
    pub fn of(points: impl Iterator<Item = Vector>, width: usize) -> Option<Self> {
        let unit = |v: Vector| v.map(|x| x / norm(v));
        let eye = unit(EYE);
        let right = unit(cross([0.0, 0.0, 1.0], eye));
        let up = cross(eye, right);
        let bounds = points.fold([[f64::INFINITY, f64::NEG_INFINITY]; 2], |b, p| {
            let at = [dot(p, right), dot(p, up)];
            std::array::from_fn(|i| [b[i][0].min(at[i]), b[i][1].max(at[i])])
        });
        let [w, h] = bounds.map(|[low, high]| high - low);
        if !(w.is_finite() && h.is_finite() && w > 0.0 && h > 0.0) {
            return None;
        }
        // A tall scene gets a narrower picture.
        let width = if h > w { width as f64 * w / h } else { width as f64 }.max(8.0);
        let scale = width / w;
        Some(View {
            right,
            up,
            eye,
            corner: [bounds[0][0], bounds[1][1]],
            scale,
            width: width.round() as usize,
            height: ((h * scale).round() as usize).max(8),
        })
    }

    /// What is seen of `triangles` (m); the numbers in the map are theirs. Corners that are not finite hide a triangle.
    pub fn map(&self, triangles: &[[Vector; 3]]) -> CellMap {
        let (columns, rows) = (SAMPLES * self.width, SAMPLES * self.height);
        let mut map = CellMap {
            width: self.width,
            height: self.height,
            cells: vec![-1; columns * rows],
            light: vec![1.0; columns * rows],
        };
        let mut depth = vec![f64::NEG_INFINITY; columns * rows];
        let lamp = LAMP.map(|x| x / norm(LAMP));
        let scale = SAMPLES as f64 * self.scale;
        for (t, corners) in triangles.iter().enumerate() {
            // Samples from the upper left, and nearness to the eye
            let [a, b, c] = corners.map(|p| {
                [
                    (dot(p, self.right) - self.corner[0]) * scale - 0.5,
                    (self.corner[1] - dot(p, self.up)) * scale - 0.5,
                    dot(p, self.eye),
                ]
            });
            let twice = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
            if !twice.is_finite() || twice == 0.0 {
                continue;
            }
            let normal = cross(sub(corners[1], corners[0]), sub(corners[2], corners[0]));
            let mut facing = dot(normal, lamp) / norm(normal);
            if dot(normal, self.eye) < 0.0 {
                facing = -facing;
            }
            let light = (0.72 + 0.28 * facing) as f32;
            let range = |i: usize, end: usize| {
                let low = a[i].min(b[i]).min(c[i]).ceil().max(0.0);
                let high = a[i].max(b[i]).max(c[i]).floor();
                low as usize..((high + 1.0).max(0.0) as usize).min(end)
            };
            for y in range(1, rows) {
                for x in range(0, columns) {
                    let (dx, dy) = (x as f64 - a[0], y as f64 - a[1]);
                    let v = (dx * (c[1] - a[1]) - (c[0] - a[0]) * dy) / twice;
                    let w = ((b[0] - a[0]) * dy - dx * (b[1] - a[1])) / twice;
                    let near = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2]);
                    let sample = y * columns + x;
                    if v >= 0.0 && w >= 0.0 && v + w <= 1.0 && near > depth[sample] {
                        depth[sample] = near;
                        map.cells[sample] = t as i32;
                        map.light[sample] = light;
                    }
                }
            }
        }
        map
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle towards the eye that covers half of the picture, and one behind it that covers all.
    #[test]
    fn what_is_nearer_hides_what_is_behind() {
        let view = View::of([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]].into_iter(), 100).unwrap();
        let at = |x: f64, y: f64, near: f64| -> Vector {
            std::array::from_fn(|i| x * view.right[i] + y * view.up[i] + near * view.eye[i])
        };
        let [left, top] = view.corner;
        let [w, h] = [view.width, view.height].map(|n| n as f64 / view.scale);
        let triangle = |size: f64, near: f64| {
            [at(left, top, near), at(left + size * w, top, near), at(left, top - size * h, near)]
        };
        let map = view.map(&[triangle(2.1, 0.0), triangle(1.0, 1.0)]);
        let share = |t: i32| map.cells.iter().filter(|&&c| c == t).count() as f64 / map.cells.len() as f64;
        let shares = [share(-1), share(0), share(1)];
        assert!(shares[0] == 0.0 && (shares[2] - 0.5).abs() < 0.01, "{shares:?}");
        // In the other order, and turned, the same
        let [a, b, c] = triangle(1.0, 1.0);
        let turned = view.map(&[[a, c, b], triangle(2.1, 0.0)]);
        let swapped = |c: &i32| 1 - c;
        assert!(map.cells.iter().map(swapped).eq(turned.cells.iter().copied()));
        assert!(map.light.iter().all(|l| (0.4..=1.0).contains(l)));
        let nan = view.map(&[[[f64::NAN; 3]; 3]]);
        assert!(nan.cells.iter().all(|&c| c == -1));
        assert!(View::of([[1.0; 3]].into_iter(), 100).is_none());
    }
}
