//! Weights as forward and backward products read them, and where their gradients are summed.

use super::layout::Layout;
use crate::kernels::{Addend, Function, Output};
use crate::kernels::{Buffer, Isa, Norm, Number, Packed, Pairs, outer, padded, product};
use m4gn_base::Result;

/// A block of a weight, or a vector, in the flat vector and in a block of sums with rows of whole vectors.
struct Slot {
    rows: usize,
    columns: usize,
    /// First column in the block, first number in the flat vector, length.
    pieces: Vec<(usize, usize, usize)>,
    /// From one row to the next in the flat vector.
    stride: usize,
}

/// Collects the blocks of a network, which then have numbers, and has its weights.
pub struct Slots<'a> {
    pub layout: &'a Layout,
    flat: &'a [f32],
    slots: Vec<Slot>,
}

/// Where the sums of a network's blocks belong in a flat gradient.
pub struct Places(Vec<Slot>);

/// Sums of gradients, a block a slot.
pub struct Gradients {
    blocks: Vec<Buffer<f32>>,
}

impl<'a> Slots<'a> {
    /// None yet, of weights as long as their layout.
    pub fn new(layout: &'a Layout, flat: &'a [f32]) -> Self {
        Slots { layout, flat, slots: Vec::new() }
    }

    fn add(&mut self, slot: Slot) -> usize {
        self.slots.push(slot);
        self.slots.len() - 1
    }

    /// All that were collected.
    pub fn places(self) -> Places {
        Places(self.slots)
    }
}

impl Places {
    /// Zero sums for all blocks.
    pub fn gradients(&self) -> Gradients {
        let block = |s: &Slot| Buffer::new(s.rows * s.columns);
        Gradients { blocks: self.0.iter().map(block).collect() }
    }

    /// Adds the sums to a flat gradient and clears them.
    pub fn flush(&self, gradients: &mut Gradients, flat: &mut [f32]) {
        for (slot, block) in self.0.iter().zip(&mut gradients.blocks) {
            for row in 0..slot.rows {
                for &(column, start, n) in &slot.pieces {
                    let from = &block[row * slot.columns + column..][..n];
                    let to = &mut flat[start + row * slot.stride..][..n];
                    to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
                }
            }
            block.fill(0.0);
        }
    }
}

impl Gradients {
    /// The sums of a slot.
    pub fn block(&mut self, slot: usize) -> &mut [f32] {
        &mut self.blocks[slot]
    }

    /// The sums of three different slots.
    pub fn three(&mut self, slots: [usize; 3]) -> [&mut [f32]; 3] {
        match self.blocks.get_disjoint_mut(slots) {
            Ok(blocks) => blocks.map(|b| &mut b[..]),
            Err(_) => unreachable!("a norm's gain, its shift and a bias are different slots"),
        }
    }
}

/// Columns of a linear layer's weight, packed for y = x W^T and for dx = dy W.
pub struct Dense<T> {
    isa: Isa,
    slot: usize,
    /// Packed inputs: numbers of each piece, and padding between them.
    inputs: usize,
    outputs: usize,
    /// For products of the forward pass.
    pub forward: Packed<T>,
    backward: Packed<T>,
}

impl<T: Number> Dense<T> {
    /// Columns `first..first + n` of `NAME.weight`.
    pub fn columns(isa: Isa, slots: &mut Slots, name: &str, first: usize, n: usize) -> Result<Self> {
        Self::of_pieces(isa, slots, name, &[(0, first, n)])
    }

    /// All columns.
    pub fn whole(isa: Isa, slots: &mut Slots, name: &str) -> Result<Self> {
        let n = slots.layout.find(&format!("{name}.weight"))?.1[1];
        Self::columns(isa, slots, name, 0, n)
    }

    /// Of a layer that reads k latents of width d, each padded to whole vectors.
    pub fn of_latents(isa: Isa, slots: &mut Slots, name: &str, d: usize, k: usize) -> Result<Self> {
        let pieces: Vec<_> = (0..k).map(|i| (i * padded(d), i * d, d)).collect();
        Self::of_pieces(isa, slots, name, &pieces)
    }

    /// Pieces: packed input, column, number.
    fn of_pieces(isa: Isa, slots: &mut Slots, name: &str, pieces: &[(usize, usize, usize)]) -> Result<Self> {
        let (start, shape) = slots.layout.find(&format!("{name}.weight"))?;
        let (outputs, stride) = (shape[0], shape[1]);
        let inputs = pieces.last().map_or(0, |p| p.0 + p.2);
        let pieces: Vec<_> = pieces.iter().map(|&(at, c, n)| (at, start + c, n)).collect();
        // Where each packed input stands in the first row; none: padding between pieces.
        let mut places = vec![None; inputs];
        for &(at, start, n) in &pieces {
            (0..n).for_each(|i| places[at + i] = Some(start + i));
        }
        let flat = slots.flat;
        let weight = |i: usize, o: usize| places[i].map_or(0.0, |place| flat[place + o * stride]);
        Ok(Dense {
            isa,
            inputs,
            outputs,
            forward: Packed::new(isa, inputs, outputs, weight),
            backward: Packed::new(isa, outputs, inputs, |o, i| weight(i, o)),
            slot: slots.add(Slot { rows: outputs, columns: padded(inputs), pieces, stride }),
        })
    }

    /// `out = dy W`, rows of the padded inputs.
    pub fn back(&self, (dy, stride): (&[T], usize), n: usize, out: &mut [f32]) {
        let out = Output::Wide(out);
        product(self.isa, &self.backward, (dy, stride), n, Addend::Nothing, Function::Identity, out);
    }

    /// Columns of `dy W`.
    pub fn columns_back(&self) -> usize {
        self.backward.columns()
    }

    /// `out += dy W`; `zeros` has a row of them.
    pub fn back_add(&self, (dy, stride): (&[T], usize), n: usize, out: &mut [f32], zeros: &[f32]) {
        let out = Output::Wide(out);
        product(self.isa, &self.backward, (dy, stride), n, Addend::Output(zeros), Function::Identity, out);
    }

    /// `dW += dy^T x`.
    pub fn learn(
        &self,
        dy: (&[T], usize),
        x: (&[T], usize),
        n: usize,
        gradients: &mut Gradients,
        pairs: &mut Pairs<T>,
    ) {
        let sizes = (self.outputs, padded(self.inputs));
        outer(self.isa, dy, x, n, sizes, gradients.block(self.slot), pairs);
    }
}

/// A bias, or the scores of a pooling, padded.
pub struct Vector {
    /// Where its gradient is summed.
    pub slot: usize,
    pub data: Vec<f32>,
}

/// Place and number of a vector's weights in the flat vector, and where its gradient is summed.
fn vector(slots: &mut Slots, name: &str) -> Result<(usize, usize, usize)> {
    let (start, shape) = slots.layout.find(name)?;
    let n = shape.iter().product();
    Ok((start, n, slots.add(Slot { rows: 1, columns: padded(n), pieces: vec![(0, start, n)], stride: n })))
}

impl Vector {
    /// The tensor of this name, of one row.
    pub fn new(slots: &mut Slots, name: &str) -> Result<Self> {
        let (start, n, slot) = vector(slots, name)?;
        let mut data = slots.flat[start..start + n].to_vec();
        data.resize(padded(n), 0.0);
        Ok(Vector { slot, data })
    }

    /// A place for sums of d numbers that belong to no weight.
    pub fn unread(slots: &mut Slots, d: usize) -> Self {
        let slot = slots.add(Slot { rows: 1, columns: padded(d), pieces: Vec::new(), stride: 0 });
        Vector { slot, data: Vec::new() }
    }
}

/// Gain and shift of a layer norm.
pub struct NormWeights {
    /// As the kernels read it.
    pub norm: Norm,
    /// Where the gradients of gain and shift are summed.
    pub slots: [usize; 2],
}

impl NormWeights {
    /// Tensors `NAME.weight` and `NAME.bias`.
    pub fn new(slots: &mut Slots, name: &str) -> Result<Self> {
        let gain = vector(slots, &format!("{name}.weight"))?;
        let shift = vector(slots, &format!("{name}.bias"))?;
        let data = |(start, n, _): (usize, usize, usize)| &slots.flat[start..start + n];
        Ok(NormWeights { norm: Norm::new(data(gain), data(shift)), slots: [gain.2, shift.2] })
    }
}

/// A linear layer.
pub struct Linear<T> {
    pub weight: Dense<T>,
    pub bias: Vector,
}

impl<T: Number> Linear<T> {
    /// Tensors `NAME.weight` and `NAME.bias`.
    pub fn new(isa: Isa, slots: &mut Slots, name: &str) -> Result<Self> {
        let weight = Dense::whole(isa, slots, name)?;
        Ok(Linear { weight, bias: Vector::new(slots, &format!("{name}.bias"))? })
    }

    /// What is added to its product.
    pub fn bias<U>(&self) -> Addend<'_, U> {
        Addend::Bias(&self.bias.data)
    }
}
