//! Memory that starts at a cache line, so that no vector crosses two.

use std::ops::{Deref, DerefMut};

#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([u8; 64]);

/// Numbers of a type that all zero bits are a value of.
pub trait Plain: Copy + 'static {}
impl Plain for f32 {}
impl Plain for f64 {}
impl Plain for super::Bf16 {}

/// A slice of fixed length that begins at a cache line; zero at first.
#[derive(Default)]
pub struct Buffer<T> {
    lines: Vec<Line>,
    len: usize,
    kind: std::marker::PhantomData<T>,
}

impl<T: Plain> Buffer<T> {
    /// Of `len` numbers, all zero.
    pub fn new(len: usize) -> Self {
        // Memory of the system that is zero anyway is not touched, so that it costs nothing until it is used.
        let lines = vec![Line([0; 64]); (len * size_of::<T>()).div_ceil(64)];
        Buffer { lines, len, kind: std::marker::PhantomData }
    }

    /// Makes it at least this long; what a shorter one held is lost.
    pub fn fit(&mut self, len: usize) {
        if self.len < len {
            *self = Self::new(len);
        }
    }

    pub fn bytes(&self) -> usize {
        self.lines.len() * 64
    }
}

impl<T: Plain> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: the lines hold len numbers, whose alignment is less than a line's; any bits are values of T.
        unsafe { std::slice::from_raw_parts(self.lines.as_ptr().cast(), self.len) }
    }
}

impl<T: Plain> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts_mut(self.lines.as_mut_ptr().cast(), self.len) }
    }
}

impl<T> std::fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Buffer({})", self.len)
    }
}
