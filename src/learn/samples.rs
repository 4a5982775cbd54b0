//! Trajectories to learn from: fields, graphs and segments, made by the functions that the session uses.

use m4gn_base::Result;
use m4gn_domain::{Domain, Place};
use m4gn_mesh::Mesh;
use m4gn_model::{Extent, ModelSpec, SegmentSpec};
use m4gn_modes::Modal;
use m4gn_parallel::Comm;
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
    /// [`Error::File`](m4gn_base::Error::File) for a frame that cannot be read.
    fn frame(&self, frame: usize) -> Result<Vec<f32>>;
}

/// One trajectory.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What it lives on; its boundary follows as its frames show.
    pub domain: Box<dyn Domain>,
    /// What the network lives on; of a body at points at rest.
    pub structure: Structure,
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

impl Sample {
    /// Of an undecomposed mesh, without frames, at a resolution (m) or a node a cell.
    ///
    /// # Errors
    /// As [`Place::whole`].
    pub fn of_mesh(
        mesh: &Mesh,
        spec: &ModelSpec,
        segments: &SegmentSpec,
        resolution: Option<f64>,
    ) -> Result<Self> {
        let modal = Modal(segments.modal());
        let place = Place::whole(mesh, spec, segments, resolution, &modal)?;
        Ok(Sample {
            width: place.domain.components().count,
            domain: place.domain,
            structure: place.structure,
            frames: Vec::new(),
            source: None,
            extent: None,
            n_frames: 0,
            cell_size: place.cell_size,
            coarse: place.coarse,
        })
    }

    /// A frame of the cells at the nodes of the network, which may be groups of cells.
    pub fn at_nodes(&self, frame: Vec<f32>) -> Vec<f32> {
        match &self.coarse {
            Some(coarse) => coarse.transfer.restrict(&frame, self.width, &Comm::serial()).values,
            None => frame,
        }
    }

    /// All fields of a frame: cells, then boundary nodes.
    ///
    /// # Errors
    /// [`Error::File`](m4gn_base::Error::File) where the frame has to be read, and cannot be.
    pub fn frame(&self, frame: usize) -> Result<Cow<'_, [f32]>> {
        let size = self.structure.graph.n_owned * self.width;
        match &self.source {
            Some(source) => Ok(Cow::Owned(self.at_nodes(source.frame(frame)?))),
            None => Ok(Cow::Borrowed(&self.frames[frame * size..(frame + 1) * size])),
        }
    }

    /// The state of a frame, reflected in the second direction if asked for.
    ///
    /// # Errors
    /// As [`Sample::frame`].
    pub fn state(&self, frame: usize, mirror: bool) -> Result<Vec<f32>> {
        let mut state = self.frame(frame)?.into_owned();
        if mirror {
            let c = self.domain.components();
            for row in state.chunks_exact_mut(c.count) {
                let odd = row.iter_mut().zip(&c.odd);
                odd.filter(|(_, odd)| **odd).for_each(|(x, _)| *x = -*x);
            }
        }
        Ok(state)
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
}
