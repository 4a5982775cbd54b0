//! The mesh of a case as the function objects hand it to the core: the same C++ code makes it.

use super::{FoamCase, triples};
use crate::mesh::{BoundaryFace, CoupledFace, Mesh, NodeType};
use crate::{Error, Result};
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
        self.handle
            .query(&json!({ "query": "node_types", "types": types }))?;

        let patch_names = self.description.patches.iter().map(|p| p.name.clone());
        let patch_names: Vec<String> = patch_names.collect();
        let patches: Vec<String> = self
            .part("value_patches")?
            .into_iter()
            .filter_map(|p| patch_names.get(p as usize).cloned())
            .collect();
        let cell_volumes = self.part("cell_volumes")?;
        Ok(Mesh {
            directions: self.part("directions")?.into_iter().map(|d| d as usize).collect(),
            cell_global: (0..cell_volumes.len() as i64).collect(),
            cell_centres: triples(&self.part("cell_centres")?),
            cell_volumes,
            face_owner: self.labels("face_owner")?,
            face_neighbour: self.labels("face_neighbour")?,
            face_coeff: self.part("face_coeff")?,
            boundary: self.boundary()?,
            coupled: self.coupled()?,
            patches,
            elastic: None,
        })
    }

    pub(super) fn part(&mut self, name: &str) -> Result<Vec<f64>> {
        self.handle.query(&json!({ "query": "mesh_part", "name": name }))
    }

    pub(super) fn labels(&mut self, name: &str) -> Result<Vec<i32>> {
        Ok(self.part(name)?.into_iter().map(|l| l as i32).collect())
    }

    fn boundary(&mut self) -> Result<Vec<BoundaryFace>> {
        let owner = self.labels("boundary_owner")?;
        let patch = self.labels("boundary_patch")?;
        let kind = self.labels("boundary_type")?;
        let coeff = self.part("boundary_coeff")?;
        let centre = triples(&self.part("boundary_centres")?);
        let area = triples(&self.part("boundary_area")?);
        let n = owner.len();
        if [patch.len(), kind.len(), coeff.len(), centre.len(), area.len()] != [n; 5] {
            return Err(Error::Internal("boundary arrays of different lengths".into()));
        }
        (0..n)
            .map(|i| {
                Ok(BoundaryFace {
                    owner: owner[i],
                    global: i as i64,
                    centre: centre[i],
                    area: area[i],
                    coeff: coeff[i],
                    kind: NodeType::from_code(kind[i])?,
                    patch: patch[i],
                })
            })
            .collect()
    }

    fn coupled(&mut self) -> Result<Vec<CoupledFace>> {
        let owner = self.labels("coupled_owner")?;
        let global = self.part("coupled_global")?;
        let coeff = self.part("coupled_coeff")?;
        let delta = triples(&self.part("coupled_delta")?);
        if [global.len(), coeff.len(), delta.len()] != [owner.len(); 3] {
            return Err(Error::Internal("coupled arrays of different lengths".into()));
        }
        Ok((0..owner.len())
            .map(|i| CoupledFace {
                owner: owner[i],
                rank: 0,
                global: global[i] as i64,
                delta: delta[i],
                coeff: coeff[i],
            })
            .collect())
    }
}
