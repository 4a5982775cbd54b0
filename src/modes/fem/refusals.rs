//! Bad input is refused with the place named.

use super::sample::Kind;
use super::*;

fn good() -> (PointMesh, Vec<Material>, Vec<Fixed>) {
    let mesh = sample::block(Kind::Hexahedra, [3, 2, 2], [1.0, 1.0, 1.0]);
    let material = Material { young: 1e6, poisson: 0.3, density: 1000.0 };
    let materials = vec![material; mesh.n_cells];
    (mesh, materials, vec![Fixed::all(0), Fixed::all(1), Fixed::all(4)])
}

fn message(change: impl FnOnce(&mut PointMesh, &mut Vec<Material>, &mut Vec<Fixed>)) -> String {
    let (mut mesh, mut materials, mut fixed) = good();
    change(&mut mesh, &mut materials, &mut fixed);
    modes(&mesh, &materials, &fixed, &Options::default(), &Comm::serial()).expect_err("bad input").to_string()
}

#[test]
fn the_good_one_is_taken() {
    let (mesh, materials, fixed) = good();
    modes(&mesh, &materials, &fixed, &Options::default(), &Comm::serial()).unwrap();
}

#[test]
fn materials_out_of_range_are_refused() {
    for (poisson, text) in [
        (0.5, "0.5: expected a value above -1 and below 0.5"),
        (0.6, "0.6"),
        (-1.0, "-1: expected"),
        (f64::NAN, "NaN"),
        (0.5 - 1e-12, "within 1e-7 of 0.5"),
    ] {
        let found = message(|_, m, _| m[5].poisson = poisson);
        assert!(found.contains("Poisson's ratio of cell 5") && found.contains(text), "{found}");
    }
    for young in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let found = message(|_, m, _| m[0].young = young);
        assert!(found.contains("Young's modulus of cell 0") && found.contains("positive"), "{found}");
    }
    let found = message(|_, m, _| m[11].density = 0.0);
    assert!(found.contains("density of cell 11 is 0 kg/m^3"), "{found}");
    let found = message(|_, m, _| m.truncate(3));
    assert!(found.contains("3 materials for 12 cells"), "{found}");
}

#[test]
fn broken_meshes_are_refused() {
    let found = message(|m, _, _| m.points.swap(16, 17));
    assert!(found.contains("inverted"), "{found}");
    let found = message(|m, _, _| m.points[3][1] = f64::NAN);
    assert!(found.contains("points[3]"), "{found}");
    // Neither start plus 3 nor the difference of two starts is an i32
    for (f, start) in [(1, i32::MAX - 1), (1, i32::MIN)] {
        let found = message(|m, _, _| m.face_start[f] = start);
        assert!(found.contains("(face_start): expected at least 3"), "{found}");
    }
    let found = message(|m, _, _| m.face_points[6] = 99);
    assert!(found.contains("names point 99: expected 0 to 35"), "{found}");
    let found = message(|m, _, _| m.face_points[6] = -1);
    assert!(found.contains("names point -1"), "{found}");
    let found = message(|m, _, _| m.face_points[1] = m.face_points[0]);
    assert!(found.contains("twice"), "{found}");
    let found = message(|m, _, _| m.face_owner[2] = 12);
    assert!(found.contains("names cell 12: expected 0 to 11"), "{found}");
    let found = message(|m, _, _| m.face_owner[0] = m.face_neighbour[0]);
    assert!(found.contains("on both sides"), "{found}");
    // A face turned over, a face of another cell, a face missing.
    let found = message(|m, _, _| m.face_points[0..4].reverse());
    assert!(found.contains("do not turn the same way"), "{found}");
    let last = |m: &PointMesh| m.n_faces() - 1;
    let found = message(|m, _, _| {
        let f = last(m);
        m.face_owner[f] = 0;
    });
    assert!(found.contains("not a closed surface"), "{found}");
    let found = message(|m, _, _| {
        let f = last(m);
        m.face_owner.truncate(f);
        m.face_start.truncate(f + 1);
        m.face_points.truncate(4 * f);
    });
    assert!(found.contains("not a closed surface"), "{found}");
    let found = message(|m, _, _| m.point_global[3] = 4);
    assert!(found.contains("holds 4 twice") || found.contains("number 3"), "{found}");
    let found = message(|m, _, _| m.point_global[3] = i64::MAX);
    assert!(found.contains("point_global holds"), "{found}");
    let found = message(|m, _, _| {
        m.points.push([9.0, 9.0, 9.0]);
        m.point_global.push(36);
    });
    assert!(found.contains("number 36 belongs to no cell"), "{found}");
    let found = message(|m, _, _| m.directions = vec![0, 1]);
    assert!(found.contains("one cell thick"), "{found}");
    let found = message(|m, _, _| m.directions = vec![0]);
    assert!(found.contains("directions"), "{found}");
    let found = message(|m, t, f| {
        *m = PointMesh { directions: vec![0, 1, 2], face_start: vec![0], ..Default::default() };
        t.clear();
        f.clear();
    });
    assert!(found.contains("no cells"), "{found}");
}

#[test]
fn bodies_that_nothing_or_everything_holds_are_refused() {
    let found = message(|_, _, f| f.clear());
    assert!(found.contains("no displacement is held") && found.contains("patch"), "{found}");
    // At one point, and along a line: the body turns.
    for n in [1, 2] {
        let found = message(|_, _, f| f.truncate(n));
        assert!(found.contains("is not held"), "{n} points: {found}");
    }
    let found = message(|m, _, f| *f = (0..m.points.len() as i32).map(Fixed::all).collect());
    assert!(found.contains("all displacements"), "{found}");
    let found = message(|_, _, f| f.push(Fixed::all(36)));
    assert!(found.contains("fixed point 36: expected 0 to 35"), "{found}");
    let found = message(|_, _, f| f.push(Fixed::all(-1)));
    assert!(found.contains("fixed point -1"), "{found}");
}
