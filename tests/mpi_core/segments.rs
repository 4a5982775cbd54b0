//! Segments and their quality on several ranks against one, by every method, on random and broken-up meshes.

use super::checks::{Checks, compare_segments};
use m4gn_base::{Error, Result};
use m4gn_mesh::{BoundaryFace, Mesh, NodeType};
use m4gn_model::{SegmentMethod, SegmentSpec};
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Quality, Segmentation, obstacle_distance, obstacle_note, quality, segment};

pub fn check(checks: &mut Checks) {
    let mut draw = Draw(1);
    for round in 0..6 {
        let mesh = random_mesh(&mut draw, round);
        let ranks = random_ranks(&mut draw, mesh.n_cells(), checks.comm.size());
        for method in SegmentMethod::ALL {
            for connected in [true, false] {
                let spec = SegmentSpec {
                    method,
                    connected,
                    count: 2 + draw.below(mesh.n_cells() / 3),
                    modes: draw.below(6),
                    tau: [0.0, 0.5, 1.0, 3.0][draw.below(4)],
                    iterations: draw.below(8),
                    ..Default::default()
                };
                one(checks, &format!("mesh {round}, {method}"), &mesh, &ranks, &spec);
            }
        }
    }
    obstacles(checks);
    quality_of_many_cells(checks);
    errors(checks);
}

/// One segmentation, whole and in parts: the same; never empty, and connected where asked.
fn one(checks: &mut Checks, name: &str, mesh: &Mesh, ranks: &[i32], spec: &SegmentSpec) {
    let comm = checks.comm.clone();
    let name = format!("{name}, {} of {} cells, connected {}", spec.count, mesh.n_cells(), spec.connected);
    let expected = solve(mesh, spec, &Comm::serial());
    let part = sample::part(mesh, ranks, comm.rank());
    let found = solve(&part, spec, &comm);
    let ((found, found_quality), (expected, expected_quality)) = match (found, expected) {
        (Ok(found), Ok(expected)) => (found, expected),
        (Err(f), Err(e)) => {
            let same = f.to_string().contains(&e.to_string());
            return checks.that(same, format!("{name}: error '{f}', expected '{e}'"));
        }
        (f, e) => {
            return checks.that(false, format!("{name}: {:?}, expected {:?}", f.err(), e.err()));
        }
    };
    compare_segments(checks, &name, &part, mesh, &found, &expected);
    checks.that(
        (&found.sweeps, found.moved, found.reassigned)
            == (&expected.sweeps, expected.moved, expected.reassigned),
        format!("{name}: the way to the answer"),
    );
    checks.that(
        found_quality == expected_quality,
        format!("{name}: {found_quality:?}, expected {expected_quality:?}"),
    );
    if spec.connected {
        let pieces = sample::pieces(mesh, &expected.node_segment);
        checks.that(pieces == spec.count, format!("{name}: {pieces} pieces"));
    }
}

fn solve(mesh: &Mesh, spec: &SegmentSpec, comm: &Comm) -> Result<(Segmentation, Quality)> {
    let mut graph = Graph::new(mesh, comm)?;
    let found = segment(mesh, &mut graph, spec, &Modal::default(), comm, None)?;
    let labels = &found.node_segment[..mesh.n_cells()];
    let quality = quality(mesh, &mut graph, labels, spec.count, comm)?;
    Ok((found, quality))
}

/// Random numbers that all ranks draw alike (a 64-bit linear congruence).
struct Draw(u64);

impl Draw {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as usize % n.max(1)
    }
}

/// Meshes of all kinds, some with faces taken out so that they fall apart.
fn random_mesh(draw: &mut Draw, kind: usize) -> Mesh {
    let mut mesh = match kind % 3 {
        0 => sample::triangles(4 + draw.below(6), 4 + draw.below(4), 1.6, 0.7),
        1 => sample::rectangle(6 + draw.below(8), 5 + draw.below(5), 2.0, 1.0),
        _ => sample::block([3 + draw.below(3), 4, 3], [1.0, 0.9, 0.7]),
    };
    if kind >= 3 {
        let kept: Vec<bool> = mesh.face_owner.iter().map(|_| draw.below(10) < 6).collect();
        let keep = |at: usize| kept[at];
        mesh.face_owner = pick(&mesh.face_owner, keep);
        mesh.face_neighbour = pick(&mesh.face_neighbour, keep);
        mesh.face_coeff = pick(&mesh.face_coeff, keep);
    }
    mesh
}

fn pick<T: Copy>(all: &[T], keep: impl Fn(usize) -> bool) -> Vec<T> {
    (0..all.len()).filter(|&i| keep(i)).map(|i| all[i]).collect()
}

/// Any rank for any cell; rank 0 of several has none.
fn random_ranks(draw: &mut Draw, n: usize, size: i32) -> Vec<i32> {
    (0..n).map(|_| (size - 1).min(1 + draw.below((size - 1).max(1) as usize) as i32)).collect()
}

/// Distances to what lies on other ranks, bit by bit.
fn obstacles(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let mut mesh = sample::triangles(11, 9, 1.6, 1.0);
    let (middle, global) = (mesh.n_cells() / 2, mesh.boundary.len() as i64);
    let inner = |k: i64| BoundaryFace {
        owner: (middle as i64 + k) as i32,
        global: global + k,
        centre: [0.8 + 0.02 * k as f64, 0.5, 0.0],
        ..mesh.boundary[0].clone()
    };
    let hole: Vec<BoundaryFace> = (0..5).map(inner).collect();
    mesh.boundary.extend(hole);
    for (i, b) in mesh.boundary.iter_mut().enumerate() {
        if i % 5 == 0 {
            b.kind = NodeType::Obstacle;
        }
    }
    let mut draw = Draw(7);
    let ranks = random_ranks(&mut draw, mesh.n_cells(), comm.size());
    let part = sample::part(&mesh, &ranks, comm.rank());
    // Without faces of the type obstacle: the pieces of walls.
    let mut walls = mesh.clone();
    walls.boundary.iter_mut().for_each(|b| b.kind = NodeType::Wall);
    walls.boundary.retain(|b| b.centre[0] > 0.0 || b.centre[1] > 0.5);
    (0..).zip(&mut walls.boundary).for_each(|(i, b)| b.global = i);
    let note = |mesh: &Mesh, comm: &Comm| obstacle_note(mesh, &[], comm);
    let found = checks.value(note(&sample::part(&walls, &ranks, comm.rank()), &comm), "pieces");
    let expected = checks.value(note(&walls, &Comm::serial()), "pieces, whole");
    checks.that(found == expected, format!("the obstacle is {found:?}, expected {expected:?}"));
    for names in [&[][..], &["outlet".to_string()]] {
        let Some(found) = checks.value(obstacle_distance(&part, names, &comm), "obstacle") else {
            continue;
        };
        let serial = Comm::serial();
        let Some(expected) = checks.value(obstacle_distance(&mesh, names, &serial), "obstacle, whole") else {
            continue;
        };
        let same = part.cell_global.iter().zip(&found).all(|(&g, d)| expected[g as usize] == *d);
        checks.that(same, format!("distances to {names:?}"));
    }
    // Every rank hears of patches that no rank has.
    let error = obstacle_distance(&part, &["cylinder".to_string()], &comm);
    let named = |m: &str| m.contains("expected some of the patches inlet, outlet, walls");
    checks.that(
        matches!(&error, Err(Error::Input(m)) if named(m)),
        format!("an obstacle that is not there: {error:?}"),
    );
}

/// Above 20,000 cells the silhouette is that of a sample, the same for any ranks and close to the exact one.
fn quality_of_many_cells(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let (nx, ny) = (210, 100);
    let mesh = sample::rectangle(nx, ny, 2.1, 1.0);
    let ranks = sample::strips(mesh.n_cells(), comm.size());
    let part = sample::part(&mesh, &ranks, comm.rank());
    // 21 squares of 10 x 10... blocks of 30 x 25 cells, K = 28.
    let label = |g: usize| (g % nx / 30 + 7 * (g / nx / 25)) as i32;
    let labels: Vec<i32> = part.cell_global.iter().map(|&g| label(g as usize)).collect();
    let whole: Vec<i32> = (0..mesh.n_cells()).map(label).collect();
    let of = |mesh: &Mesh, labels: &[i32], comm: &Comm| {
        let mut graph = Graph::new(mesh, comm)?;
        quality(mesh, &mut graph, labels, 28, comm)
    };
    let found = checks.value(of(&part, &labels, &comm), "quality");
    let expected = checks.value(of(&mesh, &whole, &Comm::serial()), "quality, whole");
    checks.that(found == expected, format!("quality {found:?}, expected {expected:?}"));
    let cells = found.map_or(0, |q| q.silhouette_cells);
    checks.that((3500..4500).contains(&cells), format!("a sample of {cells} cells"));
}

/// What cannot be done is said on every rank.
fn errors(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let mut mesh = sample::rectangle(6, 4, 1.5, 1.0);
    // Two halves that no face joins.
    let keep: Vec<bool> =
        mesh.face_owner.iter().zip(&mesh.face_neighbour).map(|(a, b)| !(a % 6 == 2 && b % 6 == 3)).collect();
    mesh.face_owner = pick(&mesh.face_owner, |f| keep[f]);
    mesh.face_neighbour = pick(&mesh.face_neighbour, |f| keep[f]);
    mesh.face_coeff = pick(&mesh.face_coeff, |f| keep[f]);
    let part = sample::part(&mesh, &sample::strips(24, comm.size()), comm.rank());
    let spec = |count, connected| SegmentSpec { count, connected, modes: 3, ..Default::default() };
    let apart = solve(&part, &spec(1, true), &comm);
    let said = apart.as_ref().is_err_and(|e| e.to_string().contains("2 components that no face joins"));
    checks.that(said, format!("one connected segment of two components: {:?}", apart.err()));
    for (count, connected) in [(1, false), (2, true), (5, true)] {
        let found = solve(&part, &spec(count, connected), &comm);
        checks.value(found, &format!("{count} segments of two components"));
    }
    // More modes than there are: an error on every rank, and none where nothing is refined.
    let many = |count| SegmentSpec { count, modes: 24, connected: false, ..Default::default() };
    checks.that(matches!(solve(&part, &many(3), &comm), Err(Error::Input(_))), "24 modes of 24 cells");
    for count in [1, 24] {
        checks.value(solve(&part, &many(count), &comm), "no modes are needed");
    }
    let two = sample::chain(2, 1.0);
    let part = sample::part(&two, &sample::strips(2, comm.size()), comm.rank());
    for count in 1..4 {
        let found = solve(&part, &spec(count, true), &comm);
        checks.that(found.is_ok() == (count < 3), format!("{count} segments of two cells"));
    }
}
