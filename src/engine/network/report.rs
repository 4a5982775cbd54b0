//! What a network takes: time by phase, memory by array.

use super::super::kernels::Number;
use super::super::profile::{Phase, Profile};
use super::Network;
use crate::model::Model;
use crate::parallel::Element;

impl<T: Number + Element> Network<T> {
    /// See [`Engine::profile`](crate::engine::Engine::profile).
    pub fn profile(&self) -> Option<Profile> {
        let mut profile = self.profile.clone()?;
        for scratch in &self.scratch {
            for (sum, seconds) in profile.phases.iter_mut().zip(scratch.clock.phases) {
                *sum += seconds;
            }
        }
        Some(profile)
    }

    /// See [`Engine::memory`](crate::engine::Engine::memory).
    pub fn memory(&self) -> Vec<(&'static str, usize)> {
        let (stage_weights, stage) = self.stage.as_ref().map_or((0, 0), |s| s.bytes());
        let layers: usize = self.layers.iter().map(|l| l.bytes()).sum();
        let ends = self.encoder.bytes() + self.edge_encoder.bytes() + self.decoder.bytes();
        let dispatch = self.dispatch.as_ref().map_or(0, |w| w.bytes());
        let order = &self.order;
        let lists = order.node.len() + order.row.len() + order.senders.len() + order.receivers.len();
        let scratch: usize = self.scratch.iter().map(|s| s.bytes()).sum();
        vec![
            ("edge latents", self.edges.bytes()),
            ("encoded edges", self.encoded.as_ref().map_or(0, |e| e.bytes())),
            ("edge features", 4 * self.features.capacity()),
            ("node latents", self.nodes.bytes()),
            ("projected senders", self.projected.bytes()),
            (
                "graph",
                4 * lists + 8 * self.cells.capacity() + self.fixed.bytes(),
            ),
            ("halo", self.message.capacity() * size_of::<T>()),
            ("segments", stage + self.table.bytes()),
            ("weights", layers + ends + dispatch + stage_weights),
            ("buffers", scratch),
        ]
    }

    /// Operations of the products of a step, by phase.
    pub(super) fn flops(&self, model: &Model) -> [f64; 8] {
        let a = &model.spec.architecture;
        let (d, h) = (self.width as f64, a.hidden_layers as f64);
        let square = 2.0 * d * d;
        let (n, e) = (self.n_owned as f64, self.order.senders.len() as f64);
        let (cells, layers) = (self.cells.len() as f64, self.layers.len() as f64);
        let mut flops = [0.0; 8];
        let mut set = |phase: Phase, value: f64| flops[phase as usize] = value;
        set(
            Phase::EncodeNodes,
            n * (2.0 * d * self.n_inputs as f64 + h * square),
        );
        if self.encoded.is_none() {
            set(
                Phase::EncodeEdges,
                e * (2.0 * d * self.edge_scale.0.len() as f64 + h * square),
            );
        }
        set(Phase::Project, layers * n * square);
        set(Phase::Edges, layers * (e * (1.0 + h) + n) * square);
        set(Phase::Nodes, layers * n * (2.0 + h) * square);
        set(
            Phase::Decode,
            cells * (h * square + 2.0 * d * self.n_outputs as f64),
        );
        if let (Some(stage), Some(spec)) = (&self.stage, &a.segment_transformer) {
            let k = stage.count() as f64;
            let layer = 4.0 * square + 4.0 * d * spec.ffn_width as f64 + 4.0 * k * d;
            let dispatched = if self.dispatch.is_some() { n + k } else { 0.0 };
            set(
                Phase::Segments,
                k * ((1.0 + h) * square + spec.layers as f64 * layer) + dispatched * square,
            );
        }
        flops
    }
}
