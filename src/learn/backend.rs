//! What computes: gradients of batches, and rollouts for validation.

use super::normaliser::Normaliser;
use m4gn_base::Result;
use m4gn_domain::Components;
use m4gn_model::ModelSpec;

/// One training example: a trajectory, a frame to start from, and its random numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Example {
    /// Index of the training trajectory.
    pub sample: usize,
    /// First frame.
    pub frame: usize,
    /// Reflected in the second direction.
    pub mirror: bool,
    /// Seed of the noise.
    pub seed: u64,
    /// What its errors are multiplied with in the loss.
    pub weight: f64,
}

/// A part of a step's batch.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Its examples. In pieces of [`Batch::micro`] their errors are averaged over all cells together.
    pub examples: &'a [Example],
    /// Examples of a piece.
    pub micro: usize,
    /// Examples of the whole batch, of which this may be one rank's share.
    pub total: usize,
    /// Model steps in the loss.
    pub unroll: usize,
    /// Whether to return what the normalisers need.
    pub accumulate: bool,
    /// Whether to compute the loss and its gradient.
    pub learn: bool,
}

/// What came of a part of a batch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Learned {
    /// Its part of the gradient of the batch's mean loss; none if it was not to be computed.
    pub gradient: Option<Vec<f32>>,
    /// Its part of the mean squared normalised error of each predicted field, over the unrolled steps.
    pub losses: Vec<f64>,
    /// Moments of the examples.
    pub moments: Option<Normaliser>,
}

impl Learned {
    /// The sum of what came of the parts of a batch, for a model of so many weights.
    pub fn sum(spec: &ModelSpec, weights: usize, batch: &Batch, parts: Vec<Learned>) -> Self {
        let mut sum = Learned {
            gradient: batch.learn.then(|| vec![0.0; weights]),
            losses: vec![0.0; Components::new(spec).predicted().count()],
            moments: batch.accumulate.then(|| Normaliser::new(spec)),
        };
        for part in parts {
            if let (Some(sum), Some(gradient)) = (&mut sum.gradient, part.gradient) {
                sum.iter_mut().zip(gradient).for_each(|(sum, g)| *sum += g);
            }
            sum.losses.iter_mut().zip(part.losses).for_each(|(sum, l)| *sum += l);
            if let (Some(sum), Some(moments)) = (&mut sum.moments, part.moments) {
                sum.add(&moments);
            }
        }
        sum
    }
}

/// A rollout of a validation trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rollout {
    /// Index of the trajectory.
    pub sample: usize,
    /// First frame.
    pub frame: usize,
    /// Model steps.
    pub steps: usize,
    /// Whether each of them starts from the recorded frame before it.
    pub single: bool,
}

/// The native engine, or libtorch. What it computes does not depend on its threads.
pub trait Backend {
    /// What it runs on, for people.
    fn name(&self) -> String;

    /// Loss and gradient of a part of a batch.
    ///
    /// # Errors
    /// What the backend may fail with.
    fn learn(&mut self, weights: &[f32], normaliser: &Normaliser, batch: &Batch) -> Result<Learned>;

    /// For each rollout, step after step, of each predicted field: the mean squared errors of the model and of holding the recorded frame that it
    /// started from, over the nodes that are not held.
    ///
    /// # Errors
    /// What the backend may fail with.
    fn roll_out(
        &mut self,
        weights: &[f32],
        normaliser: &Normaliser,
        plan: &[Rollout],
    ) -> Result<Vec<Vec<[f64; 2]>>>;
}
