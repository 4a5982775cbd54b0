//! A step on several ranks against the same step on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3.
//!
//! Every rank also runs the whole mesh in serial and compares by global numbers. Without mpirun this is a run on one
//! rank.

#[path = "ranks/mod.rs"]
mod ranks;

#[path = "mpi_engine/bodies.rs"]
mod bodies;
#[path = "samples/flow.rs"]
mod flow;

use flow::Flow;
use m4gn_base::{Error, Result};
use m4gn_engine::PrecisionChoice;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{
    Activation, Architecture, Kind, Level, M4gn, MacroSpec, Model, ModelSpec, NodeSums, Resolution,
    SegmentSpec, cell_size,
};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_step::{Session, SessionOptions};
use std::process::ExitCode;

/// Sums of neighbours and segments come in another order: a few units in the last place of fp32 a layer.
const TOLERANCE: f64 = 1e-5;
/// Where sums differ in the last place, some are rounded to another bf16.
const TOLERANCE_BF16: f64 = 2e-2;

fn main() -> ExitCode {
    ranks::run("mpi_engine", |comm| Ok(run(comm)))
}

fn run(comm: &Comm) -> Vec<String> {
    let mut failures = Vec::new();
    let size = comm.size();
    let triangles = sample::triangles(17, 9, 1.6, 0.41);
    let mut cyclic = sample::rectangle(12, 7, 1.2, 0.7);
    sample::make_cyclic(&mut cyclic, 1.2);
    let block = sample::block([6, 5, 4], [1.0, 0.8, 0.6]);
    for (what, mesh) in [("triangles", &triangles), ("cyclic", &cyclic), ("block", &block)] {
        let n = mesh.n_cells();
        let scattered: Vec<i32> = (0..n).map(|c| ((c / 5 * 7919) % size as usize) as i32).collect();
        let all_on_last = vec![size - 1; n];
        let deals = [
            ("strips", sample::strips(n, size)),
            ("scattered", scattered),
            ("the last rank alone", all_on_last),
        ];
        let m4gn = [(0, 0, 4), (1, 0, 0), (2, 1, 3)].map(|(layers_after, overlap, rwse_steps)| {
            let name = format!("{layers_after} layers after, overlap {overlap}");
            (name, spec(mesh.dim(), layers_after, overlap, rwse_steps))
        });
        let of_kind = |kind: Kind| {
            let mut spec = spec(mesh.dim(), 0, 0, 0);
            spec.architecture.kind = kind;
            spec
        };
        let (gcn, bsms) = (of_kind(Kind::Gcn { layers: 3 }), of_kind(Kind::BsmsGnn { levels: 4 }));
        let eagle = [0, 1].map(|overlap| {
            let mut eagle = spec(mesh.dim(), 1, overlap, 2);
            eagle.architecture.kind =
                Kind::Eagle(eagle.architecture.m4gn().cloned().unwrap_or_else(|| unreachable!()));
            (format!("eagle, overlap {overlap}"), eagle)
        });
        let mut before = spec(mesh.dim(), 1, 0, 0);
        before.architecture.micro.node_sums = NodeSums::Before;
        let mut walk = spec(mesh.dim(), 0, 0, 0);
        walk.architecture.micro.node_rwse_steps = 7;
        let others = [
            ("node positions".to_string(), walk),
            ("node sums before".to_string(), before),
            ("gcn".to_string(), gcn),
            ("bsms-gnn".to_string(), bsms),
        ];
        for (name, spec) in m4gn.into_iter().chain(others).chain(eagle) {
            let name = format!("{what}, {name}");
            // Groups of cells that straddle ranks.
            let groups = Resolution::Length(1.7 * cell_size(mesh, &Comm::serial()));
            // Threads and precisions have no part in who has which cell, and groups straddle ranks as cells do: one mesh has all of it.
            let (strips, grouped) = match what {
                "triangles" => (&deals[..1], &deals[..]),
                _ => (&deals[..0], &deals[1..2]),
            };
            for (precision, n_threads, resolution, tolerance, deals) in [
                (PrecisionChoice::Fp32, 1, Resolution::Off, TOLERANCE, &deals[..]),
                (PrecisionChoice::Fp32, 2, Resolution::Off, TOLERANCE, strips),
                (PrecisionChoice::Fp32, 1, groups, TOLERANCE, grouped),
                (PrecisionChoice::Bf16, 1, Resolution::Off, TOLERANCE_BF16, strips),
            ] {
                if deals.is_empty() {
                    continue;
                }
                let options =
                    SessionOptions { precision, n_threads, resolution, ..SessionOptions::default() };
                let name = format!("{name}, {precision:?}, {n_threads} threads, {resolution:?}");
                let alone = alone(mesh, &spec, &options).unwrap();
                for (how, ranks) in deals {
                    match compare(comm, mesh, ranks, &spec, &options, &alone) {
                        Ok(error) if error < tolerance => {}
                        Ok(error) => {
                            failures.push(format!("{how}, {name}: differs from serial by {error:e}"))
                        }
                        Err(e) => failures.push(format!("{how}, {name}: {e}")),
                    }
                }
            }
        }
    }
    failures.extend(bodies::failures(comm, &spec(3, 1, 0, 3)));
    if let Err(e) = disagreement(comm, &triangles) {
        failures.push(e);
    }
    failures.extend(level(comm, &cyclic).err());
    failures.extend(whole(comm, &triangles).err());
    failures
}

/// Without an outlet the level of a pressure is its mean, of the same bits on any number of ranks.
fn level(comm: &Comm, mesh: &Mesh) -> std::result::Result<(), String> {
    let (_, ranks) = sample::deals(mesh.n_cells(), comm.size()).swap_remove(1);
    let of = |mesh: &Mesh, comm: &Comm| {
        let state = state(mesh);
        Level::new(mesh, comm).of(&state.p, &state.p_boundary, comm)
    };
    match (of(&sample::part(mesh, &ranks, comm.rank()), comm), of(mesh, &Comm::serial())) {
        (found, alone) if found.to_bits() == alone.to_bits() => Ok(()),
        (found, alone) => Err(format!("the level of a pressure is {found}, in serial {alone}")),
    }
}

/// A kind that needs all nodes on one rank says so on several, and runs on one.
fn whole(comm: &Comm, mesh: &Mesh) -> std::result::Result<(), String> {
    let mut spec = spec(2, 0, 0, 0);
    spec.architecture.kind = Kind::GUNet { levels: 3 };
    let ranks = sample::strips(mesh.n_cells(), comm.size());
    let options = SessionOptions::default();
    let found =
        alone(mesh, &spec, &options).and_then(|alone| compare(comm, mesh, &ranks, &spec, &options, &alone));
    match (comm.size(), found) {
        (1, Ok(0.0)) => Ok(()),
        (2.., Err(Error::Model(m)))
            if m.contains("kind g-u-net") && m.contains("run the solver in serial") =>
        {
            Ok(())
        }
        (size, other) => Err(format!("g-u-net on {size} ranks gave {other:?}")),
    }
}

/// Two steps of a network of random weights on a mesh, and its segments.
fn two_steps(
    comm: Comm,
    mesh: &Mesh,
    spec: &ModelSpec,
    options: &SessionOptions,
) -> Result<(Flow, Vec<i32>)> {
    let mut session = Session::new(comm, mesh, &Model::random(spec.clone(), 21)?, options)?;
    let mut found = state(mesh);
    for _ in 0..2 {
        step(&mut found, &mut session)?;
    }
    Ok((found, session.cell_segment().to_vec()))
}

/// The same of the whole mesh on one rank.
fn alone(mesh: &Mesh, spec: &ModelSpec, options: &SessionOptions) -> Result<(Flow, Vec<i32>)> {
    two_steps(Comm::serial(), mesh, spec, options)
}

/// Largest difference of two steps from serial, relative to the largest value; the labels must be the same.
fn compare(
    comm: &Comm,
    mesh: &Mesh,
    ranks: &[i32],
    spec: &ModelSpec,
    options: &SessionOptions,
    (expected, expected_segments): &(Flow, Vec<i32>),
) -> Result<f64> {
    let part = sample::part(mesh, ranks, comm.rank());
    let (found, segments) = two_steps(comm.clone(), &part, spec, options)?;
    let largest = expected.u.iter().chain(&expected.p).fold(0f64, |m, v| m.max(v.abs()));
    let mut error = 0f64;
    for (c, &global) in part.cell_global.iter().enumerate() {
        let g = global as usize;
        if segments.get(c) != expected_segments.get(g) {
            return Err(Error::Internal(format!("cell {g} has another segment than in serial")));
        }
        for i in 0..3 {
            error = error.max((found.u[3 * c + i] - expected.u[3 * g + i]).abs());
        }
        error = error.max((found.p[c] - expected.p[g]).abs());
    }
    Ok(error / largest)
}

/// A bad value on one rank is an error on all, of the class that says where it was.
fn disagreement(comm: &Comm, mesh: &Mesh) -> std::result::Result<(), String> {
    let part = sample::part(mesh, &sample::strips(mesh.n_cells(), comm.size()), comm.rank());
    let model = Model::random(spec(2, 1, 0, 0), 3).map_err(|e| e.to_string())?;
    let mut session =
        Session::new(comm.clone(), &part, &model, &SessionOptions::default()).map_err(|e| e.to_string())?;
    let mut state = state(&part);
    let culprit = comm.rank() == comm.size() - 1;
    if culprit {
        state.p[0] = f64::NAN;
    }
    match (culprit, step(&mut state, &mut session)) {
        (true, Err(Error::Numerical(_))) | (false, Err(Error::OtherRank { .. })) => Ok(()),
        (_, other) => Err(format!("a NaN on the last rank gave {other:?} here")),
    }
}

/// Fields that are functions of global numbers.
fn state(mesh: &Mesh) -> Flow {
    let wave = |g: i64, k: f64| (k * g as f64).sin();
    let cells = mesh.cell_global.iter();
    let faces = mesh.boundary.iter().map(|b| b.global);
    Flow {
        u: cells.clone().flat_map(|&g| [wave(g, 0.3), wave(g, 0.7), wave(g, 0.9)]).collect(),
        u_boundary: faces.clone().flat_map(|g| [wave(g, 0.2), 0.0, 0.0]).collect(),
        p: cells.map(|&g| wave(g, 1.1)).collect(),
        p_boundary: faces.map(|g| wave(g, 0.4)).collect(),
    }
}

fn step(state: &mut Flow, session: &mut Session) -> Result<()> {
    let (mut u, mut p) = (state.u.clone(), state.p.clone());
    state.step(session, &mut u, &mut p)?;
    (state.u, state.p) = (u, p);
    Ok(())
}

fn spec(dim: usize, layers_after: usize, overlap: usize, rwse_steps: usize) -> ModelSpec {
    let (centroids, offsets) = (rwse_steps > 0, layers_after > 0);
    let segment_transformer =
        MacroSpec { layers: 2, heads: 3, ffn_width: 32, rwse_steps, centroids, offsets };
    let small = m4gn_samples::model::spec();
    ModelSpec {
        dim,
        node_types: NodeType::ALL.to_vec(),
        architecture: Architecture {
            width: 24,
            activation: Activation::Silu,
            kind: Kind::M4gn(M4gn { layers_before: 3, layers_after, segment_transformer }),
            ..small.architecture
        },
        segments: SegmentSpec { count: 6, modes: 3, overlap, ..SegmentSpec::default() },
        ..small
    }
}
