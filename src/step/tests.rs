//! Sessions on sample meshes, in serial.

use super::flow::Flow;
use super::*;
use m4gn_base::Error;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{FieldSpec, Kind, Level, Model, ModelSpec, Output, SegmentEntries};
use m4gn_samples::mesh as sample;
use m4gn_samples::model::spec;

fn entries(name: &str, value: impl Into<serde_json::Value>) -> SegmentEntries {
    let mut entries = SegmentEntries::default();
    entries.set(name, value);
    entries
}

fn session(options: &SessionOptions) -> Session {
    session_of(spec(), options)
}

fn session_of(spec: ModelSpec, options: &SessionOptions) -> Session {
    let mesh = sample::triangles(8, 6, 1.6, 0.41);
    let model = Model::random(spec, 11).unwrap();
    Session::new(Comm::serial(), &mesh, &model, options).unwrap()
}

fn state(s: &Session) -> Flow {
    let wave = |n: usize| (0..n).map(|i| (0.3 * i as f64).sin()).collect::<Vec<_>>();
    Flow {
        u: wave(3 * s.n_cells()),
        u_boundary: wave(3 * s.n_boundary()),
        p: wave(s.n_cells()),
        p_boundary: wave(s.n_boundary()),
    }
}

/// A step from `state`: U and p, which are 7 where nothing was written.
fn step(s: &mut Session, state: &Flow) -> (Result<()>, Vec<f64>, Vec<f64>) {
    let (mut u, mut p) = (vec![7.0; state.u.len()], vec![7.0; state.p.len()]);
    let done = state.step(s, &mut u, &mut p);
    (done, u, p)
}

#[test]
fn changes_are_added_and_values_replace() {
    let mut s = session(&SessionOptions::default());
    let state = state(&s);
    let (done, u, p) = step(&mut s, &state);
    done.unwrap();
    let level = Level::new(&sample::triangles(8, 6, 1.6, 0.41), &s.comm);
    let level = level.of(&state.p, &state.p_boundary, &s.comm);
    for cell in 0..s.n_cells() {
        let y = &s.stepper.outputs()[3 * cell..3 * cell + 3];
        assert_eq!(u[3 * cell], state.u[3 * cell] + y[0] as f64);
        assert_eq!(u[3 * cell + 1], state.u[3 * cell + 1] + y[1] as f64);
        assert_eq!(u[3 * cell + 2], 7.0, "a component that is not solved was touched");
        assert_eq!(p[cell], level + y[2] as f64);
    }
    assert_eq!(s.n_segments(), 4);
    assert!(s.cell_segment().iter().all(|k| (0..4).contains(k)));
}

#[test]
fn a_level_of_the_pressure_goes_through_and_changes_nothing_else() {
    for output in [Output::Value, Output::Delta] {
        let mut spec = spec();
        spec.fields[1].output = output;
        let mut s = session_of(spec, &SessionOptions::default());
        let mut state = state(&s);
        let (done, u, p) = step(&mut s, &state);
        done.unwrap();
        state.p.iter_mut().chain(&mut state.p_boundary).for_each(|p| *p += 1e4);
        let (done, raised_u, raised_p) = step(&mut s, &state);
        done.unwrap();
        let near = |a: &[f64], b: &[f64], by: f64| a.iter().zip(b).all(|(a, b)| (b - a - by).abs() < 1e-5);
        assert!(near(&u, &raised_u, 0.0) && near(&p, &raised_p, 1e4));
        assert!(s.outside().is_empty());
    }
}

/// On its scale a positive field is a field as others are; whatever it was, it comes out positive.
#[test]
fn positive_fields_are_on_a_scale_of_their_own() {
    let floor = 1e-3;
    let of = |floor, output| {
        let mut spec = spec();
        (spec.fields[1].dimensions, spec.fields[1].floor) = ([0; 7], floor);
        spec.fields[1].output = output;
        session_of(spec, &SessionOptions::default())
    };
    for output in [Output::Value, Output::Delta] {
        let (mut mapped, mut plain) = (of(Some(floor), output), of(None, output));
        let mut state = state(&mapped);
        let (done, u, p) = step(&mut mapped, &state);
        done.unwrap();
        assert!(p.iter().all(|&p| p >= floor) && state.p.iter().any(|&p| p < 0.0));
        state.p.iter_mut().chain(&mut state.p_boundary).for_each(|p| *p = p.max(floor).ln());
        let (done, plain_u, plain_p) = step(&mut plain, &state);
        done.unwrap();
        assert_eq!(u, plain_u);
        assert!(p.iter().zip(&plain_p).all(|(a, b)| (a - b.exp().max(floor)).abs() <= 1e-12 * a));
        assert!(p.iter().any(|&p| p > floor));
        // What a case is compared by is physical
        mapped.spec.trained_on = Some(m4gn_model::TrainedOn {
            cell_size: [0.0, 1.0],
            speed: None,
            courant: None,
            inputs: vec![m4gn_model::InputRange { field: "p".into(), range: [floor, 0.5] }],
            solid: None,
        });
        let outside = mapped.outside();
        assert!(outside.len() == 1 && outside[0].contains('1'), "{outside:?}");
        state.p[0] = 1e30;
        let (done, ..) = step(&mut mapped, &state);
        assert!(done.is_ok(), "{done:?}");
        state.p[0] = f64::NAN;
        let (done, ..) = step(&mut mapped, &state);
        assert!(done.unwrap_err().to_string().contains("input field 'p' is NaN"));
    }
}

#[test]
fn wrong_fields_are_refused_and_outputs_left_alone() {
    let mut s = session(&SessionOptions::default());
    let state = state(&s);
    let mut nan = state.p.clone();
    nan[5] = f64::NAN;
    let [u, p] = state.fields();
    let cases: [(&[Field], &str); 6] = [
        (&[u], "input field 'p' is missing"),
        (&[u, Field { components: 3, ..p }], "a scalar (1 components), found 3"),
        (&[Field { components: 1, ..u }, p], "a vector (3 components), found 1"),
        (&[Field { cells: &state.u[3..], ..u }, p], "cell values"),
        (&[u, Field { boundary: &[], ..p }], "boundary values"),
        (&[u, Field { cells: &nan, ..p }], "'p' is NaN at cell 5"),
    ];
    for (fields, message) in cases {
        let (mut a, mut b) = (vec![7.0; state.u.len()], vec![7.0; state.p.len()]);
        let mut out = [("U", 3, &mut a), ("p", 1, &mut b)].map(|(name, components, cells)| FieldMut {
            name,
            components,
            cells,
        });
        m4gn_samples::fails(s.step(fields, &mut out), &[message]);
        assert!(a.iter().chain(&b).all(|v| *v == 7.0));
    }
    for (name, components, words) in
        [("U", 3, "no array for the predicted field 'p'"), ("T", 1, "predicts U, p")]
    {
        let mut only = [FieldMut { name, components, cells: &mut vec![7.0; state.u.len()] }];
        assert!(s.step(&state.fields(), &mut only).unwrap_err().to_string().contains(words));
    }
}

#[test]
fn a_result_that_overflows_is_a_numerical_error() {
    let mut s = session(&SessionOptions::default());
    let mut state = state(&s);
    // Finite as a double, infinite as the network sees it.
    state.u[0] = 1e300;
    let (done, a, b) = step(&mut s, &state);
    assert!(matches!(done, Err(Error::Numerical(_))));
    assert!(a.iter().chain(&b).all(|v| *v == 7.0));
}

#[test]
fn cases_that_do_not_fit_are_refused() {
    let refused = |mesh: &Mesh, spec: ModelSpec, options: SessionOptions, words: &[&str]| {
        let model = Model::random(spec, 1).unwrap();
        let session = Session::new(Comm::serial(), mesh, &model, &options);
        let message = session.err().expect("not refused").to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    let mesh = sample::rectangle(6, 4, 1.0, 1.0);
    let default = SessionOptions::default;

    let mut s = spec();
    s.node_types.retain(|t| *t != NodeType::Outlet);
    refused(&mesh, s, default(), &["the model knows fluid, wall, inlet; patch '", "is outlet"]);
    let block = sample::block([3, 2, 2], [1.0; 3]);
    refused(&block, spec(), default(), &["trained in 2 dimensions; this case solves 3 (x, y, z)"]);
    let many = SessionOptions { segments: entries("count", 25), ..default() };
    refused(&mesh, spec(), many, &["25 segments for 24 cells"]);
    // On the network's own, coarser graph: the count of the case's cells says nothing
    let mut s = spec();
    s.resolution = Some(0.4);
    let options = SessionOptions { segments: entries("count", 20), ..default() };
    refused(&mesh, s, options, &["the 24 cells of this case are ", "and it has 20 segments"]);
    refused(&mesh, spec(), SessionOptions { segments: entries("tau", -1), ..default() }, &["tau"]);
    let labels = SessionOptions { cell_segment: Some(vec![0; 3]), ..default() };
    refused(&mesh, spec(), labels, &["3 segment labels for 24 cells"]);
    refused(&mesh, spec(), SessionOptions { n_threads: 1 << 20, ..default() }, &["n_threads"]);
    assert!(Backend::parse("tensorflow").is_err() && Backend::parse("torch:").is_err());
}

#[test]
fn threads_and_given_segments_do_not_change_the_result() {
    let run = |options: &SessionOptions| {
        let mut s = session(options);
        let state = state(&s);
        let (done, u, p) = step(&mut s, &state);
        done.unwrap();
        (u, p, s.cell_segment().to_vec())
    };
    let first = run(&SessionOptions::default());
    let threads = run(&SessionOptions { n_threads: 3, ..Default::default() });
    assert_eq!(first, threads);
    let preset = run(&SessionOptions { cell_segment: Some(first.2.clone()), ..Default::default() });
    assert_eq!(first, preset);
}

#[test]
fn a_model_can_be_computed_in_the_precision_that_it_was_trained_in() {
    use m4gn_engine::{Isa, Precision, PrecisionChoice};
    let run = |trained: Precision, precision: PrecisionChoice| {
        let options = SessionOptions { precision, ..SessionOptions::default() };
        let trained = ModelSpec { precision: trained, ..spec() };
        let mut s = session_of(trained, &options);
        let state = state(&s);
        let (done, u, p) = step(&mut s, &state);
        done.unwrap();
        (u, p)
    };
    let own = PrecisionChoice::Model;
    let (fp32, bf16) =
        (run(Precision::Fp32, PrecisionChoice::Fp32), run(Precision::Fp32, PrecisionChoice::Bf16));
    assert_ne!(fp32, bf16);
    assert_eq!(run(Precision::Fp32, own), fp32);
    assert_eq!(run(Precision::Bf16, PrecisionChoice::Fp32), fp32);
    match Isa::detect().bf16_pays() {
        true => assert_eq!(run(Precision::Bf16, own), bf16),
        false => assert_eq!(run(Precision::Bf16, own), fp32),
    }
}

#[test]
fn a_plain_network_has_no_segments() {
    let mut s = spec();
    s.architecture.kind = Kind::MeshGraphNet { layers: 2 };
    s.fields.push(FieldSpec {
        name: "T".into(),
        vector: false,
        dimensions: [0; 7],
        input: true,
        output: Output::None,
        floor: None,
    });
    let mesh = sample::rectangle(5, 4, 1.0, 1.0);
    let session =
        Session::new(Comm::serial(), &mesh, &Model::random(s, 1).unwrap(), &SessionOptions::default())
            .unwrap();
    assert_eq!((session.n_segments(), session.cell_segment().len()), (0, 0));
}

#[test]
fn a_free_face_is_seen_as_its_cell() {
    let mut mesh = sample::triangles(8, 6, 1.6, 0.41);
    let free = mesh.boundary.len() / 2;
    mesh.boundary[free].kind = NodeType::Free;
    let mut s = spec();
    s.node_types.push(NodeType::Free);
    let model = Model::random(s, 11).unwrap();
    let mut session = Session::new(Comm::serial(), &mesh, &model, &SessionOptions::default()).unwrap();
    let mut state = state(&session);
    let mut stepped = |state: &Flow| {
        let (done, u, _) = step(&mut session, state);
        done.unwrap();
        u
    };
    let first = stepped(&state);
    state.u_boundary[3 * free] += 1.0;
    assert_eq!(stepped(&state), first, "the free face's own vector is not read");
    state.u_boundary[0] += 1.0;
    assert_ne!(stepped(&state), first, "another face's is");
}
