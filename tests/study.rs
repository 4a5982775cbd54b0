//! `m4gn study` from outside: what is trained, tested and reported, and that it goes on where it was stopped.

use m4gn_samples::training as sample;
use std::path::Path;
use std::process::{Command, Output};

const STUDY: &str = r#"
title = "Two networks"
steps = 4
seeds = [1, 2]
[[data]]
name = "flow"
train = "data"
config = "config.toml"
test = [{ name = "all of it", data = "data" }]
[[network]]
name = "M4GN"
segments = [2]
[[network]]
name = "GCN"
base = "M4GN"
remove = ["macro", "segments", "model.layers_before", "model.layers_after"]
set = { model = { kind = "gcn", layers = 2 } }
"#;

fn study(folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_m4gn"));
    command.current_dir(folder).args(["study", "study.toml", "--out", "out"]).output().unwrap()
}

#[test]
fn networks_are_trained_once_and_compared_with_their_baselines() {
    let folder = sample::folder();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("config.toml"), sample::config("")).unwrap();
    std::fs::write(at("study.toml"), STUDY).unwrap();
    let first = study(folder.path());
    let said = String::from_utf8_lossy(&first.stdout).into_owned();
    assert!(first.status.success(), "{said}{}", String::from_utf8_lossy(&first.stderr));
    for expected in [
        "1/4 flow/M4GN/1: 4 updates in ",
        "all of it with 2 segments: RMSE-1 ",
        "4/4 flow/GCN/2: ",
        "flow, all of it",
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
    assert!(read("study.md").contains("| GCN |") && read("study.tex").contains("GCN & "));
    assert!(read("study.html").contains("<td>GCN</td>"));

    // Nothing is made anew but what is another.
    let made = |name: &str| std::fs::metadata(at("out/flow").join(name)).unwrap().modified().unwrap();
    let files = ["M4GN/1/model.safetensors", "M4GN/1/all of it.json", "GCN/1/model.safetensors"];
    let before = files.map(made);
    let wider = STUDY.replace("layers = 2 }", "layers = 2, width = 24 }");
    std::fs::write(at("study.toml"), &wider).unwrap();
    assert!(study(folder.path()).status.success());
    let after = files.map(made);
    assert_eq!(before[..2], after[..2]);
    assert_ne!(before[2], after[2]);

    // A network that cannot be is told, and the others are reported.
    std::fs::write(at("study.toml"), wider.replace("\"gcn\"", "\"gnc\"")).unwrap();
    let last = study(folder.path());
    let (said, error) = (String::from_utf8_lossy(&last.stdout), String::from_utf8_lossy(&last.stderr));
    assert!(said.contains("3/4 flow/GCN/1: failed: ") && said.contains("gnc"), "{said}");
    assert!(last.status.code() == Some(1) && error.contains("2 of 4 failed"), "{error}");
    assert!(at("out/study.html").is_file());
}
