//! What is found in a file, checked before it is believed: sizes against the file's, labels against ranges.

use super::schema::{FORMAT, FieldMeta, LONG, NAME, POINTS_VERSION, Split, Text, h5_error, quiet};
use crate::mesh::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use crate::{Error, Result};
use std::io::Read;
use std::path::Path;

/// A trajectory's file whose header is that of a whole one.
pub(super) struct Opened<'a> {
    pub(super) file: hdf5::File,
    pub(super) root: hdf5::Group,
    pub(super) source: Source<'a>,
    /// Whether the values stand on mesh points.
    pub(super) at_points: bool,
}

impl<'a> Opened<'a> {
    pub(super) fn new(path: &'a Path) -> Result<Self> {
        let file = open_file(path)?;
        let source = Source::new(path)?;
        let root = file.group("/").map_err(h5_error(path, "no root group"))?;
        source.check_header(&root)?;
        let at_points = source.is_at_points(&root)?;
        Ok(Opened {
            file,
            root,
            source,
            at_points,
        })
    }
}

/// Opens read-only, without HDF5's lock (shared file systems often have none, and files never change).
pub(super) fn open_file(path: &Path) -> Result<hdf5::File> {
    const SIGNATURE: &[u8; 8] = b"\x89HDF\r\n\x1a\n";
    quiet();
    let mut head = Vec::with_capacity(8);
    std::fs::File::open(path)
        .and_then(|f| f.take(8).read_to_end(&mut head))
        .map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
    if head != SIGNATURE {
        return Err(Error::file(
            path,
            "is not an HDF5 file; expected a trajectory (*.h5) of m4gn",
        ));
    }
    hdf5::FileBuilder::new()
        .with_fapl(|p| p.file_locking(false).libver_v110())
        .open(path)
        .map_err(|e| Error::file(path, format!("is truncated or damaged, record it again ({e})")))
}

/// The file while it is opened: everything found in it is checked against its length before memory is taken.
pub(super) struct Source<'a> {
    pub(super) path: &'a Path,
    bytes: u64,
}

impl<'a> Source<'a> {
    pub(super) fn new(path: &'a Path) -> Result<Self> {
        let bytes = path
            .metadata()
            .map(|m| m.len())
            .map_err(|e| Error::file(path, format!("cannot be read: {e}")))?;
        Ok(Source { path, bytes })
    }

    /// Length of the file.
    pub(super) fn bytes(&self) -> u64 {
        self.bytes
    }

    pub(super) fn damaged(&self, what: String) -> Error {
        Error::file(self.path, format!("{what}. The file is damaged, record it again"))
    }

    fn check_header(&self, root: &hdf5::Group) -> Result<()> {
        let format = self.text::<NAME>(root, "format").map_err(|_| {
            Error::file(
                self.path,
                format!("is HDF5 but has no attribute format = \"{FORMAT}\": not a trajectory of m4gn"),
            )
        })?;
        if format != FORMAT {
            return Err(Error::file(
                self.path,
                format!("attribute format is \"{format}\", expected \"{FORMAT}\""),
            ));
        }
        let version = self.number(root, "version")?;
        if version == 0 || version > POINTS_VERSION {
            return Err(Error::file(
                self.path,
                format!(
                    "schema version {version}, this m4gn reads up to {POINTS_VERSION}: update m4gn or record again"
                ),
            ));
        }
        if self.number(root, "complete").unwrap_or(0) != 1 {
            return Err(Error::file(
                self.path,
                "the recording was not finished (no attribute complete = 1): record it again",
            ));
        }
        Ok(())
    }

    /// Whether the values stand on mesh points; those of version 1 stand on cells.
    fn is_at_points(&self, root: &hdf5::Group) -> Result<bool> {
        if root.attr("location").is_err() {
            return Ok(false);
        }
        match self.text::<NAME>(root, "location")?.as_str() {
            "points" => Ok(true),
            "cells" => Ok(false),
            other => Err(self.damaged(format!("location \"{other}\", expected \"points\" or \"cells\""))),
        }
    }

    /// Split and provenance.
    pub(super) fn origin(&self, root: &hdf5::Group) -> Result<(Split, serde_json::Value)> {
        let provenance = self.text::<LONG>(root, "provenance")?;
        let provenance = serde_json::from_str(&provenance)
            .map_err(|e| Error::file(self.path, format!("attribute provenance is not JSON: {e}")))?;
        let split = self
            .text::<NAME>(root, "split")?
            .parse()
            .map_err(|e: Error| Error::file(self.path, e.to_string()))?;
        Ok((split, provenance))
    }

    /// The frames' times, finite and increasing.
    pub(super) fn times(&self, file: &hdf5::File) -> Result<Vec<f64>> {
        let times: Vec<f64> = self.values(file, "times", &[None])?;
        if let Some(i) = (1..times.len()).find(|&i| times[i] <= times[i - 1]) {
            let (a, b) = (times[i - 1], times[i]);
            return Err(self.damaged(format!(
                "times must increase, but frame {i} is at {b} s after {a} s"
            )));
        }
        if times.iter().any(|t| !t.is_finite()) {
            return Err(self.damaged("a time is not finite".into()));
        }
        Ok(times)
    }

    fn attribute(&self, at: &hdf5::Location, name: &str) -> Result<hdf5::Attribute> {
        at.attr(name)
            .map_err(|_| self.damaged(format!("attribute {name} of {} is missing", at.name())))
    }

    pub(super) fn text<const N: usize>(&self, at: &hdf5::Location, name: &str) -> Result<String> {
        let attribute = self.attribute(at, name)?;
        let text: Text<N> = attribute
            .read_scalar()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not text ({e})", at.name())))?;
        // The bytes come from the file: HDF5 does not promise that they are UTF-8.
        String::from_utf8(text.as_bytes().to_vec())
            .map_err(|_| self.damaged(format!("attribute {name} of {} is not UTF-8", at.name())))
    }

    fn number(&self, at: &hdf5::Location, name: &str) -> Result<u32> {
        self.attribute(at, name)?
            .read_scalar()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not a number ({e})", at.name())))
    }

    fn numbers(&self, at: &hdf5::Location, name: &str, most: usize) -> Result<Vec<i32>> {
        let attribute = self.attribute(at, name)?;
        if attribute.size() > most {
            return Err(self.damaged(format!(
                "attribute {name} of {} has {} values",
                at.name(),
                attribute.size()
            )));
        }
        attribute
            .read_raw()
            .map_err(|e| self.damaged(format!("attribute {name} of {} is not numbers ({e})", at.name())))
    }

    /// A dataset as a flat vector, of the given shape where given.
    pub(super) fn values<T: hdf5::H5Type>(
        &self,
        file: &hdf5::Group,
        name: &str,
        shape: &[Option<usize>],
    ) -> Result<Vec<T>> {
        let dataset = file
            .dataset(name)
            .map_err(|e| self.damaged(format!("dataset /{name} cannot be opened ({e})")))?;
        let found = dataset.shape();
        let fits =
            found.len() == shape.len() && found.iter().zip(shape).all(|(f, s)| s.is_none_or(|s| s == *f));
        let size = found.iter().try_fold(size_of::<T>(), |a, &n| a.checked_mul(n));
        if !fits || size.is_none_or(|s| s as u64 > self.bytes) {
            return Err(self.damaged(format!(
                "dataset /{name} has shape {found:?}, expected {}",
                shown(shape)
            )));
        }
        dataset
            .read_raw()
            .map_err(|e| self.damaged(format!("dataset /{name} cannot be read ({e})")))
    }

    pub(super) fn vectors(
        &self,
        file: &hdf5::Group,
        name: &str,
        rows: Option<usize>,
    ) -> Result<Vec<[f64; 3]>> {
        let flat: Vec<f64> = self.values(file, name, &[rows, Some(3)])?;
        Ok(flat.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect())
    }

    /// Labels, checked to be in `0..end`.
    pub(super) fn labels(
        &self,
        file: &hdf5::Group,
        name: &str,
        rows: Option<usize>,
        end: usize,
    ) -> Result<Vec<i32>> {
        self.in_range(name, self.values(file, name, &[rows])?, end)
    }

    pub(super) fn in_range(&self, name: &str, labels: Vec<i32>, end: usize) -> Result<Vec<i32>> {
        match labels
            .iter()
            .position(|&l| usize::try_from(l).map_or(true, |l| l >= end))
        {
            Some(i) => Err(self.damaged(format!(
                "/{name}[{i}] is {}, expected 0 to below {end}",
                labels[i]
            ))),
            None => Ok(labels),
        }
    }

    pub(super) fn mesh(&self, file: &hdf5::File) -> Result<Mesh> {
        let group = file
            .group("mesh")
            .map_err(|e| self.damaged(format!("group /mesh cannot be opened ({e})")))?;
        let directions = self.numbers(&group, "directions", 3)?;
        let increasing = directions.windows(2).all(|w| w[0] < w[1]);
        if directions.len() < 2 || !increasing || directions.iter().any(|d| !(0..3).contains(d)) {
            return Err(self.damaged(format!(
                "solved directions {directions:?}, expected two or three of 0, 1, 2"
            )));
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
        };
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
        if let Some(g) = neighbour
            .iter()
            .find(|&&g| usize::try_from(g).map_or(true, |g| g >= n_cells))
        {
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
            vectors: (0..m)
                .map(|i| cells[i * n_cells..(i + 1) * n_cells].to_vec())
                .collect(),
            eigenvalues,
        }))
    }

    pub(super) fn fields(&self, file: &hdf5::File, mesh: &Mesh, n_frames: usize) -> Result<Vec<FieldMeta>> {
        let group = file
            .group("fields")
            .map_err(|e| self.damaged(format!("group /fields cannot be opened ({e})")))?;
        let mut names = group
            .member_names()
            .map_err(|e| self.damaged(format!("group /fields cannot be listed ({e})")))?;
        names.sort();
        let mut fields = Vec::with_capacity(names.len());
        for name in names {
            let at = group
                .group(&name)
                .map_err(|e| self.damaged(format!("group /fields/{name} cannot be opened ({e})")))?;
            let vector = self.number(&at, "vector")? != 0;
            let dimensions = self.numbers(&at, "dimensions", 7)?;
            let dimensions = <[i32; 7]>::try_from(dimensions).map_err(|d| {
                self.damaged(format!("field {name} has dimensions {d:?}, expected 7 exponents"))
            })?;
            let meta = FieldMeta {
                name,
                vector,
                dimensions,
            };
            let c = meta.components(mesh.dim());
            for (part, rows) in [("cells", mesh.n_cells()), ("boundary", mesh.boundary.len())] {
                let name = format!("/fields/{}/{part}", meta.name);
                let found = at
                    .dataset(part)
                    .map_err(|e| self.damaged(format!("dataset {name} cannot be opened ({e})")))?;
                if found.shape() != [n_frames, rows, c] {
                    return Err(self.damaged(format!(
                        "dataset {name} has shape {:?}, expected [{n_frames}, {rows}, {c}]",
                        found.shape()
                    )));
                }
            }
            fields.push(meta);
        }
        Ok(fields)
    }
}

fn shown(shape: &[Option<usize>]) -> String {
    let parts: Vec<_> = shape
        .iter()
        .map(|s| s.map_or("any".to_string(), |n| n.to_string()))
        .collect();
    format!("[{}]", parts.join(", "))
}
