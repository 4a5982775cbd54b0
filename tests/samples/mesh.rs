//! Sample meshes with answers known on paper: rectangles of quads or triangles, blocks, chains, rings, and
//! their decompositions.
//!
//! Coefficients are those of the finite-volume Laplacian, face area over distance of the centres.

pub use m4gn_mesh::block::block;
use m4gn_mesh::block::{boundary, empty, face};
use m4gn_mesh::body::{Body, Material};
use m4gn_mesh::elements::{ElementKind, Elements};
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{BoundaryFace, CoupledFace, Mesh, NodeType};

/// `nx x ny` quads on `[0, lx] x [0, ly]`, 1 m thick; cell (i, j) is `i + nx * j`. Inlet at x = 0, outlet at
/// x = lx, walls at y = 0 and y = ly.
pub fn rectangle(nx: usize, ny: usize, lx: f64, ly: f64) -> Mesh {
    let mut mesh = block([nx, ny, 1], [lx, ly, 1.0]);
    mesh.directions = vec![0, 1];
    // The front and back are `empty`: no values there.
    mesh.boundary.retain(|b| b.area[2] == 0.0);
    for (i, b) in mesh.boundary.iter_mut().enumerate() {
        b.global = i as i64;
        b.centre[2] = 0.0;
    }
    for c in &mut mesh.cell_centres {
        c[2] = 0.0;
    }
    mesh
}

/// The rectangle with each quad cut along its diagonal: cells `2 q` (below) and `2 q + 1` (above) of quad q.
pub fn triangles(nx: usize, ny: usize, lx: f64, ly: f64) -> Mesh {
    let (hx, hy) = (lx / nx as f64, ly / ny as f64);
    let mut mesh = empty(vec![0, 1]);
    for q in 0..nx * ny {
        let (x, y) = ((q % nx) as f64 * hx, (q / nx) as f64 * hy);
        for third in [1.0 / 3.0, 2.0 / 3.0] {
            mesh.cell_global.push(mesh.cell_global.len() as i64);
            mesh.cell_centres.push([x + (1.0 - third) * hx, y + third * hy, 0.0]);
            mesh.cell_volumes.push(hx * hy / 2.0);
        }
    }
    for q in 0..nx * ny {
        let (i, j) = (q % nx, q / nx);
        let (below, above) = (2 * q, 2 * q + 1);
        let (x, y) = (i as f64 * hx, j as f64 * hy);
        let distance = |m: &Mesh, a: usize, b: usize| {
            let (a, b) = (m.cell_centres[a], m.cell_centres[b]);
            (a[0] - b[0]).hypot(a[1] - b[1])
        };
        let d = distance(&mesh, below, above);
        face(&mut mesh, below, above, hx.hypot(hy) / d);
        if i + 1 < nx {
            let d = distance(&mesh, below, above + 2);
            face(&mut mesh, below, above + 2, hy / d);
        } else {
            boundary(&mut mesh, below, [lx, y + hy / 2.0, 0.0], [hy, 0.0, 0.0], 3.0 * hy / hx, 1);
        }
        if i == 0 {
            boundary(&mut mesh, above, [0.0, y + hy / 2.0, 0.0], [-hy, 0.0, 0.0], 3.0 * hy / hx, 0);
        }
        if j + 1 < ny {
            let d = distance(&mesh, above, below + 2 * nx);
            face(&mut mesh, above, below + 2 * nx, hx / d);
        } else {
            boundary(&mut mesh, above, [x + hx / 2.0, ly, 0.0], [0.0, hx, 0.0], 3.0 * hx / hy, 2);
        }
        if j == 0 {
            boundary(&mut mesh, below, [x + hx / 2.0, 0.0, 0.0], [0.0, -hx, 0.0], 3.0 * hx / hy, 2);
        }
    }
    mesh
}

/// A chain of n cells on `[0, length]` with an inlet and an outlet and nothing else, 1 m^2 across.
///
/// Its Laplacian has the eigenvalues 4 / h^2 sin^2(k pi / (2 n)), k = 1 to n, h = length / n.
pub fn chain(n: usize, length: f64) -> Mesh {
    let mut mesh = rectangle(n, 1, length, 1.0);
    mesh.boundary.retain(|b| b.patch != 2);
    for (i, b) in mesh.boundary.iter_mut().enumerate() {
        b.global = i as i64;
    }
    mesh
}

/// A disk in polar cells: `rings` rings of `sectors` >= 3 each, cell (i, j) is `i * sectors + j` from the centre out,
/// 1 m thick, a wall around it.
///
/// Faces are arcs and radii: lines between centres cross them at right angles and in the middle, so that coefficients
/// (face length over distance along the grid lines) are consistent and the Laplacian is of second order. Innermost
/// cells have no face at the centre, whose length is 0.
pub fn disk(rings: usize, sectors: usize, radius: f64) -> Mesh {
    let (dr, da) = (radius / rings as f64, std::f64::consts::TAU / sectors as f64);
    let mut mesh = empty(vec![0, 1]);
    for c in 0..rings * sectors {
        let (r, a) = (((c / sectors) as f64 + 0.5) * dr, ((c % sectors) as f64 + 0.5) * da);
        mesh.cell_global.push(c as i64);
        mesh.cell_centres.push([r * a.cos(), r * a.sin(), 0.0]);
        mesh.cell_volumes.push(r * da * dr);
    }
    for c in 0..rings * sectors {
        let (i, j) = (c / sectors, c % sectors);
        let r = (i as f64 + 0.5) * dr;
        let beside = i * sectors + (j + 1) % sectors;
        face(&mut mesh, c.min(beside), c.max(beside), dr / (r * da));
        let outer = (i + 1) as f64 * dr * da;
        if i + 1 < rings {
            face(&mut mesh, c, c + sectors, outer / dr);
        } else {
            let (sin, cos) = ((j as f64 + 0.5) * da).sin_cos();
            boundary(
                &mut mesh,
                c,
                [radius * cos, radius * sin, 0.0],
                [outer * cos, outer * sin, 0.0],
                2.0 * outer / dr,
                2,
            );
        }
    }
    mesh
}

/// A ring of n >= 3 cells of volume 1 on a circle, coefficients 1, without boundary: a singular Laplacian.
pub fn ring(n: usize, radius: f64) -> Mesh {
    let mut mesh = empty(vec![0, 1]);
    for c in 0..n {
        let angle = std::f64::consts::TAU * c as f64 / n as f64;
        mesh.cell_global.push(c as i64);
        mesh.cell_centres.push([radius * angle.cos(), radius * angle.sin(), 0.0]);
        mesh.cell_volumes.push(1.0);
    }
    for c in 0..n {
        face(&mut mesh, c.min((c + 1) % n), c.max((c + 1) % n), 1.0);
    }
    mesh
}

/// Joins inlet and outlet of a [`rectangle`] by a translational cyclic over the length `lx`.
pub fn make_cyclic(mesh: &mut Mesh, lx: f64) {
    let (ends, rest): (Vec<_>, Vec<_>) = mesh.boundary.drain(..).partition(|b| b.patch < 2);
    mesh.boundary = rest;
    for (i, b) in mesh.boundary.iter_mut().enumerate() {
        b.global = i as i64;
    }
    for a in &ends {
        for b in &ends {
            if a.patch != b.patch && (a.centre[1] - b.centre[1]).abs() < 1e-9 {
                let (from, to) = (mesh.cell_centres[a.owner as usize], mesh.cell_centres[b.owner as usize]);
                let shift = if a.patch == 0 { -lx } else { lx };
                mesh.coupled.push(CoupledFace {
                    owner: a.owner,
                    rank: 0,
                    global: mesh.cell_global[b.owner as usize],
                    delta: [to[0] - from[0] + shift, to[1] - from[1], to[2] - from[2]],
                    coeff: a.coeff / 2.0,
                });
            }
        }
    }
}

/// 0 to n - 1 in an order that hangs on the seed.
pub fn shuffled(n: usize, seed: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..n).collect();
    let mut x = seed;
    for i in (1..n).rev() {
        x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        order.swap(i, (x >> 33) as usize % (i + 1));
    }
    order
}

/// The same undecomposed mesh with cells, faces and boundary faces in other orders, and internal faces seen from either side; and of each of its cells and boundary faces the
/// number before.
pub fn renumbered(mesh: &Mesh, seed: u64) -> (Mesh, [Vec<usize>; 2]) {
    let cells = shuffled(mesh.n_cells(), seed);
    let faces = shuffled(mesh.face_owner.len(), seed + 1);
    let boundary = shuffled(mesh.boundary.len(), seed + 2);
    let coupled = shuffled(mesh.coupled.len(), seed + 3);
    let mut new = vec![0i32; cells.len()];
    (0..).zip(&cells).for_each(|(to, &from)| new[from] = to);
    let of = |list: &[i32], f: usize| new[list[f] as usize];
    let ends = |f: &usize| {
        let ends = [of(&mesh.face_owner, *f), of(&mesh.face_neighbour, *f)];
        if f.is_multiple_of(3) { [ends[1], ends[0]] } else { ends }
    };
    let out = Mesh {
        cell_global: (0..cells.len() as i64).collect(),
        cell_centres: cells.iter().map(|&c| mesh.cell_centres[c]).collect(),
        cell_volumes: cells.iter().map(|&c| mesh.cell_volumes[c]).collect(),
        face_owner: faces.iter().map(|f| ends(f)[0]).collect(),
        face_neighbour: faces.iter().map(|f| ends(f)[1]).collect(),
        face_coeff: faces.iter().map(|&f| mesh.face_coeff[f]).collect(),
        boundary: (0..)
            .zip(&boundary)
            .map(|(global, &b)| BoundaryFace {
                owner: new[mesh.boundary[b].owner as usize],
                global,
                ..mesh.boundary[b].clone()
            })
            .collect(),
        coupled: coupled
            .iter()
            .map(|&c| CoupledFace {
                owner: new[mesh.coupled[c].owner as usize],
                global: i64::from(new[mesh.coupled[c].global as usize]),
                ..mesh.coupled[c].clone()
            })
            .collect(),
        ..mesh.clone()
    };
    (out, [cells, boundary])
}

/// The mesh with the walls and inlets of boundary cells at these cells' places, as meshes of points have them.
pub fn at_points(mut mesh: Mesh) -> Mesh {
    for face in &mut mesh.boundary {
        if matches!(face.kind, NodeType::Wall | NodeType::Inlet) {
            face.centre = mesh.cell_centres[face.owner as usize];
        }
    }
    mesh
}

/// The rank of each cell when `n_cells` are dealt out in `size` consecutive runs of nearly equal length.
pub fn strips(n_cells: usize, size: i32) -> Vec<i32> {
    (0..n_cells).map(|c| (c * size as usize / n_cells) as i32).collect()
}

/// Ways to deal cells to ranks: strips, one by one (every cell at a rank boundary), and all to the last rank.
pub fn deals(n: usize, size: i32) -> Vec<(&'static str, Vec<i32>)> {
    vec![
        ("strips", strips(n, size)),
        ("one by one", (0..n).map(|c| c as i32 % size).collect()),
        ("all on the last rank", vec![size - 1; n]),
    ]
}

/// The part of an undecomposed mesh that rank `rank` has, when cell c belongs to rank `ranks[c]`.
pub fn part(mesh: &Mesh, ranks: &[i32], rank: i32) -> Mesh {
    let mut local = vec![-1i32; mesh.n_cells()];
    let mut out = empty(mesh.directions.clone());
    out.patches = mesh.patches.clone();
    for c in (0..mesh.n_cells()).filter(|&c| ranks[c] == rank) {
        local[c] = out.cell_global.len() as i32;
        out.cell_global.push(mesh.cell_global[c]);
        out.cell_centres.push(mesh.cell_centres[c]);
        out.cell_volumes.push(mesh.cell_volumes[c]);
    }
    for f in 0..mesh.face_owner.len() {
        let (a, b) = (mesh.face_owner[f] as usize, mesh.face_neighbour[f] as usize);
        if ranks[a] == rank && ranks[b] == rank {
            face(&mut out, local[a] as usize, local[b] as usize, mesh.face_coeff[f]);
            continue;
        }
        for (here, there) in [(a, b), (b, a)] {
            if ranks[here] == rank {
                let (p, q) = (mesh.cell_centres[here], mesh.cell_centres[there]);
                out.coupled.push(CoupledFace {
                    owner: local[here],
                    rank: ranks[there],
                    global: mesh.cell_global[there],
                    delta: [q[0] - p[0], q[1] - p[1], q[2] - p[2]],
                    coeff: mesh.face_coeff[f],
                });
            }
        }
    }
    for b in mesh.boundary.iter().filter(|b| ranks[b.owner as usize] == rank) {
        out.boundary.push(BoundaryFace { owner: local[b.owner as usize], ..b.clone() });
    }
    for c in mesh.coupled.iter().filter(|c| ranks[c.owner as usize] == rank) {
        let there = mesh.cell_global.iter().position(|&g| g == c.global).unwrap_or(0);
        out.coupled.push(CoupledFace { owner: local[c.owner as usize], rank: ranks[there], ..c.clone() });
    }
    out
}

/// A bar of `n` unit cubes along x, held at x = 0.
pub fn bar(n: usize) -> Body {
    let corner = |p: usize| [p / 4, p % 2, p / 2 % 2].map(|v| v as f64);
    let positions: Vec<Vector> = (0..4 * (n + 1)).map(corner).collect();
    let cube = |i: usize| [0, 4, 5, 1, 2, 6, 7, 3].map(|p| (4 * i + p) as i32);
    let elements = Elements::of_kind(ElementKind::Hexahedron, (0..n).flat_map(cube).collect());
    let material = Material { young: 1e6, poisson: 0.3, density: 1000.0 };
    let kind = |p: usize| if p < 4 { NodeType::Handle } else { NodeType::Body };
    Body {
        types: (0..positions.len()).map(kind).collect(),
        material: vec![material; n],
        edges: elements.edges(),
        elements,
        positions,
    }
}

/// The closed surface of a box from 0 to `size`: points and triangles, normals outward.
pub fn brick(size: Vector) -> (Vec<Vector>, Vec<[i32; 3]>) {
    let points = (0..8i32).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from));
    let points = points.map(|p| std::array::from_fn(|i| p[i] * size[i])).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    (points, triangles)
}

/// Velocity and pressure of a vortex in a uniform flow.
pub fn flow(x: [f64; 3], centre: [f64; 2]) -> ([f32; 2], f32) {
    let r = [x[0] - centre[0], x[1] - centre[1]];
    let swirl = (-8.0 * (r[0] * r[0] + r[1] * r[1])).exp();
    ([(1.0 - 3.0 * swirl * r[1]) as f32, (3.0 * swirl * r[0]) as f32], -swirl as f32)
}

/// Connected pieces of equal segments of an undecomposed mesh, by merging labels until nothing changes.
pub fn pieces(mesh: &Mesh, segment: &[i32]) -> usize {
    let mut piece: Vec<usize> = (0..mesh.n_cells()).collect();
    let mut links: Vec<(usize, usize)> =
        mesh.face_owner.iter().zip(&mesh.face_neighbour).map(|(&a, &b)| (a as usize, b as usize)).collect();
    links.extend(mesh.coupled.iter().map(|c| (c.owner as usize, c.global as usize)));
    links.retain(|&(a, b)| segment[a] == segment[b]);
    loop {
        let before = piece.clone();
        for &(a, b) in &links {
            let low = piece[a].min(piece[b]);
            (piece[a], piece[b]) = (low, low);
        }
        if piece == before {
            break;
        }
    }
    piece.sort_unstable();
    piece.dedup();
    piece.len()
}
