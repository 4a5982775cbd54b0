//! How far a hybrid run is from the full run of the same case, and what it cost.
//!
//! Errors are root mean squares over cells and solved components (of a stress all nine), unweighted ([`crate::errors`]); over a
//! horizon also over its stored times, as the paper's RMSE-1, RMSE-50 (50 stored times) and RMSE-all. The headline is the velocity of a flow, the
//! displacement of a solid, the temperature of what has neither; the other fields that a surrogate may predict are compared where both runs stored
//! them. Errors count
//! from the takeover, the last time that the solver had computed before the surrogate first acted. "Hold last" keeps the full
//! run's field of that time. Of flows drag and lift are compared ([`forces`]), of solids the motion of a cell ([`motion`]) and
//! the force on a patch ([`reaction`]).

pub mod cost;
pub mod forces;
pub mod log;
mod mapping;
pub mod motion;
mod pairing;
pub mod reaction;
mod report;
mod series;
pub mod surrogate;
mod tables;

pub use crate::phase::PhaseFree;
pub use cost::Cost;
pub use series::Statistics;
pub(crate) use series::change;
pub use tables::Probe;

use crate::errors::{FieldErrors, Track};
use crate::foam_case::{Description, FoamCase, Patch};
use crate::phase::{Orbit, PERIODS};
use forces::{Forces, Reference};
use m4gn_base::{Error, Result, listed};
use m4gn_report::Snapshot;
use mapping::Mapping;
use motion::Motion;
use pairing::{common_times, mapping};
use reaction::Reaction;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// What the user may set.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Patch whose forces are compared; none: of a flow `cylinder` where there is one, of a solid none.
    pub patch: Option<String>,
    /// Of a solid: the patch beside whose centre a cell is followed; none: the cell that moves most.
    pub follow: Option<String>,
    /// Takeover, s; none: what the surrogate of B recorded.
    pub takeover: Option<f64>,
    /// Wall seconds of A; none: from its log, in whole seconds.
    pub wall_a: Option<f64>,
    /// Wall seconds of B; none: from its log, in whole seconds.
    pub wall_b: Option<f64>,
    /// Of a flow: whether B may have another mesh: its values are interpolated onto the cells of A.
    pub interpolate: bool,
    /// Of a flow: number of times that pictures are kept of.
    pub snapshots: usize,
}

/// The figures of a comparison; lists have one entry a common time after the takeover.
#[derive(Clone, Debug, Serialize)]
pub struct Comparison {
    /// Folder of the full run.
    pub case_a: String,
    /// Folder of the hybrid run.
    pub case_b: String,
    /// Number of cells.
    pub cells: usize,
    /// Number of cells of B.
    pub cells_b: usize,
    /// Last time that the solver had computed before the surrogate first acted, s; the first common time without one.
    pub takeover: f64,
    /// Common times after the takeover, s.
    pub times: Vec<f64>,
    /// What is compared first: the velocity U; a solid's displacement D; the temperature T where there is no velocity.
    #[serde(skip)]
    pub field: &'static str,
    /// Its errors.
    #[serde(skip)]
    pub headline: FieldErrors,
    /// What is left of the headline's error at the last time where a shift in time is taken out; none: the full run does not repeat itself.
    pub phase_free: Option<PhaseFree>,
    /// The other fields that both runs stored at all times, of a solid the stress `sigma`.
    pub fields: BTreeMap<String, FieldErrors>,
    /// Drag and lift of a flow; none: no forces were compared.
    #[serde(flatten)]
    pub forces: Option<Forces>,
    /// Why there are none of a patch that is looked at without being named.
    #[serde(skip)]
    pub no_forces: Option<String>,
    /// Motion of a solid; none of a flow.
    #[serde(flatten)]
    pub motion: Option<Motion>,
    /// What the tables of probes of both runs tell from the takeover on.
    pub probes: Vec<Probe>,
    /// Of a solid: force on the patch that was named; none: none was.
    pub reaction: Option<Reaction>,
    /// What both runs took.
    #[serde(flatten)]
    pub cost: Cost,
    /// Replaced part of B's simulated time after start-up.
    pub replaced_fraction: Option<f64>,
    /// Summary of B's surrogate.
    pub surrogate: Option<Value>,
}

/// The patch whose forces are compared without being named.
const DEFAULT_PATCH: &str = "cylinder";

/// Scalar fields that surrogates of flows predict.
const SCALARS: [&str; 3] = ["p", "p_rgh", "T"];

/// Whether a case is a solid's: it has a displacement and no pressure at its last time. (The velocity `U` does not tell:
/// solids4foam writes that of the solid.)
///
/// # Errors
/// [`Error::File`] when the case cannot be read.
pub fn is_solid(case: &mut FoamCase) -> Result<bool> {
    let Some(last) = case.description().times.len().checked_sub(1) else {
        return Ok(false);
    };
    Ok(case.has_field("D", last)? && !case.has_field("p", last)?)
}

/// Compares B (hybrid) with A (full). `progress(done, of)` is called once a time. There are pictures of flows only.
///
/// # Errors
/// Different meshes, no common times, an unknown patch, a missing or non-finite field, options of a flow for a solid and the
/// other way round, a solid that does not move.
pub fn compare(
    a: &mut FoamCase,
    b: &mut FoamCase,
    options: &Options,
    mut progress: impl FnMut(usize, usize),
) -> Result<(Comparison, Vec<Snapshot>)> {
    let solid = is_solid(a)?;
    options.check(solid, &a.description().path)?;
    let mapping = mapping(a, b, options.interpolate)?;
    let surrogate = surrogate::read(Path::new(&b.description().path))?;
    let (hold, pairs) = common_times(a, b, options.takeover.or(surrogate.as_ref().map(|s| s.takeover)))?;
    let directions = a.description().directions.clone();
    let takeover = a.description().times[hold.0];
    let times: Vec<f64> = pairs.iter().map(|p| a.description().times[p.0]).collect();

    let not_asked = |e| match (&options.patch, e) {
        (None, Error::Input(why)) => Ok(why),
        (_, e) => Err(e),
    };
    let (mut forces, mut no_forces) = (None, None);
    if !solid {
        match Reference::find(a, options, hold.0) {
            Ok(found) => forces = found.map(Forces::new),
            Err(e) => no_forces = Some(not_asked(e)?),
        }
    }
    let mut reaction = match &options.patch {
        Some(patch) if solid => {
            Some(reaction::Track::new(a, b, patch, surrogate::jumps(Path::new(&b.description().path))?)?)
        }
        _ => None,
    };
    let last = pairs[pairs.len() - 1].0;
    let name = match (solid, a.has_field("U", last)? || !a.has_field("T", last)?) {
        (true, _) => "D",
        (false, true) => "U",
        (false, false) => "T",
    };
    let n = if name == "T" { 1 } else { directions.len() };
    let mut headline = Track::new(values(a, (name, hold.0), &Mapping::Same, &directions)?);
    let mut others = other_fields(a, b, name, hold, &pairs)?;
    let mut stress = if solid { a.stress(hold.0)?.map(Track::new) } else { None };
    let kept = choose(pairs.len(), if solid { 0 } else { options.snapshots });
    let (mut snapshots, mut displacements) = (Vec::new(), motion::Fields::default());
    for (done, &(i, j)) in pairs.iter().enumerate() {
        let va = values(a, (name, i), &Mapping::Same, &directions)?;
        let vb = values(b, (name, j), &mapping, &directions)?;
        headline.add(&va, &vb);
        for (name, track) in &mut others {
            let other = mapping.scalar(b.scalar_field(name, j)?);
            track.add(&a.scalar_field(name, i)?, &other);
        }
        if let Some(found) = &mut forces
            && let Err(e) = found.add(a, b, (i, j))
        {
            (forces, no_forces) = (None, Some(not_asked(e)?));
        }
        if let Some(reaction) = &mut reaction {
            reaction.add(a, b, (i, j))?;
        }
        if let Some(track) = &mut stress {
            match (a.stress(i)?, b.stress(j)?) {
                (Some(of_a), Some(of_b)) => track.add(&of_a, &of_b),
                // The errors of some times are not those of the run
                _ => stress = None,
            }
        }
        if kept.contains(&done) {
            snapshots.push(Snapshot::new(times[done], &va, &vb, n));
        }
        if solid {
            displacements[0].push(a.vector_field(name, i)?);
            displacements[1].push(b.vector_field(name, j)?);
        }
        progress(done + 1, pairs.len());
    }
    others.extend(stress.map(|track| ("sigma", track)));
    let headline = headline.finish();
    let motion = match solid {
        true => Some(Motion::new(a, options, &displacements, (takeover, &times), &headline)?),
        false => None,
    };
    let forces = forces.map(|f| f.finish([a.description(), b.description()], takeover, &times));
    let period = match (&forces, &motion) {
        (Some(forces), _) => forces.frequency[0],
        (_, Some(motion)) => motion.frequency[0],
        _ => None,
    };
    let phase_free = match (period.map(|frequency| 1.0 / frequency), pairs.last()) {
        (Some(period), Some(&(_, last))) => {
            let from = times.partition_point(|t| *t < times[times.len() - 1] - PERIODS * period);
            let of_a = pairs[from..].iter().map(|p| values(a, (name, p.0), &Mapping::Same, &directions));
            let fields = of_a.collect::<Result<Vec<_>>>()?;
            let found = values(b, (name, last), &mapping, &directions)?;
            Orbit::new(&times[from..], fields, period).map(|orbit| orbit.nearest(&found))
        }
        _ => None,
    };
    let comparison = Comparison {
        case_a: a.description().path.clone(),
        case_b: b.description().path.clone(),
        cells: a.description().cells,
        cells_b: b.description().cells,
        takeover,
        field: name,
        headline,
        fields: others.iter().map(|(n, t)| (n.to_string(), t.finish())).collect(),
        forces,
        no_forces,
        phase_free,
        probes: tables::probes([a.description(), b.description()], takeover),
        motion,
        reaction: reaction.map(reaction::Track::finish),
        cost: Cost::of(a, b, takeover, options),
        replaced_fraction: surrogate.as_ref().and_then(|s| s.replaced_fraction),
        surrogate: surrogate.map(|s| s.summary),
        times,
    };
    Ok((comparison, snapshots))
}

/// Whether the forces on a patch can be compared, as far as the last stored time up to `time` (s) says.
///
/// # Errors
/// [`Error::Input`] for a patch that there is not, or one of a flow without extent across it.
pub fn check_patch(case: &mut FoamCase, patch: &str, time: f64) -> Result<()> {
    known(case.description(), patch)?;
    let stored = case.description().times.iter().filter(|t| **t <= time * (1.0 + 1e-6)).count();
    if is_solid(case)? || stored == 0 {
        return Ok(());
    }
    // A flow may begin without a field that says where it enters.
    let velocity = forces::inlet_velocity(case, stored - 1).ok().flatten();
    velocity.map_or(Ok(()), |v| Reference::of(case.description(), patch, v).map(|_| ()))
}

impl Options {
    /// Whether the options are of what the case is of.
    fn check(&self, solid: bool, path: &str) -> Result<()> {
        match (solid, &self.follow, self.interpolate) {
            (false, Some(patch), _) => Err(Error::Input(format!(
                "--probe-patch {patch}: cells are followed of a solid, and {path} is a flow's; leave it out"
            ))),
            (true, _, true) => Err(Error::Input(
                "--interpolate: of a displacement there is no interpolation; leave it out".into(),
            )),
            _ => Ok(()),
        }
    }
}

/// The scalar fields, but for the one that is compared first, that both runs of a flow have at all times.
fn other_fields(
    a: &mut FoamCase,
    b: &mut FoamCase,
    first: &str,
    hold: (usize, usize),
    pairs: &[(usize, usize)],
) -> Result<Vec<(&'static str, Track)>> {
    let mut tracks = Vec::new();
    for name in SCALARS.into_iter().filter(|name| first != "D" && *name != first) {
        let mut stored = true;
        for &(i, j) in std::iter::once(&hold).chain(pairs) {
            stored = stored && a.has_field(name, i)? && b.has_field(name, j)?;
        }
        if stored {
            tracks.push((name, Track::new(a.scalar_field(name, hold.0)?)));
        }
    }
    Ok(tracks)
}

impl Comparison {
    /// Name of the headline, its field, and its unit.
    pub fn names(&self) -> [&'static str; 3] {
        match self.field {
            "D" => ["displacement", "D", "m"],
            "T" => ["temperature", "T", "K"],
            _ => ["velocity", "U", "m/s"],
        }
    }

    /// The comparison as the figures file: errors are relative.
    ///
    /// # Errors
    /// None for figures that were made here.
    pub fn json(&self) -> Result<Value> {
        let internal = |e| Error::Internal(format!("figures of a comparison: {e}"));
        let mut figures = serde_json::to_value(self).map_err(internal)?;
        let (h, [name, ..]) = (&self.headline, self.names());
        figures[format!("{name}_rmse")] = json!(h.rmse);
        figures[format!("{name}_error")] = json!(h.error);
        figures[format!("{name}_rms")] = json!(h.rms);
        figures["hold_last_rmse"] = json!(h.hold_last_rmse);
        figures["hold_last_error"] = json!(h.hold_last_error);
        Ok(figures)
    }
}

/// Values at the cells of A: of a temperature, or the solved components of a vector.
fn values(
    case: &mut FoamCase,
    (name, time): (&str, usize),
    mapping: &Mapping,
    directions: &[usize],
) -> Result<Vec<f64>> {
    match name {
        "T" => Ok(mapping.scalar(case.scalar_field(name, time)?)),
        _ => Ok(components(&mapping.vector(case.vector_field(name, time)?), directions)),
    }
}

/// The solved components, cell after cell.
fn components(field: &[[f64; 3]], directions: &[usize]) -> Vec<f64> {
    field.iter().flat_map(|u| directions.iter().map(|&d| u[d])).collect()
}

/// `count` indices below `n`: the last one, and before it ones at halving distance from the start.
fn choose(n: usize, count: usize) -> Vec<usize> {
    let mut chosen: Vec<usize> =
        (0..count).map(|k| (n >> k).max(1)).map(|h| h - 1).filter(|&i| i < n).collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// The patch of this name.
///
/// # Errors
/// [`Error::Input`] with the patches that there are.
fn known<'a>(description: &'a Description, patch: &str) -> Result<&'a Patch> {
    let found = description.patches.iter().find(|p| p.name == patch);
    found.ok_or_else(|| {
        let names = listed(description.patches.iter().map(|p| &p.name));
        Error::Input(format!("patch {patch} is not in {}: its patches are {names}", description.path))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chosen_times() {
        assert_eq!(choose(100, 3), [24, 49, 99]);
        assert_eq!(choose(1, 3), [0]);
        assert!(choose(0, 3).is_empty() && choose(5, 0).is_empty());
    }

    #[test]
    fn only_solved_components_count() {
        assert_eq!(components(&[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], &[0, 2]), [1.0, 3.0, 4.0, 6.0]);
    }
}
