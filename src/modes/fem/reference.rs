//! Against an independent program: `bench/solids_reference.py` made `reference.json`.

use super::PointMesh;
use super::*;
use m4gn_mesh::elements::ElementKind;

#[derive(serde::Deserialize)]
struct Case {
    shape: String,
    young: f64,
    poisson: f64,
    density: f64,
    points: Vec<Vec<f64>>,
    cells: Vec<Vec<usize>>,
    held: Vec<usize>,
    eigenvalues: Vec<f64>,
}

impl Case {
    /// Two dimensions become a mesh that is one cell thick.
    fn mesh(&self) -> PointMesh {
        let n = self.points.len();
        let flat = self.points[0].len() == 2;
        let mut points: Vec<[f64; 3]> =
            self.points.iter().map(|x| [x[0], x[1], x.get(2).copied().unwrap_or(0.0)]).collect();
        let kind = match self.shape.as_str() {
            "tetrahedron" => ElementKind::Tetrahedron,
            "wedge" | "triangle" => ElementKind::Wedge,
            _ => ElementKind::Hexahedron,
        };
        let corners = |cell: &Vec<usize>| match flat {
            true => cell.iter().copied().chain(cell.iter().map(|p| p + n)).collect(),
            false => cell.clone(),
        };
        let cells: Vec<Vec<Vec<usize>>> = self
            .cells
            .iter()
            .map(|cell| {
                let corners: Vec<usize> = corners(cell);
                kind.sides().iter().map(|f| f.iter().map(|&i| corners[i]).collect()).collect()
            })
            .collect();
        if flat {
            points.extend(points.clone().iter().map(|x| [x[0], x[1], 0.25]));
        }
        let mut mesh = PointMesh::from_cells(points, &cells);
        if flat {
            mesh.directions = vec![0, 1];
        }
        mesh
    }
}

#[test]
fn eigenvalues_are_those_of_the_definition() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("reference.json")).unwrap();
    assert_eq!(cases.len(), 10);
    let mut worst = 0.0f64;
    for case in &cases {
        let mesh = case.mesh();
        let material = Material { young: case.young, poisson: case.poisson, density: case.density };
        let fixed: Vec<Fixed> = case.held.iter().map(|&p| Fixed::all(p as i32)).collect();
        let options = Options { modal: ModalOptions::fixed(case.eigenvalues.len()), ..Default::default() };
        let materials = vec![material; mesh.n_cells];
        let found = modes(&mesh, &materials, &fixed, &options, &Comm::serial()).unwrap();
        for (value, expected) in found.eigenvalues.iter().zip(&case.eigenvalues) {
            let off = (value / expected - 1.0).abs();
            assert!(off < 1e-8, "{} nu {}: {value}, expected {expected}", case.shape, case.poisson);
            worst = worst.max(off);
        }
    }
    println!("largest difference {worst:.1e}");
}
