//! A network and its graph as files that other programs read.

use super::Workload;
use m4gn_base::{Error, Result};
use m4gn_engine::{EngineOptions, Forward};
use safetensors::{Dtype, tensor::TensorView};
use serde_json::Value;
use std::path::Path;

/// Writes `model.safetensors` and `graph.safetensors` to a folder: senders, receivers, node types as places in the
/// model's list, edge features, physical inputs, and the outputs of the native engine in fp32.
///
/// # Errors
/// What the engine returns; [`Error::File`] for what cannot be written.
pub fn export(workload: &Workload, folder: &Path) -> Result<Value> {
    std::fs::create_dir_all(folder).map_err(Error::cannot("made", folder))?;
    let structure = workload.structure()?;
    let graph = &structure.graph;
    let (inputs, mut outputs) = workload.values(graph)?;
    workload.engine(&structure, &EngineOptions::default())?.forward(&workload.comm, &inputs, &mut outputs)?;
    workload.model.write(folder.join("model.safetensors"))?;
    let spec = &workload.model.spec;
    let kinds: Vec<i32> = graph.node_types[..graph.n_owned]
        .iter()
        .map(|&code| {
            let at = spec.node_types.iter().position(|t| *t as i32 == code);
            at.map(|i| i as i32)
                .ok_or_else(|| Error::Model(format!("the model does not know node type {code}")))
        })
        .collect::<Result<_>>()?;
    let float = |data: &[f32], width: usize| {
        let bytes = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        (Dtype::F32, vec![data.len() / width.max(1), width], bytes)
    };
    let integer = |data: &[i32]| {
        let bytes = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        (Dtype::I32, vec![data.len()], bytes)
    };
    let tensors = [
        ("senders", integer(&graph.senders)),
        ("receivers", integer(&graph.receivers)),
        ("node_types", integer(&kinds)),
        ("edge_features", float(&graph.edge_features, spec.n_edge_features())),
        ("inputs", float(&inputs, spec.n_field_inputs())),
        ("outputs", float(&outputs, spec.n_outputs())),
    ];
    write_tensors(&folder.join("graph.safetensors"), &tensors)?;
    Ok(workload.describe(graph))
}

/// A tensor as type, shape and little-endian values.
type Bytes = (Dtype, Vec<usize>, Vec<u8>);

fn write_tensors(path: &Path, tensors: &[(&str, Bytes)]) -> Result<()> {
    let failed = |e: &dyn std::fmt::Display| Error::file(path, format!("cannot be written: {e}"));
    let views = tensors
        .iter()
        .map(|(name, (kind, shape, data))| {
            let view = TensorView::new(*kind, shape.clone(), data);
            view.map(|v| (*name, v)).map_err(|e| failed(&e))
        })
        .collect::<Result<Vec<_>>>()?;
    let bytes = safetensors::serialize(views, None).map_err(|e| failed(&e))?;
    m4gn_base::files::write_whole(path, &bytes)
}
