//! What `m4gn segment` is told.

use m4gn_mesh::NodeType;
use m4gn_model::MAX_SEGMENTS;
use m4gn_model::modal::ModalSolver;
use m4gn_model::{SegmentEntries, SegmentMethod};
use serde_json::Value;
use std::path::PathBuf;

/// Cut the mesh of a case or a trajectory into segments, and say how good they are
///
/// Prints the eigenvalues of the modes, and for each method and number of segments K conductance (lower is better), edge-cut
/// ratio (lower) and silhouette (higher), sweeps, time and memory. Of several K the one with the largest silhouette is
/// suggested.
///
/// Segments and modes are written for ParaView and for later runs: in a case as the fields m4gnSegment and m4gnMode1,
/// m4gnMode2, ... in the folder of its start time, where m4gnSurrogate and 'method m4gn' of decomposePar find them; for a
/// trajectory as points with values where --vtu says.
///
/// What is not given is taken from the entry 'segments' of the case's function object (m4gnSurrogate, m4gnSegments or
/// m4gnHarvest),
/// then from the model that it names or that --model names.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// OpenFOAM case, trajectory (*.h5), or folder of trajectories, whose first is taken
    #[arg(value_name = "CASE|DATA")]
    pub(super) path: PathBuf,
    /// Number of segments K [default: the case's, the model's, the suggested one of --sweep, or 36]
    #[arg(long, value_name = "K", value_parser = count)]
    pub(super) segments: Option<usize>,
    /// Numbers of segments to compare
    #[arg(long, value_name = "K1,K2,...", value_delimiter = ',', value_parser = count)]
    pub(super) sweep: Vec<usize>,
    /// Methods to compare: metis, slic-md, slic-mdodl, slic-mdode. The first one is written [default: all that the
    /// mesh has use for; written is the case's, the model's, or slic-md]
    #[arg(long, value_name = "METHOD,...", value_delimiter = ',', value_parser = method)]
    pub(super) method: Vec<SegmentMethod>,
    /// Number of Laplacian modes m [default: 6]
    #[arg(long, value_name = "M")]
    pub(super) modes: Option<usize>,
    /// As many modes as have this share of the energy, at most --modes
    #[arg(long, value_name = "SHARE")]
    pub(super) energy: Option<f64>,
    /// The way to the modes: auto, direct or iterative [default: auto, by size]
    #[arg(long, value_name = "SOLVER", value_parser = modal_solver)]
    pub(super) modal_solver: Option<ModalSolver>,
    /// Options for PETSc and SLEPc, with the prefix m4gn_: "-m4gn_eps_tol 1e-9"
    #[arg(long, value_name = "OPTIONS", allow_hyphen_values = true)]
    pub(super) petsc: Option<String>,
    /// Weight tau of positions against modes [default: 1]
    #[arg(long, value_name = "TAU")]
    pub(super) tau: Option<f64>,
    /// Size S of a segment, m [default: from the domain and K]
    #[arg(long, value_name = "M")]
    pub(super) size: Option<f64>,
    /// Most SLIC sweeps [default: 20]
    #[arg(long, value_name = "N")]
    pub(super) iterations: Option<usize>,
    /// Layers that segments overlap by [default: 0]
    #[arg(long, value_name = "LAYERS")]
    pub(super) overlap: Option<usize>,
    /// Leave pieces that do not hang together with their segment where they are, as the paper does
    #[arg(long)]
    pub(super) no_connect: bool,
    /// Patch that is the obstacle of slic-mdodl and slic-mdode; may be repeated [default: walls that do not reach the
    /// outside of the mesh]
    #[arg(long, value_name = "PATCH")]
    pub(super) obstacle: Vec<String>,
    /// Length that the distance to the obstacle is taken over, m; 0: none, as in the paper [default: S]
    #[arg(long, value_name = "M")]
    pub(super) distance_scale: Option<f64>,
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
    /// Write a picture of the segments of each method and of the first modes to this file; 2-D only
    #[arg(long, value_name = "FILE.png")]
    pub(super) picture: Option<PathBuf>,
    /// Write the segments and modes of a trajectory to this file
    #[arg(long, value_name = "FILE.vtu")]
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
    pub(super) fn entries(&self) -> SegmentEntries {
        let mut entries = SegmentEntries::default();
        let mut say = |name: &str, value: Option<Value>| {
            if let Some(value) = value {
                entries.set(name, value);
            }
        };
        say("method", self.method.first().map(|m| m.name().into()));
        say("count", self.segments.map(Value::from));
        say("modes", self.modes.map(Value::from));
        say("energy", self.energy.map(Value::from));
        say("modal_solver", self.modal_solver.map(|s| serde_json::json!(s)));
        say("petsc_options", self.petsc.clone().map(Value::from));
        say("tau", self.tau.map(Value::from));
        say("size", self.size.map(Value::from));
        say("iterations", self.iterations.map(Value::from));
        say("overlap", self.overlap.map(Value::from));
        say("connected", self.no_connect.then_some(Value::Bool(false)));
        let obstacles = Some(&self.obstacle).filter(|names| !names.is_empty());
        say("obstacles", obstacles.map(|names| names.clone().into()));
        say("distance_scale", self.distance_scale.map(Value::from));
        entries
    }
}

fn count(text: &str) -> std::result::Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if (1..=MAX_SEGMENTS).contains(&n) => Ok(n),
        _ => Err(format!("expected a number from 1 to {MAX_SEGMENTS}")),
    }
}

fn method(text: &str) -> std::result::Result<SegmentMethod, String> {
    SegmentMethod::parse(text.trim()).map_err(|e| e.to_string())
}

fn modal_solver(text: &str) -> std::result::Result<ModalSolver, String> {
    ModalSolver::parse(text).map_err(|e| e.to_string())
}

fn node_type(text: &str) -> std::result::Result<(String, NodeType), String> {
    let kinds = || NodeType::ALL.into_iter().filter(|t| *t != NodeType::Fluid);
    let found =
        text.split_once('=').and_then(|(patch, kind)| Some((patch, kinds().find(|t| t.name() == kind)?)));
    match found {
        Some((patch, kind)) if !patch.is_empty() => Ok((patch.to_string(), kind)),
        _ => {
            let names: Vec<_> = kinds().map(NodeType::name).collect();
            Err(format!("expected PATCH=TYPE with one of {}", names.join(", ")))
        }
    }
}
