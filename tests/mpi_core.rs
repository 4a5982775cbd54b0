//! The core on several ranks against the core on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3.
//!
//! Every rank also computes the serial answer of the whole mesh, and compares by global numbers. Without mpirun
//! this is a run on one rank.

#[path = "mpi_core/checks.rs"]
mod checks;
#[path = "samples/matrices.rs"]
mod matrices;
#[path = "mpi_core/pairs.rs"]
mod pairs;
#[path = "ranks/mod.rs"]
mod ranks;
#[path = "mpi_core/segments.rs"]
mod segments;

use checks::{Checks, compare_modes, compare_segments};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::modal::{ModalOptions, Modes};
use m4gn_model::{SegmentMethod, SegmentSpec};
use m4gn_modes::{Modal, laplacian_modes, laplacian_reference};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_structure::graph::Graph;
use m4gn_structure::{Segmentation, segment};
use std::process::ExitCode;

fn main() -> ExitCode {
    ranks::run("mpi_core", |comm| Ok(run(comm)))
}

fn run(comm: &Comm) -> Vec<String> {
    let mut checks = Checks::new(comm);
    if comm.size() == 2 && comm.is_root() {
        // PETSc first started by one rank alone must not keep the others from starting it later.
        let modes = whole_modes(&sample::chain(150, 1.0));
        checks.that(modes.is_ok(), "modes on the root alone");
    }
    joined(&mut checks);
    collectives(&mut checks);
    errors_are_shared(&mut checks);
    all_fail_again_and_again(&mut checks);
    for (name, mesh) in meshes() {
        decompositions(&mut checks, name, &mesh);
    }
    cyclic(&mut checks);
    segments::check(&mut checks);
    pairs::pairs(&mut checks);
    broken_meshes(&mut checks);
    checks.failures
}

fn meshes() -> Vec<(&'static str, Mesh)> {
    vec![
        ("rectangle 20 x 12", sample::rectangle(20, 12, 2.0, 1.0)),
        ("square 14 x 14 with repeated eigenvalues", sample::rectangle(14, 14, 1.0, 1.0)),
        ("triangles 12 x 10", sample::triangles(12, 10, 1.6, 1.0)),
        ("block 7 x 6 x 5", sample::block([7, 6, 5], [1.0, 0.9, 0.7])),
        ("small rectangle 6 x 4", sample::rectangle(6, 4, 1.5, 1.0)),
    ]
}

/// Vectors follow residuals (1e-11) divided by gaps of the spectrum.
const BOUNDS: (f64, f64) = (0.0, 1e-7);

/// The answers on one rank.
struct Whole {
    n_edges: usize,
    modes: Modes,
    segments: Vec<Segmentation>,
}

fn whole_modes(mesh: &Mesh) -> Result<Modes> {
    let serial = Comm::serial();
    laplacian_modes(mesh, &serial, &ModalOptions::default())
}

impl Whole {
    fn new(mesh: &Mesh) -> Result<Self> {
        let serial = Comm::serial();
        let mut graph = Graph::new(mesh, &serial)?;
        let modes = laplacian_modes(mesh, &serial, &ModalOptions::default())?;
        let segments = specs(mesh)
            .iter()
            .map(|spec| segment(mesh, &mut graph, spec, &Modal::default(), &serial, None))
            .collect::<Result<_>>()?;
        Ok(Whole { n_edges: graph.senders.len(), modes, segments })
    }
}

/// One segment, and one of each cell, are asked of a small mesh alone.
fn specs(mesh: &Mesh) -> Vec<SegmentSpec> {
    let mut specs = vec![
        SegmentSpec { method: SegmentMethod::Metis, count: 7, ..Default::default() },
        SegmentSpec { count: 7, modes: 4, overlap: 1, ..Default::default() },
        SegmentSpec { count: 12, modes: 2, tau: 0.5, overlap: 2, ..Default::default() },
    ];
    if mesh.n_cells() < 100 {
        specs.extend([1, mesh.n_cells()].map(|count| SegmentSpec { count, ..Default::default() }));
    }
    specs
}

/// One mesh, decomposed in every way, against itself whole and against the dense reference.
fn decompositions(checks: &mut Checks, name: &str, mesh: &Mesh) {
    let Some(expected) = checks.value(Whole::new(mesh), name) else {
        return;
    };
    let dense = laplacian_reference(mesh, &Comm::serial(), &ModalOptions::default());
    if let Some(dense) = checks.value(dense, name) {
        compare_modes(checks, &format!("{name}, dense"), mesh, &expected.modes, &dense, BOUNDS);
    }
    for (deal, ranks) in sample::deals(mesh.n_cells(), checks.comm.size()) {
        let name = format!("{name}, {deal}");
        halo(checks, &name, mesh, &ranks);
        whole(checks, &name, mesh, &ranks, &expected);
    }
}

/// A host's communicator is duplicated: its own stays as it was.
fn joined(checks: &mut Checks) {
    let host = checks.comm.clone();
    let Some(guest) = checks.value(Comm::from_fortran(host.fortran()), "from_fortran") else {
        return;
    };
    checks.that((guest.rank(), guest.size()) == (host.rank(), host.size()), "joined ranks");
    checks.that(guest.fortran() != host.fortran(), "the communicator is a duplicate");
    drop(guest);
    let mut one = [1];
    host.sum_i64(&mut one);
    checks.that(one[0] == host.size() as i64, "the host's communicator outlives its guest");
    checks.that(Comm::from_fortran(123_456_789).is_err(), "a handle of nothing");
}

fn collectives(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let (p, me) = (comm.size() as i64, comm.rank() as i64);
    let mut sums = [me, 1, -me];
    comm.sum_i64(&mut sums);
    checks.that(sums == [p * (p - 1) / 2, p, -p * (p - 1) / 2], "sum_i64");
    let mut sums = [0.5f32, me as f32];
    comm.sum_f32(&mut sums);
    checks.that(sums == [0.5 * p as f32, (p * (p - 1) / 2) as f32], "sum_f32");
    let (mut high, mut low) = ([me], [me]);
    comm.max_i64(&mut high);
    comm.min_i64(&mut low);
    checks.that((high, low) == ([p - 1], [0]), "max_i64, min_i64");
    checks.that(comm.exclusive_scan_i64(me + 1) == me * (me + 1) / 2, "exclusive_scan_i64");
    // Rank r sends r + s numbers r * 100 + s to rank s.
    let send: Vec<Vec<i64>> = (0..p).map(|s| vec![me * 100 + s; (me + s) as usize]).collect();
    let expected: Vec<Vec<i64>> = (0..p).map(|r| vec![r * 100 + me; (me + r) as usize]).collect();
    checks.that(comm.all_to_all(&send) == expected, "all_to_all");
    // To the first rank more than goes in one operation.
    let long = |from: i64, to: i64| -> Vec<u8> {
        let n = if to == 0 { (1 << 24) + 1 + from } else { to };
        (0..n).map(|i| (i / 1000 + 3 * from) as u8).collect()
    };
    let send: Vec<Vec<u8>> = (0..p).map(|to| long(me, to)).collect();
    let expected: Vec<Vec<u8>> = (0..p).map(|from| long(from, me)).collect();
    checks.that(comm.all_to_all(&send) == expected, "all_to_all of long lists");
    let gathered = comm.gather(&vec![me as f64; me as usize]);
    let all = (0..p).map(|r| vec![r as f64; r as usize]).collect();
    checks.that(gathered == (me == 0).then_some(all), "gather");
    let mut data = if me == 0 { vec![7i32, 8, 9] } else { vec![1] };
    comm.broadcast(&mut data);
    checks.that(data == [7, 8, 9], "broadcast");
}

fn errors_are_shared(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let last = comm.size() - 1;
    let result = match comm.rank() == last {
        true => comm.agree::<()>(Err(Error::Input("mine".into()))),
        false => comm.agree(Ok(())),
    };
    let right = match result {
        Err(Error::Input(m)) => comm.rank() == last && m == "mine",
        Err(Error::OtherRank { rank, message }) => comm.rank() != last && rank == last && message == "mine",
        _ => false,
    };
    checks.that(right, "agree");
    checks.that(matches!(comm.agree(Ok(3)), Ok(3)), "agree on success");
}

/// Calls in which every rank fails by itself end with its own error, also where one rank has left the next call before another has
/// heard that it left this one.
fn all_fail_again_and_again(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let right = (0..1000).all(|call| {
        let word = format!("call {call}");
        let ended = comm.guarded::<()>(|| Err(Error::Input(word.clone())));
        matches!(ended, Err(Error::Input(message)) if message == word)
    });
    checks.that(right, "calls in which all ranks fail");
}

/// Ghosts get the owner's formula of the global number.
fn halo(checks: &mut Checks, name: &str, mesh: &Mesh, ranks: &[i32]) {
    let comm = checks.comm.clone();
    let part = sample::part(mesh, ranks, comm.rank());
    let Some(mut graph) = checks.value(Graph::new(&part, &comm), name) else {
        return;
    };
    let mut global = vec![-1i64; graph.n_local];
    global[..graph.n_cells].copy_from_slice(&part.cell_global);
    graph.halo.exchange_i64(&comm, &mut global, 1);
    let mut ghosts: Vec<(i32, i64)> =
        part.coupled.iter().filter(|c| c.rank != comm.rank()).map(|c| (c.rank, c.global)).collect();
    ghosts.sort_unstable();
    ghosts.dedup();
    let found: Vec<i64> = global[graph.n_owned..].to_vec();
    let expected: Vec<i64> = ghosts.iter().map(|g| g.1).collect();
    checks.that(found == expected, format!("{name}: ghosts are ordered by (rank, global)"));

    let value = |g: i64, w: usize| (g as f32) * 0.5 + w as f32;
    let mut values = vec![f32::NAN; graph.n_local * 3];
    for (cell, &g) in part.cell_global.iter().enumerate() {
        (0..3).for_each(|w| values[cell * 3 + w] = value(g, w));
    }
    let before: Vec<u32> = values[..graph.n_owned * 3].iter().map(|v| v.to_bits()).collect();
    // Twice: buffers are reused.
    for _ in 0..2 {
        values[graph.n_owned * 3..].fill(f32::NAN);
        graph.halo.exchange_f32(&comm, &mut values, 3);
    }
    let right = expected
        .iter()
        .enumerate()
        .all(|(i, &g)| (0..3).all(|w| values[(graph.n_owned + i) * 3 + w] == value(g, w)));
    checks.that(right, format!("{name}: halo values"));
    let same = before.iter().zip(&values).all(|(b, v)| *b == v.to_bits());
    checks.that(same, format!("{name}: owned values untouched"));
}

/// Eigenvalues, modes and segments of the decomposed mesh equal those of the whole one.
fn whole(checks: &mut Checks, name: &str, mesh: &Mesh, ranks: &[i32], expected: &Whole) {
    let comm = checks.comm.clone();
    let part = sample::part(mesh, ranks, comm.rank());
    let Some(mut graph) = checks.value(Graph::new(&part, &comm), name) else {
        return;
    };
    checks.that(
        comm.total(graph.senders.len()) as usize == expected.n_edges,
        format!("{name}: number of edges"),
    );
    let modes = laplacian_modes(&part, &comm, &ModalOptions::default());
    let Some(modes) = checks.value(modes, name) else {
        return;
    };
    compare_modes(checks, name, &part, &modes, &expected.modes, BOUNDS);
    for (spec, expected) in specs(mesh).iter().zip(&expected.segments) {
        let name = format!("{name}, {:?} K = {}", spec.method, spec.count);
        let found = segment(&part, &mut graph, spec, &Modal::default(), &comm, None);
        let Some(found) = checks.value(found, &name) else {
            continue;
        };
        compare_segments(checks, &name, &part, mesh, &found, expected);
        let preset: Vec<i32> = found.node_segment[..part.n_cells()].to_vec();
        let again = segment(&part, &mut graph, spec, &Modal::default(), &comm, Some(&preset));
        let again = checks.value(again, &name);
        checks.that(
            again.is_none_or(|a| a.member == found.member && a.adjacency == found.adjacency),
            format!("{name}: handed in again"),
        );
    }
}

/// A cyclic within one rank and across ranks is the same thing.
fn cyclic(checks: &mut Checks) {
    let mut mesh = sample::rectangle(16, 9, 2.0, 1.0);
    sample::make_cyclic(&mut mesh, 2.0);
    decompositions(checks, "cyclic", &mesh);
}

/// Every rank hears of a mesh that is broken on one of them.
fn broken_meshes(checks: &mut Checks) {
    let comm = checks.comm.clone();
    let mesh = sample::rectangle(8, 6, 1.0, 1.0);
    let ranks = sample::strips(48, comm.size());
    let good = sample::part(&mesh, &ranks, comm.rank());
    let last = comm.rank() == comm.size() - 1;
    type Damage = fn(&mut Mesh);
    let damages: [(&str, Damage); 5] = [
        ("a negative volume", |m| m.cell_volumes[0] = -1.0),
        ("a number twice", |m| m.cell_global[0] = 3),
        ("a wrong owner", |m| m.boundary[0].owner = 1000),
        ("a rank that does not exist", |m| m.coupled.iter_mut().take(1).for_each(|c| c.rank = 99)),
        ("a cell that its rank does not own", |m| m.coupled.iter_mut().take(1).for_each(|c| c.global = 47)),
    ];
    for (name, damage) in damages {
        let mut part = good.clone();
        let harmless = comm.size() == 1 && name.contains("rank");
        if last {
            damage(&mut part);
        }
        let result = Graph::new(&part, &comm);
        checks.that(result.is_err() != harmless, format!("{name} is an error on every rank"));
        let mine = matches!(result, Err(Error::Mesh(_)));
        let told = matches!(result, Err(Error::OtherRank { .. }));
        checks.that(harmless || mine || told, format!("{name}: class of the error"));
    }
    let Some(mut graph) = checks.value(Graph::new(&good, &comm), "a whole mesh after broken ones") else {
        return;
    };
    let spec = SegmentSpec { count: 49, ..Default::default() };
    let many = segment(&good, &mut graph, &spec, &Modal::default(), &comm, None);
    checks.that(matches!(many, Err(Error::Input(_))), "more segments than cells");
    let labels = vec![if last { 9 } else { 0 }; good.n_cells()];
    let spec = SegmentSpec { count: 2, ..Default::default() };
    checks.that(
        segment(&good, &mut graph, &spec, &Modal::default(), &comm, Some(&labels)).is_err(),
        "a preset label out of range",
    );
}
