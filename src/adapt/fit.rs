//! Rounds by regression: the decoder's last layer in closed form.

use super::learner::{Learned, Learner};
use super::round::Split;
use m4gn_learn::Example;
use m4gn_learn::NativeBackend;
use m4gn_learn::regression::{Layer, Regression};
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;

/// Examples that the sums of the oldest stretch are of, at most.
const EXAMPLES: usize = 64;

/// What a first round tries.
const RIDGES: [f64; 5] = [1e-5, 1e-4, 1e-3, 1e-2, 1e-1];

/// How often an example of a later stretch counts: these are few, and of the flow as it is now.
const FRESH: f64 = 8.0;

impl Learner {
    /// The regression on the frames that are not held back, with the ridge that is best on those that are; then, if that is
    /// better than the weights before, on all frames. Collective.
    pub(super) fn fit(
        &mut self,
        comm: &Comm,
        backend: &mut NativeBackend,
        split: &Split,
        before: f64,
    ) -> Result<Learned> {
        let layer = comm.agree(Layer::last(&self.spec, &self.layout))?;
        let [old, new] = &split.starts;
        let ([all_old, all_new], apart) = (&split.all, split.all[0].len().div_ceil(EXAMPLES).max(1));
        let (mut sums, ridges) = match &self.knowledge.fitted {
            Some((sums, ridge)) => (sums.clone(), vec![*ridge]),
            None => (self.sums(comm, backend, old, 0, apart)?, RIDGES.to_vec()),
        };
        let with = |sums: &Regression, later: &Regression| {
            let mut both = sums.clone();
            both.add(later, FRESH);
            both
        };
        let mut fresh = self.sums(comm, backend, new, 0, 1)?;
        let later = with(&sums, &fresh);
        let weights = self.knowledge.optimiser.weights.clone();
        let (mut best, mut steps) = ((f64::INFINITY, ridges[0]), 0);
        for ridge in ridges {
            steps += 1;
            if later.solve(&layer, ridge, &self.shipped, &mut self.knowledge.optimiser.weights)? {
                let score = self.score(comm, backend, split)?;
                if score < best.0 {
                    best = (score, ridge);
                }
            }
        }
        let (after, ridge) = best;
        if self.knowledge.fitted.is_none() {
            // Frames of the oldest stretch never come again: their sums are made once.
            let rest = self.sums(comm, backend, &all_old[old.len().min(all_old.len())..], 0, apart)?;
            sums.add(&rest, 1.0);
        }
        let used = after < before && {
            // Those that were not held back are the first of them.
            fresh.add(&self.sums(comm, backend, all_new, new.len(), 1)?, 1.0);
            steps += 1;
            with(&sums, &fresh).solve(&layer, ridge, &self.shipped, &mut self.knowledge.optimiser.weights)?
        };
        if !used {
            self.knowledge.optimiser.weights = weights;
        }
        self.knowledge.fitted = Some((sums, ridge));
        self.knowledge.steps += steps;
        Ok(Learned { steps, before, after: if used { after } else { before }, ended: "" })
    }

    /// The sums of every so many of the examples that begin at these frames, without the first ones of these.
    fn sums(
        &self,
        comm: &Comm,
        backend: &mut NativeBackend,
        starts: &[usize],
        without: usize,
        apart: usize,
    ) -> Result<Regression> {
        let t = &self.training;
        let starts = starts.iter().step_by(apart).enumerate().skip(without);
        let examples = starts.map(|(i, &frame)| Example {
            sample: 0,
            frame,
            mirror: t.mirror && i % 2 == 1,
            seed: t.seed.wrapping_add(frame as u64),
            weight: 1.0,
        });
        let examples: Vec<Example> = examples.collect();
        let (weights, unroll) = (&self.knowledge.optimiser.weights, self.settings.unroll);
        backend.regress(comm, weights, &self.normaliser, &examples, unroll)
    }
}
