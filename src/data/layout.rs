//! The datasets and attributes of a file being written.

use super::schema::{NAME, TRIANGLES, Text, h5_error, h5_text};
use hdf5::{Dataset, Group};
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Mesh;
use m4gn_mesh::body::{BodyShare, Material};
use ndarray::ArrayView2;
use std::path::Path;

/// Size of the mesh's datasets, bytes (generously); fails for meshes whose labels do not fit.
pub(super) fn mesh_bytes(mesh: &Mesh) -> Result<u64> {
    let canonical = mesh.cell_global.iter().enumerate().all(|(i, &g)| g == i as i64);
    let boundary = mesh.boundary.iter().enumerate().all(|(i, f)| f.global == i as i64);
    refuse(!canonical || !boundary, Error::Internal, || "a mesh is written that is not in global order")?;
    let body = mesh.body.as_ref().map_or(0, |b| b.points.len() + b.kind.len());
    let obstacle = mesh.obstacle.as_ref().map_or(0, |o| o.positions.len() + o.triangles.len());
    let rows = mesh.cell_global.len()
        + body
        + obstacle
        + mesh.face_coeff.len()
        + mesh.boundary.len()
        + mesh.coupled.len();
    let modes = mesh.elastic.as_ref().map_or(0, |e| e.eigenvalues.len());
    Ok(96 * rows as u64 + 24 * (modes * mesh.n_cells()) as u64)
}

/// Frames of `rows x columns` numbers.
#[derive(Debug, Default)]
pub(super) struct Rows {
    dataset: Option<Dataset>,
    pub rows: usize,
    pub columns: usize,
}

impl Rows {
    /// A new dataset, one frame a chunk; none for no rows, as HDF5 has no empty chunks.
    pub fn new(group: &Group, name: &str, rows: usize, columns: usize) -> hdf5::Result<Self> {
        if rows == 0 {
            return Ok(Rows::default());
        }
        let new = group.new_dataset::<f32>().shape([hdf5::Extent::from(0..), rows.into(), columns.into()]);
        let new = new.chunk((1, rows, columns)).shuffle().deflate(4).fletcher32();
        Ok(Rows { dataset: Some(new.create(name)?), rows, columns })
    }

    /// Numbers of a frame.
    pub fn size(&self) -> usize {
        self.rows * self.columns
    }

    /// Writes frame `index`, which is the next one.
    pub fn append(&self, index: usize, values: &[f32]) -> hdf5::Result<()> {
        let Some(dataset) = &self.dataset else { return Ok(()) };
        dataset.resize((index + 1, self.rows, self.columns))?;
        let view = ArrayView2::from_shape((self.rows, self.columns), values)
            .map_err(|e| hdf5::Error::Internal(e.to_string()))?;
        dataset.write_slice(view, (index, .., ..))
    }
}

pub(super) fn text<const N: usize>(path: &Path, at: &hdf5::Location, name: &str, value: &str) -> Result<()> {
    let value: Text<N> = h5_text(value)?;
    at.new_attr::<Text<N>>()
        .create(name)
        .and_then(|a| a.write_scalar(&value))
        .map_err(h5_error(path, &format!("attribute {name} cannot be written")))
}

pub(super) fn number(path: &Path, at: &hdf5::Location, name: &str, value: u32) -> Result<()> {
    at.new_attr::<u32>()
        .create(name)
        .and_then(|a| a.write_scalar(&value))
        .map_err(h5_error(path, &format!("attribute {name} cannot be written")))
}

pub(super) fn write_mesh(path: &Path, file: &hdf5::File, mesh: &Mesh) -> Result<()> {
    let failed = h5_error(path, "the mesh cannot be written");
    match &mesh.body {
        Some(body) => write_body(file, mesh, body).map_err(failed),
        None => write_cells(path, file, mesh),
    }
}

/// Points and elements of a whole body, and the surface of its obstacle.
fn write_body(file: &hdf5::File, mesh: &Mesh, body: &BodyShare) -> hdf5::Result<()> {
    let group = file.create_group("mesh")?;
    vectors(&group, "cell_centres", mesh.cell_centres.iter())?;
    scalars(&group, "point_type", &body.types.iter().map(|t| *t as i32).collect::<Vec<_>>())?;
    let group = file.create_group("elements")?;
    scalars(&group, "kind", &body.kind.iter().map(|k| *k as i32).collect::<Vec<_>>())?;
    scalars(&group, "points", &body.points.iter().map(|p| *p as i32).collect::<Vec<_>>())?;
    let of = |value: fn(&Material) -> f64| body.material.iter().map(value).collect::<Vec<_>>();
    scalars(&group, "young", &of(|m| m.young))?;
    scalars(&group, "poisson", &of(|m| m.poisson))?;
    scalars(&group, "density", &of(|m| m.density))?;
    if let Some(obstacle) = &mesh.obstacle {
        let group = file.create_group("obstacle")?;
        vectors(&group, "positions", obstacle.positions.iter())?;
        checked(&group, "triangles", &[obstacle.triangles.len(), 3], obstacle.triangles.as_flattened())?;
    }
    Ok(())
}

fn write_cells(path: &Path, file: &hdf5::File, mesh: &Mesh) -> Result<()> {
    let names = mesh.patches.iter().map(|p| h5_text(p)).collect::<Result<Vec<Text<NAME>>>>()?;
    let directions: Vec<i32> = mesh.directions.iter().map(|&d| d as i32).collect();
    let write = || -> hdf5::Result<()> {
        let group = file.create_group("mesh")?;
        group.new_attr_builder().with_data(&directions).create("directions")?;
        group.new_attr_builder().with_data(&names).create("patch_names")?;
        vectors(&group, "cell_centres", mesh.cell_centres.iter())?;
        scalars(&group, "cell_volumes", &mesh.cell_volumes)?;
        scalars(&group, "face_owner", &mesh.face_owner)?;
        scalars(&group, "face_neighbour", &mesh.face_neighbour)?;
        scalars(&group, "face_coeff", &mesh.face_coeff)?;
        let b = &mesh.boundary;
        scalars(&group, "boundary_owner", &b.iter().map(|f| f.owner).collect::<Vec<_>>())?;
        scalars(&group, "boundary_type", &b.iter().map(|f| f.kind as i32).collect::<Vec<_>>())?;
        scalars(&group, "boundary_patch", &b.iter().map(|f| f.patch).collect::<Vec<_>>())?;
        scalars(&group, "boundary_coeff", &b.iter().map(|f| f.coeff).collect::<Vec<_>>())?;
        vectors(&group, "boundary_centres", b.iter().map(|f| &f.centre))?;
        vectors(&group, "boundary_area", b.iter().map(|f| &f.area))?;
        if let Some(elastic) = &mesh.elastic {
            scalars(&group, "mode_eigenvalues", &elastic.eigenvalues)?;
            let shape = [elastic.eigenvalues.len(), mesh.n_cells(), 3];
            let flat: Vec<f64> = elastic.vectors.iter().flatten().flatten().copied().collect();
            checked(&group, "mode_cells", &shape, &flat)?;
        }
        let c = &mesh.coupled;
        if !c.is_empty() {
            scalars(&group, "coupled_owner", &c.iter().map(|f| f.owner).collect::<Vec<_>>())?;
            scalars(&group, "coupled_neighbour", &c.iter().map(|f| f.global).collect::<Vec<_>>())?;
            scalars(&group, "coupled_coeff", &c.iter().map(|f| f.coeff).collect::<Vec<_>>())?;
            vectors(&group, "coupled_delta", c.iter().map(|f| &f.delta))?;
        }
        Ok(())
    };
    write().map_err(h5_error(path, "the mesh cannot be written"))
}

pub(super) fn write_triangles(file: &hdf5::File, triangles: &[[i32; 3]]) -> hdf5::Result<()> {
    checked(file, TRIANGLES, &[triangles.len(), 3], triangles.as_flattened())
}

fn scalars<T: hdf5::H5Type>(group: &Group, name: &str, values: &[T]) -> hdf5::Result<()> {
    checked(group, name, &[values.len()], values)
}

fn vectors<'a>(group: &Group, name: &str, values: impl Iterator<Item = &'a [f64; 3]>) -> hdf5::Result<()> {
    let flat: Vec<f64> = values.flatten().copied().collect();
    checked(group, name, &[flat.len() / 3, 3], &flat)
}

/// An array in one piece with a checksum: HDF5 has them for chunks alone, and no chunks without values.
fn checked<T: hdf5::H5Type>(group: &Group, name: &str, shape: &[usize], values: &[T]) -> hdf5::Result<()> {
    let new = group.new_dataset::<T>().shape(shape);
    let new = match values.is_empty() {
        true => new,
        false => new.chunk(shape).fletcher32(),
    };
    new.create(name)?.write_raw(values)
}
