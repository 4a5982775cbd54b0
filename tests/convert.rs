//! `m4gn convert` and `m4gn predict` from outside.

#[path = "samples/records.rs"]
mod records;

use crate::program;
use m4gn_data::Trajectory;
use m4gn_model::{Kind, Model};
use std::path::Path;
use std::process::Output;

fn run(folder: &Path, arguments: &str) -> Output {
    program::m4gn().current_dir(folder).args(arguments.split(' ')).output().unwrap()
}

/// What a command prints.
fn m4gn(folder: &Path, arguments: &str) -> String {
    program::success(&run(folder, arguments))
}

fn refused(folder: &Path, arguments: &str) -> String {
    program::failure(&run(folder, arguments))
}

/// A TFRecord of two trajectories, and a model that fits them.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    put("meta.json", records::meta().to_string().as_bytes());
    put(
        "test.tfrecord",
        &[records::record(&records::example()), records::record(&records::example())].concat(),
    );
    let mut spec = m4gn_samples::model::spec();
    (spec.stride, spec.architecture.kind) = (0.5, Kind::MeshGraphNet { layers: 2 });
    Model::random(spec, 3).unwrap().write(folder.path().join("m.safetensors")).unwrap();
    folder
}

#[test]
fn data_sets_go_in_and_out() {
    let folder = folder();
    let at = folder.path();
    let said = m4gn(at, "convert test.tfrecord --out set");
    assert!(said.ends_with("2 trajectories\n") && said.contains("wrote set/test-00001.h5"), "{said}");
    assert!(m4gn(at, "convert test.tfrecord --out set --count 1").starts_with("kept  set/test-00000.h5"));
    assert!(m4gn(at, "info set").contains("2 trajectories: 0 train, 0 valid, 2 test"));
    m4gn(at, "convert set --as npz --out npz");
    m4gn(at, "convert npz/test-00001.npz --out again.h5 --split valid");
    // A number in a name is not its end
    std::fs::create_dir(at.join("numbers")).unwrap();
    for (from, to) in [("test-00000", "a-1.25"), ("test-00001", "a-1.75")] {
        std::fs::copy(at.join(format!("set/{from}.h5")), at.join(format!("numbers/{to}.h5"))).unwrap();
    }
    m4gn(at, "convert numbers --as npz --out dots");
    assert!(at.join("dots/a-1.25.npz").is_file() && at.join("dots/a-1.75.npz").is_file());
    let [a, b] = ["set/test-00001.h5", "again.h5"].map(|f| Trajectory::open(at.join(f)).unwrap());
    assert_eq!((a.mesh(), a.triangles(), a.times()), (b.mesh(), b.triangles(), b.times()));
    assert_eq!(a.recorded_frames("U").unwrap(), b.recorded_frames("U").unwrap());
    m4gn(at, "convert again.h5 --out a.pvd");
    let text = std::fs::read_to_string(at.join("a_0002.vtu")).unwrap();
    assert!(
        text.contains("NumberOfPoints=\"5\" NumberOfCells=\"4\"")
            && text.contains("Name=\"U\" NumberOfComponents=\"3\"")
    );
    std::fs::create_dir_all(at.join("case/system")).unwrap();
    std::fs::write(at.join("case/system/controlDict"), "application icoFoam;").unwrap();
    for (arguments, expected) in [
        ("convert case --out a.h5", "run its solver with -postProcess"),
        ("convert set --out a.npz", "holds 2 trajectories: give --out a folder"),
        ("convert again.h5 --out a.txt", "expected a name that ends in .npz or .pvd"),
        ("convert again.h5 --out a --as pytorch", "a trajectory is written as npz or vtu"),
        ("convert test.tfrecord --out one.h5", "holds more than one trajectory"),
        ("convert meta.json --out one.h5", "expected a file whose name ends in .tfrecord, .npz or .h5"),
        ("convert m.safetensors --out w.safetensors", "weights need --like MODEL"),
        ("convert again.h5 --out a.npz --like m.safetensors", "--like, --node-types: these are for weights"),
        ("convert again.h5 --out a.npz --dt 0.1", "which again.h5 does not: leave them out"),
        ("convert set --as npz --out b --split test", "which set does not"),
        (
            "convert again.h5 --out a.npz --poisson 0.4",
            "--split, --dt, --poisson: these are for files of others",
        ),
        ("convert m.safetensors --as pytorch --out w.safetensors --dt 1", "which m.safetensors does not"),
        (
            "convert m.safetensors --as pytorch --out w.safetensors --count 1",
            "--count: it is for trajectories",
        ),
        (
            "convert m.safetensors --as pytorch --out w.safetensors --like m.safetensors",
            "--like: it is for weights",
        ),
        (
            "convert m.safetensors --as pytorch --out w.safetensors --node-types wall",
            "--node-types: it is for",
        ),
        ("convert test.tfrecord --as npz --out b", "--as: test.tfrecord becomes trajectories"),
        ("convert test.tfrecord --out b.npz", "give NAME.h5 or a folder, and convert that"),
        ("convert again.h5 --as npz --out b.npz", "--as: the name of --out says it"),
    ] {
        let message = refused(at, arguments);
        assert!(message.contains(expected), "{message}");
    }
}

/// DeepMind's plates: the record's body deforms, and what a network of bodies says of it is a trajectory as well.
#[test]
fn bodies_go_in_and_out_and_are_predicted() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (plate, put) =
        (records::plate(), |name: &str, bytes: &[u8]| std::fs::write(at.join(name), bytes).unwrap());
    put("meta.json", records::meta_of(&plate, 0.0).to_string().as_bytes());
    put("test.tfrecord", &records::record(&records::example_of(&plate)));
    m4gn(at, "convert test.tfrecord --out a.h5 --dt 0.01 --poisson 0.3");
    assert!(m4gn(at, "info a.h5").contains("obstacle"));
    let mut spec = m4gn_samples::model::bodies();
    (spec.stride, spec.architecture.kind) = (0.01, Kind::BsmsGnn { levels: 1 });
    Model::random(spec, 3).unwrap().write(at.join("m.safetensors")).unwrap();
    m4gn(at, "predict --model m.safetensors --data a.h5 --out p.h5");
    let [truth, found] = ["a.h5", "p.h5"].map(|f| Trajectory::open(at.join(f)).unwrap());
    assert_eq!(
        (found.body(), found.obstacle(), found.times()),
        (truth.body(), truth.obstacle(), truth.times())
    );
    assert_eq!(found.read_motion(0, 1, 3).unwrap(), truth.read_motion(0, 1, 3).unwrap());
    m4gn(at, "convert p.h5 --out p.npz");
    m4gn(at, "convert p.npz --out back.h5 --poisson 0.3");
    assert_eq!(Trajectory::open(at.join("back.h5")).unwrap().mesh(), found.mesh());
    m4gn(at, "convert a.h5 --out a.pvd");
    assert!(std::fs::read_to_string(at.join("a_0002.vtu")).unwrap().contains("NumberOfCells=\"2\""));
    let message = refused(at, "convert test.tfrecord --out b.h5");
    assert!(message.contains("give a positive one with --dt"), "{message}");
    let message = refused(at, "convert test.tfrecord --out b.h5 --dt 0.01 --poisson 0.5");
    assert!(message.contains("Poisson's ratio of element 0 is 0.5"), "{message}");
}

#[test]
fn weights_go_out_and_in() {
    let folder = folder();
    let at = folder.path();
    m4gn(at, "convert m.safetensors --as physicsnemo --out w.safetensors");
    m4gn(at, "convert w.safetensors --like m.safetensors --out back.safetensors");
    let [a, b] = ["m.safetensors", "back.safetensors"].map(|f| Model::read(at.join(f)).unwrap());
    assert_eq!(a.tensors, b.tensors);
    let message = refused(at, "convert m.safetensors --as npz --out w.npz");
    assert!(message.contains("a model is written as physicsnemo or pytorch"), "{message}");
}

/// All velocities of the square grow by 1.25 m/s a frame: what knows nothing is off by that, and holding by twice of it.
#[test]
fn predictions_are_trajectories_with_their_errors() {
    let folder = folder();
    let at = folder.path();
    m4gn(at, "convert test.tfrecord --out a.h5 --count 1");
    let said = m4gn(at, "predict --model m.safetensors --data a.h5 --out p.h5 --json e.json");
    assert!(said.contains("2 steps of 0.5 s"), "{said}");
    let errors = program::figures(at.join("e.json"));
    let rows = &errors["predictions"][0]["rmse"][0];
    assert_eq!(
        (&rows["persistence"], &rows["hold_first"]),
        (&[1.25, 1.25][..].into(), &[1.25, 2.5][..].into())
    );
    let [truth, found] = ["a.h5", "p.h5"].map(|f| Trajectory::open(at.join(f)).unwrap());
    assert_eq!((found.times(), found.triangles()), (truth.times(), truth.triangles()));
    let [truth, found] = [truth, found].map(|t| t.read_frames("U", 0, 1, 3).unwrap());
    assert_eq!(found[0], truth[0]);
    // The model's row is the error of what was written, at the points that are not held.
    let pairs = found[2].cells.iter().zip(&truth[2].cells);
    let squares: Vec<f64> =
        pairs.map(|(a, b)| f64::from(a - b).powi(2)).filter(|square| *square > 0.0).collect();
    let rmse = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!((2..10).contains(&squares.len()), "{squares:?}");
    assert!((rows["model"][1].as_f64().unwrap() / rmse - 1.0).abs() < 1e-5, "{rows}");
    // Beyond what is recorded; a folder to a folder.
    m4gn(at, "predict --model m.safetensors --data a.h5 --out longer.h5 --steps 4");
    assert_eq!(Trajectory::open(at.join("longer.h5")).unwrap().times(), [0.0, 0.5, 1.0, 1.5, 2.0]);
    m4gn(at, "convert test.tfrecord --out set");
    m4gn(at, "predict --model m.safetensors --data set --out predicted --steps 1");
    // Ended and begun again: what is there stays, and is in the figures.
    let [first, second] = ["predicted/test-00000.h5", "predicted/test-00001.h5"].map(|f| at.join(f));
    std::fs::remove_file(&second).unwrap();
    let written = || first.metadata().unwrap().modified().unwrap();
    let before = written();
    m4gn(at, "predict --model m.safetensors --data set --out predicted --steps 1 --json set.json");
    let errors = program::figures(at.join("set.json"));
    let of_model = |i: usize| errors["predictions"][i]["rmse"][0]["model"][0].as_f64().unwrap();
    assert!((of_model(0) / of_model(1) - 1.0).abs() < 1e-5, "{errors}");
    assert!(second.is_file() && written() == before);
    let message = refused(at, "predict --model m.safetensors --data a.h5 --out p.h5 --steps 1");
    assert!(message.contains("p.h5") && message.contains("exists already"), "{message}");
    for (data, out, expected) in [("a.h5", "p.npz", "a name that ends in .h5"), ("set", "p2.h5", "a folder")]
    {
        let message = refused(at, &format!("predict --model m.safetensors --data {data} --out {out}"));
        assert!(message.contains(expected) && !at.join(out).exists(), "{message}");
    }
}
