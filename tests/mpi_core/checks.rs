//! Comparisons of a rank's part with the whole.

pub use crate::ranks::Checks;
use m4gn_mesh::Mesh;
use m4gn_model::modal::Modes;
use m4gn_structure::Segmentation;

/// Eigenvalues to 1e-8, of those below `least` of it, and modes to `bound`.
pub fn compare_modes(
    checks: &mut Checks,
    name: &str,
    part: &Mesh,
    found: &Modes,
    expected: &Modes,
    (least, bound): (f64, f64),
) {
    checks.that(
        found.eigenvalues.len() == expected.eigenvalues.len(),
        format!("{name}: {} modes, expected {}", found.eigenvalues.len(), expected.eigenvalues.len()),
    );
    for (i, (f, e)) in found.eigenvalues.iter().zip(&expected.eigenvalues).enumerate() {
        let near = (f - e).abs() <= 1e-8 * e.abs().max(least);
        checks.that(near, format!("{name}: eigenvalue {i}: {f}, expected {e}"));
    }
    for (i, (f, e)) in found.vectors.iter().zip(&expected.vectors).enumerate() {
        let off = part.cell_global.iter().zip(f).map(|(&g, x)| (x - e[g as usize]).abs()).fold(0.0, f64::max);
        checks.that(off < bound, format!("{name}: mode {i} differs by {off:e}"));
    }
}

/// Everything about the segments, exactly.
pub fn compare_segments(
    checks: &mut Checks,
    name: &str,
    part: &Mesh,
    mesh: &Mesh,
    found: &Segmentation,
    expected: &Segmentation,
) {
    let n = (part.n_cells(), mesh.n_cells());
    let cells = part.cell_global.iter().enumerate().map(|(i, &g)| (i, g as usize));
    let faces = part.boundary.iter().enumerate().map(|(i, b)| (n.0 + i, n.1 + b.global as usize));
    let members = |s: &Segmentation, i: usize| {
        s.member[s.member_row[i] as usize..s.member_row[i + 1] as usize].to_vec()
    };
    let (mut labels, mut overlap) = (0, 0);
    for (here, there) in cells.chain(faces) {
        labels += (found.node_segment[here] != expected.node_segment[there]) as usize;
        overlap += (members(found, here) != members(expected, there)) as usize;
    }
    checks.that(labels == 0, format!("{name}: {labels} nodes in other segments"));
    checks.that(overlap == 0, format!("{name}: {overlap} nodes with other overlaps"));
    checks.that(found.sizes == expected.sizes, format!("{name}: sizes"));
    checks.that(found.sizes.iter().all(|&s| s > 0.0), format!("{name}: a segment is empty"));
    checks.that(found.adjacency == expected.adjacency, format!("{name}: adjacency"));
    checks.that(found.rwse(8) == expected.rwse(8), format!("{name}: random-walk encoding"));
}
