//! An adaptation on disk, so that a run that is carried on has the weights, the moments, the frames and the random numbers
//! of the uninterrupted one.

use super::window::Window;
use super::{Adaptation, Clock};
use crate::regression::Regression;
use crate::tensor_file::{Arrays, TensorFile};
use m4gn_mesh::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

const ENTRY: &str = "m4gn_adaptation";

/// What the file says about itself; the `m4gn_adaptation` entry of its header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Description {
    /// Version of this schema: 1.
    version: u32,
    /// Digest of the shipped weights.
    model: u64,
    /// Nodes of the undecomposed mesh.
    nodes: usize,
    steps: u64,
    updates: u64,
    seconds: f64,
    done: bool,
    /// Of the regression, which has its sums in the array `regression` then.
    #[serde(default)]
    ridge: Option<f64>,
    #[serde(default)]
    clock: Option<Clock>,
    window: Window,
}

/// FNV-1a of the weights' bits.
fn digest(weights: &[f32]) -> u64 {
    let bytes = weights.iter().flat_map(|w| w.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

impl Adaptation {
    /// Writes the state; the first rank does. Collective; all ranks fail together.
    ///
    /// # Errors
    /// [`Error::File`] when writing fails: `path` is then as it was.
    pub fn save(&self, path: &Path) -> Result<()> {
        let written = match self.comm.is_root() {
            true => self.write(path),
            false => Ok(()),
        };
        self.comm.agree(written)
    }

    fn write(&self, path: &Path) -> Result<()> {
        let description = Description {
            version: 1,
            model: digest(&self.shipped),
            nodes: self.sample.graph.n_owned,
            steps: self.steps,
            updates: self.optimiser.updates,
            seconds: self.seconds,
            done: self.done,
            ridge: self.fitted.as_ref().map(|(_, ridge)| *ridge),
            clock: self.clock,
            window: self.window.clone(),
        };
        let mut arrays = Arrays::default();
        // Before anything was learned the weights are those of the model's file, and there are no moments.
        if self.steps > 0 {
            arrays.floats("weights", &self.optimiser.weights);
            arrays.floats("first", &self.optimiser.first);
            arrays.floats("second", &self.optimiser.second);
        }
        arrays.floats("frames", &self.sample.frames);
        if let Some((sums, _)) = &self.fitted {
            arrays.doubles("regression", &sums.sums);
        }
        arrays.write(path, "state of the adaptation", ENTRY, &description)
    }

    /// Takes up what [`Adaptation::save`] wrote; the first rank reads. Collective; all ranks fail together, and nothing is
    /// changed then.
    ///
    /// # Errors
    /// [`Error::File`] for a file that cannot be read, is damaged, or is of another model or mesh.
    pub fn load(&mut self, path: &Path) -> Result<()> {
        let read = match self.comm.is_root() {
            true => std::fs::read(path).map_err(|e| Error::file(path, e.to_string())),
            false => Ok(Vec::new()),
        };
        let mut bytes = self.comm.agree(read)?;
        self.comm.broadcast(&mut bytes);
        let taken = self.take(&bytes).map_err(|what| {
            Error::file(
                path,
                format!("not a usable state of this adaptation ({what}); delete it to adapt anew"),
            )
        });
        self.comm.agree(taken)
    }

    /// Takes up the bytes of a state; nothing is changed where they are of no use.
    fn take(&mut self, bytes: &[u8]) -> std::result::Result<(), String> {
        let (found, file): (Description, _) = TensorFile::parse(bytes, ENTRY)?;
        if found.version != 1 {
            return Err(format!("schema version {}, this program reads 1", found.version));
        }
        if found.model != digest(&self.shipped) {
            return Err("it began from the weights of another model".into());
        }
        let nodes = self.sample.graph.n_owned;
        if found.nodes != nodes {
            return Err(format!("{} nodes, this mesh has {nodes}", found.nodes));
        }
        let mut window = found.window;
        window.follow(&self.window)?;
        let stride = self.spec.stride;
        let ahead = found.clock.unwrap_or_default().ahead;
        if ![ahead.first, ahead.later].iter().all(|a| a.abs() < stride) {
            return Err(format!(
                "a clock that is {ahead:?} s off in a stride of {stride} s"
            ));
        }
        let array = |name: &str, size: usize| {
            let values = file.floats(name).ok_or_else(|| format!("no tensor `{name}`"))?;
            match values.len() == size && values.iter().all(|v| v.is_finite()) {
                true => Ok(values),
                false => Err(format!(
                    "tensor `{name}`: {} numbers, expected {size} that are all finite",
                    values.len()
                )),
            }
        };
        let size = nodes * self.sample.width;
        let n_frames = window.frames();
        let expected = n_frames.checked_mul(size).ok_or("too many frames")?;
        let frames = array("frames", expected)?;
        let n = self.layout.len();
        let (weights, first, second) = match found.steps {
            0 => (self.shipped.clone(), vec![0.0; n], vec![0.0; n]),
            _ => (array("weights", n)?, array("first", n)?, array("second", n)?),
        };
        if second.iter().any(|v| *v < 0.0) {
            return Err("tensor `second`: a negative number".into());
        }
        let mut fitted = Regression::new(&self.spec);
        let fitted = match found.ridge {
            Some(ridge) if ridge.is_finite() && ridge > 0.0 => {
                let sums = file.doubles("regression").unwrap_or_default();
                if sums.len() != fitted.sums.len() || sums.iter().any(|v| !v.is_finite()) {
                    let expected = fitted.sums.len();
                    return Err(format!("tensor `regression`: expected {expected} finite numbers"));
                }
                fitted.sums = sums;
                Some((fitted, ridge))
            }
            Some(ridge) => return Err(format!("a ridge of {ridge}")),
            None => None,
        };
        let sample = Arc::get_mut(&mut self.sample).ok_or("its frames are being read")?;
        (sample.frames, sample.n_frames) = (frames, n_frames);
        self.optimiser.weights = weights;
        (self.optimiser.first, self.optimiser.second) = (first, second);
        self.optimiser.updates = found.updates;
        (self.window, self.steps, self.fitted) = (window, found.steps, fitted);
        (self.seconds, self.done, self.clock) = (found.seconds, found.done, found.clock);
        Ok(())
    }
}
