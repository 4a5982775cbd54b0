//! What hangs together, told pair by pair.

/// Numbers in pieces: each knows one of its piece, the first itself.
#[derive(Clone, Debug)]
pub struct Joined(Vec<usize>);

impl Joined {
    /// `n` numbers, each a piece of its own.
    pub fn new(n: usize) -> Self {
        Joined((0..n).collect())
    }

    /// The first number of a piece.
    pub fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Makes one piece of two.
    pub fn join(&mut self, i: usize, j: usize) {
        let (a, b) = (self.root(i), self.root(j));
        self.0[a.max(b)] = a.min(b);
    }
}
