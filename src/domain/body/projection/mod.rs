//! Contact that does not interpenetrate: after a surrogate's step a body is pushed out of a rigid obstacle, its parts out of each
//! other (two beams, one upon the other), and, if asked for, each part out of itself.
//!
//! What is kept out are the samples of the skin that [`super::gap`] measures with: points, middles of edges, centroids
//! of faces. The correction c of the displacement is the smoothest one (see `kernel`) with
//!
//! `n_s . c(x_s) >= clearance - g_s` for every sample s near the obstacle,
//!
//! g_s its signed distance, n_s the direction in which that grows; held points stay. Distances are taken again where
//! the correction leads and the constraints rebuilt from there, until the worst gap is within the tolerance. Where cells
//! would be turned inside out, loose points go along, the correction is spread wider, and at last taken back there. The
//! answer is a function of the state alone, and a state without penetration and with valid cells is left as it is to the bit.
//! Cells that come inside out are brought back first: what is pushed after that is a body.

mod kernel;
mod near;
mod options;
mod pushes;
mod skin;
mod start;
#[cfg(test)]
mod tests;
mod validity;

use super::gap::{Gap, Samples, cell_size};
use kernel::Compliance;
use m4gn_base::{Error, Result};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::surface::{Surface, check_closed};
use m4gn_mesh::vector::{Vector, dot, norm, sub};
use near::{Near, REACH, out_of};
pub use options::ProjectionOptions;
use pushes::Constraints;
use skin::Skin;
use start::{check_apart, check_parts};
use std::collections::HashMap;
use validity::Corners;

/// Sweeps that may pass without a better gap.
const PATIENCE: usize = 3;
/// Times the correction is spread wider, and by how much each time.
const WIDER: (usize, f64) = (3, 1.6);

/// What a projection did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct ProjectionReport {
    /// Smallest gap to the obstacle before; None without obstacle.
    pub before: Option<Gap>,
    /// And after.
    pub after: Option<Gap>,
    /// Smallest gap before between parts that are near each other, and of the body to itself where that is asked for.
    pub own_before: Option<Gap>,
    /// And after.
    pub own_after: Option<Gap>,
    /// Points moved by more than the tolerance.
    pub points_moved: usize,
    /// Largest correction of a point, m.
    pub largest: f64,
    /// Times gaps were measured.
    pub sweeps: usize,
    /// Cells at which the correction had to be taken back to keep them valid.
    pub cells_pulled_back: usize,
    /// Cells that came inside out, and were brought back before.
    pub cells_untangled: usize,
}

/// Restores contact of one body and its obstacle, step after step.
#[derive(Clone, Debug)]
pub struct Projection {
    options: ProjectionOptions,
    cell: f64,
    rest: Vec<Vector>,
    held: Vec<bool>,
    obstacle: Option<Obstacle>,
    samples: Samples,
    compliance: Compliance,
    corners: Corners,
    skin: Skin,
}

/// Gaps at one state: of samples to the obstacle, and of the body to itself.
struct Measured {
    constraints: Constraints,
    gap: Option<Gap>,
    own: Option<Gap>,
}

impl Measured {
    /// The smallest gap of all, mean edges.
    fn worst(&self) -> f64 {
        let gaps = self.gap.iter().chain(&self.own).map(|g| g.cells);
        gaps.fold(f64::INFINITY, f64::min)
    }
}

/// Refuses an obstacle that overlaps the body at rest, and parts of the body that do, as [`Projection::new`] does.
///
/// # Errors
/// [`Error::Mesh`] for an obstacle that is no closed surface, or overlaps the body at rest, or parts that do: how deep and where.
pub fn check_start(body: &Body, obstacle: Option<&Obstacle>) -> Result<()> {
    let cell = cell_size(&body.positions, &body.edges);
    let (samples, skin) = sampled(body, cell);
    check(body, obstacle, &samples, &skin, cell)
}

/// The samples of a body's skin, and the skin.
fn sampled(body: &Body, cell: f64) -> (Samples, Skin) {
    let samples = Samples::new(&body.elements, |p| body.types[p as usize] != NodeType::Body);
    let skin = Skin::new(body, &samples, cell);
    (samples, skin)
}

fn check(body: &Body, obstacle: Option<&Obstacle>, samples: &Samples, skin: &Skin, cell: f64) -> Result<()> {
    if let Some(obstacle) = obstacle {
        check_closed(&obstacle.triangles)?;
        check_apart(body, obstacle, samples, skin, cell)?;
        obstacle.check(body)?;
    }
    check_parts(body, samples, skin, cell)
}

/// The smallest gap between the parts of a body, which share no point.
#[derive(Clone, Debug)]
pub struct BetweenParts {
    samples: Samples,
    skin: Skin,
}

impl BetweenParts {
    /// For a body of several parts; none of a body in one.
    pub fn new(body: &Body) -> Option<Self> {
        let (samples, skin) = sampled(body, cell_size(&body.positions, &body.edges));
        skin.has_parts().then_some(BetweenParts { samples, skin })
    }

    /// The smallest gap at `positions`, m; none where no two parts are near each other (1.5 mean edges).
    pub fn gap(&self, positions: &[Vector]) -> Option<Gap> {
        self.skin.parts_gap(&self.samples, positions)
    }
}

impl Projection {
    /// For a body and the obstacle it meets.
    ///
    /// # Errors
    /// [`Error::Input`] for an option out of range, [`Error::Mesh`] for an obstacle that is no closed surface or
    /// overlaps the body at rest, or a body without edges.
    pub fn new(body: &Body, obstacle: Option<&Obstacle>, options: &ProjectionOptions) -> Result<Self> {
        options.check()?;
        let positions = body.positions.iter().chain(obstacle.map_or(&[][..], |o| &o.positions));
        if let Some(x) = positions.flatten().find(|x| !x.is_finite()) {
            return Err(Error::Mesh(format!("a point at rest has the coordinate {x}")));
        }
        let cell = cell_size(&body.positions, &body.edges);
        if cell <= 0.0 {
            return Err(Error::Mesh("the body has no edges of any length".into()));
        }
        let held: Vec<bool> = body.types.iter().map(|&t| t != NodeType::Body).collect();
        let (samples, skin) = sampled(body, cell);
        check(body, obstacle, &samples, &skin, cell)?;
        Ok(Projection {
            options: *options,
            cell,
            rest: body.positions.clone(),
            compliance: Compliance::new(body, &held, cell),
            corners: Corners::new(body),
            held,
            obstacle: obstacle.cloned(),
            samples,
            skin,
        })
    }

    /// Mean rest edge, m: the unit of gaps.
    pub fn cell_size(&self) -> f64 {
        self.cell
    }

    /// Removes penetration from `displacement` `[N]`, m, where the obstacle is displaced by `obstacle` `[Q]`, m.
    ///
    /// What cannot be removed (held points in the way, cells that would not survive) stays and is reported.
    ///
    /// # Errors
    /// [`Error::Input`] for lengths that do not fit, [`Error::Numerical`] for values that are not finite; the
    /// displacement is then as it was.
    pub fn apply(
        &mut self,
        displacement: &mut [[f64; 3]],
        obstacle: &[[f64; 3]],
    ) -> Result<ProjectionReport> {
        let points = self.obstacle.as_ref().map_or(0, |o| o.positions.len());
        for (what, values, expected) in
            [("body", &*displacement, self.rest.len()), ("obstacle", obstacle, points)]
        {
            if values.len() != expected {
                return Err(Error::Input(format!(
                    "projection: displacements of {} points of the {what}, expected {expected}",
                    values.len()
                )));
            }
            if let Some(i) = values.iter().position(|u| u.iter().any(|v| !v.is_finite())) {
                return Err(Error::Numerical(format!(
                    "projection: the displacement of point {i} of the {what} is not finite"
                )));
            }
        }
        let came = displacement.to_vec();
        let cells_untangled = self.corners.untangle(&self.rest, displacement, &self.held);
        let start = sum(&self.rest, displacement);
        let surface = self.obstacle.as_ref().map(|o| {
            let place = sum(&o.positions, obstacle);
            Surface::open(&place, &o.triangles)
        });
        let mut near = Near::new(self.skin.normals(&start));
        let none = vec![[0.0; 3]; start.len()];
        let first = self.measure(surface.as_ref(), &start, &none, &mut near);
        let mut report = ProjectionReport {
            before: first.gap,
            after: first.gap,
            own_before: first.own,
            own_after: first.own,
            sweeps: 1,
            cells_untangled,
            ..ProjectionReport::default()
        };
        if self.is_met(first.worst()) {
            self.count_moved(&came, displacement, &mut report);
            return Ok(report);
        }

        let mut radius = self.options.radius * self.cell;
        let mut fewest = (usize::MAX, Vec::new());
        for _ in 0..=WIDER.0 {
            let (mut correction, firm) = self.push(surface.as_ref(), &start, radius, &mut near, &mut report);
            self.corners.ease(&start, &mut correction, &firm);
            let spoiled = self.corners.spoiled(&start, &sum(&start, &correction));
            if spoiled < fewest.0 {
                fewest = (spoiled, correction);
            }
            if spoiled == 0 {
                break;
            }
            radius *= WIDER.1;
        }
        let mut correction = fewest.1;
        report.cells_pulled_back = self.corners.pull_back(&start, &mut correction);

        for (u, (c, held)) in displacement.iter_mut().zip(correction.iter().zip(&self.held)) {
            if !*held {
                (0..3).for_each(|i| u[i] += c[i]);
            }
        }
        self.count_moved(&came, displacement, &mut report);
        let end = sum(&self.rest, displacement);
        report.after = surface.as_ref().and_then(|s| self.samples.worst_from(&end, s, self.cell));
        report.own_after = self.measure(None, &end, &none, &mut near).own;
        Ok(report)
    }

    fn count_moved(&self, came: &[Vector], left: &[Vector], report: &mut ProjectionReport) {
        for (a, b) in came.iter().zip(left).filter(|(a, b)| a != b) {
            let length = norm(sub(*b, *a));
            report.points_moved += usize::from(length > self.options.tolerance * self.cell);
            report.largest = report.largest.max(length);
        }
    }

    fn is_met(&self, gap: f64) -> bool {
        gap >= self.options.clearance - self.options.tolerance
    }

    /// The best correction that was met on the way, and which points are held or pushed by it.
    fn push(
        &self,
        surface: Option<&Surface>,
        start: &[Vector],
        radius: f64,
        near: &mut Near,
        report: &mut ProjectionReport,
    ) -> (Vec<Vector>, Vec<bool>) {
        let mut correction = vec![[0.0; 3]; start.len()];
        let mut firm = self.held.clone();
        let mut best = (f64::NEG_INFINITY, correction.clone(), firm.clone());
        let mut multipliers = HashMap::new();
        let mut idle = 0;
        for _ in 0..self.options.sweeps {
            let now = sum(start, &correction);
            let measured = self.measure(surface, &now, &correction, near);
            report.sweeps += 1;
            let worst = measured.worst();
            let is_met = self.is_met(worst);
            if worst > best.0 {
                best = (worst, correction, firm);
                idle = 0;
            } else {
                idle += 1;
            }
            if is_met || idle == PATIENCE {
                break;
            }
            let tolerance = 0.5 * self.options.tolerance * self.cell;
            let pushes = measured.constraints.solve(&self.compliance, radius, tolerance, &mut multipliers);
            correction = self.compliance.spread(&pushes, radius);
            firm = self.held.clone();
            let pushed = pushes.iter().filter(|(_, f)| *f != [0.0; 3]);
            pushed.for_each(|(p, _)| firm[*p] = true);
            // Far beyond any contact: the constraints contradict one another.
            if correction.as_flattened().iter().any(|v| !v.is_finite()) {
                break;
            }
        }
        (best.1, best.2)
    }

    /// Gaps of the body at `now`, of which the correction `done` is part, and the constraints that follow.
    fn measure(
        &self,
        surface: Option<&Surface>,
        now: &[Vector],
        done: &[Vector],
        near: &mut Near,
    ) -> Measured {
        let mut constraints = Constraints::default();
        let clearance = self.options.clearance * self.cell;
        let mut gap: Option<Gap> = None;
        if let Some(surface) = surface {
            let farthest = done.iter().map(|c| dot(*c, *c)).fold(0.0, f64::max).sqrt();
            let mut found = Vec::new();
            for s in 0..self.samples.len() {
                // Distances change by the correction at most.
                if near.least[s] - farthest > clearance && !near.taken[s] {
                    continue;
                }
                let x = self.samples.position(s, now);
                let beyond = surface.beyond_box(x);
                let limit = REACH * self.cell;
                let foot = match beyond < limit || near.taken[s] {
                    true => surface.foot(x),
                    false => None,
                };
                let distance = foot.map_or(beyond, |f| f.distance);
                if farthest == 0.0 {
                    near.least[s] = distance;
                }
                if gap.is_none_or(|g| distance < g.cells * self.cell) {
                    gap = Some(Gap { cells: distance / self.cell, at: x });
                }
                found.extend(foot.filter(|f| f.distance < limit || near.taken[s]).map(|f| (s, x, f)));
            }
            if farthest == 0.0 {
                near.deepest = gap.map_or(0.0, |g| (-g.cells * self.cell).max(0.0));
            }
            for (s, x, foot) in found {
                near.taken[s] = true;
                let foot = out_of(surface, x, foot, near.outward[s], near.deepest);
                let points = self.samples.points_of(s);
                let share = 1.0 / points.len() as f64;
                let least = clearance - foot.distance + dot(foot.normal, self.samples.position(s, done));
                constraints.add(s, points.iter().map(|&p| (p as usize, share)), foot.normal, least);
            }
        }
        let own = match self.options.self_contact || self.skin.has_parts() {
            true => self.skin.constrain(
                &self.samples,
                (now, done),
                (clearance, self.options.self_contact),
                &mut constraints,
            ),
            false => None,
        };
        Measured { constraints, gap, own }
    }
}

/// Point by point.
fn sum(a: &[Vector], b: &[Vector]) -> Vec<Vector> {
    a.iter().zip(b).map(|(a, b)| std::array::from_fn(|i| a[i] + b[i])).collect()
}
