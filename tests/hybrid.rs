//! `m4gn hybrid` with OpenFOAM's own tools: one draw on a coarse mesh, a short time span.
//!
//! Needs gmsh, OpenFOAM, and in `lib` libm4gnFoam.so and libm4gn_foam_bridge.so (setup/build.sh).

use crate::program::{self, figures, names, refused, text};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const HOME: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

fn m4gn(arguments: &str) -> Command {
    let mut command = program::m4gn();
    command.env("M4GN_HOME", HOME).env_remove("WM_PROJECT_DIR").args(arguments.split(' '));
    command
}

fn without_model(folder: &Path, options: &str) -> Command {
    let mut command = m4gn("hybrid --count 1 --set mesh=coarse --takeover 0.5 --seed 7");
    command.arg("--out").arg(folder.join("runs")).args(options.split_whitespace());
    command
}

/// A flow whose surrogate replaces 0.5 s of each 0.55 s, from 0.55 s on.
fn hybrid(folder: &Path, options: &str) -> Output {
    let model = Path::new(HOME).join("models/cylinder-flow.safetensors");
    without_model(folder, options).arg("--model").arg(model).output().unwrap()
}

#[test]
fn runs_are_compared_kept_and_made_anew_when_they_change() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let options = format!(
        "--end 1.2 --variant short={} --variant strict={} --baseline loose --baseline half=cells=0.5 \
         --json {} --html {}",
        path("short").display(),
        path("strict").display(),
        path("f.json").display(),
        path("f.html").display()
    );
    fs::write(path("short"), "surrogateSteps 5;\n").unwrap();
    fs::write(path("strict"), "control { tolerance 1e-12; }\n").unwrap();
    let first = hybrid(dir.path(), &options);
    assert!(first.status.success(), "{}", text(&first));
    let found = figures(path("f.json"));
    let runs = &found["cases"][0]["runs"];
    let number = |run: &str, key: &str| {
        let value = &runs[run]["score"][key];
        value.as_f64().unwrap_or_else(|| panic!("{run} {key}: {value}"))
    };
    // 0.5 and 0.25 s of the surrogate after each 0.05 s of the solver, from 0.55 s on; the last jump may be cut
    assert!(number("hybrid", "replaced") > 0.8);
    assert!((0.6..0.9).contains(&number("short", "replaced")));
    assert!(number("short", "replaced") < number("hybrid", "replaced"));
    // No jump is within that tolerance: the solver goes on alone, which is a result
    assert_eq!((number("strict", "replaced"), number("strict", "end")), (0.0, 0.0));
    let run = ["hybrid", "dmd", "network-dmd", "dmd-loose", "short", "strict", "loose", "half"];
    for name in run {
        for key in ["first", "jump", "end", "drag", "cells"] {
            assert!(number(name, key).is_finite());
        }
        let cost = &runs[name]["cost"];
        let [whole, after] = ["processor", "after_takeover"].map(|k| cost[k].as_f64().unwrap());
        assert!(after > 0.0 && after < whole, "{cost}");
    }
    // A plain solver with looser tolerances is nearly the full one; on half as many cells it is not.
    assert!(number("loose", "end") < 0.05, "{}", number("loose", "end"));
    assert!(number("half", "end") > number("loose", "end"));
    assert!(number("half", "cells") < 0.7 * number("loose", "cells"));
    assert_eq!(runs["hybrid"]["score"]["cells"], runs["loose"]["score"]["cells"]);
    assert_eq!(
        found["summary"][0]["runs"]["hybrid"]["end"]["median"].as_f64(),
        Some(number("hybrid", "end"))
    );
    // The whole run counts first, by either clock, and the stretch after the takeover beside it
    let times = ["whole", "whole_wall", "time"].map(|key| {
        let median = &found["summary"][0]["runs"]["hybrid"][key]["median"];
        median.as_f64().unwrap_or_else(|| panic!("{key}: {median}"))
    });
    assert!(times.iter().all(|t| *t > 0.0), "{times:?}");
    let heading = text(&first);
    assert!(heading.find("whole %").unwrap() < heading.find("first stride").unwrap(), "{heading}");
    let page = fs::read_to_string(path("f.html")).unwrap();
    assert_eq!(page.matches("<circle").count(), run.len());
    // Results stay, the runs themselves do not.
    let mut kept: Vec<String> = run.iter().chain(&["full"]).map(|name| format!("{name}.json")).collect();
    kept.sort();
    assert_eq!(names(&path("runs/0000")), kept);

    // The same command runs nothing.
    let again = hybrid(dir.path(), &options);
    assert!(again.status.success(), "{}", text(&again));
    assert_eq!(again.stderr, b"", "{}", text(&again));
    let kept = &figures(path("f.json"))["cases"][0]["runs"]["hybrid"];
    assert_eq!(kept["made_with"], runs["hybrid"]["made_with"]);
    assert_eq!(kept["score"]["cells"], runs["hybrid"]["score"]["cells"]);
    // Nor is anything of dmd run anew without the model, which it does not need.
    let alone =
        without_model(dir.path(), "--end 1.2 --baseline loose --baseline half=cells=0.5").output().unwrap();
    assert!(alone.status.success() && alone.stderr.is_empty(), "{}", text(&alone));

    // A variant that changed is made anew, with the full run that it is compared with; one that fails is told.
    fs::write(path("short"), "noSuchEntry 1;\n").unwrap();
    let failed = hybrid(dir.path(), &options);
    assert_eq!(failed.status.code(), Some(1), "{}", text(&failed));
    let told = text(&failed);
    assert!(told.contains("1 runs failed:\n  0000 short:") && told.contains("noSuchEntry"), "{told}");
    assert!(told.contains("0000  full  ") && !told.contains("0000  hybrid  "), "{told}");
    assert_eq!(figures(path("f.json"))["cases"][0]["failed"][0][0], "short");
    assert!(path("runs/0000/short/log.icoFoam").is_file());

    // A full run whose fields end too early compares with nothing.
    let times = names(&path("runs/0000/full")).into_iter();
    let times = times.filter_map(|name| Some((name.parse::<f64>().ok()?, name)));
    let (_, last) = times.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    fs::remove_dir_all(path("runs/0000/full").join(last)).unwrap();
    fs::write(path("short"), "surrogateSteps 5;\n").unwrap();
    let cut = hybrid(dir.path(), &options);
    assert!(text(&cut).contains("the last time that both runs have"), "{}", text(&cut));
    assert!(!path("runs/0000/short.json").is_file());
}

/// A copy of the family of cylinders that can be edited.
fn own_family(dir: &Path) -> PathBuf {
    let own = dir.join("own");
    let templates = Path::new(HOME).join("openfoam/templates/cylinder-flow");
    assert!(Command::new("cp").arg("-r").arg(templates).arg(&own).status().unwrap().success());
    own
}

fn edit(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{text}");
    fs::write(file, text.replace(from, to)).unwrap();
}

/// What was made from another family.toml, or from another file of the case, is no result of this one.
#[test]
fn a_family_that_was_edited_is_run_anew() {
    let dir = tempfile::tempdir().unwrap();
    let own = own_family(dir.path());
    let json = dir.path().join("f.json");
    let options = format!("--end 0.7 --family {} --baseline none --json {}", own.display(), json.display());
    let hybrid = |folder: &Path| without_model(folder, &options).output().unwrap();
    let run = || {
        let done = hybrid(dir.path());
        assert!(done.status.success(), "{}", text(&done));
        let case = &figures(&json)["cases"][0];
        (text(&done).contains("0000  dmd  "), case["runs"]["dmd"]["made_with"].clone())
    };
    let first = run();
    assert!(first.0 && run() == (false, first.1.clone()));
    let edit = |file: &str, from: &str, to: &str| edit(&own.join(file), from, to);
    // What is said of a family makes no other runs
    edit("family.toml", "about = \"", "about = \"My ");
    assert_eq!(run(), (false, first.1.clone()));
    edit("family.toml", "range = [0.9, 2.2]", "range = [0.9, 1.0]");
    let slower = run();
    assert!(slower.0 && slower.1 != first.1);
    edit("constant/transportProperties", "@nu@", "2e-3");
    let thicker = run();
    assert!(thicker.0 && thicker.1 != slower.1);
    let inside = hybrid(&own);
    assert!(text(&inside).contains("inside of the family's folder"), "{}", text(&inside));
}

/// A flow that begins at rest tells where it goes once the full run is done, and no other run is made then.
#[test]
fn a_patch_along_a_flow_from_rest_is_refused_before_the_variants() {
    let dir = tempfile::tempdir().unwrap();
    let own = own_family(dir.path());
    let edit = |file: &str, from: &str, to: &str| edit(&own.join(file), from, to);
    edit("family.toml", "patch = \"cylinder\"", "patch = \"walls\"");
    // The lower wall alone is flat.
    edit("mesh.geo", "\"walls\") = {volume[2], volume[4]}", "\"walls\") = {volume[2]}");
    edit("mesh.geo", "\"cylinder\") = {", "\"cylinder\") = {volume[4], ");
    let inlet = fs::read_to_string(own.join("0/U")).unwrap();
    let inlet = &inlet[inlet.find("        // 4 u0").unwrap()..inlet.find("        value").unwrap()];
    let ramp = "type uniformFixedValue; uniformValue table ((0 (0 0 0)) (0.2 (0.5 0 0)));\n";
    edit("0/U", inlet, ramp);
    let run = hybrid(dir.path(), &format!("--end 0.8 --family {}", own.display()));
    refused(&run, "1 runs failed:\n  0000 full: patch walls");
}

#[test]
fn solids_are_compared_by_their_displacement() {
    let dir = tempfile::tempdir().unwrap();
    // Without a model the family's plain solvers are left
    let none = m4gn("hybrid --family vibrating-beam --baseline none --out")
        .arg(dir.path().join("none"))
        .output()
        .unwrap();
    assert!(
        text(&none).contains("nothing is run of family vibrating-beam beside the full"),
        "{}",
        text(&none)
    );
    let json = dir.path().join("f.json");
    let run = m4gn("hybrid --family vibrating-beam --count 1 --seed 7 --end 0.52 --baseline loose")
        .arg("--out")
        .arg(dir.path().join("runs"))
        .arg("--json")
        .arg(&json)
        .output()
        .unwrap();
    assert!(run.status.success(), "{}", text(&run));
    assert!(text(&run).contains("D %") && !text(&run).contains("drag"), "{}", text(&run));
    for column in ["stress %", "D/range %", "force %"] {
        assert!(text(&run).contains(column), "{column}: {}", text(&run));
    }
    let found = figures(&json);
    let run = &found["cases"][0]["runs"]["loose"];
    let score = &run["score"];
    let number = |key: &str| score[key].as_f64().unwrap_or_else(|| panic!("{key}: {score}"));
    // The clamp's force is known at all times
    assert!(number("reaction") > 0.0 && number("reaction") < 0.7, "{score}");
    assert!(number("reaction_of_solver") == number("reaction"), "{score}");
    assert!(score["reaction_left_out"].is_null(), "{score}");
    assert!(number("range") > 0.0 && number("range") < number("displacement"), "{score}");
    assert!(number("displacement") < 0.2 && number("end") < 0.2 && number("stress") > 0.0, "{score}");
    assert!(score["drag"].is_null() && number("cells") == 320.0, "{score}");
    let [whole, after] = ["processor", "after_takeover"].map(|k| run["cost"][k].as_f64().unwrap());
    assert!(after > 0.0 && after < whole, "{run}");
}

#[test]
fn what_cannot_be_is_refused_before_anything_runs() {
    let dir = tempfile::tempdir().unwrap();
    // A family that says nothing of hybrid runs
    let family = fs::read_to_string(Path::new(HOME).join("openfoam/templates/cylinder-flow/family.toml"));
    let family = family.unwrap();
    let without = family.split("[hybrid]").next().unwrap();
    let lacking = family.replace("[hybrid]\n", "[hybrid]\nlibraries = [\"libm4gnNone.so\"]\n");
    let own = ["without", "lacking"].map(|name| format!("--family {}", dir.path().join(name).display()));
    for (name, text) in [("without", without), ("lacking", lacking.as_str())] {
        fs::create_dir(dir.path().join(name)).unwrap();
        fs::write(dir.path().join(name).join("family.toml"), text).unwrap();
    }
    let named = format!("--variant hybrid={}", dir.path().join("without/family.toml").display());
    for (options, words) in [
        (own[0].as_str(), "[hybrid]"),
        (own[1].as_str(), "libm4gnNone.so"),
        ("--family none-such", "cylinder-flow, pressed-rubber, vibrating-beam"),
        ("--set u0=-1", "above 0"),
        ("--baseline fast", "loose, coarse"),
        ("--answers --baseline plain=u0=1", "'plain' cannot be the name of a variant"),
        (named.as_str(), "'hybrid' cannot be"),
        ("--variant a=/dev/null", "expected a plain file, found a pipe or a device"),
        ("--variant a=/no/file", "/no/file"),
    ] {
        refused(&hybrid(dir.path(), options), words);
    }
    assert!(!dir.path().join("runs").exists());
}
