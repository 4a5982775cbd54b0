//! `m4gn segment`: segments and modes of a mesh, their quality, and what they cost.

mod args;
mod input;

pub use args::Args;

use input::Input;
use input::Stored;
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, ModelSpec, SegmentEntries, SegmentMethod, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_report::write_file;
use m4gn_structure::Record;
use m4gn_structure::graph::Graph;
use m4gn_workbench::survey;
use m4gn_workbench::survey::{Options, Pictured, Survey};
use std::path::Path;
use std::sync::atomic::Ordering;

/// Width of one panel of the picture, pixels.
const PANEL: usize = 400;

/// Most numbers of segments in the picture; of more only the one that is written.
const PICTURED_COUNTS: usize = 3;

/// Most modes in the picture.
const PICTURED_MODES: usize = 8;

/// Runs the command.
///
/// # Errors
/// For an input that is no case and no trajectory, values out of range, and files that cannot be written. Nothing is
/// written then, unless it is the writing that fails.
pub fn run(args: Args) -> Result<()> {
    let mut input = Input::open(&args.path)?;
    let model = match &args.model {
        Some(path) => Some(Model::read(path)?.spec),
        None => input.model()?,
    };
    let wanted = Wanted::new(&args, model.as_ref(), &input.dictionary()?)?;
    let mut mesh = input.mesh(&args.node_type)?;
    let options = wanted.options(&args, &mesh)?;
    input.add_elastic_modes(&mut mesh, &options)?;
    if let Some(path) = args.picture.as_ref().filter(|_| mesh.dim() != 2) {
        return Err(no_picture(path));
    }
    super::check_outputs([args.json.as_deref(), args.picture.as_deref()])?;
    // Nothing is put where nobody asked for it: of a trajectory where --vtu says
    let write = !args.no_write && (args.vtu.is_some() || matches!(input, Input::Case(_)));
    if write {
        input.check_fields(options.spec.modes, args.overwrite)?;
        super::check_outputs([args.vtu.as_deref()])?;
    }

    let comm = Comm::serial();
    let (mut graph, set_up) = survey::Cost::of(|| Graph::new(&mesh, &comm))?;
    println!(
        "{}: {} cells, {} boundary faces, graph in {}",
        input.name(),
        mesh.n_cells(),
        mesh.boundary.len(),
        survey::cost_text(&set_up)
    );
    let survey = compute(&mesh, &mut graph, &options, &comm)?;
    print!("{}", survey.modes_text());
    println!("\n{}", survey.table());
    print!("{}", survey.notes());

    let written = wanted.written(&survey);
    let mut figures = survey.json();
    if let Some(path) = &args.picture {
        let map = input.map(&mesh, PANEL)?.ok_or_else(|| no_picture(path))?;
        let what = Pictured {
            counts: match options.counts.len() {
                0..=PICTURED_COUNTS => options.counts.clone(),
                _ => vec![written.count],
            },
            modes: PICTURED_MODES,
        };
        write_file(path, &survey::picture(&survey, &mesh, map, &what).png()?)?;
        println!("wrote {}", path.display());
    }
    if write {
        let note = format!(
            "method {}, K {}, {} modes, tau {}",
            written.method,
            written.count,
            survey.modes.vectors.len(),
            options.spec.tau
        );
        // Scalar fields of components would take the names of m4gnSegments' vector fields.
        let as_vectors = mesh.elastic.is_some() && matches!(input, Input::Case(_));
        let modes: &[Vec<f64>] = if as_vectors { &[] } else { &survey.modes.vectors };
        let spec = SegmentSpec { method: written.method, count: written.count, ..options.spec.clone() };
        let record = Record::new(&mesh, &spec, &written.labels, &comm)?.text()?;
        let stored = Stored { labels: &written.labels, modes, note: &note, record: &record };
        let done = input.write(&mesh, &stored, args.vtu.as_deref(), args.overwrite)?;
        println!("wrote {done} ({note})");
        if input.is_decomposed() {
            println!("The case is decomposed: 'decomposePar -fields' hands them to the processor folders.");
        }
        figures["written"] = serde_json::json!({ "method": written.method.name(), "k": written.count });
    }
    super::write_json(args.json.as_deref(), &figures)
}

/// The survey with a progress bar, or plain lines where there is more than a little to wait for.
fn compute(mesh: &Mesh, graph: &mut Graph, options: &Options, comm: &Comm) -> Result<Survey> {
    let bar = super::progress_bar(0, "segmentations");
    let stop = super::stop_flag()?;
    let result = Survey::run(mesh, graph, options, comm, |done, of, what| {
        if let Some(bar) = &bar {
            bar.set_length(of as u64);
            bar.set_position(done as u64);
            bar.set_message(what.to_string());
        }
        match stop.load(Ordering::Relaxed) {
            0 => Ok(()),
            _ => Err(Error::Interrupted("stopped; nothing was written".into())),
        }
    });
    bar.iter().for_each(|b| b.finish_and_clear());
    result
}

/// What the user asked for, before the mesh is known.
struct Wanted {
    spec: SegmentSpec,
    /// K, where anybody says so.
    count: Option<usize>,
    /// Methods that are compared; empty: all.
    methods: Vec<SegmentMethod>,
    /// Whether the number of modes may be lowered for a small mesh.
    few_modes: bool,
}

impl Wanted {
    /// Command line before the case's dictionary, before model, before defaults.
    fn new(args: &Args, model: Option<&ModelSpec>, case: &SegmentEntries) -> Result<Self> {
        let trained = model.filter(|m| m.architecture.needs().segments).map(|m| m.segments.clone());
        let line = args.entries()?;
        let said = line.has("count") || case.has("count") || trained.is_some();
        let spec = line.over(&case.over(&trained.unwrap_or_default())?)?;
        let count = said.then_some(spec.count);
        let mut methods = Vec::new();
        for m in &args.method {
            if !methods.contains(m) {
                methods.push(*m);
            }
        }
        Ok(Wanted { few_modes: args.modes.is_none(), spec, count, methods })
    }

    /// What is to be compared on this mesh.
    fn options(&self, args: &Args, mesh: &Mesh) -> Result<Options> {
        let n = mesh.n_cells();
        let mut spec = self.spec.clone();
        if let Some(name) = spec.obstacles.iter().find(|o| !mesh.patches.contains(o)) {
            return Err(Error::Input(format!(
                "the obstacle {name} is no patch of this mesh; its patches with values: {}",
                mesh.patches.join(", ")
            )));
        }
        if self.few_modes {
            spec.modes = spec.modes.min(n.saturating_sub(1));
        }
        if spec.modes >= n {
            return Err(Error::Input(format!(
                "{} modes of {n} cells: expected at most {} (--modes)",
                spec.modes,
                n.saturating_sub(1)
            )));
        }
        let mut counts = args.sweep.clone();
        counts.extend(match (self.count, counts.is_empty()) {
            (Some(k), _) => Some(k),
            (None, true) => Some(spec.count),
            (None, false) => None,
        });
        counts.sort_unstable();
        counts.dedup();
        if let Some(k) = counts.iter().find(|&&k| k > n) {
            return Err(Error::Input(format!(
                "{k} segments for {n} cells: expected 1 to {n} (--segments, --sweep)"
            )));
        }
        let methods = match self.methods.is_empty() {
            true => SegmentMethod::ALL.to_vec(),
            false => self.methods.clone(),
        };
        Ok(Options { spec, methods, counts })
    }

    /// The segmentation that is written and pictured: of the wanted method, where it applies.
    fn written<'a>(&self, survey: &'a Survey) -> &'a survey::Entry {
        let method = match survey.entries.iter().any(|e| e.method == self.spec.method) {
            true => self.spec.method,
            false => survey.entries[0].method,
        };
        let named = self.count.and_then(|k| survey.find(method, k));
        named.or_else(|| survey.suggestion(method)).unwrap_or(&survey.entries[0])
    }
}

fn no_picture(path: &Path) -> Error {
    Error::Input(format!(
        "{}: pictures are drawn of 2-D meshes only; open the written fields in ParaView",
        path.display()
    ))
}

#[cfg(test)]
mod tests;
