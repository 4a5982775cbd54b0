//! Fuzz targets: the files of a training.

use crate::fuzzing::fuzz;
use m4gn_learn::normaliser::{Moments, Normaliser};
use m4gn_train::checkpoint::{Checkpoint, Progress, VERSION};
use m4gn_train::config::Config;
use std::path::Path;

#[test]
fn training_configuration() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let files = std::fs::read_dir(folder).unwrap();
    let mut paths: Vec<_> = files.map(|f| f.unwrap().path()).filter(|p| p.is_file()).collect();
    paths.sort();
    let good: Vec<Vec<u8>> = paths.iter().map(|p| std::fs::read(p).unwrap()).collect();
    fuzz("config", |r| {
        let mut bytes = r.pick(&good).clone();
        r.damage_text(&mut bytes);
        if let Ok(config) = Config::parse(&String::from_utf8_lossy(&bytes)) {
            let t = &config.training;
            let _ = (config.architecture(), t.longest_unroll());
            for step in [0, 1, 1000, u64::MAX] {
                let _ = (t.learning_rate_at(step), t.unroll_at(step));
            }
        }
        bytes.len()
    });
}

#[test]
fn checkpoint() {
    let moments = || Moments { count: vec![10.0; 3], sum: vec![1.0; 3], square: vec![2.0; 3] };
    let normaliser = Normaliser { node: moments(), edge: moments(), output: moments() };
    let checkpoint = Checkpoint {
        progress: Progress {
            version: VERSION,
            step: 10,
            updates: 5,
            samples: 40,
            seconds: 1.5,
            seed: 1,
            config: serde_json::json!({ "model": { "width": 8 } }),
            data: vec!["a.h5 3".into()],
            best: None,
            interval: (3, 0.5, 0.1, vec![0.2]),
            from: None,
        },
        weights: vec![0.5; 40],
        first: vec![0.1; 40],
        second: vec![0.2; 40],
        average: Some(vec![0.4; 40]),
        best: None,
        normaliser,
        best_normaliser: None,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("training.checkpoint");
    checkpoint.write(&path).unwrap();
    let good = std::fs::read(&path).unwrap();
    fuzz("checkpoint", |r| {
        let mut bytes = good.clone();
        r.damage(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        let _ = Checkpoint::read(&path);
        bytes.len()
    });
}
