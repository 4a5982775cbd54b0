//! Names and shapes of NVIDIA PhysicsNeMo's MeshGraphNet (`physicsnemo/models/meshgraphnet/meshgraphnet.py`, with sums and without the
//! concatenation trick) beside those of a network of kind `mesh-graph-net`.
//!
//! A perceptron there is `nn.Sequential`: linear layer i of `NAME` is `NAME.model.{2 i}`, the norm behind the last one is next. Layer l is
//! `processor.processor_layers.{2 l}.edge_mlp` and `.{2 l + 1}.node_mlp`. An edge reads `[edge, sender, receiver]` as here, a node `[sum of its
//! edges, node]` where it is `[node, sum]` here. Edges point as here: sender minus receiver.

use super::{StateDict, layers};
use m4gn_base::{Error, Result, refuse};
use m4gn_model::{Kind, Model, ModelSpec, Tensor};

/// Name here, name there, and how the columns are ordered.
type Row = (String, String, Columns);

/// Columns of a weight.
#[derive(Clone, Copy)]
enum Columns {
    Same,
    /// Two halves that change places.
    Halves,
    /// Node types among the inputs of the encoder.
    Types,
}

/// All tensors but the normalisers.
fn rows(spec: &ModelSpec) -> Result<Vec<Row>> {
    let h = spec.architecture.hidden_layers;
    let mut rows: Vec<Row> = Vec::new();
    let mut mlp = |ours: String, theirs: String, first: Columns, norm: bool| {
        for part in ["weight", "bias"] {
            for i in 0..=h {
                let columns = if i == 0 && part == "weight" { first } else { Columns::Same };
                rows.push((
                    format!("{ours}.{i}.{part}"),
                    format!("{theirs}.model.{}.{part}", 2 * i),
                    columns,
                ));
            }
            if norm {
                let theirs = format!("{theirs}.model.{}.{part}", 2 * h + 1);
                rows.push((format!("{ours}.norm.{part}"), theirs, Columns::Same));
            }
        }
    };
    mlp("encoder.node".into(), "node_encoder".into(), Columns::Types, true);
    mlp("encoder.edge".into(), "edge_encoder".into(), Columns::Same, true);
    for l in 0..layers(spec)? {
        let theirs = |i: usize, kind: &str| format!("processor.processor_layers.{i}.{kind}_mlp");
        mlp(format!("processor.{l}.edge"), theirs(2 * l, "edge"), Columns::Same, true);
        mlp(format!("processor.{l}.node"), theirs(2 * l + 1, "node"), Columns::Halves, true);
    }
    mlp("decoder".into(), "node_decoder".into(), Columns::Same, false);
    Ok(rows)
}

/// Takes width, layers and hidden layers from their tensors.
pub(super) fn measure(tensors: &StateDict, spec: &mut ModelSpec) -> Result<()> {
    let wrong = |what: &str| Error::Model(format!("{what}, expected those of PhysicsNeMo's MeshGraphNet"));
    refuse(tensors.keys().any(|name| name.contains(".lin_")), Error::Model, || {
        "the weights are of a MeshGraphNet with do_concat_trick: join lin_efeat, lin_src and lin_dst of each edge_mlp, in this order, \
             as model.0.weight"
    })?;
    let numbers = |prefix: &str, end: &str| {
        let inner = tensors.keys().filter_map(|name| name.strip_prefix(prefix)?.strip_suffix(end));
        inner.filter_map(|n| n.split('.').next()?.parse::<usize>().ok()).max()
    };
    let last = numbers("node_decoder.model.", ".weight").filter(|n| n % 2 == 0);
    let last = last.ok_or_else(|| wrong("the weights have no linear layers node_decoder.model.0, 2, ..."))?;
    let block = numbers("processor.processor_layers.", ".weight");
    let block = block.ok_or_else(|| wrong("the weights have no processor.processor_layers"))?;
    // Names are made of as many layers as a number in a name says
    let layer = last.max(block);
    refuse(layer >= tensors.len(), Error::Model, || {
        format!(
            "the weights have a layer {layer} and {} tensors in all: expected each layer up to it",
            tensors.len()
        )
    })?;
    let width = tensors.get("node_encoder.model.0.weight").and_then(|t| t.shape.first().copied());
    let a = &mut spec.architecture;
    a.width = width.ok_or_else(|| wrong("the weights have no node_encoder.model.0.weight"))?;
    a.hidden_layers = last / 2;
    a.kind = Kind::MeshGraphNet { layers: block / 2 + 1 };
    Ok(())
}

/// Puts columns of a weight into another order; of node types column j of the result is column `place(j)` of so many.
fn columns(tensor: &Tensor, ordered: Columns, place: impl Fn(usize, usize) -> usize) -> Tensor {
    let n = tensor.shape.last().copied().unwrap_or(0).max(1);
    let from = |j: usize| match ordered {
        Columns::Types => place(j, n),
        // In a weight of an odd number of columns, which is refused later, nothing changes places.
        Columns::Halves if n.is_multiple_of(2) => (j + n / 2) % n,
        _ => j,
    };
    let rows = tensor.data.chunks_exact(n);
    let data = rows.flat_map(|row| (0..n).map(|j| row[from(j)]).collect::<Vec<_>>()).collect();
    Tensor { shape: tensor.shape.clone(), data }
}

/// Their tensors under the names here.
pub(super) fn renamed(mut theirs: StateDict, spec: &ModelSpec, order: &[usize]) -> Result<StateDict> {
    let mut ours = StateDict::new();
    for (name, other, ordered) in rows(spec)? {
        let tensor = theirs.remove(&other);
        let tensor =
            tensor.ok_or_else(|| Error::Model(format!("tensor '{other}' is missing ('{name}' here)")))?;
        let first = spec.n_field_inputs();
        let own = |j: usize| Some(first + order.iter().position(|o| Some(*o) == j.checked_sub(first))?);
        let place = |j: usize, n: usize| own(j).filter(|own| *own < n).unwrap_or(j);
        ours.insert(name, columns(&tensor, ordered, place));
    }
    match theirs.keys().find(|name| !name.starts_with("norm.")) {
        Some(name) => Err(Error::Model(format!("tensor '{name}' is not part of PhysicsNeMo's MeshGraphNet"))),
        None => {
            ours.extend(theirs);
            Ok(ours)
        }
    }
}

/// A model's tensors under their names.
pub(super) fn others(model: &Model, order: &[usize]) -> Result<StateDict> {
    let first = model.spec.n_field_inputs();
    let place = |j: usize, _: usize| j.checked_sub(first).map_or(j, |t| first + order[t]);
    let row = |(name, other, ordered): Row| Ok((other, columns(model.tensor(&name)?, ordered, place)));
    rows(&model.spec)?.into_iter().map(row).collect()
}
