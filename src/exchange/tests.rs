//! Files of others there and back, and what is said of damaged ones.

use super::import::{Options, import};
use super::points::arrays;
use super::records;
use super::{Array, Arrays, npz};
use base64::{Engine, engine::general_purpose::STANDARD};
use m4gn_base::Result;
use m4gn_data::{Split, Trajectory};
use m4gn_mesh::NodeType;
use m4gn_samples::fails;
use std::path::{Path, PathBuf};

/// A folder with a file, and meta.json beside it.
pub(super) fn file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    std::fs::write(folder.path().join("meta.json"), records::meta().to_string()).unwrap();
    (folder, path)
}

pub(super) fn square() -> Arrays {
    by_name(records::square())
}

fn by_name(arrays: Vec<(&str, Vec<usize>, Vec<f64>)>) -> Arrays {
    arrays.into_iter().map(|(name, shape, data)| (name.into(), Array { shape, data })).collect()
}

pub(super) fn imported(path: &Path, options: &Options) -> Result<Trajectory> {
    let out = path.with_file_name("out.h5");
    let _ = std::fs::remove_file(&out);
    import(path, &out, options, &mut |_, _| Ok(()))?;
    Trajectory::open(out)
}

/// What is read back of the square.
fn check(t: &Trajectory) {
    let back = arrays(t).unwrap();
    for (name, shape, data) in records::square() {
        assert_eq!(back[name].data, data, "{name}");
        assert_eq!(back[name].shape[back[name].shape.len() - 2..], shape[1..], "{name}");
    }
    assert_eq!(t.times(), [0.0, 0.5, 1.0]);
}

#[test]
fn a_square_of_four_triangles_on_paper() {
    let (_folder, path) = file("test_a.tfrecord", &records::record(&records::example()));
    let t = imported(&path, &Options::default()).unwrap();
    check(&t);
    assert_eq!(t.split(), Split::Test);
    let mesh = t.mesh();
    let sixth = 1.0 / 6.0;
    let near =
        |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
    assert!(near(&mesh.cell_volumes, &[sixth, sixth, sixth, sixth, 2.0 * sixth]), "{:?}", mesh.cell_volumes);
    // A side: 2/3 of 1/4 over 1; from a corner to the middle: two triangles, over 1/2.
    let ends: Vec<_> = mesh.face_owner.iter().zip(&mesh.face_neighbour).map(|(a, b)| [*a, *b]).collect();
    assert_eq!(ends, [[0, 1], [0, 3], [0, 4], [1, 2], [1, 4], [2, 3], [2, 4], [3, 4]]);
    let (side, inner) = (sixth, 4.0 * sixth);
    assert!(
        near(&mesh.face_coeff, &[side, side, inner, side, inner, side, inner, inner]),
        "{:?}",
        mesh.face_coeff
    );
    let kinds: Vec<_> = mesh.boundary.iter().map(|b| (b.owner, b.kind)).collect();
    let wall = NodeType::Wall;
    assert_eq!(kinds, [(0, NodeType::Inlet), (1, wall), (2, NodeType::Outlet), (3, wall)]);
    assert_eq!(mesh.boundary[0].area, [-0.5, -0.5, 0.0]);
    assert_eq!(mesh.boundary[2].area, [0.5, 0.5, 0.0]);
    assert!(near(&[mesh.boundary[1].coeff], &[3.0]));
}

#[test]
fn archives_and_copies_give_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let dt = Options { dt: Some(0.5), ..Options::default() };
    npz::write(&path, &square(), &["cells", "node_type"]).unwrap();
    check(&imported(&path, &dt).unwrap());
    fails(imported(&path, &Options::default()), &["--dt"]);
    // What does not change is repeated in each frame, and `pos` for `mesh_pos`.
    let path = folder.path().join("valid.h5");
    let copy = hdf5::File::create(&path).unwrap();
    for group in ["10", "9"] {
        let group = copy.create_group(group).unwrap();
        for (name, shape, data) in records::square() {
            let name = if name == "mesh_pos" { "pos" } else { name };
            let times = 3 / shape[0];
            let data: Vec<f32> = data.iter().map(|v| *v as f32).collect::<Vec<_>>().repeat(times);
            let shape = [3, shape[1], shape[2]];
            group.new_dataset::<f32>().shape(shape).create(name).unwrap().write_raw(&data).unwrap();
        }
    }
    copy.close().unwrap();
    let mut seen = Vec::new();
    let out = folder.path().join("set");
    for kept in [false, true] {
        let mut done = |file: &Path, was: bool| {
            assert_eq!(was, kept);
            seen.push(file.file_name().unwrap().to_string_lossy().into_owned());
            Ok(())
        };
        assert_eq!(import(&path, &out, &dt, &mut done).unwrap(), 2);
    }
    let other = Options { dt: Some(0.25), ..dt.clone() };
    fails(import(&path, &out, &other, &mut |_, _| Ok(())), &["valid-00000.h5", "another --split"]);
    assert_eq!(seen[..2], ["valid-00000.h5", "valid-00001.h5"]);
    let t = Trajectory::open(out.join("valid-00001.h5")).unwrap();
    check(&t);
    assert_eq!(t.split(), Split::Valid);
    fails(imported(&path, &dt), &["more than one trajectory"]);
    assert!(
        !path.with_file_name("out.h5").exists(),
        "it is not written, so that the same name can be given with --count 1"
    );
    check(&imported(&path, &Options { count: Some(1), ..dt }).unwrap());
}

/// Velocities of the last frame, in three components.
#[test]
fn a_series_for_paraview_has_the_values() {
    let (_folder, path) = file("a.tfrecord", &records::record(&records::example()));
    let t = imported(&path, &Options::default()).unwrap();
    super::export::to_vtu(&t, &path.with_file_name("a.pvd")).unwrap();
    let text = std::fs::read_to_string(path.with_file_name("a_0002.vtu")).unwrap();
    let after = text.split("Name=\"U\"").nth(1).unwrap();
    let bytes = STANDARD.decode(after.lines().nth(1).unwrap()).unwrap();
    let found: Vec<f32> = bytes[8..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let square = square();
    let last = square["velocity"].data[20..].as_chunks::<2>().0;
    let expected: Vec<f32> = last.iter().flat_map(|v| [v[0] as f32, v[1] as f32, 0.0]).collect();
    assert_eq!(found, expected);
}

#[test]
fn errors_name_record_byte_and_key() {
    let good = records::record(&records::example());
    let twice = [&good[..], &good].concat();
    let n = good.len();
    let changed = |at: usize| {
        let mut bytes = twice.clone();
        bytes[at] ^= 1;
        bytes
    };
    let mut other = records::example();
    let at = other.windows(8).position(|w| w == b"pressure").unwrap();
    other[at] = b'P';
    let other = records::record(&other);
    let damages: [(&[u8], &str); 6] = [
        (&twice[..n + 5], &format!("record 1, byte {n}: needs 16 bytes, the file has 5 more")),
        (&twice[..2 * n - 1], &format!("record 1, byte {n}: needs {n} bytes, the file has {} more", n - 1)),
        (&changed(n), &format!("record 1, byte {n}: the checksum of its length")),
        (&changed(n + 40), &format!("record 1, byte {}: the checksum of its content", n + 12)),
        (&other, "record 0, byte 12: no feature `pressure`"),
        (&records::record(&[10, 200, 1, 0]), "record 0, byte 12: a field of 200 bytes where 1 are left"),
    ];
    for (bytes, expected) in damages {
        let (_folder, path) = file("a.tfrecord", bytes);
        let out = path.with_file_name("out");
        fails(import(&path, &out, &Options::default(), &mut |_, _| Ok(())), &["a.tfrecord: ", expected]);
    }
    let (_folder, path) = file("a.tfrecord", &good);
    for (pointer, value, expected) in [
        ("/dt", serde_json::json!("x"), "dt: expected a time in s, found \"x\""),
        ("/features/velocity/dtype", serde_json::json!("float16"), "features.velocity.dtype: expected"),
        ("/features/velocity/shape", serde_json::json!([-1, -1, 2]), "features.velocity.shape: expected"),
        (
            "/features/cells/shape",
            serde_json::json!([1, -1, 5]),
            "feature `cells`: 48 bytes for the shape [1, -1, 5]",
        ),
        ("/features/cells/type", serde_json::json!("dynamic_varlen"), "features.cells.type: expected"),
        ("/features", serde_json::json!([]), "features: expected an object"),
    ] {
        let mut meta = records::meta();
        *meta.pointer_mut(pointer).unwrap() = value;
        std::fs::write(path.with_file_name("meta.json"), meta.to_string()).unwrap();
        fails(imported(&path, &Options::default()), &[expected]);
    }
}

#[test]
fn arrays_that_make_no_trajectory_are_named() {
    let dt = Options { dt: Some(0.5), ..Options::default() };
    let refused = |arrays: &Arrays, expected: &str| {
        fails(super::Points::new(arrays, dt.dt, Path::new("a")), &[expected]);
    };
    for (name, at, value, expected) in [
        ("cells", 2, 9.0, "cells: value 2 is 9, expected a whole number from 0 to below 5"),
        ("cells", 5, 1.0, "triangle 1 of the points [1, 2, 1] has the area 0"),
        ("node_type", 0, 3.0, "node_type of point 0 is 3"),
        ("pressure", 5, f64::NAN, "pressure: frame 1 holds NaN"),
    ] {
        refused(&with(square(), name, at, value), expected);
    }
    let mut arrays = square();
    arrays.get_mut("mesh_pos").unwrap().shape = vec![1, 2, 5];
    refused(&arrays, "mesh_pos has shape [1, 2, 5]");
    arrays = square();
    arrays.remove("node_type");
    refused(&arrays, "no array node_type; found cells, mesh_pos");
    arrays = square();
    arrays.retain(|_, a| a.shape[0] == 1);
    refused(&arrays, "no array has a row for each of the 5 points");
}

/// 10 s, 10.02 s, ... as an archive has them.
#[test]
fn times_that_begin_late_are_equally_spaced() {
    let data: Vec<f64> = (0..200).map(|i| f64::from((10.0 + 0.02 * f64::from(i)) as f32)).collect();
    let interval = |data: &[f64]| {
        let times = Array { shape: vec![data.len()], data: data.to_vec() };
        super::points::interval(&Arrays::from([("times".into(), times)]), None, Path::new("a"))
    };
    assert!((interval(&data).unwrap() - 0.02).abs() < 1e-7);
    let mut other = data;
    other[50] += 0.001;
    fails(interval(&other), &["times: value 50 is 11.001"]);
}

#[test]
fn options_that_a_file_contradicts_are_refused() {
    let said = Array { shape: vec![], data: vec![f64::from(0.01f32)] };
    let said = Arrays::from([("dt".into(), said)]);
    let interval = |dt: f64| super::points::interval(&said, Some(dt), Path::new("a"));
    assert_eq!(interval(0.01).unwrap(), 0.01);
    fails(interval(0.02), &["--dt is 0.02: leave --dt out"]);
    let (_folder, path) = file("a.tfrecord", &records::record(&records::example()));
    let poisson = Options { poisson: Some(0.3), ..Options::default() };
    fails(imported(&path, &poisson), &["--poisson: it is for bodies"]);
}

/// With another number in one of them.
fn with(mut arrays: Arrays, name: &str, at: usize, value: f64) -> Arrays {
    arrays.get_mut(name).unwrap().data[at] = value;
    arrays
}

/// What comes of the plate's arrays.
fn check_plate(t: &Trajectory) {
    let body = t.body().unwrap();
    let (held, free) = (NodeType::Handle, NodeType::Body);
    assert_eq!(body.types, [held, held, held, free, free]);
    // The second tetrahedron is turned.
    assert_eq!(body.elements.points, [0, 1, 2, 3, 1, 2, 3, 4]);
    assert!(body.elements.measures(&body.positions).iter().all(|v| *v > 0.1));
    assert!(body.material.iter().all(|m| m.poisson == 0.3));
    let obstacle = t.obstacle().unwrap();
    assert_eq!((obstacle.positions.len(), obstacle.triangles.len()), (4, 4));
    assert_eq!(t.times(), [0.0, 0.01, 0.02]);
    let d = t.read_frame("D", 2).unwrap().cells;
    assert_eq!(d, [[0.0; 3], [0.0; 3], [0.0; 3], [0.0, 0.0, -0.25], [0.0, 0.0, -0.25]].concat());
    assert_eq!(t.read_motion(2, 1, 1).unwrap()[0], [[1.0, 0.0, -0.5]; 4]);
    assert_eq!(t.read_frame("sigmaEq", 1).unwrap().cells, [9.0, 10.0, 11.0, 12.0, 13.0]);
}

#[test]
fn a_plate_under_an_obstacle_there_and_back() {
    let plate = records::plate();
    let (_folder, path) = file("valid.tfrecord", &records::record(&records::example_of(&plate)));
    std::fs::write(path.with_file_name("meta.json"), records::meta_of(&plate, 0.0).to_string()).unwrap();
    let options = Options { dt: Some(0.01), poisson: Some(0.3), ..Options::default() };
    let t = imported(&path, &options).unwrap();
    check_plate(&t);
    assert_eq!(t.split(), Split::Valid);
    // A quasi-static set says 0.
    fails(imported(&path, &Options::default()), &["--dt"]);
    let archive = path.with_file_name("a.npz");
    let t = imported(&path, &options).unwrap();
    super::export::to_npz(&t, &archive).unwrap();
    let back = imported(&archive, &options).unwrap();
    check_plate(&back);
    assert_eq!((t.mesh(), t.fields()), (back.mesh(), back.fields()));
    for name in ["mesh_pos", "node_type", "stress", "world_pos"] {
        let expected = &by_name(plate.clone())[name];
        assert_eq!(npz::read(&archive).unwrap()[name].data, expected.data, "{name}");
    }
}

#[test]
fn arrays_that_make_no_body_are_named() {
    let plate = || by_name(records::plate());
    let refused = |arrays: &Arrays, expected: &str| {
        fails(super::Bodies::new(arrays, Some(0.01), 0.3, Path::new("a")), &[expected]);
    };
    for (name, at, value, expected) in [
        ("cells", 11, 3.0, "cell 2 of the points [5, 6, 7, 3] is of both"),
        ("cells", 3, 2.0, "cell 0 of the points [0, 1, 2, 2] has the point 2 twice"),
        ("mesh_pos", 11, 0.0, "cell 0 of the points [0, 1, 2, 3] has the volume 0"),
        ("cells", 3, 9.0, "cells: value 3 is 9, expected a whole number"),
        ("node_type", 4, 4.0, "node_type of point 4 is 4, expected 0 (normal)"),
        ("stress", 5, f64::NAN, "stress: frame 0 holds NaN"),
        ("world_pos", 80, f64::INFINITY, "world_pos: frame 2 holds inf"),
        (
            "world_pos",
            80,
            plate()["world_pos"].data[80] + 0.5,
            "world_pos: frame 2: the distance between points",
        ),
    ] {
        refused(&with(plate(), name, at, value), expected);
    }
    for (name, shape, data, expected) in [
        ("cells", vec![1, 2, 4], plate()["cells"].data[..8].to_vec(), "without cells or obstacle_triangles"),
        ("stress", vec![3, 9, 2], vec![0.0; 54], "stress has 2 components, expected 1 or 3"),
    ] {
        let mut arrays = plate();
        arrays.insert(name.into(), Array { shape, data });
        refused(&arrays, expected);
    }
    let mut arrays = plate();
    arrays.get_mut("cells").unwrap().data[4..8].copy_from_slice(&[0.0, 1.0, 2.0, 3.0]);
    refused(&arrays, "point 4 belongs to no cell");
    arrays = plate();
    arrays.get_mut("node_type").unwrap().data[..3].fill(0.0);
    refused(&arrays, "no handle");
    arrays = plate();
    arrays.remove("world_pos");
    refused(&arrays, "world_pos: expected an array [frames, 9, 3] of two frames or more, found none");
}
