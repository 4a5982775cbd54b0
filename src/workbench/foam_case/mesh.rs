//! The mesh of a case as the function objects hand it to the core: the same C++ code makes it.

use super::FoamCase;
use m4gn_base::Result;
use m4gn_mesh::{Mesh, NodeType};
use serde_json::json;

impl FoamCase {
    /// The undecomposed mesh: numbering, coefficients of the case's own Laplacian, node types.
    ///
    /// `node_types` gives patches, or groups of patches, their type; the other patches have those of `nodeTypes` in
    /// the case's function object, and what that leaves is found as the function objects do: from the patch's type,
    /// and from the U and p of the start time.
    ///
    /// # Errors
    /// OpenFOAM's message for a patch that no node type is found for or that is not handled, by name; a mesh that
    /// is not whole.
    pub fn mesh(&mut self, node_types: &[(String, NodeType)]) -> Result<Mesh> {
        let types: Vec<(&str, &str)> = node_types.iter().map(|(k, t)| (k.as_str(), t.name())).collect();
        let (mesh, body) = self.handle.mesh(&json!(types))?;
        self.body = body.map(Box::new);
        Ok(mesh)
    }
}
