//! The solver's mesh as plain arrays, bodies, geometry and searches.
//!
//! Everything downstream (graph, modes, segments, data set) is made from the one description [`Mesh`]: cells, faces
//! between them, boundary faces, coupled faces. A mesh recorded in a data set and a mesh met inside a solver give the
//! same graph. [`ffi`] takes it from a host.

pub mod block;
pub mod body;
mod cell_sizes;
pub mod check;
mod coupled;
pub mod elements;
mod extent;
pub mod ffi;
mod field;
pub mod joined;
pub mod nearest;
pub mod surface;
pub mod vector;
pub mod whole;
pub mod within;

#[cfg(test)]
extern crate self as m4gn_mesh;
#[cfg(test)]
#[path = "../../tests/samples/mesh.rs"]
pub mod sample;

use body::{BodyShare, Obstacle};
pub use cell_sizes::CELL_SIZE;
pub use check::GlobalSizes;
pub use coupled::Ghosts;
pub use extent::Extent;
pub use field::Field;
use m4gn_base::{Error, Result};

/// What a node of the graph stands for; the one-hot part of the node features (paper, table 2, `n_i`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(i32)]
pub enum NodeType {
    /// A cell: the solver's unknown, of a solid too.
    Fluid = 0,
    /// A boundary face of a wall.
    Wall = 1,
    /// A boundary face with prescribed velocity.
    Inlet = 2,
    /// A boundary face where the flow leaves.
    Outlet = 3,
    /// A boundary face of a symmetry plane or slip wall.
    Symmetry = 4,
    /// A boundary face of a moving or rigid obstacle.
    Obstacle = 5,
    /// A point of a body.
    Body = 6,
    /// A boundary face, or a point, of a body with prescribed displacement.
    Handle = 7,
    /// A free or loaded boundary face of a body.
    Free = 8,
}

m4gn_base::names! {
    NodeType: Fluid "fluid", Wall "wall", Inlet "inlet", Outlet "outlet", Symmetry "symmetry", Obstacle "obstacle", Body "body",
    Handle "handle", Free "free"
}

impl NodeType {
    /// The type with this code.
    pub fn from_code(code: i32) -> Result<Self> {
        usize::try_from(code).ok().and_then(|c| Self::ALL.get(c).copied()).ok_or_else(|| {
            Error::Mesh(format!("node type code {code}: expected 0 to {}", Self::ALL.len() - 1))
        })
    }
}

/// A boundary face that carries a value.
#[derive(Clone, Debug, PartialEq)]
pub struct BoundaryFace {
    /// Local cell that owns the face.
    pub owner: i32,
    /// Global number of the face, the same for any decomposition (0-based among all such faces).
    pub global: i64,
    /// Face centre, m.
    pub centre: [f64; 3],
    /// Face area vector, outward, m^2.
    pub area: [f64; 3],
    /// What the solver's Laplacian with a Dirichlet condition adds to the owner's diagonal, m.
    pub coeff: f64,
    /// What the face stands for.
    pub kind: NodeType,
    /// Index of the patch into [`Mesh::patches`].
    pub patch: i32,
}

/// A face whose other side is a cell of another rank, or of the same rank through a translational cyclic.
#[derive(Clone, Debug, PartialEq)]
pub struct CoupledFace {
    /// Local cell on this side.
    pub owner: i32,
    /// Rank of the cell on the other side.
    pub rank: i32,
    /// Global number of the cell on the other side.
    pub global: i64,
    /// From this cell's centre to the other's, through the coupling (with a cyclic's transform), m.
    pub delta: [f64; 3],
    /// Coefficient of the solver's Laplacian across the face, positive, m.
    pub coeff: f64,
}

/// Modes of the elastic body that a mesh is of (eq. 5, `m4gn_modes::fem`), in its cells: what segments of a solid are made
/// of. Whoever knows the material makes them, and hands them on with the mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ElasticModes {
    /// Squared angular frequencies, 1/s^2, ascending, the same on all ranks; a repeated one is there as a whole.
    pub eigenvalues: Vec<f64>,
    /// For each mode the displacement (x, y, z) of each of this rank's cells, the mean of their points'; the root mean
    /// square over the body is 1.
    pub vectors: Vec<Vec<[f64; 3]>>,
}

/// This rank's part of the solver's mesh. Lengths in metres, labels local unless called global.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Directions the solver solves in, as indices of x, y, z: two of them in 2-D.
    pub directions: Vec<usize>,
    /// Global number of each cell, the same for any decomposition; a permutation of 0..N over all ranks.
    pub cell_global: Vec<i64>,
    /// Cell centres, m.
    pub cell_centres: Vec<[f64; 3]>,
    /// Cell volumes, m^3.
    pub cell_volumes: Vec<f64>,
    /// Cell on the owner side of each internal face.
    pub face_owner: Vec<i32>,
    /// Cell on the neighbour side of each internal face.
    pub face_neighbour: Vec<i32>,
    /// Off-diagonal magnitude of the solver's Laplacian for each internal face, positive, m.
    pub face_coeff: Vec<f64>,
    /// Boundary faces that carry a value.
    pub boundary: Vec<BoundaryFace>,
    /// Processor and cyclic faces.
    pub coupled: Vec<CoupledFace>,
    /// Names of the patches that [`BoundaryFace::patch`] counts.
    pub patches: Vec<String>,
    /// Modes of the elastic body, of meshes of solids whose material is known.
    pub elastic: Option<ElasticModes>,
    /// Of a body that deforms, whose points are the cells: what they are, and its elements. Faces, coupled faces and
    /// volumes follow from the elements and may be left out.
    pub body: Option<BodyShare>,
    /// A rigid obstacle that may touch the body; whole, on all ranks.
    pub obstacle: Option<Obstacle>,
}

impl Mesh {
    /// Number of cells on this rank.
    pub fn n_cells(&self) -> usize {
        self.cell_volumes.len()
    }

    /// Number of owned graph nodes: cells, then boundary faces.
    pub fn n_nodes(&self) -> usize {
        self.n_cells() + self.boundary.len()
    }

    /// Number of solved directions.
    pub fn dim(&self) -> usize {
        self.directions.len()
    }
}
