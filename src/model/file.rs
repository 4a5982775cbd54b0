//! Model files: safetensors with the description as JSON under the metadata key `m4gn`.
//!
//! A file is data only: nothing in it is run, every length is checked against the file before it is used.

use super::{Model, ModelSpec, Tensor};
use m4gn_base::{Error, Result, files};
use safetensors::tensor::{Dtype, Metadata, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Metadata key of the description.
const KEY: &str = "m4gn";

/// Bytes of the number that says how long the header is.
const N_LENGTH: usize = 8;

/// Longest header, the format's own limit.
const MAX_HEADER: usize = 100_000_000;

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

    /// The bytes of a model file: what the root rank hands to the others. Its header is checked before the weights are read, so
    /// that a file of another size than its network's is not taken into memory.
    ///
    /// # Errors
    /// [`Error::File`] when it cannot be read, is not a plain file, or has a header that is no model's.
    pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>> {
        let path = path.as_ref();
        let expected = "expected a .safetensors file of `m4gn train`";
        let unreadable = |e| Error::file(path, format!("the model cannot be read: {e}; {expected}"));
        files::check_plain(path).map_err(unreadable)?;
        let mut file = File::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let mut bytes = Vec::new();
        let mut read = |bytes: &mut Vec<u8>, most: u64| {
            let part = file.by_ref().take(most).read_to_end(bytes);
            part.map_err(unreadable)
        };
        read(&mut bytes, N_LENGTH as u64)?;
        let header = header_length(&bytes).unwrap_or(0) as u64;
        read(&mut bytes, header)?;
        description(&bytes, length).map_err(|e| of_file(e, path))?;
        let rest = length - bytes.len() as u64;
        let room = usize::try_from(rest).map(|rest| bytes.try_reserve_exact(rest));
        if !matches!(room, Ok(Ok(()))) {
            return Err(Error::file(
                path,
                format!("the model takes {length} bytes, which is more than there is memory for"),
            ));
        }
        read(&mut bytes, rest)?;
        Ok(bytes)
    }

    /// A model from a file's bytes; `origin` is named in errors.
    ///
    /// # Errors
    /// As [`Model::read`].
    pub fn from_bytes(bytes: &[u8], origin: impl AsRef<Path>) -> Result<Self> {
        Self::parse(bytes).map_err(|e| of_file(e, origin))
    }

    fn parse(bytes: &[u8]) -> Result<Self> {
        let spec = description(bytes, bytes.len() as u64)?;
        let file = SafeTensors::deserialize(bytes).map_err(|e| damaged(&e, bytes.len() as u64))?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            let data = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
            tensors.insert(name.to_owned(), Tensor { shape: view.shape().to_vec(), data });
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
        let bytes = |t: &Tensor| -> Vec<u8> { t.data.iter().flat_map(|v| v.to_le_bytes()).collect() };
        let bytes: Vec<Vec<u8>> = self.tensors.values().map(bytes).collect();
        let views = self.tensors.iter().zip(&bytes).map(|((name, t), bytes)| {
            let view = TensorView::new(Dtype::F32, t.shape.clone(), bytes);
            Ok((name, view.map_err(|e| Error::Model(format!("tensor '{name}': {e}")))?))
        });
        let views = views.collect::<Result<Vec<_>>>()?;
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
        m4gn_base::files::write_whole(path, &bytes)
    }
}

/// The error of a file that is no model.
fn of_file(error: Error, path: impl AsRef<Path>) -> Error {
    match error {
        Error::File { message, .. } => Error::file(path, message),
        other => Error::file(path, format!("not a usable model: {other}")),
    }
}

/// Bytes of the JSON text that a file begins with, after the number that says so; none where there are not so many.
fn header_length(bytes: &[u8]) -> std::result::Result<usize, SafeTensorError> {
    let number = bytes.first_chunk::<N_LENGTH>();
    let length = u64::from_le_bytes(*number.ok_or(SafeTensorError::HeaderTooSmall)?);
    match usize::try_from(length) {
        Ok(length) if length <= MAX_HEADER => Ok(length),
        _ => Err(SafeTensorError::HeaderTooLarge),
    }
}

/// The description in the header of a file of `length` bytes, of which `bytes` holds the header at least; names, shapes and sizes
/// of the tensors are those of its network.
fn description(bytes: &[u8], length: u64) -> Result<ModelSpec> {
    let damaged = |e: SafeTensorError| damaged(&e, length);
    let n = header_length(bytes).map_err(damaged)?;
    let text = bytes.get(N_LENGTH..N_LENGTH + n);
    let text = text.ok_or_else(|| damaged(SafeTensorError::InvalidHeaderLength))?;
    let header: Metadata = serde_json::from_slice(text)
        .map_err(|e| damaged(SafeTensorError::InvalidHeaderDeserialization(e)))?;
    let json = header.metadata().as_ref().and_then(|m| m.get(KEY));
    let json = json.ok_or_else(|| {
        Error::Model(format!("the safetensors header has no '{KEY}' entry: not written by `m4gn train`"))
    })?;
    let spec: ModelSpec = serde_json::from_str(json)
        .map_err(|e| Error::Model(format!("the '{KEY}' entry of the header cannot be understood: {e}")))?;
    spec.check()?;
    let tensors = header.tensors();
    if let Some((name, info)) = tensors.iter().find(|(_, info)| info.dtype != Dtype::F32) {
        return Err(Error::Model(format!("tensor '{name}': expected F32, found {:?}", info.dtype)));
    }
    Model::check_shapes(&spec, tensors.iter().map(|(name, info)| (&name[..], &info.shape[..])).collect())?;
    match (N_LENGTH as u64 + n as u64).checked_add(header.data_len() as u64) {
        Some(whole) if whole == length => Ok(spec),
        _ => Err(damaged(SafeTensorError::MetadataIncompleteBuffer)),
    }
}

/// What is wrong with the file, in a reader's words.
fn damaged(e: &SafeTensorError, length: u64) -> Error {
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
    use std::io::Write;

    #[test]
    fn written_models_read_back_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let model = Model::random(spec(), 3).unwrap();
        model.write(&path).unwrap();
        assert_eq!(Model::read(&path).unwrap(), model);
        assert_eq!(std::fs::read(&path).unwrap(), model.to_bytes().unwrap());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file is left");
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
        assert!(matches!(Model::random(spec(), 3).unwrap().write(&nowhere), Err(Error::File { .. })));
        other.spec.stride = f64::INFINITY;
        assert!(matches!(other.write(&path), Err(Error::Model(_))));
    }

    /// The weights stay on disk: the file has 4 GB, of which nothing is stored.
    #[test]
    fn a_file_with_more_than_its_network_has_is_refused_by_its_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.safetensors");
        let bytes = Model::random(spec(), 3).unwrap().to_bytes().unwrap();
        let n = header_length(&bytes).unwrap();
        let data = bytes.len() - N_LENGTH - n;
        let mut header: serde_json::Value = serde_json::from_slice(&bytes[N_LENGTH..N_LENGTH + n]).unwrap();
        header["zzz"] = serde_json::json!({
            "dtype": "F32", "shape": [1u64 << 30], "data_offsets": [data, data + (4usize << 30)]
        });
        let header = header.to_string();
        let mut file = File::create(&path).unwrap();
        file.write_all(&(header.len() as u64).to_le_bytes()).unwrap();
        file.write_all(header.as_bytes()).unwrap();
        file.write_all(&bytes[N_LENGTH + n..]).unwrap();
        file.set_len((N_LENGTH + header.len() + data) as u64 + (4u64 << 30)).unwrap();
        m4gn_samples::fails(Model::read_bytes(&path), &["tensor 'zzz' is not part of this network"]);
    }

    #[test]
    fn folders_and_pipes_are_no_models() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| Model::read(path).unwrap_err().to_string();
        assert!(message(folder.path()).contains("found a folder"), "{}", message(folder.path()));
        let pipe = folder.path().join("pipe");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status().unwrap();
        assert!(made.success());
        assert!(message(&pipe).contains("found a pipe"), "{}", message(&pipe));
    }

    /// The C++ tests' model is of today's format: it is made again with
    /// `cargo run -p m4gn-workbench --example random_model -- tests/cabi/small.safetensors 1`.
    #[test]
    fn the_model_of_the_abi_tests_is_current() {
        let model =
            Model::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/cabi/small.safetensors")).unwrap();
        assert_eq!(model.spec.segments.count, 4);
    }

    #[test]
    fn other_safetensors_files_are_told_apart() {
        let view = TensorView::new(Dtype::F32, vec![1], &[0; 4]).unwrap();
        let bytes = safetensors::serialize([("a", view)], None).unwrap();
        m4gn_samples::fails(Model::from_bytes(&bytes, "b"), &["no 'm4gn' entry"]);
    }
}
