//! A file of others into trajectories of m4gn.

use super::bodies::Bodies;
use super::points::Points;
use super::tfrecord::TfRecord;
use super::{Arrays, copies, npz};
use m4gn_base::digest::Digest;
use m4gn_base::{Error, Result, refuse};
use m4gn_data::{Split, Trajectory};
use std::iter;
use std::path::{Path, PathBuf};

/// Poisson's ratio of bodies whose material is not known.
pub const POISSON: f64 = 0.4;

/// How a file is imported.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// What the trajectories are for; none: what the file's name begins with, or else to be trained on.
    pub split: Option<Split>,
    /// Time between frames, s, where the file does not say it.
    pub dt: Option<f64>,
    /// Poisson's ratio of bodies; none: [`POISSON`].
    pub poisson: Option<f64>,
    /// Most trajectories that are read.
    pub count: Option<usize>,
}

/// A file's trajectories, one after the other.
fn trajectories(path: &Path) -> Result<Box<dyn Iterator<Item = Result<Arrays>> + '_>> {
    Ok(match path.extension().and_then(|e| e.to_str()) {
        Some("tfrecord") => {
            let mut records = TfRecord::open(path)?;
            Box::new(iter::from_fn(move || records.next_arrays().transpose()))
        }
        Some("npz") => Box::new(iter::once(Ok(npz::read(path)?))),
        Some("h5" | "hdf5") => Box::new(copies::read(path)?),
        _ => return Err(Error::file(path, "expected a file whose name ends in .tfrecord, .npz or .h5")),
    })
}

/// Writes each trajectory of a file: the only one to `out` where that is the name of a file (`*.h5`), else into that folder, as
/// `NAME-00000.h5` and so on; those that were made of the same are kept. `done` is told of each file, and whether it was there.
///
/// # Errors
/// [`Error::File`] naming the place in the file that cannot be read or makes no trajectory, or a trajectory of the same name that was made of
/// something else; those of `done`.
pub fn import(
    path: &Path,
    out: &Path,
    options: &Options,
    done: &mut dyn FnMut(&Path, bool) -> Result<()>,
) -> Result<usize> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let splits = [Split::Train, Split::Valid, Split::Test];
    let named = splits.into_iter().find(|s| name.starts_with(s.name()));
    let split = options.split.or(named).unwrap_or(Split::Train);
    let from = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let single = out.extension().is_some_and(|e| e == "h5");
    let mut source = trajectories(path)?;
    let mut count = 0;
    while options.count.is_none_or(|most| count < most) {
        let Some(arrays) = source.next().transpose()? else { break };
        // Before the first is written
        if single && options.count != Some(1) && source.next().transpose()?.is_some() {
            return Err(Error::file(
                path,
                format!(
                    "holds more than one trajectory, and {} is one file: give a folder, or --count 1",
                    out.display()
                ),
            ));
        }
        let file: PathBuf = if single { out.into() } else { out.join(format!("{name}-{count:05}.h5")) };
        let inputs = inputs(&arrays, split, options);
        let kept = !single && file.exists();
        if kept {
            refuse(
                Trajectory::open(&file)?.provenance()["inputs"] != inputs[..],
                |what: String| Error::file(&file, what),
                || "was made of other arrays, with another --split, --dt or --poisson, or by another m4gn: choose another folder, or remove it",
            )?;
        } else {
            let numbered = |e| match (e, single) {
                (Error::File { path, message }, false) => {
                    Error::file(path, format!("trajectory {count}: {message}"))
                }
                (e, _) => e,
            };
            match Bodies::are(&arrays) {
                true => {
                    let poisson = options.poisson.unwrap_or(POISSON);
                    let bodies = Bodies::new(&arrays, options.dt, poisson, path).map_err(numbered)?;
                    bodies.write(&file, split, (&from, &inputs))?;
                }
                false => {
                    refuse(
                        options.poisson.is_some(),
                        |what: String| Error::file(path, what),
                        || "--poisson: it is for bodies, and this file has triangles: leave it out",
                    )?;
                    let points = Points::new(&arrays, options.dt, path).map_err(numbered)?;
                    points.write(&file, split, (&from, &inputs))?;
                }
            }
        }
        done(&file, kept)?;
        count += 1;
    }
    match count {
        0 => Err(Error::file(path, "holds no trajectory")),
        n => Ok(n),
    }
}

/// A digest of all that a trajectory is made from.
fn inputs(arrays: &Arrays, split: Split, options: &Options) -> String {
    let mut digest = Digest::default();
    for (name, array) in arrays {
        let shape = array.shape.iter().flat_map(|n| n.to_le_bytes());
        let values = array.data.iter().flat_map(|v| v.to_le_bytes());
        digest.add(name, &shape.chain(values).collect::<Vec<u8>>());
    }
    digest.add("options", format!("{split:?} {:?} {:?}", options.dt, options.poisson).as_bytes());
    digest.text()
}
