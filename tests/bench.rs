//! `m4gn bench` from outside: its figures, what it exports, and the lines of a worker. Nothing here depends on speed.

use crate::program::{self, figures, success};
use std::io::{BufRead, BufReader, Write};
use std::process::{Output, Stdio};

fn m4gn(args: &[&str]) -> Output {
    program::m4gn().args(args).output().unwrap()
}

/// A network small enough for a test.
const SMALL: [&str; 9] = ["bench", "--nodes", "60", "--layers", "2", "--width", "16", "--hidden", "1"];

#[test]
fn figures_of_a_small_network() {
    let dir = tempfile::tempdir().unwrap();
    let json = dir.path().join("bench.json");
    for extra in
        [&["--precision", "fp32"][..], &["--precision", "bf16", "--threads", "2"], &["--segments", "5"]]
    {
        let options = ["--steps", "3", "--json", json.to_str().unwrap()];
        let text = success(&m4gn(&[&SMALL[..], &options[..], extra].concat()));
        assert!(text.contains("edge blocks") && text.contains("encode nodes"), "{text}");
        let found = figures(&json);
        for key in
            ["ms_per_step", "gflops", "gemm_peak_gflops", "peak_share", "edge_block_share", "peak_memory_mib"]
        {
            assert!(found[key].as_f64().is_some_and(|v| v != 0.0), "{key}: {found}");
        }
        // 4 x 15 points: 3 V - 2 x 4 edges in both directions.
        assert_eq!(found["network"]["nodes"], 60);
        assert_eq!(found["network"]["edges"], 2 * (180 - 8));
        assert_eq!(found["steps"], 3);
        if extra[0] == "--precision" {
            // Rows of 2 x 16 x 16 operations: per layer 2 an edge and 5 a node; encoder and decoder one a node each,
            // and 2 x 16 x 3 for the fields at both ends.
            let rows = 2 * (2 * 344 + 5 * 60) + 2 * 60;
            let flops = (rows * 512 + 60 * 2 * 96) as f64;
            assert!((found["gflop_per_step"].as_f64().unwrap() * 1e9 - flops).abs() < 1e-3);
            let share = found["gflops"].as_f64().unwrap() / found["gemm_peak_gflops"].as_f64().unwrap();
            assert!((found["peak_share"].as_f64().unwrap() - share).abs() < 1e-9);
            assert!(found["phases"].as_array().unwrap().iter().all(|p| p["ms"].as_f64().unwrap() > 0.0));
        }
    }
}

#[test]
fn hexahedra_and_a_model_file() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().to_str().unwrap();
    let description = success(&m4gn(&[&SMALL[..], &["--export", folder]].concat()));
    let found: serde_json::Value = serde_json::from_str(&description).unwrap();
    assert_eq!(found["layers"], 2);
    let graph = std::fs::read(dir.path().join("graph.safetensors")).unwrap();
    let graph = safetensors::SafeTensors::deserialize(&graph).unwrap();
    assert_eq!(graph.tensor("inputs").unwrap().shape(), [60, 3]);
    assert_eq!(graph.tensor("senders").unwrap().shape(), [344]);
    assert_eq!(graph.tensor("edge_features").unwrap().shape(), [344, 3]);

    let model = format!("{folder}/model.safetensors");
    let text = success(&m4gn(&["bench", "--model", &model, "--nodes", "60", "--steps", "1"]));
    assert!(text.contains("2 layers, width 16"), "{text}");
    let text = success(&m4gn(&[
        "bench", "--hex", "--nodes", "64", "--layers", "1", "--width", "16", "--steps", "1",
    ]));
    // 4^3 cells and 96 boundary faces; 3 x 48 faces and 96 boundary faces, both ways.
    assert!(text.contains("160 nodes, 480 directed edges"), "{text}");
    // A model of two dimensions on a mesh of three.
    let refused = m4gn(&["bench", "--hex", "--nodes", "64", "--model", &model]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("dimensions"));
}

/// A step of the network, and one of its training.
#[test]
fn a_worker_answers_line_by_line() {
    answers(&["--worker"]);
    answers(&["--worker", "--train", "--unroll", "2", "--batch", "3"]);
    answers(&["--worker", "--train", "--segments", "5", "--precision", "bf16", "--threads", "2"]);
}

fn answers(options: &[&str]) {
    let mut worker = program::m4gn()
        .args([&SMALL[..], options].concat())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut to = worker.stdin.take().unwrap();
    let mut from = BufReader::new(worker.stdout.take().unwrap()).lines();
    let description: serde_json::Value = serde_json::from_str(&from.next().unwrap().unwrap()).unwrap();
    assert_eq!(description["nodes"], 60);
    for _ in 0..2 {
        writeln!(to, "run").unwrap();
        let line = from.next().unwrap().unwrap();
        let ms: Vec<f64> = line.split(' ').map(|v| v.parse().unwrap()).collect();
        assert!(ms.len() == 2 && ms[0] > 0.0, "{line}");
    }
    drop(to);
    assert!(worker.wait().unwrap().success());
}

#[test]
fn bad_usage_is_told() {
    for (args, message) in [
        (&["bench", "--threads", "0"][..], "--threads 0"),
        (&["bench", "--precision", "fp8"], "expected fp32 or bf16"),
        (&["bench", "--nodes", "2"], "expected 9 to"),
        (&["bench", "--model", "/nonexistent"], "/nonexistent"),
        (&["bench", "--nodes", "60", "--segments", "100"], "100 segments for 60 nodes"),
        (&["bench", "--worker", "--json", "x"], "cannot be used with"),
        (&["bench", "--worker", "--train", "--batch", "0"], "--batch 0"),
        (&["bench", "--batch", "2"], "--train"),
        (&["bench", "--train"], "--worker"),
    ] {
        let output = m4gn(args);
        assert!(!output.status.success());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains(message), "{args:?}: {error}");
    }
}
