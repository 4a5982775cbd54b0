//! Fuzz targets: files as they are read, and (`abi.rs`, `bodies.rs`) what a host hands to the C ABI. See `../fuzzing/mod.rs`.
#![allow(unsafe_code)]

mod abi;
mod bodies;
mod damaged;
#[path = "../fuzzing/mod.rs"]
mod fuzzing;
#[path = "../host/mod.rs"]
mod host;
mod ride;

use fuzzing::{Random, fuzz};
use m4gn_data::{FieldMeta, Recorder, Split, Trajectory, WriteOptions};
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_step::{Field, Session, SessionOptions};
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

#[test]
fn model_file() {
    let good = std::fs::read(root().join("tests/cabi/small.safetensors")).unwrap();
    let mesh = sample::triangles(5, 4, 1.0, 0.7);
    fuzz("model", |r| {
        let mut bytes = good.clone();
        match r.below(2) {
            // The header is a twentieth of the file, and where the readers' work is.
            0 => damage_header(&mut bytes, r),
            _ => r.damage(&mut bytes),
        }
        if let Ok(model) = Model::from_bytes(&bytes, "fuzz.safetensors") {
            // What is read must be fit to be written, and to be used.
            assert!(model.to_bytes().is_ok());
            let _ = Session::new(Comm::serial(), &mesh, &model, &SessionOptions::default());
        }
        bytes.len()
    });
}

/// Damages the header of a file of tensors: its length, then so many bytes of text, then the numbers.
fn damage_header(bytes: &mut Vec<u8>, r: &mut Random) {
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let tail = bytes.split_off(header);
    let mut text = bytes.split_off(8);
    r.damage_text(&mut text);
    *bytes = (text.len() as u64).to_le_bytes().to_vec();
    bytes.extend(text.into_iter().chain(tail));
}

/// A file that no other test uses.
fn place(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    (folder, path)
}

fn recorded_flow() -> Vec<u8> {
    let (_folder, path) = place("flow.h5");
    let mesh = sample::triangles(4, 3, 1.0, 0.7);
    let field =
        |name: &str, vector| FieldMeta { name: name.into(), vector, dimensions: [0, 1, -1, 0, 0, 0, 0] };
    let options = WriteOptions {
        fields: vec![field("U", true), field("p", false)],
        provenance: serde_json::json!({ "case": "fuzz" }),
        split: Split::Train,
        overwrite: false,
    };
    let mut recorder = Recorder::create(&Comm::serial(), &mesh, &path, &options).unwrap();
    let (cells, faces) = (vec![0.25; 3 * mesh.n_cells()], vec![0.5; 3 * mesh.boundary.len()]);
    for frame in 0..3 {
        let of = |name, components| Field {
            name,
            components,
            cells: &cells[..components * mesh.n_cells()],
            boundary: &faces[..components * mesh.boundary.len()],
        };
        recorder.append(0.1 * f64::from(frame), &[of("U", 3), of("p", 1)]).unwrap();
    }
    recorder.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// Reads all that a training reads.
fn read_all(path: &Path) {
    let Ok(t) = Trajectory::open(path) else { return };
    let n = t.times().len();
    for f in t.fields() {
        let _ = t.read_frame(&f.name, n - 1);
        let _ = t.read_frames(&f.name, 0, 1, n);
    }
    let _ = t.read_motion(0, 1, n);
}

/// Damages a whole file again and again.
fn damaged(target: &'static str, good: Vec<u8>) {
    let (_folder, path) = place("damaged.h5");
    fuzz(target, |r| {
        let mut bytes = good.clone();
        r.damage(&mut bytes);
        std::fs::write(&path, &bytes).unwrap();
        read_all(&path);
        bytes.len()
    });
}

#[test]
fn data_set_of_a_flow() {
    damaged("data-flow", recorded_flow());
}

#[test]
fn data_set_of_a_body() {
    damaged("data-body", std::fs::read(root().join("tests/data/solid.h5")).unwrap());
}
