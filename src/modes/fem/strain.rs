//! Where the stiffness and the mass come from: sums of small terms, each over a few points.

use super::numbering::{Numbering, take};
use m4gn_parallel::Comm;

/// A strain that is taken as constant over some volume, and its energy
/// `1/2 (lambda (tr e)^2 + 2 mu e : e)`, with e the symmetric part of `sum_i u_i (x) g_i`.
///
/// A stiffness matrix is a sum of these, one for each smoothing domain.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Strain {
    /// Volume times Lamé's first parameter, J.
    pub lambda: f64,
    /// Volume times the shear modulus, J.
    pub mu: f64,
    /// Numbers of the points.
    pub points: Vec<i64>,
    /// Gradient of each point's shape function, 1/m.
    pub gradients: Vec<[f64; 3]>,
}

/// The mass of one cell between its points, kg: symmetric, row after row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct CellMass {
    /// Numbers of the points.
    pub points: Vec<i64>,
    /// Mass matrix, `points x points`.
    pub mass: Vec<f64>,
}

/// Something over a few points that can be sent.
pub(super) trait Term: Sized {
    /// The points.
    fn points(&self) -> &[i64];
    /// Everything but the points.
    fn values(&self, to: &mut Vec<f64>);
    /// The way back; `values` starts with this term's and is moved on to the next one's.
    fn from_parts(points: Vec<i64>, values: &mut &[f64]) -> Self;
}

impl Term for Strain {
    fn points(&self) -> &[i64] {
        &self.points
    }

    fn values(&self, to: &mut Vec<f64>) {
        to.extend([self.lambda, self.mu]);
        to.extend(self.gradients.iter().flatten());
    }

    fn from_parts(points: Vec<i64>, values: &mut &[f64]) -> Self {
        let moduli = take(values, 2);
        Strain {
            lambda: moduli[0],
            mu: moduli[1],
            gradients: take(values, 3 * points.len()).chunks_exact(3).map(|g| [g[0], g[1], g[2]]).collect(),
            points,
        }
    }
}

impl Term for CellMass {
    fn points(&self) -> &[i64] {
        &self.points
    }

    fn values(&self, to: &mut Vec<f64>) {
        to.extend_from_slice(&self.mass);
    }

    fn from_parts(points: Vec<i64>, values: &mut &[f64]) -> Self {
        CellMass { mass: take(values, points.len() * points.len()).to_vec(), points }
    }
}

/// Sends each term to the ranks that `to` names for it, this one included or not; returns what this rank is to
/// have. Collective.
pub(super) fn send<T: Term>(terms: Vec<T>, comm: &Comm, to: impl Fn(&T, &mut Vec<usize>)) -> Vec<T> {
    if comm.size() == 1 {
        return terms;
    }
    let (size, here) = (comm.size() as usize, comm.rank() as usize);
    let (mut points, mut values) = (vec![Vec::new(); size], vec![Vec::new(); size]);
    let mut keep = Vec::with_capacity(terms.len());
    let mut ranks = Vec::new();
    for term in terms {
        ranks.clear();
        to(&term, &mut ranks);
        ranks.sort_unstable();
        ranks.dedup();
        for &r in ranks.iter().filter(|&&r| r != here) {
            points[r].push(term.points().len() as i64);
            points[r].extend_from_slice(term.points());
            term.values(&mut values[r]);
        }
        if ranks.contains(&here) {
            keep.push(term);
        }
    }
    let (points, values) = (comm.all_to_all(&points), comm.all_to_all(&values));
    for (points, values) in points.iter().zip(&values) {
        let (mut points, mut values) = (&points[..], &values[..]);
        while let Some((&n, rest)) = points.split_first() {
            let (own, rest) = rest.split_at(n as usize);
            keep.push(T::from_parts(own.to_vec(), &mut values));
            points = rest;
        }
    }
    keep
}

/// Sends each term to the owners of its points, so that every rank can make the rows of its own. Collective.
pub(super) fn to_owners<T: Term>(terms: Vec<T>, numbering: &Numbering, comm: &Comm) -> Vec<T> {
    send(terms, comm, |term, ranks| {
        ranks.extend(term.points().iter().map(|&p| numbering.owner(p)));
    })
}
