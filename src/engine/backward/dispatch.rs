//! The macro stage within the network: its segments, and what they add to nodes that layers follow.

use super::attention::add;
use super::graph::TrainGraph;
use super::messages::{Messages, MessagesTape};
use super::mlp::Work;
use super::network::Buffers;
use crate::kernels::{Addend, Function, Number, Output, narrow};
use crate::tiles::{blocks, numbers};
use crate::weights::{Dense, Gradients};

impl<T: Number> Messages<T> {
    /// Segments, and the dispatch where layers follow.
    pub(super) fn macro_stage(&self, graph: &TrainGraph, tape: &mut MessagesTape<T>, work: &mut Buffers<T>) {
        let (isa, columns) = (self.isa, self.columns);
        let (Some(stage), Some(of), Some(kept)) = (&self.stage, &graph.segments, &mut tape.stage) else {
            return;
        };
        stage.forward(of, kept, &mut work.fp32, &work.latents);
        let Some(dispatch) = &self.dispatch else { return };
        dispatch.table(&kept.latents, of.members.count, &mut work.table);
        tape.dispatched.fit(graph.n_nodes() * columns);
        let zeros = work.shared.zeros();
        for rows in blocks::<T>(graph.n_nodes()) {
            let range = numbers(&rows, columns);
            let h = &mut work.latents[range.clone()];
            let x = &mut tape.dispatched[range];
            narrow(isa, h, x);
            of.members.add_means(isa, h, columns, &work.table, rows.clone());
            let (x, out) = ((&*x, columns), Output::Wide(h));
            dispatch.own.run(x, rows.len(), Addend::Output(zeros), Function::Identity, out);
        }
    }

    /// From the latents behind the macro stage and its dispatch to those before it.
    pub(super) fn stage_backward(
        &self,
        graph: &TrainGraph,
        tape: &mut MessagesTape<T>,
        work: &mut Buffers<T>,
        gradients: &mut Gradients,
    ) {
        let (isa, columns) = (self.isa, self.columns);
        let (Some(stage), Some(of), Some(kept)) = (&self.stage, &graph.segments, &mut tape.stage) else {
            return;
        };
        let k = of.members.count;
        let Buffers { shared, fp32, d_nodes, d_table, d_segments, .. } = work;
        let d_nodes = &mut d_nodes[..graph.n_nodes() * columns];
        let (d_table, d_segments) = (&mut d_table[..k * columns], &mut d_segments[..k * columns]);
        if let Some(dispatch) = &self.dispatch {
            d_table.fill(0.0);
            let (work, zeros) = shared.split();
            for rows in blocks::<T>(graph.n_nodes()) {
                let (n, range) = (rows.len(), numbers(&rows, columns));
                let d = &mut d_nodes[range.clone()];
                for (place, d) in rows.clone().zip(d.chunks_exact(columns)) {
                    of.members.spread_mean(place, d, d_table);
                    add(gradients.block(dispatch.bias.slot), d);
                }
                let dy = &mut work.narrow[..n * columns];
                narrow(isa, d, dy);
                let x = (&tape.dispatched[range], columns);
                dispatch.own.learn((dy, columns), x, n, gradients, &mut work.pairs);
                dispatch.own.back_add((dy, columns), n, d, zeros);
            }
            through_table(&dispatch.segment, &kept.latents, columns, d_table, d_segments, fp32, gradients);
        }
        stage.backward(of, kept, fp32, d_segments, d_nodes, gradients);
    }
}

/// `d_x += d_table W`, and `dW += d_table^T x`, for the rows of all segments.
pub fn through_table(
    weight: &Dense<f32>,
    x: &[f32],
    columns: usize,
    d_table: &[f32],
    d_x: &mut [f32],
    work: &mut Work<f32>,
    gradients: &mut Gradients,
) {
    let k = d_table.len() / columns;
    for rows in blocks::<f32>(k) {
        let (n, range) = (rows.len(), numbers(&rows, columns));
        let dy = (&d_table[range.clone()], columns);
        weight.learn(dy, (&x[range.clone()], columns), n, gradients, &mut work.pairs);
        weight.back(dy, n, &mut work.wide);
        add(&mut d_x[range], &work.wide);
    }
}
