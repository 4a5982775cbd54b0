//! The clamped beam of 0.6 x 0.06 x 0.06 m, E = 1 MPa, rho = 1000 kg/m^3: bending frequencies and their convergence.

use super::sample::Kind;
use super::*;
use std::f64::consts::PI;

/// The first two bending frequencies, one in either direction, over that of Euler and Bernoulli, 0.851 Hz.
fn bending(kind: Kind, across: usize, poisson: f64) -> [f64; 2] {
    let side = 0.06;
    let mesh = sample::block(kind, [15 * across, across, across], [0.6, side, side]);
    let material = Material { young: 1e6, poisson, density: 1000.0 };
    let clamped: Vec<Fixed> =
        (0..mesh.points.len()).filter(|&p| mesh.points[p][0] < 1e-9).map(|p| Fixed::all(p as i32)).collect();
    let options = Options { modal: ModalOptions::fixed(2), ..Default::default() };
    let materials = vec![material; mesh.n_cells];
    let found = modes(&mesh, &materials, &clamped, &options, &Comm::serial()).unwrap();
    let exact = 1.875_104_068_711_961f64.powi(2) / (2.0 * PI * 0.36) * side * (1000f64 / 12.0).sqrt();
    [0, 1].map(|i| found.eigenvalues[i].sqrt() / (2.0 * PI) / exact)
}

/// What is said of a fine beam whose frequencies are not those of Euler and Bernoulli.
fn far(kind: Kind, poisson: f64, ratios: [f64; 2]) -> Option<String> {
    let bound = if poisson > 0.4 { 0.02 } else { 0.015 };
    let is_far = ratios.iter().any(|r| (r - 1.0).abs() > bound);
    is_far.then(|| format!("{kind:?}, nu {poisson}: {ratios:?}, expected 1 +- {bound}"))
}

/// The kinds of elements whose convergence is not measured below.
#[test]
fn a_clamped_beam_bends_at_the_frequency_of_euler_and_bernoulli_in_both_directions() {
    let mut failures = Vec::new();
    for kind in [Kind::Tetrahedra, Kind::Pyramids, Kind::Polyhedra] {
        for poisson in [0.3, 0.49] {
            let ratios = bending(kind, 4, poisson);
            println!("{kind:?} {poisson}: {ratios:?}");
            failures.extend(far(kind, poisson, ratios));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn a_clamped_beam_converges_under_refinement() {
    // Elasticity's own frequency over Euler-Bernoulli's: shear lowers it, the clamp raises it with nu. Richardson's
    // values of 60 x 4 x 4 and 120 x 8 x 8; those of hexahedra, wedges, tetrahedra and pyramids differ by 5e-4.
    let limits = [(0.0, 0.9932), (0.3, 0.9962), (0.49, 1.0048)];
    let mut failures = Vec::new();
    for kind in [Kind::Hexahedra, Kind::WedgesAlong, Kind::WedgesAcross] {
        for (poisson, limit) in limits {
            let ratios = [1, 2, 4].map(|across| bending(kind, across, poisson));
            failures.extend(far(kind, poisson, ratios[2]).filter(|_| poisson > 0.0));
            for direction in [0, 1] {
                let errors = ratios.map(|r| (r[direction] - limit).abs());
                let order = (errors[0] / errors[2]).log2() / 2.0;
                println!("{kind:?} {poisson}: {errors:?}, order {order:.2}");
                if order < 1.5 {
                    failures.push(format!("{kind:?}, nu {poisson}: {errors:?}, order {order}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
