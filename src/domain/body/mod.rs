//! A body at points that deforms, touched by a rigid obstacle that moves as prescribed.
//!
//! [`Body`] is the domain: world edges that come and go, and what its points are told of the obstacle. [`segments`] cuts it into segments,
//! [`gap`] is the distance between its skin and the obstacle, and [`quality`] has the paper's mesh metrics (appendix C.2).

mod coarser;
mod domain;
pub mod gap;
mod graph;
mod host;
mod inputs;
mod part;
pub mod quality;
mod segments;
mod start;

pub use graph::{Body, MeshEdge, N_FEATURES, has_feature};
pub use host::BodyHost;
pub use part::BodyPart;

use crate::Place;
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_mesh::body::Body as Solid;
use m4gn_mesh::body::Obstacle;
use m4gn_model::modal::ModalSource;
use m4gn_model::{ModelSpec, SegmentSpec, cell_size};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;

/// This rank's part of a body as a domain, and what the network lives on.
struct Made {
    part: BodyPart,
    body: Body,
    structure: Structure,
}

impl Made {
    /// The points p of a whole body with `ranks[p]` this rank. Collective; all ranks fail together.
    fn new(
        (whole, ranks, obstacle): (&Solid, &[i32], Option<&Obstacle>),
        spec: &ModelSpec,
        settings: &SegmentSpec,
        modes: &dyn ModalSource,
        comm: &Comm,
    ) -> Result<Self> {
        Structure::check_ranks(spec, comm)?;
        let needs = spec.architecture.needs();
        // Every rank computes the same modes: bodies at points are small beside what ranks are for.
        let modes = match needs.segments && settings.method.uses_modes() && settings.count > 1 {
            true => Some(comm.agree(modes.of_body(whole, settings.modes))?),
            false => None,
        };
        let part = comm.agree(BodyPart::of_rank(whole, obstacle, ranks, comm.rank()))?;
        let (body, graph) = Body::new(&part, spec, comm)?;
        let segments = match needs.segments {
            true => Some(segments::segment(&part, &body, spec, settings, modes.as_ref(), comm)?),
            false => None,
        };
        let sequence = Structure::sequence_of(segments.as_ref(), needs, &part.mesh, comm)?;
        let mut walk = m4gn_structure::node_walk(&segments::without_obstacle(&part), needs.walk, comm)?;
        // The obstacle's points are nodes of the first rank with points.
        if comm.rank() == part.first {
            let pairs = &part.obstacle_edges;
            walk.extend(m4gn_structure::walk_of_pairs(part.obstacle.len(), pairs, needs.walk));
        }
        let levels = body.coarser(&part.mesh, &graph, needs.levels, comm)?;
        let place = Structure::places(needs, &part.mesh);
        let structure = Structure { graph, segments, sequence, levels, walk, place };
        Ok(Made { part, body, structure })
    }
}

/// As [`Place::whole`].
pub(crate) fn place(
    mesh: &Mesh,
    spec: &ModelSpec,
    settings: &SegmentSpec,
    modes: &dyn ModalSource,
) -> Result<Place> {
    let comm = Comm::serial();
    let (whole, ranks) = mesh.whole_body(&comm)?;
    let whole = (&whole, &ranks[..], mesh.obstacle.as_ref());
    let Made { part, body, structure } = Made::new(whole, spec, settings, modes, &comm)?;
    Ok(Place { cell_size: cell_size(&part.mesh, &comm), domain: Box::new(body), structure, coarse: None })
}
