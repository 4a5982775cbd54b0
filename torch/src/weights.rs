//! Named views of the flat vector of all weights, to which the backward pass gathers the gradient.

use m4gn_engine::backward::Layout;
use std::collections::BTreeMap;
use tch::{Kind, Tensor};

/// Named tensors, views of the flat vector (and of its bfloat16 copy).
pub struct Weights {
    full: BTreeMap<String, Tensor>,
    half: BTreeMap<String, Tensor>,
}

impl Weights {
    /// Views of the flat vector of this layout; gradients flow back to it. With `half`, bfloat16 copies too.
    pub fn new(layout: &Layout, flat: &Tensor, half: bool) -> Self {
        let sizes: Vec<i64> = layout.starts().windows(2).map(|w| (w[1] - w[0]) as i64).collect();
        let view = |((name, shape), part): (&(String, Vec<usize>), Tensor)| {
            let shape: Vec<i64> = shape.iter().map(|&n| n as i64).collect();
            (name.clone(), part.view(&shape[..]))
        };
        let named = |vector: &Tensor| {
            let parts = vector.split_with_sizes(&sizes[..], 0);
            layout.entries().iter().zip(parts).map(view).collect()
        };
        Weights {
            full: named(flat),
            half: if half { named(&flat.to_kind(Kind::BFloat16)) } else { BTreeMap::new() },
        }
    }

    /// A weight in fp32. Panics for a name that the layout lacks, a defect of this library.
    pub fn full(&self, name: &str) -> &Tensor {
        self.full.get(name).unwrap_or_else(|| panic!("no weight named {name}"))
    }

    /// The weight that large products use: bfloat16 where asked for.
    pub fn product(&self, name: &str) -> &Tensor {
        self.half.get(name).unwrap_or_else(|| self.full(name))
    }

    /// Whether large products are in bfloat16.
    pub fn is_half(&self) -> bool {
        !self.half.is_empty()
    }
}
