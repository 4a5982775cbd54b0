//! Trajectories to learn from: fields, graphs and segments, made by the functions that the session uses.

use super::config::Config;
use super::copies::Copies;
use super::ranges::{Ranges, solid};
use super::recorded::{Recorded, see_as_cells};
use m4gn_contact::graph::ContactGraph;
use m4gn_contact::part::BodyPart;
use m4gn_data::Trajectory;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, NodeType, Result};
use m4gn_model::modal::ModalSource;
use m4gn_model::{Extent, FieldSpec, ModalOperator, ModelSpec, Output, SegmentSpec, cell_size};
use m4gn_modes::Modal;
use m4gn_step::faces_seen_as_their_cells;
use m4gn_structure::Structure;
use m4gn_structure::coarse::Coarse;
use std::path::Path;

/// One recorded trajectory.
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
    /// The file that frames are read from; none where they are in memory.
    pub recorded: Option<Recorded>,
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
    /// Reads a trajectory into memory and makes its graph and segments. Of a body, the obstacle's points are the boundary.
    ///
    /// # Errors
    /// [`Error::File`] for a trajectory that cannot be read, or that no graph or segments can be made of.
    pub fn read(trajectory: &Trajectory, spec: &ModelSpec) -> Result<Self> {
        Self::read_within(trajectory, spec, u64::MAX)
    }

    /// As [`Sample::read`]; frames that take more than `room` bytes stay on disk, and are read when they are needed. All of them
    /// are read here once, so that a damaged file is noticed before anything is learned.
    ///
    /// # Errors
    /// As [`Sample::read`].
    pub fn read_within(trajectory: &Trajectory, spec: &ModelSpec, room: u64) -> Result<Self> {
        let mesh = trajectory.mesh();
        let made = match trajectory.body() {
            Some(body) => Self::of_body(body, trajectory.obstacle(), spec, None),
            None => Self::of_mesh(mesh, spec, &spec.segments, spec.resolution, None),
        };
        let mut sample = made.map_err(|e| Error::file(trajectory.path(), e.to_string()))?;
        sample.n_frames = trajectory.times().len();
        let recorded = Recorded::new(trajectory, spec);
        let keep = sample.frame_bytes() <= room;
        let mut frames = Vec::new();
        if keep {
            frames.reserve_exact(sample.n_frames * sample.structure.graph.n_owned * sample.width);
        }
        let nodes = sample.coarse.as_ref().map_or(mesh, |coarse| &coarse.mesh);
        let (mut copies, mut ranges) = (Copies::new(nodes, spec), Ranges::new(spec));
        let states = recorded.open()?;
        for number in 0..sample.n_frames {
            let frame = sample.at_nodes(recorded.frame(&states, number)?);
            copies.see(&frame);
            ranges.see(match &sample.contact {
                Some(_) => &frame[..sample.n_cells() * sample.width],
                None => &frame,
            });
            if keep {
                frames.extend(frame);
            }
        }
        drop(states);
        let mut found = vec![false; sample.copies.len()];
        copies.mark(&mut found);
        sample.copies = found;
        sample.extent = Some(ranges.extent(sample.cell_size, solid(trajectory)?));
        sample.frames = frames;
        sample.recorded = (!keep).then_some(recorded);
        Ok(sample)
    }

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
    pub(super) fn at_nodes(&self, frame: Vec<f32>) -> Vec<f32> {
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
            recorded: None,
            extent: None,
            n_frames: 0,
            cell_size: 0.0,
            coarse: None,
            width,
        }
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

/// What the data say about a model: dimensions, fields, and whose modes its segments are made of.
pub(super) fn describe(config: &Config, first: &Trajectory) -> Result<ModelSpec> {
    let mesh = first.mesh();
    let fields = config.model.fields.iter().map(|wanted| {
        let found = first.field(&wanted.name)?;
        Ok(FieldSpec {
            name: found.name.clone(),
            vector: found.vector,
            dimensions: found.dimensions,
            input: wanted.input,
            output: wanted.output,
        })
    });
    let operator = match first.body() {
        Some(_) => config.segments.operator,
        None if config.segments.is_elastic(mesh)? => Some(ModalOperator::Elastic),
        None => Some(ModalOperator::Laplacian),
    };
    Ok(ModelSpec {
        format: 1,
        dim: mesh.dim(),
        stride: config.model.stride,
        fields: fields.collect::<Result<_>>()?,
        node_types: Vec::new(),
        architecture: config.architecture()?,
        contact: config.contact,
        resolution: config.model.resolution,
        segments: SegmentSpec {
            operator,
            ..config.segments.clone()
        },
        precision: config.training.precision,
        trained_on: None,
        calibration: None,
        training: serde_json::Value::Null,
    })
}

/// Frames in one model step: the stride over the frame interval, which must be a whole number.
pub fn frames_a_step(times: &[f64], stride: f64, path: &Path) -> Result<usize> {
    let count = times.len();
    if count < 2 {
        return Err(Error::file(
            path,
            format!("{count} frames: at least two are needed to learn from"),
        ));
    }
    let interval = (times[count - 1] - times[0]) / (count - 1) as f64;
    let uneven = times
        .windows(2)
        .any(|w| ((w[1] - w[0]) / interval - 1.0).abs() > 1e-3);
    let steps = stride / interval;
    if uneven || steps < 0.5 || (steps - steps.round()).abs() > 1e-3 * steps {
        return Err(Error::file(
            path,
            format!(
                "frames every {interval:.6} s{}: model.stride = {stride} s must be a multiple of an even interval",
                if uneven { " on average, not evenly" } else { "" }
            ),
        ));
    }
    Ok(steps.round() as usize)
}
