//! A pair of matrices as distributed rows.

use super::pair::Pair;
use m4gn_base::{Error, Result, refuse};
use m4gn_parallel::{Comm, same_on_all_ranks};

/// Sizes of entries and eigenvalues that the solvers' products of two still hold.
const MAGNITUDES: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// A K_ii / M_ii so many times larger than all that K couples is a penalty.
const PENALTY: f64 = 1e6;

/// Sizes of eigenvalues farther apart than this leave those of the smaller size in the rounding of the larger.
pub(super) const SPAN: f64 = 1e9;

/// This rank's rows of a distributed square matrix (CSR). Rows are numbered rank after rank.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// Row i holds entries `row[i]..row[i + 1]`; one more than the rows of this rank.
    pub row: Vec<usize>,
    /// Column of each entry in the numbering of all ranks, in any order; entries of one place add up.
    pub column: Vec<i64>,
    /// Value of each entry.
    pub value: Vec<f64>,
}

impl Rows {
    /// Rows of this rank.
    pub fn n(&self) -> usize {
        self.row.len().saturating_sub(1)
    }
}

/// The right-hand matrix of K phi = lambda M phi.
#[derive(Clone, Debug, PartialEq)]
pub enum Mass {
    /// A diagonal matrix: cell volumes.
    Diagonal(Vec<f64>),
    /// A consistent mass matrix, distributed as the stiffness.
    Matrix(Rows),
}

impl Mass {
    /// All entries of this rank.
    pub(super) fn values(&self) -> &[f64] {
        match self {
            Mass::Diagonal(values) => values,
            Mass::Matrix(rows) => &rows.value,
        }
    }
}

/// K phi = lambda M phi on this rank; both are symmetric.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// K.
    pub stiffness: Rows,
    /// M.
    pub mass: Mass,
    /// Unknowns a point, 1 or more: rows `block * p` to `block * p + block - 1` belong to point p of this rank.
    pub block: usize,
    /// Position of each point of this rank, m. Signs, and bases of repeated eigenvalues, are chosen by them and so
    /// depend on no numbering. Empty on all ranks: chosen by row numbers.
    pub positions: Vec<[f64; 3]>,
    /// A number a little below the eigenvalues wanted; none: estimated from the entries.
    pub shift: Option<f64>,
}

impl Problem {
    /// Whether the arrays are what the types say, and the pair is of one kind on all ranks. Collective; all ranks fail
    /// together.
    ///
    /// # Errors
    /// [`Error::Input`] naming the array, where it is wrong, and what was expected.
    pub(super) fn check(&self, comm: &Comm) -> Result<()> {
        let diagonal = matches!(self.mass, Mass::Diagonal(_));
        let kind = [
            ("whether the mass is diagonal", i64::from(diagonal)),
            ("unknowns a point", self.block as i64),
            ("shift", self.shift.map_or(0, |s| 1 + (s.to_bits() >> 2) as i64)),
        ];
        same_on_all_ranks(comm, &kind)?;
        comm.agree(self.check_here(comm))
    }

    /// As `check`, of this rank. Collective: counts the unknowns of all ranks first.
    fn check_here(&self, comm: &Comm) -> Result<()> {
        let n = self.stiffness.n();
        let mut total = [n as i64, self.positions.len() as i64];
        comm.sum_i64(&mut total);
        self.stiffness.check("K", n, total[0])?;
        match &self.mass {
            Mass::Matrix(rows) => rows.check("M", n, total[0])?,
            Mass::Diagonal(values) => {
                refuse(values.len() != n, Error::Input, || {
                    format!("M has {} diagonal entries, K {n} rows: expected as many", values.len())
                })?;
                finite("M", values)?;
            }
        }
        refuse(self.block == 0 || !n.is_multiple_of(self.block), Error::Input, || {
            format!("{n} rows with {} unknowns a point: expected whole points on every rank", self.block)
        })?;
        if total[1] > 0 && self.positions.len() * self.block != n {
            return Err(Error::Input(format!(
                "{} positions for {n} rows of {} unknowns a point: expected one a point, or none on all ranks",
                self.positions.len(),
                self.block
            )));
        }
        if let Some(p) = self.positions.iter().flatten().find(|x| !x.is_finite()) {
            return Err(Error::Input(format!("a position of a point is {p}: expected finite numbers")));
        }
        match self.shift {
            Some(s) if !s.is_finite() => {
                Err(Error::Input(format!("shift: expected a finite number, found {s}")))
            }
            _ => Ok(()),
        }
    }

    /// Makes a mass matrix that is diagonal on all ranks a [`Mass::Diagonal`], which costs less. Collective.
    pub fn simplify(&mut self, comm: &Comm) {
        let first = comm.exclusive_scan_i64(self.stiffness.n() as i64);
        let diagonal = match &self.mass {
            Mass::Diagonal(_) => true,
            Mass::Matrix(m) => {
                let own = |(i, c): (usize, &i64)| *c == first + i as i64;
                m.row.iter().enumerate().all(|(i, r)| i == *r) && m.column.iter().enumerate().all(own)
            }
        };
        if let (false, Mass::Matrix(m)) = (comm.any(!diagonal), &mut self.mass) {
            self.mass = Mass::Diagonal(std::mem::take(&mut m.value));
        }
    }

    /// Size of the largest eigenvalues: the largest K_ii / M_ii where M has a diagonal, leaving out penalties, and the
    /// smallest. Collective.
    ///
    /// A penalty is a K_ii beside which the rest of its row, and that of all others, is nothing: it holds its unknown, and
    /// its size says nothing of the modes.
    ///
    /// # Errors
    /// [`Error::Numerical`] where the diagonals show that the pair is not positive semi-definite, or has a vector
    /// that both make 0; [`Error::Input`] if M has no diagonal entry above 0, or for magnitudes whose squares are no
    /// doubles any more: the solvers then return wrong eigenvalues, infinite ones among them.
    pub(super) fn eigenvalue_sizes(&self, comm: &Comm) -> Result<[f64; 2]> {
        let (k, beside) = self.stiffness.diagonal(comm);
        let (m, coupled) = match &self.mass {
            Mass::Diagonal(values) => (values.clone(), Vec::new()),
            Mass::Matrix(rows) => rows.diagonal(comm),
        };
        let mut largest = [m.iter().copied().fold(0.0, f64::max)];
        comm.max_f64(&mut largest);
        if largest[0] <= 0.0 {
            return Err(Error::Input(
                "the mass matrix M has no diagonal entry above 0: expected masses or volumes".into(),
            ));
        }
        comm.agree(self.check_diagonals(&k, &m, &coupled))?;
        let weighty: Vec<usize> = (0..m.len()).filter(|&i| m[i] > 1e-12 * largest[0]).collect();
        let ratios = || weighty.iter().map(|&i| (k[i] / m[i]).abs());
        let coupled = weighty.iter().map(|&i| beside[i] / m[i]).fold(0.0, f64::max);
        let smallest = ratios().filter(|r| *r > 0.0).fold(f64::INFINITY, f64::min);
        let mut sizes = [ratios().fold(0.0, f64::max), coupled, -smallest];
        comm.max_f64(&mut sizes);
        let [all, coupled, smallest] = [sizes[0], sizes[1], -sizes[2]];
        let plain = PENALTY * coupled.max(if smallest.is_finite() { smallest } else { 0.0 });
        let mut size = [ratios().filter(|r| *r <= plain).fold(0.0, f64::max)];
        comm.max_f64(&mut size);
        let most = |values: &[f64]| values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let mut sizes = [most(&self.stiffness.value), most(self.mass.values())];
        comm.max_f64(&mut sizes);
        let named = [
            ("the largest entry of K", sizes[0]),
            ("the largest entry of M", sizes[1]),
            ("the largest K_ii / M_ii", all),
        ];
        for (name, value) in named {
            if value != 0.0 && !MAGNITUDES.contains(&value) {
                return Err(Error::Input(format!(
                    "{name} is {value:e}: expected a magnitude between {:e} and {:e}; give K and M in other units",
                    MAGNITUDES.start(),
                    MAGNITUDES.end()
                )));
            }
        }
        // K = 0 has the eigenvalue 0 only; any size will do.
        Ok(if size[0] > 0.0 { [size[0], smallest] } else { [1.0; 2] })
    }

    /// What the diagonals of this rank say of the pair: those of a positive semi-definite matrix are not
    /// negative, and where one is 0 so is its row. `coupled`: magnitudes beside M's diagonal, if any.
    fn check_diagonals(&self, k: &[f64], m: &[f64], coupled: &[f64]) -> Result<()> {
        if let Some(i) = (0..coupled.len()).find(|&i| m[i] == 0.0 && coupled[i] > 0.0) {
            let why = format!("its diagonal entry {i} on this rank is 0, and others of its row are not");
            return Err(crate::negative_mass(&why));
        }
        match (0..m.len()).find(|&i| m[i] < 0.0 || (m[i] == 0.0 && k[i] == 0.0)) {
            None => Ok(()),
            Some(i) if m[i] < 0.0 => {
                Err(crate::negative_mass(&format!("its diagonal entry {i} on this rank is {:e}", m[i])))
            }
            Some(i) => Err(Error::Numerical(format!(
                "K and M make one vector 0: their diagonal entries {i} on this rank are both 0; is there a row of zeros in \
                 both?"
            ))),
        }
    }

    /// phi^T M phi of the modes' scale: the sum of the entries of M over the unknowns of a point. Where that, or
    /// phi^T M phi of a pair, is not positive, M makes no scale: it is
    /// then replaced by 1 in the pairs. `total` unknowns of all ranks. Collective.
    pub(super) fn scale(&self, total: usize, comm: &Comm, pairs: &mut [Pair]) -> f64 {
        let mut sums = vec![self.mass.values().iter().sum::<f64>()];
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for p in pairs.iter() {
            sums.extend([
                dot(&p.vector, &p.weighted),
                dot(&p.vector, &p.vector),
                dot(&p.weighted, &p.weighted),
            ]);
        }
        comm.sum_f64(&mut sums);
        let positive = |s: &[f64]| s[0] > 1e-12 * (s[1] * s[2]).sqrt();
        if sums[0] > 0.0 && sums[1..].chunks_exact(3).all(positive) {
            return sums[0] / self.block as f64;
        }
        pairs.iter_mut().for_each(|p| p.weighted.clone_from(&p.vector));
        total as f64 / self.block as f64
    }
}

impl Rows {
    fn check(&self, name: &str, n: usize, total: i64) -> Result<()> {
        let (rows, columns, values) = (&self.row, &self.column, &self.value);
        refuse(rows.len() != n + 1 || n + 1 == 0, Error::Input, || {
            format!("{name}: {} row offsets for {n} rows: expected one more than rows", rows.len())
        })?;
        if rows[0] != 0 || rows[n] != columns.len() || columns.len() != values.len() {
            return Err(Error::Input(format!(
                "{name}: row offsets from {} to {}, {} columns, {} values: expected offsets from 0 to the number of \
                 entries, and as many columns as values",
                rows[0],
                rows[n],
                columns.len(),
                values.len()
            )));
        }
        if let Some(i) = rows.windows(2).position(|w| w[0] > w[1]) {
            return Err(Error::Input(format!(
                "{name}: the offset of row {i} of this rank is {}, the next {}: expected them not to fall",
                rows[i],
                rows[i + 1]
            )));
        }
        if let Some(c) = columns.iter().find(|c| !(0..total).contains(c)) {
            return Err(Error::Input(format!("{name}: column {c}: expected 0 to {}", total - 1)));
        }
        finite(name, values)
    }

    /// The diagonal entries of this rank's rows, and the sum of the magnitudes of the others of each. Collective.
    fn diagonal(&self, comm: &Comm) -> (Vec<f64>, Vec<f64>) {
        let first = comm.exclusive_scan_i64(self.n() as i64);
        let (mut diagonal, mut beside) = (vec![0.0; self.n()], vec![0.0; self.n()]);
        for (i, w) in self.row.windows(2).enumerate() {
            for (c, v) in self.column[w[0]..w[1]].iter().zip(&self.value[w[0]..w[1]]) {
                match *c == first + i as i64 {
                    true => diagonal[i] += v,
                    false => beside[i] += v.abs(),
                }
            }
        }
        (diagonal, beside)
    }
}

fn finite(name: &str, values: &[f64]) -> Result<()> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(i) => Err(Error::Input(format!(
            "entry {i} of {name} on this rank is {}: expected finite numbers; look for cells of zero volume or \
             properties that were not read",
            values[i]
        ))),
    }
}
