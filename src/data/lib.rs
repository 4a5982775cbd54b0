//! Recorded trajectories: one HDF5 file a trajectory, many files a folder.
//!
//! Schema, version 3 (`N` nodes: the cells, or the mesh points that take their place; `B` boundary faces, `F` internal
//! faces, `T` frames, `c` components: 1 for a scalar, one a solved direction for a vector). Everything is in the
//! undecomposed mesh's numbering, whatever the number of ranks that recorded it. Text has a fixed length.
//!
//! ```text
//! /                     attributes: format = "m4gn-trajectory", version = 3, split, provenance (JSON text),
//!                       complete = 1 (written last)
//! /mesh                 attributes: directions, patch_names
//!   cell_centres [N,3] m        cell_volumes [N] m^3
//!   face_owner, face_neighbour [F]                 face_coeff [F] m
//!   boundary_owner, boundary_type, boundary_patch [B]
//!   boundary_centres, boundary_area [B,3]          boundary_coeff [B] m
//!   coupled_owner, coupled_neighbour [C]           coupled_delta [C,3]  coupled_coeff [C]   (cyclic faces)
//!   triangles [G,3] i32           (of nodes that are points of a mesh of triangles)
//!   mode_eigenvalues [m] 1/s^2  mode_cells [m,N,3]         (elastic modes, of solids whose material is known)
//! /times [T] s                  increasing; of a quasi-static run they number the frames
//! /fields/NAME          attributes: vector, dimensions[7]
//!   cells [T,N,c] f32           boundary [T,B,c] f32 (left out where B = 0)
//! ```
//!
//! A body that deforms has its points for nodes, and elements; it is 3-D and has no boundary faces:
//!
//! ```text
//! /mesh                 no attributes
//!   cell_centres [N,3] m, points at rest           point_type [N] i32: 6 body, 7 handle (held fixed)
//! /elements             kind [E] i32 (VTK's codes)         points [sum of the kinds' points] i32, one element after another
//!                       young [E] Pa   poisson [E]   density [E] kg/m^3
//! /fields/D             displacement from rest
//! /obstacle             (optional) a rigid body with prescribed motion: its closed surface
//!   positions [Q,3] m, where its displacement is 0        triangles [G,3] i32, normals outward
//!   displacement [T,Q,3] f32 m
//! ```
//!
//! Every array that holds values has HDF5's checksum (fletcher32); arrays of frames have one frame a chunk, shuffled and
//! deflated. Files of other versions are refused.
//!
//! Files use the 1.10 file format (checksummed metadata), so that h5py, ParaView and any HDF5 since 2016 read
//! them and flipped bytes are noticed.

mod body;
mod flow;
mod layout;
mod other;
mod recorder;
mod schema;
mod self_contained;
mod source;
mod space;
mod states;
mod superblock;
mod trajectory;
mod writer;

#[cfg(test)]
mod body_tests;
#[cfg(test)]
mod damage_tests;
#[cfg(test)]
mod tests;

pub use other::{is_trajectory, open_other};
pub use recorder::Recorder;
pub use schema::{FieldMeta, Frame, Split};
pub use states::States;
pub use trajectory::{Trajectory, interval, list};
pub use writer::{WriteOptions, Writer};
