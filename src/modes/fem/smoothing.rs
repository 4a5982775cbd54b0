//! Smoothed finite elements on any polygon or polyhedron: the formulation that locks neither in bending nor at nu
//! near 1/2.
//!
//! Displacements are linear in the tetrahedra (in 2-D triangles) that join an edge with the middle of a face and the
//! middle of the cell; a middle's displacement is the mean of its points'. No unknown is added, neighbours fit
//! together whatever their shapes, and linear displacements are exact. Three averages of the strain share the energy:
//!
//! - over all that surrounds an edge (edge-based smoothing, ES-FEM: Liu, Nguyen-Thoi, Lam, J. Sound Vib. 320, 2009),
//!   which takes away the parasitic shear of linear elements in bending: [`EDGES`] of it;
//! - over the cell, which is stiffer: the rest of it. The mixture is alpha-FEM's (Liu, Nguyen-Thoi, Lam 2008): edges
//!   alone are up to 2 % too soft on wedges;
//! - over all that surrounds a point (node-based smoothing), for the part of lambda above [`LIMIT`] mu only
//!   (selective smoothing: Onishi, Iida, Amaya 2017): so few volume constraints do not lock. Points of the surface
//!   join those inside (`volume.rs`): averages of their own would lock in bodies a few cells thick.
//!
//! Cells are averaged with cells of the same moduli only: strain jumps where moduli do.

use super::mesh::Cell;
use super::numbering::{Numbering, take};
use super::strain::{Strain, Term, send};
use super::volume::Shares;
use m4gn_base::{Error, Result, refuse_any};
use m4gn_mesh::vector::{cross, dot, sub};
use m4gn_parallel::Comm;

/// Share of the edges' strains in the energy; the cells' have the rest.
const EDGES: f64 = 0.9;

/// Multiple of mu up to which lambda goes with the shear: nu up to 1/3 needs no averages around points.
const LIMIT: f64 = 2.0;

/// The tetrahedra or triangles of a cell, summed up edge by edge.
struct Parts {
    /// Positions of each edge's ends.
    edges: Vec<[usize; 2]>,
    /// Volume around each edge within this cell.
    volume: Vec<f64>,
    /// Volume times gradient around each edge, for each of the cell's points.
    gradients: Vec<Vec<[f64; 3]>>,
    /// Mass matrix for unit density.
    mass: Vec<f64>,
}

/// Stiffness of all cells of this rank, complete for what this rank is to assemble, and unit masses of its cells.
///
/// `x` are the points (in 2-D with the third coordinate zero), `moduli` (lambda, mu) of each cell, `averages`
/// where the volume averages around each local point go. Collective; all ranks fail together.
pub(super) fn strains(
    cells: &[Cell],
    x: &[[f64; 3]],
    moduli: &[(f64, f64)],
    numbering: &Numbering,
    averages: &[Shares],
    comm: &Comm,
) -> Result<(Vec<Strain>, Vec<Vec<f64>>)> {
    let parts: Result<Vec<Parts>> = cells.iter().enumerate().map(|(c, cell)| parts(c, cell, x)).collect();
    let parts = comm.agree(parts)?;
    let mut strains = Vec::new();
    let mut shared: Vec<Domain> = Vec::new();
    let mut masses = Vec::with_capacity(cells.len());
    for ((cell, part), &(lambda, mu)) in cells.iter().zip(parts).zip(moduli) {
        let numbers: Vec<i64> = cell.points.iter().map(|&p| numbering.number[p].unwrap_or(-1)).collect();
        let low = if lambda > LIMIT * mu { LIMIT * mu } else { lambda };
        let whole = Domain {
            key: [-1, -1],
            moduli: [low, mu],
            volume: part.volume.iter().sum(),
            points: numbers.clone(),
            gradients: (0..numbers.len()).map(|i| sum(part.gradients.iter().map(|g| g[i]))).collect(),
        };
        strains.push(whole.strain(1.0 - EDGES));
        for ((&[a, b], &volume), gradients) in part.edges.iter().zip(&part.volume).zip(&part.gradients) {
            let (a, b) = (numbers[a], numbers[b]);
            shared.push(Domain {
                key: [a.min(b), a.max(b)],
                moduli: [low, mu],
                volume,
                points: numbers.clone(),
                gradients: gradients.clone(),
            });
        }
        if lambda > low {
            shared.extend(around_points(cell, &numbers, &part, lambda - low, averages));
        }
        masses.push(part.mass);
    }
    // An edge's cells may be on several ranks: the owner of one end brings them together.
    let shared = send(shared, comm, |domain: &Domain, ranks| ranks.push(numbering.owner(domain.key[0])));
    for domain in merge(shared) {
        let share = if domain.key[1] < 0 { 1.0 } else { EDGES };
        strains.push(domain.strain(share));
    }
    Ok((strains, masses))
}

/// A cell's share in the averages around points: half of each edge's for either end.
fn around_points(
    cell: &Cell,
    numbers: &[i64],
    part: &Parts,
    lambda: f64,
    averages: &[Shares],
) -> Vec<Domain> {
    let n = numbers.len();
    let mut domains: Vec<Domain> = Vec::new();
    for (ends, (&size, slopes)) in part.edges.iter().zip(part.volume.iter().zip(&part.gradients)) {
        for &(average, share) in ends.iter().flat_map(|&end| &averages[cell.points[end]]) {
            let key = [average, -1];
            let at = domains.iter().position(|d| d.key == key).unwrap_or_else(|| {
                domains.push(Domain {
                    key,
                    moduli: [lambda, 0.0],
                    volume: 0.0,
                    points: numbers.to_vec(),
                    gradients: vec![[0.0; 3]; n],
                });
                domains.len() - 1
            });
            domains[at].volume += 0.5 * share * size;
            for (to, g) in domains[at].gradients.iter_mut().zip(slopes) {
                for d in 0..3 {
                    to[d] += 0.5 * share * g[d];
                }
            }
        }
    }
    domains
}

/// Part of an average, or all of it.
#[derive(Clone, Debug)]
struct Domain {
    /// The edge's ends, or the point and -1.
    key: [i64; 2],
    /// lambda and mu, Pa.
    moduli: [f64; 2],
    /// Volume, m^3.
    volume: f64,
    /// Numbers of the points.
    points: Vec<i64>,
    /// Volume times gradients, m^2.
    gradients: Vec<[f64; 3]>,
}

impl Term for Domain {
    fn points(&self) -> &[i64] {
        &self.points
    }

    fn values(&self, to: &mut Vec<f64>) {
        // Numbers below 2^53 are exact as doubles.
        to.extend([self.key[0] as f64, self.key[1] as f64]);
        to.extend(self.moduli);
        to.push(self.volume);
        to.extend(self.gradients.iter().flatten());
    }

    fn from_parts(points: Vec<i64>, values: &mut &[f64]) -> Self {
        let (head, gradients) = (take(values, 5), take(values, 3 * points.len()));
        Domain {
            key: [head[0] as i64, head[1] as i64],
            moduli: [head[2], head[3]],
            volume: head[4],
            gradients: gradients.chunks_exact(3).map(|g| [g[0], g[1], g[2]]).collect(),
            points,
        }
    }
}

impl Domain {
    fn strain(self, share: f64) -> Strain {
        let volume = self.volume;
        Strain {
            lambda: share * volume * self.moduli[0],
            mu: share * volume * self.moduli[1],
            points: self.points,
            gradients: self.gradients.iter().map(|g| g.map(|v| v / volume)).collect(),
        }
    }
}

/// Joins the domains of the same edge or point and the same moduli.
fn merge(mut domains: Vec<Domain>) -> Vec<Domain> {
    let order = |d: &Domain| (d.key, d.moduli.map(f64::to_bits));
    // Points as a tie-break: the sum does not depend on who sent first.
    domains.sort_by(|a, b| order(a).cmp(&order(b)).then_with(|| a.points.cmp(&b.points)));
    let mut merged: Vec<Domain> = Vec::new();
    for group in domains.chunk_by(|a, b| order(a) == order(b)) {
        let mut points: Vec<i64> = group.iter().flat_map(|d| d.points.iter().copied()).collect();
        points.sort_unstable();
        points.dedup();
        let mut gradients = vec![[0.0; 3]; points.len()];
        for domain in group {
            for (p, g) in domain.points.iter().zip(&domain.gradients) {
                let to = &mut gradients[points.partition_point(|q| q < p)];
                for d in 0..3 {
                    to[d] += g[d];
                }
            }
        }
        merged.push(Domain {
            key: group[0].key,
            moduli: group[0].moduli,
            volume: group.iter().map(|d| d.volume).sum(),
            points,
            gradients,
        });
    }
    merged
}

fn sum(vectors: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    vectors.fold([0.0; 3], |s, v| [s[0] + v[0], s[1] + v[1], s[2] + v[2]])
}

/// Divides a cell.
fn parts(number: usize, cell: &Cell, x: &[[f64; 3]]) -> Result<Parts> {
    let n = cell.points.len();
    let position = |p: usize| x[cell.points[p]];
    let middle = |points: &[usize]| sum(points.iter().map(|&p| position(p))).map(|v| v / points.len() as f64);
    let all: Vec<usize> = (0..n).collect();
    let centre = middle(&all);
    let mut parts =
        Parts { edges: Vec::new(), volume: Vec::new(), gradients: Vec::new(), mass: vec![0.0; n * n] };
    for face in &cell.faces {
        let solid = face.len() > 2;
        let sides = if solid { face.len() } else { 1 };
        for i in 0..sides {
            let (a, b) = (face[i], face[(i + 1) % face.len()]);
            // Each vertex of the tetrahedron as a mean of the cell's points.
            let ends = [a, b];
            let mut means: Vec<&[usize]> = vec![&all, face, &ends[..1], &ends[1..]];
            let mut corners = vec![centre, middle(face), position(a), position(b)];
            if !solid {
                means.remove(1);
                corners.remove(1);
            }
            let (volume, slopes) = simplex(&corners);
            let key = [a.min(b), a.max(b)];
            let e = parts.edges.iter().position(|&k| k == key).unwrap_or_else(|| {
                parts.edges.push(key);
                parts.volume.push(0.0);
                parts.gradients.push(vec![[0.0; 3]; n]);
                parts.edges.len() - 1
            });
            parts.volume[e] += volume;
            for (mean, slope) in means.iter().zip(slopes) {
                for &p in mean.iter() {
                    for (to, slope) in parts.gradients[e][p].iter_mut().zip(slope) {
                        *to += slope / mean.len() as f64;
                    }
                }
            }
            add_mass(&mut parts.mass, n, &means, volume);
        }
    }
    let bad = parts.volume.iter().position(|&v| !(v > 0.0 && v.is_finite()));
    refuse_any(bad, Error::Mesh, |e| {
        let ([a, b], volume) = (parts.edges[e].map(|p| cell.points[p]), parts.volume[e]);
        format!(
            "cell {number} at {centre:?} is inverted, flat or folded: the volume between its middle and the edge of points {a} \
             and {b} is {volume}, expected a positive one; run checkMesh"
        )
    })?;
    Ok(parts)
}

/// Adds the mass of a tetrahedron (triangle) with linear shape functions, volume / 20 (1 + delta) (/ 12).
fn add_mass(mass: &mut [f64], n: usize, means: &[&[usize]], volume: f64) {
    let k = means.len() as f64;
    let unit = volume / (k * (k + 1.0));
    let mut total = vec![0.0; n];
    for mean in means {
        let w = 1.0 / mean.len() as f64;
        for &p in mean.iter() {
            total[p] += w;
            for &q in mean.iter() {
                mass[p * n + q] += unit * w * w;
            }
        }
    }
    for p in 0..n {
        for q in 0..n {
            mass[p * n + q] += unit * total[p] * total[q];
        }
    }
}

/// Volume of a tetrahedron, or area of a triangle in x and y, and volume times the gradient of each vertex's shape
/// function.
fn simplex(x: &[[f64; 3]]) -> (f64, Vec<[f64; 3]>) {
    let from = |i: usize| sub(x[i], x[0]);
    let mut slopes = vec![[0.0; 3]; x.len()];
    let volume;
    if let [_, _, _] = x {
        let (a, b) = (from(1), from(2));
        volume = 0.5 * (a[0] * b[1] - a[1] * b[0]);
        slopes[1] = [0.5 * b[1], -0.5 * b[0], 0.0];
        slopes[2] = [-0.5 * a[1], 0.5 * a[0], 0.0];
    } else {
        let (a, b, c) = (from(1), from(2), from(3));
        slopes[1] = cross(b, c).map(|v| v / 6.0);
        slopes[2] = cross(c, a).map(|v| v / 6.0);
        slopes[3] = cross(a, b).map(|v| v / 6.0);
        volume = dot(a, slopes[1]);
    }
    let all = sum(slopes.iter().copied());
    slopes[0] = all.map(|v| -v);
    (volume, slopes)
}
