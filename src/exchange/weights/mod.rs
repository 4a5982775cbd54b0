//! Weights of others as models, and models as weights for others: PyTorch state dicts, of a file of safetensors or of `torch.save`.
//!
//! A state dict with m4gn's own names ([`Model::tensor_shapes`]) is any network of m4gn; one with PhysicsNeMo's names is its MeshGraphNet,
//! a network of the kind `mesh-graph-net`. What a state dict does not say (fields, stride, normalisers where it has none) is said by a
//! model that it is to be like.

mod physicsnemo;
mod pickle;
#[cfg(test)]
mod tests;

use m4gn_base::{Error, Result, files};
use m4gn_mesh::NodeType;
use m4gn_model::{Kind, MicroSpec, Model, ModelSpec, Tensor};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::BTreeMap;
use std::path::Path;

/// Tensors by name.
pub type StateDict = BTreeMap<String, Tensor>;

/// Whose names a state dict has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Naming {
    /// Those of m4gn's model files.
    Own,
    /// Those of PhysicsNeMo's MeshGraphNet.
    PhysicsNemo,
}

/// Reads a state dict: `*.safetensors`, else what `torch.save` writes. No code of the file is run. Prefixes `module.` are taken off.
///
/// # Errors
/// [`Error::File`] for a file that is neither, is damaged, or holds something else than tensors of floating-point numbers.
pub fn read(path: &Path) -> Result<StateDict> {
    let tensors = match path.extension().is_some_and(|e| e == "safetensors") {
        true => {
            let bytes = files::read(path).map_err(Error::cannot("read", path))?;
            let wrong = |what: String| Error::file(path, what);
            let file = SafeTensors::deserialize(&bytes)
                .map_err(|e| wrong(format!("is no file of safetensors, or is damaged ({e})")))?;
            let tensor = |(name, view): (String, TensorView)| {
                let data = numbers(view.dtype(), view.data()).ok_or_else(|| {
                    wrong(format!("tensor '{name}' is {:?}, expected F32 or F64", view.dtype()))
                })?;
                Ok((name, Tensor { shape: view.shape().to_vec(), data }))
            };
            file.tensors().into_iter().map(tensor).collect::<Result<StateDict>>()?
        }
        false => pickle::read(path)?,
    };
    let bare = |name: String| name.strip_prefix("module.").map_or(name.clone(), str::to_string);
    Ok(tensors.into_iter().map(|(name, t)| (bare(name), t)).collect())
}

/// Numbers in little-endian bytes, of the types that weights have.
fn numbers(kind: Dtype, bytes: &[u8]) -> Option<Vec<f32>> {
    Some(match kind {
        Dtype::F32 => bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
        Dtype::F64 => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
        _ => return None,
    })
}

/// Whose names these are.
pub fn naming(tensors: &StateDict) -> Naming {
    match tensors.keys().any(|name| name.starts_with("node_encoder.")) {
        true => Naming::PhysicsNemo,
        false => Naming::Own,
    }
}

/// The model whose weights these are: `like` says all that they do not, its number of layers, hidden layers and width excepted of a
/// MeshGraphNet of PhysicsNeMo. `node_types`: the order of the one-hot node types among its inputs; none: that of `like`.
///
/// # Errors
/// [`Error::Model`] naming the tensor that is missing, has another shape or is too many.
pub fn model(mut tensors: StateDict, like: &Model, node_types: Option<&[NodeType]>) -> Result<Model> {
    let mut spec = like.spec.clone();
    if naming(&tensors) == Naming::PhysicsNemo {
        tensors.retain(|name, _| name != "device_buffer");
        physicsnemo::measure(&tensors, &mut spec)?;
        tensors = physicsnemo::renamed(tensors, &spec, &order(&spec, node_types)?)?;
    } else if node_types.is_some() {
        return Err(Error::Input(
            "--node-types: weights with m4gn's own names have the node types of the model that they are like"
                .into(),
        ));
    }
    for (name, tensor) in like.tensors.iter().filter(|(name, _)| name.starts_with("norm.")) {
        tensors.entry(name.clone()).or_insert_with(|| tensor.clone());
    }
    spec.training = serde_json::json!({ "weights": "m4gn convert" });
    (spec.trained_on, spec.calibration) = (None, None);
    Model::new(spec, tensors)
}

/// The weights of a model under other names; normalisers stay out of those of PhysicsNeMo, which has them in files of their own.
///
/// # Errors
/// [`Error::Model`] for a network that PhysicsNeMo's MeshGraphNet is not.
pub fn state_dict(model: &Model, naming: Naming, node_types: Option<&[NodeType]>) -> Result<StateDict> {
    match naming {
        Naming::Own => Ok(model.tensors.clone()),
        Naming::PhysicsNemo => physicsnemo::others(model, &order(&model.spec, node_types)?),
    }
}

/// Writes a state dict as a file of safetensors, which PyTorch reads with `safetensors.torch.load_file`.
///
/// # Errors
/// [`Error::File`] when it cannot be written.
pub fn write(tensors: &StateDict, path: &Path) -> Result<()> {
    let wrong = |e: safetensors::SafeTensorError| Error::file(path, format!("cannot be written: {e}"));
    let bytes: Vec<Vec<u8>> =
        tensors.values().map(|t| t.data.iter().flat_map(|x| x.to_le_bytes()).collect()).collect();
    let views = tensors.iter().zip(&bytes).map(|((name, t), bytes)| {
        TensorView::new(Dtype::F32, t.shape.clone(), bytes).map(|view| (name, view))
    });
    let views = views.collect::<std::result::Result<Vec<_>, _>>().map_err(wrong)?;
    files::write_whole(path, &safetensors::serialize(views, None).map_err(wrong)?)
}

/// Of each of the others' node types, in their order, its place among the model's.
fn order(spec: &ModelSpec, node_types: Option<&[NodeType]>) -> Result<Vec<usize>> {
    let Some(theirs) = node_types else {
        return Ok((0..spec.node_types.len()).collect());
    };
    let names = |types: &[NodeType]| types.iter().map(|t| t.name()).collect::<Vec<_>>().join(",");
    let places: Option<Vec<usize>> =
        theirs.iter().map(|t| spec.node_types.iter().position(|own| own == t)).collect();
    let mut sorted = places.clone().unwrap_or_default();
    sorted.sort_unstable();
    match places {
        Some(places) if sorted.into_iter().eq(0..spec.node_types.len()) => Ok(places),
        _ => Err(Error::Input(format!(
            "--node-types {}: expected each of the model's node types once: {}",
            names(theirs),
            names(&spec.node_types)
        ))),
    }
}

/// Whether the network is one that PhysicsNeMo's MeshGraphNet is: its layers.
fn layers(spec: &ModelSpec) -> Result<usize> {
    match spec.architecture.kind {
        Kind::MeshGraphNet { layers } if spec.architecture.micro == MicroSpec::default() => Ok(layers),
        Kind::MeshGraphNet { .. } => Err(Error::Model(
            "PhysicsNeMo's MeshGraphNet sums the edges that its layer has just updated, has one encoder for all of them, and no positional \
             encoding: expected a model with node_sums = \"after\", world_edges = \"together\", node_rwse_steps = 0"
                .into(),
        )),
        _ => Err(Error::Model(format!(
            "PhysicsNeMo's MeshGraphNet is a network of kind mesh-graph-net, the model is {}",
            spec.architecture.name().name()
        ))),
    }
}
