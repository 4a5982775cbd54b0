//! Recorded trajectories: one HDF5 file a trajectory, many files a folder.
//!
//! Schema, version 1 (`N` cells, `B` boundary faces, `F` internal faces, `T` frames, `c` components: 1 for a
//! scalar, one a solved direction for a vector). Everything is in the undecomposed mesh's numbering, whatever
//! the number of ranks that recorded it.
//!
//! ```text
//! /                     attributes: format = "m4gn-trajectory", version = 1, split, provenance (JSON text),
//!                       complete = 1 (written last)
//! /mesh                 attributes: directions, patch_names
//!   cell_centres [N,3] m        cell_volumes [N] m^3
//!   face_owner, face_neighbour [F]                 face_coeff [F] m
//!   boundary_owner, boundary_type, boundary_patch [B]
//!   boundary_centres, boundary_area [B,3]          boundary_coeff [B] m
//!   coupled_owner, coupled_neighbour [C]           coupled_delta [C,3]  coupled_coeff [C]   (cyclic faces)
//!   mode_eigenvalues [m] 1/s^2  mode_cells [m,N,3]         (elastic modes, of solids whose material is known)
//! /times [T] s
//! /fields/NAME          attributes: vector, dimensions[7]
//!   cells [T,N,c] f32           boundary [T,B,c] f32     chunk = one frame, shuffle, deflate 4, fletcher32
//! ```
//!
//! Deforming bodies are recorded at mesh points, in version 2: see `points`.
//!
//! Files use the 1.10 file format (checksummed metadata), so that h5py, ParaView and any HDF5 since 2016 read
//! them and flipped bytes are noticed.

mod layout;
mod points;
mod recorded;
mod recorder;
mod rows;
mod schema;
mod source;
mod space;
mod trajectory;
mod writer;

#[cfg(test)]
mod points_tests;
#[cfg(test)]
mod tests;

pub use points::{Body, Csr, Material, Obstacle, PointType, SolidFrame, SolidTrajectory};
pub use recorded::Recorded;
pub use recorder::{FieldValues, Recorder};
pub use schema::{FieldMeta, Frame, Split};
pub use trajectory::{Trajectory, list};
pub use writer::{WriteOptions, Writer};
