//! The passes of a step over tiles of nodes and their edges.

use super::super::ends::Encoder;
use super::super::kernels::{Addend, Buffer, Function, Normed, Number, Output, add_means, narrow, product};
use super::super::passing::Topology;
use super::super::pool::Parts;
use super::super::profile::Phase;
use super::super::tiles::{Scratch, Tile, block, blocks};
use super::Network;
use crate::parallel::{Comm, Element};
use std::ops::Range;
use std::time::Instant;

impl<T: Number + Element> Network<T> {
    /// f_e of eq. 1, for good.
    pub(super) fn encode_edges(&mut self) {
        let (columns, tiles) = (self.columns, &self.tiles);
        let (encoder, bias) = (&self.edge_encoder, &self.edge_bias[..]);
        let (features, k) = (&self.features[..], self.edge_scale.0.len());
        let mut encoded = Buffer::new(self.edges.len());
        let out = Parts::new(&mut encoded);
        let task = |s: &mut Scratch<T>, i: usize| {
            // SAFETY: tiles are disjoint.
            let out = unsafe { out.rows(&tiles[i].edges, columns) };
            encode_tile(encoder, bias, (features, k), &tiles[i], s, out);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
        self.features = Vec::new();
        self.encoded = Some(encoded);
    }

    /// f_n of eq. 1.
    pub(super) fn encode_nodes(&mut self, inputs: &[f32]) {
        let (columns, k) = (self.columns, self.n_inputs);
        let (tiles, node) = (&self.tiles, &self.order.node);
        let (encoder, fixed) = (&self.encoder, &self.fixed);
        let (mean, scale) = (&self.input_mean, &self.input_scale);
        let nodes = Parts::new(&mut self.nodes);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let places = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let out = unsafe { nodes.rows(places, columns) };
            for (row, &node) in node[places.clone()].iter().enumerate() {
                let raw = &inputs[node as usize * k..(node as usize + 1) * k];
                let x = s.raw[row * k..].iter_mut();
                for (((x, raw), m), scale) in x.zip(raw).zip(mean).zip(scale) {
                    *x = (raw - m) * scale;
                }
                let fixed = &fixed.rows[fixed.row[node as usize] as usize * columns..][..columns];
                s.sums[row * columns..(row + 1) * columns].copy_from_slice(fixed);
            }
            let buffers = (&mut s.a[..], &mut s.b[..], &mut s.c[..]);
            let addend = Addend::Rows(&s.sums);
            encoder.run((&s.raw, k), places.len(), addend, buffers, Normed::Wide(out));
            s.clock.stop(Phase::EncodeNodes);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// One message-passing layer (eq. 2, 3) with its halo exchange, which goes on while the nodes that do not wait
    /// for it are done.
    pub(super) fn pass(&mut self, comm: &Comm, l: usize) {
        let (columns, tiles, layer) = (self.columns, &self.tiles, &self.layers[l]);
        let (pool, scratch) = (&self.pool, &mut self.scratch);
        let nodes = &self.nodes;
        let out = Parts::new(&mut self.projected[..self.n_owned * columns]);
        let project = |s: &mut Scratch<T>, i: usize| {
            let rows = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let out = unsafe { out.rows(rows, columns) };
            layer.project(s, &nodes[rows.start * columns..rows.end * columns], out);
        };
        pool.run(scratch, tiles.len(), project, || ());

        let nodes = Parts::new(&mut self.nodes);
        let edges = Parts::new(&mut self.edges);
        let encoded = self.encoded.as_deref().filter(|_| l == 0);
        let compute = l == 0 && encoded.is_none();
        let (encoder, bias) = (&self.edge_encoder, &self.edge_bias[..]);
        let features = (&self.features[..], self.edge_scale.0.len());
        let keep = l + 1 < self.layers.len();
        let (senders, receivers) = (&self.order.senders[..], &self.order.receivers[..]);
        let sweep = |projected: &[T], tile: &Tile, s: &mut Scratch<T>| {
            // SAFETY: tiles are disjoint.
            let (h, e) = unsafe { (nodes.rows(&tile.nodes, columns), edges.rows(&tile.edges, columns)) };
            if compute {
                s.clock.start();
                encode_tile(encoder, bias, features, tile, s, e);
                s.clock.stop(Phase::EncodeEdges);
            }
            let before = encoded.map(|e| &e[tile.edges.start * columns..tile.edges.end * columns]);
            let graph = Topology {
                senders,
                receivers,
                projected,
            };
            layer.sweep(&graph, tile, s, h, e, before, keep);
        };
        let (interior, rest) = tiles.split_at(self.n_interior);
        let start = self.profile.as_ref().map(|_| Instant::now());
        let mut busy = 0.0;
        let message = &mut self.message;
        self.halo.exchange_during(
            comm,
            &mut self.projected,
            columns,
            message,
            |projected, progress| {
                let start = start.map(|_| Instant::now());
                pool.run(
                    scratch,
                    interior.len(),
                    |s, i| sweep(projected, &interior[i], s),
                    progress,
                );
                busy = start.map_or(0.0, |s| s.elapsed().as_secs_f64());
            },
        );
        if let (Some(start), Some(own)) = (start, scratch.first_mut()) {
            own.clock.phases[Phase::Halo as usize] += start.elapsed().as_secs_f64() - busy;
        }
        let projected = &self.projected;
        pool.run(scratch, rest.len(), |s, i| sweep(projected, &rest[i], s), || ());
    }

    /// The macro stage, and h += dispatch([h, h_S]) where the model carries on after it.
    pub(super) fn segments(&mut self, comm: &Comm) {
        let Some(stage) = &mut self.stage else { return };
        self.scratch[0].clock.start();
        stage.run(comm, &self.pool, &self.nodes);
        self.scratch[0].clock.stop(Phase::Segments);
        let (Some(weight), Some(table)) = (&self.dispatch, stage.dispatched()) else {
            return;
        };
        let (isa, columns, tiles) = (self.isa, self.columns, &self.tiles);
        let (row, member) = (&stage.member_row, &stage.member);
        let nodes = Parts::new(&mut self.nodes);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let places = &tiles[i].nodes;
            // SAFETY: tiles are disjoint.
            let h = unsafe { nodes.rows(places, columns) };
            narrow(isa, h, &mut s.a[..h.len()]);
            add_means(isa, h, columns, table, &row[places.start..=places.end], member);
            s.sums[..h.len()].copy_from_slice(h);
            let rows = Addend::Rows(&s.sums);
            let identity = Function::Identity;
            product(
                isa,
                weight,
                (&s.a, columns),
                places.len(),
                rows,
                identity,
                Output::Wide(h),
            );
            s.clock.stop(Phase::Segments);
        };
        self.pool.run(&mut self.scratch, tiles.len(), task, || ());
    }

    /// The decoder, on cells.
    pub(super) fn decode(&mut self, outputs: &mut [f32]) {
        let (isa, columns, m) = (self.isa, self.columns, self.n_outputs);
        let decoder = &self.decoder;
        if let (Some(weight), Some(stage)) = (&decoder.segment, &self.stage) {
            let x = (stage.latents(), columns);
            let out = Output::Wide(&mut self.table[..]);
            product(
                isa,
                weight,
                x,
                stage.count(),
                Addend::Nothing,
                Function::Identity,
                out,
            );
        }
        let (cells, nodes, table, stage) = (&self.cells, &self.nodes, &self.table[..], &self.stage);
        let width = decoder.columns();
        let outputs = Parts::new(outputs);
        let task = |s: &mut Scratch<T>, i: usize| {
            s.clock.start();
            let cells = &cells[block(i, cells.len())];
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
        self.pool
            .run(&mut self.scratch, blocks(cells.len()).len(), task, || ());
    }
}

/// Encodes a tile's edges into `out`, its rows.
fn encode_tile<T: Number>(
    encoder: &Encoder<T>,
    bias: &[f32],
    (features, k): (&[f32], usize),
    tile: &Tile,
    scratch: &mut Scratch<T>,
    out: &mut [T],
) {
    let columns = bias.len();
    let own = |chunk: &Range<usize>| {
        (chunk.start - tile.edges.start) * columns..(chunk.end - tile.edges.start) * columns
    };
    for chunk in tile.chunks() {
        let Scratch { a, b, c, .. } = &mut *scratch;
        let from = (&features[chunk.start * k..], k);
        let bias = Addend::Bias(bias);
        encoder.run(
            from,
            chunk.len(),
            bias,
            (a, b, c),
            Normed::Narrow(&mut out[own(&chunk)]),
        );
    }
}
