//! The undecomposed mesh of a solver that runs on several ranks.

use crate::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_parallel::{Comm, Element};

/// The rows of all ranks, one after the other, on the first one. Collective.
fn collect<T: Element, const N: usize>(
    comm: &Comm,
    rows: impl Iterator<Item = [T; N]>,
) -> Option<Vec<[T; N]>> {
    let local: Vec<T> = rows.flatten().collect();
    comm.gather(&local).map(|lists| lists.concat().as_chunks::<N>().0.to_vec())
}

/// Where each of the numbers 0 to N - 1 is.
fn places(numbers: impl ExactSizeIterator<Item = i64>) -> Vec<usize> {
    let mut places = vec![0; numbers.len()];
    numbers.enumerate().for_each(|(i, number)| places[number as usize] = i);
    places
}

/// The undecomposed mesh, on the first rank; none elsewhere. Of parts that were checked ([`Mesh::check`]). Collective.
///
/// Cells and boundary faces are in the order of their global numbers, faces in that of their cells, whatever the number of
/// ranks. Faces between ranks become internal faces again; they are told from cyclic faces by their geometry: the
/// vector between the cells through a processor face is the difference of their centres.
pub fn whole_mesh(comm: &Comm, mesh: &Mesh) -> Option<Mesh> {
    let global = |cell: i32| mesh.cell_global[cell as usize];
    let cells = collect(comm, mesh.cell_global.iter().map(|&g| [g]));
    let centres = collect(comm, mesh.cell_centres.iter().copied());
    let volumes = collect(comm, mesh.cell_volumes.iter().map(|&v| [v]));
    let ends = mesh.face_owner.iter().zip(&mesh.face_neighbour);
    let ends = collect(comm, ends.map(|(&a, &b)| [global(a), global(b)]));
    let coeff = collect(comm, mesh.face_coeff.iter().map(|&c| [c]));
    let label = |b: &BoundaryFace| [b.global, global(b.owner), b.kind as i64, i64::from(b.patch)];
    let labels = collect(comm, mesh.boundary.iter().map(label));
    let real = |b: &BoundaryFace| {
        let ([x, y, z], [u, v, w]) = (b.centre, b.area);
        [x, y, z, u, v, w, b.coeff]
    };
    let reals = collect(comm, mesh.boundary.iter().map(real));
    let coupled = collect(comm, mesh.coupled.iter().map(|f| [global(f.owner), f.global]));
    let ways = collect(comm, mesh.coupled.iter().map(|f| [f.delta[0], f.delta[1], f.delta[2], f.coeff]));
    // Cell by cell, all modes of each.
    let modes = (0..mesh.n_cells())
        .flat_map(|c| mesh.elastic.iter().flat_map(move |e| e.vectors.iter().map(move |v| v[c])));
    let modes = collect(comm, modes);

    let (cells, centres, volumes) = (cells?, centres?, volumes?);
    let order = places(cells.iter().map(|c| c[0]));
    let centres: Vec<[f64; 3]> = order.iter().map(|&i| centres[i]).collect();
    let elastic = mesh.elastic.as_ref().zip(modes).map(|(elastic, modes)| {
        let m = elastic.eigenvalues.len();
        ElasticModes {
            eigenvalues: elastic.eigenvalues.clone(),
            vectors: (0..m).map(|k| order.iter().map(|&i| modes[i * m + k]).collect()).collect(),
        }
    });

    let mut faces: Vec<(i64, i64, f64)> =
        ends?.iter().zip(coeff?).map(|(&[a, b], [c])| (a.min(b), a.max(b), c)).collect();
    let mut cyclic = Vec::new();
    for (&[owner, neighbour], [x, y, z, coeff]) in coupled?.iter().zip(ways?) {
        let (from, to, delta) = (centres[owner as usize], centres[neighbour as usize], [x, y, z]);
        let length = delta.iter().map(|x| x * x).sum::<f64>().sqrt();
        let straight = (0..3).all(|k| (to[k] - from[k] - delta[k]).abs() <= 1e-5 * length);
        if !straight {
            cyclic.push(CoupledFace { owner: owner as i32, rank: 0, global: neighbour, delta, coeff });
        } else if owner < neighbour {
            // The other side's entry is the same face.
            faces.push((owner, neighbour, coeff));
        }
    }
    faces.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
    cyclic.sort_by(|a, b| {
        let deltas = a.delta.iter().zip(&b.delta).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne());
        (a.owner, a.global).cmp(&(b.owner, b.global)).then(deltas.unwrap_or(std::cmp::Ordering::Equal))
    });

    let (labels, reals) = (labels?, reals?);
    let face = |i: usize| {
        let ([global, owner, kind, patch], [x, y, z, u, v, w, coeff]) = (labels[i], reals[i]);
        let (kind, patch) = (NodeType::ALL[kind as usize], patch as i32);
        BoundaryFace { owner: owner as i32, global, centre: [x, y, z], area: [u, v, w], coeff, kind, patch }
    };
    Some(Mesh {
        directions: mesh.directions.clone(),
        cell_global: (0..order.len() as i64).collect(),
        cell_volumes: order.iter().map(|&i| volumes[i][0]).collect(),
        cell_centres: centres,
        face_owner: faces.iter().map(|f| f.0 as i32).collect(),
        face_neighbour: faces.iter().map(|f| f.1 as i32).collect(),
        face_coeff: faces.iter().map(|f| f.2).collect(),
        boundary: places(labels.iter().map(|l| l[0])).into_iter().map(face).collect(),
        coupled: cyclic,
        patches: mesh.patches.clone(),
        elastic,
        ..Mesh::default()
    })
}
