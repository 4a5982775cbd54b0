//! Round trips, recordings that fail, full disks.

use super::*;
use m4gn_base::Error;
use m4gn_mesh::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_samples::fails;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Two by two unit cells, walls all round but an inlet on the left, one cyclic pair.
pub(super) fn square() -> Mesh {
    let centres = [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5], [1.5, 1.5]];
    let face = |owner: i32, global: i64, x: f64, y: f64, kind: NodeType| BoundaryFace {
        owner,
        global,
        centre: [x, y, 0.5],
        area: [x - centres[owner as usize][0], y - centres[owner as usize][1], 0.0].map(|a| 2.0 * a),
        coeff: 2.0,
        kind,
        patch: i32::from(kind == NodeType::Inlet),
    };
    Mesh {
        directions: vec![0, 1],
        cell_global: (0..4).collect(),
        cell_centres: centres.iter().map(|c| [c[0], c[1], 0.5]).collect(),
        cell_volumes: vec![1.0; 4],
        face_owner: vec![0, 0, 1, 2],
        face_neighbour: vec![1, 2, 3, 3],
        face_coeff: vec![1.0; 4],
        boundary: vec![
            face(0, 0, 0.0, 0.5, NodeType::Inlet),
            face(2, 1, 0.0, 1.5, NodeType::Inlet),
            face(1, 2, 1.5, 0.0, NodeType::Wall),
        ],
        coupled: vec![
            CoupledFace { owner: 1, rank: 0, global: 0, delta: [1.0, 0.0, 0.0], coeff: 1.0 },
            CoupledFace { owner: 0, rank: 0, global: 1, delta: [-1.0, 0.0, 0.0], coeff: 1.0 },
        ],
        patches: vec!["walls".into(), "inlet".into()],
        elastic: Some(ElasticModes {
            eigenvalues: vec![2.5, 7.0],
            vectors: (0..2).map(|k| (0..4).map(|c| [c as f64, 0.1 * f64::from(k), -1.5]).collect()).collect(),
        }),
        ..Mesh::default()
    }
}

pub(super) fn fields() -> Vec<FieldMeta> {
    vec![
        FieldMeta { name: "U".into(), vector: true, dimensions: [0, 1, -1, 0, 0, 0, 0] },
        FieldMeta { name: "k".into(), vector: false, dimensions: [0, 2, -2, 0, 0, 0, 0] },
    ]
}

pub(super) fn frames(i: usize) -> Vec<Frame> {
    let ramp = |n: usize, offset: f32| (0..n).map(|k| offset + i as f32 + 0.25 * k as f32).collect();
    vec![
        Frame { cells: ramp(8, 0.0), boundary: ramp(6, 100.0) },
        Frame { cells: ramp(4, 200.0), boundary: ramp(3, 300.0) },
    ]
}

pub(super) fn options() -> WriteOptions {
    WriteOptions {
        fields: fields(),
        provenance: serde_json::json!({"application": "test", "seed": 7}),
        split: Split::Test,
        overwrite: false,
    }
}

pub(super) fn write(path: &Path, n: usize) {
    record(path, &square(), &options(), (0..n).map(|i| (1.0 + 0.01 * i as f64, frames(i))));
}

/// A whole recording of the given times and frames.
fn record(
    path: &Path,
    mesh: &Mesh,
    options: &WriteOptions,
    frames: impl IntoIterator<Item = (f64, Vec<Frame>)>,
) -> Trajectory {
    let mut writer = Writer::create(path, mesh, options).unwrap();
    for (time, frame) in frames {
        writer.append(time, &frame).unwrap();
    }
    writer.finish().unwrap();
    Trajectory::open(path).unwrap()
}

/// The path of a trajectory in a new folder, which is removed with the first.
pub(super) fn place() -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.h5");
    (dir, path)
}

/// A new trajectory of `n` frames.
pub(super) fn written(n: usize) -> (TempDir, PathBuf) {
    let (dir, path) = place();
    write(&path, n);
    (dir, path)
}

#[test]
fn the_mesh_says_how_large_its_cells_are() {
    let (_dir, path) = written(2);
    let trajectory = Trajectory::open(&path).unwrap();
    let meta = trajectory.field("cellSize").unwrap();
    assert_eq!((meta.vector, meta.dimensions), (false, [0, 1, 0, 0, 0, 0, 0]));
    let sizes: Vec<f32> = square().cell_sizes().iter().map(|&s| s as f32).collect();
    let read = trajectory.read_frames("cellSize", 0, 1, 2).unwrap();
    let states = trajectory.states(&["k", "cellSize"]).unwrap();
    for (frame, of_mesh) in read.iter().enumerate() {
        assert_eq!(of_mesh.cells, sizes);
        let behind = square().boundary.iter().map(|b| sizes[b.owner as usize]).collect::<Vec<_>>();
        assert_eq!(of_mesh.boundary, behind);
        assert_eq!(&states.read(frame).unwrap().0[1], of_mesh);
    }
}

#[test]
fn the_provenance_says_the_viscosity() {
    let (_dir, path) = written(1);
    assert!(Trajectory::open(&path).unwrap().field("nu").is_err());
    let options = WriteOptions { provenance: serde_json::json!({"nu": 1e-3}), overwrite: true, ..options() };
    let trajectory = record(&path, &square(), &options, [(1.0, frames(0))]);
    assert_eq!(trajectory.field("nu").unwrap().dimensions, [0, 2, -1, 0, 0, 0, 0]);
    let nu = trajectory.read_frame("nu", 0).unwrap();
    assert_eq!(nu.cells, vec![1e-3; square().n_cells()]);
    assert_eq!(nu.boundary, vec![1e-3; square().boundary.len()]);
}

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("new/0000.h5");
    write(&path, 5);
    let trajectory = Trajectory::open(&path).unwrap();
    assert_eq!(trajectory.mesh(), &square());
    assert_eq!(trajectory.fields(), fields());
    assert_eq!(trajectory.split(), Split::Test);
    assert_eq!(trajectory.provenance()["seed"], 7);
    assert_eq!(trajectory.times(), [0, 1, 2, 3, 4].map(|i| 1.0 + 0.01 * f64::from(i)));
    assert_eq!(trajectory.read_frame("U", 3).unwrap(), frames(3)[0]);
    let every_second = trajectory.read_frames("k", 0, 2, 3).unwrap();
    assert_eq!(every_second, [frames(0)[1].clone(), frames(2)[1].clone(), frames(4)[1].clone()]);
    assert_eq!(list(path.parent().unwrap()).unwrap(), std::slice::from_ref(&path));
    assert_eq!(list(&path).unwrap(), std::slice::from_ref(&path));
    // Only the file itself is there, of the size that HDF5 needs.
    assert_eq!(path.parent().unwrap().read_dir().unwrap().count(), 1);
    assert!(path.metadata().unwrap().len() < 64 << 10);
}

/// 1e4 at the outlet, or in the mean of cells of one size.
#[test]
fn a_pressure_is_read_without_its_level() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, expected) in
        [(NodeType::Outlet, [-2.0, 0.0, 2.0, 4.0]), (NodeType::Wall, [-3.0, -1.0, 1.0, 3.0])]
    {
        let path = folder.path().join(format!("{}.h5", kind.name()));
        let mut mesh = square();
        mesh.boundary[2].kind = kind;
        let p = FieldMeta { name: "p".into(), vector: false, dimensions: [0, 2, -2, 0, 0, 0, 0] };
        let options = WriteOptions { fields: vec![p], ..options() };
        let cells = vec![9998.0, 10000.0, 10002.0, 10004.0];
        let frame = Frame { cells, boundary: vec![9998.0, 10002.0, 10000.0] };
        let read = record(&path, &mesh, &options, [(0.0, vec![frame])]);
        assert_eq!(read.read_frame("p", 0).unwrap().cells, expected);
        let (states, _) = read.states(&["p"]).unwrap().read(0).unwrap();
        assert_eq!(states[0].cells, expected);
        assert_eq!(states[0].boundary[1] - states[0].boundary[0], 4.0);
    }
}

#[test]
fn no_boundary_faces_is_a_mesh_too() {
    let (_dir, path) = place();
    let mesh = Mesh { boundary: vec![], ..square() };
    let frame: Vec<_> = frames(0).into_iter().map(|f| Frame { boundary: vec![], ..f }).collect();
    let trajectory = record(&path, &mesh, &options(), [(0.0, frame.clone())]);
    assert_eq!(trajectory.read_frame("U", 0).unwrap(), frame[0]);
}

#[test]
fn a_frame_that_is_not_there() {
    let (_dir, path) = written(2);
    let trajectory = Trajectory::open(&path).unwrap();
    assert!(trajectory.read_frame("U", 2).unwrap_err().to_string().contains("2 frames"));
    assert!(trajectory.read_frames("U", 1, usize::MAX, 3).is_err());
    // Of a file that was opened once as of one that is opened for each read.
    let states = trajectory.states(&["k", "U"]).unwrap();
    let last = trajectory.times().len() - 1;
    let expected = ["k", "U"].map(|name| trajectory.read_frame(name, last).unwrap());
    assert_eq!(states.read(last).unwrap(), (expected.to_vec(), vec![]));
    fails(states.read(last + 1), &["the trajectory has"]);
    assert!(trajectory.states(&["k", "T"]).is_err());
    assert!(trajectory.read_frame("T", 0).unwrap_err().to_string().contains("recorded are U, k"));
}

#[test]
fn unfinished_recordings_leave_nothing_and_are_not_listed() {
    let (dir, path) = place();
    let mut writer = Writer::create(&path, &square(), &options()).unwrap();
    writer.append(0.0, &frames(0)).unwrap();
    assert!(list(dir.path()).unwrap_err().to_string().contains("holds no trajectories"));
    drop(writer);
    assert_eq!(dir.path().read_dir().unwrap().count(), 0);
    // A killed process leaves its partial file: not listed, and no obstacle to the next recording.
    std::fs::write(dir.path().join(".a.h5.partial"), b"rest").unwrap();
    assert!(list(dir.path()).is_err());
    write(&path, 1);
    assert_eq!(list(dir.path()).unwrap(), [path]);
}

#[test]
fn whole_frames_of_a_killed_recording_are_kept() {
    let (dir, path) = place();
    let partial = dir.path().join(".a.h5.partial");
    // The file as it stands after each frame is what a killed process leaves, and a whole one that has no name yet
    let mut writer = Writer::create(&path, &square(), &options()).unwrap();
    writer.append(0.0, &frames(0)).unwrap();
    writer.append(1.0, &frames(1)).unwrap();
    let left = std::fs::read(&partial).unwrap();
    writer.finish().unwrap();
    let whole = std::fs::read(&path).unwrap();
    std::fs::remove_file(&path).unwrap();

    for (name, left) in [("a-killed.h5", &left), ("a-killed-2.h5", &left), ("a-killed-3.h5", &whole)] {
        std::fs::write(&partial, left).unwrap();
        record(&path, &square(), &options(), [(2.0, frames(2))]);
        std::fs::remove_file(&path).unwrap();
        let kept = Trajectory::open(dir.path().join(name)).unwrap();
        assert_eq!(kept.times(), [0.0, 1.0]);
        assert_eq!(kept.read_frame(&kept.fields()[0].name, 1).unwrap(), frames(1)[0]);
    }
    // But not of what can be copied again.
    std::fs::write(&partial, &left).unwrap();
    let mut writer = Writer::create_copy(&path, &square(), &options()).unwrap();
    writer.append(2.0, &frames(2)).unwrap();
    writer.finish().unwrap();
    assert!(path.exists() && !partial.exists() && !dir.path().join("a-killed-4.h5").exists());
}

#[test]
fn bad_frames_are_refused_and_the_recording_goes_on() {
    let (_dir, path) = place();
    let mut writer = Writer::create(&path, &square(), &options()).unwrap();
    writer.append(0.0, &frames(0)).unwrap();
    assert!(matches!(writer.append(0.0, &frames(1)), Err(Error::Input(_))));
    let mut nan = frames(1);
    nan[0].cells[3] = f32::NAN;
    assert!(matches!(writer.append(1.0, &nan), Err(Error::Numerical(_))));
    let mut short = frames(1);
    short[1].boundary.pop();
    assert!(matches!(writer.append(1.0, &short), Err(Error::Input(_))));
    writer.append(1.0, &frames(1)).unwrap();
    writer.finish().unwrap();
    assert!(writer.append(2.0, &frames(2)).is_err());
    assert_eq!(Trajectory::open(&path).unwrap().times(), [0.0, 1.0]);
}

#[test]
fn an_existing_file_is_kept() {
    let (dir, path) = written(1);
    fails(Writer::create(&path, &square(), &options()), &["exists already"]);
    let mut writer =
        Writer::create(&path, &square(), &WriteOptions { overwrite: true, ..options() }).unwrap();
    assert_eq!(Trajectory::open(&path).unwrap().times().len(), 1);
    assert!(writer.finish().unwrap_err().to_string().contains("no frame"));
    assert_eq!(Trajectory::open(&path).unwrap().times().len(), 1);
    fails(Writer::create(dir.path(), &square(), &options()), &["is a folder"]);
    fails(Writer::create("/proc/none/a.h5", &square(), &options()), &["/proc/none"]);
}

/// A full disk, without being root: the file size limit of a child process (SIGXFSZ ignored, as a host may).
#[test]
fn a_full_disk_leaves_nothing() {
    let name = "tests::a_full_disk_leaves_nothing";
    if let Ok(path) = std::env::var("M4GN_TEST_FULL_DISK") {
        let path = Path::new(&path);
        let mut mesh = square();
        let n = 20_000;
        mesh.cell_global = (0..n).collect();
        mesh.cell_centres = vec![[0.0; 3]; n as usize];
        mesh.cell_volumes = vec![1.0; n as usize];
        mesh.elastic = None;
        let noise = |i: usize, n: usize| (0..n).map(|k| ((k * 7919 + i) as f32).sin()).collect::<Vec<_>>();
        let frame = |i| {
            vec![
                Frame { cells: noise(i, 40_000), boundary: noise(i, 6) },
                Frame { cells: noise(i, 20_000), boundary: noise(i, 3) },
            ]
        };
        let mut writer = Writer::create(path, &mesh, &options()).unwrap();
        let error = (0..1000).find_map(|i| writer.append(i as f64, &frame(i)).err()).unwrap();
        assert!(error.to_string().contains("file size limit"), "{error}");
        assert!(writer.append(2000.0, &frame(0)).unwrap_err().to_string().contains("given up"));
        assert!(writer.finish().is_err());
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let exe = std::env::current_exe().unwrap();
    let status = std::process::Command::new("bash")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 8192; exec \"$0\" --exact \"$1\" --nocapture")
        .arg(exe)
        .arg(name)
        .env("M4GN_TEST_FULL_DISK", dir.path().join("a.h5"))
        .status()
        .unwrap();
    assert!(status.success());
    assert_eq!(dir.path().read_dir().unwrap().count(), 0);
}

/// A second recording of one name is refused, and the first goes on untouched; what a killed one left is taken over.
#[test]
fn two_recordings_of_one_name() {
    let (dir, path) = place();
    let options = options();
    let mut first = Writer::create(&path, &square(), &options).unwrap();
    first.append(0.0, &frames(0)).unwrap();
    let second = Writer::create(&path, &square(), &options).map(|_| ()).unwrap_err();
    assert!(second.to_string().contains("being written by another recording"), "{second}");
    first.append(1.0, &frames(1)).unwrap();
    first.finish().unwrap();
    drop(first);
    let read = Trajectory::open(&path).unwrap();
    assert_eq!(read.read_frame(&read.fields()[0].name, 1).unwrap(), frames(1)[0]);

    std::fs::write(dir.path().join(".b.h5.partial"), "left by a killed run").unwrap();
    let path = dir.path().join("b.h5");
    assert_eq!(record(&path, &square(), &options, [(0.0, frames(0))]).times(), [0.0]);
}
