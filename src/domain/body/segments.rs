//! Segments of a body at points (Algorithms 1 and 2 on eq. 5): by its elastic modes with the handle held, the
//! distance to the obstacle, and positions. The obstacle is a segment of its own, the last one.

use super::graph::Body;
use super::part::BodyPart;
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_model::modal::{Modes, NoModes};
use m4gn_model::{ModelSpec, SegmentMethod, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_structure::graph::Graph;
use m4gn_structure::{self as segments, Segmentation};

/// Segments of this rank's part, and what a network reads of them. `modes` are those of the whole body; none where
/// `spec` needs none. Collective; all ranks fail together.
///
/// The count of the result is `spec.segments.count`, and one more for an obstacle.
///
/// # Errors
/// As [`segments::segment`].
pub fn segment(
    part: &BodyPart,
    nodes: &Body,
    spec: &ModelSpec,
    settings: &SegmentSpec,
    modes: Option<&Modes>,
    comm: &Comm,
) -> Result<Segmentation> {
    let bare = without_obstacle(part);
    // Without an obstacle there is no distance to one.
    let mut settings = settings.clone();
    if part.obstacle.is_empty() && settings.method.uses_obstacle() {
        settings.method = SegmentMethod::Slic;
    }
    let mut graph = Graph::new(&bare, comm)?;
    let mut body = match modes {
        Some(modes) => {
            let own = Modes {
                eigenvalues: modes.eigenvalues.clone(),
                vectors: modes
                    .vectors
                    .iter()
                    .map(|v| part.points.iter().map(|&p| v[p as usize]).collect())
                    .collect(),
            };
            let mut with_obstacle = Graph::new(&part.mesh, comm)?;
            let refined = segments::segment_by_modes(&part.mesh, &mut with_obstacle, &settings, &own, comm)?;
            let cells = &refined.node_segment[..bare.n_cells()];
            let whole = segments::segment(&bare, &mut graph, &settings, &NoModes, comm, Some(cells))?;
            Segmentation {
                sweeps: refined.sweeps,
                moved: refined.moved,
                reassigned: refined.reassigned,
                ..whole
            }
        }
        None => segments::segment(&bare, &mut graph, &settings, &NoModes, comm, None)?,
    };
    body.encode(spec, &bare, comm);
    Ok(match part.obstacle.is_empty() {
        true => body,
        false => with_obstacle(body, part, nodes, spec),
    })
}

/// This rank's part of the body alone.
pub(super) fn without_obstacle(part: &BodyPart) -> Mesh {
    Mesh { boundary: Vec::new(), ..part.mesh.clone() }
}

/// Adds the obstacle as the last segment.
fn with_obstacle(body: Segmentation, part: &BodyPart, nodes: &Body, spec: &ModelSpec) -> Segmentation {
    let (k, q) = (body.count, part.obstacle.len());
    let here = nodes.n_owned - nodes.n_points();
    let mut s = body;
    s.node_segment.extend(vec![k as i32; here]);
    for _ in 0..here {
        s.member.push(k as i32);
        s.member_row.push(s.member.len() as u32);
    }
    s.sizes.push(q as f64);
    // It touches no segment at rest: its random walk stays where it is.
    let mut adjacency = vec![0.0; (k + 1) * (k + 1)];
    for (row, old) in adjacency.chunks_exact_mut(k + 1).zip(s.adjacency.chunks_exact(k)) {
        row[..k].copy_from_slice(old);
    }
    adjacency[(k + 1) * (k + 1) - 1] = 2.0 * part.obstacle_edges.len() as f64;
    s.adjacency = adjacency;
    s.count = k + 1;

    // The obstacle moves: where it was at the start says nothing. Its place is the centre, its points' offsets 0.
    s.position.extend(vec![0.0; spec.n_position_features()]);
    s.offsets.extend(vec![0.0; here * spec.n_offset_features()]);
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_model::modal::ModalSource;
    use m4gn_modes::Modal;
    use m4gn_samples::bodies as sample;
    use m4gn_samples::model::bodies;

    #[test]
    fn the_obstacle_is_a_segment_of_its_own() {
        let body = sample::block([6, 2, 2], [3.0, 1.0, 1.0]);
        let obstacle = sample::octahedron([2.5, 0.5, 1.8], 0.5);
        let comm = Comm::serial();
        let mut spec = bodies();
        spec.segments =
            SegmentSpec { method: SegmentMethod::SlicExp, count: 4, modes: 1, ..SegmentSpec::default() };
        let settings = spec.segments.clone();
        let modes = Modal::default().of_body(&body, settings.modes).unwrap();
        // A square section bends alike in both directions: the cluster counts as one mode.
        assert_eq!((modes.vectors.len(), modes.vectors[0].len()), (6, 63));
        let part = BodyPart::whole(&body, Some(&obstacle)).unwrap();
        let (nodes, _) = Body::new(&part, &spec, &comm).unwrap();
        let cut = segment(&part, &nodes, &spec, &settings, Some(&modes), &comm).unwrap();
        assert_eq!((cut.count, cut.node_segment.len()), (5, 69));
        assert!(cut.node_segment[63..].iter().all(|&s| s == 4));
        assert!(cut.node_segment[..63].iter().all(|&s| s < 4));
        assert_eq!(cut.sizes.iter().sum::<f64>(), 69.0);
        assert_eq!(cut.position.len(), 5 * spec.n_position_features());
        assert_eq!(cut.offsets.len(), 69 * spec.n_offset_features());
    }

    #[test]
    fn a_body_that_is_held_nowhere_is_refused() {
        let mut body = sample::block([2, 1, 1], [2.0, 1.0, 1.0]);
        body.types.fill(m4gn_mesh::NodeType::Body);
        m4gn_samples::fails(Modal::default().of_body(&body, SegmentSpec::default().modes), &["handle"]);
    }
}
