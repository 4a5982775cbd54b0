//! Flows at points, whose walls and inlets are prescribed.

use super::*;
use m4gn_data::{WriteOptions, Writer};
use m4gn_mesh::NodeType;

/// At points of walls and inlets a rollout has what is recorded, and they do not count.
#[test]
fn points_of_walls_are_as_recorded_and_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.h5");
    let mesh = m4gn_samples::mesh::at_points(m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0));
    m4gn_samples::training::write_trajectory_on(&path, &mesh, 0, Split::Test, 12).unwrap();
    let t = Trajectory::open(&path).unwrap();
    let mut spec = m4gn_samples::model::spec();
    spec.segments.method = m4gn_model::SegmentMethod::Metis;
    let model = Model::random(spec, 3).unwrap();
    let case = run(&model, &t, &SessionOptions::default(), (None, Keep::All), &mut || Ok(())).unwrap();
    let walls = |b: &&m4gn_mesh::BoundaryFace| matches!(b.kind, NodeType::Wall | NodeType::Inlet);
    let held: Vec<usize> = mesh.boundary.iter().filter(walls).map(|b| b.owner as usize).collect();
    let kept = &case.rollout().unwrap().states;
    assert_eq!(kept.len(), 11);
    for (step, found) in kept {
        let truth = t.read_frame("U", *step).unwrap().cells;
        let (mut sum, mut free) = (0.0, 0);
        for node in 0..mesh.n_cells() {
            let off = [0, 1].map(|i| found[3 * node + i] - f64::from(truth[2 * node + i]));
            match held.contains(&node) {
                true => assert_eq!(off, [0.0; 2], "step {step}, point {node}"),
                false => (sum, free) = (sum + off[0].powi(2) + off[1].powi(2), free + 2),
            }
        }
        let error = case.predictions[0].fields[0].rollout[step - 1].rmse();
        assert!((error / (sum / f64::from(free)).sqrt() - 1.0).abs() < 1e-9, "step {step}");
    }
}

/// Along walls without friction, where what is recorded changes, a rollout has what the network says from the first step on: not what the
/// wall has as the step begins.
#[test]
fn points_of_walls_that_the_flow_slips_along_are_predicted() {
    let folder = tempfile::tempdir().unwrap();
    let [at_rest, slips] = ["a.h5", "b.h5"].map(|name| folder.path().join(name));
    let mesh = m4gn_samples::mesh::at_points(m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0));
    m4gn_samples::training::write_trajectory_on(&at_rest, &mesh, 0, Split::Test, 6).unwrap();
    let t = Trajectory::open(&at_rest).unwrap();
    let (fields, provenance) = (t.fields().to_vec(), t.provenance().clone());
    let options = WriteOptions { fields, provenance, split: Split::Test, overwrite: false };
    let mut writer = Writer::create(&slips, &mesh, &options).unwrap();
    let owners =
        |kind: NodeType| mesh.boundary.iter().filter(move |b| b.kind == kind).map(|b| b.owner as usize);
    for (frame, &time) in t.times().iter().enumerate() {
        let mut u = t.read_frame("U", frame).unwrap();
        for (face, row) in mesh.boundary.iter().zip(u.boundary.chunks_exact_mut(2)) {
            if face.kind == NodeType::Wall {
                row.copy_from_slice(&u.cells[2 * face.owner as usize..][..2]);
            }
        }
        writer.append(time, &[u, t.read_frame("p", frame).unwrap()]).unwrap();
    }
    writer.finish().unwrap();

    let t = Trajectory::open(&slips).unwrap();
    let mut spec = m4gn_samples::model::spec();
    spec.segments.method = m4gn_model::SegmentMethod::Metis;
    let model = Model::random(spec, 3).unwrap();
    let case = run(&model, &t, &SessionOptions::default(), (None, Keep::All), &mut || Ok(())).unwrap();
    let kept = &case.rollout().unwrap().states;
    assert_eq!(kept.len(), 5);
    for (step, found) in kept {
        let before = t.read_frame("U", step - 1).unwrap().cells;
        let predicted = owners(NodeType::Wall).filter(|node| owners(NodeType::Inlet).all(|i| i != *node));
        for node in predicted {
            let changes = [0, 1].map(|i| found[3 * node + i] - f64::from(before[2 * node + i]));
            assert_ne!(changes, [0.0; 2], "step {step}, point {node}");
        }
    }
}
