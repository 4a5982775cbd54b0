//! Where a step's time goes.

use std::time::Instant;

/// Parts of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Fields to node latents.
    EncodeNodes,
    /// Features to edge latents, where they are computed anew in each step.
    EncodeEdges,
    /// The senders' part of the edge networks, once a node.
    Project,
    /// Edge networks, layer norms, residuals and sums into the receivers, with the receivers' part.
    Edges,
    /// Node networks.
    Nodes,
    /// Segment sums, encoder, transformer, dispatch.
    Segments,
    /// Latents to fields.
    Decode,
    /// Packing for and waiting for other ranks.
    Halo,
}

m4gn_base::names! {
    Phase: EncodeNodes "encode nodes", EncodeEdges "encode edges", Project "project senders", Edges "edge blocks", Nodes "node blocks",
    Segments "segments", Decode "decode", Halo "halo"
}

/// What the steps so far took, summed; made when [`EngineOptions::profile`](super::EngineOptions::profile) is set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Profile {
    /// Steps.
    pub steps: u64,
    /// Wall time of the steps, s.
    pub seconds: f64,
    /// Time of each phase of [`Phase::ALL`], summed over threads, s.
    pub phases: [f64; 8],
    /// Multiplications and additions of the products of each phase in one step, each counted as one operation.
    pub flops: [f64; 8],
}

/// A thread's clock. Off, it costs a branch.
#[derive(Debug)]
pub struct Clock {
    on: bool,
    last: Instant,
    /// Time of each phase so far, s.
    pub phases: [f64; 8],
}

impl Clock {
    /// Stopped; it never starts unless `on`.
    pub fn new(on: bool) -> Self {
        Clock { on, last: Instant::now(), phases: [0.0; 8] }
    }

    /// Starts a phase.
    pub fn start(&mut self) {
        if self.on {
            self.last = Instant::now();
        }
    }

    /// Books the time since the last call on this phase.
    pub fn stop(&mut self, phase: Phase) {
        if self.on {
            let now = Instant::now();
            self.phases[phase as usize] += (now - self.last).as_secs_f64();
            self.last = now;
        }
    }
}
