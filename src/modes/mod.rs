//! Modes of a mesh (Algorithm 1): K phi = lambda M phi.
//!
//! Fluid: K is the solver's own finite-volume Laplacian (off-diagonal -c of each face, every boundary face a
//! Dirichlet one, eq. 6), M the cell volumes; eigenvalues are in 1/m^2. Solid: stiffness and mass (eq. 5), with
//! several unknowns a point; eigenvalues are in 1/s^2. Any solver can hand in its own pair as a [`Problem`].
//!
//! Two traps are closed here: the sign of an eigenvector, and the basis of a repeated eigenvalue's space, are chosen
//! by a rule that looks at positions alone (`canonical.rs`), so that they depend neither on the ranks nor on the
//! solver's start vector.

mod assemble;
mod canonical;
mod dense;
mod frame;
mod gathered;
mod options;
mod pair;
mod problem;
mod select;
#[cfg(not(feature = "slepc"))]
mod serial;
#[cfg(any(test, not(feature = "slepc")))]
mod sparse;

pub use frame::Extent;
pub use options::{ModalOptions, ModalSolver, ModeCount};
pub(crate) use pair::Pair;
pub use problem::{Mass, Problem, Rows};

use crate::graph::Graph;
use crate::mesh::{ElasticModes, Mesh};
use crate::parallel::Comm;
use crate::{Error, Result};
use frame::Frame;
use std::borrow::Cow;

#[cfg(feature = "slepc")]
use crate::ffi::petsc as large;
#[cfg(not(feature = "slepc"))]
use serial as large;

/// Problems of at most this many unknowns are solved densely: Krylov spaces are no smaller there.
const DENSE: usize = 100;

/// Whether the graph of K is that of a plane mesh: rows of at most six entries an unknown of a point (four of
/// triangles, five of quads; hexahedra have seven). `unknowns` and `entries` of all ranks.
#[cfg(feature = "slepc")]
pub(crate) fn is_plane(unknowns: i64, entries: i64, block: usize) -> bool {
    entries <= 6 * unknowns * block as i64
}

/// Whether [`ModalSolver::Auto`] does without a factorisation: above 4 million unknowns of a plane mesh, 400,000 else.
///
/// The factor of a mesh grows like n log n in two dimensions and like n^(4/3) in three, its work like n^(3/2) and n^2;
/// at these sizes the factor takes some 3 GB, over all ranks.
#[cfg(feature = "slepc")]
pub(crate) fn prefers_iterative(unknowns: i64, entries: i64, block: usize) -> bool {
    let limit = if is_plane(unknowns, entries, block) {
        4_000_000
    } else {
        400_000
    };
    unknowns > limit
}

/// Modes, by ascending eigenvalue.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Eigenvalues; of the Laplacian in 1/m^2.
    pub eigenvalues: Vec<f64>,
    /// For each mode its value for each of this rank's unknowns. Scaled to phi^T M phi = (sum of the entries of M) /
    /// block: the root mean square over the mesh, weighted by M, is 1 whatever the mesh's size; for the Laplacian
    /// sum over all ranks of V phi^2 = sum of V.
    pub vectors: Vec<Vec<f64>>,
}

/// The pair of matrices of the Laplacian modes, eq. 6. Collective; all ranks fail together.
///
/// # Errors
/// [`crate::Error::Mesh`] for coupled faces whose other side is not found.
pub fn laplacian(mesh: &Mesh, graph: &mut Graph, comm: &Comm) -> Result<Problem> {
    let (mut problem, _) = assemble::laplacian(mesh, graph, comm)?;
    problem.positions.clone_from(&mesh.cell_centres);
    Ok(problem)
}

/// The first Laplacian modes. Collective; all ranks fail together.
///
/// If the last eigenvalue is repeated, its whole cluster is returned: there may be more modes than asked for, never
/// fewer. Without Dirichlet boundaries (all cyclic) the first mode is the constant one with eigenvalue 0.
///
/// # Errors
/// [`crate::Error::Input`] if the number of modes is not below the number of cells or an option is wrong,
/// [`crate::Error::Numerical`] if the solver fails.
pub fn laplacian_modes(mesh: &Mesh, graph: &mut Graph, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    let (problem, frame) = assemble::laplacian(mesh, graph, comm)?;
    Solution::new(Cow::Owned(problem), frame, comm, options)?.modes(false)
}

/// The modes that segments of a mesh are made of: those of the elastic body that it has with it, or of its Laplacian.
/// Collective; all ranks fail together.
///
/// Of elastic modes each solved component of the displacement is a vector of its own, with the mode's eigenvalue: a
/// distance over all of them depends neither on signs nor on bases of repeated eigenvalues, which come whole.
///
/// # Errors
/// As [`laplacian_modes`]; [`Error::Input`] if the mesh has fewer elastic modes than asked for.
pub fn of_mesh(
    mesh: &Mesh,
    graph: &mut Graph,
    comm: &Comm,
    elastic: bool,
    options: &ModalOptions,
) -> Result<Modes> {
    match mesh.elastic.as_ref().filter(|_| elastic) {
        Some(modes) => comm.agree(of_body(mesh, modes, options.count)),
        None => laplacian_modes(mesh, graph, comm, options),
    }
}

fn of_body(mesh: &Mesh, modes: &ElasticModes, count: ModeCount) -> Result<Modes> {
    let there = modes.eigenvalues.len();
    let wanted = select::candidates(count, usize::MAX);
    if wanted > there {
        return Err(Error::Input(format!(
            "{wanted} elastic modes: the mesh has {there} with it; ask for fewer, or record more (modes of m4gnHarvest)"
        )));
    }
    let n = select::first(&modes.eigenvalues, count);
    let components = |i: usize| mesh.directions.iter().map(move |&d| (i, d));
    let taken: Vec<(usize, usize)> = (0..n).flat_map(components).collect();
    Ok(Modes {
        eigenvalues: taken.iter().map(|&(i, _)| modes.eigenvalues[i]).collect(),
        vectors: taken
            .iter()
            .map(|&(i, d)| modes.vectors[i].iter().map(|u| u[d]).collect())
            .collect(),
    })
}

/// The first modes of a pair of matrices. Collective; all ranks fail together.
///
/// Symmetric pairs have K and M positive semi-definite, and no vector that both make 0; M may be singular, its null
/// space has no finite eigenvalues. Of non-symmetric pairs the eigenvalues nearest to the shift are taken, which lies
/// just below 0 if none is given; they are sorted by real part. A complex pair a +- ib counts as one repeated
/// eigenvalue a with the real and the imaginary part of its vector; with |b| > |a| / 10 it is an error, as it is no
/// vibration any more.
///
/// # Errors
/// [`crate::Error::Input`] for matrices that are no CSR of this layout, values that are not finite, modes not fewer than the
/// unknowns, or wrong options; [`crate::Error::Numerical`] if the solver fails or there are fewer finite eigenvalues.
pub fn solve(problem: &Problem, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    problem.check(comm)?;
    Solution::new(Cow::Borrowed(problem), Frame::of(problem, comm), comm, options)?.modes(false)
}

/// The same modes as [`solve`] by a dense eigen-decomposition, which it serves to test.
///
/// # Errors
/// As [`solve`].
pub fn reference(problem: &Problem, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    problem.check(comm)?;
    Solution::new(Cow::Borrowed(problem), Frame::of(problem, comm), comm, options)?.modes(true)
}

/// The same modes as [`laplacian_modes`] by a dense eigen-decomposition, which it serves to test.
///
/// # Errors
/// As [`laplacian_modes`].
pub fn laplacian_reference(mesh: &Mesh, comm: &Comm, options: &ModalOptions) -> Result<Modes> {
    let mut graph = Graph::new(mesh, comm)?;
    let (problem, frame) = assemble::laplacian(mesh, &mut graph, comm)?;
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
        let mut total = [problem.stiffness.n() as i64];
        comm.sum_i64(&mut total);
        let solution = Solution {
            problem,
            frame,
            comm,
            options,
            total: total[0] as usize,
        };
        options.same_on_all_ranks(comm)?;
        comm.agree(select::check(options.count, solution.total))?;
        Ok(solution)
    }

    fn modes(mut self, plain: bool) -> Result<Modes> {
        let comm = self.comm;
        let wanted = select::candidates(self.options.count, self.total);
        if wanted == 0 {
            return Ok(Modes {
                eigenvalues: Vec::new(),
                vectors: Vec::new(),
            });
        }
        let size = comm.agree(self.problem.eigenvalue_size(comm))?;
        // Eigenvalues that are 0 come out smaller than this.
        let zero = self
            .problem
            .shift
            .map_or(1e-13 * size, |s| (1e-4 * s.abs()).max(1e-14 * size));
        let mut pairs = if plain || self.total <= DENSE {
            let shift = self.problem.shift.unwrap_or(-1e-4 * size);
            dense::eigenpairs(&self.problem, shift, comm)?
        } else {
            let taken = |values: &[f64]| {
                (values.len() >= wanted)
                    .then(|| select::whole_clusters(values, wanted, zero))
                    .flatten()
            };
            let matrices = large::Matrices::new(comm, &self.problem)?;
            if let Cow::Owned(problem) = &mut self.problem {
                // A factor needs the room.
                problem.stiffness = Rows::default();
            }
            let request = Request {
                symmetric: self.problem.symmetric,
                block: self.problem.block,
                shift: self.problem.shift.unwrap_or(-1e-10 * size),
                wanted,
                taken: &taken,
                options: self.options,
            };
            large::eigenpairs(comm, &matrices, &request)?
        };
        let count = comm.agree(select::count(&pairs, self.options.count, zero, self.total))?;
        pairs.truncate(count);
        pairs.sort_by(|a, b| a.value.total_cmp(&b.value));
        let scale = self.problem.scale(self.total, comm, &mut pairs);
        for cluster in select::clusters(&pairs, zero) {
            canonical::choose_basis(&self.frame, self.problem.block, scale, comm, &mut pairs[cluster]);
        }
        let (eigenvalues, vectors) = pairs.into_iter().map(|p| (p.value, p.vector)).unzip();
        Ok(Modes { eigenvalues, vectors })
    }
}

/// What is asked of the solver.
pub(crate) struct Request<'a> {
    /// Whether both matrices are symmetric.
    pub symmetric: bool,
    /// Unknowns a point.
    pub block: usize,
    /// Below the eigenvalues wanted: K - shift M is positive definite where both are symmetric.
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
