use super::*;
use m4gn_model::SegmentMethod;
use m4gn_modes::Modal;
use m4gn_samples::mesh as sample;
use proptest::prelude::*;

fn cut(mesh: &Mesh, spec: &SegmentSpec, preset: Option<&[i32]>) -> Result<Segmentation> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    segment(mesh, &mut graph, spec, &Modal::default(), &comm, preset)
}

fn metis(count: usize) -> SegmentSpec {
    SegmentSpec { method: SegmentMethod::Metis, count, ..Default::default() }
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
    // A segment a cell, in the order of their places.
    assert_eq!(s.node_segment[..4], [0, 1, 2, 3]);
    for count in [0, 5] {
        let error = cut(&mesh, &metis(count), None).unwrap_err();
        assert!(matches!(&error, Error::Input(m) if m.contains("expected 1 to 4")), "{error}");
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
        m4gn_samples::fails(cut(&mesh, &metis(2), Some(labels)), &[part]);
    }
}

#[test]
fn extremes_have_an_answer() {
    let mesh = sample::triangles(4, 3, 1.6, 0.7);
    for method in SegmentMethod::ALL {
        for (count, tau, size, modes) in [
            (1, 1.0, None, 6),
            (24, 1.0, None, 6),
            (23, 1.0, None, 3),
            (5, 0.0, None, 3),
            (5, 0.0, None, 0),
            (5, 1.0, Some(1e-300), 3),
            (5, 1e6, Some(1e9), 23),
        ] {
            let spec = SegmentSpec { method, count, tau, size, modes, ..Default::default() };
            let s = cut(&mesh, &spec, None).unwrap();
            assert!(s.sizes.iter().all(|&n| n > 0.0), "{spec:?}: {:?}", s.sizes);
            assert_eq!(sample::pieces(&mesh, &s.node_segment), count, "{spec:?}");
        }
    }
    let two = sample::chain(2, 1.0);
    let spec = |count, modes| SegmentSpec { count, modes, ..Default::default() };
    assert_eq!(cut(&two, &spec(1, 6), None).unwrap().node_segment[..2], [0, 0]);
    assert_eq!(cut(&two, &spec(2, 6), None).unwrap().node_segment[..2], [0, 1]);
    assert!(matches!(cut(&two, &spec(3, 6), None), Err(Error::Input(_))));
}

#[test]
fn cells_that_left_metis_segments_are_counted() {
    let mesh = sample::triangles(16, 6, 1.6, 0.6);
    let of = |method| {
        let spec = SegmentSpec { method, count: 12, modes: 3, ..Default::default() };
        cut(&mesh, &spec, None).unwrap()
    };
    let (metis, slic) = (of(SegmentMethod::Metis), of(SegmentMethod::Slic));
    let apart = (0..mesh.n_cells()).filter(|&c| metis.node_segment[c] != slic.node_segment[c]).count();
    assert!(apart > 0);
    assert_eq!((metis.moved, slic.moved), (0, apart));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn segments_of_any_mesh_are_full_and_connected_when_asked(
        (nx, ny) in (1usize..8, 1usize..7),
        lost in prop::collection::vec(0usize..4, 100),
        method in prop::sample::select(SegmentMethod::ALL.to_vec()),
        (count, modes, iterations) in (1usize..30, 0usize..5, 0usize..6),
        (tau, connected) in (prop::sample::select(vec![0.0, 0.3, 1.0, 5.0]), any::<bool>()),
    ) {
        let mut mesh = sample::rectangle(nx, ny, 1.3, 0.8);
        let keep: Vec<bool> = (0..mesh.face_owner.len()).map(|f| lost[f % lost.len()] > 0).collect();
        let mut at = keep.iter();
        mesh.face_owner.retain(|_| *at.next().unwrap());
        at = keep.iter();
        mesh.face_neighbour.retain(|_| *at.next().unwrap());
        at = keep.iter();
        mesh.face_coeff.retain(|_| *at.next().unwrap());
        let n = mesh.n_cells();
        let spec = SegmentSpec { method, count, modes, iterations, tau, connected, ..Default::default() };
        let components = sample::pieces(&mesh, &vec![0; n]);
        match cut(&mesh, &spec, None) {
            Ok(s) => {
                prop_assert!(s.node_segment.iter().all(|&l| (0..count as i32).contains(&l)));
                prop_assert!(s.sizes.iter().all(|&n| n > 0.0));
                if connected {
                    prop_assert_eq!(sample::pieces(&mesh, &s.node_segment[..n]), count);
                }
            }
            Err(Error::Input(m)) => prop_assert!(
                count > n || modes >= n || (connected && count < components), "{m}"
            ),
            Err(e) => prop_assert!(false, "{e}"),
        }
    }
}
