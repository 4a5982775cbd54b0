//! One step of a training, or its rollouts, shared out to the ranks: the same weights on all of them, and the same answer on
//! any number of them up to rounding.

use super::backend::{Backend, Batch, Learned, Rollout};
use super::normaliser::Normaliser;
use m4gn_base::Result;
use m4gn_parallel::Comm;

/// Loss and gradient of a whole batch, of which each rank computes its share; the same on all ranks. Collective; all ranks
/// fail together.
///
/// # Errors
/// What the backend may fail with.
pub fn learn_together(
    comm: &Comm,
    backend: &mut dyn Backend,
    weights: &[f32],
    normaliser: &Normaliser,
    batch: &Batch,
) -> Result<Learned> {
    let (rank, size) = (comm.rank() as usize, comm.size() as usize);
    // Whole pieces to a rank, so that the mean over a piece is the same on any number of ranks.
    let pieces = batch.examples.len().div_ceil(batch.micro);
    let bound = |rank: usize| (pieces * rank / size * batch.micro).min(batch.examples.len());
    let share = Batch { examples: &batch.examples[bound(rank)..bound(rank + 1)], ..*batch };
    let mut learned = comm.agree(backend.learn(weights, normaliser, &share))?;
    comm.sum_f64(&mut learned.losses);
    learned.moments.iter_mut().flat_map(Normaliser::numbers_mut).for_each(|n| comm.sum_f64(n));
    if let Some(gradient) = &mut learned.gradient {
        comm.sum_f32(gradient);
    }
    Ok(learned)
}

/// The errors of all rollouts of a plan ([`Backend::roll_out`]) of a model with so many predicted fields, which the ranks share; the same
/// on all ranks. Collective; all ranks fail together.
///
/// # Errors
/// What the backend may fail with.
pub fn roll_out_together(
    comm: &Comm,
    backend: &mut dyn Backend,
    weights: &[f32],
    normaliser: &Normaliser,
    plan: &[Rollout],
    fields: usize,
) -> Result<Vec<Vec<[f64; 2]>>> {
    let (rank, size) = (comm.rank() as usize, comm.size() as usize);
    let share: Vec<Rollout> = plan.iter().skip(rank).step_by(size).copied().collect();
    let mut own = comm.agree(backend.roll_out(weights, normaliser, &share))?.into_iter();
    // Each number is one rank's, and 0 on the others.
    let part = |(i, rollout): (usize, &Rollout)| match i % size == rank {
        true => own.next().unwrap_or_default(),
        false => vec![[0.0; 2]; rollout.steps * fields],
    };
    let mut all: Vec<Vec<[f64; 2]>> = plan.iter().enumerate().map(part).collect();
    all.iter_mut().for_each(|errors| comm.sum_f64(errors.as_flattened_mut()));
    Ok(all)
}
