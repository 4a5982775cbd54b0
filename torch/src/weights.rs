//! Named views of the flat vector of all weights, to which the backward pass gathers the gradient.

use m4gn_model::ModelSpec;
use std::collections::BTreeMap;
use tch::{Kind, Tensor};

/// Name, shape and place of each weight in the flat vector; the normalisers are not among them.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    host: m4gn_engine::backward::Layout,
    entries: Vec<(String, Vec<i64>)>,
    sizes: Vec<i64>,
}

/// Named tensors, views of the flat vector (and of its bfloat16 copy).
pub struct Weights {
    full: BTreeMap<String, Tensor>,
    half: BTreeMap<String, Tensor>,
}

impl Layout {
    /// The layout of a model.
    pub fn new(spec: &ModelSpec) -> Self {
        let host = m4gn_engine::backward::Layout::new(spec);
        let entries: Vec<(String, Vec<i64>)> = host
            .entries()
            .iter()
            .map(|(name, shape)| (name.clone(), shape.iter().map(|&n| n as i64).collect()))
            .collect();
        let sizes = entries.iter().map(|(_, shape)| shape.iter().product()).collect();
        Layout { host, entries, sizes }
    }

    /// Named views of the flat vector; gradients flow back to it. With `half`, bfloat16 copies too.
    pub fn views(&self, flat: &Tensor, half: bool) -> Weights {
        let named = |vector: &Tensor| {
            let parts = vector.split_with_sizes(&self.sizes[..], 0);
            self.entries
                .iter()
                .zip(parts)
                .map(|((name, shape), part)| (name.clone(), part.view(&shape[..])))
                .collect()
        };
        Weights {
            full: named(flat),
            half: if half { named(&flat.to_kind(Kind::BFloat16)) } else { BTreeMap::new() },
        }
    }
}

impl std::ops::Deref for Layout {
    type Target = m4gn_engine::backward::Layout;

    fn deref(&self) -> &Self::Target {
        &self.host
    }
}

impl Weights {
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
