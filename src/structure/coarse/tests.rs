use super::Coarse;
use m4gn_base::Error;
use m4gn_mesh::{Mesh, NodeType};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use proptest::prelude::*;

fn mesh() -> Mesh {
    sample::triangles(16, 12, 2.0, 1.5)
}

fn coarse(mesh: &Mesh, edge_length: f64) -> Coarse {
    Coarse::new(mesh, edge_length, &Comm::serial()).unwrap().unwrap()
}

/// A linear function of the cells and boundary faces.
fn linear(mesh: &Mesh) -> Vec<f32> {
    let f = |x: &[f64; 3]| (1.0 + 2.0 * x[0] - 3.0 * x[1]) as f32;
    let faces = mesh.boundary.iter().map(|b| f(&b.centre));
    mesh.cell_centres.iter().map(f).chain(faces).collect()
}

/// Checks that values of cells have these means over the groups.
fn check_means(mesh: &Mesh, coarse: &Coarse, cells: &[f64], means: &[f64]) {
    let values: Vec<f32> = cells.iter().map(|&x| x as f32).chain(vec![0.0; mesh.boundary.len()]).collect();
    let found = coarse.transfer.restrict(&values, 1, &Comm::serial()).values;
    for (x, y) in found.iter().zip(means) {
        assert!((f64::from(*x) - y).abs() < 1e-5, "{x} for {y}");
    }
}

#[test]
fn groups_are_a_mesh_of_the_asked_edge_length() {
    let mesh = mesh();
    let comm = Comm::serial();
    let edge = 3.0 * m4gn_model::cell_size(&mesh, &comm);
    let coarse = coarse(&mesh, edge);
    coarse.mesh.check(&comm).unwrap();
    let found = m4gn_model::cell_size(&coarse.mesh, &comm);
    assert!((found / edge - 1.0).abs() < 0.25, "{found} m, asked for {edge} m");
    let volume = |m: &Mesh| m.cell_volumes.iter().sum::<f64>();
    assert!((volume(&coarse.mesh) / volume(&mesh) - 1.0).abs() < 1e-12);
    // Closed: area vectors of all boundary faces sum to nothing, as before.
    let area = coarse.mesh.boundary.iter().map(|b| b.area);
    let sum = area.fold([0.0; 3], |s, a| [s[0] + a[0], s[1] + a[1], s[2] + a[2]]);
    assert!(sum.iter().all(|x| x.abs() < 1e-12), "{sum:?}");
}

#[test]
fn a_mesh_that_is_coarse_already_stays_as_it_is() {
    let (mesh, comm) = (mesh(), Comm::serial());
    let size = m4gn_model::cell_size(&mesh, &comm);
    assert!(Coarse::new(&mesh, 0.5 * size, &comm).unwrap().is_none());
    assert!(Coarse::new(&mesh, 1.1 * size, &comm).unwrap().is_none());
    let coarse = coarse(&mesh, 1.3 * size);
    assert!(coarse.n_groups < mesh.n_cells() * 3 / 4, "{} groups", coarse.n_groups);
}

#[test]
fn linear_changes_come_back_exactly_inside_and_means_everywhere() {
    let mesh = mesh();
    let comm = Comm::serial();
    let coarse = coarse(&mesh, 0.4);
    let values = linear(&mesh);
    let restricted = coarse.transfer.restrict(&values, 1, &comm).values;
    let own: Vec<f64> = restricted[..coarse.n_groups].iter().map(|&x| f64::from(x)).collect();
    let back = coarse.transfer.prolong(&own, &vec![0.0; coarse.n_groups], &comm);
    for (x, y) in back.iter().zip(&values) {
        assert!((x - f64::from(*y)).abs() < 1e-4, "{x} for {y}");
    }
    check_means(&mesh, &coarse, &back, &own);
}

#[test]
fn a_change_beside_a_wall_is_zero_there_and_curved() {
    let (mesh, comm) = (sample::triangles(32, 24, 2.0, 1.5), Comm::serial());
    let coarse = coarse(&mesh, 0.25);
    // Zero at y = 0, which is a wall, with a gradient and a curvature along its normal
    let profile = |y: f64| 2.0 * y - 3.0 * y * y;
    let mut values: Vec<f32> = mesh.cell_centres.iter().map(|c| profile(c[1]) as f32).collect();
    values.extend(mesh.boundary.iter().map(|b| profile(b.centre[1]) as f32));
    let restricted = coarse.transfer.restrict(&values, 1, &comm);
    let own: Vec<f64> = restricted.values[..coarse.n_groups].iter().map(|&x| f64::from(x)).collect();
    let below = |b: &&m4gn_mesh::BoundaryFace| b.kind == NodeType::Wall && b.centre[1] < 1e-9;
    let mut beside: Vec<i32> =
        mesh.boundary.iter().filter(below).map(|b| coarse.group[b.owner as usize]).collect();
    beside.retain(|&g| {
        let faces = mesh.boundary.iter().filter(|b| coarse.group[b.owner as usize] == g);
        faces.filter(|b| b.kind == NodeType::Wall).all(|b| b.centre[1] < 1e-9)
    });
    let walls = coarse.transfer.at_walls(&values, &restricted, &comm);
    assert!(beside.len() > 4 && beside.iter().all(|&g| walls[g as usize] > 0.999));
    let error = |walls: &[f64]| {
        let back = coarse.transfer.prolong(&own, walls, &comm);
        let cells = (0..mesh.n_cells()).filter(|&c| beside.contains(&coarse.group[c]));
        cells.map(|c| (back[c] - profile(mesh.cell_centres[c][1])).abs()).fold(0.0, f64::max)
    };
    let (held, free) = (error(&walls), error(&vec![0.0; coarse.n_groups]));
    assert!(held < 1e-4 && free > 0.02, "{held} and {free}");
    // Means are kept
    let back = coarse.transfer.prolong(&own, &walls, &comm);
    check_means(&mesh, &coarse, &back, &own);
}

#[test]
fn a_zero_gradient_stays_one() {
    let mesh = mesh();
    let mut values = linear(&mesh);
    let n = mesh.n_cells();
    for (i, face) in mesh.boundary.iter().enumerate() {
        values[n + i] = values[face.owner as usize];
    }
    let coarse = coarse(&mesh, 0.4);
    let restricted = coarse.transfer.restrict(&values, 1, &Comm::serial()).values;
    for (i, face) in coarse.mesh.boundary.iter().enumerate() {
        assert_eq!(restricted[coarse.n_groups + i], restricted[face.owner as usize]);
    }
}

#[test]
fn groups_joined_by_a_cyclic_patch_know_the_way_through_it() {
    let mut mesh = sample::rectangle(16, 8, 2.0, 1.0);
    sample::make_cyclic(&mut mesh, 2.0);
    let coarse = coarse(&mesh, 0.25);
    assert_eq!(coarse.n_groups, 32);
    coarse.mesh.check(&Comm::serial()).unwrap();
    assert!(!coarse.mesh.coupled.is_empty());
    for face in &coarse.mesh.coupled {
        let (here, there) =
            (coarse.mesh.cell_centres[face.owner as usize], coarse.mesh.cell_centres[face.global as usize]);
        assert!((there[0] - here[0]).abs() > 1.0 && face.delta[0].abs() < 0.5, "{face:?}");
    }
}

#[test]
fn labels_go_to_groups_and_back() {
    let mesh = mesh();
    let comm = Comm::serial();
    let coarse = coarse(&mesh, 0.4);
    let labels: Vec<i32> = (0..coarse.n_groups as i32).map(|g| g % 5).collect();
    let cells = coarse.labels_of_cells(&labels, &comm);
    assert_eq!(coarse.labels_of_groups(&mesh, &cells, &comm), labels);
}

#[test]
fn lengths_that_are_none_are_refused() {
    for edge in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = Coarse::new(&mesh(), edge, &Comm::serial()).unwrap_err();
        assert!(matches!(error, Error::Input(_)), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn averages_are_kept(edge in 1.3..8.0f64, nx in 2usize..20, ny in 2usize..12) {
        let mesh = sample::triangles(nx, ny, 2.0, 1.0);
        let comm = Comm::serial();
        let Some(coarse) = Coarse::new(&mesh, edge * m4gn_model::cell_size(&mesh, &comm), &comm).unwrap() else {
            return Ok(());
        };
        coarse.mesh.check(&comm).unwrap();
        let values = linear(&mesh);
        let restricted = coarse.transfer.restrict(&values, 1, &comm).values;
        let mean = |m: &Mesh, v: &[f32]| -> f64 {
            m.cell_volumes.iter().zip(v).map(|(w, &x)| w * f64::from(x)).sum()
        };
        let (fine, groups) = (mean(&mesh, &values), mean(&coarse.mesh, &restricted));
        prop_assert!((fine - groups).abs() < 1e-5 * fine.abs().max(1.0), "{} {}", fine, groups);
    }
}
