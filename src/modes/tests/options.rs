//! Ways to the same modes, and options of PETSc.

use super::super::*;
use m4gn_mesh::Error;
use m4gn_model::modal::ModalSolver;
use m4gn_samples::mesh as sample;

fn with(mesh: &Mesh, solver: ModalSolver, petsc: &str) -> Result<Modes> {
    let comm = Comm::serial();
    let options = ModalOptions { solver, petsc: petsc.into(), ..Default::default() };
    laplacian_modes(mesh, &comm, &options)
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
        let direct = with(&mesh, ModalSolver::Direct, "").unwrap();
        same(&with(&mesh, ModalSolver::Iterative, "").unwrap(), &direct);
    }
}

#[test]
fn faer_gives_the_same_modes() {
    for mesh in meshes() {
        let found = with(&mesh, ModalSolver::Auto, "").unwrap();
        let plain = laplacian_reference(&mesh, &Comm::serial(), &ModalOptions::default());
        same(&plain.unwrap(), &found);
    }
}

#[test]
fn options_of_petsc_are_used_or_refused() {
    let mesh = sample::rectangle(24, 16, 2.0, 1.0);
    let expected = with(&mesh, ModalSolver::Auto, "").unwrap();
    for good in [
        "-m4gn_eps_ncv 40 -m4gn_eps_tol 1e-12",
        "-m4gn_st_pc_factor_mat_solver_type mumps",
        "-m4gn_st_pc_type cholesky -m4gn_st_pc_factor_mat_ordering_type rcm",
        "-m4gn_st_ksp_type cg -m4gn_st_ksp_rtol 1e-12 -m4gn_st_pc_type gamg",
    ] {
        same(&with(&mesh, ModalSolver::Auto, good).unwrap(), &expected);
    }
    let iterative = with(&mesh, ModalSolver::Iterative, "-m4gn_st_pc_hypre_boomeramg_coarsen_type PMIS");
    same(&iterative.unwrap(), &expected);
    for (bad, word) in [
        ("-m4gn_st_pc_type no_such", "no_such"),
        ("-m4gn_eps_ncv many", "many"),
        ("-m4gn_eps_ncv 3", "ncv"),
        ("-m4gn_eps_tolerance 1e-9", "not used"),
        ("-eps_tol 1e-9", "-m4gn_"),
    ] {
        let error = with(&mesh, ModalSolver::Auto, bad).unwrap_err();
        assert!(error.status() > 0 && error.to_string().contains(word), "{bad}: {error}");
        // They are gone with the call.
        same(&with(&mesh, ModalSolver::Auto, "").unwrap(), &expected);
    }
    assert!(matches!(ModalSolver::parse("fast"), Err(Error::Input(_))));
}
