//! Trajectories to learn from: fields, graphs and segments, made by the functions that the session uses.

use super::copies::Copies;
use m4gn_contact::graph::ContactGraph;
use m4gn_contact::part::BodyPart;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Mesh, NodeType, Result};
use m4gn_model::modal::ModalSource;
use m4gn_model::{Extent, FieldSpec, ModelSpec, Output, SegmentSpec, cell_size};
use m4gn_modes::Modal;
use m4gn_step::faces_seen_as_their_cells;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;
use std::borrow::Cow;
use std::fmt::Debug;
use std::sync::Arc;

/// Where frames are read from when they are needed: data sets may be larger than the memory.
pub trait FrameSource: Debug + Send + Sync {
    /// All fields of a frame of the mesh that the sample was made of: cells, boundary faces, points of the obstacle
    /// `[nodes x components]`.
    ///
    /// # Errors
    /// [`Error::File`](m4gn_mesh::Error::File) for a frame that cannot be read.
    fn frame(&self, frame: usize) -> Result<Vec<f32>>;
}

/// One trajectory.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What the network lives on; of a body at points at rest.
    pub structure: Structure,
    /// A body at points.
    pub contact: Option<ContactGraph>,
    /// Owner cell of each boundary node.
    pub owners: Vec<u32>,
    /// Whether a boundary value is its owner's (outflow, symmetry) or prescribed, `[B x components]`.
    pub copies: Vec<bool>,
    /// Points that are held; none for cells.
    pub held: Option<Vec<bool>>,
    /// All fields of all frames: cells then boundary nodes, `[T x (C + B) x components]`; empty where they stay on disk.
    pub frames: Vec<f32>,
    /// What frames are read from; none where they are in memory.
    pub source: Option<Arc<dyn FrameSource>>,
    /// What the frames span; none where they were not read from a file.
    pub extent: Option<Extent>,
    /// Number of frames.
    pub n_frames: usize,
    /// Mean distance of neighbouring nodes, m; of a body at rest.
    pub cell_size: f64,
    /// The way from the cells, where the nodes are groups of them.
    pub coarse: Option<Coarse>,
    /// Components of all fields together.
    pub width: usize,
}

/// Components of the fields: which are inputs, which outputs, and how.
#[derive(Clone, Debug)]
pub struct Components {
    /// Components of all fields together.
    pub count: usize,
    /// Field of each component.
    pub field: Vec<usize>,
    /// Components that are inputs.
    pub inputs: Vec<usize>,
    /// Components that are predicted.
    pub outputs: Vec<usize>,
    /// Components that change sign under reflection in the second direction.
    pub odd: Vec<bool>,
}

impl Components {
    /// Counts the components of a model's fields.
    pub fn new(spec: &ModelSpec) -> Self {
        let mut c = Components {
            count: 0,
            field: vec![],
            inputs: vec![],
            outputs: vec![],
            odd: vec![],
        };
        for (f, field) in spec.fields.iter().enumerate() {
            for i in 0..field.components(spec.dim) {
                if field.input {
                    c.inputs.push(c.count);
                }
                if field.output != Output::None {
                    c.outputs.push(c.count);
                }
                c.field.push(f);
                c.odd.push(field.vector && i == 1);
                c.count += 1;
            }
        }
        c
    }

    /// Components of the first predicted field.
    pub fn headline(&self) -> impl Iterator<Item = usize> {
        let field = self.field[self.outputs[0]];
        (0..self.count).filter(move |&i| self.field[i] == field)
    }

    /// Mean square, over the cells (of which there are `cells`) and its components, of the difference of the first predicted field
    /// in two frames.
    pub fn mean_square(&self, a: &[f32], b: &[f32], cells: usize) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        let rows = a.chunks_exact(self.count).zip(b.chunks_exact(self.count));
        for (a, b) in rows.take(cells) {
            for i in self.headline() {
                sum += (f64::from(a[i]) - f64::from(b[i])).powi(2);
                n += 1.0;
            }
        }
        sum / n
    }
}

impl Sample {
    /// Graph and segments of an undecomposed mesh, without frames, at a resolution (m) or a node a cell. `labels [C]` are
    /// segments of the cells computed before.
    ///
    /// # Errors
    /// For a mesh that no graph can be made of, or segments that cannot be found.
    pub fn of_mesh(
        mesh: &Mesh,
        spec: &ModelSpec,
        segments: &SegmentSpec,
        resolution: Option<f64>,
        labels: Option<&[i32]>,
    ) -> Result<Self> {
        let comm = Comm::serial();
        let coarse = match resolution {
            Some(length) => Coarse::new(mesh, length, &comm)?,
            None => None,
        };
        let nodes = coarse.as_ref().map_or(mesh, |coarse| &coarse.mesh);
        let labels = match (&coarse, labels) {
            (Some(coarse), Some(labels)) => Some(coarse.labels_of_groups(mesh, labels, &comm)),
            (_, labels) => labels.map(<[i32]>::to_vec),
        };
        let modal = Modal(segments.modal());
        let structure = Structure::new(nodes, spec, segments, &modal, labels.as_deref(), &comm)?;
        let owners = nodes.boundary.iter().map(|b| b.owner as u32).collect();
        Ok(Sample {
            cell_size: cell_size(nodes, &comm),
            coarse,
            ..Self::without_frames(structure, owners, spec)
        })
    }

    /// Appends a frame of the mesh that the sample was made of: all fields, cells and then boundary nodes
    /// `[(C + B) x components]`. Faces that the network sees as their cells get the cells' vectors.
    pub fn push(&mut self, mesh: &Mesh, spec: &ModelSpec, mut frame: Vec<f32>) {
        let as_cells = faces_seen_as_their_cells(mesh);
        see_as_cells(&as_cells, &spec.fields, spec.dim, mesh.n_cells(), &mut frame);
        let frame = self.at_nodes(frame);
        self.frames.extend(frame);
        self.n_frames += 1;
    }

    /// A frame of the cells at the nodes of the network, which may be groups of cells.
    pub fn at_nodes(&self, frame: Vec<f32>) -> Vec<f32> {
        match &self.coarse {
            Some(coarse) => {
                coarse
                    .transfer
                    .restrict(&frame, self.width, &Comm::serial())
                    .values
            }
            None => frame,
        }
    }

    /// Finds by the frames in memory which boundary values are their owners'. `mesh` is the one that the sample was made of.
    /// The boundary of a body is its obstacle, whose motion is its own.
    pub fn find_copies(&mut self, mesh: &Mesh, spec: &ModelSpec) {
        if self.contact.is_some() {
            return;
        }
        let nodes = self.coarse.as_ref().map_or(mesh, |coarse| &coarse.mesh);
        let mut copies = Copies::new(nodes, spec);
        let size = self.structure.graph.n_owned * self.width;
        self.frames.chunks_exact(size).for_each(|frame| copies.see(frame));
        let mut found = vec![false; self.copies.len()];
        copies.mark(&mut found);
        self.copies = found;
    }

    /// The graph and segments of a body, without frames. `labels [N]` are segments of its points found before.
    ///
    /// # Errors
    /// For a body or an obstacle that no graph can be made of, or segments that cannot be found.
    pub fn of_body(
        body: &Body,
        obstacle: Option<&Obstacle>,
        spec: &ModelSpec,
        labels: Option<&[i32]>,
    ) -> Result<Self> {
        let comm = Comm::serial();
        let radius = spec.contact.map_or(0.0, |c| c.radius);
        let part = BodyPart::whole(body, obstacle)?;
        let contact = ContactGraph::new(&part, radius, &comm)?;
        let settings = &spec.segments;
        let cut = match labels {
            _ if !spec.architecture.needs().segments => None,
            Some(labels) => Some(m4gn_contact::segments::of_labels(
                &part, &contact, spec, settings, labels, &comm,
            )?),
            None => {
                let modes = match settings.method.uses_modes() && settings.count > 1 {
                    true => Some(Modal::default().of_body(body, settings.mode_count())?),
                    false => None,
                };
                let modes = modes.as_ref();
                Some(m4gn_contact::segments::segment(
                    &part, &contact, spec, settings, modes, &comm,
                )?)
            }
        };
        let structure = Structure {
            graph: contact.graph().clone(),
            segments: cut,
        };
        let owners = vec![0; structure.graph.n_owned - structure.graph.n_cells];
        Ok(Sample {
            cell_size: cell_size(&part.mesh, &comm),
            contact: Some(contact),
            held: Some(body.types.iter().map(|t| *t == NodeType::Handle).collect()),
            ..Self::without_frames(structure, owners, spec)
        })
    }

    fn without_frames(structure: Structure, owners: Vec<u32>, spec: &ModelSpec) -> Self {
        let width = Components::new(spec).count;
        Sample {
            structure,
            contact: None,
            copies: vec![false; owners.len() * width],
            owners,
            held: None,
            frames: Vec::new(),
            source: None,
            extent: None,
            n_frames: 0,
            cell_size: 0.0,
            coarse: None,
            width,
        }
    }

    /// All fields of a frame: cells, then boundary nodes.
    ///
    /// # Errors
    /// [`Error::File`](m4gn_mesh::Error::File) where the frame has to be read, and cannot be.
    pub fn frame(&self, frame: usize) -> Result<Cow<'_, [f32]>> {
        let size = self.structure.graph.n_owned * self.width;
        match &self.source {
            Some(source) => Ok(Cow::Owned(self.at_nodes(source.frame(frame)?))),
            None => Ok(Cow::Borrowed(&self.frames[frame * size..(frame + 1) * size])),
        }
    }

    /// Whether its frames are read from the file when they are needed.
    pub fn is_streamed(&self) -> bool {
        self.source.is_some()
    }

    /// Bytes of all its frames in memory.
    pub fn frame_bytes(&self) -> u64 {
        (self.n_frames * self.structure.graph.n_owned * self.width * size_of::<f32>()) as u64
    }

    /// Cells, or points of a body.
    pub fn n_cells(&self) -> usize {
        self.structure.graph.n_cells
    }

    /// Nodes of the boundary, or points of the obstacle.
    pub fn n_boundary(&self) -> usize {
        self.structure.graph.n_owned - self.structure.graph.n_cells
    }

    /// Its structure reflected in the second direction; of a body at points at rest.
    pub fn reflected(&self, spec: &ModelSpec) -> Structure {
        let Some(contact) = &self.contact else {
            return self.structure.reflected(spec);
        };
        let mut reflected = self.structure.clone();
        reflected.graph = contact.reflected().graph().clone();
        reflected.reflect_segments(spec);
        reflected
    }
}

/// Gives faces that a network sees as their cells the cells' vectors.
pub fn see_as_cells(
    as_cells: &[(usize, usize)],
    fields: &[FieldSpec],
    dim: usize,
    cells: usize,
    frame: &mut [f32],
) {
    let width: usize = fields.iter().map(|f| f.components(dim)).sum();
    let mut first = 0;
    for field in fields {
        let n = field.components(dim);
        for &(face, cell) in as_cells.iter().filter(|_| field.vector) {
            let at = |node: usize| node * width + first;
            frame.copy_within(at(cell)..at(cell) + n, at(cells + face));
        }
        first += n;
    }
}
