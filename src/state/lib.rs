//! The state of a solver: what crosses between a host and a surrogate.
//!
//! A host describes its arrays once ([`Layout`]), and hands their values over as a list in that order. A network reads and writes the
//! arrays that it knows by name; a fit takes all of them.

use m4gn_base::{Error, Result, refuse};

/// Where an array has its values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// The nodes of a solver with its unknowns in cells.
    Cells,
    /// The nodes of a solver with its unknowns at mesh points.
    Points,
    /// Internal faces, or any other items.
    Faces,
    /// Boundary faces: first those of the mesh that carry values, in its order.
    Boundary,
}

/// What an array is to a surrogate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// At the nodes, with an equation in time: it is advanced and measured, and a fit is made of it.
    Solved,
    /// At the nodes, and follows from the solved ones (an incompressible pressure): it is advanced and measured.
    Follows,
    /// Not measured (fluxes, boundary values): a fit advances it with the solved ones.
    Carried,
    /// The host knows its values at later times: no surrogate advances it.
    Prescribed,
    /// One number a boundary face: not 0 where the face holds its value, 0 where it has that of its cell.
    Held,
}

/// An array of the state on this rank.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Unique among the arrays of its place and role.
    pub name: String,
    /// Where its values are.
    pub place: Place,
    /// What it is to a surrogate.
    pub role: Role,
    /// Numbers an item.
    pub components: usize,
    /// How many of them are solved: 1 of a scalar, the solved directions of a vector.
    pub solved: usize,
    /// Items of this rank.
    pub items: usize,
    /// Least value that is physical.
    pub floor: Option<f64>,
    /// What a fit is weighted by, one an item (volumes of the nodes); empty: 1 each.
    pub weights: Vec<f64>,
}

impl Array {
    /// An array at cells with an equation in time.
    pub fn solved(name: &str, components: usize, weights: Vec<f64>) -> Self {
        Array {
            name: name.to_string(),
            place: Place::Cells,
            role: Role::Solved,
            components,
            solved: components,
            items: weights.len(),
            floor: None,
            weights,
        }
    }

    /// Numbers that are carried along.
    pub fn carried(name: &str, items: usize) -> Self {
        Array {
            name: name.to_string(),
            place: Place::Faces,
            role: Role::Carried,
            components: 1,
            solved: 0,
            items,
            floor: None,
            weights: Vec::new(),
        }
    }

    /// Numbers of this rank.
    pub fn numbers(&self) -> usize {
        self.items * self.components
    }

    /// Whether surrogates are measured by it.
    pub fn is_measured(&self) -> bool {
        matches!(self.role, Role::Solved | Role::Follows)
    }

    fn is_at_nodes(&self) -> bool {
        matches!(self.place, Place::Cells | Place::Points)
    }

    fn check(&self) -> Result<()> {
        let bad = |what: String| Err(Error::Input(format!("array {}: {what}", self.name)));
        if self.name.is_empty() || self.components == 0 || self.items.checked_mul(self.components).is_none() {
            return bad(format!(
                "{} items of {} components: expected a name, and at least 1 component",
                self.items, self.components
            ));
        }
        if self.is_measured() && !(self.is_at_nodes() && (1..=self.components).contains(&self.solved)) {
            return bad(format!(
                "{} of {} components are solved: expected an array at cells or points, with 1 to all of them",
                self.solved, self.components
            ));
        }
        if self.role == Role::Held && !(self.place == Place::Boundary && self.components == 1) {
            return bad("expected one number a boundary face, which says whether it holds its value".into());
        }
        if !self.weights.is_empty() && self.weights.len() != self.items {
            return bad(format!("{} weights: expected {}, one an item", self.weights.len(), self.items));
        }
        if let Some(w) = self.weights.iter().find(|w| !(w.is_finite() && **w >= 0.0)) {
            return bad(format!("weight {w}: expected a finite number, not below 0"));
        }
        match self.floor {
            Some(floor) if !floor.is_finite() => bad(format!("floor {floor}: expected a finite number")),
            _ => Ok(()),
        }
    }
}

/// The arrays of a state, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    arrays: Vec<Array>,
}

/// The numbers of a state, array after array.
pub type Values = Vec<Vec<f64>>;

impl Layout {
    /// Of these arrays.
    ///
    /// # Errors
    /// [`Error::Input`] for arrays that cannot be, two of one name, or measured ones of different nodes.
    pub fn new(arrays: Vec<Array>) -> Result<Self> {
        for (i, array) in arrays.iter().enumerate() {
            array.check()?;
            let key = |a: &Array| (a.place, a.role == Role::Held);
            if arrays[..i].iter().any(|a| a.name == array.name && key(a) == key(array)) {
                return Err(Error::Input(format!(
                    "array {}: another one has its name and place",
                    array.name
                )));
            }
        }
        let mut measured = arrays.iter().filter(|a| a.is_measured());
        if let Some(first) = measured.next()
            && let Some(other) = measured.find(|a| (a.place, a.items) != (first.place, first.items))
        {
            return Err(Error::Input(format!(
                "arrays {} and {} are measured, with {} and {} items: expected those of the same nodes",
                first.name, other.name, first.items, other.items
            )));
        }
        Ok(Layout { arrays })
    }

    /// The arrays.
    pub fn arrays(&self) -> &[Array] {
        &self.arrays
    }

    /// Those of these places in the list.
    pub fn pick(&self, which: &[usize]) -> Vec<&Array> {
        which.iter().map(|&i| &self.arrays[i]).collect()
    }

    /// The arrays that surrogates are measured by.
    pub fn measured(&self) -> Vec<usize> {
        (0..self.arrays.len()).filter(|&i| self.arrays[i].is_measured()).collect()
    }

    /// The values of a field at the nodes.
    pub fn at_nodes(&self, name: &str) -> Option<usize> {
        self.arrays.iter().position(|a| a.name == name && a.is_at_nodes())
    }

    /// The values of a field at boundary faces.
    pub fn at_boundary(&self, name: &str) -> Option<usize> {
        let found = |a: &Array| a.name == name && a.place == Place::Boundary && a.role != Role::Held;
        self.arrays.iter().position(found)
    }

    /// Which boundary faces hold the values of a field.
    pub fn held(&self, name: &str) -> Option<usize> {
        self.arrays.iter().position(|a| a.name == name && a.role == Role::Held)
    }

    /// Whether the host knows some of them beforehand.
    pub fn is_prescribed(&self) -> bool {
        self.arrays.iter().any(|a| a.role == Role::Prescribed)
    }

    /// Nodes of this rank, by the measured arrays; none: there are none of these.
    pub fn rows(&self) -> Option<usize> {
        self.arrays.iter().find(|a| a.is_measured()).map(|a| a.items)
    }

    /// Checks the numbers of a state.
    ///
    /// # Errors
    /// [`Error::Input`] for another number of arrays, or of numbers in one; [`Error::Numerical`] where a measured one is not finite.
    pub fn check(&self, state: &[&[f64]]) -> Result<()> {
        refuse(state.len() != self.arrays.len(), Error::Input, || {
            format!("a state of {} arrays: expected {}, as described", state.len(), self.arrays.len())
        })?;
        if let Some((a, values)) = self.arrays.iter().zip(state).find(|(a, v)| a.numbers() != v.len()) {
            return Err(Error::Input(format!(
                "array {}: expected {} numbers, found {}",
                a.name,
                a.numbers(),
                values.len()
            )));
        }
        for (a, values) in self.arrays.iter().zip(state).filter(|(a, _)| a.is_measured()) {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                let item = i / a.components.max(1);
                return Err(Error::Numerical(format!("array {}: {} at item {item}", a.name, values[i])));
            }
        }
        Ok(())
    }

    /// What all ranks must have alike.
    pub fn shared(&self) -> String {
        let one = |a: &Array| {
            format!("{} {:?} {:?} {} {} {:?}\n", a.name, a.place, a.role, a.components, a.solved, a.floor)
        };
        self.arrays.iter().map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_found_by_name_and_place() {
        let at = |place, role| Array { place, role, ..Array::carried("U", 3) };
        let layout = Layout::new(vec![
            Array { solved: 2, ..Array::solved("U", 3, vec![1.0; 4]) },
            at(Place::Boundary, Role::Carried),
            at(Place::Boundary, Role::Held),
            Array { role: Role::Follows, ..Array::solved("p", 1, vec![1.0; 4]) },
        ])
        .unwrap();
        assert_eq!(
            (layout.at_nodes("U"), layout.at_boundary("U"), layout.held("U")),
            (Some(0), Some(1), Some(2))
        );
        assert_eq!((layout.at_nodes("phi"), layout.measured(), layout.rows()), (None, vec![0, 3], Some(4)));
        assert!(!layout.is_prescribed());
        let (u, b) = ([0.0; 12], [0.0; 3]);
        layout.check(&[&u, &b, &b, &u[..4]]).unwrap();
        let short = layout.check(&[&u, &b, &b, &b]).unwrap_err().to_string();
        assert!(short.contains("array p: expected 4 numbers, found 3"), "{short}");
        assert!(layout.check(&[]).unwrap_err().to_string().contains("0 arrays: expected 4"));
    }

    #[test]
    fn what_cannot_be_is_named() {
        let good = || Array::solved("T", 1, vec![1.0; 2]);
        for (arrays, words) in [
            (vec![good(), good()], "another one has its name"),
            (vec![good(), Array::solved("k", 1, vec![1.0; 3])], "arrays T and k"),
            (vec![Array { solved: 2, ..good() }], "2 of 1 components"),
            (vec![Array { components: 0, ..good() }], "0 components"),
            (vec![Array { weights: vec![1.0], ..good() }], "1 weights: expected 2"),
            (vec![Array { weights: vec![1.0, f64::NAN], ..good() }], "weight NaN"),
            (vec![Array { floor: Some(f64::NAN), ..good() }], "floor NaN"),
            (vec![Array { place: Place::Faces, ..good() }], "at cells or points"),
            (vec![Array { role: Role::Held, ..Array::carried("U", 3) }], "one number a boundary face"),
            (vec![Array::carried("", 3)], "expected a name"),
        ] {
            let error = Layout::new(arrays).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }
}
