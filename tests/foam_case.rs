//! The bridge to OpenFOAM, on cases small enough to know every answer: a cube of two cells.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

use crate::common::{alone, cube, field, near, note, put, uniform};
use m4gn_samples::fails;
use m4gn_workbench::foam_case::{FoamCase, Reaction, Unknown};
use std::{fs, path::Path, process::Command};
use tempfile::TempDir;

/// Boundary conditions of the velocity of a fluid that flows past walls at rest, and of its pressure.
const OF_U: &str = "inlet{type fixedValue; value uniform (1 0 0);} outlet{type zeroGradient;} sides{type slip;} body{type noSlip;}";
const OF_P: &str = "\".*\"{type zeroGradient;}";

fn open(case: &Path) -> m4gn_base::Result<FoamCase> {
    FoamCase::open(case)
}

#[test]
fn mesh_and_fields_of_a_cube() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    cube(dir.path(), false, "empty");
    uniform(dir.path(), "0.5", 2.0);
    let mut case = open(dir.path()).unwrap();
    let d = case.description().clone();
    assert_eq!(
        (d.cells, d.times.as_slice(), d.directions.as_slice(), d.processors),
        (2, &[0.5][..], &[0, 1][..], 0)
    );
    assert_eq!((d.application.as_str(), d.delta_t), ("icoFoam", 0.5));
    let names: Vec<(&str, &str)> = d.patches.iter().map(|p| (p.name.as_str(), p.kind.as_str())).collect();
    assert_eq!(names, [("inlet", "patch"), ("outlet", "patch"), ("body", "wall"), ("sides", "empty")]);
    assert_eq!((d.patches[1].lower, d.patches[1].upper), ([1.0, 0.0, 0.0], [1.0, 1.0, 1.0]));
    assert!(near(case.cell_centres().unwrap()[1], [0.75, 0.5, 0.5]));
    let polygons = case.polygons().unwrap();
    assert_eq!(polygons.start, [0, 4, 8]);
    assert!(
        polygons.points[..4].iter().all(|p| p[0] <= 0.5) && polygons.points[4..].iter().all(|p| p[0] >= 0.5)
    );
    assert_eq!(case.vector_field("U", 0).unwrap(), [[2.0, 0.0, 0.0]; 2]);
    assert_eq!(case.scalar_field("p", 0).unwrap(), [1.0, 1.0]);
    assert!(case.has_field("U", 0).unwrap() && !case.has_field("k", 0).unwrap());
    let inlet = case.flow("inlet", 0).unwrap();
    assert!(
        (inlet.flux + 2.0).abs() < 1e-12
            && (inlet.area - 1.0).abs() < 1e-12
            && near(inlet.velocity, [2.0, 0.0, 0.0])
    );
}

#[test]
fn forces_on_a_closed_body() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    cube(dir.path(), true, "patch");
    // Centres of the ten boundary faces, in their order.
    let (q, h) = (0.25, 0.75);
    let centres = [
        [0.0, 0.5, 0.5],
        [1.0, 0.5, 0.5],
        [q, 0.0, 0.5],
        [h, 0.0, 0.5],
        [q, 1.0, 0.5],
        [h, 1.0, 0.5],
        [q, 0.5, 0.0],
        [h, 0.5, 0.0],
        [q, 0.5, 1.0],
        [h, 0.5, 1.0],
    ];
    let list = |kind: &str, of: &dyn Fn([f64; 3]) -> String| {
        let values: Vec<String> = centres.iter().map(|c| of(*c)).collect();
        format!("body{{type fixedValue; value nonuniform List<{kind}> 10({});}}", values.join(" "))
    };
    // Uniform pressure and a fluid at rest.
    field(dir.path(), "1", "p", ["3", "3"], "body{type fixedValue; value uniform 3;}");
    field(dir.path(), "1", "U", ["(0 0 0)", "(0 0 0)"], "body{type noSlip;}");
    // Hydrostatic pressure p = 7 z: by Gauss, the sum of p S is grad p times the volume of 1.
    field(dir.path(), "2", "p", ["3.5", "3.5"], &list("scalar", &|c| (7.0 * c[2]).to_string()));
    // Shear U = (y, 0, 0): the stress is the same on opposite faces, and their areas cancel.
    field(dir.path(), "2", "U", ["(0.5 0 0)", "(0.5 0 0)"], &list("vector", &|c| format!("({} 0 0)", c[1])));
    let mut case = open(dir.path()).unwrap();
    let rest = case.force("body", 0).unwrap();
    assert!(near(rest.pressure, [0.0; 3]) && near(rest.viscous, [0.0; 3]), "{rest:?}");
    let shear = case.force("body", 1).unwrap();
    assert!(near(shear.pressure, [0.0, 0.0, 7.0]) && near(shear.viscous, [0.0; 3]), "{shear:?}");

    // Fluid of velocity 1 at distance 1/2 from walls at rest, y = 0 and y = 1: stress 0.25 * 2 on an area of 2.
    let dir = TempDir::new().unwrap();
    cube(dir.path(), false, "patch");
    field(dir.path(), "1", "U", ["(1 0 0)", "(1 0 0)"], OF_U);
    field(dir.path(), "1", "p", ["0", "0"], OF_P);
    let drag = || open(dir.path()).unwrap().force("body", 0).unwrap();
    assert!(near(drag().viscous, [1.0, 0.0, 0.0]) && near(drag().total(), [1.0, 0.0, 0.0]), "{:?}", drag());
    // A turbulent viscosity of 0.75 at the walls, and a fluid whose own one is stored, 0.5 there
    field(dir.path(), "1", "nut", ["9", "9"], "\".*\"{type nutkWallFunction; value uniform 0.75;}");
    assert!(near(drag().viscous, [4.0, 0.0, 0.0]), "{:?}", drag());
    put(dir.path(), "constant/transportProperties", "dictionary", "transportModel CrossPowerLaw;");
    field(dir.path(), "1", "nu", ["9", "9"], "\".*\"{type calculated; value uniform 0.5;}");
    assert!(near(drag().viscous, [5.0, 0.0, 0.0]), "{:?}", drag());
}

#[test]
fn each_of_two_open_cases_includes_its_own_files() {
    let _alone = alone();
    let dirs = [TempDir::new().unwrap(), TempDir::new().unwrap()];
    let mut cases = Vec::new();
    for (dir, nu) in dirs.iter().zip([0.25, 0.5]) {
        cube(dir.path(), false, "patch");
        fs::write(dir.path().join("system/fluid"), format!("nu {nu};")).unwrap();
        put(dir.path(), "constant/transportProperties", "dictionary", "#include \"<system>/fluid\"\n");
        // As above: the force is four times the viscosity
        field(dir.path(), "1", "U", ["(1 0 0)", "(1 0 0)"], OF_U);
        field(dir.path(), "1", "p", ["0", "0"], OF_P);
        cases.push(open(dir.path()).unwrap());
    }
    let forces: Vec<f64> = cases.iter_mut().map(|c| c.force("body", 0).unwrap().viscous[0]).collect();
    assert!((forces[0] - 1.0).abs() < 1e-12 && (forces[1] - 2.0).abs() < 1e-12, "{forces:?}");
}

#[test]
fn openfoams_own_messages_become_errors() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    fails(open(&dir.path().join("none")), &["is not an OpenFOAM case", "controlDict\" does not exist"]);
    cube(dir.path(), false, "empty");
    uniform(dir.path(), "1", 1.0);
    fs::rename(dir.path().join("constant/polyMesh/faces"), dir.path().join("faces")).unwrap();
    fails(open(dir.path()), &["has no mesh"]);
    fs::rename(dir.path().join("faces"), dir.path().join("constant/polyMesh/faces")).unwrap();

    let mut case = open(dir.path()).unwrap();
    fails(case.vector_field("V", 0), &["expected a volVectorField", "1/V"]);
    fails(case.vector_field("p", 0), &["another class"]);
    fails(case.force("wing", 0), &["wing", "body"]);
    fails(case.vector_field("U", 9), &["there are 1 times"]);

    // A truncated field: OpenFOAM's own words, with file and line.
    let path = dir.path().join("1/U");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.find("inlet").unwrap()]).unwrap();
    fails(open(dir.path()).unwrap().vector_field("U", 0), &["OpenFOAM", "1/U", "line"]);
    // The next case is read as if nothing had happened.
    fs::write(&path, &text).unwrap();
    assert_eq!(open(dir.path()).unwrap().vector_field("U", 0).unwrap().len(), 2);
    // A list that is shorter than the mesh.
    fs::write(&path, text.replace("2((1 0 0) (1 0 0))", "1((1 0 0))")).unwrap();
    fails(open(dir.path()).unwrap().vector_field("U", 0), &["size 1 is not equal to"]);
}

#[test]
fn a_decomposed_case_is_read_without_reconstructing_it() {
    let _alone = alone();
    let dir = TempDir::new().unwrap();
    cube(dir.path(), false, "patch");
    for time in ["0", "1"] {
        field(dir.path(), time, "U", ["(1 0 0)", "(3 0 0)"], OF_U);
        field(dir.path(), time, "p", ["1", "2"], OF_P);
    }
    let stress = "\".*\"{type calculated; value uniform (7 2 3 -1 0.5 4);}";
    field(dir.path(), "1", "sigma", ["(7 2 3 -1 0.5 4)"; 2], stress);
    let whole = open(dir.path()).unwrap().force("body", 1).unwrap();
    let method = "numberOfSubdomains 2; method simple; simpleCoeffs { n (2 1 1); delta 0.001; }";
    put(dir.path(), "system/decomposeParDict", "dictionary", method);
    let project = std::env::var("WM_PROJECT_DIR").unwrap_or_else(|_| "/usr/share/openfoam".into());
    let mut command = Command::new("decomposePar");
    let run = command
        .args(["-time", "0:1", "-case"])
        .arg(dir.path())
        .env("WM_PROJECT_DIR", project)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stdout));
    fs::remove_dir_all(dir.path().join("1")).unwrap();

    let mut case = open(dir.path()).unwrap();
    assert_eq!((case.description().processors, case.description().times.as_slice()), (2, &[0.0, 1.0][..]));
    assert_eq!(case.vector_field("U", 1).unwrap(), [[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]]);
    assert_eq!(case.scalar_field("p", 1).unwrap(), [1.0, 2.0]);
    let force = case.force("body", 1).unwrap();
    assert!(
        near(force.pressure, whole.pressure) && near(force.viscous, whole.viscous),
        "{force:?}, {whole:?}"
    );
    assert_eq!(case.reaction("outlet", 1).unwrap(), Reaction::Force([7.0, 2.0, 3.0]));
    let stale = "m4gn: not advanced by the surrogate, values of time 0";
    note(dir.path(), "processor0/1/sigma", stale);
    let found = || open(dir.path()).unwrap().reaction("outlet", 1).unwrap();
    assert_eq!(found(), Reaction::Unknown(Unknown::Stale));
    // reconstructPar takes no notes over
    field(dir.path(), "1", "sigma", ["(7 2 3 -1 0.5 4)"; 2], stress);
    assert_eq!(open(dir.path()).unwrap().description().processors, 0);
    assert_eq!(found(), Reaction::Unknown(Unknown::Stale));
    fails(case.vector_field("V", 1), &["processor0/1/V"]);
}
