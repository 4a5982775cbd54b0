//! `m4gn compare` on cases small enough to know every answer: a cube of two cells.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

use crate::common::{cube, field, put, uniform};
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
    let (json, html) = (file("c.json"), file("c.html"));
    let outputs = ["--json", &json, "--html", &html];
    let run = m4gn(&[&["compare", &a, &b, "--patch", "body", "--wall-a", "9"], &outputs[..]].concat());
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    let list = |key: &str| -> Vec<f64> {
        found[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    // One of two components is wrong by 1/2 at the first horizon, none at the second. Held: 1 against 2 and 3.
    let expected = [(0.5_f64 / 2.0_f64.sqrt(), 1.0 / 2.0_f64.sqrt()), (0.25, (5.0_f64 / 4.0).sqrt())];
    // p is the same in both runs and at all times.
    assert_eq!(found["fields"]["p"]["rmse"], serde_json::json!([0.0, 0.0]));
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("RMSE-1") && text.contains("hybrid [p]"), "{text}");
    for (i, (model, hold)) in expected.into_iter().enumerate() {
        assert!((list("velocity_rmse")[i] - model).abs() < 1e-12, "{found}");
        assert!((list("hold_last_rmse")[i] - hold).abs() < 1e-12, "{found}");
    }
    assert_eq!((list("times"), found["takeover"].as_f64()), (vec![2.0, 3.0], Some(1.0)));
    assert_eq!((found["wall_a"].as_f64(), found["wall_b"].as_f64()), (Some(9.0), None));
    assert!(found["replaced_fraction"].is_null() && found["strouhal_error"].is_null());
    assert!(fs::read_to_string(&html).unwrap().contains("data:image/png;base64,"));

    // A surrogate that says when it took over.
    let folder = Path::new(&b).join("postProcessing/surrogate/1");
    fs::create_dir_all(&folder).unwrap();
    let summary = r#"{"replaced_time": 1.0, "replaced_fraction": 0.5, "takeover_time": 2.0}"#;
    fs::write(folder.join("summary.json"), summary).unwrap();
    let run = m4gn(&["compare", &a, &b, "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    assert_eq!((found["times"][0].as_f64(), found["replaced_fraction"].as_f64()), (Some(3.0), Some(0.5)));
}

/// A temperature in both cells of the full run 300, 301, 302 K, of the hybrid 300, 302, 302 K at t = 1, 2, 3.
#[test]
fn a_temperature_is_compared_where_both_runs_have_it() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json").to_str().unwrap().to_string();
    for (case, values) in [(&a, [300, 301, 302]), (&b, [300, 302, 302])] {
        for (i, value) in values.iter().enumerate() {
            let value = value.to_string();
            let boundary = "\".*\"{type zeroGradient;} sides{type empty;}";
            let time = (i + 1).to_string();
            field(Path::new(case), &time, "T", [&value, &value], boundary);
        }
    }
    let run = m4gn(&["compare", &a, &b, "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    // The errors are 1 and 0 K, those of holding 300 K are 1 and 2 K; a horizon has all times before it too.
    for (key, expected) in [("rmse", [1.0, 0.5_f64.sqrt()]), ("hold_last_rmse", [1.0, 2.5_f64.sqrt()])] {
        for (horizon, value) in expected.into_iter().enumerate() {
            let found = found["fields"]["T"][key][horizon].as_f64().unwrap();
            assert!((found - value).abs() < 1e-9, "{key}: {found}, expected {value}");
        }
    }
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("hybrid [T]"), "{text}");
}

/// Of heat conduction, by the temperatures above.
#[test]
fn a_temperature_comes_first_where_there_is_no_velocity() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json").to_str().unwrap().to_string();
    for (case, values) in [(&a, [300, 301, 302]), (&b, [300, 302, 302])] {
        for (i, value) in values.iter().enumerate() {
            let (time, value) = ((i + 1).to_string(), value.to_string());
            let boundary = "\".*\"{type zeroGradient;} sides{type empty;}";
            field(Path::new(case), &time, "T", [&value, &value], boundary);
            fs::remove_file(Path::new(case).join(&time).join("U")).unwrap();
        }
    }
    let run = m4gn(&["compare", &a, &b, "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    for (horizon, value) in [1.0, 0.5_f64.sqrt()].into_iter().enumerate() {
        assert!((found["temperature_rmse"][horizon].as_f64().unwrap() - value).abs() < 1e-9, "{found}");
    }
    assert!(found["fields"]["T"].is_null() && found["fields"]["p"].is_object(), "{found}");
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("hybrid [T, K]"), "{text}");
}

/// The pressure on the upper faces of the body goes up and down by `swing`, and the lift with it, in ten times.
fn lifted(case: &Path, swing: f64) {
    for time in 1..=10 {
        let upper = 1.0 + if time % 2 == 1 { swing } else { -swing };
        let time = &time.to_string();
        uniform(case, time, 1.0);
        let calculated = "type calculated; value";
        let boundary = format!(
            "body{{{calculated} nonuniform List<scalar> 4(1 1 {upper} {upper});}} sides{{type empty;}} \
             \".*let\"{{{calculated} uniform 1;}}"
        );
        field(case, time, "p", ["1", "1"], &boundary);
    }
}

/// Not "22073 %": no percentage tells of a lift that the full run hardly has.
#[test]
fn a_lift_of_many_times_the_full_runs_is_said_so() {
    let (_dir, a, b) = two_runs();
    lifted(Path::new(&a), 0.001);
    lifted(Path::new(&b), 0.221);
    let run = m4gn(&["compare", &a, &b, "--patch", "body"]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = String::from_utf8_lossy(&run.stdout);
    let row = text.lines().find(|l| l.contains("rms lift")).unwrap();
    assert!(row.contains("221 times the full run's") && !row.contains('%'), "{row}");
}

/// Rows of a time step each, of a drag of 2 and a lift of a period of 0.4 s, which stored times each second cannot tell; B has a row a
/// stride in a stretch of twice the drag.
#[test]
fn the_tables_of_function_objects_are_weighed_by_time() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json").to_str().unwrap().to_string();
    for (case, step) in [(&a, 0.01), (&b, 0.05)] {
        let mut table = String::from("# Force coefficients\n# Time \tCd\tCs\tCl\n");
        let mut time: f64 = 0.0;
        while time < 3.0 - 1e-9 {
            time += if time < 2.0 - 1e-9 { 0.01 } else { step };
            let drag = if time > 2.0 { 4.0 } else { 2.0 };
            table += &format!("{time}\t{drag}\t0\t{}\n", (std::f64::consts::TAU * time / 0.4).sin());
        }
        let functions = "functions { drag { type forceCoeffs; patches (body); } other { type forceCoeffs; patches (inlet); } }";
        let control = Path::new(case).join("system/controlDict");
        let text = fs::read_to_string(&control).unwrap() + functions;
        fs::write(control, text).unwrap();
        let folder = Path::new(case).join("postProcessing/drag/0");
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("coefficient.dat"), table).unwrap();
    }
    let run = m4gn(&["compare", &a, &b, "--patch", "body", "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    assert_eq!(found["table"], "drag");
    for run in [0, 1] {
        let number = |key: &str| found[key][run].as_f64().unwrap();
        assert!((number("mean_drag") - 3.0).abs() < 0.05, "{found}");
        assert!((number("frequency") - 2.5).abs() < 0.02, "{found}");
    }
    assert!(found["drag_error"].as_f64().unwrap() < 0.02, "{found}");
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("the tables of the function object drag"), "{text}");
    // Of the stored times alone nothing can be told
    fs::remove_dir_all(Path::new(&b).join("postProcessing")).unwrap();
    let run = m4gn(&["compare", &a, &b, "--patch", "body", "--json", &json]);
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("2 stored times are too few"), "{text}");
    let found = figures(&json);
    assert!(
        found["mean_drag"] == serde_json::json!([null, null]) && found["drag_error"].is_null(),
        "{found}"
    );
}

/// A cylinder whose forces cannot be known, as the viscosity is not.
#[test]
fn a_patch_that_nobody_names_keeps_nothing_from_being_compared() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json").to_str().unwrap().to_string();
    for case in [&a, &b].map(Path::new) {
        for file in ["constant/polyMesh/boundary", "1/U", "2/U", "3/U", "1/p", "2/p", "3/p"] {
            let text = fs::read_to_string(case.join(file)).unwrap();
            fs::write(case.join(file), text.replace("body", "cylinder")).unwrap();
        }
        fs::remove_file(case.join("constant/transportProperties")).unwrap();
    }
    let run = m4gn(&["compare", &a, &b, "--json", &json]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let text = String::from_utf8_lossy(&run.stdout);
    assert!(text.contains("no forces on patch cylinder: ") && text.contains("transportProperties"), "{text}");
    assert!(figures(&json)["drag_a"].is_null());
    assert!(!m4gn(&["compare", &a, &b, "--patch", "cylinder"]).status.success());
}

/// As in `m4gn compare A B | head -1`.
#[test]
fn a_reader_of_one_line_is_no_error() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let run = Command::new(env!("CARGO_BIN_EXE_m4gn"))
        .args(["compare", &a, &b, "--json", json.to_str().unwrap()])
        .stdout(writer)
        .output()
        .unwrap();
    assert!(
        run.status.success() && run.stderr.is_empty(),
        "{} {}",
        run.status,
        String::from_utf8_lossy(&run.stderr)
    );
    assert!(json.is_file(), "the figures are written all the same");
}

/// The full run's log goes on to 3 s, the hybrid's ends at 2 s: what the full run took for 2 s counts. A log without End is none.
#[test]
fn times_are_those_of_the_same_span_and_of_runs_that_ended() {
    let (dir, a, b) = two_runs();
    let json = dir.path().join("c.json").to_str().unwrap().to_string();
    let log = |case: &str, seconds: &[f64], end: &str| {
        let step = |(i, s): (usize, &f64)| {
            format!("Time = {}\n\nExecutionTime = {s} s  ClockTime = {s:.0} s\n\n", i + 1)
        };
        let steps: String = seconds.iter().enumerate().map(step).collect();
        let control = fs::read_to_string(Path::new(case).join("system/controlDict")).unwrap();
        let application = control.split("application").nth(1).unwrap().split(';').next().unwrap();
        let file = format!("log.{}", application.trim());
        fs::write(Path::new(case).join(file), format!("Create mesh for time = 0\n\n{steps}{end}")).unwrap();
    };
    let compared = || {
        let run = m4gn(&["compare", &a, &b, "--json", &json]);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        (figures(&json), String::from_utf8_lossy(&run.stdout).into_owned())
    };
    log(&a, &[40.0, 80.0, 440.0], "End\n");
    log(&b, &[10.0, 20.0], "End\n");
    let (found, text) = compared();
    assert_eq!(found["span"], serde_json::json!([0.0, 2.0]));
    assert_eq!((&found["processor_a"], &found["processor_b"]), (&80.0.into(), &20.0.into()));
    assert_eq!((&found["processor_after_a"], &found["processor_after_b"]), (&40.0.into(), &10.0.into()));
    let row = text.lines().find(|l| l.contains("whole run: processor time")).unwrap();
    assert!(row.ends_with("25.0 %, 4.00 x as fast"), "{text}");
    assert!(text.find("whole run").unwrap() < text.find("RMSE-1").unwrap());
    log(&b, &[0.7], "");
    let (found, text) = compared();
    assert!(found["processor_a"].is_null() && found["wall_b"].is_null(), "{found}");
    assert!(text.contains("no line 'End'") && !text.contains(" x as fast"), "{text}");
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
    fails(&[&a, "/tmp/my case"], "has the character ' '");
    fails(&[&a, &b, "--patch", "wing"], "its patches are inlet, outlet, body, sides");
    fails(&[&a, &b, "--probe-patch", "outlet"], "of a solid");
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

/// A body of two cells that sways with period 8 in y, the right one twice as far; `scale` times as far.
fn sways(case: &Path, scale: f64) {
    cube(case, false, "empty");
    for time in 1..=24 {
        let y = scale * (std::f64::consts::TAU * f64::from(time) / 8.0).cos();
        let boundary = "\".*\"{type calculated; value uniform (0 0 0);} sides{type empty;}";
        let cells = [format!("(0 {} 0)", 0.5 * y), format!("(0 {y} 0)")];
        field(case, &time.to_string(), "D", [&cells[0], &cells[1]], boundary);
    }
}

#[test]
fn the_motion_of_a_solid_is_compared() {
    let dir = TempDir::new().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (a, b, json, html) = (path("a"), path("b"), path("c.json"), path("c.html"));
    sways(Path::new(&a), 1.0);
    sways(Path::new(&b), 0.9);
    // The cell beside the outlet is the one that moves most; the one beside the inlet moves half as far.
    for (patch, most) in [(None, 1.0), (Some("outlet"), 1.0), (Some("inlet"), 0.5)] {
        let mut args = vec!["compare", &a, &b, "--json", &json, "--html", &html];
        args.extend(patch.iter().flat_map(|p| ["--probe-patch", p]));
        let run = m4gn(&args);
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let found = figures(&json);
        let number = |key: &str| found[key].as_f64().unwrap();
        // From 2 to 24: two whole periods and seven of the eight samples of another; cos^2 sums to 4 a period.
        let mean_square = (12.0 - 0.5) / 23.0_f64;
        assert!((number("amplitude") - most).abs() < 1e-9, "{found}");
        assert!((number("point_error_rms") - 0.1 * mean_square.sqrt()).abs() < 1e-6, "{found}");
        assert!((number("point_error_max") - 0.1).abs() < 1e-6, "{found}");
        assert_eq!(found["component"], 1);
        for frequency in found["frequency"].as_array().unwrap() {
            assert!((frequency.as_f64().unwrap() - 0.125).abs() < 1e-6, "{found}");
        }
        assert!(number("frequency_error") < 1e-6 && (number("periods") - 23.0 / 8.0).abs() < 1e-4);
        // Over both cells and both components: (1 + 1/4)/4 of the square.
        let expected = 0.1 * (mean_square * 1.25 / 4.0).sqrt();
        // The errors of the cells are 0.1 and 0.05 where they are largest, of a range of 1
        let worst = (0.5 * (0.01 + 0.0025_f64)).sqrt();
        assert!((number("displacement_range") - 1.0).abs() < 1e-9, "{found}");
        assert!((number("displacement_error_of_range") - worst).abs() < 1e-9, "{found}");
        assert!(found["reaction"].is_null());
        let last = found["displacement_rmse"].as_array().unwrap().last().unwrap();
        assert!((last.as_f64().unwrap() - expected).abs() < 1e-6, "{found}");
    }
    assert!(fs::read_to_string(&html).unwrap().contains("<svg"));

    let fails = |args: &[&str], words: &str| {
        let run = m4gn(&[&["compare", &a, &b], args].concat());
        let text = String::from_utf8_lossy(&run.stderr).into_owned();
        assert_eq!(run.status.code(), Some(1), "{args:?}: {text}");
        assert!(text.contains(words), "{args:?}: expected '{words}' in '{text}'");
    };
    fails(&["--interpolate"], "--interpolate");
    fails(&["--patch", "wing"], "its patches are inlet, outlet, body, sides");
    fails(&["--probe-patch", "wing"], "its patches are inlet, outlet, body, sides");
    sways(Path::new(&a), 0.0);
    fails(&[], "does not move");
    fs::remove_file(Path::new(&b).join("24/D")).unwrap();
    fails(&[], "24/D");
}

/// A stress that is the same everywhere: `xx` along x, and `xy`. In 2-D there is no stress on `sides`.
fn stress(case: &Path, time: u32, xx: f64, xy: f64) {
    let value = format!("({xx} {xy} 0 0 0 0)");
    let boundary = format!("sides{{type empty;}} \".*\"{{type calculated; value uniform {value};}}");
    field(case, &time.to_string(), "sigma", [&value, &value], &boundary);
}

#[test]
fn the_reaction_of_a_solid_is_compared_where_both_runs_know_it() {
    let dir = TempDir::new().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_string();
    let (a, b, json, html) = (path("a"), path("b"), path("c.json"), path("c.html"));
    sways(Path::new(&a), 1.0);
    sways(Path::new(&b), 0.9);
    // Errors count from 1 on. Full: 3 N and 4 N along x on an area of 1; hybrid: 1 N too much along y, then right.
    for time in 2..=24 {
        stress(Path::new(&a), time, if time == 2 { 3.0 } else { 4.0 }, 0.0);
    }
    stress(Path::new(&b), 2, 3.0, 1.0);
    stress(Path::new(&b), 3, 4.0, 0.0);
    // A stress of the solver's last step, under a time of the surrogate's
    stress(Path::new(&b), 4, 9.0, 9.0);
    let file = Path::new(&b).join("4/sigma");
    let text = fs::read_to_string(&file).unwrap();
    let note = "format ascii; note \"m4gn: not advanced by the surrogate, values of time 3\";";
    fs::write(&file, text.replacen("format ascii;", note, 1)).unwrap();

    let run = m4gn(&["compare", &a, &b, "--patch", "outlet", "--json", &json, "--html", &html]);
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let found = figures(&json);
    let reaction = &found["reaction"];
    assert_eq!(reaction["times"], serde_json::json!([2.0, 3.0]));
    assert_eq!(reaction["force_a"], serde_json::json!([[3.0, 0.0, 0.0], [4.0, 0.0, 0.0]]));
    let number = |key: &str| reaction[key].as_f64().unwrap();
    assert!((number("error_rms") - 0.2).abs() < 1e-12, "{reaction}");
    assert!((number("error_max") - 0.25).abs() < 1e-12, "{reaction}");
    // The patch of the force is not the one beside which a cell is followed
    assert_eq!(found["amplitude"], 1.0);
    let text = String::from_utf8_lossy(&run.stdout);
    for words in [
        "compared at 2 of 23 times",
        "1 time where sigma was not advanced by the surrogate in the hybrid run",
        "20 times where no sigma is stored in the hybrid run",
    ] {
        assert!(text.contains(words), "{text}");
        assert!(fs::read_to_string(&html).unwrap().contains(words));
    }
    let row = |what: &str| {
        let line = text.lines().find(|l| l.contains(what));
        line.unwrap_or_else(|| panic!("{text}"))
    };
    assert!(row("rms reaction force on outlet").ends_with("20.0 %"), "{text}");
    assert!(row("largest reaction force on outlet").ends_with("25.0 %"), "{text}");
}
