//! Weights as forward and backward products read them, and where their gradients are summed.

use super::layout::Layout;
use crate::kernels::{Addend, Function, Output};
use crate::kernels::{Buffer, Isa, Norm, Number, Packed, Pairs, outer, padded, product};
use m4gn_base::Result;

/// A block of a weight, or a vector, in the flat vector and in a block of sums with rows of whole vectors.
#[derive(Clone, Debug)]
struct Slot {
    rows: usize,
    columns: usize,
    /// First column in the block, first number in the flat vector, length.
    pieces: Vec<(usize, usize, usize)>,
    /// From one row to the next in the flat vector.
    stride: usize,
}

/// Collects the blocks of a network, which then have numbers.
#[derive(Debug)]
pub struct Slots {
    layout: Layout,
    slots: Vec<Slot>,
}

/// Sums of gradients, a block a slot.
#[derive(Debug)]
pub struct Gradients {
    blocks: Vec<Buffer<f32>>,
}

impl Slots {
    /// None yet.
    pub fn new(layout: Layout) -> Self {
        Slots { layout, slots: Vec::new() }
    }

    /// The layout of the flat vector.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    fn add(&mut self, slot: Slot) -> usize {
        self.slots.push(slot);
        self.slots.len() - 1
    }

    /// Zero sums for all blocks.
    pub fn gradients(&self) -> Gradients {
        let block = |s: &Slot| Buffer::new(s.rows * s.columns);
        Gradients { blocks: self.slots.iter().map(block).collect() }
    }

    /// Adds the sums to a flat gradient and clears them.
    pub fn flush(&self, gradients: &mut Gradients, flat: &mut [f32]) {
        for (slot, block) in self.slots.iter().zip(&mut gradients.blocks) {
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

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.blocks.iter().map(|b| b.bytes()).sum()
    }
}

/// Columns of a linear layer's weight, packed for y = x W^T and for dx = dy W.
#[derive(Debug)]
pub struct Dense<T> {
    isa: Isa,
    slot: usize,
    /// Packed inputs: numbers of each piece, and padding between them.
    inputs: usize,
    outputs: usize,
    forward: Packed<T>,
    backward: Packed<T>,
    source: Slot,
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
        let source = Slot {
            rows: outputs,
            columns: padded(inputs),
            pieces: pieces.iter().map(|&(at, c, n)| (at, start + c, n)).collect(),
            stride,
        };
        Ok(Dense {
            isa,
            slot: slots.add(source.clone()),
            inputs,
            outputs,
            forward: Packed::zero(isa, inputs, outputs),
            backward: Packed::zero(isa, outputs, inputs),
            source,
        })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        let Slot { pieces, stride, .. } = &self.source;
        // Where each packed input stands in the first row; none: padding between pieces.
        let mut places = vec![None; self.inputs];
        for &(at, start, n) in pieces {
            (0..n).for_each(|i| places[at + i] = Some(start + i));
        }
        let weight = |i: usize, o: usize| places[i].map_or(0.0, |place| flat[place + o * stride]);
        self.forward.fill(weight);
        self.backward.fill(|o, i| weight(i, o));
    }

    /// Packed for products of the forward pass.
    pub fn forward(&self) -> &Packed<T> {
        &self.forward
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

    /// Bytes.
    pub fn bytes(&self) -> usize {
        self.forward.bytes() + self.backward.bytes()
    }
}

/// A bias, a gain or a shift, padded.
#[derive(Debug)]
pub struct Vector {
    /// Where its gradient is summed.
    pub slot: usize,
    /// Its numbers.
    pub data: Vec<f32>,
    start: usize,
    n: usize,
}

impl Vector {
    /// The tensor of this name, of one row.
    pub fn new(slots: &mut Slots, name: &str) -> Result<Self> {
        let (start, shape) = slots.layout.find(name)?;
        let n = shape.iter().product();
        let slot = slots.add(Slot { rows: 1, columns: padded(n), pieces: vec![(0, start, n)], stride: n });
        Ok(Vector { slot, data: vec![0.0; padded(n)], start, n })
    }

    /// A place for sums of d numbers that belong to no weight.
    pub fn unread(slots: &mut Slots, d: usize) -> Self {
        let slot = slots.add(Slot { rows: 1, columns: padded(d), pieces: Vec::new(), stride: 0 });
        Vector { slot, data: Vec::new(), start: 0, n: 0 }
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.data[..self.n].copy_from_slice(&flat[self.start..self.start + self.n]);
    }
}

/// Gain and shift of a layer norm.
#[derive(Debug)]
pub struct NormWeights {
    /// As the kernels read it.
    pub norm: Norm,
    gain: Vector,
    shift: Vector,
}

impl NormWeights {
    /// Tensors `NAME.weight` and `NAME.bias`.
    pub fn new(slots: &mut Slots, name: &str) -> Result<Self> {
        let gain = Vector::new(slots, &format!("{name}.weight"))?;
        let shift = Vector::new(slots, &format!("{name}.bias"))?;
        let norm = Norm::new(&gain.data[..gain.n], &shift.data[..shift.n]);
        Ok(NormWeights { norm, gain, shift })
    }

    /// Takes the weights of the flat vector.
    pub fn load(&mut self, flat: &[f32]) {
        self.gain.load(flat);
        self.shift.load(flat);
        self.norm = Norm::new(&self.gain.data[..self.gain.n], &self.shift.data[..self.shift.n]);
    }

    /// Where the gradients of gain and shift are summed.
    pub fn slots(&self) -> [usize; 2] {
        [self.gain.slot, self.shift.slot]
    }
}
