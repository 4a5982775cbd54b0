//! Isoparametric displacement elements as finite-element libraries have them, fully integrated.
//!
//! They serve to compare with such libraries. Linear ones are too stiff in bending, and all lock at nu near 1/2: the
//! smoothed elements are what modes are made of.

use super::mesh::Cell;
use super::numbering::Numbering;
use super::shape::{Shape, recognise};
use super::strain::Strain;
use m4gn_mesh::{Error, Result};

/// Shape functions and their slopes at one quadrature point of a reference element.
struct Sample {
    weight: f64,
    values: Vec<f64>,
    slopes: Vec<[f64; 3]>,
}

/// Stiffness of the cells and their unit masses, with `x` and `moduli` as in the smoothed formulation.
///
/// Errors: cells that are no standard element, and cells whose map from the reference element turns over.
pub(super) fn strains(
    cells: &[Cell],
    x: &[[f64; 3]],
    moduli: &[(f64, f64)],
    numbering: &Numbering,
) -> Result<(Vec<Strain>, Vec<Vec<f64>>)> {
    let mut strains = Vec::new();
    let mut masses = Vec::with_capacity(cells.len());
    for (c, (cell, &(lambda, mu))) in cells.iter().zip(moduli).enumerate() {
        let (shape, order) = recognise(cell);
        let n = cell.points.len();
        let corners: Vec<[f64; 3]> = order.iter().map(|&p| x[cell.points[p]]).collect();
        let mut mass = vec![0.0; n * n];
        for sample in samples(shape).ok_or_else(|| no_element(c, shape))? {
            let (volume, gradients) =
                map(shape, &corners, &sample).map_err(|found| inverted(c, shape, found))?;
            strains.push(Strain {
                lambda: lambda * volume,
                mu: mu * volume,
                points: order.iter().map(|&p| numbering.number[cell.points[p]].unwrap_or(-1)).collect(),
                gradients,
            });
        }
        for sample in mass_samples(shape).ok_or_else(|| no_element(c, shape))? {
            let (volume, _) = map(shape, &corners, &sample).map_err(|found| inverted(c, shape, found))?;
            for (i, &p) in order.iter().enumerate() {
                for (j, &q) in order.iter().enumerate() {
                    mass[p * n + q] += volume * sample.values[i] * sample.values[j];
                }
            }
        }
        masses.push(mass);
    }
    Ok((strains, masses))
}

fn no_element(cell: usize, shape: Shape) -> Error {
    Error::Mesh(format!(
        "cell {cell} is a {}: the isoparametric formulation knows tetrahedra, pyramids, wedges and hexahedra (2-D: \
         triangles and quadrilaterals) only; choose the smoothed one",
        shape.name()
    ))
}

fn inverted(cell: usize, shape: Shape, found: f64) -> Error {
    Error::Mesh(format!(
        "cell {cell}, a {}, is inverted or flat: its Jacobian is {found}, expected a positive one; run checkMesh",
        shape.name()
    ))
}

/// Volume of a quadrature point, and gradients of the shape functions there.
fn map(
    shape: Shape,
    corners: &[[f64; 3]],
    sample: &Sample,
) -> std::result::Result<(f64, Vec<[f64; 3]>), f64> {
    let mut j = [[0.0; 3]; 3];
    for (x, slope) in corners.iter().zip(&sample.slopes) {
        for (row, s) in j.iter_mut().zip(slope) {
            for (value, x) in row.iter_mut().zip(x) {
                *value += s * x;
            }
        }
    }
    if matches!(shape, Shape::Triangle | Shape::Quadrilateral) {
        j[2][2] = 1.0;
    }
    let minor = |a: usize, b: usize| {
        let (c, d, e, f) = ((a + 1) % 3, (a + 2) % 3, (b + 1) % 3, (b + 2) % 3);
        j[c][e] * j[d][f] - j[c][f] * j[d][e]
    };
    let det: f64 = (0..3).map(|b| j[0][b] * minor(0, b)).sum();
    if !(det > 0.0 && det.is_finite()) {
        return Err(det);
    }
    let gradient =
        |slope: &[f64; 3]| [0, 1, 2].map(|d| (0..3).map(|a| slope[a] * minor(a, d)).sum::<f64>() / det);
    Ok((sample.weight * det, sample.slopes.iter().map(gradient).collect()))
}

/// Quadrature of the stiffness; none where there is no such element.
fn samples(shape: Shape) -> Option<Vec<Sample>> {
    match shape {
        // The gradient is constant.
        Shape::Tetrahedron => Some(vec![tetrahedron([0.25; 3], 1.0 / 6.0)]),
        Shape::Triangle => Some(vec![triangle([1.0 / 3.0; 2], 0.5)]),
        _ => mass_samples(shape),
    }
}

/// Quadrature of the mass.
fn mass_samples(shape: Shape) -> Option<Vec<Sample>> {
    let g = 1.0 / 3f64.sqrt();
    let pair = [-g, g];
    let third = [[1.0 / 6.0, 1.0 / 6.0], [2.0 / 3.0, 1.0 / 6.0], [1.0 / 6.0, 2.0 / 3.0]];
    let each = |points: &[[f64; 3]], at: fn([f64; 3]) -> Sample| points.iter().map(|&p| at(p)).collect();
    let product = |a: &[[f64; 2]], z: &[f64]| -> Vec<[f64; 3]> {
        z.iter().flat_map(|&z| a.iter().map(move |p| [p[0], p[1], z])).collect()
    };
    let square: Vec<[f64; 2]> = pair.iter().flat_map(|&y| pair.map(|x| [x, y])).collect();
    Some(match shape {
        Shape::Triangle => third.map(|p| triangle(p, 1.0 / 6.0)).into(),
        Shape::Quadrilateral => square.iter().map(|p| quadrilateral(*p)).collect(),
        Shape::Tetrahedron => {
            let (a, b) = (0.585_410_196_624_968_5, 0.138_196_601_125_010_5);
            [[b, b, b], [a, b, b], [b, a, b], [b, b, a]].map(|p| tetrahedron(p, 1.0 / 24.0)).into()
        }
        Shape::Wedge => each(&product(&third, &pair), wedge),
        Shape::Hexahedron => each(&product(&square, &pair), hexahedron),
        Shape::Pyramid => {
            let s = 0.6f64.sqrt();
            let heights = [(-s, 5.0 / 9.0), (0.0, 8.0 / 9.0), (s, 5.0 / 9.0)];
            heights
                .iter()
                .flat_map(|&(z, w)| square.iter().map(move |p| pyramid([p[0], p[1], z], w)))
                .collect()
        }
        Shape::Polygon | Shape::Polyhedron => return None,
    })
}

fn triangle([a, b]: [f64; 2], weight: f64) -> Sample {
    Sample {
        weight,
        values: vec![1.0 - a - b, a, b],
        slopes: vec![[-1.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    }
}

fn quadrilateral([x, y]: [f64; 2]) -> Sample {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    Sample {
        weight: 1.0,
        values: corners.map(|[a, b]| 0.25 * (1.0 + a * x) * (1.0 + b * y)).into(),
        slopes: corners.map(|[a, b]| [0.25 * a * (1.0 + b * y), 0.25 * b * (1.0 + a * x), 0.0]).into(),
    }
}

fn tetrahedron([a, b, c]: [f64; 3], weight: f64) -> Sample {
    Sample {
        weight,
        values: vec![1.0 - a - b - c, a, b, c],
        slopes: vec![[-1.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    }
}

/// Layers of a flat element, at -1 and 1.
fn layered(flat: &Sample, z: f64, weight: f64) -> Sample {
    let mut sample = Sample { weight, values: Vec::new(), slopes: Vec::new() };
    for side in [-1.0, 1.0] {
        let h = 0.5 * (1.0 + side * z);
        sample.values.extend(flat.values.iter().map(|v| v * h));
        let slope = |(v, s): (&f64, &[f64; 3])| [s[0] * h, s[1] * h, 0.5 * side * v];
        sample.slopes.extend(flat.values.iter().zip(&flat.slopes).map(slope));
    }
    sample
}

fn wedge([a, b, z]: [f64; 3]) -> Sample {
    layered(&triangle([a, b], 1.0), z, 1.0 / 6.0)
}

fn hexahedron([x, y, z]: [f64; 3]) -> Sample {
    layered(&quadrilateral([x, y]), z, 1.0)
}

/// The hexahedron with its upper four points in one: on parallelogram bases and in straight sides linear functions
/// are exact.
fn pyramid([x, y, z]: [f64; 3], weight: f64) -> Sample {
    let cube = hexahedron([x, y, z]);
    let apex = |v: &[f64]| v[4..].iter().sum::<f64>();
    let mut values = cube.values[..4].to_vec();
    values.push(apex(&cube.values));
    let mut slopes = cube.slopes[..4].to_vec();
    slopes.push([0, 1, 2].map(|d| cube.slopes[4..].iter().map(|s| s[d]).sum()));
    Sample { weight, values, slopes }
}
