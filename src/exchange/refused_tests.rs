//! What is not read is refused by name.

use super::import::Options;
use super::tests::{file, imported, square};
use super::{npz, records};
use m4gn_samples::fails;

/// An array of `numpy.save`.
fn saved(descr: &str, shape: &str, bytes: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n");
    [&b"\x93NUMPY\x01\x00"[..], &(header.len() as u16).to_le_bytes(), header.as_bytes(), bytes].concat()
}

#[test]
fn arrays_of_an_archive_are_read_or_refused_by_their_type() {
    let (_folder, path) = file("a.npz", &[]);
    let read = |descr: &str, shape: &str, bytes: &[u8]| {
        std::fs::write(&path, records::zip(&[("x.npy".to_string(), saved(descr, shape, bytes))])).unwrap();
        npz::read(&path).map_err(|e| e.to_string())
    };
    for (descr, bytes, expected) in [
        ("'>f4'", 1.5f32.to_be_bytes().to_vec(), 1.5),
        ("'<f8'", (-2.5f64).to_le_bytes().to_vec(), -2.5),
        ("'>i2'", (-3i16).to_be_bytes().to_vec(), -3.0),
        ("'<u4'", 4_000_000_000u32.to_le_bytes().to_vec(), 4e9),
        ("'|u1'", vec![200], 200.0),
        ("'|b1'", vec![1], 1.0),
    ] {
        assert_eq!(read(descr, "(1,)", &bytes).unwrap()["x"].data, [expected], "{descr}");
    }
    for descr in ["'<f2'", "'<c8'", "'|O'", "'<M8[ns]'", "[('a', '<f4')]"] {
        let message = read(descr, "(1,)", &[0; 8]).unwrap_err();
        let bare = descr.trim_matches('\'');
        assert!(
            message.contains("x.npy, its byte 10: numbers of type ") && message.contains(bare),
            "{message}"
        );
        assert!(message.contains("expected float32, float64"), "{message}");
    }
    assert!(read("'<U3'", "(1,)", &[0; 12]).unwrap().is_empty());
}

#[test]
fn copies_are_read_or_refused_by_their_type() {
    let (_folder, path) = file("valid.h5", &[]);
    let dt = Options { dt: Some(0.5), ..Options::default() };
    let write = |more: &dyn Fn(&hdf5::Group)| {
        let copy = hdf5::File::create(&path).unwrap();
        let group = copy.create_group("0").unwrap();
        for (name, shape, data) in records::square() {
            group.new_dataset::<f64>().shape(shape).create(name).unwrap().write_raw(&data).unwrap();
        }
        more(&group);
    };
    write(&|group| {
        group.new_dataset::<bool>().shape(2).create("flags").unwrap().write_raw(&[true, false]).unwrap();
    });
    fails(imported(&path, &dt), &["/0/flags is of type bool, expected whole or floating-point numbers"]);
    write(&|group| {
        group.unlink("mesh_pos").unwrap();
        let places: Vec<f64> = (0..20).map(f64::from).collect();
        group.new_dataset::<f64>().shape([2, 5, 2]).create("mesh_pos").unwrap().write_raw(&places).unwrap();
    });
    fails(imported(&path, &dt), &["/0/mesh_pos of the last frame is another than that of frame 0"]);
}

#[test]
fn arrays_that_are_no_fields_are_refused_by_their_shape() {
    let refused = |name: &str, shape: &[usize], expected: &str| {
        let mut arrays = square();
        let data = vec![0.25; shape.iter().product()];
        arrays.insert(name.into(), super::Array { shape: shape.to_vec(), data });
        fails(super::Points::new(&arrays, Some(0.5), std::path::Path::new("a")), &[expected]);
    };
    refused("velocity", &[5, 3, 2], "velocity has shape [5, 3, 2], expected [frames, 5, components]");
    refused("pressure", &[3, 4, 1], "pressure has shape [3, 4, 1], expected [frames, 5, components]");
    refused("walls", &[1, 5, 1], "walls has shape [1, 5, 1], expected [frames, 5, components]");
}

/// `velocity` and `U` are one field.
#[test]
fn two_arrays_of_one_field_are_refused() {
    let (_folder, path) = file("a.npz", &[]);
    let mut arrays = square();
    arrays.insert("U".into(), square()["velocity"].clone());
    npz::write(&path, &arrays, &["cells", "node_type"]).unwrap();
    let dt = Options { dt: Some(0.5), ..Options::default() };
    fails(imported(&path, &dt), &["field 'U' appears twice"]);
    assert!(!path.with_file_name("out.h5").exists());
}
