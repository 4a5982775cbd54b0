//! Draws and files of the families that come with m4gn.

use super::*;
use crate::fixtures;
use crate::generate::command::{Command, Conditional};
use crate::generate::parameter::{Settings, parse_setting};
use m4gn_samples::fails;

fn family(name: &str) -> Family {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates");
    Family::load(&home.join(name)).unwrap()
}

fn settings(texts: &[&str]) -> Settings {
    texts.iter().map(|t| parse_setting(t).unwrap()).collect()
}

fn case(name: &str, set: &[&str]) -> FamilyCase {
    let family = family(name);
    FamilyCase {
        seed: 3,
        index: 4,
        draw: family.draw(3, 4, &settings(set)).unwrap(),
        split: Split::Valid,
        frames: family.recording.frames,
        interval: family.recording.interval,
        spin_up: family.recording.spin_up,
        command: "m4gn generate".into(),
        family: Arc::new(family),
    }
}

/// What version 0.1.0 drew: the data sets of the shipped models are these.
#[test]
fn the_draws_of_a_seed_stay() {
    let family = family("cylinder-flow");
    let draw = |seed, index| {
        let draw = family.draw(seed, index, &Settings::new()).unwrap();
        ["x", "y", "radius", "u0"].map(|name| draw.variables[name])
    };
    assert_eq!(draw(1, 0), OLD[0]);
    assert_eq!(draw(7, 1), OLD[1]);
}

const OLD: [[f64; 4]; 2] =
    [[0.300621, 0.142058, 0.05588, 1.185122], [0.448027, 0.131358, 0.060256, 1.586537]];

#[test]
fn draws_are_in_range_and_depend_on_seed_and_index_only() {
    let family = family("cylinder-flow");
    let mut all = std::collections::BTreeSet::new();
    for index in 0..500 {
        let draw = family.draw(7, index, &Settings::new()).unwrap();
        assert_eq!(draw, family.draw(7, index, &Settings::new()).unwrap());
        let [x, y, r] = ["x", "y", "radius"].map(|n| draw.variables[n]);
        assert!((0.2..=0.45).contains(&x), "{draw:?}");
        // At least 5 cm between the cylinder and either wall
        assert!(y - r >= 0.05 && 0.41 - y - r >= 0.05, "{draw:?}");
        all.insert(x.to_bits());
    }
    assert!(all.len() > 490, "{} different of 500", all.len());
}

#[test]
fn faster_flow_and_finer_meshes_need_more_steps() {
    let family = family("cylinder-flow");
    let steps = |set: &[&str], interval| {
        let mut all = settings(&["x=0.3", "y=0.2"]);
        all.extend(settings(set));
        family.steps(&family.draw(1, 0, &all).unwrap(), interval).unwrap()
    };
    let slow = steps(&["u0=0.9", "radius=0.035", "mesh=coarse"], 0.01);
    let fast = steps(&["u0=2.2", "radius=0.07"], 0.01);
    assert!(slow >= 2 && slow < fast, "{slow} {fast}");
    assert!(fast < steps(&["u0=2.2", "radius=0.07", "mesh=fine"], 0.01));
    assert!(fast < steps(&["u0=2.2", "radius=0.07", "cells=4"], 0.01));
    // The tutorial: 0.002 s
    let tutorial = ["u0=1.55", "radius=0.052", "courant=1"];
    assert_eq!(steps(&tutorial, 0.05), 25);
}

#[test]
fn every_placeholder_is_filled() {
    for (name, end) in [
        ("cylinder-flow", "7;"),
        ("pressed-rubber", "2.58;"),
        ("vibrating-rubber", "2.6;"),
        ("vibrating-beam", "1.3;"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let case = case(name, &[]);
        case.write(dir.path()).unwrap();
        let files = files(&case.family.folder).unwrap();
        assert!(files.len() >= 8, "{files:?}");
        for file in files {
            let text = std::fs::read_to_string(dir.path().join(&file)).unwrap();
            let left = text.lines().find(|l| !l.trim_start().starts_with("//") && l.contains('@'));
            assert_eq!(left, None, "{file:?}");
        }
        let control = std::fs::read_to_string(dir.path().join("system/controlDict")).unwrap();
        assert!(control.contains(&format!("endTime         {end}")), "{control}");
        assert!(!dir.path().join(FILE).exists());
    }
}

#[test]
fn commands_run_where_their_condition_holds() {
    let mut family = family("cylinder-flow");
    let draw = |elements: &str| family.draw(1, 0, &settings(&[&format!("elements={elements}")])).unwrap();
    assert_eq!(
        family.programs(&draw("quads")).unwrap(),
        ["gmsh", "gmshToFoam", "changeDictionary", "icoFoam"]
    );
    assert_eq!(
        family.programs(&draw("polyhedra")).unwrap(),
        ["gmsh", "gmshToFoam", "polyDualMesh", "extrudeMesh", "changeDictionary", "icoFoam"]
    );
    assert_eq!(
        family.programs(&draw("hexahedra")).unwrap(),
        ["blockMesh", "snappyHexMesh", "extrudeMesh", "changeDictionary", "icoFoam"]
    );
    family.prepare.push(Command::When(Conditional { when: "colour == 2".into(), run: vec!["true".into()] }));
    fails(family.draw(1, 0, &Settings::new()), &["colour == 2"]);
}

#[test]
fn an_unknown_placeholder_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("my-family");
    let text = "about = 'x'\nsolver = ['icoFoam']\nsteps = '1'\n[recording]\nfields = ['U']\nframes = 1\ninterval = 1\nspin_up = 1\n";
    fixtures::write(&folder, &[(FILE, text), ("a", "1 @ 2 @@ @deltaT@ @size@")]);
    let family = Family::load(&folder).unwrap();
    let times = Times { delta_t: 0.5, end: 1.0, write_interval: 1.0 };
    let draw = family.draw(1, 1, &Settings::new()).unwrap();
    let write = || family.write(&family.files(&draw, times)?, "", &dir.path().join("case"));
    fails(write(), &["my-family/a", "@size@"]);
    std::fs::write(folder.join("a"), "1 @ 2 @@ @deltaT@").unwrap();
    std::fs::set_permissions(folder.join("a"), Permissions::from_mode(0o755)).unwrap();
    write().unwrap();
    assert_eq!(dir.path().join("case/a").metadata().unwrap().permissions().mode() & 0o111, 0o111);
    let written = std::fs::read_to_string(dir.path().join("case/a")).unwrap();
    assert_eq!(written, "1 @ 2 @@ 0.5");
    // What family.toml has wrong
    for (bad, words) in [
        ("surplus = 1\n", "surplus"),
        ("[[parameter]]\nname = 'a'\n", "either 'range'"),
        ("[[parameter]]\nname = 'deltaT'\nvalue = 1\n", "cannot be the name"),
        ("[[derived]]\nname = 'b'\n", "value"),
        ("label = 'of @size@ m'\n", "label: @size@"),
        (ANSWERS, "hybrid.answers: functions: @speed@"),
    ] {
        let text = match bad.starts_with('[') {
            true => format!("{text}{bad}"),
            false => format!("{bad}{text}"),
        };
        std::fs::write(folder.join(FILE), text).unwrap();
        fails(Family::load(&folder), &["family.toml", words]);
    }
}

const ANSWERS: &str = "[hybrid]\nstart_up = 1\nend = 3\ninterval = 1\nsolver_time = 1\nsurrogate_steps = 1\n\
                       [hybrid.answers]\nend = 3\nmin_time = 1\nquantities = ''\nfunctions = 'a { magUInf @speed@; }'\n";

#[test]
fn another_case_is_told_from_this_one() {
    let plain = case("cylinder-flow", &[]);
    let mut provenance = serde_json::json!({
        "frames": 600, "frameInterval": 0.01, "spinUp": 1, "inputs": plain.made_of().unwrap().2,
    });
    for (name, value) in origin(&plain.family, 3, 4, &plain.draw) {
        provenance[name] = value.parse::<f64>().map_or(value.into(), Into::into);
    }
    let told = |case: &FamilyCase, provenance| case.difference(provenance).unwrap();
    assert_eq!(told(&plain, &provenance), None);
    let finer = told(&case("cylinder-flow", &["cells=2"]), &provenance);
    assert_eq!(finer.unwrap(), "cells 1.0 instead of 2");
    let square = told(&case("cylinder-flow", &["shape=square"]), &provenance);
    assert_eq!(square.unwrap(), "shape \"cylinder\" instead of square");
    let mut other = provenance.clone();
    other["u0"] = 5.into();
    assert!(told(&plain, &other).unwrap().starts_with("u0 5 instead of"));
    assert!(told(&plain, &serde_json::Value::Null).is_some());
    // What no number of the draw says: the solver's steps, a command, the text of a file
    let mut edited = case("cylinder-flow", &[]);
    let family = Arc::make_mut(&mut edited.family);
    family.steps = format!("2*({})", family.steps);
    assert!(told(&edited, &provenance).unwrap().contains("family.toml"));
    let mut edited = case("cylinder-flow", &[]);
    Arc::make_mut(&mut edited.family).solver.push("-noFunctionObjects".into());
    assert!(told(&edited, &provenance).is_some());
    let copy = tempfile::tempdir().unwrap();
    let folder = copy.path().join("cylinder-flow");
    for (file, bytes) in plain.family.files(&plain.draw, plain.times().unwrap().0).unwrap() {
        put(&folder.join(file), &bytes).unwrap();
    }
    let mut edited = case("cylinder-flow", &[]);
    Arc::make_mut(&mut edited.family).folder = folder.clone();
    assert_eq!(told(&edited, &provenance), None);
    put(&folder.join("constant/transportProperties"), b"nu 5e-3;").unwrap();
    assert!(told(&edited, &provenance).unwrap().contains("a file of the family"));
}

#[test]
fn what_is_no_file_and_what_lies_inside_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("own");
    put(&folder.join("system/controlDict"), b"x").unwrap();
    let mut family = family("cylinder-flow");
    family.folder = folder.canonicalize().unwrap();
    assert_eq!(files(&family.folder).unwrap(), [PathBuf::from("system/controlDict")]);
    for out in ["data", "system/data", "."] {
        fails(family.check_outside(&folder.join(out)), &["inside of the family's folder"]);
    }
    family.check_outside(&dir.path().join("own-data")).unwrap();
    for target in ["/dev/urandom", "/tmp"] {
        let link = folder.join("link");
        std::os::unix::fs::symlink(target, &link).unwrap();
        fails(files(&family.folder), &["no plain file"]);
        std::fs::remove_file(link).unwrap();
    }
    let pipe = std::process::Command::new("mkfifo").arg(folder.join("pipe")).status();
    assert!(pipe.unwrap().success());
    assert!(files(&family.folder).is_err());
}

#[test]
fn impossible_cases_are_refused() {
    let family = family("cylinder-flow");
    let refused = |set: &[&str]| family.draw(1, 0, &settings(set)).unwrap_err().to_string();
    assert!(refused(&["radius=0.3"]).contains("from either wall"));
    assert!(refused(&["speed=1"]).contains("it has x, y, radius, u0, nu"));
    assert!(refused(&["mesh=thin"]).contains("coarse, fine, standard"));
    assert!(refused(&["nu=-1:1"]).contains("above 0"));
    fails(Family::find(Path::new("no-such-family")), &["family.toml"]);
}

#[test]
fn the_courant_number_is_read_from_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("log");
    std::fs::write(&log, "Time = 1\nCourant Number mean: 0.1 max: 0.7\nCourant Number mean: 0.2 max: 0.65\n")
        .unwrap();
    assert_eq!(largest_courant(&log), Some(0.7));
    assert_eq!(largest_courant(&dir.path().join("none")), None);
}

/// The beam of solids4foam begins undeformed, with the velocities that were drawn.
#[test]
fn the_beam_of_solids4foam_starts_as_it_was_drawn() {
    for index in 0..20 {
        let cells = family("vibrating-rubber").draw(7, index, &Settings::new()).unwrap().variables;
        for k in 1..=3 {
            let velocity = cells[&format!("velocity{k}")];
            let before = cells[&format!("o{k}")];
            assert!((before + velocity * cells["step"]).abs() < 1e-12);
        }
    }
}

/// The first mode has 0.851 1/s and the others the ratios of a cantilever.
#[test]
fn the_beam_starts_as_it_was_drawn() {
    let family = family("vibrating-beam");
    for index in 0..20 {
        let v = family.draw(7, index, &Settings::new()).unwrap().variables;
        let frequency = |k: u32| v[&format!("omega{k}")] / std::f64::consts::TAU;
        assert!((frequency(1) - 0.8513).abs() < 1e-4);
        assert!((frequency(2) / frequency(1) - 6.2669).abs() < 1e-3);
        assert!((frequency(3) / frequency(1) - 17.5475).abs() < 1e-3);
        for k in 1..=3 {
            let [a, phase, omega, now, before] =
                ["amplitude", "phase", "omega", "d", "o"].map(|name| v[&format!("{name}{k}")]);
            assert!(now.abs() <= a && a <= [0.025, 2e-3, 3e-4][k - 1]);
            // The backward difference is the rate half a step earlier
            let middle = -a * omega * (phase - 0.5 * omega * 1e-3).sin();
            assert!(((now - before) / 1e-3 - middle).abs() < 1e-3 * a * omega + 1e-12);
        }
    }
}
