//! Dense solution with faer on the root: the plain reference, and the solver of small problems.

use super::gathered::{self, Gathered, Triplet};
use super::pair::Pair;
use super::problem::Problem;
use faer::{Mat, MatRef, Side};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;

/// All finite eigenpairs, those nearest to `shift` first; the root solves and tells the others. Collective.
///
/// n^3 work, n^2 memory.
pub(super) fn eigenpairs(problem: &Problem, shift: f64, comm: &Comm) -> Result<Vec<Pair>> {
    let solved = match Gathered::of(problem, comm) {
        None => Ok(Vec::new()),
        Some(pair) => {
            let (k, m) = (matrix(pair.n, &pair.k), matrix(pair.n, &pair.m));
            pair.check_symmetry().and_then(|()| symmetric(k, m, shift))
        }
    };
    gathered::share(problem, comm, solved)
}

fn matrix(n: usize, entries: &[Triplet]) -> Mat<f64> {
    let mut a = Mat::zeros(n, n);
    entries.iter().for_each(|&(i, j, v)| a[(i, j)] += v);
    a
}

/// With K - shift M = L L^T: the eigenvalues of L^-1 M L^-T are 1 / (lambda - shift), also for a singular M.
fn symmetric(k: Mat<f64>, m: Mat<f64>, shift: f64) -> Result<Vec<f64>> {
    let n = k.nrows();
    let shifted = &k - faer::Scale(shift) * &m;
    let factor =
        shifted.llt(Side::Lower).map_err(|_| crate::not_definite(shift, &format!("{n} unknowns")))?;
    let l = factor.L();
    let mut a = m.clone();
    l.solve_lower_triangular_in_place(a.as_mut());
    let mut a = a.transpose().to_owned();
    l.solve_lower_triangular_in_place(a.as_mut());
    let eigen = a.self_adjoint_eigen(Side::Lower).map_err(failed(n))?;
    let (theta, mut y) = (eigen.S().column_vector(), eigen.U().to_owned());
    // Ascending.
    if theta[0] < -1e-10 * theta[n - 1].abs() {
        return Err(crate::negative_mass(&format!("{:e} is an eigenvalue", shift + 1.0 / theta[0])));
    }
    l.transpose().solve_upper_triangular_in_place(y.as_mut());
    let theta: Vec<f64> = theta.iter().copied().collect();
    Ok(flatten(&theta, y.as_ref(), &m, shift))
}

/// Value, vector, and M times the vector, pair after pair; infinite eigenvalues are left out.
fn flatten(theta: &[f64], vectors: MatRef<f64>, m: &Mat<f64>, shift: f64) -> Vec<f64> {
    let n = vectors.nrows();
    let largest = theta.iter().fold(0.0f64, |most, t| most.max(t.abs()));
    let mut order: Vec<usize> =
        (0..n).filter(|&i| theta[i].abs() > n as f64 * f64::EPSILON * largest).collect();
    order.sort_by(|&a, &b| theta[b].abs().total_cmp(&theta[a].abs()));
    let weighted = m * vectors;
    let mut flat = Vec::with_capacity(order.len() * (1 + 2 * n));
    for i in order {
        flat.push(shift + 1.0 / theta[i]);
        flat.extend(vectors.col(i).iter().chain(weighted.col(i).iter()));
    }
    flat
}

fn failed<E: std::fmt::Debug>(n: usize) -> impl Fn(E) -> Error {
    move |e| Error::Numerical(format!("the dense eigen-decomposition of {n} unknowns failed: {e:?}"))
}
