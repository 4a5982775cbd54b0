use super::*;
use m4gn_model::SegmentMethod;
use m4gn_model::modal::ModalOptions;
use m4gn_modes::laplacian_modes;
use m4gn_samples::mesh as sample;

fn spec(count: usize, modes: usize) -> SegmentSpec {
    SegmentSpec { count, modes, ..Default::default() }
}

fn refined(mesh: &Mesh, spec: &SegmentSpec, labels: &[i32]) -> Result<Vec<i32>> {
    let comm = Comm::serial();
    let modes = laplacian_modes(mesh, &comm, &ModalOptions::fixed(spec.modes))?;
    refine(mesh, spec, &modes, &comm, (&mesh.cell_global, labels.to_vec())).map(|r| r.0)
}

/// The rule of [`Features::nearest`] with every centroid looked at.
fn plain_nearest(features: &Features, labels: &[i32], centroids: &[f64]) -> Vec<i32> {
    let margin = features.margin;
    let width = features.width;
    let one = |(cell, &current): (usize, &i32)| {
        let distances: Vec<f64> =
            centroids.chunks_exact(width).map(|c| features.distance(features.of(cell), c)).collect();
        let own = distances[current as usize];
        let open = |d: f64| d <= features.size && d < own - margin;
        let least = distances.iter().copied().filter(|&d| open(d)).fold(f64::INFINITY, f64::min);
        let first = distances.iter().position(|&d| open(d) && d <= least + margin);
        first.map_or(current, |k| k as i32)
    };
    labels.iter().enumerate().map(one).collect()
}

#[test]
fn looking_at_near_centroids_alone_changes_nothing() {
    let comm = Comm::serial();
    let mesh = sample::triangles(24, 9, 1.6, 0.41);
    let modes = laplacian_modes(&mesh, &comm, &ModalOptions::fixed(5)).unwrap();
    for method in SegmentMethod::ALL {
        for (count, tau, size) in
            [(7, 1.0, None), (40, 0.3, None), (20, 0.0, Some(0.2)), (60, 2.0, Some(0.05))]
        {
            let spec = SegmentSpec { method, tau, size, ..spec(count, 5) };
            let features = Features::new(&mesh, &spec, &comm, &modes.vectors).unwrap();
            let mut labels: Vec<i32> = (0..mesh.n_cells()).map(|c| (c * 7 % count) as i32).collect();
            for _ in 0..6 {
                let centroids = features.centroids(&comm, count, &labels);
                let next = features.nearest(&labels, &centroids);
                assert_eq!(next, plain_nearest(&features, &labels, &centroids));
                labels = next;
            }
        }
    }
}

#[test]
fn two_blobs_are_found_from_a_poor_start() {
    let mut mesh = sample::chain(8, 8.0);
    // Two groups of four cells, 10 m apart.
    mesh.cell_centres[4..].iter_mut().for_each(|x| x[0] += 10.0);
    let spec = SegmentSpec { size: Some(20.0), ..spec(2, 0) };
    assert_eq!(refined(&mesh, &spec, &[0, 0, 0, 1, 0, 1, 1, 1]).unwrap(), [0, 0, 0, 0, 1, 1, 1, 1]);
    // One sweep on paper: centroids 11.2 / 4 + ..., all cells farther than S stay.
    let spec = SegmentSpec { size: Some(1e-3), ..spec };
    assert_eq!(refined(&mesh, &spec, &[0, 0, 0, 1, 0, 1, 1, 1]).unwrap(), [0, 0, 0, 1, 0, 1, 1, 1]);
}

#[test]
fn the_sign_change_of_the_second_mode_cuts_a_chain_in_half() {
    let mesh = sample::chain(10, 1.0);
    let spec = SegmentSpec { tau: 0.0, size: Some(1.0), ..spec(2, 2) };
    let labels = refined(&mesh, &spec, &[0, 0, 0, 0, 0, 0, 0, 1, 1, 1]).unwrap();
    assert_eq!(labels, [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]);
}

#[test]
fn a_segment_keeps_its_nearest_cell() {
    // Segment 1 has cells 0 and 5 and its centroid in the middle of segment 0: all would leave it.
    let mesh = sample::chain(6, 6.0);
    let spec = SegmentSpec { size: Some(10.0), iterations: 1, ..spec(3, 0) };
    let labels = refined(&mesh, &spec, &[1, 0, 0, 2, 2, 1]).unwrap();
    assert!((0..3).all(|k| labels.contains(&k)), "{labels:?}");
}

#[test]
fn sizes_beyond_numbers() {
    let mesh = sample::chain(6, 6.0);
    let start = [0, 0, 0, 1, 1, 1];
    for size in [1e-320, 1e-12, 1e200] {
        let spec = SegmentSpec { size: Some(size), ..spec(2, 2) };
        let found = refined(&mesh, &spec, &start).unwrap();
        assert!(found.contains(&0) && found.contains(&1), "{size}: {found:?}");
    }
    for (size, mode_scale) in [(1.7e308, None), (1.0, Some(1.7e308))] {
        let spec = SegmentSpec { size: Some(size), mode_scale, ..spec(2, 2) };
        m4gn_samples::fails(refined(&mesh, &spec, &start), &["mode_scale", "1.7e308"]);
    }
}

#[test]
fn the_default_size_is_that_of_the_paper() {
    let mesh = sample::rectangle(16, 4, 1.6, 0.41);
    let extent = Extent::of(&mesh, &Comm::serial());
    assert!((default_size(&mesh, &extent, 36) - (0.656f64 / 36.0).sqrt()).abs() < 1e-12);
}

/// Two cells a segment on a line, S = 1, one mode: what moves the middle cells is a mode as it is, or S times it, and what
/// of the nearer centroid the margin asks for.
#[test]
fn modes_and_margin_as_printed() {
    let mut mesh = sample::chain(4, 4.0);
    let at = [0.0, 1.0, 2.1, 3.0];
    mesh.cell_centres.iter_mut().zip(at).for_each(|(x, at)| x[0] = at);
    let modes = Modes { eigenvalues: vec![1.0], vectors: vec![vec![0.0, 0.0, 0.5, 0.5]] };
    let labels = |spec: &SegmentSpec| {
        let start = (&mesh.cell_global[..], vec![0, 0, 0, 1]);
        refine(&mesh, spec, &modes, &Comm::serial(), start).unwrap().0
    };
    let size = SegmentSpec { size: Some(4.0), iterations: 1, ..spec(2, 1) };
    // Cell 2: |1.0667 .. |: 1.0667 + 0.333 S from segment 0, 0.9 from segment 1.
    let found = |mode_scale, margin| labels(&SegmentSpec { mode_scale, margin, ..size.clone() });
    assert_eq!(found(Some(1.0), 0.0), [0, 0, 1, 1]);
    // Nearer by 1.0667 + 0.3333 - 0.9 = 0.5 = 0.125 S as printed, by 1.0667 + 1.3333 - 0.9 = 1.5 = 0.375 S with S times the mode.
    assert_eq!(found(Some(1.0), 0.124), [0, 0, 1, 1]);
    assert_eq!(found(Some(1.0), 0.126), [0, 0, 0, 1]);
    assert_eq!(found(None, 0.374), [0, 0, 1, 1]);
    assert_eq!(found(None, 0.376), [0, 0, 0, 1]);
}
