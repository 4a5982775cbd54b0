//! Sample meshes by points with answers known on paper: blocks of any cells, 2-D rectangles, and decompositions.

use m4gn_mesh::elements::ElementKind;
use m4gn_modes::fem::PointMesh;
use std::collections::HashMap;

/// Cells of a sample block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Bricks.
    Hexahedra,
    /// Each brick halved into wedges whose triangles are normal to x.
    WedgesAlong,
    /// Each brick halved into wedges whose triangles are normal to z.
    WedgesAcross,
    /// Each brick in six tetrahedra around a diagonal.
    Tetrahedra,
    /// Each brick in six pyramids around its middle.
    Pyramids,
    /// Hexagonal prisms, normal to z, with five- to seven-sided ones at the boundary: each brick's top and bottom are
    /// cut so that three cells meet at each vertical edge.
    Polyhedra,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Kind; 6] = [
        Kind::Hexahedra,
        Kind::WedgesAlong,
        Kind::WedgesAcross,
        Kind::Tetrahedra,
        Kind::Pyramids,
        Kind::Polyhedra,
    ];
}

/// Polygons of a sample rectangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flat {
    /// Rectangles.
    Quadrilaterals,
    /// Each rectangle halved.
    Triangles,
    /// Hexagons as in [`Kind::Polyhedra`].
    Polygons,
}

impl Flat {
    /// All kinds.
    pub const ALL: [Flat; 3] = [Flat::Quadrilaterals, Flat::Triangles, Flat::Polygons];
}

/// A block `[0, l0] x [0, l1] x [0, l2]` of `n` bricks in each direction, cut into cells of a kind.
pub fn block(kind: Kind, n: [usize; 3], l: [f64; 3]) -> PointMesh {
    if kind == Kind::Polyhedra {
        let (flat, polygons) = honeycomb(n[0], n[1], l[0], l[1]);
        return extrude(&flat, &polygons, n[2], l[2]);
    }
    let bricks = m4gn_samples::bodies::block(n, l);
    let (mut points, mut cells) = (bricks.positions, Vec::new());
    for e in 0..bricks.elements.len() {
        let brick: Vec<usize> = bricks.elements.points_of(e).iter().map(|&p| p as usize).collect();
        cells.extend(cut(kind, &brick, &mut points));
    }
    PointMesh::from_cells(points, &cells)
}

/// The faces of the cells of a brick.
fn cut(kind: Kind, brick: &[usize], points: &mut Vec<[f64; 3]>) -> Vec<Vec<Vec<usize>>> {
    let bases = ElementKind::Hexahedron.sides();
    let (element, cells): (ElementKind, &[&[usize]]) = match kind {
        Kind::WedgesAlong => (ElementKind::Wedge, &[&[0, 3, 7, 1, 2, 6], &[0, 7, 4, 1, 6, 5]]),
        Kind::WedgesAcross => (ElementKind::Wedge, &[&[0, 1, 2, 4, 5, 6], &[0, 2, 3, 4, 6, 7]]),
        Kind::Tetrahedra => (
            ElementKind::Tetrahedron,
            &[&[0, 1, 2, 6], &[0, 2, 3, 6], &[0, 3, 7, 6], &[0, 7, 4, 6], &[0, 4, 5, 6], &[0, 5, 1, 6]],
        ),
        Kind::Pyramids => {
            points.push([0, 1, 2].map(|d| brick.iter().map(|&p| points[p][d]).sum::<f64>() / 8.0));
            (ElementKind::Pyramid, bases)
        }
        _ => (ElementKind::Hexahedron, &[&[0, 1, 2, 3, 4, 5, 6, 7]]),
    };
    let faces = |cell: &&[usize]| {
        let mut corners: Vec<usize> = cell.iter().map(|&i| brick[i]).collect();
        if kind == Kind::Pyramids {
            corners.reverse();
            corners.push(points.len() - 1);
        }
        element.sides().iter().map(|f| f.iter().map(|&i| corners[i]).collect()).collect()
    };
    cells.iter().map(faces).collect()
}

/// `nx x ny` polygons on `[0, lx] x [0, ly]`, one cell thick (0.1 of the lower length) in z.
pub fn rectangle(kind: Flat, nx: usize, ny: usize, lx: f64, ly: f64) -> PointMesh {
    let cells = match kind {
        Flat::Quadrilaterals => Kind::Hexahedra,
        Flat::Triangles => Kind::WedgesAcross,
        Flat::Polygons => Kind::Polyhedra,
    };
    PointMesh { directions: vec![0, 1], ..block(cells, [nx, ny, 1], [lx, ly, 0.1 * lx.min(ly)]) }
}

/// Rows of bricks, every second row moved by half a brick, in 2-D: sides between rows have a point in their middle, so
/// that inner cells are hexagons, bent a little to be convex and unequal.
fn honeycomb(nx: usize, ny: usize, lx: f64, ly: f64) -> (Vec<[f64; 2]>, Vec<Vec<usize>>) {
    let (hx, hy) = (lx / nx as f64, ly / ny as f64);
    let mut points = Vec::new();
    let mut index = HashMap::new();
    // Points on row lines at half bricks; both neighbours of a line use those that either needs.
    for j in 0..=ny {
        for i in 0..=2 * nx {
            let needed = |row: usize| row < ny && (i == 0 || i == 2 * nx || i % 2 == row % 2);
            if needed(j) || j > 0 && needed(j - 1) {
                let inner = i > 0 && i < 2 * nx && j > 0 && j < ny;
                // Up where the side above ends: convex for the cells of both rows.
                let up = if i % 2 == j % 2 { 1.0 } else { -1.0 };
                let bend = if inner { 0.15 * hy * up } else { 0.0 };
                index.insert((i, j), points.len());
                points.push([0.5 * hx * i as f64, hy * j as f64 + bend]);
            }
        }
    }
    let mut cells = Vec::new();
    for j in 0..ny {
        let mut cuts: Vec<usize> = (0..=2 * nx).filter(|i| i % 2 == j % 2).collect();
        cuts.insert(0, 0);
        cuts.push(2 * nx);
        cuts.dedup();
        for ends in cuts.windows(2) {
            let line = |row: usize| (ends[0]..=ends[1]).map(move |i| (i, row));
            let bottom = line(j).filter_map(|k| index.get(&k).copied());
            let top = line(j + 1).filter_map(|k| index.get(&k).copied());
            let mut polygon: Vec<usize> = bottom.collect();
            let top: Vec<usize> = top.collect();
            polygon.extend(top.iter().rev());
            cells.push(polygon);
        }
    }
    (points, cells)
}

fn extrude(flat: &[[f64; 2]], polygons: &[Vec<usize>], layers: usize, l: f64) -> PointMesh {
    let n = flat.len();
    let mut points = Vec::new();
    for k in 0..=layers {
        points.extend(flat.iter().map(|x| [x[0], x[1], l * k as f64 / layers as f64]));
    }
    let mut cells = Vec::new();
    for k in 0..layers {
        for polygon in polygons {
            let bottom: Vec<usize> = polygon.iter().rev().map(|p| p + n * k).collect();
            let top: Vec<usize> = polygon.iter().map(|p| p + n * (k + 1)).collect();
            let m = polygon.len();
            let mut faces: Vec<Vec<usize>> = (0..m)
                .map(|i| {
                    let (a, b) = (polygon[i], polygon[(i + 1) % m]);
                    vec![a + n * k, b + n * k, b + n * (k + 1), a + n * (k + 1)]
                })
                .collect();
            faces.extend([bottom, top]);
            cells.push(faces);
        }
    }
    PointMesh::from_cells(points, &cells)
}

/// Moves every point by up to `amount` in the directions where it is not on the box's boundary, by its position only.
pub fn distort(mesh: &mut PointMesh, amount: f64) {
    let extreme =
        |d: usize, f: fn(f64, f64) -> f64, start: f64| mesh.points.iter().map(|x| x[d]).fold(start, f);
    let low = [0, 1, 2].map(|d| extreme(d, f64::min, f64::INFINITY));
    let high = [0, 1, 2].map(|d| extreme(d, f64::max, f64::NEG_INFINITY));
    let directions = mesh.directions.clone();
    for x in &mut mesh.points {
        let old = *x;
        for &d in &directions {
            let inside = old[d] > low[d] + 1e-9 && old[d] < high[d] - 1e-9;
            if inside {
                // In 2-D front and back move alike.
                let seed: f64 = directions
                    .iter()
                    .map(|&e| (12.9898 + 7.1 * e as f64) * (old[e] - low[e]) / (high[e] - low[e]))
                    .sum();
                x[d] += amount * (37.0 * seed + 1.7 * d as f64).sin();
            }
        }
    }
}

/// The part of `rank`, given each cell's rank. Local points are numbered by first use.
pub fn part(mesh: &PointMesh, ranks: &[i32], rank: i32) -> PointMesh {
    let mut out =
        PointMesh { directions: mesh.directions.clone(), face_start: vec![0], ..Default::default() };
    let mut local = vec![-1i32; mesh.n_cells];
    for c in (0..mesh.n_cells).filter(|&c| ranks[c] == rank) {
        local[c] = out.n_cells as i32;
        out.n_cells += 1;
    }
    let side = |f: usize| {
        let owner = local[mesh.face_owner[f] as usize];
        let neighbour = mesh.face_neighbour.get(f).map_or(-1, |&c| local[c as usize]);
        (owner, neighbour)
    };
    let mut point = vec![-1i32; mesh.points.len()];
    for internal in [true, false] {
        for f in 0..mesh.n_faces() {
            let (owner, neighbour) = side(f);
            if (owner >= 0 && neighbour >= 0) != internal || (owner < 0 && neighbour < 0) {
                continue;
            }
            let mut face: Vec<i32> = mesh.face(f).to_vec();
            if owner < 0 {
                face.reverse();
            }
            for p in face {
                let to = &mut point[p as usize];
                if *to < 0 {
                    *to = out.points.len() as i32;
                    out.points.push(mesh.points[p as usize]);
                    out.point_global.push(mesh.point_global[p as usize]);
                }
                out.face_points.push(*to);
            }
            out.face_start.push(out.face_points.len() as i32);
            out.face_owner.push(if owner >= 0 { owner } else { neighbour });
            if internal {
                out.face_neighbour.push(neighbour);
            }
        }
    }
    out
}
