//! Whether a model fits a case.

use super::SessionOptions;
use m4gn_mesh::{Error, Result};
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::ModelSpec;

/// Solved directions and node types of this rank's mesh against the model's.
///
/// # Errors
/// [`Error::Model`] saying what the model knows and what the mesh has, with the patch's name.
pub fn check(spec: &ModelSpec, mesh: &Mesh, options: &SessionOptions) -> Result<()> {
    match (spec.contact, &mesh.body) {
        (Some(_), None) => {
            return Err(Error::Model(
                "the model is of a body at points: it needs the body's elements; fields at cells need a model without \
                 `contact`"
                    .into(),
            ));
        }
        (None, Some(_)) => {
            return Err(Error::Model(
                "the model is of fields at cells; a body at points needs one with `contact`, trained on trajectories at \
                 points"
                    .into(),
            ));
        }
        (None, None) if options.projection.is_some() => {
            return Err(Error::Input(
                "projection: the model is of fields at cells, which no obstacle touches".into(),
            ));
        }
        _ => {}
    }
    if mesh.dim() != spec.dim {
        let names: Vec<_> = mesh
            .directions
            .iter()
            .map(|&d| ["x", "y", "z"].get(d).copied().unwrap_or("?"))
            .collect();
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
