//! Trajectories of deforming bodies, recorded at mesh points. Written by `tools/m4gn_solids/recording.py`.
//!
//! Schema version 2, location "points" (`N` points, `C` elements, `E` edges, `T` frames, `Q` obstacle points; the
//! body is 3-D, all lengths in m; text attributes as in version 1):
//!
//! ```text
//! /                     attributes: format = "m4gn-trajectory", version = 2, location = "points", split,
//!                       provenance (JSON text), complete = 1 (written last)
//! /points               positions [N,3] f64, at rest        type [N] i32: 6 body, 7 handle (held fixed)
//! /elements             kind [C] i32 (VTK's codes)          start [C+1] i64     points [start[C]] i32
//!                       young [C] Pa   poisson [C]   density [C] kg/m^3
//! /edges [E,2] i32      smaller point first, sorted
//! /stiffness, /mass     (optional) of the solver, no point held, as CSR: start [3N+1] i64, column i32, value f64;
//!                       degree of freedom 3 p + i is component i of point p; N/m and kg
//! /displacement [T,N,3] f32, from rest                      chunk = one frame, shuffle, deflate 4, fletcher32
//! /von_mises [T,N] f32  (optional) Pa                       likewise
//! /times [T] s          increasing; of a quasi-static run they number the frames
//! /obstacle             (optional) a rigid body with prescribed motion: its closed surface
//!   positions [Q,3] f64, where its displacement is 0        triangles [G,3] i32, normals outward
//!   displacement [T,Q,3] f32                                chunk = one frame, ...
//! ```

use super::schema::Split;
use super::source::{Opened, Source, open_file};
use crate::solids::elements::{ElementKind, Elements};
use crate::solids::surface::check_closed;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// What a point of a body is; the codes go on from those of [`crate::mesh::NodeType`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum PointType {
    /// Free to move.
    Body = 6,
    /// Held fixed.
    Handle = 7,
}

/// Isotropic material of an element.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Material {
    /// Young's modulus, Pa.
    pub young: f64,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Density at rest, kg/m^3.
    pub density: f64,
}

/// A body at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Points `[N]`, m.
    pub positions: Vec<[f64; 3]>,
    /// What they are `[N]`.
    pub types: Vec<PointType>,
    /// Elements over them.
    pub elements: Elements,
    /// Material of each element.
    pub material: Vec<Material>,
    /// Edges of the mesh, each once, smaller point first, sorted.
    pub edges: Vec<[i32; 2]>,
}

/// The closed surface of a rigid obstacle.
#[derive(Clone, Debug, PartialEq)]
pub struct Obstacle {
    /// Points `[Q]` where its displacement is 0, m.
    pub positions: Vec<[f64; 3]>,
    /// Triangles, normals outward.
    pub triangles: Vec<[i32; 3]>,
}

/// One frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SolidFrame {
    /// Displacement of the body's points from rest `[N]`, m.
    pub displacement: Vec<[f32; 3]>,
    /// Displacement of the obstacle's points `[Q]`, m; empty without obstacle.
    pub obstacle: Vec<[f32; 3]>,
    /// Von Mises stress at the points `[N]`, Pa, where it was recorded.
    pub von_mises: Option<Vec<f32>>,
}

/// A square sparse matrix by rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Csr {
    /// Row r has the entries `start[r]..start[r + 1]`; one more than there are rows.
    pub start: Vec<usize>,
    /// Columns.
    pub column: Vec<i32>,
    /// Values.
    pub value: Vec<f64>,
}

/// A recorded trajectory of a deforming body; frames and matrices are read on demand.
#[derive(Clone, Debug)]
pub struct SolidTrajectory {
    path: PathBuf,
    body: Body,
    obstacle: Option<Obstacle>,
    times: Vec<f64>,
    has_von_mises: bool,
    provenance: serde_json::Value,
    split: Split,
}

impl SolidTrajectory {
    /// Opens a file and checks that it is a whole trajectory at points with consistent sizes.
    ///
    /// # Errors
    /// [`Error::File`] when the file is missing, not HDF5, truncated, of another format, a trajectory at cells, a newer
    /// version, incomplete, or inconsistent in itself.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        Self::read(Opened::new(path.as_ref())?)
    }

    pub(super) fn read(opened: Opened) -> Result<Self> {
        let Opened {
            file,
            root,
            source,
            at_points,
        } = opened;
        if !at_points {
            return Err(Error::file(
                source.path,
                "is a trajectory at cells (a flow), expected one at points (a deforming body)",
            ));
        }
        let (split, provenance) = source.origin(&root)?;
        let body = body(&source, &file)?;
        let times = source.times(&file)?;
        if times.is_empty() {
            return Err(source.damaged("there are no frames".into()));
        }
        let n = body.positions.len();
        let obstacle = obstacle(&source, &file)?;
        source.check_frames(&file, "displacement", &[times.len(), n, 3])?;
        if let Some(o) = &obstacle {
            source.check_frames(
                &file,
                "obstacle/displacement",
                &[times.len(), o.positions.len(), 3],
            )?;
        }
        let has_von_mises = file.link_exists("von_mises");
        if has_von_mises {
            source.check_frames(&file, "von_mises", &[times.len(), n])?;
        }
        Ok(SolidTrajectory {
            path: source.path.to_path_buf(),
            body,
            obstacle,
            times,
            has_von_mises,
            provenance,
            split,
        })
    }

    /// The file it was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The body at rest.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The obstacle, where there is one.
    pub fn obstacle(&self) -> Option<&Obstacle> {
        self.obstacle.as_ref()
    }

    /// Times of the frames, s, increasing; at least one.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Whether stresses were recorded.
    pub fn has_von_mises(&self) -> bool {
        self.has_von_mises
    }

    /// Where the trajectory came from: command, versions, parameters.
    pub fn provenance(&self) -> &serde_json::Value {
        &self.provenance
    }

    /// What the trajectory is for.
    pub fn split(&self) -> Split {
        self.split
    }

    /// One frame.
    ///
    /// # Errors
    /// As [`SolidTrajectory::read_frames`].
    pub fn read_frame(&self, frame: usize) -> Result<SolidFrame> {
        let mut frames = self.read_frames(frame, 1, 1)?;
        frames
            .pop()
            .ok_or_else(|| Error::Internal("one frame asked for, none read".into()))
    }

    /// Frames `first`, `first + step`, ... (`count` of them).
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that is not there; [`Error::File`] for a damaged or vanished file.
    pub fn read_frames(&self, first: usize, step: usize, count: usize) -> Result<Vec<SolidFrame>> {
        if count == 0 {
            return Ok(Vec::new());
        }
        let last = (count - 1).checked_mul(step).and_then(|n| n.checked_add(first));
        if last.is_none_or(|l| l >= self.times.len()) {
            return Err(Error::Input(format!(
                "{}: frames {first}, every {step}, {count} of them: the trajectory has {} frames",
                self.path.display(),
                self.times.len()
            )));
        }
        let file = open_file(&self.path)?;
        let source = Source::new(&self.path)?;
        let n = self.body.positions.len();
        (0..count)
            .map(|i| {
                let k = first + i * step;
                let vectors = |name: &str, rows: usize| -> Result<Vec<[f32; 3]>> {
                    let flat = source.frame(&file, name, &[self.times.len(), rows, 3], k)?;
                    Ok(flat.as_chunks().0.to_vec())
                };
                Ok(SolidFrame {
                    displacement: vectors("displacement", n)?,
                    obstacle: match &self.obstacle {
                        Some(o) => vectors("obstacle/displacement", o.positions.len())?,
                        None => Vec::new(),
                    },
                    von_mises: match self.has_von_mises {
                        true => Some(source.frame(&file, "von_mises", &[self.times.len(), n], k)?),
                        false => None,
                    },
                })
            })
            .collect()
    }

    /// The recorded stiffness matrix at rest with no point held, N/m; None where it was not recorded.
    ///
    /// # Errors
    /// [`Error::File`] when it is damaged.
    pub fn stiffness(&self) -> Result<Option<Csr>> {
        self.matrix("stiffness")
    }

    /// The recorded mass matrix, kg; None where it was not recorded.
    ///
    /// # Errors
    /// [`Error::File`] when it is damaged.
    pub fn mass(&self) -> Result<Option<Csr>> {
        self.matrix("mass")
    }

    fn matrix(&self, name: &str) -> Result<Option<Csr>> {
        let file = open_file(&self.path)?;
        if !file.link_exists(name) {
            return Ok(None);
        }
        let source = Source::new(&self.path)?;
        let rows = 3 * self.body.positions.len();
        let start = source.starts(&file, &format!("{name}/start"), rows, None)?;
        let entries = start[rows];
        let column = source.packed_labels(&file, &format!("{name}/column"), entries, rows)?;
        let value: Vec<f64> = source.packed(&file, &format!("{name}/value"), entries)?;
        source.check_finite(&format!("{name}/value"), &value)?;
        Ok(Some(Csr { start, column, value }))
    }
}

fn body(source: &Source, file: &hdf5::File) -> Result<Body> {
    let positions = source.vectors(file, "points/positions", None)?;
    source.check_finite("points/positions", positions.as_flattened())?;
    let n = positions.len();
    let types: Vec<i32> = source.values(file, "points/type", &[Some(n)])?;
    let types = types.iter().enumerate().map(|(i, &t)| match t {
        6 => Ok(PointType::Body),
        7 => Ok(PointType::Handle),
        _ => Err(source.damaged(format!(
            "/points/type[{i}] is {t}, expected 6 (body) or 7 (handle)"
        ))),
    });
    let types = types.collect::<Result<_>>()?;
    let kind: Vec<i32> = source.values(file, "elements/kind", &[None])?;
    let c = kind.len();
    let kind = kind.iter().enumerate().map(|(i, &k)| {
        let kind =
            ElementKind::from_code(k).map_err(|e| source.damaged(format!("/elements/kind[{i}]: {e}")))?;
        if kind.dim() == 3 {
            Ok(kind)
        } else {
            Err(source.damaged(format!("/elements/kind[{i}] is flat, expected elements in 3-D")))
        }
    });
    let kind: Vec<ElementKind> = kind.collect::<Result<_>>()?;
    let sizes: Vec<usize> = kind.iter().map(|k| k.n_points()).collect();
    let start = source.starts(file, "elements/start", c, Some(&sizes))?;
    let points = source.labels(file, "elements/points", Some(start[c]), n)?;
    let elements = Elements { kind, start, points };
    let value = |name: &str| -> Result<Vec<f64>> {
        let path = format!("elements/{name}");
        let values: Vec<f64> = source.values(file, &path, &[Some(c)])?;
        source.check_finite(&path, &values)?;
        Ok(values)
    };
    let (young, poisson, density) = (value("young")?, value("poisson")?, value("density")?);
    let material = (0..c).map(|e| Material {
        young: young[e],
        poisson: poisson[e],
        density: density[e],
    });
    let edges = source.label_rows(file, "edges", 2, n)?;
    let edges: Vec<[i32; 2]> = edges.as_chunks().0.to_vec();
    let body = Body {
        positions,
        types,
        elements,
        material: material.collect(),
        edges,
    };
    check_body(source, &body)?;
    Ok(body)
}

fn check_body(source: &Source, body: &Body) -> Result<()> {
    for (e, m) in body.material.iter().enumerate() {
        if m.young <= 0.0 || m.density <= 0.0 || !(-1.0..0.5).contains(&m.poisson) {
            let Material {
                young,
                poisson,
                density,
            } = m;
            return Err(source.damaged(format!(
                "element {e} has E {young} Pa, nu {poisson}, rho {density} kg/m^3, expected E and rho above 0 and nu \
                 below 0.5"
            )));
        }
    }
    for e in 0..body.elements.len() {
        let volume = body.elements.kind[e].measure(&body.elements.corners(e, &body.positions));
        if volume <= 0.0 {
            return Err(source.damaged(format!("element {e} has the volume {volume} m^3 at rest")));
        }
    }
    if body.edges != body.elements.edges() {
        return Err(source.damaged("/edges are not the sorted edges of /elements".into()));
    }
    Ok(())
}

fn obstacle(source: &Source, file: &hdf5::File) -> Result<Option<Obstacle>> {
    if !file.link_exists("obstacle") {
        return Ok(None);
    }
    let positions = source.vectors(file, "obstacle/positions", None)?;
    source.check_finite("obstacle/positions", positions.as_flattened())?;
    let triangles = source.label_rows(file, "obstacle/triangles", 3, positions.len())?;
    let triangles: Vec<[i32; 3]> = triangles.as_chunks().0.to_vec();
    check_closed(&triangles).map_err(|e| source.damaged(format!("/obstacle/triangles: {e}")))?;
    Ok(Some(Obstacle { positions, triangles }))
}
