//! Another numbering of the same mesh gives the same segments and the same step, with all kinds of networks.

#[path = "samples/flow.rs"]
mod flow;

use flow::Flow;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{Kind, Model, ModelSpec, Resolution, SegmentMethod, SegmentSpec, cell_size};
use m4gn_parallel::Comm;
use m4gn_samples::{bodies, mesh as sample, model};
use m4gn_step::{Session, SessionOptions};
use std::collections::HashSet;

/// Sums come in another order: a few units in the last place of fp32 a layer.
const TOLERANCE: f64 = 1e-5;

/// The six kinds, those with segments with these.
fn kinds(base: &ModelSpec, segments: &SegmentSpec) -> Vec<ModelSpec> {
    let m4gn = base.architecture.m4gn().unwrap().clone();
    let kinds = [
        Kind::M4gn(m4gn.clone()),
        Kind::Eagle(m4gn),
        Kind::MeshGraphNet { layers: 3 },
        Kind::Gcn { layers: 3 },
        Kind::BsmsGnn { levels: 3 },
        Kind::GUNet { levels: 3 },
    ];
    let of = |kind: Kind| {
        let mut spec = base.clone();
        spec.fields.iter_mut().for_each(|f| f.input |= matches!(kind, Kind::Gcn { .. }));
        spec.architecture.kind = kind;
        spec.segments = segments.clone();
        spec
    };
    kinds.into_iter().map(of).collect()
}

fn methods(count: usize, modes: usize) -> Vec<SegmentSpec> {
    let of = |method| SegmentSpec { method, count, modes, overlap: 1, ..SegmentSpec::default() };
    SegmentMethod::ALL.into_iter().map(of).collect()
}

/// Fields that are functions of places, without a symmetry.
fn state(mesh: &Mesh) -> Flow {
    let wave = |x: &[f64; 3], k: f64| (k * x[0] + 1.7 * x[1] - 0.6 * x[2] + 0.3 * k).sin();
    let cells = || mesh.cell_centres.iter();
    let faces = || mesh.boundary.iter().map(|b| &b.centre);
    Flow {
        u: cells().flat_map(|x| [wave(x, 3.0), wave(x, 7.0), wave(x, 9.0)]).collect(),
        u_boundary: faces().flat_map(|x| [wave(x, 2.0), 0.0, 0.0]).collect(),
        p: cells().map(|x| wave(x, 5.0)).collect(),
        p_boundary: faces().map(|x| wave(x, 4.0)).collect(),
    }
}

/// Segments and U of a session after two steps.
fn steps(mesh: &Mesh, model: &Model, resolution: Resolution) -> (Vec<i32>, Vec<f64>) {
    let options = SessionOptions { resolution, ..SessionOptions::default() };
    let mut session = Session::new(Comm::serial(), mesh, model, &options).unwrap();
    let mut state = state(mesh);
    for _ in 0..2 {
        let (mut u, mut p) = (state.u.clone(), state.p.clone());
        state.step(&mut session, &mut u, &mut p).unwrap();
        (state.u, state.p) = (u, p);
    }
    (session.cell_segment().to_vec(), state.u)
}

fn meshes() -> Vec<(&'static str, Mesh)> {
    let mut uneven = sample::triangles(17, 9, 1.6, 0.41);
    for (i, x) in uneven.cell_centres.iter_mut().enumerate() {
        x[0] += 1e-3 * (i as f64 * 0.9).sin();
    }
    let mut cyclic = sample::rectangle(12, 7, 1.2, 0.7);
    sample::make_cyclic(&mut cyclic, 1.2);
    vec![
        ("even triangles", sample::triangles(16, 8, 1.6, 0.4)),
        ("uneven triangles", uneven),
        ("cyclic", cyclic),
        ("block", sample::block([6, 5, 4], [1.0, 0.8, 0.6])),
        (POINTS, points()),
    ]
}

/// Unknowns at points: those of walls and inlets are two nodes in one place.
const POINTS: &str = "points";

fn points() -> Mesh {
    let mut mesh = sample::triangles(13, 7, 1.3, 0.5);
    // A point of the boundary has one face.
    let mut owners = HashSet::new();
    mesh.boundary.retain(|b| owners.insert(b.owner));
    (0..).zip(&mut mesh.boundary).for_each(|(i, b)| b.global = i);
    sample::at_points(mesh)
}

#[test]
fn flows_do_not_depend_on_the_numbering() {
    let mut failures = Vec::new();
    for (name, mesh) in meshes() {
        let groups = Resolution::Length(1.7 * cell_size(&mesh, &Comm::serial()));
        let mut base = model::spec();
        (base.dim, base.node_types) = (mesh.dim(), NodeType::ALL.to_vec());
        for (i, segments) in methods(6, 3).iter().enumerate() {
            // The kinds without segments once.
            for spec in kinds(&base, segments).into_iter().take(if i == 0 { 6 } else { 2 }) {
                let model = Model::random(spec, 21).unwrap();
                let kind = model.spec.architecture.name().name();
                // Groups are of cells.
                let resolutions =
                    [Resolution::Off, groups].into_iter().take(if name == POINTS { 1 } else { 2 });
                for resolution in resolutions {
                    let (labels, u) = steps(&mesh, &model, resolution);
                    let largest = u.iter().fold(0f64, |most, v| most.max(v.abs()));
                    for seed in [3, 11] {
                        let what = format!("{name}, {kind}, {}, {resolution:?}, {seed}", segments.method);
                        let (other, [cells, _]) = sample::renumbered(&mesh, seed);
                        let (found, v) = steps(&other, &model, resolution);
                        let moved = (0..found.len()).filter(|&c| found[c] != labels[cells[c]]).count();
                        if moved > 0 {
                            failures.push(format!("{what}: {moved} cells in other segments"));
                            continue;
                        }
                        let pairs =
                            v.chunks_exact(3).zip(&cells).flat_map(|(v, &c)| v.iter().zip(&u[3 * c..]));
                        let off = pairs.fold(0f64, |most, (a, b)| most.max((a - b).abs())) / largest;
                        if off.is_nan() || off > TOLERANCE {
                            failures.push(format!("{what}: a step is off by {off:e}"));
                        }
                    }
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn bodies_do_not_depend_on_the_numbering() {
    let mut failures = Vec::new();
    let obstacle = bodies::octahedron([4.0, 0.8, 1.7], 0.5);
    let body = bodies::block([9, 3, 2], [4.5, 1.5, 1.0]);
    let mut base = model::bodies();
    base.contact = Some(m4gn_model::ContactSpec { radius: 0.6 });
    for (i, segments) in methods(6, 1).iter().enumerate() {
        for spec in kinds(&base, segments).into_iter().take(if i == 0 { 6 } else { 2 }) {
            let what = format!("{}, {}", spec.architecture.name().name(), segments.method);
            let model = Model::random(spec, 3).unwrap();
            let step = |body: &m4gn_mesh::body::Body| {
                let mesh = body.mesh(Some(&obstacle));
                let mut session =
                    Session::new(Comm::serial(), &mesh, &model, &SessionOptions::default()).unwrap();
                let mut u = vec![[0.0; 3]; body.positions.len()];
                let at = |s: f64| vec![[0.02 * s, 0.0, -0.1 * s]; 6];
                session.step_body(&mut u, [&at(1.0), &at(2.0)]).unwrap();
                (session.cell_segment().to_vec(), u)
            };
            let (labels, u) = step(&body);
            let largest = u.as_flattened().iter().fold(0f64, |most, v| most.max(v.abs()));
            for seed in [3, 11] {
                let (other, points) = bodies::renumbered(&body, seed);
                let (found, v) = step(&other);
                let moved = (0..found.len()).filter(|&p| found[p] != labels[points[p]]).count();
                let pairs = v.iter().zip(&points).flat_map(|(v, &p)| v.iter().zip(&u[p]));
                let off = pairs.fold(0f64, |most, (a, b)| most.max((a - b).abs())) / largest;
                if moved > 0 || off.is_nan() || off > TOLERANCE {
                    failures
                        .push(format!("{what}, {seed}: {moved} points in other segments, off by {off:e}"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
