//! What a state is: named arrays of numbers, each with its place in the inner product.

use m4gn_mesh::{Error, Result};

/// How a field enters the inner product of states.
#[derive(Clone, Debug, PartialEq)]
pub enum Weight {
    /// Not at all: the field is carried along with the same coefficients (face fluxes, boundary values).
    Carried,
    /// Every value alike.
    One,
    /// A weight for each item (cell volumes), the same for all its components.
    Items(Vec<f64>),
}

/// One array of a state, as large as it is on this rank.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Unique among the fields.
    pub name: String,
    /// Numbers on this rank: items times components, the components of an item together.
    pub len: usize,
    /// Numbers an item.
    pub components: usize,
    /// Its part in the inner product.
    pub weight: Weight,
    /// Whether a prediction is kept from falling below the least value that the snapshots in use have (k, omega, T).
    pub positive: bool,
    /// Whether its values at later times are known: a fit that says others of them does not hold there.
    pub input: bool,
}

impl Field {
    /// A field of the inner product with a weight for each item.
    pub fn weighted(name: &str, components: usize, weights: Vec<f64>) -> Self {
        Field {
            name: name.to_string(),
            len: weights.len() * components,
            components,
            weight: Weight::Items(weights),
            positive: false,
            input: false,
        }
    }

    /// A field that is carried along.
    pub fn carried(name: &str, len: usize) -> Self {
        Field {
            name: name.to_string(),
            len,
            components: 1,
            weight: Weight::Carried,
            positive: false,
            input: false,
        }
    }

    /// Whether it takes part in the inner product.
    pub fn measured(&self) -> bool {
        self.weight != Weight::Carried
    }
}

/// Checks names, lengths and weights of a state's fields.
pub(crate) fn check(fields: &[Field]) -> Result<()> {
    let bad = |name: &str, problem: String| Err(Error::Input(format!("dmd: field {name}: {problem}")));
    for (i, f) in fields.iter().enumerate() {
        if f.name.is_empty() || fields[..i].iter().any(|g| g.name == f.name) {
            return bad(&f.name, "expected a name that no other field has".into());
        }
        if f.components == 0 || !f.len.is_multiple_of(f.components.max(1)) {
            return bad(
                &f.name,
                format!("{} values of {} components: expected whole items", f.len, f.components),
            );
        }
        if let Weight::Items(w) = &f.weight {
            if w.len() * f.components != f.len {
                return bad(
                    &f.name,
                    format!("{} weights: expected {}, one an item", w.len(), f.len / f.components),
                );
            }
            if let Some(w) = w.iter().find(|w| !(w.is_finite() && **w >= 0.0)) {
                return bad(&f.name, format!("weight {w}: expected a finite number, not below 0"));
            }
        }
    }
    if !fields.iter().any(Field::measured) {
        return Err(Error::Input(
            "dmd: expected at least one field with a weight in the inner product".into(),
        ));
    }
    Ok(())
}
