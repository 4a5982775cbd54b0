//! What stands between linear layers: in buffers that are used again, or kept for derivatives.

use super::kernels::{Addend, Buffer, Function, Number, Output, Saved, narrow, silu_keep};
use super::tiles::numbers;
use super::weights::Dense;
use std::ops::Range;

/// What an activation leaves, a row each: its values, and its derivative where the values do not tell it.
pub struct Activated<T> {
    function: Function,
    pub value: Buffer<T>,
    slope: Option<Buffer<T>>,
}

impl<T: Number> Activated<T> {
    pub fn new(function: Function) -> Self {
        let slope = (function == Function::Silu).then(Buffer::default);
        Activated { function, value: Buffer::default(), slope }
    }

    /// Room for so many numbers.
    pub fn fit(&mut self, len: usize) {
        self.value.fit(len);
        self.slope.iter_mut().for_each(|s| s.fit(len));
    }

    /// Where these numbers go.
    pub fn place(&mut self, range: Range<usize>) -> Place<'_, T> {
        let slope = self.slope.as_mut().map(|s| &mut s[range.clone()]);
        Place { function: self.function, value: &mut self.value[range], slope }
    }

    /// As [`activation_backward`](super::kernels::activation_backward) reads these numbers.
    pub fn saved(&self, range: Range<usize>) -> Saved<'_, T> {
        match &self.slope {
            Some(slope) => Saved::Slope(&slope[range]),
            None => Saved::Value(&self.value[range]),
        }
    }
}

/// Where a layer's activations go.
pub struct Place<'a, T> {
    pub function: Function,
    pub value: &'a mut [T],
    /// Their derivatives, where these are kept.
    pub slope: Option<&'a mut [T]>,
}

impl<'a, T: Number> Place<'a, T> {
    /// `f(x W + addend)` of n rows of x, which stand a stride apart; `wide` has room for them.
    pub fn fill(mut self, w: &Dense<T>, x: (&[T], usize), n: usize, addend: Addend<T>, wide: &mut [f32]) {
        match self.slope {
            Some(_) => self.keep(w, x, n, addend, wide),
            None => w.run(x, n, addend, self.function, Output::Narrow(self.value)),
        }
    }

    /// The same of a layer in fp32.
    pub fn round(
        mut self,
        w: &Dense<f32>,
        x: (&[f32], usize),
        n: usize,
        addend: Addend<f32>,
        wide: &mut [f32],
    ) {
        if self.slope.is_some() {
            return self.keep(w, x, n, addend, wide);
        }
        let size = n * w.columns();
        w.run(x, n, addend, self.function, Output::Wide(wide));
        narrow(w.isa, &wide[..size], &mut self.value[..size]);
    }

    /// The same of a layer in any precision, with the derivatives.
    fn keep<U: Number>(
        &mut self,
        w: &Dense<U>,
        x: (&[U], usize),
        n: usize,
        addend: Addend<U>,
        wide: &mut [f32],
    ) {
        w.run(x, n, addend, Function::Identity, Output::Wide(wide));
        let slope = self.slope.as_deref_mut().unwrap_or_default();
        silu_keep(w.isa, &wide[..n * w.columns()], self.value, slope);
    }
}

impl<'a> Place<'a, f32> {
    /// As [`Place::fill`], of a layer in any precision; returns the values.
    pub fn fill_wide<U: Number>(
        mut self,
        w: &Dense<U>,
        x: (&[U], usize),
        n: usize,
        addend: Addend<U>,
        wide: &mut [f32],
    ) -> &'a [f32] {
        match self.slope {
            Some(_) => self.keep(w, x, n, addend, wide),
            None => w.run(x, n, addend, self.function, Output::Wide(self.value)),
        }
        self.value
    }
}

/// Where the activations of layers behind each other go, rows of one width.
pub enum Activations<'a, T> {
    /// To two buffers by turns.
    Passing(Function, [&'a mut [T]; 2]),
    /// To these rows of what is kept, a layer each.
    Kept(&'a mut [Activated<T>], Range<usize>),
}

impl<T: Number> Activations<'_, T> {
    /// Those of layer i: what the layer before left, nothing for the first one, and where its own go.
    pub fn of(&mut self, i: usize, columns: usize) -> (&[T], Place<'_, T>) {
        match self {
            Activations::Passing(function, [a, b]) => {
                let (before, value) = if i.is_multiple_of(2) { (&**b, &mut **a) } else { (&**a, &mut **b) };
                (before, Place { function: *function, value, slope: None })
            }
            Activations::Kept(layers, rows) => {
                let range = numbers(rows, columns);
                let (done, rest) = layers.split_at_mut(i);
                let before = done.last().map_or(&[][..], |layer| &layer.value[range.clone()]);
                (before, rest[0].place(range))
            }
        }
    }

    /// What layer i left.
    pub fn values(&self, i: usize, columns: usize) -> &[T] {
        match self {
            Activations::Passing(_, buffers) => buffers[i % 2],
            Activations::Kept(layers, rows) => &layers[i].value[numbers(rows, columns)],
        }
    }
}
