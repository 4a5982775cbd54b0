//! Blocks of bricks against planes, spheres, edges and themselves.

use super::*;
use m4gn_mesh::elements::{ElementKind, Elements};
use m4gn_samples::bodies as sample;
use m4gn_samples::mesh::brick;
use proptest::prelude::*;

/// `n` unit bricks from `corner` on; points below `held` (z) are held.
fn block(n: [usize; 3], corner: Vector, held: f64) -> Body {
    let mut body = sample::block(n, n.map(|n| n as f64));
    for (x, kind) in body.positions.iter_mut().zip(&mut body.types) {
        (0..3).for_each(|i| x[i] += corner[i]);
        *kind = match x[2] < held {
            true => NodeType::Handle,
            false => NodeType::Body,
        };
    }
    body
}

/// Two blocks as one body.
fn both(a: Body, b: Body) -> Body {
    let shift = a.positions.len() as i32;
    let points = a.elements.points.iter().copied();
    let points = points.chain(b.elements.points.iter().map(|p| p + shift)).collect();
    Body {
        positions: [a.positions, b.positions].concat(),
        types: [a.types, b.types].concat(),
        material: [a.material, b.material].concat(),
        edges: [a.edges, b.edges.iter().map(|e| e.map(|p| p + shift)).collect()].concat(),
        elements: Elements::of_kind(ElementKind::Hexahedron, points),
    }
}

/// A box whose lower corner is `corner`.
fn obstacle(size: Vector, corner: Vector) -> Obstacle {
    let (points, triangles) = brick(size);
    let positions = points.iter().map(|p| std::array::from_fn(|i| p[i] + corner[i]));
    Obstacle { positions: positions.collect(), triangles }
}

/// An octahedron with each face cut into n^2, on a sphere.
fn sphere(radius: f64, centre: Vector, n: i32) -> Obstacle {
    let mut positions: Vec<Vector> = Vec::new();
    let mut point = |x: [i32; 3]| -> i32 {
        let v = x.map(f64::from);
        let on = std::array::from_fn(|i| centre[i] + radius * v[i] / norm(v));
        let same = |p: &Vector| norm(m4gn_mesh::vector::sub(*p, on)) < 1e-9 * radius;
        positions.iter().position(same).unwrap_or_else(|| {
            positions.push(on);
            positions.len() - 1
        }) as i32
    };
    let mut triangles = Vec::new();
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|i| if octant >> i & 1 == 0 { 1 } else { -1 });
        let mirrored = sign.iter().product::<i32>() < 0;
        let at = |i: i32, j: i32| [sign[0] * (n - i - j), sign[1] * i, sign[2] * j];
        for i in 0..n {
            for j in 0..n - i {
                let mut faces = vec![[at(i, j), at(i + 1, j), at(i, j + 1)]];
                if i + j + 2 <= n {
                    faces.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
                for face in faces {
                    let [a, b, c] = face.map(&mut point);
                    triangles.push(if mirrored { [a, c, b] } else { [a, b, c] });
                }
            }
        }
    }
    Obstacle { positions, triangles }
}

fn zeros(n: usize) -> Vec<Vector> {
    vec![[0.0; 3]; n]
}

fn apply(body: &Body, o: &Obstacle, u: &mut [Vector], shift: Vector) -> ProjectionReport {
    let mut projection = Projection::new(body, Some(o), &ProjectionOptions::default()).unwrap();
    let report = projection.apply(u, &vec![shift; o.positions.len()]).unwrap();
    check(body, u);
    report
}

/// Held points stay, cells are valid.
fn check(body: &Body, u: &[Vector]) {
    for (t, u) in body.types.iter().zip(u) {
        assert!(*t == NodeType::Body || *u == [0.0; 3]);
    }
    let volumes = body.elements.measures(&sum(&body.positions, u));
    assert!(volumes.iter().all(|v| *v > 0.0), "{volumes:?}");
}

/// A plate that covers the whole top comes down by 0.4: the top must follow by that much.
#[test]
fn a_block_under_a_plane() {
    let body = block([6, 6, 5], [0.0; 3], 0.5);
    let o = obstacle([8.0, 8.0, 2.0], [-1.0, -1.0, 5.1]);
    let mut u = zeros(body.positions.len());
    let report = apply(&body, &o, &mut u, [0.0, 0.0, -0.5]);
    let gap = report.before.unwrap().cells;
    assert!((gap + 0.4).abs() < 1e-12, "{report:?}");
    assert!(report.after.unwrap().cells >= -0.005, "{report:?}");
    assert_eq!(report.cells_pulled_back, 0);
    for (x, u) in body.positions.iter().zip(&u).filter(|(x, _)| x[2] == 5.0) {
        assert!(u[2] < -0.395 && u[2] > -0.5, "{x:?} {u:?}");
        // A plane pushes along its normal only
        assert!(u[0] == 0.0 && u[1] == 0.0);
    }
}

/// The deepest point goes as far as it must, its surroundings follow less and less, far away nothing moves.
#[test]
fn a_sphere_pressed_in() {
    let body = block([16, 16, 6], [-8.0, -8.0, 0.0], 0.5);
    let o = sphere(4.0, [0.0, 0.0, 10.5], 8);
    let mut u = zeros(body.positions.len());
    let report = apply(&body, &o, &mut u, [0.0, 0.0, -1.2]);
    assert!((report.before.unwrap().cells + 0.7).abs() < 0.01, "{report:?}");
    assert!(report.after.unwrap().cells >= -0.005, "{report:?}");
    assert!(report.sweeps <= 4, "{report:?}");
    let at = |x: Vector| u[body.positions.iter().position(|p| *p == x).unwrap()];
    let deep = at([0.0, 0.0, 6.0]);
    assert!((deep[2] + 0.71).abs() < 0.04, "{deep:?}");
    let below = at([0.0, 0.0, 4.0])[2];
    assert!(below < -0.1 && below > deep[2], "{below}");
    assert_eq!(at([8.0, 8.0, 6.0]), [0.0; 3]);
    assert!((report.largest - 0.7).abs() < 0.1 && report.points_moved > 50);
    // As symmetric as the case
    let (a, b) = (at([2.0, 1.0, 6.0]), at([-2.0, 1.0, 6.0]));
    assert!((a[0] + b[0]).abs() < 0.01 && (a[2] - b[2]).abs() < 0.02, "{a:?} {b:?}");
}

/// Deeper than a cell, by a box with sharp edges that is narrower than the block.
#[test]
fn a_sharp_edge_pressed_in_deep() {
    let body = block([16, 8, 6], [-8.0, -4.0, 0.0], 0.5);
    let o = obstacle([5.3, 12.0, 4.0], [-2.4, -6.0, 6.05]);
    for depth in [0.3, 0.8, 1.5] {
        let mut u = zeros(body.positions.len());
        let report = apply(&body, &o, &mut u, [0.0, 0.0, -0.05 - depth]);
        assert!(report.after.unwrap().cells >= -0.02, "{depth}: {report:?}");
        assert!(report.largest < depth + 0.35, "{depth}: {report:?}");
    }
}

#[test]
fn without_penetration_nothing_changes() {
    let body = block([3, 3, 3], [0.0; 3], 0.5);
    let o = obstacle([1.0; 3], [1.0, 1.0, 3.5]);
    let mut u: Vec<Vector> = (0..64).map(|i| [1e-3 * (i as f64).sin(), 0.0, 1e-4]).collect();
    let before = u.clone();
    let options = ProjectionOptions { self_contact: true, ..ProjectionOptions::default() };
    let mut projection = Projection::new(&body, Some(&o), &options).unwrap();
    let report = projection.apply(&mut u, &[[0.0, 0.0, -0.49]; 8]).unwrap();
    assert!(u.iter().flatten().map(|v| v.to_bits()).eq(before.iter().flatten().map(|v| v.to_bits())));
    assert_eq!((report.points_moved, report.largest, report.sweeps), (0, 0.0, 1));
    assert_eq!(report.before, report.after);
    // And without any obstacle
    let mut projection = Projection::new(&body, None, &ProjectionOptions::default()).unwrap();
    let report = projection.apply(&mut u, &[]).unwrap();
    assert_eq!((u, report.before), (before, None));
}

#[test]
fn clearance_is_kept() {
    let body = block([6, 6, 3], [0.0; 3], 0.5);
    let o = obstacle([2.0; 3], [2.0, 2.0, 3.1]);
    let options = ProjectionOptions { clearance: 0.1, ..ProjectionOptions::default() };
    let mut u = zeros(body.positions.len());
    let mut projection = Projection::new(&body, Some(&o), &options).unwrap();
    let report = projection.apply(&mut u, &[[0.0, 0.0, -0.2]; 8]).unwrap();
    assert!((report.after.unwrap().cells - 0.1).abs() < 0.01, "{report:?}");
    check(&body, &u);
}

/// Held points in the way: the obstacle stays in them, and the rest is moved as far as it can be.
#[test]
fn held_points_stay_where_they_are() {
    let body = block([4, 4, 2], [0.0; 3], 1.5);
    let o = obstacle([6.0, 6.0, 4.0], [-1.0, -1.0, 2.1]);
    let mut u = zeros(body.positions.len());
    let report = apply(&body, &o, &mut u, [0.0, 0.0, -1.5]);
    assert!(report.after.unwrap().cells < -0.4, "{report:?}");
    assert!(report.cells_pulled_back > 0, "{report:?}");
}

/// One block sinks into another that is a part of the same body: each gives way by half.
#[test]
fn two_blocks_of_one_body() {
    let body = both(block([5, 5, 4], [0.0; 3], 0.5), block([5, 5, 4], [0.0, 0.0, 4.2], -1.0));
    let n = body.positions.len() / 2;
    let mut u = zeros(2 * n);
    u[n..].iter_mut().for_each(|u| *u = [0.13, 0.08, -0.6]);
    let mut projection = Projection::new(&body, None, &ProjectionOptions::default()).unwrap();
    let start: Vec<Vector> =
        (0..2 * n).map(|p| std::array::from_fn(|i| body.positions[p][i] + u[p][i])).collect();
    let report = projection.apply(&mut u, &[]).unwrap();
    check(&body, &u);
    let gap = BetweenParts::new(&body).unwrap().gap(&start);
    assert_eq!(gap, report.own_before);
    assert!(BetweenParts::new(&block([2, 2, 2], [0.0; 3], 0.5)).is_none());
    assert!((report.own_before.unwrap().cells + 0.41).abs() < 0.02, "{report:?}");
    assert!(report.own_after.unwrap().cells >= -0.02, "{report:?}");
    let middle = |from: usize, z: f64| {
        let of = (from..from + n).filter(|&p| body.positions[p][2] == z && body.positions[p][0] == 2.0);
        let values: Vec<f64> = of.map(|p| u[p][2]).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let (lower, upper) = (middle(0, 4.0), middle(n, 4.2) + 0.6);
    assert!(lower < -0.1 && upper > 0.1 && (upper - lower - 0.4).abs() < 0.05, "{lower} {upper}");
    // Blocks that overlap at rest are refused.
    let body = both(block([5, 5, 4], [0.0; 3], 0.5), block([5, 5, 4], [0.0, 0.0, 3.8], -1.0));
    let error = check_start(&body, None).unwrap_err().to_string();
    assert!(error.contains("two parts of the body overlap at the start, 0.2"), "{error}");
}

/// A clamp: two arms of one part with a slit of one cell between them; the upper one bends into the lower one.
#[test]
fn two_arms_of_one_part() {
    let whole = block([6, 3, 5], [0.0; 3], 0.5);
    let e = &whole.elements;
    let open = |&e: &usize| (e % 6 < 2) || e / 18 != 2;
    let points = (0..e.len()).filter(open).flat_map(|k| e.points_of(k).iter().copied());
    let elements = Elements::of_kind(ElementKind::Hexahedron, points.collect());
    let body = Body {
        material: whole.material[..elements.len()].to_vec(),
        edges: elements.edges(),
        elements,
        ..whole
    };
    let bent = |x: &Vector| match x[2] > 2.5 && x[0] > 2.0 {
        true => [0.0, 0.0, -1.3 * (x[0] - 2.0) / 4.0],
        false => [0.0; 3],
    };
    let mut u: Vec<Vector> = body.positions.iter().map(bent).collect();
    let options = ProjectionOptions { self_contact: true, ..ProjectionOptions::default() };
    let mut projection = Projection::new(&body, None, &options).unwrap();
    let report = projection.apply(&mut u, &[]).unwrap();
    check(&body, &u);
    let before = report.own_before.unwrap().cells;
    assert!((before + 0.3).abs() < 0.05, "{report:?}");
    assert!(report.own_after.unwrap().cells >= -0.02, "{report:?}");
}

/// A block that is squeezed has no contact with itself.
#[test]
fn a_thin_body_does_not_meet_itself() {
    let body = block([8, 8, 1], [0.0; 3], -1.0);
    let options = ProjectionOptions { self_contact: true, ..ProjectionOptions::default() };
    let mut projection = Projection::new(&body, None, &options).unwrap();
    let mut u: Vec<Vector> = body.positions.iter().map(|x| [0.0, 0.0, -0.7 * x[2]]).collect();
    let before = u.clone();
    let report = projection.apply(&mut u, &[]).unwrap();
    assert!(report.own_before.is_none() && u == before, "{report:?}");
}

#[test]
fn what_does_not_fit_is_refused() {
    let body = block([2, 2, 2], [0.0; 3], 0.5);
    let o = obstacle([1.0; 3], [0.5, 0.5, 2.2]);
    let options = ProjectionOptions::default();
    let mut projection = Projection::new(&body, Some(&o), &options).unwrap();
    let mut u = zeros(27);
    let text = |r: Result<ProjectionReport>| r.unwrap_err().to_string();
    assert!(text(projection.apply(&mut u[1..], &zeros(8))).contains("26 points of the body, expected 27"));
    assert!(text(projection.apply(&mut u, &zeros(7))).contains("7 points of the obstacle, expected 8"));
    u[5][1] = f64::NAN;
    assert!(text(projection.apply(&mut u, &zeros(8))).contains("point 5 of the body"));
    let mut bad = zeros(8);
    bad[2][0] = f64::INFINITY;
    assert!(text(projection.apply(&mut zeros(27), &bad)).contains("point 2 of the obstacle"));

    let refused = |o: &Obstacle, options: &ProjectionOptions| {
        Projection::new(&body, Some(o), options).unwrap_err().to_string()
    };
    let around = refused(&obstacle([9.0; 3], [-3.0; 3]), &options);
    assert!(around.contains("contains the whole body") && around.contains("deep at"), "{around}");
    let over = refused(&obstacle([1.0; 3], [0.5, 0.5, 1.8]), &options);
    assert!(over.contains("overlaps the body at the start, 0.200 mean edges"), "{over}");
    // No sample of the skin is in it
    let within = refused(&obstacle([0.2; 3], [0.9; 3]), &options);
    assert!(within.contains("overlaps"), "{within}");
    let mut open = o.clone();
    open.triangles.pop();
    assert!(refused(&open, &options).contains("not closed"));
    for (bad, name) in [
        (ProjectionOptions { clearance: f64::NAN, ..options }, "clearance"),
        (ProjectionOptions { tolerance: 0.0, ..options }, "tolerance"),
        (ProjectionOptions { radius: 0.5, ..options }, "radius"),
        (ProjectionOptions { sweeps: 0, ..options }, "sweeps"),
    ] {
        assert!(refused(&o, &bad).contains(name));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    /// Spheres and boxes from above, anywhere, up to a cell deep, into a block whose prediction is rough.
    #[test]
    fn what_is_pressed_in_comes_out(x in -4.0..4.0f64, y in -4.0..4.0f64, depth in 0.0..1.0f64, round in any::<bool>(),
                                    noise in 0.0..0.1f64) {
        let body = block([10, 10, 6], [-5.0, -5.0, 0.0], 0.5);
        let o = match round {
            true => sphere(3.0, [x, y, 9.1 + noise], 6),
            false => obstacle([4.0, 3.0, 4.0], [x - 2.0, y - 1.5, 6.1 + noise]),
        };
        let mut u = zeros(body.positions.len());
        for (i, u) in u.iter_mut().enumerate().filter(|(i, _)| body.types[*i] == NodeType::Body) {
            *u = [1.0, 2.0, 3.0].map(|k| noise * (k * i as f64).sin());
        }
        let mut projection = Projection::new(&body, Some(&o), &ProjectionOptions::default()).unwrap();
        let report = projection.apply(&mut u, &vec![[0.0, 0.0, -depth - 0.1]; o.positions.len()]).unwrap();
        check(&body, &u);
        prop_assert!(report.after.unwrap().cells >= -0.02, "{report:?}");
        prop_assert!(report.largest < 2.0 * depth + 0.5, "{report:?}");
    }
}
