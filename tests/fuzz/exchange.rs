//! Fuzz targets: data sets of others.

use crate::fuzzing::{Random, fuzz};
use crate::records;
use m4gn_exchange::import::{Options, import};
use m4gn_exchange::{Array, npz};
use std::path::Path;

/// Imports what is there; what comes of it is whole.
fn read(path: &Path) {
    let out = path.with_file_name("out");
    let options = Options { dt: Some(0.5), count: Some(3), ..Options::default() };
    let mut whole = |file: &Path, _| {
        m4gn_data::Trajectory::open(file).expect("a trajectory that was just written");
        std::fs::remove_file(file).unwrap();
        Ok(())
    };
    let _ = import(path, &out, &options, &mut whole);
}

/// Writes a file that `damage` makes, and reads it.
fn target(name: &'static str, file: &str, damage: impl Fn(&mut Random, &Path) -> Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(file);
    fuzz(name, |r| {
        std::fs::write(path.with_file_name("meta.json"), records::meta().to_string()).unwrap();
        let bytes = damage(r, &path);
        std::fs::write(&path, &bytes).unwrap();
        read(&path);
        bytes.len()
    });
}

#[test]
fn tfrecord() {
    target("tfrecord", "a.tfrecord", |r, path| {
        let bodies = r.below(2) == 0;
        let arrays = if bodies { records::plate() } else { records::square() };
        let meta = records::meta_of(&arrays, if bodies { 0.0 } else { 0.5 });
        std::fs::write(path.with_file_name("meta.json"), meta.to_string()).unwrap();
        let mut example = records::example_of(&arrays);
        // Behind a checksum that is right, or in the file.
        if r.below(3) > 0 {
            r.damage(&mut example);
            return records::record(&example);
        }
        let mut bytes = records::record(&example).repeat(2);
        r.damage(&mut bytes);
        bytes
    });
}

/// An archive of files, one of which is damaged behind a checksum that is right, or which is damaged itself.
fn damaged(r: &mut Random, mut files: Vec<(String, Vec<u8>)>) -> Vec<u8> {
    if r.below(3) > 0 {
        let i = r.below(files.len());
        r.damage(&mut files[i].1);
        return records::zip(&files);
    }
    let mut bytes = records::zip(&files);
    r.damage(&mut bytes);
    bytes
}

#[test]
fn npz() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("good.npz");
    let good = [records::square(), records::plate()].map(|arrays| {
        let arrays = arrays.into_iter().map(|(name, shape, data)| (name.to_string(), Array { shape, data }));
        npz::write(&file, &arrays.collect(), &["cells", "node_type"]).unwrap();
        npz::entries(&file, |_| true).unwrap()
    });
    target("npz", "a.npz", |r, _| {
        let which = r.below(2);
        damaged(r, good[which].clone())
    });
}

#[test]
fn meta_json() {
    target("meta.json", "a.tfrecord", |r, path| {
        let mut text = records::meta().to_string().into_bytes();
        r.damage_text(&mut text);
        std::fs::write(path.with_file_name("meta.json"), text).unwrap();
        records::record(&records::example())
    });
}

#[test]
fn torch_save() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("w.pt");
    let good =
        records::state_dict(&[("a.weight", vec![2, 3], vec![0.5; 6]), ("a.bias", vec![2], vec![1.0, 2.0])]);
    fuzz("torch-save", |r| {
        let mut files = good.clone();
        if r.below(8) == 0 {
            // Tuples, lists and dicts in each other
            let at = r.below(files[0].1.len());
            let code = [b"\x85", b"\x87", b"t", b"(", b")", b"}"][r.below(6)];
            let many = code.repeat(r.below(200_000));
            files[0].1.splice(at..at, many);
        }
        let bytes = damaged(r, files);
        std::fs::write(&path, &bytes).unwrap();
        let _ = m4gn_exchange::weights::read(&path);
        bytes.len()
    });
}
