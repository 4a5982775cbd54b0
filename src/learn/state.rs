//! States of a trajectory: its frames, reflected if asked for, and what they changed by where that is an input.

use super::samples::Sample;
use m4gn_mesh::Result;

impl Sample {
    /// The state of a frame that came about in a stride of so many frames, reflected in the second direction if asked for.
    ///
    /// A trajectory begins at rest: of a frame that is less than a stride from the first one the change over the stride before is
    /// that since the first one, and of the first one it is zero.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn state(&self, frame: usize, stride: usize, mirror: bool) -> Result<Vec<f32>> {
        let mut state = self.frame(frame)?.into_owned();
        if self.domain.has_history() {
            let before = self.frame(frame.saturating_sub(stride))?;
            for (i, before) in before.iter().enumerate() {
                state.push(state[i] - before);
            }
        }
        if mirror {
            let c = self.domain.components();
            for row in state.chunks_exact_mut(c.count) {
                let odd = row.iter_mut().zip(&c.odd);
                odd.filter(|(_, odd)| **odd).for_each(|(x, _)| *x = -*x);
            }
        }
        Ok(state)
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
