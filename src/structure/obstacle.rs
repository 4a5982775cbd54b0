//! Distance to the obstacle: the feature of SLIC-MDOD_l and SLIC-MDOD_e (eq. 14).

use super::wall_pieces::{Piece, first_of, wall_pieces};
use m4gn_base::{Error, Result};
use m4gn_mesh::Extent;
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::vector::Vector;
use m4gn_mesh::{BoundaryFace, Mesh, NodeType};
use m4gn_model::{SegmentMethod, SegmentSpec};
use m4gn_parallel::{Comm, everywhere};
use std::collections::{BTreeSet, HashSet};

/// Distances count as at least this fraction of S: the logarithm of zero is not a feature.
const LEAST: f64 = 1e-6;

/// Shortest distance from each of this rank's cell centres to a face centre of the obstacle, in the solved
/// directions, m. Collective; exact, so the same on any number of ranks.
///
/// The obstacle is what [`SegmentSpec::obstacles`] says. Cyclics are not looked through.
///
/// # Errors
/// [`Error::Input`] if no face is of the obstacle.
pub fn obstacle_distance(mesh: &Mesh, obstacles: &[String], comm: &Comm) -> Result<Vec<f64>> {
    let solved = |x: &[f64; 3]| [0, 1, 2].map(|d| if mesh.directions.contains(&d) { x[d] } else { 0.0 });
    let (faces, _) = obstacle_faces(mesh, obstacles, comm)?;
    let own: Vec<f64> = faces.iter().flat_map(|b| solved(&b.centre)).collect();
    let all = everywhere(comm, &own);
    let tree = Nearest::new(all.as_chunks::<3>().0);
    Ok(mesh.cell_centres.iter().map(|x| tree.distance_squared(solved(x)).sqrt()).collect())
}

/// The feature f^obs of each of this rank's cells, m: S log(d/l) or S exp(-d/l), with l the spec's
/// `distance_scale` or S, so that a change by a factor e of the distance, or by one length l at the obstacle, counts
/// about as one cluster size. With `distance_scale` 0 log d and exp(-d), d in metres. Empty for the other methods.
/// Collective.
pub(super) fn feature(mesh: &Mesh, spec: &SegmentSpec, size: f64, comm: &Comm) -> Result<Vec<f64>> {
    if !spec.method.uses_obstacle() {
        return Ok(Vec::new());
    }
    let (factor, length) = match spec.distance_scale {
        None => (size, size),
        Some(0.0) => (1.0, 1.0),
        Some(length) => (size, length),
    };
    let of = |d: f64| {
        let d = d.max(LEAST * size) / length;
        factor
            * match spec.method {
                SegmentMethod::SlicLog => d.ln(),
                _ => (-d).exp(),
            }
    };
    let distances = obstacle_distance(mesh, &spec.obstacles, comm)?;
    Ok(distances.into_iter().map(of).collect())
}

/// What was taken for the obstacle, for people: its patches, or the pieces of walls. Collective; all ranks fail together.
///
/// # Errors
/// As [`obstacle_distance`].
pub fn obstacle_note(mesh: &Mesh, obstacles: &[String], comm: &Comm) -> Result<String> {
    Ok(obstacle_faces(mesh, obstacles, comm)?.1)
}

/// This rank's faces of the obstacle, and what it is. Collective.
fn obstacle_faces<'a>(
    mesh: &'a Mesh,
    obstacles: &[String],
    comm: &Comm,
) -> Result<(Vec<&'a BoundaryFace>, String)> {
    let patch = |b: &BoundaryFace| mesh.patches[b.patch as usize].as_str();
    let found = |faces: Vec<&'a BoundaryFace>| comm.any(!faces.is_empty()).then_some(faces);
    let all = |wanted: &dyn Fn(&BoundaryFace) -> bool| mesh.boundary.iter().filter(|b| wanted(b)).collect();
    let none = || {
        Error::Input(format!(
            "the mesh has no obstacle to take distances from: expected boundary faces of node type obstacle or wall, \
             found {}; name the obstacle's patches, or choose the method slic-md or metis",
            listed(&words(comm, mesh.boundary.iter().map(|b| b.kind.name())))
        ))
    };
    if obstacles.is_empty()
        && let Some(faces) = found(all(&|b| b.kind == NodeType::Obstacle))
    {
        let patches = listed(&words(comm, faces.iter().map(|b| patch(b))));
        return Ok((faces, format!("the faces of node type obstacle, of {patches}")));
    }
    let patches = words(comm, mesh.boundary.iter().map(patch));
    let others: Vec<&String> = obstacles.iter().filter(|name| !patches.contains(*name)).collect();
    let extent = Extent::of(mesh, comm);
    let at_box = |centre: &Vector| {
        mesh.directions.iter().any(|&d| {
            let (low, high) = (extent.low[d], extent.high[d]);
            (centre[d] - low).min(high - centre[d]) <= 1e-9 * (high - low)
        })
    };
    // Patches need no search for pieces.
    let pieces = match others.is_empty() && !obstacles.is_empty() {
        true => Vec::new(),
        false => wall_pieces(mesh, at_box, comm),
    };
    let name = |piece: &Piece| format!("{}:{}", mesh.patches[piece.patch as usize], piece.number);
    let said = |pieces: &[&Piece]| {
        let of = |piece: &&Piece| {
            let at: Vec<String> =
                mesh.directions.iter().map(|&d| format!("{:.4}", piece.centre[d])).collect();
            format!("{} ({} faces around {} m)", name(piece), piece.faces.len(), at.join(" "))
        };
        first_of(pieces.iter().map(of))
    };
    let faces_of = |pieces: &[&Piece]| -> HashSet<i64> {
        pieces.iter().flat_map(|piece| piece.faces.iter().copied()).collect()
    };
    if !obstacles.is_empty() {
        let asked: Vec<&Piece> = pieces.iter().filter(|piece| others.contains(&&name(piece))).collect();
        let missing: Vec<&String> = others
            .iter()
            .copied()
            .filter(|wanted| asked.iter().all(|piece| name(piece) != **wanted))
            .collect();
        if missing.len() == obstacles.len() {
            return Err(Error::Input(format!(
                "no face belongs to the obstacle {}: expected some of the patches {}, or of the pieces of walls {}",
                obstacles.join(", "),
                listed(&patches),
                if pieces.is_empty() { "none".into() } else { said(&pieces.iter().collect::<Vec<_>>()) }
            )));
        }
        let there: Vec<&str> =
            obstacles.iter().filter(|o| !missing.contains(o)).map(String::as_str).collect();
        let mut note = format!("what the setting obstacles names, {}", there.join(", "));
        missing.iter().for_each(|name| note += &format!("; no face is of {name}"));
        let named = faces_of(&asked);
        let faces = all(&|b| there.contains(&patch(b)) || named.contains(&b.global));
        return Ok((faces, note));
    }
    let inner: Vec<&Piece> = pieces.iter().filter(|piece| !piece.at_box).collect();
    if !inner.is_empty() {
        let of_inner = faces_of(&inner);
        return Ok((
            all(&|b| of_inner.contains(&b.global)),
            format!("the pieces of walls that do not reach the box around the mesh, {}", said(&inner)),
        ));
    }
    let faces = found(all(&|b| b.kind == NodeType::Wall)).ok_or_else(none)?;
    Ok((
        faces,
        "all walls, since each piece of them reaches the box around the mesh; the setting obstacles names others".into(),
    ))
}

/// The different words of all ranks. Collective.
fn words<'a>(comm: &Comm, own: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    let own: BTreeSet<&str> = own.collect();
    let bytes: Vec<u8> = own.iter().flat_map(|w| w.bytes().chain([0])).collect();
    let all = String::from_utf8_lossy(&everywhere(comm, &bytes)).into_owned();
    all.split_terminator('\0').map(str::to_owned).collect()
}

fn listed(words: &BTreeSet<String>) -> String {
    if words.is_empty() { "none".into() } else { m4gn_base::listed(words) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::mesh as sample;

    fn distances(mesh: &Mesh, obstacles: &[&str]) -> Result<Vec<f64>> {
        let names: Vec<String> = obstacles.iter().map(|n| n.to_string()).collect();
        obstacle_distance(mesh, &names, &Comm::serial())
    }

    /// Four unit cells in a row with inlet, outlet and walls all around.
    fn row() -> Mesh {
        sample::rectangle(4, 1, 4.0, 1.0)
    }

    #[test]
    fn named_patches_then_obstacles_then_walls() {
        let mut mesh = row();
        // Inlet at (0, 0.5), cells at (0.5, 0.5) and on.
        assert_eq!(distances(&mesh, &["inlet"]).unwrap(), [0.5, 1.5, 2.5, 3.5]);
        assert_eq!(distances(&mesh, &[]).unwrap(), [0.5; 4]);
        let message = distances(&mesh, &["cylinder"]).unwrap_err().to_string();
        assert!(message.contains("cylinder: expected some of the patches inlet, outlet, walls"), "{message}");
        // A name that nothing has counts for nothing, and that is said.
        let some = ["inlet", "inlett"].map(String::from);
        let said = obstacle_note(&mesh, &some, &Comm::serial()).unwrap();
        assert!(said.ends_with("obstacles names, inlet; no face is of inlett"), "{said}");
        assert_eq!(distances(&mesh, &["inlet", "inlett"]).unwrap(), [0.5, 1.5, 2.5, 3.5]);
        let outlet = mesh.boundary.iter_mut().find(|b| b.patch == 1);
        outlet.unwrap().kind = NodeType::Obstacle;
        assert_eq!(distances(&mesh, &[]).unwrap(), [3.5, 2.5, 1.5, 0.5]);
    }

    #[test]
    fn walls_inside_the_box_are_the_obstacle() {
        // 3 x 3 grid whose middle cell is cut out: faces of the hole are a patch of their own.
        let mut mesh = sample::rectangle(3, 3, 3.0, 3.0);
        mesh.patches.push("hole".into());
        let face = mesh.boundary[0].clone();
        for centre in [[1.0, 1.5, 0.0], [2.0, 1.5, 0.0], [1.5, 1.0, 0.0], [1.5, 2.0, 0.0]] {
            mesh.boundary.push(BoundaryFace {
                centre,
                kind: NodeType::Wall,
                patch: 3,
                global: mesh.boundary.len() as i64,
                ..face.clone()
            });
        }
        let found = distances(&mesh, &[]).unwrap();
        let corner = 0.5f64.hypot(1.0);
        assert_eq!(found[..3], [corner, 0.5, corner]);
    }

    /// Walls around a channel of 9 x 9 cells and around the 3 x 3 cells in its middle, all of one patch.
    fn channel() -> Mesh {
        let mut mesh = sample::rectangle(9, 9, 9.0, 9.0);
        let face = mesh.boundary.iter().find(|b| b.kind == NodeType::Wall).unwrap().clone();
        for (i, j, x, y) in (3..6).flat_map(|k| {
            let at = k as f64 + 0.5;
            [(2, k, 3.0, at), (6, k, 6.0, at), (k, 2, at, 3.0), (k, 6, at, 6.0)]
        }) {
            let (owner, global) = (i + 9 * j, mesh.boundary.len() as i64);
            mesh.boundary.push(BoundaryFace { owner, global, centre: [x, y, 0.0], ..face.clone() });
        }
        mesh
    }

    #[test]
    fn walls_of_one_patch_are_told_apart_by_pieces() {
        let mesh = channel();
        let note = |mesh: &Mesh, names: &[String]| obstacle_note(mesh, names, &Comm::serial()).unwrap();
        let said = note(&mesh, &[]);
        assert!(said.contains("walls:2 (12 faces around 4.5000 4.5000 m)"), "{said}");
        let found = distances(&mesh, &[]).unwrap();
        assert_eq!((found[2 + 9 * 4], found[4 + 9 * 7]), (0.5, 1.5));
        // Beside the outer walls it is the inner ones that count.
        assert_eq!(found[4], 2.5);
        assert_eq!(distances(&mesh, &["walls:1"]).unwrap()[4 + 9 * 4], 4.5);
        let message = distances(&mesh, &["walls:4"]).unwrap_err().to_string();
        assert!(
            message.contains("walls:4: expected some of the patches inlet, outlet, walls, or of the pieces"),
            "{message}"
        );
        assert!(message.contains("walls:3 (9 faces around 4.5000 9.0000 m)"), "{message}");
        // Other numbers change nothing.
        let (other, [cells, _]) = sample::renumbered(&mesh, 5);
        assert_eq!(note(&other, &[]), said);
        let renumbered = distances(&other, &[]).unwrap();
        assert!(renumbered.iter().zip(cells).all(|(d, c)| *d == found[c]));
        // A channel without anything in it.
        assert!(note(&row(), &[]).contains("all walls"));
    }

    /// Faces near each other hang together where their owners do not touch, and lengths that halve from one to the next change nothing.
    #[test]
    fn faces_near_each_other_are_one_piece() {
        let mut mesh = channel();
        (mesh.face_owner, mesh.face_neighbour, mesh.face_coeff) = (vec![], vec![], vec![]);
        let said = obstacle_note(&mesh, &[], &Comm::serial()).unwrap();
        assert!(said.contains("walls:2 (12 faces around"), "{said}");
        let mut graded = row();
        graded.boundary.truncate(1);
        let face = BoundaryFace { kind: NodeType::Wall, patch: 2, ..graded.boundary[0].clone() };
        graded.boundary.clear();
        let mut x = 0.0;
        for (i, length) in [1.0, 0.5, 0.25, 0.125, 0.25, 0.5, 1.0].into_iter().enumerate() {
            let centre = [1.0 + x + 0.5 * length, 0.5, 0.0];
            x += length;
            graded.boundary.push(BoundaryFace {
                owner: (i % 4) as i32,
                global: i as i64,
                centre,
                ..face.clone()
            });
        }
        let said = distances(&graded, &["walls:2"]).unwrap_err().to_string();
        assert!(said.contains("pieces of walls walls:1 (7 faces"), "{said}");
    }

    /// DeepMind's CylinderFlow: boundary nodes at points, those of the cylinder of the same type as those of the channel's walls.
    #[test]
    fn the_cylinder_among_points_of_one_wall_type() {
        let (nx, ny) = (16, 8);
        let at = |i: i32, j: i32| [f64::from(i) * 0.1, f64::from(j) * 0.05, 0.0];
        let is_hole = |i: i32, j: i32| (5..7).contains(&i) && j == 4;
        let on_hole = |i: i32, j: i32| (4..8).contains(&i) && (3..6).contains(&j) && !is_hole(i, j);
        let all: Vec<(i32, i32)> = (0..=nx).flat_map(|i| (0..=ny).map(move |j| (i, j))).collect();
        let points: Vec<(i32, i32)> = all.into_iter().filter(|&(i, j)| !is_hole(i, j)).collect();
        let n = points.len();
        let mut mesh = Mesh {
            directions: vec![0, 1],
            cell_global: (0..n as i64).collect(),
            cell_centres: points.iter().map(|&(i, j)| at(i, j)).collect(),
            cell_volumes: vec![1.0; n],
            patches: ["inflow", "outflow", "wall"].map(String::from).into(),
            ..Mesh::default()
        };
        for (a, &(i, j)) in points.iter().enumerate() {
            for near in [(i + 1, j), (i, j + 1), (i + 1, j + 1)] {
                if let Some(b) = points.iter().position(|p| *p == near) {
                    mesh.face_owner.push(a as i32);
                    mesh.face_neighbour.push(b as i32);
                    mesh.face_coeff.push(1.0);
                }
            }
            let (kind, patch) = match (i, j) {
                (0, _) => (NodeType::Inlet, 0),
                (i, _) if i == nx => (NodeType::Outlet, 1),
                (i, j) if j == 0 || j == ny || on_hole(i, j) => (NodeType::Wall, 2),
                _ => continue,
            };
            let global = mesh.boundary.len() as i64;
            let (owner, centre) = (a as i32, at(i, j));
            mesh.boundary.push(BoundaryFace {
                owner,
                global,
                centre,
                area: [0.1, 0.0, 0.0],
                coeff: 1.0,
                kind,
                patch,
            });
        }
        let said = obstacle_note(&mesh, &[], &Comm::serial()).unwrap();
        assert!(said.contains("wall:2 (10 faces around 0.5500 0.2000 m)"), "{said}");
        let cylinder: Vec<[f64; 3]> =
            points.iter().filter(|&&(i, j)| on_hole(i, j)).map(|&(i, j)| at(i, j)).collect();
        let to_cylinder = |x: &[f64; 3]| {
            let d = cylinder.iter().map(|c| (x[0] - c[0]).hypot(x[1] - c[1]));
            d.fold(f64::INFINITY, f64::min)
        };
        for (method, of) in
            [(SegmentMethod::SlicLog, f64::ln as fn(f64) -> f64), (SegmentMethod::SlicExp, |d| (-d).exp())]
        {
            let spec = SegmentSpec { method, distance_scale: Some(0.0), ..Default::default() };
            let found = feature(&mesh, &spec, 0.1, &Comm::serial()).unwrap();
            for (x, found) in mesh.cell_centres.iter().zip(found) {
                let expected = of(to_cylinder(x).max(1e-7));
                assert!((found - expected).abs() < 1e-12, "{method} at {x:?}: {found}, expected {expected}");
            }
        }
    }

    #[test]
    fn a_mesh_without_walls_is_refused_by_its_node_types() {
        let mesh = sample::chain(4, 4.0);
        m4gn_samples::fails(distances(&mesh, &[]), &["found inlet, outlet"]);
    }

    #[test]
    fn features_on_paper() {
        let mesh = row();
        let comm = Comm::serial();
        let of = |method, distance_scale| {
            let spec =
                SegmentSpec { method, distance_scale, obstacles: vec!["inlet".into()], ..Default::default() };
            feature(&mesh, &spec, 2.0, &comm).unwrap()
        };
        assert!(of(SegmentMethod::Slic, None).is_empty());
        assert_eq!(of(SegmentMethod::SlicLog, None)[1], 2.0 * 0.75f64.ln());
        assert_eq!(of(SegmentMethod::SlicExp, None)[1], 2.0 * (-0.75f64).exp());
        assert_eq!(of(SegmentMethod::SlicExp, Some(0.5))[1], 2.0 * (-3.0f64).exp());
        assert_eq!(of(SegmentMethod::SlicLog, Some(0.0))[1], 1.5f64.ln());
        assert_eq!(of(SegmentMethod::SlicExp, Some(0.0))[1], (-1.5f64).exp());
    }

    #[test]
    fn the_logarithm_at_the_obstacle_itself_is_finite() {
        let mut mesh = row();
        mesh.boundary[0].centre = mesh.cell_centres[0];
        let spec = SegmentSpec {
            method: SegmentMethod::SlicLog,
            obstacles: vec!["inlet".into()],
            ..Default::default()
        };
        let found = feature(&mesh, &spec, 2.0, &Comm::serial()).unwrap();
        assert!((found[0] - 2.0 * 1e-6f64.ln()).abs() < 1e-9, "{found:?}");
    }
}
