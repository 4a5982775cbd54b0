//! Finite elements on several ranks against those on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3, 4.
//!
//! Every rank also computes the serial answer of the whole mesh, and compares by global numbers.

#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_model::modal::ModalOptions;
use m4gn_modes::fem::{Fixed, Material, Options, Plane, PointMesh, SolidModes, modes};
use m4gn_parallel::Comm;
use m4gn_samples::mesh::deals;
use m4gn_samples::points as sample;
use m4gn_samples::points::{Flat, Kind};
use ranks::Checks;
use std::process::ExitCode;

fn main() -> ExitCode {
    ranks::run("mpi_fem", |comm| {
        let mut checks = Checks::new(comm);
        for body in bodies() {
            decompositions(&mut checks, &body);
        }
        Ok(checks.failures)
    })
}

struct Body {
    name: String,
    mesh: PointMesh,
    materials: Vec<Material>,
    fixed: Vec<Fixed>,
    options: Options,
}

fn first(n: usize) -> Options {
    Options { modal: ModalOptions::fixed(n), ..Default::default() }
}

const SOFT: Material = Material { young: 1e6, poisson: 0.3, density: 1000.0 };

/// Stiffer and nearly incompressible.
const RUBBER: Material = Material { young: 3e6, poisson: 0.49, density: 1200.0 };

/// Points at x = 0 held in all directions, those at the other end along `other`.
fn held(mesh: &PointMesh, length: f64, other: [bool; 3]) -> Vec<Fixed> {
    let at = |p: usize| mesh.points[p][0];
    let points = 0..mesh.points.len();
    let clamped = points.clone().filter(|&p| at(p) < 1e-9).map(|p| Fixed::all(p as i32));
    let guided =
        points.filter(|&p| at(p) > length - 1e-9).map(|p| Fixed { point: p as i32, components: other });
    clamped.chain(guided).collect()
}

fn bodies() -> Vec<Body> {
    let mut list = Vec::new();
    for kind in Kind::ALL {
        let mut mesh = sample::block(kind, [7, 3, 3], [1.0, 0.4, 0.3]);
        sample::distort(&mut mesh, 0.01);
        let materials = (0..mesh.n_cells).map(|c| if c % 5 < 3 { SOFT } else { RUBBER }).collect();
        list.push(Body {
            name: format!("{kind:?}"),
            fixed: held(&mesh, 1.0, [false, true, false]),
            materials,
            mesh,
            options: first(6),
        });
    }
    for kind in Flat::ALL {
        let mut mesh = sample::rectangle(kind, 9, 5, 1.0, 0.5);
        sample::distort(&mut mesh, 0.01);
        list.push(Body {
            name: format!("{kind:?}"),
            fixed: held(&mesh, 1.0, [true, false, false]),
            materials: vec![RUBBER; mesh.n_cells],
            mesh,
            options: Options {
                plane: if kind == Flat::Triangles { Plane::Stress } else { Plane::Strain },
                ..first(6)
            },
        });
    }
    let mesh = sample::block(Kind::Hexahedra, [4, 4, 4], [1.0, 1.0, 1.0]);
    list.push(Body {
        name: "a free cube with repeated eigenvalues".into(),
        materials: vec![SOFT; mesh.n_cells],
        fixed: Vec::new(),
        mesh,
        options: Options { free_body: true, ..first(9) },
    });
    list
}

/// This rank's part of a body; a held point is named by the rank of one cell only, not by all that share it.
fn part(body: &Body, ranks: &[i32], rank: i32) -> (PointMesh, Vec<Material>, Vec<Fixed>) {
    let mesh = sample::part(&body.mesh, ranks, rank);
    let here = |(c, m): (usize, &Material)| (ranks[c] == rank).then_some(*m);
    let materials = body.materials.iter().enumerate().filter_map(here).collect();
    let mut teller = vec![i32::MAX; body.mesh.points.len()];
    for f in 0..body.mesh.n_faces() {
        for &p in body.mesh.face(f) {
            let to = &mut teller[p as usize];
            *to = (*to).min(ranks[body.mesh.face_owner[f] as usize]);
        }
    }
    let local = |f: &Fixed| {
        let at = mesh.point_global.iter().position(|&g| g == i64::from(f.point))?;
        (teller[f.point as usize] == rank).then_some(Fixed { point: at as i32, components: f.components })
    };
    let fixed = body.fixed.iter().filter_map(local).collect();
    (mesh, materials, fixed)
}

fn decompositions(checks: &mut Checks, body: &Body) {
    let comm = checks.comm.clone();
    let serial = modes(&body.mesh, &body.materials, &body.fixed, &body.options, &Comm::serial());
    let whole = match comm.agree(serial) {
        Ok(whole) => whole,
        Err(e) => return checks.that(false, format!("{}: {e}", body.name)),
    };
    for (deal, ranks) in deals(body.mesh.n_cells, comm.size()) {
        let name = format!("{}, {deal}", body.name);
        let (mesh, materials, fixed) = part(body, &ranks, comm.rank());
        match modes(&mesh, &materials, &fixed, &body.options, &comm) {
            Ok(found) => compare(checks, &name, &mesh, &found, &whole),
            Err(e) => checks.that(false, format!("{name}: {e}")),
        }
    }
}

/// Eigenvalues to 1e-8, modes to 1e-6.
fn compare(checks: &mut Checks, name: &str, mesh: &PointMesh, found: &SolidModes, whole: &SolidModes) {
    let n = whole.eigenvalues.len();
    checks.that(
        found.eigenvalues.len() == n,
        format!("{name}: {} modes, expected {n}", found.eigenvalues.len()),
    );
    let largest = whole.eigenvalues[n - 1];
    for (i, (f, e)) in found.eigenvalues.iter().zip(&whole.eigenvalues).enumerate() {
        // Rigid motions have 0 to rounding.
        let bound = 1e-8 * e.abs().max(1e-3 * largest);
        checks.that((f - e).abs() < bound, format!("{name}: eigenvalue {i}: {f}, expected {e}"));
    }
    for (i, (f, e)) in found.vectors.iter().zip(&whole.vectors).enumerate() {
        let off = mesh
            .point_global
            .iter()
            .zip(f)
            .flat_map(|(&g, u)| u.iter().zip(e[g as usize]).map(|(a, b)| (a - b).abs()))
            .fold(0.0, f64::max);
        checks.that(off < 1e-6, format!("{name}: mode {i} differs by {off:e}"));
    }
}
