//! Bad input is refused with the place named.

use super::sample::Kind;
use super::*;

fn good() -> (PointMesh, Vec<Material>, Vec<Fixed>) {
    let mesh = sample::block(Kind::Hexahedra, [3, 2, 2], [1.0, 1.0, 1.0]);
    let material = Material { young: 1e6, poisson: 0.3, density: 1000.0 };
    let materials = vec![material; mesh.n_cells];
    (mesh, materials, vec![Fixed::all(0), Fixed::all(1), Fixed::all(4)])
}

type Change = fn(&mut PointMesh, &mut Vec<Material>, &mut Vec<Fixed>);

/// Each change is refused with all of these words, which are separated by `|`.
fn refused(cases: &[(Change, &str)]) {
    for (change, words) in cases {
        let (mut mesh, mut materials, mut fixed) = good();
        change(&mut mesh, &mut materials, &mut fixed);
        let found = modes(&mesh, &materials, &fixed, &Options::default(), &Comm::serial());
        let found = found.expect_err(words).to_string();
        assert!(words.split('|').all(|word| found.contains(word)), "{words}: {found}");
    }
}

#[test]
fn the_good_one_is_taken() {
    let (mesh, materials, fixed) = good();
    modes(&mesh, &materials, &fixed, &Options::default(), &Comm::serial()).unwrap();
}

#[test]
fn materials_out_of_range_are_refused() {
    refused(&[
        (
            |_, m, _| m[5].poisson = 0.5,
            "Poisson's ratio of cell 5|0.5: expected a value above -1 and below 0.5",
        ),
        (|_, m, _| m[5].poisson = 0.6, "Poisson's ratio of cell 5|0.6"),
        (|_, m, _| m[5].poisson = -1.0, "Poisson's ratio of cell 5|-1: expected"),
        (|_, m, _| m[5].poisson = f64::NAN, "Poisson's ratio of cell 5|NaN"),
        (|_, m, _| m[5].poisson = 0.5 - 1e-12, "Poisson's ratio of cell 5|within 1e-7 of 0.5"),
        (|_, m, _| m[0].young = 0.0, "Young's modulus of cell 0|positive"),
        (|_, m, _| m[0].young = -1.0, "Young's modulus of cell 0|positive"),
        (|_, m, _| m[0].young = f64::NAN, "Young's modulus of cell 0|positive"),
        (|_, m, _| m[0].young = f64::INFINITY, "Young's modulus of cell 0|positive"),
        (|_, m, _| m[11].density = 0.0, "density of cell 11 is 0 kg/m^3"),
        (|_, m, _| m.truncate(3), "3 materials for 12 cells"),
    ]);
}

#[test]
fn broken_meshes_are_refused() {
    refused(&[
        (|m, _, _| m.points.swap(16, 17), "inverted"),
        (|m, _, _| m.points[3][1] = f64::NAN, "points[3]"),
        // Neither start plus 3 nor the difference of two starts is an i32
        (|m, _, _| m.face_start[1] = i32::MAX - 1, "(face_start): expected at least 3"),
        (|m, _, _| m.face_start[1] = i32::MIN, "(face_start): expected at least 3"),
        (|m, _, _| m.face_points[6] = 99, "names point 99: expected 0 to 35"),
        (|m, _, _| m.face_points[6] = -1, "names point -1"),
        (|m, _, _| m.face_points[1] = m.face_points[0], "twice"),
        (|m, _, _| m.face_owner[2] = 12, "names cell 12: expected 0 to 11"),
        (|m, _, _| m.face_owner[0] = m.face_neighbour[0], "on both sides"),
        // A face turned over, a face of another cell, a face missing.
        (|m, _, _| m.face_points[0..4].reverse(), "do not turn the same way"),
        (|m, _, _| *m.face_owner.last_mut().unwrap() = 0, "not a closed surface"),
        (
            |m, _, _| {
                let f = m.n_faces() - 1;
                m.face_owner.truncate(f);
                m.face_start.truncate(f + 1);
                m.face_points.truncate(4 * f);
            },
            "not a closed surface",
        ),
        // It is held twice, and 3 by no rank, which is what is said.
        (|m, _, _| m.point_global[3] = 4, "global number 3: expected each"),
        (|m, _, _| m.point_global[3] = i64::MAX, "point_global holds"),
        (
            |m, _, _| {
                m.points.push([9.0, 9.0, 9.0]);
                m.point_global.push(36);
            },
            "number 36 belongs to no cell",
        ),
        (|m, _, _| m.directions = vec![0, 1], "one cell thick"),
        (|m, _, _| m.directions = vec![0], "directions"),
        (
            |m, t, f| {
                *m = PointMesh { directions: vec![0, 1, 2], face_start: vec![0], ..Default::default() };
                t.clear();
                f.clear();
            },
            "no cells",
        ),
    ]);
}

#[test]
fn bodies_that_nothing_or_everything_holds_are_refused() {
    refused(&[
        (|_, _, f| f.clear(), "no displacement is held|patch"),
        // At one point, and along a line: the body turns.
        (|_, _, f| f.truncate(1), "is not held"),
        (|_, _, f| f.truncate(2), "is not held"),
        (|m, _, f| *f = (0..m.points.len() as i32).map(Fixed::all).collect(), "all displacements"),
        (|_, _, f| f.push(Fixed::all(36)), "fixed point 36: expected 0 to 35"),
        (|_, _, f| f.push(Fixed::all(-1)), "fixed point -1"),
    ]);
}
