//! Exports: a model that is read once, for all that a host makes of it.

use super::guard;
use super::pointers;
use m4gn_base::{Error, Result};
use m4gn_model::{ModalOperator, Model};
use m4gn_parallel::Comm;
use m4gn_step::read_model;
use std::ffi::c_char;
use std::hash::{DefaultHasher, Hasher};
use std::path::PathBuf;
use std::sync::Arc;

/// `m4gn_model`
pub struct ModelHandle {
    pub(super) model: Arc<Model>,
    /// Of the file's bytes.
    digest: u64,
}

impl ModelHandle {
    /// What all ranks must be given alike.
    pub(super) fn shared(&self) -> String {
        format!("model {:x}", self.digest)
    }
}

/// Collective.
fn open(comm: &Comm, path: PathBuf) -> Result<ModelHandle> {
    let model = read_model(comm, &path)?;
    let mut hasher = DefaultHasher::new();
    hasher.write(&comm.agree(model.to_bytes())?);
    Ok(ModelHandle { model: Arc::new(model), digest: hasher.finish() })
}

/// Elastic modes that a model's segments need.
fn elastic_modes(model: &Model) -> Result<i32> {
    let segments = &model.spec.segments;
    let elastic = segments.operator == Some(ModalOperator::Elastic) && segments.method.uses_modes();
    let count = match elastic && model.spec.architecture.needs().segments {
        true => segments.modes,
        false => 0,
    };
    i32::try_from(count).map_err(|_| Error::Model(format!("segments.modes: {count} is too large")))
}

exports! {
    /// Reads a model.
    fn m4gn_model_open(comm: i32, path: *const c_char, model: *mut *mut ModelHandle) -> i32, or |status| status; {
        // SAFETY: the host's string and place, or null.
        unsafe {
            let (comm, place) = (Comm::from_fortran(comm), pointers::reference_mut("model", model));
            let read = |_: &Comm| {
                let path = PathBuf::from(pointers::text("path", path)?);
                let same = format!("path {}", guard::file_name(&path));
                Ok((path, same))
            };
            guard::create("m4gn_model_open", comm, place, read, open)
        }
    }

    /// Elastic modes that the mesh must have for a model; -1 for null.
    fn m4gn_model_n_elastic_modes(model: *const ModelHandle) -> i32, or guard::no_count; {
        // SAFETY: a model of ours, or null.
        elastic_modes(&unsafe { pointers::reference("model", model)? }.model)
    }
}
