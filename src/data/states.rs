//! Whole states of a trajectory, frame by frame, from a file that is opened once.

use super::schema::Frame;
use super::source::{Source, open_file};
use super::trajectory::{Trajectory, Values};
use hdf5::Dataset;
use m4gn_base::{Error, Result};

/// Several fields and the obstacle's displacement, open for reading.
pub struct States<'a> {
    source: Source<'a>,
    fields: Vec<Values>,
    motion: Option<Dataset>,
    frames: usize,
}

impl Trajectory {
    /// Opens these fields, and the obstacle's displacement where there is one.
    ///
    /// # Errors
    /// [`Error::File`] for a field that is not there, or a file that is damaged, or has vanished or changed since
    /// [`Trajectory::open`].
    pub fn states(&self, fields: &[&str]) -> Result<States<'_>> {
        let (file, source) = (open_file(self.path())?, Source::new(self.path())?);
        let opened = fields.iter().map(|name| self.open_field(&source, &file, self.field(name)?));
        Ok(States {
            fields: opened.collect::<Result<_>>()?,
            motion: self.open_motion(&source, &file)?,
            frames: self.times().len(),
            source,
        })
    }
}

impl States<'_> {
    /// Values of the fields at a frame, and the displacement of the obstacle's points `[Q]`, m (none without obstacle).
    ///
    /// # Errors
    /// [`Error::Input`] for a frame that is not there; [`Error::File`] for a damaged file.
    pub fn read(&self, frame: usize) -> Result<(Vec<Frame>, Vec<[f32; 3]>)> {
        if frame >= self.frames {
            return Err(Error::Input(format!(
                "{}: frame {frame}: the trajectory has {} frames",
                self.source.path.display(),
                self.frames
            )));
        }
        let values = self.fields.iter().map(|f| f.frame(&self.source, frame));
        let motion = match &self.motion {
            Some(motion) => self.source.frame(motion, frame)?,
            None => Vec::new(),
        };
        Ok((values.collect::<Result<_>>()?, motion.as_chunks().0.to_vec()))
    }
}
