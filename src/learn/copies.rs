//! Which boundary values are their owners', as all frames of a trajectory show together.

use m4gn_mesh::Mesh;
use m4gn_model::ModelSpec;
use m4gn_step::CopiedFaces;

/// The frames that were seen so far.
pub struct Copies<'a> {
    nodes: &'a Mesh,
    width: usize,
    /// First component, components and faces of each field.
    fields: Vec<(usize, usize, CopiedFaces<'a>)>,
}

impl<'a> Copies<'a> {
    /// Of a mesh whose cells are the network's nodes.
    pub fn new(nodes: &'a Mesh, spec: &ModelSpec) -> Self {
        let mut width = 0;
        let fields = spec.fields.iter().map(|field| {
            let (first, n) = (width, field.components(spec.dim));
            width += n;
            (first, n, CopiedFaces::new(nodes, field.vector))
        });
        let fields = fields.collect();
        Copies { nodes, width, fields }
    }

    /// Looks at a frame: all fields of the nodes, then of the boundary.
    pub fn see(&mut self, frame: &[f32]) {
        for (first, _, faces) in self.fields.iter_mut().filter(|f| f.2.asks_for_values()) {
            let mut column = frame.chunks_exact(self.width).map(|row| row[*first]);
            let cells: Vec<f32> = column.by_ref().take(self.nodes.n_cells()).collect();
            let boundary: Vec<f32> = column.collect();
            faces.see(&cells, &boundary);
        }
    }

    /// Marks the boundary values that are their owners', `[B x components]`.
    pub fn mark(&self, copies: &mut [bool]) {
        for (first, n, faces) in &self.fields {
            for (face, copy) in faces.found().into_iter().enumerate() {
                copies[face * self.width + first..][..*n].fill(copy);
            }
        }
    }
}
