//! An OpenFOAM case, read and written with OpenFOAM's own libraries through `libm4gn_foam_bridge.so`.

mod fields;
mod solid;

pub use fields::{Source, Stored};
pub use solid::{Reaction, Unknown};

use crate::foam_bridge;
use crate::foam_bridge::CaseHandle;
pub use crate::foam_bridge::LIBRARY;
use m4gn_base::{Error, Result};
use m4gn_mesh::{ElasticModes, Mesh, NodeType};
use m4gn_model::modal::ModalOptions;
use m4gn_modes::fem::{self, HostBody};
use m4gn_parallel::Comm;
use serde::Deserialize;
use serde_json::json;
use std::path::Path;

/// A patch of the case's mesh.
#[derive(Clone, Debug, Deserialize)]
pub struct Patch {
    /// Name.
    pub name: String,
    /// Type in `constant/polyMesh/boundary`.
    pub kind: String,
    /// Lower corner of its points, m.
    pub lower: [f64; 3],
    /// Upper corner of its points, m.
    pub upper: [f64; 3],
}

/// A function object of `controlDict`.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct FunctionObject {
    /// Name.
    pub name: String,
    /// Its type, such as `forceCoeffs`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Patches of the mesh that a `forceCoeffs` or `forces` looks at; none of others.
    pub patches: Vec<String>,
    /// Its `rhoInf`, where the density is that (`rho rhoInf`), kg/m^3.
    pub density: Option<f64>,
}

/// What the case holds.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Description {
    /// Absolute path of its folder.
    pub path: String,
    /// `application` of its `controlDict`.
    pub application: String,
    /// `deltaT` of its `controlDict`, s.
    pub delta_t: f64,
    /// Number of processor folders that its fields come from; 0: its own time folders.
    pub processors: usize,
    /// Name of the folder that a run starts from (`startFrom`, `startTime`): `0`.
    pub start: String,
    /// Entries of its function object `m4gnSurrogate`, else `m4gnSegments`, else `m4gnRecorder`; none if it has none.
    pub function_object: serde_json::Map<String, serde_json::Value>,
    /// All of its function objects.
    pub functions: Vec<FunctionObject>,
    /// Stored times, s, ascending.
    pub times: Vec<f64>,
    /// Number of cells.
    pub cells: usize,
    /// Solved directions: 0 x, 1 y, 2 z.
    pub directions: Vec<usize>,
    /// Patches in the order of the mesh.
    pub patches: Vec<Patch>,
}

/// Cells of a 2-D case as polygons in the plane of the solved directions.
#[derive(Clone, Debug, Default)]
pub struct Polygons {
    /// Points of cell i: `start[i]..start[i + 1]`.
    pub start: Vec<usize>,
    /// Points, m.
    pub points: Vec<[f64; 2]>,
}

/// Force of the fluid on a patch, divided by the density, m^4/s^2.
#[derive(Clone, Copy, Debug)]
pub struct Force {
    /// Sum of p S.
    pub pressure: [f64; 3],
    /// Sum of -S . (nu + nut) dev(twoSymm(grad U)), as `functionObjects::forces`.
    pub viscous: [f64; 3],
}

impl Force {
    /// Pressure and viscous part together.
    pub fn total(&self) -> [f64; 3] {
        std::array::from_fn(|d| self.pressure[d] + self.viscous[d])
    }
}

/// Flow through a patch.
#[derive(Clone, Copy, Debug)]
pub struct Flow {
    /// Volume flux, outward, m^3/s.
    pub flux: f64,
    /// Area, m^2.
    pub area: f64,
    /// Mean velocity over the area, m/s; zero for a patch without values (`empty`).
    pub velocity: [f64; 3],
}

/// An open case. It stays on the thread that opened it.
pub struct FoamCase {
    handle: CaseHandle,
    description: Description,
    /// Of the last [`FoamCase::mesh`].
    body: Option<Box<HostBody>>,
}

impl FoamCase {
    /// Opens the case in `folder`.
    ///
    /// A decomposed case whose processor folders hold later times than the case itself is read from those.
    ///
    /// # Errors
    /// OpenFOAM's own message when the folder is no case or its mesh cannot be read.
    pub fn open(folder: &Path) -> Result<Self> {
        check_name(folder)?;
        let mut handle = CaseHandle::open(foam_bridge::load()?, folder)?;
        let text = handle.describe()?;
        let description = serde_json::from_str(&text)
            .map_err(|e| Error::Internal(format!("description of {folder:?}: {e}")))?;
        Ok(FoamCase { handle, description, body: None })
    }

    /// What the case holds.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// The undecomposed mesh, as the function objects hand it to the core: numbering, coefficients of the case's own Laplacian, node types.
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

    /// Modes of the elastic body in the cells, as the function objects make them; none where the case has no
    /// displacement or its material is not known. After [`FoamCase::mesh`].
    ///
    /// # Errors
    /// As [`fem::modes`].
    pub fn elastic_modes(&mut self, modal: &ModalOptions) -> Result<Option<ElasticModes>> {
        let Some(body) = &self.body else { return Ok(None) };
        let options = fem::Options { modal: modal.clone(), ..body.options.clone() };
        let found = fem::modes(&body.mesh, &body.materials, &body.fixed, &options, &Comm::serial())?;
        let cells = body.mesh.cell_points();
        let mean = |vector: &Vec<[f64; 3]>| {
            let of_cell = |points: &Vec<usize>| {
                let sum = |d: usize| points.iter().map(|&p| vector[p][d]).sum::<f64>();
                [0, 1, 2].map(|d| sum(d) / points.len() as f64)
            };
            cells.iter().map(of_cell).collect()
        };
        let vectors = found.vectors.iter().map(mean).collect();
        Ok(Some(ElasticModes { vectors, eigenvalues: found.eigenvalues }))
    }

    /// Centres of the cells, m.
    pub fn cell_centres(&mut self) -> Result<Vec<[f64; 3]>> {
        Ok(triples(&self.handle.query(&json!({ "query": "cell_centres" }))?))
    }

    /// Cells as polygons; no points where the case is not 2-D.
    pub fn polygons(&mut self) -> Result<Polygons> {
        let data = self.handle.query(&json!({ "query": "polygons" }))?;
        let n = self.description.cells + 1;
        if data.len() < n {
            return Ok(Polygons { start: vec![0; n], points: Vec::new() });
        }
        let points = data[n..].chunks_exact(2).map(|p| [p[0], p[1]]).collect();
        Ok(Polygons { start: data[..n].iter().map(|&s| s as usize).collect(), points })
    }

    /// Whether field `name` is stored at time number `time`.
    pub fn has_field(&mut self, name: &str, time: usize) -> Result<bool> {
        Ok(self.handle.query(&json!({ "query": "has_field", "name": name, "time": time }))? == [1.0])
    }

    /// Cell values of a scalar field at time number `time`.
    ///
    /// # Errors
    /// OpenFOAM's message for a missing or broken file; a non-finite value.
    pub fn scalar_field(&mut self, name: &str, time: usize) -> Result<Vec<f64>> {
        let values = self.handle.query(&json!({ "query": "scalar", "name": name, "time": time }))?;
        self.finite(values, name, time)
    }

    /// Cell values of a vector field at time number `time`; errors as [`Self::scalar_field`].
    pub fn vector_field(&mut self, name: &str, time: usize) -> Result<Vec<[f64; 3]>> {
        let values = self.handle.query(&json!({ "query": "vector", "name": name, "time": time }))?;
        Ok(triples(&self.finite(values, name, time)?))
    }

    /// Force on a patch at time number `time`, from the stored p and U, `nu` of `transportProperties`, or as it is stored where the fluid is not
    /// Newtonian, and the stored `nut`.
    pub fn force(&mut self, patch: &str, time: usize) -> Result<Force> {
        let values = self.handle.query(&json!({ "query": "force", "patch": patch, "time": time }))?;
        let values = triples(&self.finite(values, &format!("force on {patch}"), time)?);
        Ok(Force { pressure: values[0], viscous: values[1] })
    }

    /// Flow through a patch at time number `time`.
    pub fn flow(&mut self, patch: &str, time: usize) -> Result<Flow> {
        let v = self.handle.query(&json!({ "query": "flow", "patch": patch, "time": time }))?;
        let v = self.finite(v, &format!("flow through {patch}"), time)?;
        let area = v[1].max(f64::MIN_POSITIVE);
        Ok(Flow { flux: v[0], area: v[1], velocity: [v[2] / area, v[3] / area, v[4] / area] })
    }

    fn finite(&self, values: Vec<f64>, what: &str, time: usize) -> Result<Vec<f64>> {
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(values),
            Some(i) => Err(Error::Numerical(format!(
                "{what} of {} at time {} holds {} (value {i} of {}): the run went wrong there, and nothing can be compared",
                self.description.path,
                self.description.times.get(time).copied().unwrap_or(f64::NAN),
                values[i],
                values.len()
            ))),
        }
    }
}

/// OpenFOAM strips these characters from paths, and then ends the process or looks elsewhere.
fn check_name(folder: &Path) -> Result<()> {
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let Some(text) = whole.to_str() else {
        return Err(Error::Input(format!(
            "{}: the path is not UTF-8; OpenFOAM cannot read such a case: rename the folder",
            whole.to_string_lossy()
        )));
    };
    match text.chars().find(|c| c.is_whitespace() || matches!(c, '"' | '\'')) {
        None => Ok(()),
        Some(c) => Err(Error::Input(format!(
            "{text}: the path has the character {c:?}, which OpenFOAM takes in no path; expected none of blanks and quotes: \
             rename the folder, or make a symbolic link to it elsewhere and give that"
        ))),
    }
}

fn triples(values: &[f64]) -> Vec<[f64; 3]> {
    values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect()
}
