//! Modes of a mesh (Algorithm 1): K phi = lambda M phi.
//!
//! Fluid: K is the solver's own finite-volume Laplacian (off-diagonal -c of each face, every boundary face a
//! Dirichlet one, eq. 6), M the cell volumes; eigenvalues are in 1/m^2. Solid: stiffness and mass (eq. 5), with
//! several unknowns a point; eigenvalues are in 1/s^2. Any solver can hand in its own pair as a [`Problem`].
//!
//! Two traps are closed here: the sign of an eigenvector, and the basis of a repeated eigenvalue's space, are chosen
//! by a rule that looks at positions alone (`canonical.rs`), so that they depend neither on the ranks nor on the
//! solver's start vector.

#[cfg(test)]
extern crate self as m4gn_modes;

mod assemble;
mod canonical;
mod dense;
pub mod eigen;
pub mod fem;
mod frame;
mod gathered;
mod pair;
mod problem;
mod select;

pub use problem::{Mass, Problem, Rows};

use frame::Frame;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::body::Body;
use m4gn_mesh::{ElasticModes, Mesh};
use m4gn_model::modal::{ModalOptions, ModalSource, Modes};
use m4gn_parallel::Comm;
use pair::Pair;
use std::borrow::Cow;

/// Problems of at most this many unknowns are solved densely: Krylov spaces are no smaller there.
const DENSE: usize = 100;

/// Whether the graph of K is that of a plane mesh: rows of at most six entries an unknown of a point (four of
/// triangles, five of quads; hexahedra have seven). `unknowns` and `entries` of all ranks.
pub fn is_plane(unknowns: i64, entries: i64, block: usize) -> bool {
    entries <= 6 * unknowns * block as i64
}

/// Whether [`ModalSolver::Auto`] does without a factorisation: above 4 million unknowns of a plane mesh, 400,000 else.
///
/// The factor of a mesh grows like n log n in two dimensions and like n^(4/3) in three, its work like n^(3/2) and n^2;
/// at these sizes the factor takes some 3 GB, over all ranks.
fn prefers_iterative(unknowns: i64, entries: i64, block: usize) -> bool {
    let limit = if is_plane(unknowns, entries, block) { 4_000_000 } else { 400_000 };
    unknowns > limit
}

/// The error of a pair whose K - shift M is not positive definite.
pub fn not_definite(shift: f64, why: &str) -> Error {
    Error::Numerical(format!(
        "K - ({shift:e}) M is not positive definite ({why}): expected a symmetric pair with K and M positive semi-definite \
         and no vector that both make 0, as a row of zeros in both; give a shift below the spectrum"
    ))
}

/// The error of a pair whose M is not positive semi-definite.
pub fn negative_mass(why: &str) -> Error {
    Error::Numerical(format!(
        "M is not positive semi-definite ({why}): expected masses or volumes that are not negative"
    ))
}

/// The first Laplacian modes. Collective; all ranks fail together.
///
/// If the last eigenvalue is repeated, its whole cluster is returned: there may be more modes than asked for, never
/// fewer. Without Dirichlet boundaries (all cyclic) the first mode is the constant one with eigenvalue 0.
///
/// # Errors
/// [`m4gn_base::Error::Input`] if the number of modes is not below the number of cells or an option is wrong,
/// [`m4gn_base::Error::Numerical`] if the solver fails.
pub fn laplacian_modes(mesh: &Mesh, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    let (problem, frame) = assemble::laplacian(mesh, comm)?;
    Solution::new(Cow::Owned(problem), frame, comm, options)?.modes(false)
}

/// Modes computed here, in the way that these options say; their number is what is asked for.
#[derive(Clone, Debug, Default)]
pub struct Modal(pub ModalOptions);

impl Modal {
    fn options(&self, count: usize) -> ModalOptions {
        ModalOptions { count, ..self.0.clone() }
    }
}

impl ModalSource for Modal {
    fn of_mesh(&self, mesh: &Mesh, elastic: bool, count: usize, comm: &Comm) -> Result<Modes> {
        match mesh.elastic.as_ref().filter(|_| elastic) {
            Some(modes) => comm.agree(of_body(mesh, modes, count)),
            None => laplacian_modes(mesh, comm, &self.options(count)),
        }
    }

    fn of_body(&self, body: &Body, count: usize) -> Result<Modes> {
        fem::body_modes(body, &self.options(count))
    }
}

fn of_body(mesh: &Mesh, modes: &ElasticModes, count: usize) -> Result<Modes> {
    let there = modes.eigenvalues.len();
    if count > there {
        return Err(Error::Input(format!(
            "{count} elastic modes: the mesh has {there} with it; ask for fewer, or record more (modes of m4gnRecorder)"
        )));
    }
    let n = select::first(&modes.eigenvalues, count);
    let components = |i: usize| mesh.directions.iter().map(move |&d| (i, d));
    let taken: Vec<(usize, usize)> = (0..n).flat_map(components).collect();
    Ok(Modes {
        eigenvalues: taken.iter().map(|&(i, _)| modes.eigenvalues[i]).collect(),
        vectors: taken.iter().map(|&(i, d)| modes.vectors[i].iter().map(|u| u[d]).collect()).collect(),
    })
}

/// The first modes of a pair of matrices. Collective; all ranks fail together.
///
/// K and M are symmetric and positive semi-definite, and no vector makes both 0; M may be singular, its null space has no finite
/// eigenvalues.
///
/// # Errors
/// [`m4gn_base::Error::Input`] for matrices that are no CSR of this layout, values that are not finite, modes not fewer than the
/// unknowns, or wrong options; [`m4gn_base::Error::Numerical`] if the solver fails or there are fewer finite eigenvalues.
pub fn solve(problem: &Problem, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    problem.check(comm)?;
    Solution::new(Cow::Borrowed(problem), Frame::of(problem, comm), comm, options)?.modes(false)
}

/// The same modes as [`laplacian_modes`] by a dense eigen-decomposition, which it serves to test.
///
/// # Errors
/// As [`laplacian_modes`].
pub fn laplacian_reference(mesh: &Mesh, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    let (problem, frame) = assemble::laplacian(mesh, comm)?;
    Solution::new(Cow::Owned(problem), frame, comm, options)?.modes(true)
}

/// One run.
struct Solution<'a> {
    problem: Cow<'a, Problem>,
    frame: Frame<'a>,
    comm: &'a Comm,
    options: &'a ModalOptions,
    /// Unknowns of all ranks.
    total: usize,
}

impl<'a> Solution<'a> {
    fn new(
        problem: Cow<'a, Problem>,
        frame: Frame<'a>,
        comm: &'a Comm,
        options: &'a ModalOptions,
    ) -> Result<Self> {
        let total = comm.total(problem.stiffness.n()) as usize;
        let solution = Solution { problem, frame, comm, options, total };
        options.same_on_all_ranks(comm)?;
        comm.agree(select::check(options.count, solution.total))?;
        Ok(solution)
    }

    fn modes(mut self, plain: bool) -> Result<Modes> {
        let comm = self.comm;
        let wanted = self.options.count;
        if wanted == 0 {
            return Ok(Modes { eigenvalues: Vec::new(), vectors: Vec::new() });
        }
        let [size, smallest] = comm.agree(self.problem.eigenvalue_sizes(comm))?;
        // Eigenvalues that are 0 come out smaller than this.
        let zero = self.problem.shift.map_or(1e-13 * size, |s| (1e-4 * s.abs()).max(1e-14 * size));
        let mut pairs = if plain || self.total <= DENSE {
            let shift = self.problem.shift.unwrap_or(-1e-4 * size);
            dense::eigenpairs(&self.problem, shift, comm)?
        } else {
            let taken = |values: &[f64]| {
                (values.len() >= wanted).then(|| select::whole_clusters(values, wanted, zero)).flatten()
            };
            let request = Request {
                block: self.problem.block,
                shift: self.problem.shift.unwrap_or(-1e-10 * size),
                wanted,
                taken: &taken,
                options: self.options,
            };
            eigen::eigenpairs(comm, &mut self.problem, &request)?
        };
        let count = comm.agree(select::count(&pairs, wanted, zero))?;
        pairs.truncate(count);
        pairs.sort_by(|a, b| a.value.total_cmp(&b.value));
        if size > problem::SPAN * smallest && pairs.iter().any(|p| p.value.abs() <= zero) {
            return Err(Error::Numerical(format!(
                "K_ii / M_ii goes from {smallest:.1e} to {size:.1e}: the first modes drown in the rounding of the largest, and \
                 cannot be told from modes of eigenvalue 0; hold unknowns by leaving their rows out, or by a penalty on \
                 the diagonal alone, and take a smaller one where unknowns are tied together"
            )));
        }
        let scale = self.problem.scale(self.total, comm, &mut pairs);
        for cluster in select::clusters(&pairs, zero) {
            canonical::choose_basis(&self.frame, self.problem.block, scale, comm, &mut pairs[cluster]);
        }
        let finite = |p: &Pair| p.value.is_finite() && p.vector.iter().all(|x| x.is_finite());
        comm.agree(refuse(!pairs.iter().all(finite), Error::Numerical, || {
            "a mode is not finite: the entries of K and M leave the range of double on the way; give them in other units"
        }))?;
        let (eigenvalues, vectors) = pairs.into_iter().map(|p| (p.value, p.vector)).unzip();
        Ok(Modes { eigenvalues, vectors })
    }
}

/// What is asked of the solver.
pub(crate) struct Request<'a> {
    /// Unknowns a point.
    pub block: usize,
    /// Below the eigenvalues wanted: K - shift M is positive definite.
    pub shift: f64,
    /// Pairs wanted at first.
    pub wanted: usize,
    /// How many of these eigenvalues, nearest to the shift first, are taken; none: more have to be seen.
    pub taken: &'a dyn Fn(&[f64]) -> Option<usize>,
    /// The way to them.
    pub options: &'a ModalOptions,
}

#[cfg(test)]
mod tests;
