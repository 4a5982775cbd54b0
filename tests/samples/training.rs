//! Small synthetic trajectories and configurations, for tests.

use m4gn_base::{Error, Result};
use m4gn_data::{FieldMeta, Frame, Split, WriteOptions, Writer};
use m4gn_mesh::{Mesh, NodeType};
use m4gn_samples::mesh::{flow, triangles};
use m4gn_train::Request;
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};

/// A folder with three trajectories in `data`.
///
/// # Panics
/// Where they cannot be written.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("data")).unwrap();
    write_data(&folder.path().join("data"), 3).unwrap();
    folder
}

/// The losses in a training's log.
///
/// # Panics
/// Where there is none.
pub fn losses(request: &Request) -> Vec<f64> {
    let text = std::fs::read_to_string(request.log()).unwrap();
    text.lines().skip(1).map(|l| l.split(',').nth(4).unwrap().parse().unwrap()).collect()
}

/// Writes `count` trajectories of a vortex that is carried along a channel, frames every 0.01 s.
///
/// # Errors
/// As [`Writer`].
pub fn write_data(folder: &Path, count: usize) -> Result<()> {
    for number in 0..count {
        let split = if number + 1 == count { Split::Valid } else { Split::Train };
        write_trajectory(&folder.join(format!("{number:03}.h5")), number, split, 30)?;
    }
    Ok(())
}

/// Writes one of them, of so many frames.
///
/// # Errors
/// As [`Writer`].
pub fn write_trajectory(path: &Path, number: usize, split: Split, frames: usize) -> Result<()> {
    write_trajectory_on(path, &triangles(6, 4, 1.5, 1.0), number, split, frames)
}

/// The same on a mesh of 1.5 m x 1 m.
///
/// # Errors
/// As [`Writer`].
pub fn write_trajectory_on(
    path: &Path,
    mesh: &Mesh,
    number: usize,
    split: Split,
    frames: usize,
) -> Result<()> {
    let options = WriteOptions {
        fields: vec![
            FieldMeta { name: "U".into(), vector: true, dimensions: [0, 1, -1, 0, 0, 0, 0] },
            FieldMeta { name: "p".into(), vector: false, dimensions: [0, 2, -2, 0, 0, 0, 0] },
        ],
        provenance: serde_json::json!({ "application": "test" }),
        split,
        overwrite: false,
    };
    let mut writer = Writer::create(path, mesh, &options)?;
    for frame in 0..frames {
        let time = 0.01 * frame as f64;
        let flow = |x: [f64; 3]| flow(x, [0.3 + 0.1 * number as f64 + time, 0.5]);
        let mut frames = vec![Frame::default(), Frame::default()];
        for &x in &mesh.cell_centres {
            let (u, p) = flow(x);
            frames[0].cells.extend(u);
            frames[1].cells.push(p);
        }
        for face in &mesh.boundary {
            let outlet = face.kind == NodeType::Outlet;
            let (u, p) = flow(mesh.cell_centres[face.owner as usize]);
            frames[0].boundary.extend(if outlet { u } else { [0.5, 0.0] });
            frames[1].boundary.push(if outlet { 0.0 } else { p });
        }
        writer.append(time, &frames)?;
    }
    writer.finish()?;
    Ok(())
}

/// A small network; `training` is appended to the `[training]` table.
pub fn config(training: &str) -> String {
    format!(
        r#"
        [model]
        stride = 0.02
        width = 16
        hidden_layers = 1
        activation = "relu"
        layers_before = 1
        layers_after = 1
        fields = [{{ name = "U", input = true, output = "delta" }}, {{ name = "p", input = true, output = "value" }}]
        [macro]
        layers = 1
        heads = 2
        ffn_width = 16
        rwse_steps = 3
        centroids = true
        offsets = true
        [segments]
        method = "metis"
        count = 4
        [training]
        batch_size = 3
        micro_batch = 2
        learning_rate = 2e-3
        decay_steps = 1000
        noise = {{ U = 0.01, p = 0.01 }}
        mirror = true
        ema_decay = 0.9
        gradient_clip = 1.0
        unroll = [[0, 1], [6, 2]]
        normaliser_steps = 4
        normaliser_warmup = 2
        log_interval = 2
        {training}
    "#
    )
}

/// A training of `steps` steps in a folder with data: files `name.toml`, `name.safetensors` and `name.json`; `training` is
/// what its configuration has differently ([`config`]).
///
/// # Panics
/// Where the configuration cannot be written.
pub fn request(folder: &Path, name: &str, training: &str, steps: u64) -> Request {
    let config = folder.join(format!("{name}.toml"));
    std::fs::write(&config, self::config(training)).unwrap();
    Request { json: Some(folder.join(format!("{name}.json"))), ..request_of(folder, &config, name, steps) }
}

/// The same by a configuration that is there, without figures.
pub fn request_of(folder: &Path, config: &Path, name: &str, steps: u64) -> Request {
    Request {
        data: folder.join("data"),
        config: config.into(),
        out: folder.join(format!("{name}.safetensors")),
        threads: Some(1),
        steps: Some(steps),
        ..Request::default()
    }
}

/// Runs a training and stops it once its log is as `until` says, unless it has ended before.
///
/// # Panics
/// Where it fails.
pub fn interrupt(
    request: &Request,
    until: impl Fn(&str) -> bool,
    train: impl FnOnce(&AtomicU8) -> Result<serde_json::Value> + Send,
) {
    let (stop, log) = (AtomicU8::new(0), request.log());
    let outcome = std::thread::scope(|scope| {
        let training = scope.spawn(|| train(&stop));
        while !training.is_finished() {
            if std::fs::read_to_string(&log).is_ok_and(|text| until(&text)) {
                stop.store(1, Ordering::Relaxed);
            }
            std::thread::yield_now();
        }
        training.join().unwrap()
    });
    match outcome {
        Err(Error::Interrupted(message)) => assert!(message.contains("--resume"), "{message}"),
        other => drop(other.unwrap()),
    }
}
