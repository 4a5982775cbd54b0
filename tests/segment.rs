//! `m4gn segment` on a case of two cells, where every answer is known, and on bad input.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

use crate::common::{cube, put, uniform};
use crate::program::{figures, m4gn, names, success};
use std::{fs, path::Path, process::Output};
use tempfile::TempDir;

fn segment(case: &Path, arguments: &str) -> Output {
    m4gn()
        .arg("segment")
        .arg(case)
        .args(arguments.split_whitespace())
        .current_dir(case.parent().unwrap())
        .output()
        .unwrap()
}

/// Must end with this status and say `text` on stderr, in one paragraph.
fn refused(case: &Path, arguments: &str, status: i32, text: &str) {
    let output = segment(case, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{arguments}: {said}");
    assert!(said.contains(text), "{arguments}: expected '{text}' in: {said}");
    assert!(status == 2 || said.trim_end().lines().count() == 1, "{said}");
    assert!(!said.contains("panicked"), "{said}");
}

fn accepted(case: &Path, arguments: &str) -> String {
    success(&segment(case, arguments))
}

/// The duct of two cells of 1/2 x 1 x 1, empty in z, in a folder of its own.
fn duct() -> (TempDir, std::path::PathBuf) {
    let dir = TempDir::new().unwrap();
    let case = dir.path().join("case");
    cube(&case, false, "empty");
    uniform(&case, "0", 2.0);
    (dir, case)
}

#[test]
fn two_cells_on_paper() {
    let (dir, case) = duct();
    let text = accepted(&case, "--segments 2 --json figures.json");
    let json = figures(dir.path().join("figures.json"));
    // Between the cells 1/0.5, to each end 1/0.25, to each of two walls 0.5/0.5: K = [8 -2; -2 8], V = 1/2. The mode with
    // eigenvalue (8 - 2)/0.5 = 12.
    let found = json["eigenvalues"].as_array().unwrap();
    assert!(found.len() == 1 && (found[0].as_f64().unwrap() - 12.0).abs() < 1e-9, "{json}");
    assert_eq!((&json["k"], &json["edge_cut_ratio"]), (&2.into(), &1.0.into()), "{json}");
    assert_eq!((&json["conductance"], &json["silhouette"]), (&1.0.into(), &0.0.into()), "{json}");
    assert!(text.contains("m4gnSegment, m4gnMode1 in "), "{text}");
    // As many segments as cells: there is nothing to move
    assert!(text.contains("\n0 % of the cells are not where METIS had put them\n"), "{text}");
    assert_eq!(names(&case.join("0")), ["U", "m4gnMode1", "m4gnSegment", "m4gnSegmentDict", "p"]);
    let field = fs::read_to_string(case.join("0/m4gnSegment")).unwrap();
    assert!(
        field.contains("volScalarField") && field.contains("note        \"m4gn segment: method slic-md, K 2")
    );
    let values = field.split("internalField").nth(1).unwrap();
    assert!(values.contains("2(0 1)") || values.contains("2\n(\n0\n1\n)"), "{values}");

    // Again, with one segment: our own fields are replaced, and modes that are no longer there go.
    accepted(&case, "--segments 1 --modes 0");
    assert_eq!(names(&case.join("0")), ["U", "m4gnSegment", "m4gnSegmentDict", "p"]);
    let field = fs::read_to_string(case.join("0/m4gnSegment")).unwrap();
    assert!(field.contains("internalField   uniform 0"), "{field}");
}

#[test]
fn the_cases_own_format() {
    let (_dir, case) = duct();
    let control =
        "application icoFoam; startFrom startTime; startTime 0; deltaT 0.5; writeInterval 1; endTime 3; ";
    put(&case, "system/controlDict", "dictionary", &format!("{control} writeCompression on;"));
    accepted(&case, "--segments 2");
    assert_eq!(names(&case.join("0")), ["U", "m4gnMode1.gz", "m4gnSegment.gz", "m4gnSegmentDict", "p"]);
    put(&case, "system/controlDict", "dictionary", &format!("{control} writeFormat binary;"));
    accepted(&case, "--segments 2");
    assert_eq!(names(&case.join("0")), ["U", "m4gnMode1", "m4gnSegment", "m4gnSegmentDict", "p"]);
    let field = fs::read(case.join("0/m4gnMode1")).unwrap();
    assert!(String::from_utf8_lossy(&field).contains("format      binary"));
}

#[test]
fn bad_input_writes_nothing() {
    let (dir, case) = duct();
    let before = names(&case.join("0"));
    refused(&dir.path().join("none"), "", 1, "does not exist");
    refused(dir.path(), "", 1, "is neither an OpenFOAM case");
    refused(&case, "--segments 0", 2, "expected a number from 1");
    refused(&case, "--segments 3", 1, "3 segments for 2 cells: expected 1 to 2");
    refused(&case, "--segments 2 --modes 2", 1, "2 modes of 2 cells");
    refused(&case, "--segments 2 --set tau=nan", 1, "tau");
    refused(&case, "--segments 2 --json none/figures.json", 1, "none/figures.json: cannot be written");
    refused(&case, r#"--segments 2 --set obstacles=["wing"]"#, 1, "wing is no patch");
    refused(&case, "--segments 2 --node-type wing=wall", 1, "fit no patch");
    refused(&case, "--segments 2 --model none.safetensors", 1, "none.safetensors");
    assert_eq!(names(&case.join("0")), before);
    assert_eq!(names(dir.path()), ["case"]);

    // Somebody else's field.
    uniform(&case, "1", 2.0);
    fs::copy(case.join("0/p"), case.join("1/m4gnSegment")).unwrap();
    let theirs = fs::read(case.join("1/m4gnSegment")).unwrap();
    refused(&case, "--segments 2 --json figures.json", 1, "was not written by m4gn");
    assert_eq!(fs::read(case.join("1/m4gnSegment")).unwrap(), theirs);
    assert_eq!((names(&case.join("1")).len(), names(dir.path()).len()), (3, 1));
    accepted(&case, "--segments 2 --no-write");
    accepted(&case, "--segments 2 --overwrite");
    assert_ne!(fs::read(case.join("1/m4gnSegment")).unwrap(), theirs);

    // A folder of the start time that cannot be one.
    fs::remove_dir_all(case.join("1")).unwrap();
    let control =
        "application icoFoam; startFrom startTime; startTime 7; deltaT 0.5; writeInterval 1; endTime 9;";
    put(&case, "system/controlDict", "dictionary", control);
    fs::write(case.join("7"), "no folder").unwrap();
    let node_types = "--segments 2 --node-type inlet=inlet --node-type outlet=outlet";
    refused(&case, node_types, 1, "m4gn: OpenFOAM: ");
    assert_eq!(fs::read_to_string(case.join("7")).unwrap(), "no folder");
}

#[test]
fn patches_that_are_not_understood_are_named() {
    let (_dir, case) = duct();
    fs::remove_dir_all(case.join("0")).unwrap();
    refused(&case, "--segments 2", 1, "what is patch inlet");
    accepted(&case, "--segments 2 --node-type inlet=inlet --node-type outlet=outlet --no-write");
    // From the function object, and from the boundary conditions.
    let functions = "functions { recorder { type m4gnRecorder; nodeTypes { inlet inlet; outlet outlet; } } }";
    let control = format!("application icoFoam; deltaT 0.5; writeInterval 1; endTime 3; {functions}");
    put(&case, "system/controlDict", "dictionary", &control);
    accepted(&case, "--segments 2 --no-write");

    let boundary = case.join("constant/polyMesh/boundary");
    let text = fs::read_to_string(&boundary).unwrap();
    fs::write(&boundary, text.replace("type empty", "type wedge")).unwrap();
    let output = segment(&case, "--segments 2");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("sides"), "{output:?}");
}

#[test]
fn entries_of_the_function_object_are_the_defaults() {
    let (dir, case) = duct();
    let functions = "functions { off { type m4gnSurrogate; enabled no; segments { count 1; } } \
                     s { type m4gnSurrogate; segments { count 2; method metis; modes 0; } } }";
    let control = format!("application icoFoam; deltaT 0.5; writeInterval 1; endTime 3; {functions}");
    put(&case, "system/controlDict", "dictionary", &control);
    let text = accepted(&case, "--json figures.json");
    assert!(text.contains("method metis, K 2, 0 modes"), "{text}");
    let json = figures(dir.path().join("figures.json"));
    assert_eq!((&json["method"], &json["k"]), (&"metis".into(), &2.into()));
    let text = accepted(&case, "--segments 1 --method slic-md --modes 1");
    assert!(text.contains("method slic-md, K 1, 1 modes"), "{text}");
    put(&case, "system/controlDict", "dictionary", &control.replace("count 2", "count two"));
    refused(&case, "", 1, "the case's function object: segments.count: expected a whole number");
}
