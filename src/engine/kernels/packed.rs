//! Weights in the order that products read them.

use super::Isa;
use super::buffer::Buffer;
use super::simd::{LANES, Number};

/// Most vectors of a panel of columns.
pub const PANEL: usize = 4;

/// A weight `[inputs x outputs]` in the order that products read it: panels of up to four vectors of outputs, in
/// each of them input after input (with bf16 pair after pair). Outputs are padded with zeros to whole vectors.
pub struct Packed<T> {
    data: Buffer<T>,
    inputs: usize,
    outputs: usize,
    /// Outputs, padded.
    columns: usize,
    /// Vectors of each panel.
    panels: Vec<usize>,
}

/// `width` padded to whole vectors.
pub fn padded(width: usize) -> usize {
    width.next_multiple_of(LANES)
}

impl<T: Number> Packed<T> {
    /// From `weight(input, output)`.
    pub fn new(isa: Isa, inputs: usize, outputs: usize, weight: impl Fn(usize, usize) -> f32) -> Self {
        let mut packed = Self::zero(isa, inputs, outputs);
        packed.fill(weight);
        packed
    }

    /// To be filled later.
    pub fn zero(isa: Isa, inputs: usize, outputs: usize) -> Self {
        let vectors = padded(outputs) / LANES;
        let most = isa.panel().min(PANEL);
        // As even as they come: five vectors are 3 and 2.
        let n = vectors.div_ceil(most);
        let panels: Vec<usize> = (0..n).map(|i| vectors * (i + 1) / n - vectors * i / n).collect();
        Packed {
            data: Buffer::new(inputs.next_multiple_of(T::STEP) * vectors * LANES),
            inputs,
            outputs,
            columns: vectors * LANES,
            panels,
        }
    }

    /// Other weights of the same shape.
    pub fn fill(&mut self, weight: impl Fn(usize, usize) -> f32) {
        let steps = self.inputs.div_ceil(T::STEP);
        let (mut at, mut first) = (0, 0);
        for &panel in &self.panels {
            for step in 0..steps {
                for column in first..first + panel * LANES {
                    for k in step * T::STEP..(step + 1) * T::STEP {
                        if k < self.inputs && column < self.outputs {
                            self.data[at] = T::from_f32(weight(k, column));
                        }
                        at += 1;
                    }
                }
            }
            first += panel * LANES;
        }
    }

    /// Inputs.
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    /// Outputs, padded.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The first of the weights; those of a panel stand behind those of the one before.
    pub(super) fn start(&self) -> *const T {
        self.data.as_ptr()
    }

    /// Vectors of each panel.
    pub(super) fn panels(&self) -> &[usize] {
        &self.panels
    }
}
