//! The connected pieces of walls: which of them is the obstacle where no patch says so.

use super::place::line;
use m4gn_mesh::joined::Joined;
use m4gn_mesh::nearest::Nearest;
use m4gn_mesh::vector::{Vector, bounds, norm, sub};
use m4gn_mesh::{BoundaryFace, Mesh, NodeType};
use m4gn_parallel::{Comm, everywhere};
use std::collections::BTreeMap;

/// Faces of a patch hang together if they are not farther apart than this times the larger of their distances to the next face: twice the
/// length of a face where lengths halve from one to the next.
const REACH: f64 = 2.0;

/// Faces closer than this, over the diagonal of the box around the walls, are at one place.
const SAME: f64 = 1e-9;

/// Most pieces of walls that are named: a bed of particles has thousands.
const NAMED: usize = 100;

/// A connected piece of the walls of a patch, of all ranks.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// Index of the patch.
    pub patch: i32,
    /// Number among the pieces of its patch, in the order of their places, from 1.
    pub number: usize,
    /// Global numbers of its faces.
    pub faces: Vec<i64>,
    /// Mean of its faces' centres, m.
    pub centre: Vector,
    /// Whether a face of it is on the box around the mesh.
    pub at_box: bool,
}

/// The first of what is said of pieces, and how many there are besides.
pub(super) fn first_of(all: impl ExactSizeIterator<Item = String>) -> String {
    let rest = all.len().saturating_sub(NAMED);
    let more = (rest > 0).then(|| format!("and {rest} more"));
    all.take(NAMED).chain(more).collect::<Vec<_>>().join(", ")
}

/// A wall's face on any rank.
struct Wall {
    owner: i64,
    global: i64,
    patch: i32,
    at_owner: bool,
    centre: Vector,
}

/// The pieces of all walls, by patch and then by place, the same on all ranks. `at_box` says whether a face is on the box around the mesh.
/// Collective.
///
/// At points, where a wall's node is where its owner is, pieces are those of the mesh's edges. At cells faces hang together whose owners are
/// one or neighbours, or that are near each other.
pub(super) fn wall_pieces(mesh: &Mesh, at_box: impl Fn(&Vector) -> bool, comm: &Comm) -> Vec<Piece> {
    let walls = walls(mesh, comm);
    let mut joined = Joined::new(walls.len());
    let mut of_owner: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    walls.iter().enumerate().for_each(|(i, wall)| of_owner.entry(wall.owner).or_default().push(i));
    let mut join_owners = |a: i64, b: i64| {
        let (Some(a), Some(b)) = (of_owner.get(&a), of_owner.get(&b)) else { return };
        for (&i, &j) in a.iter().flat_map(|i| b.iter().map(move |j| (i, j))) {
            if walls[i].patch == walls[j].patch {
                joined.join(i, j);
            }
        }
    };
    let own = of_neighbours(mesh, &of_owner);
    everywhere(comm, &own).as_chunks::<2>().0.iter().for_each(|&[a, b]| join_owners(a, b));
    of_owner.keys().for_each(|&owner| join_owners(owner, owner));
    let mut of_patch: BTreeMap<i32, Vec<usize>> = BTreeMap::new();
    let at_cells = walls.iter().enumerate().filter(|(_, wall)| !wall.at_owner);
    at_cells.for_each(|(i, wall)| of_patch.entry(wall.patch).or_default().push(i));
    of_patch.values().for_each(|faces| join_near(&walls, faces, &mut joined));

    let places: Vec<Vector> = walls.iter().map(|wall| wall.centre).collect();
    let number = line(&places, &walls.iter().map(|wall| wall.global).collect::<Vec<_>>());
    let mut found: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    (0..walls.len()).for_each(|i| found.entry(joined.root(i)).or_default().push(i));
    let mut pieces: Vec<Vec<usize>> = found.into_values().collect();
    pieces.sort_by_key(|faces| (walls[faces[0]].patch, faces.iter().map(|&i| number[i]).min()));
    let mut counts: BTreeMap<i32, usize> = BTreeMap::new();
    let piece = |faces: Vec<usize>| {
        let patch = walls[faces[0]].patch;
        let number = counts.entry(patch).or_default();
        *number += 1;
        let sum = |d: usize| faces.iter().map(|&i| walls[i].centre[d]).sum::<f64>();
        Piece {
            patch,
            number: *number,
            centre: std::array::from_fn(|d| sum(d) / faces.len() as f64),
            at_box: faces.iter().any(|&i| at_box(&walls[i].centre)),
            faces: faces.into_iter().map(|i| walls[i].global).collect(),
        }
    };
    pieces.into_iter().map(piece).collect()
}

/// The walls of all ranks, in the order of their global numbers. Collective.
fn walls(mesh: &Mesh, comm: &Comm) -> Vec<Wall> {
    let is_wall = |b: &&BoundaryFace| b.kind == NodeType::Wall;
    let own = || mesh.boundary.iter().filter(is_wall);
    let at_owner = |b: &BoundaryFace| mesh.cell_centres[b.owner as usize] == b.centre;
    let row = |b: &BoundaryFace| {
        [mesh.cell_global[b.owner as usize], b.global, i64::from(b.patch), i64::from(at_owner(b))]
    };
    let numbers = everywhere(comm, &own().flat_map(row).collect::<Vec<_>>());
    let solved =
        |b: &BoundaryFace| [0, 1, 2].map(|d| if mesh.directions.contains(&d) { b.centre[d] } else { 0.0 });
    let centres = everywhere(comm, &own().flat_map(solved).collect::<Vec<_>>());
    let rows = numbers.as_chunks::<4>().0.iter().zip(centres.as_chunks::<3>().0);
    let wall = |(&[owner, global, patch, at_owner], &centre): (&[i64; 4], &Vector)| Wall {
        owner,
        global,
        patch: patch as i32,
        at_owner: at_owner == 1,
        centre,
    };
    let mut walls: Vec<Wall> = rows.map(wall).collect();
    walls.sort_by_key(|wall| wall.global);
    walls
}

/// Pairs of this rank's neighbouring cells that both own walls, by global numbers.
fn of_neighbours(mesh: &Mesh, owners: &BTreeMap<i64, Vec<usize>>) -> Vec<i64> {
    let global = |cell: i32| mesh.cell_global[cell as usize];
    let inner = mesh.face_owner.iter().zip(&mesh.face_neighbour).map(|(&a, &b)| [global(a), global(b)]);
    let coupled = mesh.coupled.iter().map(|face| [global(face.owner), face.global]);
    inner.chain(coupled).filter(|pair| pair.iter().all(|cell| owners.contains_key(cell))).flatten().collect()
}

/// Joins the faces of a patch that are near each other.
fn join_near(walls: &[Wall], faces: &[usize], joined: &mut Joined) {
    let places: Vec<Vector> = faces.iter().map(|&i| walls[i].centre).collect();
    let [low, high] = bounds(places.iter().copied());
    let same = SAME * norm(sub(high, low));
    let tree = Nearest::new(&places);
    for (&i, &place) in faces.iter().zip(&places) {
        // The next face elsewhere
        let mut next = f64::INFINITY;
        tree.search(place, next, |_, square| {
            next = if square.sqrt() > same { square } else { next };
            next
        });
        let reach = if next.is_finite() { same.max(REACH * next.sqrt()) } else { same };
        let limit = reach * reach * (1.0 + SAME) + f64::MIN_POSITIVE;
        tree.search(place, limit, |j, square| {
            if square.sqrt() <= reach {
                joined.join(i, faces[j]);
            }
            limit
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_pieces_the_first_are_named() {
        let said = |n: usize| first_of((0..n).map(|i| i.to_string()));
        assert_eq!(said(3), "0, 1, 2");
        assert!(said(NAMED).ends_with("98, 99"));
        assert!(said(NAMED + 2).ends_with("98, 99, and 2 more"));
    }

    /// Against looking at all pairs: three clusters, graded towards a corner, and faces at one place.
    #[test]
    fn faces_are_joined_as_by_looking_at_all_pairs() {
        let part = |k: usize, share: f64| (k as f64 * share).fract();
        let wall = |k: usize| {
            let far = 2.0 * (k % 3) as f64;
            let centre = match k {
                0..120 => [far + part(k, 0.618).powi(3), part(k, 0.414).powi(2), part(k, 0.732)],
                120..123 => [9.0, 0.0, 0.0],
                _ => [0.0, 9.0, 9.0],
            };
            Wall { owner: k as i64, global: k as i64, patch: 0, at_owner: false, centre }
        };
        for count in [1, 3, 120, 124] {
            let walls: Vec<Wall> = (124 - count..124).map(wall).collect();
            let from = |a: &Wall| walls.iter().map(|b| norm(sub(a.centre, b.centre))).collect();
            let apart: Vec<Vec<f64>> = walls.iter().map(from).collect();
            let same = 1e-7;
            let elsewhere =
                |row: &Vec<f64>| row.iter().copied().filter(|d| *d > same).fold(f64::INFINITY, f64::min);
            let next: Vec<f64> = apart.iter().map(elsewhere).collect();
            let [mut plain, mut found] = [(); 2].map(|()| Joined::new(count));
            for i in 0..count {
                for j in 0..i {
                    let reach = REACH * next[i].max(next[j]);
                    if apart[i][j] <= same || reach.is_finite() && apart[i][j] <= reach {
                        plain.join(i, j);
                    }
                }
            }
            join_near(&walls, &(0..count).collect::<Vec<_>>(), &mut found);
            let [plain, found] =
                [&mut plain, &mut found].map(|j| (0..count).map(|i| j.root(i)).collect::<Vec<_>>());
            assert_eq!(plain, found);
        }
    }
}
