use crate::Modal;
use m4gn_mesh::{ElasticModes, Mesh};
use m4gn_model::modal::ModalSource;
use m4gn_model::{ModalOperator, SegmentSpec};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use m4gn_structure as segments;
use m4gn_structure::graph::Graph;

/// A mesh with modes of a body; the second and third have one frequency, and the basis is turned by `angle`.
fn mesh(angle: f64) -> Mesh {
    let mut mesh = sample::triangles(12, 6, 1.2, 0.6);
    let wave = |k: f64, x: &[f64; 3]| [(k * x[0]).sin(), (k * x[1]).cos(), 0.0];
    let of = |f: &dyn Fn(&[f64; 3]) -> [f64; 3]| mesh.cell_centres.iter().map(f).collect();
    let (c, s) = (angle.cos(), angle.sin());
    let pair = |a: f64, b: f64| {
        move |x: &[f64; 3]| {
            let (u, v) = (wave(5.0, x), wave(8.0, x));
            [0, 1, 2].map(|d| a * u[d] + b * v[d])
        }
    };
    let vectors = vec![
        of(&|x| wave(2.0, x).map(|v| v * angle.cos().signum())),
        of(&pair(c, s)),
        of(&pair(-s, c)),
        of(&|x| wave(11.0, x)),
    ];
    mesh.elastic = Some(ElasticModes { eigenvalues: vec![1.0, 4.0, 4.0 + 1e-9, 9.0], vectors });
    mesh
}

fn spec(operator: Option<ModalOperator>, modes: usize) -> SegmentSpec {
    SegmentSpec { count: 9, modes, operator, ..Default::default() }
}

fn labels(mesh: &Mesh, spec: &SegmentSpec) -> m4gn_base::Result<Vec<i32>> {
    let comm = Comm::serial();
    let mut graph = Graph::new(mesh, &comm)?;
    Ok(segments::segment(mesh, &mut graph, spec, &Modal::default(), &comm, None)?.node_segment)
}

#[test]
fn repeated_frequencies_come_whole_and_each_solved_component_is_a_feature() {
    let (mesh, comm) = (mesh(0.0), Comm::serial());
    let of = |count| {
        let modes = Modal::default().of_mesh(&mesh, true, count, &comm);
        modes.map(|m| m.eigenvalues)
    };
    let values = of(2).unwrap();
    assert_eq!(values, [1.0, 1.0, 4.0, 4.0, 4.0 + 1e-9, 4.0 + 1e-9]);
    assert!(of(0).unwrap().is_empty());
    m4gn_samples::fails(of(5), &["5 elastic modes: the mesh has 4"]);
}

#[test]
fn segments_depend_on_neither_signs_nor_bases() {
    let elastic = spec(None, 2);
    let first = labels(&mesh(0.0), &elastic).unwrap();
    for angle in [0.4, 2.0, 3.1] {
        assert_eq!(labels(&mesh(angle), &elastic).unwrap(), first, "turned by {angle}");
    }
    let laplacian = labels(&mesh(0.0), &spec(Some(ModalOperator::Laplacian), 2)).unwrap();
    assert_ne!(first, laplacian);
}

#[test]
fn elastic_modes_that_are_not_there_or_broken_are_named() {
    let without = Mesh { elastic: None, ..mesh(0.0) };
    let wanted = spec(Some(ModalOperator::Elastic), 2);
    m4gn_samples::fails(labels(&without, &wanted), &["the mesh has none with it; expected E, nu and rho"]);
    let broken = |change: &dyn Fn(&mut ElasticModes)| {
        let mut mesh = mesh(0.0);
        change(mesh.elastic.as_mut().unwrap());
        labels(&mesh, &wanted).unwrap_err().to_string()
    };
    assert!(broken(&|e| e.vectors[1].truncate(3)).contains("mode_cells has 3 entries"));
    assert!(broken(&|e| e.vectors[1][7][0] = f64::NAN).contains("elastic mode 1 holds a number"));
    assert!(broken(&|e| e.eigenvalues[1] = 0.0).contains("mode_eigenvalues[1] is 0, after 1"));
}
