//! One model step on physical fields: what goes into the network, what is to come out, and the next state, each with its
//! derivative.

use super::samples::{Components, Sample};
use m4gn_contact::graph::ContactGraph;
use m4gn_mesh::Result;
use m4gn_model::{ModelSpec, N_CONTACT_INPUTS, Output};

/// Which components are inputs and outputs, and how they go from a state to the next.
#[derive(Clone, Debug)]
pub struct Stepper {
    components: Components,
    /// Whether an output is a change.
    delta: Vec<bool>,
    /// Components that are not predicted.
    given: Vec<usize>,
    /// Whether the obstacle's motion is the input: bodies at points.
    contact: bool,
    /// Frames of a stride, where what the displacement changed by over the stride before is an input too. A state is then the
    /// displacement of all nodes, followed by this change of all nodes.
    history: Option<usize>,
}

impl Stepper {
    /// For the fields of a model, whose stride is so many frames.
    pub fn new(spec: &ModelSpec, frames_a_step: usize) -> Self {
        let components = Components::new(spec);
        let output = |c: &usize| spec.fields[components.field[*c]].output;
        Stepper {
            delta: components
                .outputs
                .iter()
                .map(|c| output(c) == Output::Delta)
                .collect(),
            given: (0..components.count)
                .filter(|c| output(c) == Output::None)
                .collect(),
            contact: spec.contact.is_some(),
            history: spec.has_history().then_some(frames_a_step),
            components,
        }
    }

    /// The components of the fields.
    pub fn components(&self) -> &Components {
        &self.components
    }

    /// The state of a frame, reflected in the second direction if asked for.
    ///
    /// A trajectory begins at rest: of a frame that is less than a stride from the first one the change over the stride before is
    /// that since the first one, and of the first one it is zero.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn frame(&self, sample: &Sample, frame: usize, mirror: bool) -> Result<Vec<f32>> {
        self.frame_after(sample, frame, self.history.unwrap_or(0), mirror)
    }

    /// As [`Stepper::frame`], of a body that came here in a stride from where it was so many frames before.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn frame_after(
        &self,
        sample: &Sample,
        frame: usize,
        frames: usize,
        mirror: bool,
    ) -> Result<Vec<f32>> {
        let mut state = sample.frame(frame)?.into_owned();
        if self.history.is_some() {
            let before = sample.frame(frame.saturating_sub(frames))?;
            for (i, before) in before.iter().enumerate() {
                state.push(state[i] - before);
            }
        }
        if mirror {
            for row in state.chunks_exact_mut(self.components.count) {
                let odd = row.iter_mut().zip(&self.components.odd);
                odd.filter(|(_, odd)| **odd).for_each(|(x, _)| *x = -*x);
            }
        }
        Ok(state)
    }

    /// Displacement, or fields, of all nodes in a state; then what it changed by over the stride before, where that is in it.
    pub fn parts<'a>(&self, state: &'a [f32]) -> (&'a [f32], Option<&'a [f32]>) {
        match self.history {
            Some(_) => {
                let (now, change) = state.split_at(state.len() / 2);
                (now, Some(change))
            }
            None => (state, None),
        }
    }

    /// Physical node inputs. Of a body at points they come of its points and of the obstacle's motion until `next`.
    pub fn inputs(&self, body: Option<&ContactGraph>, state: &[f32], next: &[f32], inputs: &mut Vec<f32>) {
        let c = &self.components;
        if let Some(body) = body {
            let ((state, change), (next, _)) = (self.parts(state), self.parts(next));
            let (points, now) = state.split_at(3 * body.graph().n_cells);
            body.inputs(points, change, [now, &next[points.len()..]], inputs);
            return;
        }
        inputs.clear();
        for row in state.chunks_exact(c.count) {
            inputs.extend(c.inputs.iter().map(|&i| row[i]));
        }
    }

    /// Physical outputs that lead exactly to `next`: changes from the present state, with its noise, or values.
    pub fn target(&self, sample: &Sample, state: &[f32], next: &[f32], target: &mut Vec<f32>) {
        target.clear();
        let c = &self.components;
        let rows = state.chunks_exact(c.count).zip(next.chunks_exact(c.count));
        for (now, next) in rows.take(sample.n_cells()) {
            let outputs = c.outputs.iter().zip(&self.delta);
            target.extend(outputs.map(|(&i, delta)| if *delta { next[i] - now[i] } else { next[i] }));
        }
    }

    /// The state one step later from physical outputs. `next` holds what is prescribed at the new time: of a history, what the
    /// displacement of held points and of the obstacle changes by; that of the other points is the output.
    pub fn advance(&self, sample: &Sample, state: &[f32], outputs: &[f32], next: &[f32]) -> Vec<f32> {
        let c = &self.components;
        let mut new = next.to_vec();
        let rows = outputs.chunks_exact(c.outputs.len());
        for (cell, row) in rows.enumerate() {
            if sample.held.as_ref().is_some_and(|held| held[cell]) {
                continue;
            }
            for ((&i, delta), y) in c.outputs.iter().zip(&self.delta).zip(row) {
                let at = cell * c.count + i;
                new[at] = if *delta { state[at] + y } else { *y };
                if self.history.is_some() {
                    new[next.len() / 2 + at] = *y;
                }
            }
        }
        self.copy_to_boundary(sample, &mut new, true);
        new
    }

    /// Boundary values that are their owner's; of predicted components alone, or of all.
    pub fn copy_to_boundary(&self, sample: &Sample, state: &mut [f32], predicted: bool) {
        let (n, width) = (sample.n_cells(), self.components.count);
        for (face, &owner) in sample.owners.iter().enumerate() {
            for i in 0..width {
                let copied = sample.copies[face * width + i] && !(predicted && self.given.contains(&i));
                if copied {
                    state[(n + face) * width + i] = state[owner as usize * width + i];
                }
            }
        }
    }

    /// From the derivative by the next state, which is spoilt, to that by the outputs, which is added to, and by the
    /// present state.
    pub fn advance_backward(&self, sample: &Sample, d_next: &mut [f32], d_outputs: &mut [f32]) -> Vec<f32> {
        let c = &self.components;
        let (n, width) = (sample.n_cells(), c.count);
        for (face, &owner) in sample.owners.iter().enumerate() {
            for i in (0..width).filter(|i| !self.given.contains(i)) {
                if sample.copies[face * width + i] {
                    d_next[owner as usize * width + i] += d_next[(n + face) * width + i];
                }
            }
        }
        let mut d_state = vec![0.0; d_next.len()];
        for (cell, row) in d_outputs.chunks_exact_mut(c.outputs.len()).enumerate() {
            if sample.held.as_ref().is_some_and(|held| held[cell]) {
                continue;
            }
            for ((&i, delta), y) in c.outputs.iter().zip(&self.delta).zip(row) {
                let d = d_next[cell * width + i];
                *y += d;
                if *delta {
                    d_state[cell * width + i] = d;
                }
                if self.history.is_some() {
                    *y += d_next[d_next.len() / 2 + cell * width + i];
                }
            }
        }
        d_state
    }

    /// What the derivative by the inputs is by the state.
    pub fn inputs_backward(&self, d_inputs: &[f32], d_state: &mut [f32]) {
        // The motion of an obstacle is prescribed, and how near it is counts as given.
        if self.contact {
            if self.history.is_some() {
                let (_, change) = d_state.split_at_mut(d_state.len() / 2);
                let rows = d_inputs.chunks_exact(N_CONTACT_INPUTS + 3);
                for (d, row) in change.as_chunks_mut::<3>().0.iter_mut().zip(rows) {
                    let by = d.iter_mut().zip(&row[N_CONTACT_INPUTS..]);
                    by.for_each(|(d, x)| *d += x);
                }
            }
            return;
        }
        let c = &self.components;
        let rows = d_inputs.chunks_exact(c.inputs.len());
        for (d, row) in d_state.chunks_exact_mut(c.count).zip(rows) {
            c.inputs.iter().zip(row).for_each(|(&i, x)| d[i] += x);
        }
    }

    /// What the derivative by the target is by the state.
    pub fn target_backward(&self, d_target: &[f32], d_state: &mut [f32]) {
        let c = &self.components;
        let rows = d_target.chunks_exact(c.outputs.len());
        for (d, row) in d_state.chunks_exact_mut(c.count).zip(rows) {
            let outputs = c.outputs.iter().zip(&self.delta).zip(row);
            outputs
                .filter(|((_, delta), _)| **delta)
                .for_each(|((&i, _), x)| d[i] -= x);
        }
    }
}

#[cfg(test)]
#[path = "state_tests.rs"]
mod tests;
