//! Modes of a body by its elements.

use super::{Fixed, Options, PointMesh, modes};
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::NodeType;
use m4gn_mesh::body::Body;
use m4gn_model::modal::{ModalOptions, Modes};
use m4gn_parallel::Comm;

/// The first elastic modes of a whole body, its handle held, as features of its points: three components a mode.
/// Computed by this rank alone.
///
/// # Errors
/// As [`modes`]: [`Error::Input`] for a body without handle, a material out of range, more modes than unknowns.
pub fn body_modes(body: &Body, modal: &ModalOptions) -> Result<Modes> {
    let cells: Vec<Vec<Vec<usize>>> = (0..body.elements.len())
        .map(|e| {
            let points = body.elements.points_of(e);
            let face = |side: &&[usize]| side.iter().map(|&i| points[i] as usize).collect();
            body.elements.kind[e].sides().iter().map(face).collect()
        })
        .collect();
    let mesh = PointMesh::from_cells(body.positions.clone(), &cells);
    let held: Vec<Fixed> =
        (0..).zip(&body.types).filter(|(_, t)| **t == NodeType::Handle).map(|(p, _)| Fixed::all(p)).collect();
    refuse(held.is_empty(), Error::Input, || {
        "no point of the body is a handle: a body that is held nowhere has no static answer to an obstacle; mark \
             the held points with type 7"
    })?;
    let options = Options { modal: modal.clone(), ..Options::default() };
    let found = modes(&mesh, &body.material, &held, &options, &Comm::serial())?;
    let component = |i: usize| move |u: &[f64; 3]| u[i];
    Ok(Modes {
        eigenvalues: found.eigenvalues.iter().flat_map(|&v| [v; 3]).collect(),
        vectors: found
            .vectors
            .iter()
            .flat_map(|mode| [0, 1, 2].map(|i| mode.iter().map(component(i)).collect()))
            .collect(),
    })
}
