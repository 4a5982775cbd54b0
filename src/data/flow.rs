//! The mesh of fields at cells, as it is found in a file.

use super::schema::{NAME, Text};
use super::source::Source;
use m4gn_base::Result;
use m4gn_mesh::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_parallel::Comm;

impl Source<'_> {
    /// The mesh: cells, faces between them, boundary faces, cyclic faces, elastic modes.
    pub(super) fn mesh(&self, file: &hdf5::File) -> Result<Mesh> {
        let group = self.group(file, "mesh")?;
        let directions = self.numbers(&group, "directions", 3)?;
        let increasing = directions.windows(2).all(|w| w[0] < w[1]);
        if directions.len() < 2 || !increasing || directions.iter().any(|d| !(0..3).contains(d)) {
            return Err(
                self.damaged(format!("solved directions {directions:?}, expected two or three of 0, 1, 2"))
            );
        }
        let cell_volumes: Vec<f64> = self.values(file, "mesh/cell_volumes", &[None])?;
        let n = cell_volumes.len();
        let face_coeff: Vec<f64> = self.values(file, "mesh/face_coeff", &[None])?;
        let f = Some(face_coeff.len());
        let patches = self.patches(&group)?;
        let mesh = Mesh {
            directions: directions.iter().map(|&d| d as usize).collect(),
            cell_global: (0..n as i64).collect(),
            cell_centres: self.vectors(file, "mesh/cell_centres", Some(n))?,
            cell_volumes,
            face_owner: self.labels(file, "mesh/face_owner", f, n)?,
            face_neighbour: self.labels(file, "mesh/face_neighbour", f, n)?,
            face_coeff,
            boundary: self.boundary(file, n, patches.len())?,
            coupled: self.coupled(file, n)?,
            patches,
            elastic: self.elastic(file, n)?,
            ..Mesh::default()
        };
        mesh.check(&Comm::serial()).map_err(|e| self.damaged(e.to_string()))?;
        Ok(mesh)
    }

    fn patches(&self, group: &hdf5::Group) -> Result<Vec<String>> {
        let attribute = self.attribute(group, "patch_names")?;
        if attribute.size() as u64 > self.bytes {
            return Err(self.damaged(format!("{} patch names", attribute.size())));
        }
        let names: Vec<Text<NAME>> = attribute
            .read_raw()
            .map_err(|e| self.damaged(format!("attribute patch_names of /mesh is not text ({e})")))?;
        names
            .iter()
            .map(|n| {
                String::from_utf8(n.as_bytes().to_vec())
                    .map_err(|_| self.damaged("a patch name is not UTF-8".into()))
            })
            .collect()
    }

    fn boundary(&self, file: &hdf5::File, n_cells: usize, n_patches: usize) -> Result<Vec<BoundaryFace>> {
        let coeff: Vec<f64> = self.values(file, "mesh/boundary_coeff", &[None])?;
        let b = Some(coeff.len());
        let owner = self.labels(file, "mesh/boundary_owner", b, n_cells)?;
        let patch = self.labels(file, "mesh/boundary_patch", b, n_patches)?;
        let kind: Vec<i32> = self.values(file, "mesh/boundary_type", &[b])?;
        let centres = self.vectors(file, "mesh/boundary_centres", b)?;
        let area = self.vectors(file, "mesh/boundary_area", b)?;
        (0..coeff.len())
            .map(|i| {
                let kind = NodeType::from_code(kind[i])
                    .map_err(|e| self.damaged(format!("/mesh/boundary_type[{i}]: {e}")))?;
                Ok(BoundaryFace {
                    owner: owner[i],
                    global: i as i64,
                    centre: centres[i],
                    area: area[i],
                    coeff: coeff[i],
                    kind,
                    patch: patch[i],
                })
            })
            .collect()
    }

    fn coupled(&self, file: &hdf5::File, n_cells: usize) -> Result<Vec<CoupledFace>> {
        if !file.link_exists("mesh/coupled_coeff") {
            return Ok(Vec::new());
        }
        let coeff: Vec<f64> = self.values(file, "mesh/coupled_coeff", &[None])?;
        let c = Some(coeff.len());
        let owner = self.labels(file, "mesh/coupled_owner", c, n_cells)?;
        let neighbour: Vec<i64> = self.values(file, "mesh/coupled_neighbour", &[c])?;
        if let Some(g) = neighbour.iter().find(|&&g| usize::try_from(g).map_or(true, |g| g >= n_cells)) {
            return Err(self.damaged(format!("a cyclic face leads to cell {g} of {n_cells}")));
        }
        let delta = self.vectors(file, "mesh/coupled_delta", c)?;
        let faces = (0..coeff.len()).map(|i| CoupledFace {
            owner: owner[i],
            rank: 0,
            global: neighbour[i],
            delta: delta[i],
            coeff: coeff[i],
        });
        Ok(faces.collect())
    }

    /// Elastic modes of a solid; recordings of other meshes have none.
    fn elastic(&self, file: &hdf5::File, n_cells: usize) -> Result<Option<ElasticModes>> {
        if !file.link_exists("mesh/mode_eigenvalues") {
            return Ok(None);
        }
        let eigenvalues: Vec<f64> = self.values(file, "mesh/mode_eigenvalues", &[None])?;
        let m = eigenvalues.len();
        let cells: Vec<f64> = self.values(file, "mesh/mode_cells", &[Some(m), Some(n_cells), Some(3)])?;
        let cells = cells.as_chunks::<3>().0;
        Ok(Some(ElasticModes {
            vectors: (0..m).map(|i| cells[i * n_cells..(i + 1) * n_cells].to_vec()).collect(),
            eigenvalues,
        }))
    }
}
