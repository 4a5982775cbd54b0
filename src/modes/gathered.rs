//! Matrices gathered on the root, and eigenpairs handed out from there.

use super::pair::Pair;
use super::problem::{Mass, Problem, Rows};
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;

/// Entries of a symmetric matrix may differ from their mirror images by this, relative to the largest entry.
const ASYMMETRY: f64 = 1e-8;

/// (row, column, value); entries of one place add up.
pub(super) type Triplet = (usize, usize, f64);

/// K and M, whole.
pub(super) struct Gathered {
    pub k: Vec<Triplet>,
    pub m: Vec<Triplet>,
    /// Unknowns.
    pub n: usize,
}

impl Gathered {
    /// On the root, none elsewhere. Collective.
    pub fn of(problem: &Problem, comm: &Comm) -> Option<Self> {
        let n = comm.total(problem.stiffness.n()) as usize;
        let k = rows(&problem.stiffness, comm);
        let m = match &problem.mass {
            Mass::Matrix(m) => rows(m, comm),
            Mass::Diagonal(values) => comm.gather(values).map(|parts| {
                let values = parts.into_iter().flatten().enumerate();
                values.map(|(i, v)| (i, i, v)).collect()
            }),
        };
        Some(Gathered { k: k?, m: m?, n })
    }

    /// # Errors
    /// [`Error::Input`] for an entry that is not its mirror image.
    pub fn check_symmetry(&self) -> Result<()> {
        for (name, entries) in [("K", &self.k), ("M", &self.m)] {
            let largest = entries.iter().map(|e| e.2.abs()).fold(0.0, f64::max);
            let mirrored = |&(i, j, v): &Triplet| if i < j { (i, j, v) } else { (j, i, -v) };
            let mut sides: Vec<Triplet> = entries.iter().filter(|e| e.0 != e.1).map(mirrored).collect();
            sides.sort_by_key(|e| (e.0, e.1));
            for place in sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
                let off: f64 = place.iter().map(|e| e.2).sum();
                if off.abs() > ASYMMETRY * largest {
                    let (i, j, _) = place[0];
                    return Err(Error::Input(format!(
                        "{name} is not symmetric: entries ({i}, {j}) and ({j}, {i}) differ by {off:e}"
                    )));
                }
            }
        }
        Ok(())
    }
}

fn rows(rows: &Rows, comm: &Comm) -> Option<Vec<Triplet>> {
    let counts: Vec<i64> = rows.row.windows(2).map(|w| (w[1] - w[0]) as i64).collect();
    let (counts, columns, values) =
        (comm.gather(&counts), comm.gather(&rows.column), comm.gather(&rows.value));
    let mut entries = columns?.into_iter().flatten().zip(values?.into_iter().flatten());
    let mut all = Vec::new();
    for (i, count) in counts?.into_iter().flatten().enumerate() {
        all.extend(entries.by_ref().take(count as usize).map(|(j, v)| (i, j as usize, v)));
    }
    Some(all)
}

/// Every rank's part of the root's eigenpairs: value, vector, and M times it, one after the other. Collective.
pub(super) fn share(problem: &Problem, comm: &Comm, solved: Result<Vec<f64>>) -> Result<Vec<Pair>> {
    let mut flat = comm.agree(solved)?;
    comm.broadcast(&mut flat);
    let n = problem.stiffness.n();
    let first = comm.exclusive_scan_i64(n as i64) as usize;
    let total = comm.total(n) as usize;
    Ok(flat
        .chunks_exact(1 + 2 * total)
        .map(|pair| Pair {
            value: pair[0],
            vector: pair[1 + first..1 + first + n].to_vec(),
            weighted: pair[1 + total + first..1 + total + first + n].to_vec(),
        })
        .collect())
}
