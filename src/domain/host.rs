//! A domain in a host's run.

use crate::body::BodyHost;
use crate::cells::CellsHost;
use crate::{Domain, Field, Kind};
use m4gn_base::{Error, Result};
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::modal::ModalSource;
use m4gn_model::{ModelSpec, SegmentSpec, Solid};
use m4gn_parallel::Comm;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;

/// Who asks the network.
pub trait Predict {
    /// The network's physical outputs at a state of a domain, changes not yet added; `next` is what is prescribed after the step.
    /// Collective; all ranks fail together.
    ///
    /// # Errors
    /// As [`Domain::set_edges`]; what the network may fail with.
    fn predict(
        &mut self,
        comm: &Comm,
        domain: &dyn Domain,
        state: &mut [f32],
        next: &[f32],
    ) -> Result<&[f32]>;
}

/// A domain in a host's run: fields by name in, the fields after a stride out, in double precision.
pub trait Host: Send {
    /// The domain, whose nodes are the network's.
    fn domain(&self) -> &dyn Domain;

    /// One stride. `checked` is the caller's own finding so far, that the ranks agree on with theirs; `result [n_nodes x n_outputs]` gets
    /// the predicted components at the host's nodes. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::Input`] for fields that are missing or have other components or lengths; [`Error::Numerical`] for
    /// values that are not finite, going in or coming out.
    fn step(
        &mut self,
        comm: &Comm,
        network: &mut dyn Predict,
        fields: &[Field],
        checked: Result<()>,
        result: &mut [f64],
    ) -> Result<()>;

    /// Takes the displacement of an obstacle's points at the start and at the end of the next step, m. Collective; all ranks fail
    /// together.
    ///
    /// # Errors
    /// [`Error::Input`] for other lengths, or a domain without obstacle; [`Error::Numerical`] for values that are not finite.
    fn set_obstacle(&mut self, _comm: &Comm, _motion: [&[Vector]; 2]) -> Result<()> {
        Err(Error::Input("the model is of fields at cells: it knows no obstacle that moves".into()))
    }

    /// Looks at a recorded state of the host's fields. At points of walls a vector that differs from one such state to another is predicted;
    /// else it is prescribed.
    fn see(&mut self, _fields: &[Field]) {}

    /// What the elements are made of, where the domain says so itself.
    fn solid(&self) -> Option<&Solid> {
        None
    }

    /// The groups that the network lives on; none where it lives on the host's nodes.
    fn groups(&self) -> Option<&Coarse> {
        None
    }

    /// All components of the fields before the last step, a row a node that counts for what the model was trained on.
    fn seen(&self) -> &[f32];
}

/// How a host has its domain.
pub struct HostOptions<'a> {
    /// How segments are cut.
    pub segments: &'a SegmentSpec,
    /// Mean distance of the network's nodes, m; none: the host's.
    pub resolution: Option<f64>,
    /// Segment of each of the host's nodes, computed before.
    pub labels: Option<&'a [i32]>,
    /// Whom segments ask for modes.
    pub modes: &'a dyn ModalSource,
}

/// A domain in a host's run, as it begins.
pub struct Hosted {
    /// The domain.
    pub host: Box<dyn Host>,
    /// What the network lives on.
    pub structure: Structure,
    /// Segments of the host's nodes.
    pub n_segments: usize,
    /// Segment of each of the host's nodes; empty without segments.
    pub node_segment: Vec<i32>,
    /// How they were computed, to be stored with them; empty if they were handed in, or are not to be stored.
    pub segment_record: String,
    /// Mean distance of neighbouring nodes of the network, m.
    pub cell_size: f64,
}

/// The domain of the model that `spec` describes on this rank's part of a host's mesh. Collective; all ranks fail together.
///
/// # Errors
/// [`Error::Model`] when the model does not fit the mesh (kind of domain, dimension, node types); [`Error::Mesh`] for a mesh that no graph
/// can be made of, or an obstacle that overlaps the body at rest; [`Error::Input`] for options out of range; what the modes may fail with.
pub fn open(mesh: &Mesh, spec: &ModelSpec, options: &HostOptions, comm: &Comm) -> Result<Hosted> {
    comm.agree(fits(mesh, spec))?;
    match Kind::of_model(spec) {
        Kind::Body => BodyHost::open(mesh, spec, options, comm),
        Kind::Cells => CellsHost::open(mesh, spec, options, comm),
    }
}

/// Whether the model is of this kind of domain, and knows its directions and node types.
///
/// # Errors
/// [`Error::Model`] that says what it knows, and what the mesh has.
pub fn fits(mesh: &Mesh, spec: &ModelSpec) -> Result<()> {
    match (Kind::of_model(spec), Kind::of_mesh(mesh)) {
        (Kind::Body, Kind::Cells) => {
            return Err(Error::Model(
                "the model is of a body at points: it needs the body's elements; fields at cells need a model without \
                 `contact`"
                    .into(),
            ));
        }
        (Kind::Cells, Kind::Body) => {
            return Err(Error::Model(
                "the model is of fields at cells; a body at points needs one with `contact`, trained on trajectories at \
                 points"
                    .into(),
            ));
        }
        _ => {}
    }
    if mesh.dim() != spec.dim {
        let names: Vec<_> =
            mesh.directions.iter().map(|&d| ["x", "y", "z"].get(d).copied().unwrap_or("?")).collect();
        return Err(Error::Model(format!(
            "the model was trained in {} dimensions; this case solves {} ({}): use a model of this dimension, or \
             empty patches for a 2-D case",
            spec.dim,
            mesh.dim(),
            names.join(", ")
        )));
    }
    let known = |kind: NodeType| spec.node_types.contains(&kind);
    if let Some(face) = mesh.boundary.iter().find(|b| !known(b.kind)) {
        let names: Vec<_> = spec.node_types.iter().map(|t| t.name()).collect();
        let patch = mesh.patches.get(face.patch as usize).map_or("?", |p| p);
        return Err(Error::Model(format!(
            "the model knows {}; patch '{patch}' is {}: give the patch one of these types (nodeTypes), or train with \
             such a patch",
            names.join(", "),
            face.kind.name()
        )));
    }
    Ok(())
}
