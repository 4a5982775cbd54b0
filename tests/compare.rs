//! `m4gn compare` on cases small enough to know every answer: a cube of two cells.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

mod common;

use common::{cube, put, uniform};
use std::{
    fs,
    path::Path,
    process::{Command, Output},
};
use tempfile::TempDir;

fn m4gn(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_m4gn"));
    command.args(args).env_remove("WM_PROJECT_DIR").output().unwrap()
}

/// Two ducts: the full run's velocity is 1, 2, 3 at t = 1, 2, 3; the hybrid's 1, 2.5, 3.
fn two_runs() -> (TempDir, String, String) {
    let dir = TempDir::new().unwrap();
    for (name, speeds) in [("a", [1.0, 2.0, 3.0]), ("b", [1.0, 2.5, 3.0])] {
        let case = dir.path().join(name);
        cube(&case, false, "empty");
        for (i, u) in speeds.iter().enumerate() {
            uniform(&case, &(i + 1).to_string(), *u);
        }
    }
    let path = |n: &str| dir.path().join(n).to_str().unwrap().to_string();
    let (a, b) = (path("a"), path("b"));
    (dir, a, b)
}

fn figures(path: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn compare_gives_the_errors_on_paper() {
    let (dir, a, b) = two_runs();
    let file = |n: &str| dir.path().join(n).to_str().unwrap().to_string();
    let (json, html, png) = (file("c.json"), file("c.html"), file("c.png"));
    let outputs = ["--json", &json, "--html", &html, "--png", &png];
    let run = m4gn(
        &[
            &["compare", &a, &b, "--patch", "body", "--wall-a", "9"],
            &outputs[..],
        ]
        .concat(),
    );
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    let list = |key: &str| -> Vec<f64> {
        found[key]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect()
    };
    // One of two components is wrong by 1/2 at the first horizon, none at the second. Held: 1 against 2 and 3.
    let expected = [
        (0.5_f64 / 2.0_f64.sqrt(), 1.0 / 2.0_f64.sqrt()),
        (0.25, (5.0_f64 / 4.0).sqrt()),
    ];
    for (i, (model, hold)) in expected.into_iter().enumerate() {
        assert!((list("velocity_rmse")[i] - model).abs() < 1e-12, "{found}");
        assert!((list("hold_last_rmse")[i] - hold).abs() < 1e-12, "{found}");
    }
    assert_eq!(
        (list("times"), found["takeover"].as_f64()),
        (vec![2.0, 3.0], Some(1.0))
    );
    assert_eq!(
        (found["wall_a"].as_f64(), found["wall_b"].as_f64()),
        (Some(9.0), None)
    );
    assert!(found["replaced_fraction"].is_null() && found["strouhal_error"].is_null());
    assert!(
        fs::read_to_string(&html)
            .unwrap()
            .contains("data:image/png;base64,")
    );
    assert!(fs::read(&png).unwrap().starts_with(b"\x89PNG"));

    // A surrogate that says when it took over.
    let folder = Path::new(&b).join("postProcessing/surrogate/1");
    fs::create_dir_all(&folder).unwrap();
    let summary = r#"{"replaced_time": 1.0, "replaced_fraction": 0.5, "takeover_time": 2.0}"#;
    fs::write(folder.join("summary.json"), summary).unwrap();
    let run = m4gn(&["compare", &a, &b, "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    assert_eq!(
        (found["times"][0].as_f64(), found["replaced_fraction"].as_f64()),
        (Some(3.0), Some(0.5))
    );
}

#[test]
fn compare_refuses_what_cannot_be_compared() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json");
    let fails = |args: &[&str], words: &str| {
        let run = m4gn(&[&["compare", "--json", json.to_str().unwrap()], args].concat());
        let text = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(1), "{args:?}: {text}");
        assert!(
            text.starts_with("m4gn: ") && text.contains(words),
            "{args:?}: expected '{words}' in '{text}'"
        );
        assert!(!json.exists(), "{args:?} left a file of figures");
    };
    fails(&[&a, "/nowhere"], "is not an OpenFOAM case");
    fails(
        &[&a, &b, "--patch", "wing"],
        "its patches are inlet, outlet, body, sides",
    );
    fails(&[&a, &b, "--from", "0.5"], "took over at 0.5 s");
    fails(&[&a, &b, "--from", "3"], "took over at 3 s");
    fails(&[&a, &b, "--wall-a", "0"], "expected a positive number");
    // Another mesh.
    let points =
        "12((0 0 0)(0 1 0)(0 1 1)(0 0 1)(0.4 0 0)(0.4 1 0)(0.4 1 1)(0.4 0 1)(1 0 0)(1 1 0)(1 1 1)(1 0 1))";
    put(Path::new(&b), "constant/polyMesh/points", "vectorField", points);
    fails(&[&a, &b], "different meshes");
    // A run that blew up.
    cube(Path::new(&b), false, "empty");
    uniform(Path::new(&b), "3", f64::NAN);
    fails(&[&a, &b], "3/U");
    assert_eq!(m4gn(&["compare", &a]).status.code(), Some(2));
}
