//! What a step takes: time and operations by phase.

use super::super::kernels::Number;
use super::super::profile::{Phase, Profile};
use super::Network;
use m4gn_model::Model;
use m4gn_parallel::Element;

impl<T: Number + Element> Network<T> {
    /// See [`Engine::profile`](crate::Engine::profile).
    pub fn profile(&self) -> Option<Profile> {
        let mut profile = self.profile.clone()?;
        for scratch in &self.grid.scratch {
            for (sum, seconds) in profile.phases.iter_mut().zip(scratch.clock.phases) {
                *sum += seconds;
            }
        }
        Some(profile)
    }

    /// Operations of the products of a step, by phase.
    pub(super) fn flops(&self, model: &Model) -> [f64; 8] {
        let a = &model.spec.architecture;
        let (d, h) = (a.width as f64, a.hidden_layers as f64);
        let square = 2.0 * d * d;
        let (n, cells) = (self.grid.n_owned as f64, self.cells.len() as f64);
        let mut list = self.processor.flops(&self.grid, model);
        list.extend([
            (Phase::EncodeNodes, n * (2.0 * d * self.n_inputs as f64 + h * square)),
            (Phase::Decode, cells * (h * square + 2.0 * d * self.n_outputs as f64)),
        ]);
        let mut flops = [0.0; 8];
        for (phase, value) in list {
            flops[phase as usize] += value;
        }
        flops
    }
}
