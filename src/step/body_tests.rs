//! Sessions of bodies, in serial.

use super::*;
use m4gn_base::Error;
use m4gn_domain::Place;
use m4gn_engine::plain;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Obstacle};
use m4gn_mesh::vector::Vector;
use m4gn_model::{MicroSpec, Model, NodeSums, WorldEdges};
use m4gn_modes::Modal;
use m4gn_samples::bodies as sample;
use m4gn_samples::model::{bodies, bodies_of_other_kinds};

fn case() -> (Model, Body, Obstacle) {
    let mut spec = bodies();
    spec.segments.count = 3;
    spec.segments.modes = 1;
    let obstacle = sample::octahedron([2.6, 0.5, 1.6], 0.5);
    (Model::random(spec, 5).unwrap(), sample::block([6, 2, 2], [3.0, 1.0, 1.0]), obstacle)
}

fn session(model: &Model, body: &Body, obstacle: &Obstacle) -> Session {
    let mesh = body.mesh(Some(obstacle));
    Session::new(Comm::serial(), &mesh, model, &SessionOptions::default()).unwrap()
}

/// The whole body and what its network lives on, as a session on one rank makes them.
fn place(model: &Model, body: &Body, obstacle: &Obstacle) -> Place {
    let (spec, mesh) = (&model.spec, body.mesh(Some(obstacle)));
    let modal = Modal(spec.segments.modal());
    Place::whole(&mesh, spec, &spec.segments, None, &modal).unwrap()
}

fn narrow(rows: &[&[Vector]]) -> Vec<f32> {
    rows.concat().iter().flatten().map(|v| *v as f32).collect()
}

/// Edges of a state, and what the plain network says there.
fn plainly(model: &Model, place: &mut Place, mut state: Vec<f32>, next: &[f32]) -> (usize, Vec<f64>) {
    let mut inputs = Vec::new();
    place.domain.inputs(&state, next, &mut inputs);
    place.domain.set_edges(&Comm::serial(), &mut state, &mut place.structure).unwrap();
    let edges = place.structure.graph.senders.len();
    (edges, plain::forward(model, &place.structure, &inputs))
}

/// The engine that takes new edges in each step against the plain loops on a graph made for that step.
#[test]
fn steps_are_those_of_the_plain_network() {
    let (model, body, obstacle) = case();
    let edges = steps_against_the_plain_network(&model, &body, &obstacle);
    assert!(edges[0] < edges[2] && edges[3] < edges[2], "{edges:?}");
}

/// The same of networks with coarser graphs, with the displacement at the nodes, and with all switches of the paper.
#[test]
fn steps_of_other_kinds_are_those_of_the_plain_network() {
    let (Model { spec: mut papers, .. }, body, obstacle) = case();
    papers.architecture.micro =
        MicroSpec { world_edges: WorldEdges::Apart, node_sums: NodeSums::Before, node_rwse_steps: 4 };
    for spec in bodies_of_other_kinds().into_iter().chain([papers]) {
        steps_against_the_plain_network(&Model::random(spec, 5).unwrap(), &body, &obstacle);
    }
}

/// The number of edges in each step.
fn steps_against_the_plain_network(model: &Model, body: &Body, obstacle: &Obstacle) -> Vec<usize> {
    let n = body.positions.len();
    let comm = Comm::serial();
    let options = SessionOptions::default();
    let mut session = Session::new(comm.clone(), &body.mesh(Some(obstacle)), model, &options).unwrap();
    let mut place = place(model, body, obstacle);
    let mut displacement = vec![[0.0; 3]; n];
    let mut edges = Vec::new();
    for step in 0..4 {
        // Down until it touches, then away.
        let at = |s: i32| [0.0, 0.0, -0.15 * f64::from(if s > 2 { 9 - 3 * s } else { s })];
        let (now, next) = (vec![at(step); 6], vec![at(step + 1); 6]);
        let state = narrow(&[&displacement, &now]);
        let (count, plain) = plainly(model, &mut place, state, &narrow(&[&displacement, &next]));
        edges.push(count);
        let before = displacement.clone();
        session.step_body(&mut displacement, [&now, &next]).unwrap();
        for (p, (u, old)) in displacement.iter().zip(&before).enumerate() {
            for i in 0..3 {
                let expected = match body.types[p] {
                    NodeType::Body => old[i] + plain[3 * p + i],
                    _ => 0.0,
                };
                assert!((u[i] - expected).abs() < 1e-4, "{step} {p}: {} {expected}", u[i]);
            }
        }
        // Random weights move points far: the next step starts from a small part of it.
        displacement.iter_mut().flatten().for_each(|v| *v *= 0.01);
    }
    edges
}

#[test]
fn what_does_not_fit_is_refused() {
    let (model, body, obstacle) = case();
    let new = |model: &Model, options: &SessionOptions| {
        Session::new(Comm::serial(), &body.mesh(Some(&obstacle)), model, options).map(|_| ())
    };
    let cells = Model::random(m4gn_samples::model::spec(), 1).unwrap();
    let says = |result: Result<()>, word: &str| {
        m4gn_samples::fails(result, &[word]);
    };
    says(new(&cells, &SessionOptions::default()), "contact");
    let torch = SessionOptions { backend: crate::Backend::Torch(None), ..SessionOptions::default() };
    says(new(&model, &torch), "backend native");
    let inside = sample::octahedron([2.6, 0.5, 1.2], 0.5);
    let options = SessionOptions::default();
    let overlap = Session::new(Comm::serial(), &body.mesh(Some(&inside)), &model, &options);
    says(overlap.map(|_| ()), "overlaps the body at the start");
    let mut session = session(&model, &body, &obstacle);
    let still = vec![[0.0; 3]; 6];
    says(session.step_body(&mut vec![[0.0; 3]; 62], [&still, &still]), "expected 189");
    says(session.step_body(&mut vec![[0.0; 3]; 63], [&still, &still[1..]]), "after the step");
    let mut broken = vec![[0.0; 3]; 63];
    broken[7][1] = f64::NAN;
    says(session.step_body(&mut broken, [&still, &still]), "point 7");
}

/// A network that throws points out of all bounds: what searches would choke on is refused before.
#[test]
fn displacements_out_of_all_bounds_are_refused() {
    let (mut model, body, obstacle) = case();
    model.tensors.get_mut("norm.output.std").unwrap().data.fill(1e12);
    let mut session = session(&model, &body, &obstacle);
    let still = vec![[0.0; 3]; 6];
    let mut displacement = vec![[0.0; 3]; 63];
    let error = session.step_body(&mut displacement, [&still, &still]).unwrap_err();
    assert!(matches!(error, Error::Numerical(_)), "{error}");
    assert!(error.to_string().contains("the state has left what it was trained on"), "{error}");
    assert!(displacement.iter().all(|u| *u == [0.0; 3]));
}

#[test]
fn what_a_body_was_trained_on_is_compared() {
    let (mut model, body, obstacle) = case();
    // The block's edges are half a metre long.
    model.spec.trained_on = Some(m4gn_model::TrainedOn {
        cell_size: [0.4, 0.6],
        speed: None,
        courant: None,
        inputs: vec![m4gn_model::InputRange { field: "D".into(), range: [-0.1, 0.1] }],
        solid: Some(m4gn_model::Solid { poisson: Some([0.1, 0.2]), ..m4gn_model::Solid::default() }),
    });
    let mut session = session(&model, &body, &obstacle);
    // The material is known before any step, and the displacement is not.
    let material = "Poisson's ratio is 4.000e-1, and the model was trained on 1.000e-1 to 2.000e-1";
    assert_eq!(session.outside(), [material]);
    let still = vec![[0.0; 3]; 6];
    let mut from = |x: f64| {
        session.step_body(&mut vec![[x, 0.0, 0.0]; 63], [&still, &still]).unwrap();
        session.outside()
    };
    assert_eq!(from(0.1), [material]);
    let far = from(0.5);
    assert!(far.len() == 2 && far[1].starts_with("D is 0.000e0 to 5.000e-1"), "{far:?}");
}
