//! The trajectory of a bar that Python wrote (`python -m m4gn_solids.fixture`), whole and damaged.

use super::damage_tests::flipped;
use super::tests::place;
use super::*;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::Material;
use m4gn_mesh::elements::ElementKind;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/solid.h5");

/// Frames of the displacement, and motion of the obstacle.
type All = (Vec<Frame>, Vec<Vec<[f32; 3]>>);

fn read_all(path: &Path) -> m4gn_base::Result<All> {
    let t = Trajectory::open(path)?;
    let n = t.times().len();
    Ok((t.read_frames("D", 0, 1, n)?, t.read_motion(0, 1, n)?))
}

/// A copy that was changed.
fn changed(change: impl FnOnce(&hdf5::File)) -> (tempfile::TempDir, PathBuf) {
    let (dir, path) = place();
    std::fs::copy(FILE, &path).unwrap();
    change(&hdf5::File::open_rw(&path).unwrap());
    (dir, path)
}

/// What reading all of the changed copy says.
fn message(change: impl FnOnce(&hdf5::File)) -> String {
    let (_dir, path) = changed(change);
    read_all(&path).unwrap_err().to_string()
}

/// Changes one value of an array.
fn edit<T: hdf5::H5Type + Copy>(f: &hdf5::File, name: &str, at: usize, change: impl Fn(T) -> T) {
    let data = f.dataset(name).unwrap();
    let mut values = data.read_raw::<T>().unwrap();
    values[at] = change(values[at]);
    data.as_writer().write_raw(&values).unwrap();
}

#[test]
fn what_python_wrote_is_read() {
    let t = Trajectory::open(FILE).unwrap();
    assert_eq!((t.split(), t.times()), (Split::Test, &[0.0, 0.01, 0.02, 0.03][..]));
    assert_eq!(t.provenance()["family"], "bar");
    let body = t.body().unwrap();
    assert_eq!((body.positions.len(), body.elements.len()), (12, 4));
    assert!(body.elements.kind.iter().all(|&k| k == ElementKind::Wedge));
    // Two bricks of 1 cm
    assert!((body.elements.measures(&body.positions).iter().sum::<f64>() - 2e-6).abs() < 1e-18);
    let handles: Vec<usize> = (0..12).filter(|&p| body.types[p] == NodeType::Handle).collect();
    assert_eq!(handles, [0, 3, 6, 9]);
    let rubber = Material { young: 1e6, poisson: 0.4, density: 1000.0 };
    assert_eq!(body.material, [rubber; 4]);
    assert_eq!(t.mesh(), &body.mesh(t.obstacle()));
    for kind in [NodeType::Body, NodeType::Handle, NodeType::Obstacle] {
        assert!(t.node_types().contains(&kind));
    }
    let field = t.field("D").unwrap();
    assert_eq!((field.vector, field.dimensions), (true, [0, 1, 0, 0, 0, 0, 0]));

    let (frames, motion) = read_all(Path::new(FILE)).unwrap();
    let at = |k: usize, p: usize| frames[k].cells.as_chunks::<3>().0[p];
    assert!(frames[0].cells.iter().all(|&u| u == 0.0));
    // Pressed down, held at the handle; the obstacle goes down 1 mm a frame
    assert!((0..12).any(|p| at(3, p)[1] < -5e-4));
    assert!((0..4).all(|k| handles.iter().all(|&p| at(k, p) == [0.0; 3])));
    assert!(motion[2].iter().all(|u| (u[1] + 2e-3).abs() < 1e-9 && u[0] == 0.0));
    assert_eq!(t.read_frame("D", 3).unwrap(), frames[3]);
    assert!(t.read_frame("D", 4).unwrap_err().to_string().contains("4 frames"));
    assert!(t.read_motion(4, 1, 1).unwrap_err().to_string().contains("4 frames"));
}

#[test]
fn a_body_has_no_mesh_of_cells() {
    m4gn_samples::fails(Trajectory::open(FILE).unwrap().cells(), &["deforming body"]);
}

#[test]
fn arrays_without_a_checksum_are_refused() {
    let text = message(|f| {
        let poisson = f.dataset("elements/poisson").unwrap().read_raw::<f64>().unwrap();
        f.unlink("elements/poisson").unwrap();
        let new = f.new_dataset_builder().with_data(&poisson);
        new.create("elements/poisson").unwrap();
    });
    assert!(text.contains("/elements/poisson have no checksum"), "{text}");
}

#[test]
fn an_obstacle_that_deforms_is_refused() {
    let text = message(|f| {
        let last = f.dataset("obstacle/displacement").unwrap().size() - 3;
        edit(f, "obstacle/displacement", last, |u: f32| u + 1e-3);
    });
    assert!(text.contains("frame 3 of /obstacle/displacement") && text.contains("rigid body"), "{text}");
}

#[test]
fn what_is_inconsistent_is_named() {
    let labels = |name: &str, at: usize, value: i32| message(|f| edit(f, name, at, |_| value));
    assert!(labels("mesh/point_type", 3, 9).contains("/mesh/point_type[3] is 9, expected 6 (body)"));
    assert!(labels("elements/kind", 1, 5).contains("/elements/kind[1]: element code 5"));
    assert!(labels("elements/kind", 1, 11).contains("element code 11"));
    assert!(labels("elements/kind", 1, 10).contains("/elements/points has shape [24], expected [22]"));
    assert!(labels("elements/points", 7, 12).contains("/elements/points[7] is 12, expected 0 to below 12"));
    assert!(labels("elements/points", 0, 1).contains("element 0 has the point 1 twice"));
    assert!(labels("obstacle/triangles", 0, -1).contains("/obstacle/triangles[0] is -1"));
    assert!(labels("obstacle/triangles", 0, 3).contains("not closed"));
    let value = |name: &str, value: f64| message(|f| edit(f, name, 2, |_| value));
    assert!(value("elements/poisson", 0.5).contains("Poisson's ratio of element 2 is 0.5"));
    assert!(value("elements/density", 0.0).contains("density of element 2 is 0 kg"));
    assert!(value("elements/young", f64::NAN).contains("expected a finite one"));
    assert!(value("mesh/cell_centres", f64::INFINITY).contains("value 2 of /mesh/cell_centres"));
    assert!(value("mesh/cell_centres", 0.05).contains("element 0 has the volume -"));
    assert!(value("times", 0.0).contains("times must increase"));
    assert!(message(|f| f.unlink("fields/D/cells").unwrap()).contains("/fields/D/cells cannot be opened"));
    assert!(message(|f| f.delete_attr("complete").unwrap()).contains("not finished"));
    assert!(message(|f| f.dataset("times").unwrap().resize(0).unwrap()).contains("no frames"));
    let short = message(|f| f.dataset("obstacle/displacement").unwrap().resize((2, 26, 3)).unwrap());
    assert!(short.contains("[2, 26, 3], expected [4, 26, 3]"), "{short}");
    let nan = message(|f| edit(f, "obstacle/displacement", 1, |_| f32::NAN));
    assert!(nan.contains("frame 0 of /obstacle/displacement"), "{nan}");
}

#[test]
fn the_obstacle_may_be_left_out() {
    let (_dir, path) = changed(|f| f.unlink("obstacle").unwrap());
    let t = Trajectory::open(&path).unwrap();
    assert!(t.obstacle().is_none() && !t.node_types().contains(&NodeType::Obstacle));
    let (frames, motion) = read_all(&path).unwrap();
    assert_eq!((frames.len(), motion), (4, vec![Vec::new(); 4]));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Flipped bytes anywhere give values or an error, never a panic, and never other values: all is checksummed.
    #[test]
    fn damaged_bytes_never_panic(places in prop::collection::vec((0.0..1.0f64, 1..=255u8), 1..4)) {
        let (_dir, path) = flipped(Path::new(FILE), &places);
        if let Ok(found) = read_all(&path) {
            prop_assert_eq!(found, read_all(Path::new(FILE)).unwrap());
            let [found, whole] = [path.as_path(), Path::new(FILE)].map(|p| Trajectory::open(p).unwrap());
            prop_assert_eq!(found.mesh(), whole.mesh());
            prop_assert_eq!(found.times(), whole.times());
        }
    }
}
