//! Pairs of matrices and the ways to their modes, on several ranks.

use crate::checks::{Checks, compare_modes};
use crate::matrices::{self, problem};
use m4gn_base::Result;
use m4gn_model::modal::{ModalOptions, ModalSolver, Modes};
use m4gn_modes::{Problem, Rows, laplacian_modes, solve};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use std::f64::consts::PI;

/// This rank's rows of a matrix of constant bands, the same for each of `block` unknowns of a point. The last rank has no point where
/// there is more than one.
fn bands(comm: &Comm, points: i64, band: [f64; 3], block: usize) -> Rows {
    let ranks = i64::from(comm.size() - 1).max(1);
    let first = |r: i32| points * i64::from(r).min(ranks) / ranks;
    matrices::bands(first(comm.rank())..first(comm.rank() + 1), points, band, &vec![1.0; block])
}

/// All that is checked here.
pub fn pairs(checks: &mut Checks) {
    let comm = checks.comm.clone();
    for n in [30, 300] {
        on_paper(checks, &comm, n);
    }
    ways(checks);
    copies(checks);
}

/// Eigenvalues to 1e-8 of those on paper.
fn expect(checks: &mut Checks, name: &str, found: Result<Modes>, exact: &[f64], tolerance: f64) {
    let Some(found) = checks.value(found, name) else {
        return;
    };
    checks.that(found.eigenvalues.len() == exact.len(), format!("{name}: number of modes"));
    for (x, y) in found.eigenvalues.iter().zip(exact) {
        checks.that((x / y - 1.0).abs() < tolerance, format!("{name}: {x}, expected {y}"));
    }
}

fn on_paper(checks: &mut Checks, comm: &Comm, n: i64) {
    let h = 1.0 / (n + 1) as f64;
    let cos = |k: f64| (k * PI * h).cos();
    let options = ModalOptions::fixed(4);
    let (k, m) = (
        bands(comm, n, [-1.0 / h, 2.0 / h, -1.0 / h], 1),
        bands(comm, n, [h / 6.0, 4.0 * h / 6.0, h / 6.0], 1),
    );
    let exact = [1.0, 2.0, 3.0, 4.0].map(|k| 6.0 / (h * h) * (1.0 - cos(k)) / (2.0 + cos(k)));
    let found = solve(&problem(k, Some(m)), comm, &options);
    expect(checks, &format!("bar of {n}"), found, &exact, 1e-8);

    let exact = |k: f64| 2.0 - 2.0 * cos(k);
    let k = bands(comm, n, [-1.0, 2.0, -1.0], 2);
    let found = solve(&Problem { block: 2, ..problem(k, None) }, comm, &ModalOptions::fixed(3));
    expect(checks, &format!("two chains of {n}"), found, &[1.0, 1.0, 2.0, 2.0].map(exact), 1e-7);
}

/// Factorisation and multigrid, on the ranks and on one, give the same modes.
fn ways(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let serial = Comm::serial();
    let mut closed = sample::rectangle(20, 11, 2.0, 1.0);
    closed.boundary.clear();
    for (name, mesh) in [
        ("block", sample::block([8, 7, 6], [1.0, 0.9, 0.7])),
        ("disk", sample::disk(8, 24, 1.0)),
        ("closed", closed),
        ("ring", sample::ring(150, 1.0)),
        ("triangles", sample::triangles(12, 10, 1.6, 1.0)),
    ] {
        let whole = laplacian_modes(&mesh, &serial, &ModalOptions::default());
        let Some(whole) = checks.value(whole, name) else {
            continue;
        };
        let ranks = sample::strips(mesh.n_cells(), comm.size());
        let part = sample::part(&mesh, &ranks, comm.rank());
        for solver in [ModalSolver::Direct, ModalSolver::Iterative] {
            let options = ModalOptions { solver, ..Default::default() };
            let found = laplacian_modes(&part, &comm, &options);
            let name = format!("{name}, {solver:?}");
            let Some(found) = checks.value(found, &name) else {
                continue;
            };
            compare_modes(checks, &name, &part, &found, &whole, (1e-2, 1e-6));
        }
    }
}

/// Equal parts that are not joined: each eigenvalue as often as there are parts, with the vectors of one rank.
fn copies(checks: &mut Checks) {
    let (parts, points) = (7, 30);
    let of = |comm: &Comm| {
        let mut k = bands(comm, parts * points, [-1.0, 2.0, -1.0], 1);
        let first = comm.exclusive_scan_i64(k.n() as i64);
        for (i, w) in (first..).zip(k.row.windows(2)) {
            for e in w[0]..w[1] {
                if k.column[e] / points != i / points {
                    k.value[e] = 0.0;
                }
            }
        }
        let found = solve(&problem(k, None), comm, &ModalOptions::fixed(1));
        (first as usize, found)
    };
    let comm = checks.comm.clone();
    let ((first, found), (_, whole)) = (of(&comm), of(&Comm::serial()));
    let exact = 2.0 - 2.0 * (PI / (points + 1) as f64).cos();
    let Some(whole) = checks.value(whole, "equal parts, one rank") else {
        return;
    };
    if let Ok(found) = &found {
        for (mode, same) in found.vectors.iter().zip(&whole.vectors) {
            let off = mode.iter().zip(&same[first..]).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            checks.that(off < 1e-5, format!("equal parts: a mode differs by {off:e}"));
        }
    }
    expect(checks, "equal parts", found, &[exact; 7], 1e-8);
}
