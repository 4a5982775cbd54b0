//! Meshes and settings as a careless host hands them in.

use crate::fuzzing::Random;
use crate::host::{Host, message};
use m4gn_mesh::elements::ElementKind;
use m4gn_mesh::{CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_samples::bodies as contact;
use m4gn_samples::mesh as sample;
use serde_json::Value;
use std::ffi::CString;
use std::ptr::null;

/// A small mesh with something wrong, or nothing.
fn mesh(r: &mut Random) -> Mesh {
    let mut m = match r.below(4) {
        0 => sample::rectangle(4, 3, 1.0, 1.0),
        1 => sample::block([3, 2, 2], [1.0, 1.0, 1.0]),
        _ => sample::triangles(4, 3, 1.0, 0.7),
    };
    if r.below(8) == 0 {
        sample::make_cyclic(&mut m, 1.0);
    }
    for _ in 0..r.below(3) {
        let (i, x) = (r.integer(), r.real());
        let face = r.below(m.boundary.len());
        match r.below(14) {
            0 => *at(&mut m.cell_global, r) = i,
            1 => *at(&mut m.cell_volumes, r) = x,
            2 => at(&mut m.cell_centres, r)[r.below(3)] = x,
            3 => *at(&mut m.face_owner, r) = i as i32,
            4 => *at(&mut m.face_neighbour, r) = i as i32,
            5 => *at(&mut m.face_coeff, r) = x,
            6 => m.boundary[face].owner = i as i32,
            7 => m.boundary[face].global = i,
            8 => m.boundary[face].coeff = x,
            9 => m.boundary[face].area[r.below(3)] = x,
            10 => m.boundary[face].patch = i as i32,
            11 => m.boundary[face].kind = *r.pick(&[NodeType::Wall, NodeType::Obstacle, NodeType::Fluid]),
            12 => m.boundary[face].centre[r.below(3)] = x,
            _ => m.coupled.push(CoupledFace {
                owner: i as i32,
                rank: r.below(2) as i32,
                global: r.integer(),
                delta: [x, 0.0, 0.0],
                coeff: r.real(),
            }),
        }
    }
    // All of a mesh at an extreme scale.
    if r.below(6) == 0 {
        let scale = *r.pick(&[1e-200, 1e-30, 1e30, 1e200]);
        m.cell_centres.iter_mut().flatten().for_each(|v| *v *= scale);
        m.cell_volumes.iter_mut().for_each(|v| *v *= scale);
        m.face_coeff.iter_mut().for_each(|v| *v *= scale);
    }
    if r.below(8) == 0 {
        let n = m.n_cells();
        m.elastic = Some(ElasticModes {
            eigenvalues: vec![1.0, r.real()],
            vectors: vec![vec![[r.real(), 0.0, 1.0]; n]; 2],
        });
    }
    m
}

pub fn at<'a, T>(list: &'a mut [T], r: &mut Random) -> &'a mut T {
    let n = list.len();
    &mut list[r.below(n)]
}

/// A count that is no longer than its arrays, or negative.
pub fn shorter(n: &mut i32, r: &mut Random) {
    *n = match r.below(3) {
        0 => -1 - r.below(1 << 30) as i32,
        _ => r.below(*n as usize + 1) as i32,
    };
}

/// A mesh of cells, or now and then of a body at points.
pub fn host(r: &mut Random) -> Host {
    if r.below(12) == 0 {
        return body_host(r);
    }
    let mesh = mesh(r);
    let elastic = mesh.elastic.clone();
    let mut h = Host::new(mesh);
    if let Some(modes) = elastic {
        h.give_modes(&modes);
    }
    if r.below(3) == 0 {
        let d = &mut h.data;
        match r.below(12) {
            0 => shorter(&mut d.n_cells, r),
            1 => shorter(&mut d.n_faces, r),
            2 => shorter(&mut d.n_boundary, r),
            3 => shorter(&mut d.n_coupled, r),
            4 => shorter(&mut d.n_patches, r),
            5 => d.n_directions = r.integer() as i32,
            6 => d.directions[r.below(3)] = r.integer() as i32,
            7 => d.cell_centres = null(),
            8 => d.boundary_type = null(),
            9 => d.patch_names = null(),
            10 => d.face_coeff = d.face_coeff.wrapping_byte_add(4),
            _ => shorter(&mut d.n_modes, r),
        }
    }
    h
}

/// A body of a few elements under an obstacle, with something wrong, or nothing.
fn body_mesh(r: &mut Random) -> Mesh {
    let body = match r.below(3) {
        0 => sample::bar(3),
        _ => contact::block([3, 2, 1], [1.5, 1.0, 0.5]),
    };
    let obstacle = contact::octahedron([1.2, 0.5, 1.1], 0.5);
    let mut m = body.mesh((r.below(4) > 0).then_some(&obstacle));
    for _ in 0..r.below(3) {
        let (i, x) = (r.integer(), r.real());
        let kind = *r.pick(&[NodeType::Body, NodeType::Handle, NodeType::Obstacle]);
        match (r.below(10), m.body.as_mut(), m.obstacle.as_mut()) {
            (0, ..) => *at(&mut m.cell_global, r) = i,
            (1, ..) => at(&mut m.cell_centres, r)[r.below(3)] = x,
            (2, Some(share), _) => *at(&mut share.types, r) = kind,
            (3, Some(share), _) => share.types.fill(kind),
            // The points of an element follow from its kind: one with fewer leaves the array long enough.
            (4, Some(share), _) => *at(&mut share.kind, r) = *r.pick(&ElementKind::ALL[..3]),
            (5, Some(share), _) => *at(&mut share.points, r) = i,
            (6, Some(share), _) => {
                let m = at(&mut share.material, r);
                **at(&mut [&mut m.young, &mut m.poisson, &mut m.density], r) = x;
            }
            (7, _, Some(obstacle)) => at(&mut obstacle.positions, r)[r.below(3)] = x,
            (8, _, Some(obstacle)) => at(&mut obstacle.triangles, r)[r.below(3)] = i as i32,
            _ => (),
        }
    }
    // All of a body at an extreme scale.
    if r.below(6) == 0 {
        let scale = *r.pick(&[1e-200, 1e-30, 1e30, 1e200]);
        let obstacle = m.obstacle.iter_mut().flat_map(|o| &mut o.positions);
        let places = m.cell_centres.iter_mut().chain(obstacle);
        places.flatten().for_each(|v| *v *= scale);
    }
    m
}

pub fn body_host(r: &mut Random) -> Host {
    let mut h = Host::new(body_mesh(r));
    if r.below(6) == 0 {
        let d = &mut h.data;
        match r.below(12) {
            0 => shorter(&mut d.n_cells, r),
            1 => shorter(&mut d.n_elements, r),
            2 => shorter(&mut d.n_obstacle, r),
            3 => shorter(&mut d.n_obstacle_triangles, r),
            4 => d.n_faces = r.integer() as i32,
            5 => d.n_directions = r.integer() as i32,
            6 => d.cell_type = null(),
            7 => d.element_kind = null(),
            8 => d.element_points = null(),
            9 => d.element_material = null(),
            10 => d.obstacle_positions = null(),
            _ => d.obstacle_triangles = null(),
        }
    }
    h
}

/// Cells, or points of a body, that the arrays hold.
pub fn n_cells(h: &Host) -> usize {
    h.mesh.cell_global.len()
}

/// Bytes of a mesh, about.
pub fn size(h: &Host) -> usize {
    300 * (n_cells(h) + h.mesh.boundary.len())
}

/// The settings as text, now and then with bytes that were changed.
pub fn settings_as_text(settings: &Value, r: &mut Random) -> CString {
    let mut text = settings.to_string().into_bytes();
    match r.below(8) {
        0 => r.damage(&mut text),
        1 => r.damage_number(&mut text, 0),
        _ => (),
    }
    text.retain(|b| *b != 0);
    CString::new(text).unwrap()
}

/// Fails after a panic behind the ABI's door, which is a status there.
pub fn not_internal() {
    let message = message();
    assert!(!message.contains("internal error"), "{message}");
}

/// A pointer to one of these, or null.
pub fn word(r: &mut Random, of: &'static [&'static std::ffi::CStr]) -> *const std::ffi::c_char {
    match r.below(3) {
        0 => r.pick(of).as_ptr(),
        _ => null(),
    }
}
