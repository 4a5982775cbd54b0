//! Fields of a flow as a host has them, and steps of a session.

use m4gn_base::Result;
use m4gn_step::{Field, FieldMut, Session};

/// U and p at cells and boundary faces.
pub struct Flow {
    pub u: Vec<f64>,
    pub u_boundary: Vec<f64>,
    pub p: Vec<f64>,
    pub p_boundary: Vec<f64>,
}

impl Flow {
    pub fn fields(&self) -> [Field<'_>; 2] {
        [
            Field { name: "U", components: 3, cells: &self.u, boundary: &self.u_boundary },
            Field { name: "p", components: 1, cells: &self.p, boundary: &self.p_boundary },
        ]
    }

    /// A step from these fields. The places of the next ones are in another order.
    pub fn step(&self, session: &mut Session, u: &mut [f64], p: &mut [f64]) -> Result<()> {
        let places = [("p", 1, p), ("U", 3, u)];
        let mut places = places.map(|(name, components, cells)| FieldMut { name, components, cells });
        session.step(&self.fields(), &mut places)
    }
}
