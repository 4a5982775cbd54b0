use super::super::*;
use m4gn_base::Error;
use m4gn_samples::mesh as sample;
use std::f64::consts::PI;

fn modes(mesh: &Mesh, n: usize) -> Result<Modes> {
    let comm = Comm::serial();
    laplacian_modes(mesh, &comm, &ModalOptions::fixed(n))
}

/// The first `n` eigenvalues of the finite-volume Laplacian of a rectangle or a block of so many cells and this length along each axis:
/// exact, not only in the limit.
fn discrete(axes: &[(usize, f64)], n: usize) -> Vec<f64> {
    let one = |&(n, l): &(usize, f64)| -> Vec<f64> {
        (1..=n).map(|k| (2.0 * n as f64 / l * (k as f64 * PI / (2 * n) as f64).sin()).powi(2)).collect()
    };
    let mut all = axes.iter().map(one).fold(vec![0.0], |sums, axis| {
        sums.iter().flat_map(|sum| axis.iter().map(move |value| sum + value)).collect()
    });
    all.sort_by(f64::total_cmp);
    all.truncate(n);
    all
}

#[test]
fn a_chain_has_the_eigenvalues_on_paper() {
    // Both ways to solve: dense (12 cells) and SLEPc (150).
    for n in [12, 150] {
        let m = modes(&sample::chain(n, 2.0), 5).unwrap();
        let h = 2.0 / n as f64;
        for (k, value) in m.eigenvalues.iter().enumerate() {
            let exact = (2.0 / h * ((k + 1) as f64 * PI / (2 * n) as f64).sin()).powi(2);
            assert!((value / exact - 1.0).abs() < 1e-9, "{n}: {value} {exact}");
        }
    }
}

#[test]
fn every_copy_of_repeated_eigenvalues_of_a_square_is_found() {
    let m = modes(&sample::rectangle(24, 24, 1.0, 1.0), 12).unwrap();
    let exact = discrete(&[(24, 1.0), (24, 1.0)], m.eigenvalues.len());
    for (value, exact) in m.eigenvalues.iter().zip(&exact) {
        assert!((value / exact - 1.0).abs() < 1e-9, "{:?}\n{exact:?}", m.eigenvalues);
    }
    // The second eigenvalue is double: asking for two gives three.
    assert_eq!(modes(&sample::rectangle(24, 24, 1.0, 1.0), 2).unwrap().eigenvalues.len(), 3);
}

#[test]
fn a_block_has_the_eigenvalues_on_paper() {
    let m = modes(&sample::block([9, 8, 7], [1.0, 0.9, 0.7]), 6).unwrap();
    let exact = discrete(&[(9, 1.0), (8, 0.9), (7, 0.7)], m.eigenvalues.len());
    for (value, exact) in m.eigenvalues.iter().zip(&exact) {
        assert!((value / exact - 1.0).abs() < 1e-9, "{:?}\n{exact:?}", m.eigenvalues);
    }
}

/// Squares of the zeros of the Bessel functions J_0, J_1 twice, J_2 twice, J_0, over the radius.
#[test]
fn a_disk_converges_with_second_order() {
    let zeros: [f64; 6] = [
        2.404_825_557_695_773,
        3.831_705_970_207_512,
        3.831_705_970_207_512,
        5.135_622_301_840_683,
        5.135_622_301_840_683,
        5.520_078_110_286_311,
    ];
    let radius = 0.5;
    let errors = [8, 16, 32].map(|n| {
        let found = modes(&sample::disk(n, 4 * n, radius), 6).unwrap().eigenvalues;
        [0, 1, 2, 3, 4, 5].map(|i| (found[i] / (zeros[i] / radius).powi(2) - 1.0).abs())
    });
    for i in 0..6 {
        let order = (errors[0][i] / errors[2][i]).log2() / 2.0;
        assert!(
            (order - 2.0).abs() < 0.1 && errors[2][i] < 5e-3,
            "eigenvalue {i}: order {order}, {errors:?}"
        );
    }
}

#[test]
fn modes_are_scaled_orthogonal_and_equal_to_the_dense_ones() {
    let mesh = sample::triangles(12, 10, 1.0, 1.0);
    let (m, r) = (
        modes(&mesh, 6).unwrap(),
        laplacian_reference(&mesh, &Comm::serial(), &ModalOptions::fixed(6)).unwrap(),
    );
    assert_eq!(m.eigenvalues.len(), r.eigenvalues.len());
    let inner = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).zip(&mesh.cell_volumes).map(|((x, y), v)| x * y * v).sum()
    };
    for i in 0..m.vectors.len() {
        for j in 0..=i {
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((inner(&m.vectors[i], &m.vectors[j]) - expected).abs() < 1e-9);
        }
        assert!((m.eigenvalues[i] / r.eigenvalues[i] - 1.0).abs() < 1e-10);
        for (x, y) in m.vectors[i].iter().zip(&r.vectors[i]) {
            assert!((x - y).abs() < 1e-7, "mode {i}: {x} {y}");
        }
    }
}

#[test]
fn a_ring_without_boundary_starts_with_the_constant() {
    for n in [16, 128] {
        let m = modes(&sample::ring(n, 1.0), 2).unwrap();
        // 2 - 2 cos(2 pi k / n): 0 once, then pairs.
        assert_eq!(m.eigenvalues.len(), 3);
        assert!(m.eigenvalues[0].abs() < 1e-9);
        let second = 2.0 - 2.0 * (2.0 * PI / n as f64).cos();
        assert!((m.eigenvalues[1] / second - 1.0).abs() < 1e-8);
        assert!(m.vectors[0].iter().all(|x| (x.abs() - 1.0).abs() < 1e-8));
    }
}

#[test]
fn a_cyclic_channel_equals_a_ring_of_rows() {
    let mut mesh = sample::rectangle(16, 8, 2.0, 1.0);
    sample::make_cyclic(&mut mesh, 2.0);
    let m = modes(&mesh, 3).unwrap();
    let across = (2.0 * 8.0 * (PI / 16.0).sin()).powi(2);
    let along = (2.0 * 8.0 * (PI / 16.0).sin()).powi(2);
    for (value, exact) in m.eigenvalues.iter().zip([across, across + along, across + along]) {
        assert!((value / exact - 1.0).abs() < 1e-9, "{:?}", m.eigenvalues);
    }
}

#[test]
fn as_many_modes_as_cells_is_an_error_that_says_so() {
    let mesh = sample::chain(5, 1.0);
    assert_eq!(modes(&mesh, 4).unwrap().eigenvalues.len(), 4);
    assert_eq!(modes(&mesh, 0).unwrap().vectors.len(), 0);
    let error = modes(&mesh, 5).unwrap_err();
    assert!(matches!(&error, Error::Input(m) if m.contains("at most 4")), "{error}");
}

#[test]
fn two_cells_have_one_mode() {
    let m = modes(&sample::chain(2, 1.0), 1).unwrap();
    // h = 1/2: 4 / h^2 sin^2(pi / 4) = 8; both cells alike.
    assert!((m.eigenvalues[0] - 8.0).abs() < 1e-9);
    assert!((m.vectors[0][0] - m.vectors[0][1]).abs() < 1e-12 && (m.vectors[0][0].abs() - 1.0).abs() < 1e-12);
    assert!(matches!(modes(&sample::chain(2, 1.0), 2), Err(Error::Input(_))));
}
