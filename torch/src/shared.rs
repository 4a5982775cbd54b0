//! Tensors that threads share.

use std::ops::Deref;
use tch::Tensor;

/// A tensor whose clones are handles on the same memory.
pub struct Shared(Tensor);

impl Clone for Shared {
    fn clone(&self) -> Self {
        Shared(self.0.shallow_clone())
    }
}

impl Deref for Shared {
    type Target = Tensor;

    fn deref(&self) -> &Tensor {
        &self.0
    }
}

impl From<Tensor> for Shared {
    fn from(tensor: Tensor) -> Self {
        Shared(tensor)
    }
}
