//! One step of a training, or its rollouts, shared out to the ranks: the same weights on all of them, and the same answer on
//! any number of them up to rounding.

use super::backend::{Backend, Batch, Learned, Rollout};
use super::normaliser::Normaliser;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;

/// Loss and gradient of a whole batch, of which each rank computes its share; the same on all ranks. Collective; all ranks
/// fail together.
///
/// # Errors
/// What the backend may fail with.
pub(super) fn learn_together(
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
    let share = Batch {
        examples: &batch.examples[bound(rank)..bound(rank + 1)],
        ..*batch
    };
    let mut learned = comm.agree(backend.learn(weights, normaliser, &share))?;
    comm.sum_f64(&mut learned.losses);
    if let Some(moments) = &mut learned.moments {
        let mut flat = moments.flat();
        comm.sum_f64(&mut flat);
        moments.set_flat(&flat);
    }
    if let Some(gradient) = &mut learned.gradient {
        comm.sum_f32(gradient);
    }
    Ok(learned)
}

/// The errors of all rollouts of a plan ([`Backend::roll_out`]), which the ranks share; the same on all ranks. Collective; all
/// ranks fail together.
///
/// # Errors
/// What the backend may fail with.
pub(super) fn roll_out_together(
    comm: &Comm,
    backend: &mut dyn Backend,
    weights: &[f32],
    normaliser: &Normaliser,
    plan: &[Rollout],
) -> Result<Vec<Vec<(f64, f64)>>> {
    let (rank, size) = (comm.rank() as usize, comm.size() as usize);
    let own: Vec<Rollout> = plan.iter().skip(rank).step_by(size).copied().collect();
    let mut outcomes = comm
        .agree(backend.roll_out(weights, normaliser, &own))?
        .into_iter();
    // Each number is one rank's, and 0 on the others.
    let mut flat = Vec::new();
    for (i, rollout) in plan.iter().enumerate() {
        let errors = match i % size == rank {
            true => outcomes.next().unwrap_or_default(),
            false => vec![(0.0, 0.0); rollout.steps],
        };
        flat.extend(errors.into_iter().flat_map(|(model, held)| [model, held]));
    }
    comm.sum_f64(&mut flat);
    let mut rows = flat.chunks_exact(2).map(|pair| (pair[0], pair[1]));
    let steps = plan.iter().map(|rollout| rollout.steps);
    Ok(steps.map(|n| rows.by_ref().take(n).collect()).collect())
}
