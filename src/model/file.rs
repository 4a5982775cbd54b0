//! Model files: safetensors with the description as JSON under the metadata key `m4gn`.
//!
//! A file is data only: nothing in it is run, every length is checked against the file before it is used.

use super::{Model, ModelSpec, Tensor};
use m4gn_mesh::{Error, Result};
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Metadata key of the description.
const KEY: &str = "m4gn";

impl Model {
    /// Reads and checks a model file.
    ///
    /// # Errors
    /// [`Error::File`] when it is missing, truncated, not safetensors, or not a model of this program;
    /// all name the file.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        Self::from_bytes(&Self::read_bytes(path)?, path)
    }

    /// The bytes of a model file, not looked at yet: what the root rank hands to the others.
    ///
    /// # Errors
    /// [`Error::File`] when it cannot be read.
    pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>> {
        let path = path.as_ref();
        std::fs::read(path).map_err(|e| {
            Error::file(
                path,
                format!("the model cannot be read: {e}. Expected a .safetensors file of `m4gn train`"),
            )
        })
    }

    /// A model from a file's bytes; `origin` is named in errors.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn from_bytes(bytes: &[u8], origin: impl AsRef<Path>) -> Result<Self> {
        Self::parse(bytes).map_err(|e| match e {
            Error::File { message, .. } => Error::file(origin, message),
            other => Error::file(origin, format!("not a usable model: {other}")),
        })
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| damaged(&e, bytes.len()))?;
        let json = header
            .metadata()
            .as_ref()
            .and_then(|m| m.get(KEY))
            .ok_or_else(|| {
                Error::Model(format!(
                    "the safetensors header has no '{KEY}' entry: not written by `m4gn train`"
                ))
            })?;
        let spec: ModelSpec = serde_json::from_str(json).map_err(|e| {
            Error::Model(format!(
                "the '{KEY}' entry of the header cannot be understood: {e}"
            ))
        })?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| damaged(&e, bytes.len()))?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(Error::Model(format!(
                    "tensor '{name}': expected F32, found {:?}",
                    view.dtype()
                )));
            }
            let data = view
                .data()
                .as_chunks::<4>()
                .0
                .iter()
                .map(|b| f32::from_le_bytes(*b))
                .collect();
            tensors.insert(
                name.to_owned(),
                Tensor {
                    shape: view.shape().to_vec(),
                    data,
                },
            );
        }
        Model::new(spec, tensors)
    }

    /// The bytes of the model's file, the same for the same model.
    ///
    /// # Errors
    /// [`Error::Model`] when the description cannot be written as JSON or a tensor has another length than its
    /// shape says.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let json = serde_json::to_string(&self.spec)
            .map_err(|e| Error::Model(format!("the description cannot be written as JSON: {e}")))?;
        let bytes: BTreeMap<&str, Vec<u8>> = self
            .tensors
            .iter()
            .map(|(name, t)| {
                (
                    name.as_str(),
                    t.data.iter().flat_map(|v| v.to_le_bytes()).collect(),
                )
            })
            .collect();
        let views: Vec<(&str, TensorView)> = self
            .tensors
            .iter()
            .map(|(name, t)| {
                let view = TensorView::new(Dtype::F32, t.shape.clone(), &bytes[name.as_str()])
                    .map_err(|e| Error::Model(format!("tensor '{name}': {e}")))?;
                Ok((name.as_str(), view))
            })
            .collect::<Result<_>>()?;
        safetensors::serialize(views, Some(HashMap::from([(KEY.to_owned(), json)])))
            .map_err(|e| Error::Model(format!("the model cannot be written: {e}")))
    }

    /// Writes the model beside `path` first and renames it when it is whole.
    ///
    /// # Errors
    /// [`Error::Model`] for a model that [`Model::new`] would refuse, [`Error::File`] when writing fails: `path` is
    /// then as it was.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        self.check()?;
        let bytes = self.to_bytes()?;
        m4gn_mesh::files::write_whole(path, &bytes)
    }
}

/// What is wrong with the file, in a reader's words.
fn damaged(e: &SafeTensorError, length: usize) -> Error {
    let what = match e {
        SafeTensorError::HeaderTooSmall
        | SafeTensorError::InvalidHeaderLength
        | SafeTensorError::MetadataIncompleteBuffer => "the file is truncated or has bytes too many",
        SafeTensorError::HeaderTooLarge
        | SafeTensorError::InvalidHeader(_)
        | SafeTensorError::InvalidHeaderDeserialization(_)
        | SafeTensorError::JsonError(_) => "this is not a safetensors file",
        _ => "the file is damaged",
    };
    Error::Model(format!("{what} ({length} bytes; {e})"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::spec;
    use proptest::prelude::*;

    #[test]
    fn written_models_read_back_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let model = Model::random(spec(), 3).unwrap();
        model.write(&path).unwrap();
        assert_eq!(Model::read(&path).unwrap(), model);
        assert_eq!(std::fs::read(&path).unwrap(), model.to_bytes().unwrap());
        assert_eq!(
            std::fs::read_dir(folder.path()).unwrap().count(),
            1,
            "a temporary file is left"
        );
    }

    #[test]
    fn errors_name_the_file_and_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let message = |path: &Path| Model::read(path).unwrap_err().to_string();
        assert!(message(&path).contains("a.safetensors") && message(&path).contains("No such file"));
        let bytes = Model::random(spec(), 3).unwrap().to_bytes().unwrap();
        for (content, word) in [
            (&bytes[..bytes.len() - 1], "truncated"),
            (&bytes[..100], "truncated"),
            (&b""[..], "truncated"),
            (&b"FoamFile { version 2.0; }"[..], "not a safetensors file"),
        ] {
            std::fs::write(&path, content).unwrap();
            assert!(message(&path).contains(word), "{}", message(&path));
        }
        let mut other = Model::random(spec(), 3).unwrap();
        other.spec.dim = 3;
        std::fs::write(&path, other.to_bytes().unwrap()).unwrap();
        assert!(message(&path).contains("expected"), "{}", message(&path));
        let nowhere = folder.path().join("no/such/folder.safetensors");
        assert!(matches!(
            Model::random(spec(), 3).unwrap().write(&nowhere),
            Err(Error::File { .. })
        ));
        other.spec.stride = f64::INFINITY;
        assert!(matches!(other.write(&path), Err(Error::Model(_))));
    }

    /// The C++ tests' model is of today's format: it is made again with
    /// `cargo run -p m4gn-workbench --example random_model -- tests/cabi/small.safetensors 1`.
    #[test]
    fn the_model_of_the_abi_tests_is_current() {
        let model = Model::read(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../tests/cabi/small.safetensors"
        ))
        .unwrap();
        assert_eq!(model.spec.segments.count, 4);
    }

    #[test]
    fn other_safetensors_files_are_told_apart() {
        let view = TensorView::new(Dtype::F32, vec![1], &[0; 4]).unwrap();
        let bytes = safetensors::serialize([("a", view)], None).unwrap();
        let message = Model::from_bytes(&bytes, "b").unwrap_err().to_string();
        assert!(message.contains("no 'm4gn' entry"), "{message}");
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

        /// Whatever is cut off or flipped, reading ends in a model or an error, never in a panic.
        #[test]
        fn damaged_bytes_never_panic(cut in any::<prop::sample::Index>(), truncate in any::<bool>(),
                                     flips in prop::collection::vec((any::<prop::sample::Index>(), 0u8..8), 0..20),
                                     in_header in any::<bool>()) {
            let mut bytes = Model::random(spec(), 3).unwrap().to_bytes().unwrap();
            if truncate {
                bytes.truncate(cut.index(bytes.len()));
            }
            let range = if in_header { bytes.len().min(12_000) } else { bytes.len() };
            for (at, bit) in flips {
                if range > 0 {
                    let i = at.index(range);
                    bytes[i] ^= 1 << bit;
                }
            }
            if let Ok(model) = Model::from_bytes(&bytes, "damaged") {
                prop_assert!(model.spec.check().is_ok());
            }
        }
    }
}
