//! `m4gn compare` on cases small enough to know every answer: a cube of two cells.
//!
//! Needs OpenFOAM and `libm4gn_foam_bridge.so` beside the executable (setup/build.sh).

use crate::common::{cube, field, note, put, uniform};
use crate::program::{fails, figures, m4gn, success};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use tempfile::TempDir;

/// Cases of a full and a hybrid run, a and b in a folder.
struct Runs {
    dir: TempDir,
    a: PathBuf,
    b: PathBuf,
}

impl Runs {
    /// Without the cases.
    fn new() -> Runs {
        let dir = TempDir::new().unwrap();
        let (a, b) = (dir.path().join("a"), dir.path().join("b"));
        Runs { dir, a, b }
    }

    /// Two ducts: the full run's velocity is 1, 2, 3 at t = 1, 2, 3; the hybrid's 1, 2.5, 3.
    fn ducts() -> Runs {
        let runs = Runs::new();
        for (case, speeds) in [(&runs.a, [1.0, 2.0, 3.0]), (&runs.b, [1.0, 2.5, 3.0])] {
            cube(case, false, "empty");
            for (i, u) in speeds.iter().enumerate() {
                uniform(case, &(i + 1).to_string(), *u);
            }
        }
        runs
    }

    /// `m4gn compare a b --json c.json --html c.html` with these options.
    fn compare(&self, options: &[&str]) -> Output {
        let mut command = m4gn();
        command.current_dir(self.dir.path()).env_remove("WM_PROJECT_DIR");
        let files = ["--json", "c.json", "--html", "c.html"];
        command.args(["compare", "a", "b"]).args(files).args(options).output().unwrap()
    }

    /// What it prints, and its figures.
    fn compared(&self, options: &[&str]) -> (String, Value) {
        let text = success(&self.compare(options));
        (text, figures(self.dir.path().join("c.json")))
    }

    fn page(&self) -> String {
        fs::read_to_string(self.dir.path().join("c.html")).unwrap()
    }
}

#[test]
fn compare_gives_the_errors_on_paper() {
    let runs = Runs::ducts();
    let (text, found) = runs.compared(&["--patch", "body", "--wall-a", "9"]);
    let list = |key: &str| -> Vec<f64> {
        found[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    // One of two components is wrong by 1/2 at the first horizon, none at the second. Held: 1 against 2 and 3.
    let expected = [(0.5_f64 / 2.0_f64.sqrt(), 1.0 / 2.0_f64.sqrt()), (0.25, (5.0_f64 / 4.0).sqrt())];
    // p is the same in both runs and at all times.
    assert_eq!(found["fields"]["p"]["rmse"], serde_json::json!([0.0, 0.0]));
    assert!(text.contains("RMSE-1") && text.contains("hybrid [p]"), "{text}");
    for (i, (model, hold)) in expected.into_iter().enumerate() {
        assert!((list("velocity_rmse")[i] - model).abs() < 1e-12, "{found}");
        assert!((list("hold_last_rmse")[i] - hold).abs() < 1e-12, "{found}");
    }
    assert_eq!((list("times"), found["takeover"].as_f64()), (vec![2.0, 3.0], Some(1.0)));
    assert_eq!((found["wall_a"].as_f64(), found["wall_b"].as_f64()), (Some(9.0), None));
    assert!(found["replaced_fraction"].is_null() && found["strouhal_error"].is_null());
    assert!(runs.page().contains("data:image/png;base64,"));

    // A surrogate that says when it took over.
    let folder = runs.b.join("postProcessing/surrogate/1");
    fs::create_dir_all(&folder).unwrap();
    let summary = r#"{"replaced_time": 1.0, "replaced_fraction": 0.5, "takeover_time": 2.0}"#;
    fs::write(folder.join("summary.json"), summary).unwrap();
    let (_, found) = runs.compared(&[]);
    assert_eq!((found["times"][0].as_f64(), found["replaced_fraction"].as_f64()), (Some(3.0), Some(0.5)));
    let (text, found) = runs.compared(&["--from", "1"]);
    assert_eq!(found["times"][0].as_f64(), Some(2.0));
    assert!(text.contains("2 common times; errors from 1 s"), "{text}");
}

/// The ducts with a temperature in both cells, of the full run 300, 301, 302 K, of the hybrid 300, 302, 302 K at t = 1, 2, 3.
fn warm_ducts() -> Runs {
    let runs = Runs::ducts();
    for (case, values) in [(&runs.a, [300, 301, 302]), (&runs.b, [300, 302, 302])] {
        for (i, value) in values.iter().enumerate() {
            let (time, value) = ((i + 1).to_string(), value.to_string());
            let boundary = "\".*\"{type zeroGradient;} sides{type empty;}";
            field(case, &time, "T", [&value, &value], boundary);
        }
    }
    runs
}

#[test]
fn a_temperature_is_compared_where_both_runs_have_it() {
    let (text, found) = warm_ducts().compared(&[]);
    // The errors are 1 and 0 K, those of holding 300 K are 1 and 2 K; a horizon has all times before it too.
    for (key, expected) in [("rmse", [1.0, 0.5_f64.sqrt()]), ("hold_last_rmse", [1.0, 2.5_f64.sqrt()])] {
        for (horizon, value) in expected.into_iter().enumerate() {
            let found = found["fields"]["T"][key][horizon].as_f64().unwrap();
            assert!((found - value).abs() < 1e-9, "{key}: {found}, expected {value}");
        }
    }
    assert!(text.contains("hybrid [T]"), "{text}");
}

/// Of heat conduction, by the temperatures above.
#[test]
fn a_temperature_comes_first_where_there_is_no_velocity() {
    let runs = warm_ducts();
    for case in [&runs.a, &runs.b] {
        for time in ["1", "2", "3"] {
            fs::remove_file(case.join(time).join("U")).unwrap();
        }
    }
    let (text, found) = runs.compared(&[]);
    for (horizon, value) in [1.0, 0.5_f64.sqrt()].into_iter().enumerate() {
        assert!((found["temperature_rmse"][horizon].as_f64().unwrap() - value).abs() < 1e-9, "{found}");
    }
    assert!(found["fields"]["T"].is_null() && found["fields"]["p"].is_object(), "{found}");
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
    let runs = Runs::ducts();
    lifted(&runs.a, 0.001);
    lifted(&runs.b, 0.221);
    let (text, _) = runs.compared(&["--patch", "body"]);
    let row = text.lines().find(|l| l.contains("rms lift")).unwrap();
    assert!(row.contains("221 times the full run's") && !row.contains('%'), "{row}");
}

/// Rows of a time step each, of a drag of 2 and a lift of a period of 0.4 s, which stored times each second cannot tell; B has a row a
/// stride in a stretch of twice the drag.
#[test]
fn the_tables_of_function_objects_are_weighed_by_time() {
    let runs = Runs::ducts();
    for (case, step) in [(&runs.a, 0.01), (&runs.b, 0.05)] {
        let mut table = String::from("# Force coefficients\n# Time \tCd\tCs\tCl\n");
        let mut time: f64 = 0.0;
        while time < 3.0 - 1e-9 {
            time += if time < 2.0 - 1e-9 { 0.01 } else { step };
            let drag = if time > 2.0 { 4.0 } else { 2.0 };
            table += &format!("{time}\t{drag}\t0\t{}\n", (std::f64::consts::TAU * time / 0.4).sin());
        }
        let functions = "functions { drag { type forceCoeffs; patches (body); } other { type forceCoeffs; patches (inlet); } }";
        let control = case.join("system/controlDict");
        let text = fs::read_to_string(&control).unwrap() + functions;
        fs::write(control, text).unwrap();
        let folder = case.join("postProcessing/drag/0");
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("coefficient.dat"), table).unwrap();
    }
    let (text, found) = runs.compared(&["--patch", "body"]);
    assert_eq!(found["table"], "drag");
    for run in [0, 1] {
        let number = |key: &str| found[key][run].as_f64().unwrap();
        assert!((number("mean_drag") - 3.0).abs() < 0.05, "{found}");
        assert!((number("frequency") - 2.5).abs() < 0.02, "{found}");
    }
    assert!(found["drag_error"].as_f64().unwrap() < 0.02, "{found}");
    assert!(text.contains("the tables of the function object drag"), "{text}");
    // Of the stored times alone nothing can be told
    fs::remove_dir_all(runs.b.join("postProcessing")).unwrap();
    let (text, found) = runs.compared(&["--patch", "body"]);
    assert!(text.contains("2 stored times are too few"), "{text}");
    assert!(
        found["mean_drag"] == serde_json::json!([null, null]) && found["drag_error"].is_null(),
        "{found}"
    );
}

/// A cylinder whose forces cannot be known, as the viscosity is not.
#[test]
fn a_patch_that_nobody_names_keeps_nothing_from_being_compared() {
    let runs = Runs::ducts();
    for case in [&runs.a, &runs.b] {
        for file in ["constant/polyMesh/boundary", "1/U", "2/U", "3/U", "1/p", "2/p", "3/p"] {
            let text = fs::read_to_string(case.join(file)).unwrap();
            fs::write(case.join(file), text.replace("body", "cylinder")).unwrap();
        }
        fs::remove_file(case.join("constant/transportProperties")).unwrap();
    }
    let (text, found) = runs.compared(&[]);
    assert!(text.contains("no forces on patch cylinder: ") && text.contains("transportProperties"), "{text}");
    assert!(found["drag_a"].is_null());
    assert!(!runs.compare(&["--patch", "cylinder"]).status.success());
}

/// The full run's log goes on to 3 s, the hybrid's ends at 2 s: what the full run took for 2 s counts. A log without End is none.
#[test]
fn times_are_those_of_the_same_span_and_of_runs_that_ended() {
    let runs = Runs::ducts();
    let log = |case: &Path, seconds: &[f64], end: &str| {
        let step = |(i, s): (usize, &f64)| {
            format!("Time = {}\n\nExecutionTime = {s} s  ClockTime = {s:.0} s\n\n", i + 1)
        };
        let steps: String = seconds.iter().enumerate().map(step).collect();
        let control = fs::read_to_string(case.join("system/controlDict")).unwrap();
        let application = control.split("application").nth(1).unwrap().split(';').next().unwrap();
        let file = format!("log.{}", application.trim());
        fs::write(case.join(file), format!("Create mesh for time = 0\n\n{steps}{end}")).unwrap();
    };
    log(&runs.a, &[40.0, 80.0, 440.0], "End\n");
    let (text, _) = runs.compared(&[]);
    assert!(text.contains("no times of the logs: ") && text.contains("/b/log."), "{text}");
    log(&runs.b, &[10.0, 20.0], "End\n");
    let (text, found) = runs.compared(&[]);
    assert_eq!(found["span"], serde_json::json!([0.0, 2.0]));
    assert_eq!((&found["processor_a"], &found["processor_b"]), (&80.0.into(), &20.0.into()));
    assert_eq!((&found["processor_after_a"], &found["processor_after_b"]), (&40.0.into(), &10.0.into()));
    let row = text.lines().find(|l| l.contains("whole run: processor time")).unwrap();
    assert!(row.ends_with("25.0 %, 4.00 x as fast"), "{text}");
    assert!(text.find("whole run").unwrap() < text.find("RMSE-1").unwrap());
    // One that began from the full run's fields at 1 s
    let late = "Create mesh for time = 1\n\nTime = 2\n\nExecutionTime = 5 s  ClockTime = 5 s\n\nEnd\n";
    fs::write(runs.b.join("log.icoFoam"), late).unwrap();
    let (_, found) = runs.compared(&[]);
    assert_eq!(found["span"], serde_json::json!([1.0, 2.0]));
    assert_eq!((&found["processor_a"], &found["processor_b"]), (&40.0.into(), &5.0.into()));
    log(&runs.b, &[0.7], "");
    let (text, found) = runs.compared(&[]);
    assert!(found["processor_a"].is_null() && found["wall_b"].is_null(), "{found}");
    assert!(text.contains("no line 'End'") && !text.contains(" x as fast"), "{text}");
}

#[test]
fn compare_refuses_what_cannot_be_compared() {
    let runs = Runs::ducts();
    let refused = |options: &[&str], words: &str| {
        fails(&runs.compare(options), words);
        assert!(!runs.dir.path().join("c.json").exists(), "{options:?} left a file of figures");
    };
    let of = |other: &str| m4gn().current_dir(&runs.dir).args(["compare", "a", other]).output().unwrap();
    fails(&of("/nowhere"), "is not an OpenFOAM case");
    fails(&of("/tmp/my case"), "has the character ' '");
    refused(&["--patch", "wing"], "its patches are inlet, outlet, body, sides");
    refused(&["--probe-patch", "outlet"], "of a solid");
    refused(&["--from", "0.5"], "count from 0.5 s on");
    refused(&["--from", "3"], "count from 3 s on");
    // Another mesh.
    let points =
        "12((0 0 0)(0 1 0)(0 1 1)(0 0 1)(0.4 0 0)(0.4 1 0)(0.4 1 1)(0.4 0 1)(1 0 0)(1 1 0)(1 1 1)(1 0 1))";
    put(&runs.b, "constant/polyMesh/points", "vectorField", points);
    refused(&[], "different meshes");
    // A run that blew up.
    cube(&runs.b, false, "empty");
    uniform(&runs.b, "3", f64::NAN);
    refused(&[], "3/U");
    assert_eq!(m4gn().args(["compare", "a"]).status().unwrap().code(), Some(2));
}

/// A body of two cells that sways with period 8 in y, the right one twice as far; `scale` times as far. As of solids4foam, `U` is its velocity,
/// which makes no flow of it.
fn sways(case: &Path, scale: f64) {
    cube(case, false, "empty");
    for time in 1..=24 {
        let y = scale * (std::f64::consts::TAU * f64::from(time) / 8.0).cos();
        let boundary = "\".*\"{type calculated; value uniform (0 0 0);} sides{type empty;}";
        let cells = [format!("(0 {} 0)", 0.5 * y), format!("(0 {y} 0)")];
        for name in ["D", "U"] {
            field(case, &time.to_string(), name, [&cells[0], &cells[1]], boundary);
        }
    }
}

#[test]
fn the_motion_of_a_solid_is_compared() {
    let runs = Runs::new();
    sways(&runs.a, 1.0);
    sways(&runs.b, 0.9);
    // The cell beside the outlet is the one that moves most; the one beside the inlet moves half as far.
    for (patch, most) in [(None, 1.0), (Some("outlet"), 1.0), (Some("inlet"), 0.5)] {
        let options: Vec<&str> = patch.iter().flat_map(|p| ["--probe-patch", *p]).collect();
        let (_, found) = runs.compared(&options);
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
    assert!(runs.page().contains("<svg"));

    fails(&runs.compare(&["--interpolate"]), "--interpolate");
    for option in ["--patch", "--probe-patch"] {
        fails(&runs.compare(&[option, "wing"]), "its patches are inlet, outlet, body, sides");
    }
    sways(&runs.a, 0.0);
    fails(&runs.compare(&[]), "does not move");
    fs::remove_file(runs.b.join("24/D")).unwrap();
    fails(&runs.compare(&[]), "24/D");
}

/// A stress that is the same everywhere: `xx` along x, and `xy`. In 2-D there is no stress on `sides`.
fn stress(case: &Path, time: u32, xx: f64, xy: f64) {
    let value = format!("({xx} {xy} 0 0 0 0)");
    let boundary = format!("sides{{type empty;}} \".*\"{{type calculated; value uniform {value};}}");
    field(case, &time.to_string(), "sigma", [&value, &value], &boundary);
}

#[test]
fn the_reaction_of_a_solid_is_compared_where_both_runs_know_it() {
    let runs = Runs::new();
    sways(&runs.a, 1.0);
    sways(&runs.b, 0.9);
    // Errors count from 1 on. Full: 3 N and 4 N along x on an area of 1; hybrid: 1 N too much along y, then right.
    for time in 2..=24 {
        stress(&runs.a, time, if time == 2 { 3.0 } else { 4.0 }, 0.0);
    }
    stress(&runs.b, 2, 3.0, 1.0);
    stress(&runs.b, 3, 4.0, 0.0);
    // A stress of the solver's last step, under a time of the surrogate's
    stress(&runs.b, 4, 9.0, 9.0);
    note(&runs.b, "4/sigma", "m4gn: not advanced by the surrogate, values of time 3");

    let (text, found) = runs.compared(&["--patch", "outlet"]);
    let reaction = &found["reaction"];
    assert_eq!(reaction["times"], serde_json::json!([2.0, 3.0]));
    assert_eq!(reaction["force_a"], serde_json::json!([[3.0, 0.0, 0.0], [4.0, 0.0, 0.0]]));
    let number = |key: &str| reaction[key].as_f64().unwrap();
    assert!((number("error_rms") - 0.2).abs() < 1e-12, "{reaction}");
    assert!((number("error_max") - 0.25).abs() < 1e-12, "{reaction}");
    // The patch of the force is not the one beside which a cell is followed
    assert_eq!(found["amplitude"], 1.0);
    for words in [
        "compared at 2 of 23 times",
        "1 time where sigma was not advanced by the surrogate in the hybrid run",
        "20 times where no sigma is stored in the hybrid run",
    ] {
        assert!(text.contains(words), "{text}");
        assert!(runs.page().contains(words));
    }
    let row = |what: &str| {
        let line = text.lines().find(|l| l.contains(what));
        line.unwrap_or_else(|| panic!("{text}"))
    };
    assert!(row("rms reaction force on outlet").ends_with("20.0 %"), "{text}");
    assert!(row("largest reaction force on outlet").ends_with("25.0 %"), "{text}");
}

/// Full: 3 Pa along x at all times but the first, when there is none; hybrid: at 2 s a shear of 0.3 Pa too much, then right.
#[test]
fn the_stress_of_a_solid_is_compared_where_both_runs_have_it_at_all_times() {
    let runs = Runs::new();
    for (case, scale) in [(&runs.a, 1.0), (&runs.b, 0.9)] {
        sways(case, scale);
        (1..=24).for_each(|time| stress(case, time, if time == 1 { 0.0 } else { 3.0 }, 0.0));
    }
    stress(&runs.b, 2, 3.0, 0.3);
    let (text, found) = runs.compared(&[]);
    let sigma = &found["fields"]["sigma"];
    // Of nine components one is 3 Pa, and two are wrong by 0.3 Pa at one of 23 times
    let near = |value: &Value, expected: f64| (value.as_f64().unwrap() - expected).abs() < 1e-12;
    assert!(near(&sigma["rms"], 1.0), "{sigma}");
    assert!(near(&sigma["rmse"][0], 0.02_f64.sqrt()), "{sigma}");
    assert!(near(&sigma["rmse"][22], (0.02_f64 / 23.0).sqrt()), "{sigma}");
    assert!(near(&sigma["hold_last_rmse"][22], 1.0), "{sigma}");
    assert!(text.contains("hybrid [sigma]") && runs.page().contains("hybrid [sigma]"), "{text}");

    // A stress of the solver's last step at a time of the surrogate's, and none at all
    note(&runs.b, "4/sigma", "m4gn: not advanced by the surrogate, values of time 3");
    let (text, found) = runs.compared(&[]);
    assert!(found["fields"]["sigma"].is_null() && !text.contains("[sigma]"), "{text}");
    stress(&runs.b, 4, 3.0, 0.0);
    fs::remove_file(runs.a.join("24/sigma")).unwrap();
    assert!(runs.compared(&[]).1["fields"]["sigma"].is_null());
}
