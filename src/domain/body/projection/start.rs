//! The state at rest, from which contact can be kept free of overlap.

use super::skin::Skin;
use crate::body::gap::Samples;
use m4gn_base::{Error, Result};
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::surface::Surface;
use m4gn_mesh::vector::Vector;

/// Overlap at the start that is let pass, mean edges: what a generator may record.
const OVERLAP: f64 = 0.05;

/// Refuses parts of a body that overlap at rest.
pub(super) fn check_parts(body: &Body, samples: &Samples, skin: &Skin, cell: f64) -> Result<()> {
    let gap = match skin.has_parts() {
        true => skin.parts_gap(samples, &body.positions),
        false => None,
    };
    match gap.filter(|gap| gap.cells < -OVERLAP) {
        Some(gap) => Err(Error::Mesh(format!(
            "two parts of the body overlap at the start, {:.3} mean edges ({:.3e} m) deep at ({:.6} {:.6} {:.6}) m: parts that share \
             no point are taken for bodies of their own; move them apart, or join their points",
            -gap.cells,
            -gap.cells * cell,
            gap.at[0],
            gap.at[1],
            gap.at[2]
        ))),
        None => Ok(()),
    }
}

/// Refuses an obstacle that overlaps the body at rest.
pub(super) fn check_apart(
    body: &Body,
    obstacle: &Obstacle,
    samples: &Samples,
    skin: &Skin,
    cell: f64,
) -> Result<()> {
    let surface = Surface::new(&obstacle.positions, &obstacle.triangles)?;
    let gap = samples.worst_from(&body.positions, &surface, cell);
    let skin = skin.at_rest();
    let inside = obstacle.positions.iter().map(|&x| (skin.distance(x) / cell, x));
    let inside = inside.fold(
        None,
        |worst: Option<(f64, Vector)>, one| {
            if worst.is_none_or(|w| one.0 < w.0) { Some(one) } else { worst }
        },
    );
    let pairs = gap.map(|g| (g.cells, g.at)).into_iter().chain(inside);
    let deepest = pairs.fold((0.0, [0.0; 3]), |a, b| if b.0 < a.0 { b } else { a });
    let (cells, at) = deepest;
    if cells >= -OVERLAP {
        return Ok(());
    }
    let all = body.positions.iter().all(|&x| surface.distance(x) < 0.0);
    let what = if all { "contains the whole body" } else { "overlaps the body" };
    Err(Error::Mesh(format!(
        "the obstacle {what} at the start, {:.3} mean edges ({:.3e} m) deep at ({:.6} {:.6} {:.6}) m: place it outside, or \
         check that its triangles' normals point outward",
        -cells,
        -cells * cell,
        at[0],
        at[1],
        at[2]
    )))
}
