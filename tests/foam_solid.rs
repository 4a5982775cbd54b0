//! What the bridge to OpenFOAM says of solids, on a cube of two cells: the force on a patch, and where correctors end.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

use crate::common::{alone, cube, field, near, note, put};
use m4gn_samples::fails;
use m4gn_workbench::foam_case::{FoamCase, Reaction, Unknown};
use std::{fs, path::Path};
use tempfile::TempDir;

fn open(case: &Path) -> m4gn_base::Result<FoamCase> {
    FoamCase::open(case)
}

/// Centres of the boundary faces of the cube, patch by patch: inlet, outlet, body, sides.
const CENTRES: [(&str, &[[f64; 3]]); 4] = [
    ("inlet", &[[0.0, 0.5, 0.5]]),
    ("outlet", &[[1.0, 0.5, 0.5]]),
    ("body", &[[0.25, 0.0, 0.5], [0.75, 0.0, 0.5], [0.25, 1.0, 0.5], [0.75, 1.0, 0.5]]),
    ("sides", &[[0.25, 0.5, 0.0], [0.75, 0.5, 0.0], [0.25, 0.5, 1.0], [0.75, 0.5, 1.0]]),
];

/// Writes a field of a solid with these values at its places.
fn solid_field(case: &Path, time: &str, name: &str, kind: &str, of: &dyn Fn([f64; 3]) -> String) {
    let patches = CENTRES.map(|(patch, centres)| {
        let values: Vec<String> = centres.iter().map(|c| of(*c)).collect();
        let n = values.len();
        format!("{patch}{{type calculated; value nonuniform List<{kind}> {n}({});}} ", values.join(" "))
    });
    let cells = [of([0.25, 0.5, 0.5]), of([0.75, 0.5, 0.5])];
    field(case, time, name, [&cells[0], &cells[1]], &patches.concat());
}

/// A cube in the uniform stress xx 7, xy 2, xz 3, yy -1, yz 0.5, zz 4 Pa at time 1.
fn stressed(case: &Path) {
    cube(case, false, "patch");
    solid_field(case, "1", "sigma", "symmTensor", &|_| "(7 2 3 -1 0.5 4)".into());
}

fn force(case: &mut FoamCase, patch: &str) -> [f64; 3] {
    match case.reaction(patch, 0).unwrap() {
        Reaction::Force(force) => force,
        other => panic!("{patch}: {other:?}"),
    }
}

#[test]
fn reaction_of_a_uniform_stress() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    stressed(dir.path());
    let mut case = open(dir.path()).unwrap();
    // The row of the stress along the normal, times an area of 1
    assert!(near(force(&mut case, "outlet"), [7.0, 2.0, 3.0]));
    assert!(near(force(&mut case, "inlet"), [-7.0, -2.0, -3.0]));
    // Opposite faces are in equilibrium
    assert!(near(force(&mut case, "body"), [0.0; 3]));
    fails(case.reaction("wing", 0), &["wing", "outlet"]);

    // A model of solids4foam for small strains does not look at D
    let linear = "solidModel linearGeometryTotalDisplacement;";
    put(dir.path(), "constant/solidProperties", "dictionary", linear);
    solid_field(dir.path(), "1", "D", "vector", &|c| format!("({} 0 0)", c[0]));
    assert!(near(force(&mut open(dir.path()).unwrap(), "outlet"), [7.0, 2.0, 3.0]));
}

/// x is stretched by 1.5, sheared by 0.25 along y and 0.5 along z; z is doubled. F has no symmetry, so that a transpose in the wrong
/// place shows.
#[test]
fn reaction_on_deformed_areas() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    stressed(dir.path());
    let total = "solidModel nonLinearGeometryTotalLagrangianTotalDisplacement;";
    put(dir.path(), "constant/solidProperties", "dictionary", total);
    let displacement = |c: [f64; 3]| {
        let x = 0.5 * c[0] + 0.25 * c[1] + 0.5 * c[2];
        format!("({x} 0 {})", c[2])
    };
    solid_field(dir.path(), "1", "D", "vector", &displacement);
    // The face x = 1 is spanned by the images of y and z, (0.25 1 0) and (0.5 0 2): its area is their cross product,
    // (2 -0.5 -0.5), and the force the stress times it.
    let expected = [
        7.0 * 2.0 + 2.0 * -0.5 + 3.0 * -0.5,
        2.0 * 2.0 + -1.0 * -0.5 + 0.5 * -0.5,
        3.0 * 2.0 + 0.5 * -0.5 + 4.0 * -0.5,
    ];
    let by_gradient = force(&mut open(dir.path()).unwrap(), "outlet");
    assert!(near(by_gradient, expected), "{by_gradient:?}, expected {expected:?}");

    // The stored F goes before the gradient of D, here that of no displacement at all
    solid_field(dir.path(), "1", "F", "tensor", &|_| "(1.5 0.25 0.5 0 1 0 0 0 2)".into());
    solid_field(dir.path(), "1", "D", "vector", &|_| "(0 0 0)".into());
    let by_f = force(&mut open(dir.path()).unwrap(), "outlet");
    assert!(near(by_f, expected), "{by_f:?}, expected {expected:?}");

    // An F that the surrogate did not advance does not
    note(dir.path(), "1/F", "m4gn: not advanced by the surrogate, values of time 0.5");
    let found = force(&mut open(dir.path()).unwrap(), "outlet");
    assert!(near(found, [7.0, 2.0, 3.0]), "{found:?}");

    solid_field(dir.path(), "1", "F", "tensor", &|_| "(-1 0 0 0 1 0 0 0 1)".into());
    fails(open(dir.path()).unwrap().reaction("outlet", 0), &["inside out", "outlet"]);
}

#[test]
fn a_force_that_is_not_known_is_not_guessed() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    let unknown = || open(dir.path()).unwrap().reaction("outlet", 0).unwrap();
    cube(dir.path(), false, "patch");
    solid_field(dir.path(), "1", "D", "vector", &|c| format!("({} 0 0)", c[0]));
    assert_eq!(unknown(), Reaction::Unknown(Unknown::Missing));
    stressed(dir.path());
    let path = dir.path().join("1/sigma");
    let whole = fs::read_to_string(&path).unwrap();
    note(dir.path(), "1/sigma", "m4gn: not advanced by the surrogate, values of time 0.5");
    assert_eq!(unknown(), Reaction::Unknown(Unknown::Stale));
    // A note of somebody else says nothing of that
    fs::write(&path, &whole).unwrap();
    note(dir.path(), "1/sigma", "of the tutorial");
    assert_eq!(unknown(), Reaction::Force([7.0, 2.0, 3.0]));
    fs::write(&path, whole.replace("[1 -1 -2 0 0 0 0]", "[0 2 -2 0 0 0 0]")).unwrap();
    assert_eq!(unknown(), Reaction::Unknown(Unknown::Kinematic));
    fs::write(&path, whole.replace("[1 -1 -2 0 0 0 0]", "[0 0 0 0 0 0 0]")).unwrap();
    let error = open(dir.path()).unwrap().reaction("outlet", 0).unwrap_err().to_string();
    assert!(error.contains("expected a stress") || error.contains("needs a stress"), "{error}");
    fs::write(&path, &whole).unwrap();
    let updated = "solidModel nonLinearGeometryUpdatedLagrangian;";
    put(dir.path(), "constant/solidProperties", "dictionary", updated);
    assert_eq!(unknown(), Reaction::Unknown(Unknown::Moved));
}

#[test]
fn the_stress_at_the_cells_is_that_of_its_time() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    stressed(dir.path());
    let read = || open(dir.path()).unwrap().stress(0).unwrap();
    let cell = [7.0, 2.0, 3.0, 2.0, -1.0, 0.5, 3.0, 0.5, 4.0];
    assert_eq!(read(), Some([cell, cell].concat()));
    let path = dir.path().join("1/sigma");
    let whole = fs::read_to_string(&path).unwrap();
    let value = "(7 2 3 -1 0.5 4)";
    let list = format!("nonuniform List<symmTensor> 2({value} {value})");
    assert!(whole.contains(&list), "{whole}");
    fs::write(&path, whole.replace(&list, &format!("uniform {value}"))).unwrap();
    assert_eq!(read(), Some([cell, cell].concat()));
    note(dir.path(), "1/sigma", "m4gn: not advanced by the surrogate, values of time 0.5");
    assert_eq!(read(), None);
    // A conductivity, say
    fs::write(&path, whole.replace("volSymmTensorField", "volScalarField")).unwrap();
    assert_eq!(read(), None);
    fs::remove_file(&path).unwrap();
    assert_eq!(read(), None);
}
