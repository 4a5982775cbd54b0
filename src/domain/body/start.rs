//! The state at rest, which is free of overlap.

use super::gap::{Samples, cell_size};
use m4gn_base::{Error, Result};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::surface::{Surface, check_closed};
use m4gn_mesh::vector::Vector;

/// Overlap at the start that is let pass, mean edges: what a generator may record.
const OVERLAP: f64 = 0.05;

/// Refuses an obstacle that overlaps the body at rest.
///
/// # Errors
/// [`Error::Mesh`] for an obstacle that is no closed surface, or overlaps the body at rest: how deep and where.
pub(super) fn check_start(body: &Body, obstacle: Option<&Obstacle>) -> Result<()> {
    let Some(obstacle) = obstacle else {
        return Ok(());
    };
    check_closed(&obstacle.triangles)?;
    check_apart(body, obstacle, cell_size(&body.positions, &body.edges))?;
    obstacle.check(body)
}

/// The skin of a body as a surface: quadrilaterals are four triangles around their middle.
fn skin(body: &Body) -> Surface {
    let (faces, n) = (body.elements.skin(), body.positions.len());
    let mut triangles = Vec::new();
    for (k, f) in faces.iter().enumerate() {
        match f[..] {
            [a, b, c] => triangles.push([a, b, c]),
            _ => triangles.extend((0..f.len()).map(|i| [f[i], f[(i + 1) % f.len()], (n + k) as i32])),
        }
    }
    let middle = |face: &Vec<i32>| -> Vector {
        let sum = |i: usize| face.iter().map(|&p| body.positions[p as usize][i]).sum::<f64>();
        std::array::from_fn(|i| sum(i) / face.len() as f64)
    };
    let places: Vec<Vector> = body.positions.iter().copied().chain(faces.iter().map(middle)).collect();
    Surface::open(&places, &triangles)
}

fn check_apart(body: &Body, obstacle: &Obstacle, cell: f64) -> Result<()> {
    let surface = Surface::new(&obstacle.positions, &obstacle.triangles)?;
    let samples = Samples::new(&body.elements, |p| body.types[p as usize] != NodeType::Body);
    let gap = samples.worst(&body.positions, &surface, cell);
    let skin = skin(body);
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

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::bodies as sample;
    use m4gn_samples::mesh::brick;

    fn obstacle(size: Vector, corner: Vector) -> Obstacle {
        let (points, triangles) = brick(size);
        let positions = points.iter().map(|p| std::array::from_fn(|i| p[i] + corner[i]));
        Obstacle { positions: positions.collect(), triangles }
    }

    #[test]
    fn what_overlaps_is_refused() {
        let body = sample::block([2, 2, 2], [2.0; 3]);
        let apart = obstacle([1.0; 3], [0.5, 0.5, 2.2]);
        assert!(check_start(&body, Some(&apart)).is_ok());
        let refused = |o: &Obstacle| check_start(&body, Some(o)).unwrap_err().to_string();
        let around = refused(&obstacle([9.0; 3], [-3.0; 3]));
        assert!(around.contains("contains the whole body") && around.contains("deep at"), "{around}");
        let over = refused(&obstacle([1.0; 3], [0.5, 0.5, 1.8]));
        assert!(over.contains("overlaps the body at the start, 0.200 mean edges"), "{over}");
        // No sample of the skin is in it
        assert!(refused(&obstacle([0.2; 3], [0.9; 3])).contains("overlaps"));
        let mut open = apart;
        open.triangles.pop();
        assert!(refused(&open).contains("not closed"));
    }
}
