//! Weights as forward and backward products read them, and where their gradients are summed.

use super::kernels::{
    Addend, Buffer, Function, Isa, Norm, Number, Output, Packed, Pairs, outer, padded, product,
};
use super::layout::Layout;
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

/// The weights of a network, from which its layers take theirs, and the blocks that they make of them.
pub struct Weights<'a> {
    pub isa: Isa,
    pub layout: &'a Layout,
    flat: &'a [f32],
    /// Whether layers have what their derivatives need.
    trained: bool,
    slots: Vec<Slot>,
}

/// Where the sums of a network's blocks belong in a flat gradient.
pub struct Places(Vec<Slot>);

/// Sums of gradients, a block a slot.
pub struct Gradients {
    blocks: Vec<Buffer<f32>>,
}

impl<'a> Weights<'a> {
    /// Of a flat vector as long as its layout, for forward passes alone.
    pub fn new(isa: Isa, layout: &'a Layout, flat: &'a [f32]) -> Self {
        Weights { isa, layout, flat, trained: false, slots: Vec::new() }
    }

    /// The same, for derivatives as well.
    pub fn trained(isa: Isa, layout: &'a Layout, flat: &'a [f32]) -> Self {
        Weights { trained: true, ..Self::new(isa, layout, flat) }
    }

    fn add(&mut self, slot: Slot) -> usize {
        self.slots.push(slot);
        self.slots.len() - 1
    }

    /// Where the sums of all blocks belong.
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
    pub isa: Isa,
    slot: usize,
    /// Packed inputs: numbers of each piece, and padding between them.
    inputs: usize,
    outputs: usize,
    /// For products of the forward pass.
    pub forward: Packed<T>,
    /// For those of the derivative, where there are any.
    backward: Option<Packed<T>>,
}

impl<T: Number> Dense<T> {
    /// Columns `first..first + n` of `NAME.weight`.
    pub fn part(weights: &mut Weights, name: &str, first: usize, n: usize) -> Result<Self> {
        Self::of_pieces(weights, name, &[(0, first, n)])
    }

    /// All columns.
    pub fn whole(weights: &mut Weights, name: &str) -> Result<Self> {
        let n = weights.layout.find(&format!("{name}.weight"))?.1[1];
        Self::part(weights, name, 0, n)
    }

    /// Of a layer that reads k latents of width d, each padded to whole vectors.
    pub fn of_latents(weights: &mut Weights, name: &str, d: usize, k: usize) -> Result<Self> {
        let pieces: Vec<_> = (0..k).map(|i| (i * padded(d), i * d, d)).collect();
        Self::of_pieces(weights, name, &pieces)
    }

    /// Pieces: packed input, column, number.
    fn of_pieces(weights: &mut Weights, name: &str, pieces: &[(usize, usize, usize)]) -> Result<Self> {
        let (start, shape) = weights.layout.find(&format!("{name}.weight"))?;
        let (outputs, stride) = (shape[0], shape[1]);
        let inputs = pieces.last().map_or(0, |p| p.0 + p.2);
        let pieces: Vec<_> = pieces.iter().map(|&(at, c, n)| (at, start + c, n)).collect();
        // Where each packed input stands in the first row; none: padding between pieces.
        let mut places = vec![None; inputs];
        for &(at, start, n) in &pieces {
            (0..n).for_each(|i| places[at + i] = Some(start + i));
        }
        let (isa, flat) = (weights.isa, weights.flat);
        let weight = |i: usize, o: usize| places[i].map_or(0.0, |place| flat[place + o * stride]);
        Ok(Dense {
            isa,
            inputs,
            outputs,
            forward: Packed::new(isa, inputs, outputs, weight),
            backward: weights.trained.then(|| Packed::new(isa, outputs, inputs, |o, i| weight(i, o))),
            slot: weights.add(Slot { rows: outputs, columns: padded(inputs), pieces, stride }),
        })
    }

    /// `f(x W + addend)` of n rows of x, which stand a stride apart.
    pub fn run(&self, x: (&[T], usize), n: usize, addend: Addend<T>, f: Function, out: Output<T>) {
        product(self.isa, &self.forward, x, n, addend, f, out);
    }

    /// Columns of the outputs, padded.
    pub fn columns(&self) -> usize {
        self.forward.columns()
    }

    fn backward(&self) -> &Packed<T> {
        match &self.backward {
            Some(weight) => weight,
            None => unreachable!("a derivative by weights for forward passes alone"),
        }
    }

    /// `out = dy W`, rows of the padded inputs.
    pub fn back(&self, dy: (&[T], usize), n: usize, out: &mut [f32]) {
        let out = Output::Wide(out);
        product(self.isa, self.backward(), dy, n, Addend::Nothing, Function::Identity, out);
    }

    /// Columns of `dy W`.
    pub fn columns_back(&self) -> usize {
        self.backward().columns()
    }

    /// `out += dy W`; `zeros` has a row of them.
    pub fn back_add(&self, dy: (&[T], usize), n: usize, out: &mut [f32], zeros: &[f32]) {
        let out = Output::Wide(out);
        product(self.isa, self.backward(), dy, n, Addend::Output(zeros), Function::Identity, out);
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
fn vector(weights: &mut Weights, name: &str) -> Result<(usize, usize, usize)> {
    let (start, shape) = weights.layout.find(name)?;
    let n = shape.iter().product();
    Ok((start, n, weights.add(Slot { rows: 1, columns: padded(n), pieces: vec![(0, start, n)], stride: n })))
}

impl Vector {
    /// The tensor of this name, of one row.
    pub fn new(weights: &mut Weights, name: &str) -> Result<Self> {
        let (start, n, slot) = vector(weights, name)?;
        let mut data = weights.flat[start..start + n].to_vec();
        data.resize(padded(n), 0.0);
        Ok(Vector { slot, data })
    }

    /// A place for sums of d numbers that belong to no weight.
    pub fn unread(weights: &mut Weights, d: usize) -> Self {
        let slot = weights.add(Slot { rows: 1, columns: padded(d), pieces: Vec::new(), stride: 0 });
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
    pub fn new(weights: &mut Weights, name: &str) -> Result<Self> {
        let gain = vector(weights, &format!("{name}.weight"))?;
        let shift = vector(weights, &format!("{name}.bias"))?;
        let data = |(start, n, _): (usize, usize, usize)| &weights.flat[start..start + n];
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
    pub fn new(weights: &mut Weights, name: &str) -> Result<Self> {
        let weight = Dense::whole(weights, name)?;
        Ok(Linear { weight, bias: Vector::new(weights, &format!("{name}.bias"))? })
    }

    /// `f(x W + b)` of n rows of x, which stand a stride apart.
    pub fn run(&self, x: (&[T], usize), n: usize, f: Function, out: Output<T>) {
        self.weight.run(x, n, self.bias(), f, out);
    }

    /// `out += x W + b`, as [`Linear::run`].
    pub fn add(&self, x: (&[T], usize), n: usize, out: &mut [f32]) {
        let bias = Addend::Output(&self.bias.data);
        self.weight.run(x, n, bias, Function::Identity, Output::Wide(out));
    }

    /// What is added to its product.
    pub fn bias<U>(&self) -> Addend<'_, U> {
        Addend::Bias(&self.bias.data)
    }
}
