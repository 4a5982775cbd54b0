//! States of a trajectory: its frames, reflected if asked for.

use super::samples::Sample;
use m4gn_base::Result;

impl Sample {
    /// The state of a frame, reflected in the second direction if asked for.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn state(&self, frame: usize, mirror: bool) -> Result<Vec<f32>> {
        let mut state = self.frame(frame)?.into_owned();
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
