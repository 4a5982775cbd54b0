//! Files of flows that are damaged, or are no trajectories.

use super::tests::{frames, place, square, write, written};
use super::*;
use m4gn_samples::fails;
use proptest::prelude::*;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Opens a file and reads all of it.
fn read_all(path: &Path) -> m4gn_base::Result<()> {
    let trajectory = Trajectory::open(path)?;
    for field in trajectory.fields() {
        trajectory.read_frames(&field.name, 0, 1, trajectory.times().len())?;
    }
    Ok(())
}

#[test]
fn files_that_are_no_trajectories() {
    let (dir, path) = place();
    let message = |path: &Path| Trajectory::open(path).unwrap_err().to_string();
    assert!(message(&path).contains("cannot be read: No such file"));
    assert!(message(dir.path()).contains("expected a plain file, found a folder"));
    std::fs::write(&path, "text").unwrap();
    assert!(message(&path).contains("not an HDF5 file"));
    std::fs::write(&path, "").unwrap();
    assert!(message(&path).contains("not an HDF5 file"));
    let make = |attribute: &dyn Fn(&hdf5::File)| {
        write(&path, 1);
        attribute(&hdf5::File::open_rw(&path).unwrap());
        let text = message(&path);
        std::fs::remove_file(&path).unwrap();
        text
    };
    std::fs::remove_file(&path).unwrap();
    assert!(make(&|f| f.delete_attr("complete").unwrap()).contains("not finished"));
    assert!(make(&|f| f.delete_attr("format").unwrap()).contains("not a trajectory"));
    for version in [1u32, 2, 9] {
        let other = make(&|f| f.attr("version").unwrap().write_scalar(&version).unwrap());
        let named = other.contains(&format!("schema version {version}")) && other.contains("reads version 3");
        assert!(named, "{other}");
    }
    // What is said of a trajectory is looked up, and added to, by name.
    let list = make(&|f| {
        f.delete_attr("provenance").unwrap();
        super::layout::text::<8>(Path::new("a"), f, "provenance", "[1]").unwrap();
    });
    assert!(list.contains("provenance is not a JSON object"), "{list}");
    let gone = make(&|f| f.unlink("mesh/face_owner").unwrap());
    assert!(gone.contains("mesh/face_owner"), "{gone}");
    let label = make(&|f| f.dataset("mesh/face_owner").unwrap().write_raw(&[0, 1, 2, 4]).unwrap());
    assert!(label.contains("face_owner[3] is 4"), "{label}");
    let kind = make(&|f| f.dataset("mesh/boundary_type").unwrap().write_raw(&[1, 2, 77]).unwrap());
    assert!(kind.contains("node type code 77"), "{kind}");
    let frames = make(&|f| f.dataset("fields/k/cells").unwrap().resize((3, 4, 1)).unwrap());
    assert!(frames.contains("/fields/k/cells") && frames.contains("[3, 4, 1]"), "{frames}");
}

/// A copy of a file with flipped bytes.
pub(super) fn flipped(whole: &Path, places: &[(f64, u8)]) -> (TempDir, PathBuf) {
    let mut bytes = std::fs::read(whole).unwrap();
    for (place, flip) in places {
        let i = (place * bytes.len() as f64) as usize;
        bytes[i] ^= flip;
    }
    let (dir, path) = place();
    std::fs::write(&path, &bytes).unwrap();
    (dir, path)
}

/// As it lies there while a program writes it, and after one that was killed.
#[test]
fn a_file_that_another_program_has_open_is_not_called_damaged() {
    let (dir, path) = place();
    let seen = dir.path().join("b.h5");
    write(&path, 1);
    let open =
        hdf5::FileBuilder::new().with_fapl(|p| p.file_locking(false).libver_v110()).open_rw(&path).unwrap();
    std::fs::copy(&path, &seen).unwrap();
    drop(open);
    let message = Trajectory::open(&seen).unwrap_err().to_string();
    assert!(
        message.contains("b.h5: another program has it open to write") && message.contains("h5clear -s"),
        "{message}"
    );
    Trajectory::open(&path).unwrap();
}

#[test]
fn every_truncation_is_an_error() {
    let (_dir, path) = written(3);
    let whole = std::fs::read(&path).unwrap();
    for length in (0..whole.len()).step_by(97) {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(read_all(&path).is_err(), "truncated to {length} of {} bytes", whole.len());
    }
}

/// Meshes that no solver has are damage.
#[test]
fn meshes_are_checked_when_they_are_read() {
    let (_dir, path) = written(2);
    let file = hdf5::File::open_rw(&path).unwrap();
    let volumes = file.dataset("mesh/cell_volumes").unwrap();
    volumes.write_raw(&[1.0, f64::NAN, 1.0, 1.0]).unwrap();
    drop((volumes, file));
    fails(Trajectory::open(&path), &["cell_volumes[1] is NaN"]);
}

/// What lies outside of the file is not read, a pipe not waited for.
#[test]
fn links_out_of_the_file_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let other = dir.path().join("other.h5");
    write(&other, 2);
    let refused = |name: &str, change: &dyn Fn(&hdf5::File), words: &str| {
        let path = dir.path().join(name);
        write(&path, 2);
        change(&hdf5::File::open_rw(&path).unwrap());
        fails(Trajectory::open(&path), &[words]);
    };
    let soft = |f: &hdf5::File| {
        f.group("mesh").unwrap().unlink("cell_volumes").unwrap();
        f.link_soft("/mesh/face_coeff", "mesh/cell_volumes").unwrap();
    };
    refused("soft.h5", &soft, "/mesh/cell_volumes is a link to another place");
    let external = |f: &hdf5::File| {
        f.unlink("times").unwrap();
        f.link_external(other.to_str().unwrap(), "/times", "times").unwrap();
    };
    refused("external.h5", &external, "/times is a link to another place");
    let bytes = dir.path().join("bytes");
    std::fs::write(&bytes, [0u8; 32]).unwrap();
    let stored = |f: &hdf5::File| {
        f.unlink("times").unwrap();
        let new = f.new_dataset::<f64>().shape((2,));
        new.external(bytes.to_str().unwrap(), 0, 16).create("times").unwrap();
    };
    refused("stored.h5", &stored, "the values of /times are stored in other files");

    let pipe = dir.path().join("pipe.h5");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
    assert!(made.success());
    fails(Trajectory::open(&pipe), &["expected a plain file, found a pipe"]);
}

/// Flipped bytes anywhere give the values that were written or an error, never a panic, and never others: all is
/// checksummed.
#[test]
fn damaged_bytes_never_panic() {
    let (_dir, good) = written(2);
    let whole = Trajectory::open(&good).unwrap();
    let config = ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() };
    proptest!(config, |(places in prop::collection::vec((0.0..1.0f64, 1..=255u8), 1..4))| {
        let (_dir, path) = flipped(&good, &places);
        if let Ok(trajectory) = Trajectory::open(&path) {
            prop_assert_eq!(trajectory.mesh(), &square());
            prop_assert_eq!(trajectory.times(), whole.times());
            for (f, meta) in trajectory.fields().to_vec().iter().enumerate() {
                if let Ok(frame) = trajectory.read_frame(&meta.name, 1) {
                    prop_assert_eq!(&frame, &frames(1)[f]);
                }
            }
        }
    });
}
