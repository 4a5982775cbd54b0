//! Sparse solution with faer on the root: shift-and-invert for builds without SLEPc, and a second opinion.

use super::gathered::{self, Gathered, Triplet};
use super::pair::Pair;
use super::problem::Problem;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::solvers::Solve;
use faer::matrix_free::LinOp;
use faer::matrix_free::eigen::{PartialEigenParams, partial_eigen, partial_eigen_scratch};
use faer::prelude::ReborrowMut;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet as Entry};
use faer::{Col, Mat, MatMut, MatRef, Par, Side, c64};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};

/// Most sweeps that look for copies of repeated eigenvalues.
const SWEEPS: usize = 40;

/// Relative residual of an eigenpair of the inverse.
const TOLERANCE: f64 = 1e-11;

/// Eigenpairs of a symmetric pair, nearest to the shift first: those that `taken` takes, and a few more. Collective;
/// the root solves and tells the others.
///
/// The factor has to fit into the root's memory.
pub(super) fn eigenpairs(
    problem: &Problem,
    shift: f64,
    wanted: usize,
    taken: &dyn Fn(&[f64]) -> Option<usize>,
    comm: &Comm,
) -> Result<Vec<Pair>> {
    let solved = match Gathered::of(problem, comm) {
        None => Ok(Vec::new()),
        Some(pair) => Search::new(pair, shift).and_then(|mut search| {
            search.run(wanted, taken)?;
            Ok(search.flat())
        }),
    };
    gathered::share(problem, comm, solved)
}

/// x -> (K - shift M)^-1 M x with known vectors projected out, M-orthogonally.
struct Inverse {
    n: usize,
    factor: Llt<usize, f64>,
    m: SparseColMat<usize, f64>,
    /// M-orthonormal.
    known: Vec<Col<f64>>,
    /// M times each.
    weighted: Vec<Col<f64>>,
}

impl std::fmt::Debug for Inverse {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Inverse({})", self.n)
    }
}

impl Inverse {
    /// Takes the part along known vectors out of a vector.
    fn project(&self, x: &mut Col<f64>) {
        for (q, mq) in self.known.iter().zip(&self.weighted) {
            let along = mq.transpose() * &*x;
            *x -= faer::Scale(along) * q;
        }
    }
}

impl LinOp<f64> for Inverse {
    fn apply_scratch(&self, _columns: usize, _par: Par) -> StackReq {
        StackReq::EMPTY
    }

    fn nrows(&self) -> usize {
        self.n
    }

    fn ncols(&self) -> usize {
        self.n
    }

    fn apply(&self, mut out: MatMut<'_, f64>, x: MatRef<'_, f64>, _par: Par, _stack: &mut MemStack) {
        for j in 0..x.ncols() {
            let mut y: Col<f64> = &self.m * x.col(j);
            self.factor.solve_in_place(y.as_mat_mut());
            self.project(&mut y);
            out.rb_mut().col_mut(j).copy_from(&y);
        }
    }

    fn conj_apply(&self, out: MatMut<'_, f64>, x: MatRef<'_, f64>, par: Par, stack: &mut MemStack) {
        self.apply(out, x, par, stack);
    }
}

struct Search {
    inverse: Inverse,
    shift: f64,
    values: Vec<f64>,
}

impl Search {
    fn new(pair: Gathered, shift: f64) -> Result<Self> {
        pair.check_symmetry()?;
        let n = pair.n;
        let m = matrix(n, pair.m.iter().copied())?;
        let scaled = pair.m.iter().map(|&(i, j, v)| (i, j, -shift * v));
        let shifted = matrix(n, pair.k.iter().copied().chain(scaled))?;
        let factor = shifted.sp_cholesky(Side::Lower).map_err(|e| {
            Error::Numerical(format!(
                "K - ({shift:e}) M of {n} unknowns has no Cholesky factor ({e:?}): expected K and M positive \
                 semi-definite and no vector that both make 0"
            ))
        })?;
        Ok(Search {
            inverse: Inverse {
                n,
                factor,
                m,
                known: Vec::new(),
                weighted: Vec::new(),
            },
            shift,
            values: Vec::new(),
        })
    }

    fn run(&mut self, wanted: usize, taken: &dyn Fn(&[f64]) -> Option<usize>) -> Result<()> {
        let n = self.inverse.n;
        let mut ask = (wanted + 2).min(n);
        for sweep in 0..SWEEPS {
            let bound = self.bound(taken);
            let before = self.values.len();
            self.sweep(ask, sweep)?;
            let new = &self.values[before..];
            let fresh = before == 0 || new.iter().any(|&v| bound.is_none_or(|b| v <= b));
            if self.values.len() >= n || new.is_empty() || (!fresh && self.bound(taken).is_some()) {
                return Ok(());
            }
            ask = 2.min(n - self.values.len());
        }
        Err(Error::Numerical(format!(
            "{} modes did not suffice to find the end of a cluster of repeated eigenvalues: ask for fewer or more modes",
            self.values.len()
        )))
    }

    fn bound(&self, taken: &dyn Fn(&[f64]) -> Option<usize>) -> Option<f64> {
        let mut values = self.values.clone();
        values.sort_by(f64::total_cmp);
        let n = taken(&values)?;
        values.get(n.checked_sub(1)?).copied()
    }

    fn sweep(&mut self, wanted: usize, start: usize) -> Result<()> {
        let n = self.inverse.n;
        // Any start without symmetry will do, another one each time.
        let mut from = Col::from_fn(n, |i| 1.0 + (1.7 * (i + 1) as f64 + 0.61 * start as f64).sin());
        self.inverse.project(&mut from);
        let length = from.norm_l2();
        from /= faer::Scale(length);
        let mut vectors = Mat::<c64>::zeros(n, wanted);
        let mut values = vec![c64::new(0.0, 0.0); wanted];
        let params = PartialEigenParams::default();
        let scratch = partial_eigen_scratch(&self.inverse, wanted, Par::Seq, params);
        let found = partial_eigen(
            vectors.as_mut(),
            &mut values,
            &self.inverse,
            from.as_ref(),
            TOLERANCE,
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
            params,
        );
        if found.n_converged_eigen == 0 {
            return Err(Error::Numerical(format!(
                "no mode of {n} unknowns converged: look at the mesh for badly scaled cells"
            )));
        }
        for (j, theta) in values.iter().enumerate().take(found.n_converged_eigen) {
            let mut x = Col::from_fn(n, |i| vectors[(i, j)].re);
            self.inverse.project(&mut x);
            self.inverse.project(&mut x);
            let mut mx = &self.inverse.m * &x;
            let square: f64 = x.transpose() * &mx;
            // Infinite eigenvalues, and what the projection leaves of known ones.
            if !(square > 0.0 && theta.re > 0.0 && square.is_finite()) {
                continue;
            }
            let scale = faer::Scale(1.0 / square.sqrt());
            x *= scale;
            mx *= scale;
            self.values.push(self.shift + 1.0 / theta.re);
            self.inverse.known.push(x);
            self.inverse.weighted.push(mx);
        }
        Ok(())
    }

    fn flat(&self) -> Vec<f64> {
        let mut order: Vec<usize> = (0..self.values.len()).collect();
        order.sort_by(|&a, &b| self.values[a].total_cmp(&self.values[b]));
        let mut flat = Vec::with_capacity(order.len() * (2 + 2 * self.inverse.n));
        for i in order {
            let (x, mx) = (&self.inverse.known[i], &self.inverse.weighted[i]);
            gathered::push(&mut flat, (self.values[i], 0.0), x.iter(), mx.iter());
        }
        flat
    }
}

fn matrix(n: usize, entries: impl Iterator<Item = Triplet>) -> Result<SparseColMat<usize, f64>> {
    let entries: Vec<_> = entries.map(|(i, j, v)| Entry::new(i, j, v)).collect();
    SparseColMat::try_new_from_triplets(n, n, &entries)
        .map_err(|e| Error::Numerical(format!("a sparse matrix of {n} unknowns cannot be made: {e:?}")))
}
