//! OpenFOAM cases of two cells, written by hand.
// Each of the two test programs uses a part of it.
#![allow(dead_code)]

use std::{
    fs,
    path::Path,
    sync::{Mutex, MutexGuard},
};

const HEADER: &str = "FoamFile { version 2.0; format ascii; class CLASS; object OBJECT; }\n";

/// Writes a file of a case with OpenFOAM's header.
pub fn put(case: &Path, name: &str, class: &str, text: &str) {
    let path = case.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let object = path.file_name().unwrap().to_str().unwrap();
    fs::write(&path, HEADER.replace("CLASS", class).replace("OBJECT", object) + text).unwrap();
}

/// The unit cube, cut at x = 1/2 into two cells: faces z = 0 and z = 1 in `sides`, the others in `inlet` (x = 0),
/// `outlet` (x = 1) and `body` (y = 0, y = 1). With `closed`, all ten faces are one wall `body`.
pub fn cube(case: &Path, closed: bool, sides: &str) {
    put(
        case,
        "system/controlDict",
        "dictionary",
        "application icoFoam; deltaT 0.5; writeInterval 1; endTime 3;",
    );
    put(case, "system/fvSchemes", "dictionary", "gradSchemes{} divSchemes{} laplacianSchemes{}");
    put(case, "system/fvSolution", "dictionary", "solvers{}");
    put(case, "constant/transportProperties", "dictionary", "nu [0 2 -1 0 0 0 0] 0.25;");
    let mut points = String::from("12(");
    for x in [0.0, 0.5, 1.0] {
        for (y, z) in [(0, 0), (1, 0), (1, 1), (0, 1)] {
            points += &format!("({x} {y} {z})");
        }
    }
    put(case, "constant/polyMesh/points", "vectorField", &(points + ")"));
    // Point 4 i + j is corner j of the section at x = i/2. Normals point from the owner outwards.
    let faces = "11(4(4 5 6 7) 4(0 3 2 1) 4(8 9 10 11) 4(0 4 7 3) 4(4 8 11 7) 4(1 2 6 5) 4(5 6 10 9) \
                 4(0 1 5 4) 4(4 5 9 8) 4(3 7 6 2) 4(7 11 10 6))";
    // Corners are (0 0)(1 0)(1 1)(0 1) in y, z: faces 3, 4 are y = 0; 5, 6 y = 1; 7, 8 z = 0; 9, 10 z = 1.
    put(case, "constant/polyMesh/faces", "faceList", faces);
    put(case, "constant/polyMesh/owner", "labelList", "11(0 0 1 0 1 0 1 0 1 0 1)");
    put(case, "constant/polyMesh/neighbour", "labelList", "1(1)");
    let patch = |name: &str, kind: &str, n: usize, start: usize| {
        format!("{name}{{type {kind}; nFaces {n}; startFace {start};}}\n")
    };
    let patches = if closed {
        format!("1({})", patch("body", "wall", 10, 1))
    } else {
        let ends = patch("inlet", "patch", 1, 1) + &patch("outlet", "patch", 1, 2);
        format!("4({ends}{}{})", patch("body", "wall", 4, 3), patch("sides", sides, 4, 7))
    };
    put(case, "constant/polyMesh/boundary", "polyBoundaryMesh", &patches);
}

/// Writes p, T, nu, nut, U, D, sigma or F at a time.
pub fn field(case: &Path, time: &str, name: &str, cells: [&str; 2], boundary: &str) {
    let (class, kind, dimensions) = match name {
        "p" => ("volScalarField", "scalar", "[0 2 -2 0 0 0 0]"),
        "T" => ("volScalarField", "scalar", "[0 0 0 1 0 0 0]"),
        "nu" | "nut" => ("volScalarField", "scalar", "[0 2 -1 0 0 0 0]"),
        "D" => ("volVectorField", "vector", "[0 1 0 0 0 0 0]"),
        "sigma" => ("volSymmTensorField", "symmTensor", "[1 -1 -2 0 0 0 0]"),
        "F" => ("volTensorField", "tensor", "[0 0 0 0 0 0 0]"),
        _ => ("volVectorField", "vector", "[0 1 -1 0 0 0 0]"),
    };
    let text = format!(
        "dimensions {dimensions}; internalField nonuniform List<{kind}> 2({} {});\nboundaryField {{ {boundary} }}\n",
        cells[0], cells[1]
    );
    put(case, &format!("{time}/{name}"), class, &text);
}

/// A duct with the same velocity `u` everywhere and pressure 1 on the whole body.
pub fn uniform(case: &Path, time: &str, u: f64) {
    let v = format!("({u} 0 0)");
    let walls =
        |value: &str| format!("inlet{{{value}}} outlet{{{value}}} body{{{value}}} sides{{type empty;}}");
    field(case, time, "U", [&v, &v], &walls(&format!("type fixedValue; value uniform {v};")));
    field(case, time, "p", ["1", "1"], &walls("type calculated; value uniform 1;"));
}

/// Puts a note into the header of a file.
pub fn note(case: &Path, file: &str, note: &str) {
    let path = case.join(file);
    let text = fs::read_to_string(&path).unwrap();
    let (before, after) = text.split_once("class").unwrap();
    fs::write(&path, format!("{before}note \"{note}\"; class{after}")).unwrap();
}

/// OpenFOAM is not thread-safe, and tests run in threads.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

pub fn alone() -> MutexGuard<'static, ()> {
    ONE_AT_A_TIME.lock().unwrap_or_else(|e| e.into_inner())
}

/// Two points, or vectors, that are the same up to rounding.
pub fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|d| (a[d] - b[d]).abs() < 1e-12)
}
