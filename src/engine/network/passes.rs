//! The two ends of a step: fields to latents, latents to fields.

use super::super::kernels::{Addend, Function, Normed, Number, Output};
use super::super::pool::Parts;
use super::super::profile::Phase;
use super::super::tiles::{Scratch, block, blocks};
use super::Network;
use m4gn_parallel::Element;

impl<T: Number + Element> Network<T> {
    /// f_n of eq. 1.
    pub(super) fn encode_nodes(&mut self, inputs: &[f32]) {
        let Network { grid, n_inputs, .. } = self;
        let (columns, k) = (grid.columns, *n_inputs);
        let (encoder, fixed, scale) = (&self.encoder, &self.fixed, &self.scale);
        grid.sweep_own(|s, tile, order, out| {
            s.clock.start();
            let places = &tile.nodes;
            for (row, &node) in order.node[places.clone()].iter().enumerate() {
                let raw = &inputs[node as usize * k..(node as usize + 1) * k];
                scale.normalise(raw, &mut s.raw[row * k..]);
                let fixed = &fixed.rows[fixed.row[node as usize] as usize * columns..][..columns];
                s.sums[row * columns..(row + 1) * columns].copy_from_slice(fixed);
            }
            let Scratch { a, b, c, sums, raw, .. } = &mut *s;
            let rows = encoder.rest.rows(None, places, [a, b]);
            encoder.run((raw, k), places.len(), Addend::Rows(sums), rows, c, Normed::Wide(out));
            s.clock.stop(Phase::EncodeNodes);
        });
    }

    /// The decoder, on cells.
    pub(super) fn decode(&mut self, outputs: &mut [f32]) {
        let Network { grid, processor, .. } = self;
        let (columns, m) = (grid.columns, self.n_outputs);
        let decoder = &self.decoder;
        let stage = processor.stage().filter(|_| decoder.segment.is_some());
        if let (Some(weight), Some(stage)) = (&decoder.segment, stage) {
            let (x, out) = ((stage.latents(), columns), Output::Wide(&mut self.table[..]));
            weight.run(x, stage.members.count, Addend::Nothing, Function::Identity, out);
        }
        let (cells, nodes, scale) = (&self.cells, &grid.nodes, &self.scale_out);
        let table = stage.map(|s| (&self.table[..], &s.members));
        let outputs = Parts::new(outputs);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let cells = &cells[block::<T>(i, cells.len())];
            let stride = decoder.run(nodes, table, cells, s, None);
            for (&(_, cell), row) in cells.iter().zip(s.raw.chunks_exact_mut(stride)) {
                scale.to_physical(&mut row[..m]);
                let cell = cell as usize;
                // SAFETY: every cell stands in one block, once.
                unsafe { outputs.rows(&(cell..cell + 1), m) }.copy_from_slice(&row[..m]);
            }
            s.clock.stop(Phase::Decode);
        };
        grid.pool.run(&mut grid.scratch, blocks::<T>(cells.len()).len(), task, || ());
    }
}
