//! What solvers return: an eigenvalue with this rank's part of its vector.

/// An eigenvalue, its vector, and M times it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pair {
    /// The eigenvalue.
    pub value: f64,
    /// This rank's part of the eigenvector.
    pub vector: Vec<f64>,
    /// This rank's part of M times `vector`.
    pub weighted: Vec<f64>,
}

impl Pair {
    /// Subtracts `along` times another one.
    pub fn remove(&mut self, along: f64, other: &Pair) {
        for (x, y) in self.vector.iter_mut().zip(&other.vector) {
            *x -= along * y;
        }
        for (x, y) in self.weighted.iter_mut().zip(&other.weighted) {
            *x -= along * y;
        }
    }

    /// Multiplies both vectors.
    pub fn scale(&mut self, by: f64) {
        self.vector.iter_mut().chain(&mut self.weighted).for_each(|x| *x *= by);
    }
}
