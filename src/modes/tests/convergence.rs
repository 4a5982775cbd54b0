//! Eigenvalues against the continuous ones, under refinement.

use super::super::*;
use m4gn_samples::mesh as sample;
use std::f64::consts::PI;

/// Slope of log(error) over log(h) by least squares.
fn order(h: &[f64], errors: &[f64]) -> f64 {
    let n = h.len() as f64;
    let (x, y): (Vec<f64>, Vec<f64>) = h.iter().zip(errors).map(|(h, e)| (h.ln(), e.ln())).unzip();
    let mean = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let covariance: f64 = x.iter().zip(&y).map(|(x, y)| (x - mean.0) * (y - mean.1)).sum();
    covariance / x.iter().map(|x| (x - mean.0).powi(2)).sum::<f64>()
}

/// Refines a mesh and asserts the fitted order of each eigenvalue and the error on the finest mesh.
fn converges(mesh: impl Fn(usize) -> Mesh, sizes: &[usize], exact: &[f64], expected: f64, finest: f64) {
    let comm = Comm::serial();
    let mut errors = vec![Vec::new(); exact.len()];
    for &n in sizes {
        let mesh = mesh(n);
        let options = ModalOptions::fixed(exact.len());
        let modes = laplacian_modes(&mesh, &comm, &options).unwrap();
        for ((errors, value), exact) in errors.iter_mut().zip(&modes.eigenvalues).zip(exact) {
            errors.push((value / exact - 1.0).abs());
        }
    }
    let h: Vec<f64> = sizes.iter().map(|&n| 1.0 / n as f64).collect();
    for (i, errors) in errors.iter().enumerate() {
        let fitted = order(&h, errors);
        assert!((fitted - expected).abs() < 0.1, "eigenvalue {i}: order {fitted}, errors {errors:?}");
        assert!(errors[sizes.len() - 1] < finest, "eigenvalue {i}: errors {errors:?}");
    }
}

#[test]
fn a_rectangle_converges_with_second_order() {
    // pi^2 (i^2 / a^2 + j^2 / b^2), a = 2, b = 1.
    let exact = |i: f64, j: f64| PI * PI * (i * i / 4.0 + j * j);
    let wanted = [(1., 1.), (2., 1.), (3., 1.), (1., 2.), (4., 1.), (2., 2.)].map(|(i, j)| exact(i, j));
    let mesh = |n| sample::rectangle(2 * n, n, 2.0, 1.0);
    converges(mesh, &[12, 24, 48], &wanted[..4], 2.0, 2e-3);
    // The fifth and the sixth are one, which the mesh splits.
    converges(mesh, &[16, 32], &wanted, 2.0, 1e-2);
}

#[test]
fn a_block_converges_with_second_order() {
    let exact = |i: f64, j: f64, k: f64| PI * PI * (i * i + j * j / 0.81 + k * k / 0.49);
    let mut wanted: Vec<f64> = (1..4)
        .flat_map(|i| (1..4).flat_map(move |j| (1..4).map(move |k| exact(i as f64, j as f64, k as f64))))
        .collect();
    wanted.sort_by(f64::total_cmp);
    let mesh = |n| sample::block([n, n, n], [1.0, 0.9, 0.7]);
    converges(mesh, &[6, 9, 14], &wanted[..4], 2.0, 2e-2);
}

#[test]
fn a_disk_converges_with_second_order() {
    // Squares of the zeros of the Bessel functions J_0, J_1 twice, J_2 twice, J_0, over the radius.
    let zeros = [
        2.404_825_557_695_773,
        3.831_705_970_207_512,
        3.831_705_970_207_512,
        5.135_622_301_840_683,
        5.135_622_301_840_683,
        5.520_078_110_286_311,
    ];
    let radius = 0.5;
    let wanted = zeros.map(|z: f64| (z / radius).powi(2));
    converges(|n| sample::disk(n, 4 * n, radius), &[8, 16, 32], &wanted, 2.0, 5e-3);
}
