//! Which kind of domain a model or a mesh is of, and what follows from it alone.

use crate::body::has_feature;
use m4gn_base::Result;
use m4gn_mesh::Mesh;
use m4gn_model::{ModalOperator, ModelSpec, SegmentSpec};
use std::hash::{DefaultHasher, Hash, Hasher};

/// Whether the nodes of a model's domain move and may be touched.
pub fn moves(spec: &ModelSpec) -> bool {
    Kind::of_model(spec) == Kind::Body
}

/// Whose modes the segments of a training on a mesh are made of.
///
/// # Errors
/// As [`SegmentSpec::is_elastic`].
pub fn operator(mesh: &Mesh, segments: &SegmentSpec) -> Result<Option<ModalOperator>> {
    Ok(match Kind::of_mesh(mesh) {
        Kind::Body => segments.operator,
        Kind::Cells if segments.is_elastic(mesh)? => Some(ModalOperator::Elastic),
        Kind::Cells => Some(ModalOperator::Laplacian),
    })
}

/// Whether a mesh is of the kind that a model is for; else both kinds, that of the mesh last.
///
/// # Errors
/// The kinds, where they differ.
pub fn check_kind(spec: &ModelSpec, mesh: &Mesh) -> std::result::Result<(), [Kind; 2]> {
    let kinds = [Kind::of_model(spec), Kind::of_mesh(mesh)];
    if kinds[0] == kinds[1] { Ok(()) } else { Err(kinds) }
}

/// A kind of domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Fields at the cells of a mesh that stays.
    Cells,
    /// A body at points.
    Body,
}

impl Kind {
    /// Of the model that `spec` describes.
    pub(crate) fn of_model(spec: &ModelSpec) -> Self {
        match spec.contact {
            Some(_) => Kind::Body,
            None => Kind::Cells,
        }
    }

    /// Of a mesh.
    pub(crate) fn of_mesh(mesh: &Mesh) -> Self {
        match mesh.body {
            Some(_) => Kind::Body,
            None => Kind::Cells,
        }
    }

    /// What a trajectory of this kind asks of the configuration of a training, for people.
    pub fn asks_of_configuration(self) -> &'static str {
        match self {
            Kind::Body => {
                "is a trajectory at points (a deforming body): give the configuration a table [contact] with a radius"
            }
            Kind::Cells => {
                "is a trajectory at cells: [contact] is for deforming bodies at points; leave the table out, or give a folder \
                 with trajectories at points only"
            }
        }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Cells => "fields at cells (a flow)",
            Kind::Body => "a body at points",
        }
    }
}

/// What the normalisers of a model see.
pub struct Statistics {
    /// Whether a row of node inputs has one of them.
    pub node: fn(&[f32], usize) -> bool,
    /// Whether a row of edge features has one of them.
    pub edge: fn(&[f32], usize) -> bool,
    /// Whether all outputs have one deviation.
    pub outputs_alike: bool,
}

impl Statistics {
    /// Of the model that `spec` describes.
    ///
    /// Of a body, a feature of an edge is seen in the edges of its kind alone, and the three components of the displacement have one
    /// deviation: a direction in which a body hardly moves is not worth more than another.
    pub fn of(spec: &ModelSpec) -> Self {
        match Kind::of_model(spec) {
            Kind::Body => Statistics { node: |row, i| row[i] != 0.0, edge: has_feature, outputs_alike: true },
            Kind::Cells => Statistics { node: |_, _| true, edge: |_, _| true, outputs_alike: false },
        }
    }
}

/// What all ranks must describe alike of a mesh: its kind, and an obstacle, which is whole on each of them.
pub fn shared(mesh: &Mesh) -> String {
    let mut hasher = DefaultHasher::new();
    if let Some(obstacle) = &mesh.obstacle {
        let bits = obstacle.positions.as_flattened().iter().map(|v| v.to_bits());
        bits.for_each(|b| b.hash(&mut hasher));
        obstacle.triangles.hash(&mut hasher);
    }
    format!("{:?}\nobstacle {:x}", Kind::of_mesh(mesh), hasher.finish())
}
