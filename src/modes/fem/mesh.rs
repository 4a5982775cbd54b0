//! The solver's mesh by points: cells as lists of faces, faces as lists of points, the way OpenFOAM keeps them.

use super::check;
use m4gn_base::{Error, Result, refuse};
use m4gn_parallel::{Comm, same_on_all_ranks};
use std::collections::HashMap;

/// This rank's part of a polyhedral mesh whose unknowns stand on points. Labels are local unless called global;
/// lengths in metres.
///
/// Points on the boundary between ranks are held by every rank that has a cell at them, with one global number.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointMesh {
    /// Directions the solver solves in, as indices of x, y, z: three, or two on a mesh that is one cell thick in
    /// the third (`empty` patches).
    pub directions: Vec<usize>,
    /// Points, m.
    pub points: Vec<[f64; 3]>,
    /// Number of each point, the same on every rank that holds it: 0..N, each on at least one rank.
    pub point_global: Vec<i64>,
    /// Number of cells on this rank.
    pub n_cells: usize,
    /// Face f has the points `face_points[face_start[f]..face_start[f + 1]]`; one more than there are faces.
    pub face_start: Vec<i32>,
    /// Points around each face; the right-hand rule gives the normal, which leaves the owner.
    pub face_points: Vec<i32>,
    /// Cell that each face's normal leaves.
    pub face_owner: Vec<i32>,
    /// Cell on the other side of the first faces; those after them are on a boundary of the body or of the rank.
    pub face_neighbour: Vec<i32>,
}

/// A cell, or in 2-D its polygon.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cell {
    /// Local points; in 2-D the polygon in right-handed order.
    pub points: Vec<usize>,
    /// Faces as positions in `points`, turning so that normals leave the cell; in 2-D the polygon's sides.
    pub faces: Vec<Vec<usize>>,
}

impl PointMesh {
    /// Makes the mesh of cells that are given as closed lists of outward faces.
    pub fn from_cells(points: Vec<[f64; 3]>, cells: &[Vec<Vec<usize>>]) -> Self {
        let mut seen: HashMap<Vec<usize>, (usize, Vec<usize>, Option<usize>)> = HashMap::new();
        let mut order = Vec::new();
        for (c, faces) in cells.iter().enumerate() {
            for face in faces {
                let mut key = face.clone();
                key.sort_unstable();
                match seen.get_mut(&key) {
                    Some(entry) => entry.2 = Some(c),
                    None => {
                        seen.insert(key.clone(), (c, face.clone(), None));
                        order.push(key);
                    }
                }
            }
        }
        let mut mesh = PointMesh {
            directions: vec![0, 1, 2],
            point_global: (0..points.len() as i64).collect(),
            points,
            n_cells: cells.len(),
            face_start: vec![0],
            ..Default::default()
        };
        for internal in [true, false] {
            for (owner, face, neighbour) in order.iter().filter_map(|k| seen.get(k)) {
                if neighbour.is_some() == internal {
                    mesh.face_owner.push(*owner as i32);
                    mesh.face_neighbour.extend(neighbour.map(|n| n as i32));
                    mesh.face_points.extend(face.iter().map(|&p| p as i32));
                    mesh.face_start.push(mesh.face_points.len() as i32);
                }
            }
        }
        mesh
    }

    /// Number of faces.
    pub fn n_faces(&self) -> usize {
        self.face_owner.len()
    }

    /// Points of face `f`.
    pub fn face(&self, f: usize) -> &[i32] {
        &self.face_points[self.face_start[f] as usize..self.face_start[f + 1] as usize]
    }

    /// Solved directions: 2 or 3.
    pub fn dim(&self) -> usize {
        self.directions.len()
    }

    /// Checks lengths, label ranges, finite positions, and that every cell is a closed surface whose faces turn the
    /// same way. Collective; all ranks fail together.
    pub fn check(&self, comm: &Comm) -> Result<()> {
        comm.agree(check::local(self))?;
        refuse(!comm.any(self.n_cells > 0), Error::Mesh, || "the mesh has no cells on any rank")?;
        same_on_all_ranks(comm, &[("number of directions", self.dim() as i64)])
    }

    /// Points of each cell, ascending.
    pub fn cell_points(&self) -> Vec<Vec<usize>> {
        self.polyhedra().into_iter().map(|cell| cell.points).collect()
    }

    /// Faces of each cell, and whether the face's normal leaves it.
    pub(super) fn cell_faces(&self) -> Vec<Vec<(usize, bool)>> {
        let mut faces = vec![Vec::new(); self.n_cells];
        for (f, &c) in self.face_owner.iter().enumerate() {
            faces[c as usize].push((f, true));
        }
        for (f, &c) in self.face_neighbour.iter().enumerate() {
            faces[c as usize].push((f, false));
        }
        faces
    }

    /// The polyhedra, each with its own numbering of points.
    pub(super) fn polyhedra(&self) -> Vec<Cell> {
        let polyhedron = |faces: Vec<(usize, bool)>| {
            let around = |&(f, outward): &(usize, bool)| -> Vec<usize> {
                let points = self.face(f).iter().map(|&p| p as usize);
                match outward {
                    true => points.collect(),
                    false => points.rev().collect(),
                }
            };
            let faces: Vec<Vec<usize>> = faces.iter().map(around).collect();
            let mut points: Vec<usize> = faces.iter().flatten().copied().collect();
            points.sort_unstable();
            points.dedup();
            let place = |p: &usize| points.partition_point(|q| q < p);
            Cell { faces: faces.iter().map(|f| f.iter().map(place).collect()).collect(), points }
        };
        self.cell_faces().into_iter().map(polyhedron).collect()
    }
}
