//! What the shipped models predict in fp32 on small meshes, to the bit. The portable kernels compute it, so that the bits do
//! not depend on the processor.
//!
//! A change of these bits is a change of every user's results: it needs a reason that is written down with the new digests.

use m4gn_engine::Isa;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{Model, ModelSpec, Output, Resolution};
use m4gn_parallel::Comm;
use m4gn_samples::bodies;
use m4gn_samples::mesh as sample;
use m4gn_step::{Field, FieldMut, Session, SessionOptions};
use std::path::Path;

/// Model, case, digest of two steps, and the last of the predicted values for people.
const EXPECTED: [(&str, &str, u64, f64); 5] = [
    ("cylinder-flow", "cells", 0x7517_695c_39cc_5712, -0.8079977631568909),
    ("cylinder-flow", "groups", 0xd683_8f61_3353_800e, -0.0788152739405632),
    ("vibrating-rubber", "cells", 0x3e6c_df6e_4abd_f53e, 0.10366823234491879),
    ("deforming-beam", "body", 0xd6fc_540e_f103_1545, -0.00015988182492108536),
    ("deforming-plate", "body", 0x342d_df43_5f03_b426, -0.0011795931457716324),
];

/// FNV-1a of the values' bits.
fn digest(values: &[f64]) -> u64 {
    let bytes = values.iter().flat_map(|v| v.to_bits().to_le_bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// From 0 to 1 and back over `period` steps of i. It is made of products alone, which every processor rounds alike.
fn wave(i: usize, period: usize) -> f64 {
    let t = (i % period) as f64 / period as f64;
    4.0 * t * (1.0 - t)
}

fn options(resolution: Resolution) -> SessionOptions {
    SessionOptions { isa: Some(Isa::portable()), resolution, ..SessionOptions::default() }
}

/// A mesh with about the cells of the training, whose boundary faces are of the model's types.
fn mesh_of(spec: &ModelSpec) -> Mesh {
    let known = |kind: NodeType| spec.node_types.contains(&kind);
    let mut mesh = match spec.dim {
        2 => sample::triangles(24, 16, 0.3, 0.2),
        _ => sample::block([7, 3, 2], [0.21, 0.09, 0.06]),
    };
    for face in &mut mesh.boundary {
        if !known(face.kind) {
            face.kind = match face.kind {
                NodeType::Inlet => NodeType::Handle,
                _ => NodeType::Free,
            };
        }
    }
    mesh
}

/// Two steps of a model of fields at cells, from fields within the middle half of what it was trained on.
fn steps_of_cells(model: &Model, resolution: Resolution) -> Vec<f64> {
    let spec = &model.spec;
    let mesh = mesh_of(spec);
    let mut session = Session::new(Comm::serial(), &mesh, model, &options(resolution)).unwrap();
    let trained_on = spec.trained_on.as_ref().unwrap();
    let values = |name: &str, components: usize, n: usize, period: usize| -> Vec<f64> {
        let range = trained_on.inputs.iter().find(|r| r.field == name);
        let [low, high] = range.map_or([0.0, 0.0], |r| r.range);
        let of = |i: usize| {
            low + (high - low) * (0.25 + 0.5 * wave(i / components + 7 * (i % components), period))
        };
        (0..n * components).map(of).collect()
    };
    let components: Vec<usize> = spec.fields.iter().map(|f| if f.vector { 3 } else { 1 }).collect();
    let mut state: Vec<[Vec<f64>; 2]> = spec
        .fields
        .iter()
        .zip(&components)
        .enumerate()
        .map(|(k, (f, &c))| {
            [
                values(&f.name, c, mesh.n_cells(), 29 + 4 * k),
                values(&f.name, c, mesh.boundary.len(), 17 + 2 * k),
            ]
        })
        .collect();
    // As in the recordings that the models were trained on, whose pressure has no level.
    for (_, [_, boundary]) in spec.fields.iter().zip(&mut state).filter(|(f, _)| f.has_level()) {
        let faces = boundary.iter_mut().zip(&mesh.boundary);
        faces.filter(|(_, face)| face.kind == NodeType::Outlet).for_each(|(p, _)| *p = 0.0);
    }
    let mut all = Vec::new();
    for _ in 0..2 {
        let before = state.clone();
        let fields: Vec<Field> = spec
            .fields
            .iter()
            .zip(&components)
            .zip(&before)
            .map(|((f, &components), [cells, boundary])| Field { name: &f.name, components, cells, boundary })
            .collect();
        let mut out: Vec<FieldMut> = spec
            .fields
            .iter()
            .zip(&components)
            .zip(&mut state)
            .filter(|((f, _), _)| f.output != Output::None)
            .map(|((f, &components), [cells, _])| FieldMut { name: &f.name, components, cells })
            .collect();
        session.step(&fields, &mut out).unwrap();
        out.iter().for_each(|o| all.extend_from_slice(o.cells));
    }
    all
}

/// The points of a body a little off their places, so that no two distances are the same. Bodies are small enough for their modes to be
/// computed without SLEPc.
fn uneven(mut body: Body) -> Body {
    for (i, x) in body.positions.iter_mut().enumerate() {
        for (d, v) in x.iter_mut().enumerate() {
            *v += 2e-4 * (wave(i + 5 * d, 23 + 8 * d) - 0.5);
        }
    }
    body
}

/// Two steps of a body under an obstacle that comes down on it, and a third one from a state that a solver changed.
fn steps_of_body(model: &Model, body: &Body, obstacle: &Obstacle) -> Vec<f64> {
    let mesh = body.mesh(Some(obstacle));
    let mut session = Session::new(Comm::serial(), &mesh, model, &options(Resolution::Off)).unwrap();
    let at =
        |step: i32| vec![[2e-4 * f64::from(step), 0.0, -1e-3 * f64::from(step)]; obstacle.positions.len()];
    let mut u = vec![[0.0; 3]; body.positions.len()];
    let mut all = Vec::new();
    for step in 0..3 {
        if step == 2 {
            for (i, u) in u.iter_mut().enumerate().filter(|(i, _)| body.types[*i] == NodeType::Body) {
                u[2] -= 3e-4 * wave(i, 31);
            }
        }
        session.step_body(&mut u, [&at(step), &at(step + 1)]).unwrap();
        all.extend_from_slice(u.as_flattened());
    }
    all
}

#[test]
fn shipped_models_predict_the_same_bits() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let mut differing = Vec::new();
    for (name, case, expected, last) in EXPECTED {
        let model = Model::read(folder.join(format!("{name}.safetensors"))).unwrap();
        let block = || uneven(bodies::block([3, 2, 2], [0.012, 0.0085, 0.0075]));
        let values = match case {
            "body" => steps_of_body(&model, &block(), &bodies::octahedron([0.009, 0.004, 0.0135], 0.004)),
            "groups" => steps_of_cells(&model, Resolution::Auto),
            _ => steps_of_cells(&model, Resolution::Off),
        };
        let found = (digest(&values), values[values.len() - 1]);
        if found != (expected, last) {
            differing.push(format!("(\"{name}\", \"{case}\", {:#018x}, {:?}),", found.0, found.1));
        }
    }
    assert!(differing.is_empty(), "other bits than before:\n{}", differing.join("\n"));
}

/// All shipped models are held.
#[test]
fn every_shipped_model_is_here() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "safetensors") {
            let name = path.file_stem().unwrap().to_str().unwrap();
            assert!(EXPECTED.iter().any(|e| e.0 == name), "{name}: add it with its digest");
        }
    }
}
