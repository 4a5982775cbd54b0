//! How a push at one point of a body moves the others: a smooth kernel of their distance at rest.

use m4gn_mesh::body::Body;
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::vector::{Vector, dot, sub};

/// Distance from held points over which a point becomes free, mean edges.
const RAMP: f64 = 2.0;

/// The compliance `C[p, q] = s_p s_q w(|X_p - X_q| / R)` between points, the same for each component.
///
/// `w(r) = (1 - r)^4 (4 r + 1)` for r < 1, Wendland's C2 function, which is positive definite in three dimensions
/// (Wendland 1995), `s` rises from 0 at held points to 1, and parts of a body that hang together nowhere do not feel
/// each other. Corrections are `C f` for pushes f: of all fields that meet the same constraints it is the one of least
/// norm in the space that belongs to the kernel, so that it is as smooth as the contact allows.
#[derive(Clone, Debug)]
pub(super) struct Compliance {
    rest: Vec<Vector>,
    freedom: Vec<f64>,
    component: Vec<u32>,
}

impl Compliance {
    /// `cell`: mean edge, m.
    pub(super) fn new(body: &Body, held: &[bool], cell: f64) -> Self {
        let component = body.elements.parts(body.positions.len());
        let mut freedom = vec![1.0; held.len()];
        for c in 0..component.iter().copied().max().map_or(0, |c| c + 1) {
            let of = |p: &usize| component[*p] == c;
            let fixed = (0..held.len()).filter(of).filter(|&p| held[p]);
            let fixed: Vec<Vector> = fixed.map(|p| body.positions[p]).collect();
            let fixed = Nearest::new(&fixed);
            for p in (0..held.len()).filter(of) {
                let t = (fixed.distance_squared(body.positions[p]).sqrt() / (RAMP * cell)).min(1.0);
                freedom[p] = t * (2.0 - t);
            }
        }
        Compliance { rest: body.positions.clone(), freedom, component }
    }

    /// Entry of two points; `radius` R in m.
    pub(super) fn between(&self, p: usize, q: usize, radius: f64) -> f64 {
        if self.component[p] != self.component[q] {
            return 0.0;
        }
        let away = sub(self.rest[p], self.rest[q]);
        let square = dot(away, away) / (radius * radius);
        if square >= 1.0 {
            return 0.0;
        }
        let r = square.sqrt();
        let near = (1.0 - r) * (1.0 - r);
        self.freedom[p] * self.freedom[q] * near * near * (4.0 * r + 1.0)
    }

    /// Displacement of all points `[N]` under `pushes` at some.
    pub(super) fn spread(&self, pushes: &[(usize, Vector)], radius: f64) -> Vec<Vector> {
        let mut moved = vec![[0.0; 3]; self.rest.len()];
        for &(q, f) in pushes.iter().filter(|(_, f)| *f != [0.0; 3]) {
            for (p, u) in moved.iter_mut().enumerate() {
                let c = self.between(p, q, radius);
                if c > 0.0 {
                    for i in 0..3 {
                        u[i] += c * f[i];
                    }
                }
            }
        }
        moved
    }
}
