//! What `m4gn segment` is told.

use m4gn_base::{Result, listed, settings};
use m4gn_mesh::NodeType;
use m4gn_model::MAX_SEGMENTS;
use m4gn_model::modal::ModalSolver;
use m4gn_model::{SegmentEntries, SegmentMethod, SegmentSpec};
use serde_json::{Map, Value};
use std::path::PathBuf;

/// Cut the mesh of a case or a trajectory into segments, and say how good they are
///
/// Prints the eigenvalues of the modes, conductance (lower is better), edge-cut ratio (lower) and silhouette (higher) of the
/// segments, sweeps, the share of cells that they moved off METIS's segments, time and memory.
///
/// Segments and modes are written for ParaView and for later runs: in a case as the fields m4gnSegment and m4gnMode1,
/// m4gnMode2, ... in the folder of its start time, where m4gnSurrogate finds them; for a trajectory as points with values
/// where --vtu says.
///
/// Settings that are not given come from the entry 'segments' of the case's function object (m4gnSurrogate, m4gnSegments or
/// m4gnRecorder), then from the model that it names or that --model names.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// OpenFOAM case, trajectory (*.h5), or folder of trajectories, whose first is taken
    #[arg(value_name = "CASE|DATA")]
    pub(super) path: PathBuf,
    /// Number of segments K [default: the case's, the model's, or 36]
    #[arg(long, value_name = "K", value_parser = count)]
    pub(super) segments: Option<usize>,
    #[arg(long, value_parser = method, help = methods())]
    pub(super) method: Option<SegmentMethod>,
    #[arg(long, value_name = "M", help = default_of("modes"))]
    pub(super) modes: Option<usize>,
    #[arg(long, value_name = "SOLVER", value_parser = modal_solver, help = default_of("modal_solver"))]
    pub(super) modal_solver: Option<ModalSolver>,
    /// Another entry of 'segments', as in a dictionary (docs/reference/dictionary.md): tau=0.5, overlap=1, obstacles=["wing"]; may be repeated
    #[arg(long, value_name = "ENTRY=VALUE", value_parser = entry)]
    pub(super) set: Vec<(String, Value)>,
    /// Node type of a patch of a case: wall, inlet, outlet, symmetry or obstacle; may be repeated [default: the
    /// function object's nodeTypes, else from the boundary conditions]
    #[arg(long, value_name = "PATCH=TYPE", value_parser = node_type)]
    pub(super) node_type: Vec<(String, NodeType)>,
    /// Take the segmentation that this model was trained with
    #[arg(long, value_name = "FILE")]
    pub(super) model: Option<PathBuf>,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    pub(super) json: Option<PathBuf>,
    /// Write the segments and modes of a trajectory to this file
    #[arg(long, value_name = "FILE.vtu", conflicts_with = "no_write")]
    pub(super) vtu: Option<PathBuf>,
    /// Do not write segments and modes
    #[arg(long)]
    pub(super) no_write: bool,
    /// Replace m4gnSegment or m4gnMode... that something else wrote
    #[arg(long)]
    pub(super) overwrite: bool,
}

impl Args {
    /// What the command line says of the segments.
    pub(super) fn entries(&self) -> Result<SegmentEntries> {
        let mut entries: Map<String, Value> = self.set.iter().cloned().collect();
        let named = [
            ("method", self.method.map(|m| m.name().into())),
            ("count", self.segments.map(Value::from)),
            ("modes", self.modes.map(Value::from)),
            ("modal_solver", self.modal_solver.map(|s| serde_json::json!(s))),
        ];
        entries.extend(named.into_iter().filter_map(|(name, value)| Some((name.into(), value?))));
        settings::parse("--set", &Value::Object(entries).to_string(), &[])
    }
}

/// What an entry of segments means, and its default.
fn default_of(name: &str) -> String {
    let table = SegmentSpec::table();
    let default = table.entries.iter().find(|e| e.name == name).and_then(|e| e.default.clone());
    format!("{} [default: {}]", table.help(name), default.unwrap_or_default().to_string().trim_matches('"'))
}

fn methods() -> String {
    format!(
        "{} [default: the case's, the model's, or {}]",
        SegmentSpec::table().help("method"),
        SegmentSpec::default().method
    )
}

fn entry(text: &str) -> std::result::Result<(String, Value), String> {
    let (name, value) = text.split_once('=').ok_or("expected ENTRY=VALUE")?;
    // As in a dictionary
    let value = match value {
        "yes" => true.into(),
        "no" => false.into(),
        other => serde_json::from_str(other).unwrap_or_else(|_| other.into()),
    };
    Ok((name.into(), value))
}

fn count(text: &str) -> std::result::Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if (1..=MAX_SEGMENTS).contains(&n) => Ok(n),
        _ => Err(format!("expected a number from 1 to {MAX_SEGMENTS}")),
    }
}

fn method(text: &str) -> std::result::Result<SegmentMethod, String> {
    settings::read("method", &text.into()).map_err(|e| e.to_string())
}

fn modal_solver(text: &str) -> std::result::Result<ModalSolver, String> {
    settings::read("modal solver", &text.into()).map_err(|e| e.to_string())
}

fn node_type(text: &str) -> std::result::Result<(String, NodeType), String> {
    let kinds = || NodeType::ALL.into_iter().filter(|t| *t != NodeType::Fluid);
    let found =
        text.split_once('=').and_then(|(patch, kind)| Some((patch, kinds().find(|t| t.name() == kind)?)));
    match found {
        Some((patch, kind)) if !patch.is_empty() => Ok((patch.to_string(), kind)),
        _ => Err(format!("expected PATCH=TYPE with one of {}", listed(kinds().map(NodeType::name)))),
    }
}
