//! An adaptation on disk, so that a run that is carried on has the weights, the moments, the frames and the random numbers
//! of the uninterrupted one.

use super::Adaptation;
use super::learner::{Knowledge, Learner};
use super::window::Window;
use m4gn_base::{Error, Result, files};
use m4gn_model::tensor_file::{Arrays, TensorFile};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

const ENTRY: &str = "m4gn_adaptation";

/// What the file says about itself; the `m4gn_adaptation` entry of its header.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Description {
    /// Version of this schema: 2.
    version: u32,
    /// Digest of the shipped weights.
    model: u64,
    /// Nodes of the undecomposed mesh.
    nodes: usize,
    steps: u64,
    updates: u64,
    seconds: f64,
    done: bool,
    window: Window,
}

/// FNV-1a of the weights' bits.
fn digest(weights: &[f32]) -> u64 {
    let bytes = weights.iter().flat_map(|w| w.to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
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
        files::write_whole(path, &self.bytes()?)
    }

    /// The state as the bytes of a file. Not collective: all ranks have it.
    ///
    /// # Errors
    /// [`Error::Internal`] where it cannot be written down.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        let Learner { knowledge, sample, window, shipped, .. } = &self.learner;
        let optimiser = &knowledge.optimiser;
        let description = Description {
            version: 2,
            model: digest(shipped),
            nodes: sample.structure.graph.n_owned,
            steps: knowledge.steps,
            updates: optimiser.updates,
            seconds: knowledge.seconds,
            done: self.done,
            window: window.clone(),
        };
        let mut arrays = Arrays::default();
        // Before anything was learned the weights are those of the model's file, and there are no moments.
        if knowledge.steps > 0 {
            arrays.floats("weights", &optimiser.weights);
            arrays.floats("first", &optimiser.first);
            arrays.floats("second", &optimiser.second);
        }
        arrays.floats("frames", &sample.frames);
        let bytes = arrays.bytes(ENTRY, &description);
        bytes.map_err(|e| Error::Internal(format!("the state of the adaptation: {e}")))
    }

    /// Takes up the bytes of a state, which all ranks have. Collective; all ranks fail together, and nothing is changed then.
    ///
    /// # Errors
    /// [`Error::Input`] for bytes that are damaged, or of another model or mesh.
    pub fn restore(&mut self, bytes: &[u8]) -> Result<()> {
        let taken = self.take(bytes).map_err(|what| {
            Error::Input(format!("not a usable state of this adaptation ({what}); delete it to adapt anew"))
        });
        self.comm.agree(taken)
    }

    /// Takes up what [`Adaptation::save`] wrote; the first rank reads. Collective; all ranks fail together, and nothing is
    /// changed then.
    ///
    /// # Errors
    /// [`Error::File`] for a file that cannot be read, is damaged, or is of another model or mesh.
    pub fn load(&mut self, path: &Path) -> Result<()> {
        let read = match self.comm.is_root() {
            true => files::read(path).map_err(|e| Error::file(path, e.to_string())),
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
        let learner = &mut self.learner;
        if found.version != 2 {
            return Err(format!("schema version {}, this program reads 2", found.version));
        }
        if found.model != digest(&learner.shipped) {
            return Err("it began from the weights of another model".into());
        }
        let nodes = learner.sample.structure.graph.n_owned;
        if found.nodes != nodes {
            return Err(format!("{} nodes, this mesh has {nodes}", found.nodes));
        }
        let mut window = found.window;
        window.follow(&learner.window)?;
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
        let size = window.frames().checked_mul(nodes * learner.sample.width);
        let frames = array("frames", size.ok_or("too many frames")?)?;
        let n = learner.layout.len();
        let (weights, first, second) = match found.steps {
            0 => (learner.shipped.clone(), vec![0.0; n], vec![0.0; n]),
            _ => (array("weights", n)?, array("first", n)?, array("second", n)?),
        };
        if second.iter().any(|v| *v < 0.0) {
            return Err("tensor `second`: a negative number".into());
        }
        let mut optimiser = learner.knowledge.optimiser.clone();
        (optimiser.weights, optimiser.first, optimiser.second) = (weights, first, second);
        optimiser.updates = found.updates;
        let knowledge = Knowledge { optimiser, steps: found.steps, seconds: found.seconds };
        let sample = Arc::get_mut(&mut learner.sample).ok_or("its frames are being read")?;
        (sample.frames, sample.n_frames) = (frames, window.frames());
        (learner.window, learner.knowledge) = (window, knowledge);
        self.done = found.done;
        Ok(())
    }
}
