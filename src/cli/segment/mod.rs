//! `m4gn segment`: segments and modes of a mesh, their quality, and what they cost.

mod args;
mod cut;
mod input;

pub use args::Args;

use cut::{Cost, Cut};
use input::Input;
use input::Stored;
use m4gn_base::{Error, Result, refuse};
use m4gn_mesh::Mesh;
use m4gn_model::{Model, ModelSpec, SegmentEntries, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Record, obstacle_note};

/// Runs the command; nothing is written where anything but the writing fails.
pub fn run(args: Args) -> Result<()> {
    let mut input = Input::open(&args.path)?;
    refuse(
        args.vtu.is_some() && matches!(input, Input::Case(_)),
        Error::Input,
        || "--vtu is for a trajectory: a case gets the fields m4gnSegment and m4gnMode1, ..., which ParaView reads; leave it out",
    )?;
    let model = match &args.model {
        Some(path) => Some(Model::read(path)?.spec),
        None => input.model()?,
    };
    let wanted = wanted(&args, model.as_ref(), &input.dictionary()?)?;
    let mut mesh = input.mesh(&args.node_type)?;
    let spec = fitted(wanted, args.modes.is_none(), &mesh)?;
    input.add_elastic_modes(&mut mesh, &spec)?;
    // Nothing is put where nobody asked for it: of a trajectory where --vtu says
    let write = !args.no_write && (args.vtu.is_some() || matches!(input, Input::Case(_)));
    let shown = args.vtu.as_deref().filter(|_| write);
    let _claimed = super::claim_outputs([args.json.as_deref(), shown], [Some(&*args.path)])?;
    if write {
        input.check_fields(spec.modes, args.overwrite)?;
    }

    let comm = Comm::serial();
    let (mut graph, set_up) = Cost::of(|| Graph::new(&mesh, &comm))?;
    println!(
        "{}: {} cells, {} boundary faces, graph in {set_up}",
        input.name(),
        mesh.n_cells(),
        mesh.boundary.len(),
    );
    let cut = Cut::new(&mesh, &mut graph, &spec, &comm)?;
    if spec.method.uses_obstacle() {
        println!("obstacle: {}", obstacle_note(&mesh, &spec.obstacles, &comm)?);
    }
    print!("{}", cut.text());
    if write {
        let modes = &cut.modes.vectors;
        let count = cut.eigenvalues().0.len();
        let note = format!("method {}, K {}, {count} modes, tau {}", spec.method, spec.count, spec.tau);
        // Scalar fields of components would take the names of m4gnSegments' vector fields.
        let as_vectors = mesh.elastic.is_some() && matches!(input, Input::Case(_));
        let modes: &[Vec<f64>] = if as_vectors { &[] } else { modes };
        let record = Record::new(&mesh, &spec, &cut.labels, &comm)?.text()?;
        let stored = Stored { labels: &cut.labels, modes, note: &note, record: &record };
        let done = input.write(&mesh, &stored, args.vtu.as_deref(), args.overwrite)?;
        println!("wrote {done} ({note})");
        if input.is_decomposed() {
            println!("The case is decomposed: 'decomposePar -fields' hands them to the processor folders.");
        }
    }
    super::write_json(args.json.as_deref(), &cut.json())
}

/// What the user asks for: command line before the case's dictionary, before model, before defaults.
fn wanted(args: &Args, model: Option<&ModelSpec>, case: &SegmentEntries) -> Result<SegmentSpec> {
    let trained = model.filter(|m| m.architecture.needs().segments).map(|m| m.segments.clone());
    args.entries()?.over(&case.over(&trained.unwrap_or_default())?)
}

/// What is asked for on this mesh. A small mesh lowers the number of modes where `few_modes` allows it.
fn fitted(mut spec: SegmentSpec, few_modes: bool, mesh: &Mesh) -> Result<SegmentSpec> {
    let n = mesh.n_cells();
    let patch = |name: &str| mesh.patches.iter().any(|patch| patch == name);
    let piece = |name: &str| name.rsplit_once(':').is_some_and(|(of, _)| patch(of));
    if let Some(name) = spec.obstacles.iter().find(|o| !patch(o) && !piece(o)) {
        return Err(Error::Input(format!(
            "the obstacle {name} is no patch of this mesh; its patches with values: {}",
            mesh.patches.join(", ")
        )));
    }
    if few_modes {
        spec.modes = spec.modes.min(n.saturating_sub(1));
    }
    refuse(spec.modes >= n, Error::Input, || {
        format!("{} modes of {n} cells: expected at most {} (--modes)", spec.modes, n.saturating_sub(1))
    })?;
    refuse(spec.count > n, Error::Input, || {
        format!("{} segments for {n} cells: expected 1 to {n} (--segments)", spec.count)
    })?;
    Ok(spec)
}

#[cfg(test)]
mod tests;
