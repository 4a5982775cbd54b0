use super::*;
use m4gn_base::Error;
use m4gn_samples::mesh as sample;

fn of(mesh: &Mesh, labels: &[i32], count: usize) -> Result<Quality> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    quality(mesh, &mut graph, labels, count, &comm)
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-12
}

/// Cells at 0.5, 1.5, 2.5, 3.5 on a path of 3 edges, degrees 1, 2, 2, 1.
#[test]
fn a_path_of_four_cells() {
    let mesh = sample::chain(4, 4.0);
    let q = of(&mesh, &[0, 0, 1, 1], 2).unwrap();
    assert!(near(q.conductance, 1.0 / 3.0) && near(q.edge_cut_ratio, 1.0 / 3.0));
    // Outer cells: a = 1, b = 2.5; inner ones: a = 1, b = 1.5.
    assert!(near(q.silhouette, (0.6 + 1.0 / 3.0) / 2.0), "{q:?}");
    // All edges cut; a = 2 for everybody, b = (1 + 3) / 2 for the outer cells, 1 for the inner ones.
    let q = of(&mesh, &[0, 1, 0, 1], 2).unwrap();
    assert!(near(q.conductance, 1.0) && near(q.edge_cut_ratio, 1.0));
    assert!(near(q.silhouette, -0.25), "{q:?}");
    // Segments {0}, {1, 2, 3}: conductances 1 / 1 and 1 / 1.
    let q = of(&mesh, &[0, 1, 1, 1], 2).unwrap();
    assert!(near(q.conductance, 1.0) && near(q.edge_cut_ratio, 1.0 / 3.0));
    // Cell 0 has 0; cell 1: a 1.5, b 1; cell 2: a 1, b 2; cell 3: a 1.5, b 3.
    assert!(near(q.silhouette, (-1.0 / 3.0 + 0.5 + 0.5) / 4.0), "{q:?}");
}

/// Three segments of a 3 x 2 grid, its columns: 7 edges, 4 cut; degrees 2 3 2 / 2 3 2.
#[test]
fn columns_of_a_grid() {
    let mesh = sample::rectangle(3, 2, 3.0, 2.0);
    let q = of(&mesh, &[0, 1, 2, 0, 1, 2], 3).unwrap();
    assert!(near(q.edge_cut_ratio, 4.0 / 7.0));
    // Outer columns: 2 / min(4, 10); the middle one: 4 / min(6, 8).
    assert!(near(q.conductance, (0.5 + 0.5 + 4.0 / 6.0) / 3.0));
    let b = (1.0 + 2f64.sqrt()) / 2.0;
    assert!(near(q.silhouette, (b - 1.0) / b), "{q:?}");
    assert_eq!(q.silhouette_cells, 6);
}

#[test]
fn one_segment_and_as_many_as_cells() {
    let mesh = sample::rectangle(3, 2, 3.0, 2.0);
    let q = of(&mesh, &[0; 6], 1).unwrap();
    assert_eq!((q.conductance, q.edge_cut_ratio, q.silhouette), (0.0, 0.0, 0.0));
    let q = of(&mesh, &[0, 1, 2, 3, 4, 5], 6).unwrap();
    assert_eq!((q.conductance, q.edge_cut_ratio, q.silhouette), (1.0, 1.0, 0.0));
}

/// Every cell against every other, one at a time, in the order of the definition.
fn plain_silhouette(mesh: &Mesh, labels: &[i32], count: usize) -> f64 {
    let distance = |i: usize, j: usize| {
        let (a, b) = (mesh.cell_centres[i], mesh.cell_centres[j]);
        (a[0] - b[0]).hypot(a[1] - b[1])
    };
    let n = labels.len();
    let mean = |i: usize, k: usize| {
        let members: Vec<usize> = (0..n).filter(|&j| j != i && labels[j] as usize == k).collect();
        members.iter().map(|&j| distance(i, j)).sum::<f64>() / members.len() as f64
    };
    let one = |i: usize| {
        let own = labels[i] as usize;
        let a = mean(i, own);
        let b = (0..count).filter(|&k| k != own).map(|k| mean(i, k)).fold(f64::INFINITY, f64::min);
        if a.is_nan() { 0.0 } else { (b - a) / a.max(b) }
    };
    (0..n).map(one).sum::<f64>() / n as f64
}

#[test]
fn the_fast_silhouette_is_the_plain_one() {
    let mesh = sample::triangles(13, 11, 1.6, 0.41);
    let labels: Vec<i32> = (0..mesh.n_cells()).map(|c| (hash(c as u64) % 5) as i32).collect();
    let found = of(&mesh, &labels, 5).unwrap().silhouette;
    assert!((found - plain_silhouette(&mesh, &labels, 5)).abs() < 1e-10);
    let labels: Vec<i32> = (0..mesh.n_cells()).map(|c| (mesh.cell_centres[c][0] * 5.0) as i32).collect();
    let found = of(&mesh, &labels, 8).unwrap().silhouette;
    assert!((found - plain_silhouette(&mesh, &labels, 8)).abs() < 1e-10);
}

#[test]
fn labels_are_checked() {
    let mesh = sample::chain(4, 4.0);
    for labels in [&[0, 0, 1][..], &[0, 0, 1, 2], &[0, 0, 0, 0]] {
        assert!(matches!(of(&mesh, labels, 2), Err(Error::Input(_))));
    }
}
