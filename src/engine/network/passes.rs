//! The two ends of a step: fields to latents, latents to fields.

use super::super::kernels::{Addend, Function, Normed, Number, Output, add_means, product};
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
            let buffers = (&mut s.a[..], &mut s.b[..], &mut s.c[..]);
            let addend = Addend::Rows(&s.sums);
            encoder.run((&s.raw, k), places.len(), addend, buffers, Normed::Wide(out));
            s.clock.stop(Phase::EncodeNodes);
        });
    }

    /// The decoder, on cells.
    pub(super) fn decode(&mut self, outputs: &mut [f32]) {
        let Network { grid, processor, .. } = self;
        let (isa, columns, m) = (grid.isa, grid.columns, self.n_outputs);
        let decoder = &self.decoder;
        let stage = processor.stage().filter(|_| decoder.segment.is_some());
        if let (Some(weight), Some(stage)) = (&decoder.segment, stage) {
            let x = (stage.latents(), columns);
            let out = Output::Wide(&mut self.table[..]);
            product(isa, weight, x, stage.count(), Addend::Nothing, Function::Identity, out);
        }
        let (cells, nodes, table) = (&self.cells, &grid.nodes, &self.table[..]);
        let width = decoder.columns();
        let outputs = Parts::new(outputs);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let cells = &cells[block::<T>(i, cells.len())];
            for (row, &(place, _)) in cells.iter().enumerate() {
                let place = place as usize;
                s.c[row * columns..(row + 1) * columns]
                    .copy_from_slice(&nodes[place * columns..(place + 1) * columns]);
                let sum = &mut s.sums[row * width..(row + 1) * width];
                sum.copy_from_slice(&decoder.bias);
                if let Some(stage) = stage {
                    let row = &stage.member_row[place..=place + 1];
                    add_means(isa, sum, width, table, row, &stage.member);
                }
            }
            let stride = decoder.run(s, cells.len());
            for (&(_, cell), row) in cells.iter().zip(s.raw.chunks_exact(stride)) {
                let cell = cell as usize;
                // SAFETY: every cell stands in one block, once.
                unsafe { outputs.rows(&(cell..cell + 1), m) }.copy_from_slice(&row[..m]);
            }
            s.clock.stop(Phase::Decode);
        };
        grid.pool.run(&mut grid.scratch, blocks::<T>(cells.len()).len(), task, || ());
    }
}
