//! Ways to the same modes.

use super::super::*;
use m4gn_model::modal::ModalSolver;
use m4gn_samples::mesh as sample;

fn with(mesh: &Mesh, solver: ModalSolver) -> Modes {
    let options = ModalOptions { solver, ..Default::default() };
    laplacian_modes(mesh, &Comm::serial(), &options).unwrap()
}

fn same(a: &Modes, b: &Modes) {
    assert_eq!(a.eigenvalues.len(), b.eigenvalues.len());
    for (i, (x, y)) in a.eigenvalues.iter().zip(&b.eigenvalues).enumerate() {
        assert!((x - y).abs() <= 1e-8 * y.abs().max(1e-3), "eigenvalue {i}: {x} {y}");
        for (x, y) in a.vectors[i].iter().zip(&b.vectors[i]) {
            assert!((x - y).abs() < 1e-6, "mode {i}: {x} {y}");
        }
    }
}

/// A mesh without Dirichlet boundary at all: K is singular.
fn closed() -> Mesh {
    let mut mesh = sample::rectangle(20, 11, 2.0, 1.0);
    mesh.boundary.clear();
    mesh
}

fn meshes() -> Vec<Mesh> {
    vec![
        sample::rectangle(24, 16, 2.0, 1.0),
        sample::rectangle(15, 15, 1.0, 1.0),
        sample::triangles(12, 10, 1.6, 1.0),
        sample::block([9, 8, 7], [1.0, 0.9, 0.7]),
        sample::ring(150, 1.0),
        closed(),
    ]
}

#[test]
fn multigrid_gives_the_modes_of_the_factorisation() {
    for mesh in meshes() {
        let direct = with(&mesh, ModalSolver::Direct);
        same(&with(&mesh, ModalSolver::Iterative), &direct);
    }
}

#[test]
fn faer_gives_the_same_modes() {
    for mesh in meshes() {
        let found = with(&mesh, ModalSolver::Auto);
        let plain = laplacian_reference(&mesh, &Comm::serial(), &ModalOptions::default());
        same(&plain.unwrap(), &found);
    }
}
