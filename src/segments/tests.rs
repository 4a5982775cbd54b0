use super::*;
use crate::mesh::sample;
use crate::model::SegmentMethod;

fn cut(mesh: &Mesh, spec: &SegmentSpec, preset: Option<&[i32]>) -> Result<Segmentation> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    segment(mesh, &mut graph, spec, &comm, preset)
}

fn metis(count: usize) -> SegmentSpec {
    SegmentSpec {
        method: SegmentMethod::Metis,
        count,
        ..Default::default()
    }
}

#[test]
fn one_segment_has_every_node_and_edge() {
    let mesh = sample::rectangle(4, 3, 1.0, 1.0);
    let s = cut(&mesh, &metis(1), None).unwrap();
    assert_eq!(s.sizes, [26.0]);
    // 17 internal faces and 14 boundary faces, both ways.
    assert_eq!(s.adjacency, [62.0]);
    assert_eq!(s.node_segment, [0; 26]);
}

#[test]
fn more_segments_than_cells_is_an_error_that_says_so() {
    let mesh = sample::rectangle(2, 2, 1.0, 1.0);
    let s = cut(&mesh, &metis(4), None).unwrap();
    assert_eq!(s.node_segment[..4], [0, 1, 2, 3]);
    for count in [0, 5] {
        let error = cut(&mesh, &metis(count), None).unwrap_err();
        assert!(
            matches!(&error, Error::Input(m) if m.contains("expected 1 to 4")),
            "{error}"
        );
    }
}

#[test]
fn overlap_grows_by_one_layer_a_round_on_a_path() {
    // Nodes: cells 0 to 5, inlet 6 (cell 0), outlet 7 (cell 5).
    let mesh = sample::chain(6, 6.0);
    let preset = [0, 0, 0, 1, 1, 1];
    for overlap in 0..4 {
        let spec = SegmentSpec { overlap, ..metis(2) };
        let s = cut(&mesh, &spec, Some(&preset)).unwrap();
        let both = |i: usize| s.member_row[i + 1] - s.member_row[i] == 2;
        for cell in 0..6 {
            let distance = if cell < 3 { 3 - cell } else { cell - 2 };
            assert_eq!(both(cell), distance <= overlap, "cell {cell}, overlap {overlap}");
        }
        assert_eq!(both(6), overlap >= 4);
        assert_eq!(s.sizes[0], 4.0 + overlap as f64);
    }
    let s = cut(&mesh, &metis(2), Some(&preset)).unwrap();
    assert_eq!(s.adjacency, [6.0, 1.0, 1.0, 6.0]);
}

#[test]
fn preset_labels_are_checked() {
    let mesh = sample::chain(4, 1.0);
    for (labels, part) in [
        (&[0, 0, 1][..], "3 segment labels for 4 cells"),
        (&[0, 0, 1, 2], "cell 3 on rank 0 is 2: expected 0 to 1"),
        (&[0, 0, -1, 1], "cell 2 on rank 0 is -1"),
        (&[1, 1, 1, 1], "segment 0 of 2 has no cell"),
    ] {
        let error = cut(&mesh, &metis(2), Some(labels)).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
}
