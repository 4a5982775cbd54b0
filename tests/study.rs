//! `m4gn study` from outside: what is trained, tested and reported, and that it goes on where it was stopped.

use crate::program::{self, refused, success};
use m4gn_samples::training as sample;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// A test may be named as the training's figures are: `train.json`.
const STUDY: &str = r#"
title = "Two networks"
steps = 4
seeds = [1, 2]
[[data]]
name = "flow"
train = "data"
config = "config.toml"
test = [{ name = "train", data = "data" }]
[[network]]
name = "M4GN"
segments = [2]
[[network]]
name = "GCN"
base = "M4GN"
remove = ["macro", "segments", "model.layers_before", "model.layers_after"]
set = { model = { kind = "gcn", layers = 2 } }
"#;

/// Data, a configuration of `training` entries, and a study.
fn folder(training: &str, study: &str) -> tempfile::TempDir {
    let folder = sample::folder();
    std::fs::write(folder.path().join("config.toml"), sample::config(training)).unwrap();
    std::fs::write(folder.path().join("study.toml"), study).unwrap();
    folder
}

fn command(folder: &Path) -> Command {
    let mut command = program::m4gn();
    command.current_dir(folder).args(["study", "study.toml", "--out", "out"]);
    command
}

fn study(folder: &Path) -> Output {
    command(folder).output().unwrap()
}

#[test]
fn networks_are_trained_once_and_compared_with_their_baselines() {
    let folder = folder("", STUDY);
    let at = |name: &str| folder.path().join(name);
    let said = success(&study(folder.path()));
    for expected in [
        "1/4 flow/M4GN/1: 4 updates in ",
        "train with 2 segments: RMSE-1 ",
        "4/4 flow/GCN/2: ",
        "flow, train",
        "3 trajectories, U; mean ± standard deviation over seeds, 4 updates each. RMSE-all of M4GN is ",
        "M4GN, 2 segments",
        "dmd",
    ] {
        assert!(said.contains(expected), "{expected}: {said}");
    }
    let read = |name: &str| std::fs::read_to_string(at("out").join(name)).unwrap();
    let report: serde_json::Value = serde_json::from_str(&read("study.json")).unwrap();
    let test = &report["tests"][0];
    assert_eq!(test["networks"].as_array().unwrap().len(), 3, "{test}");
    assert_eq!(test["networks"][0]["seeds"], 2);
    let over = test["networks"][0]["over_diameter"].as_array().unwrap();
    assert!(over.len() == 3 && over.iter().all(|c| c["diameter"].as_u64() > Some(1)), "{over:?}");
    assert!(test["baselines"]["persistence"]["rmse_all"].as_f64().unwrap() > 0.0, "{test}");
    assert!(read("study.md").contains("| GCN |"));
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/figures.md");
    let page = std::fs::read_to_string(page).unwrap();
    for object in [&report, test, &test["networks"][0], &over[0], &report["cells"][0]] {
        for key in object.as_object().unwrap().keys() {
            assert!(page.contains(&format!("`{key}`")), "docs/reference/figures.md lacks {key}");
        }
    }

    // Nothing is made anew but what is another.
    let made = |name: &str| std::fs::metadata(at("out/flow").join(name)).unwrap().modified().unwrap();
    let files = ["M4GN/1/model.safetensors", "M4GN/1/test-train.json", "GCN/1/model.safetensors"];
    let before = files.map(made);
    let wider = STUDY.replace("layers = 2 }", "layers = 2, width = 24 }");
    std::fs::write(at("study.toml"), &wider).unwrap();
    success(&study(folder.path()));
    let after = files.map(made);
    assert_eq!(before[..2], after[..2]);
    assert_ne!(before[2], after[2]);

    // Another time of a file is no other content, wherever it lies.
    let folder_data = at("data");
    for file in std::fs::read_dir(&folder_data).unwrap() {
        let path = file.unwrap().path();
        std::fs::write(path.with_extension("copy"), std::fs::read(&path).unwrap()).unwrap();
        std::fs::rename(path.with_extension("copy"), path).unwrap();
    }
    let before = files.map(made);
    let again = success(&study(folder.path()));
    assert!(files.map(made) == before, "{again}");

    // Other data: what was there before is kept, and it is said before.
    std::fs::remove_file(at("data/000.h5")).unwrap();
    sample::write_trajectory(&at("data/000.h5"), 5, m4gn_data::Split::Train, 30).unwrap();
    let model = std::fs::read(at("out/flow/GCN/1/model.safetensors")).unwrap();
    let said = success(&study(folder.path()));
    let (told, first) = (
        said.find("3/4 flow/GCN/1: is trained anew, with another data set"),
        said.find("1/4 flow/M4GN/1: 4 updates"),
    );
    assert!(told.is_some() && told < first, "{said}");
    assert_eq!(std::fs::read(at("out/flow/GCN/1/earlier-2/model.safetensors")).unwrap(), model);
}

/// A seed that cannot be trained is told first, and the others are trained; tables say so.
#[test]
fn what_fails_is_in_the_tables() {
    let folder = folder("", &STUDY.replace("segments = [2]\n", ""));
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir_all(at("out/flow/GCN")).unwrap();
    std::fs::write(at("out/flow/GCN/2"), "in the way").unwrap();
    let done = study(folder.path());
    let (said, error) = (String::from_utf8_lossy(&done.stdout), String::from_utf8_lossy(&done.stderr));
    assert!(said.starts_with("4/4 flow/GCN/2: failed: "), "{said}");
    assert!(done.status.code() == Some(1) && error.contains("1 of 4 failed"), "{error}");
    let text = std::fs::read_to_string(at("out/study.md")).unwrap();
    assert!(text.contains("1 of 2") && text.contains("Failed: GCN, seed 2: "), "{text}");
    assert!(text.contains("over the seeds that both have: 1."), "{text}");
}

/// Nothing is trained where something of the study cannot be.
#[test]
fn all_is_checked_before_the_first_training() {
    let folder = folder("", STUDY);
    let at = |name: &str| folder.path().join(name);
    for (from, to, expected) in [
        ("\"gcn\"", "\"gnc\"", "network \"GCN\" on \"flow\": not a valid training configuration"),
        ("data = \"data\" }", "data = \"dtaa\" }", "dtaa: cannot be read"),
        (
            "data = \"data\" }",
            "data = \"data\", split = \"test\" }",
            "data: holds no trajectory of split test",
        ),
        ("train = \"data\"", "train = \"config.toml\"", "config.toml: is not an HDF5 file"),
        ("\"gcn\", layers = 2 }", "\"gcn\", layers = 2, stride = 0.015 }", "model.stride = 0.015"),
        (
            "remove =",
            "segments = [3]\nremove =",
            "network \"GCN\" on \"flow\": segments = [3]: it is a network without segments",
        ),
        ("segments = [2]", "segments = [999]", "segments = [999]: expected at most the cells or points of"),
        ("steps = 4", "steps = 4\nbackend = \"troch\"", "backend = \"troch\": expected native or torch"),
    ] {
        std::fs::write(at("study.toml"), STUDY.replacen(from, to, 1)).unwrap();
        let ended = study(folder.path());
        refused(&ended, expected);
        assert!(ended.stdout.is_empty() && !at("out/flow").exists(), "{to}: {ended:?}");
    }
}

/// Two in a folder that another program has wait; then one makes all, and the other one finds it done.
#[test]
fn two_studies_take_turns() {
    let folder = folder("", &STUDY.replace("seeds = [1, 2]", "seeds = [1]"));
    let at = |name: &str| folder.path().join(name);
    let lock = m4gn_base::lock::folder(&at("out")).unwrap();
    let mut studies = [(); 2].map(|()| command(folder.path()).stdout(Stdio::piped()).spawn().unwrap());
    let mut said = studies.each_mut().map(|study| BufReader::new(study.stdout.take().unwrap()));
    for out in &mut said {
        let mut line = String::new();
        out.read_line(&mut line).unwrap();
        let words = line.starts_with("waiting: ") && line.contains("out: is being written by process ");
        assert!(words, "{line}");
    }
    drop(lock);
    // Of one training and one validation
    let lines = said.map(|out| {
        let all = out.lines().map(Result::unwrap);
        all.filter(|l| l.starts_with("1/2") || l.starts_with("2/2")).collect::<Vec<_>>()
    });
    assert!(studies.iter_mut().all(|study| study.wait().unwrap().success()), "{lines:?}");
    assert!(lines[0].len() == 2 && lines[0] == lines[1], "{lines:?}");
}

/// Ctrl-C: the training saves its checkpoint, and goes on from there.
#[test]
fn a_study_that_is_stopped_goes_on() {
    let long = STUDY.replace("steps = 4", "steps = 100000").replace("seeds = [1, 2]", "seeds = [1]");
    let folder = folder("checkpoint_interval = 1000000", &long);
    let at = |name: &str| folder.path().join(name);
    let mut child = command(folder.path()).spawn().unwrap();
    let log = at("out/flow/M4GN/1/model.csv");
    let start = std::time::Instant::now();
    while std::fs::read_to_string(&log).map_or(0, |text| text.lines().count()) < 3 {
        assert!(start.elapsed().as_secs() < 600, "no step is made");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    m4gn_base::ffi::ask_to_end(child.id());
    assert_eq!(child.wait().unwrap().code(), Some(1));
    assert!(at("out/flow/M4GN/1/model.checkpoint").is_file());
    let count = || std::fs::read_to_string(&log).unwrap().lines().count();
    let before = count();
    // Asked at once, it has made no step less.
    let mut child = command(folder.path()).spawn().unwrap();
    while count() <= before {
        assert!(start.elapsed().as_secs() < 600, "no step is made");
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    m4gn_base::ffi::ask_to_end(child.id());
    child.wait().unwrap();
    let said = std::fs::read_to_string(at("out/flow/M4GN/1/log.train")).unwrap();
    assert!(said.contains("resumed at step "), "{said}");
}
