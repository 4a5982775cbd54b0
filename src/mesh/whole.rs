//! The undecomposed mesh of a solver that runs on several ranks.

use crate::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use m4gn_base::{Error, Result};
use m4gn_parallel::{Comm, Element};

/// The lists of all ranks, one after the other, on the first one. Collective.
fn collect<T: Element>(comm: &Comm, local: &[T]) -> Option<Vec<T>> {
    comm.gather(local).map(|lists| lists.concat())
}

/// The undecomposed mesh, on the first rank; none elsewhere. Collective.
///
/// Cells and boundary faces are in the order of their global numbers, faces in that of their cells, whatever the number of
/// ranks. Faces between ranks become internal faces again; they are told from cyclic faces by their geometry: the
/// vector between the cells through a processor face is the difference of their centres.
///
/// # Errors
/// [`Error::Mesh`] when the global numbers of cells or boundary faces are no permutation.
pub fn whole_mesh(comm: &Comm, mesh: &Mesh) -> Option<Result<Mesh>> {
    let global = |cell: i32| mesh.cell_global.get(cell as usize).copied().unwrap_or(-1);
    let centres = collect(comm, mesh.cell_centres.as_flattened());
    let volumes = collect(comm, &mesh.cell_volumes);
    let cells = collect(comm, &mesh.cell_global);
    let pairs = mesh.face_owner.iter().zip(&mesh.face_neighbour);
    let pairs: Vec<i64> = pairs.flat_map(|(&o, &n)| [global(o), global(n)]).collect();
    let pairs = collect(comm, &pairs);
    let coeff = collect(comm, &mesh.face_coeff);
    let b = &mesh.boundary;
    let labels: Vec<i64> =
        b.iter().flat_map(|f| [f.global, global(f.owner), f.kind as i64, i64::from(f.patch)]).collect();
    let labels = collect(comm, &labels);
    let reals: Vec<f64> =
        b.iter().flat_map(|f| f.centre.into_iter().chain(f.area).chain([f.coeff])).collect();
    let reals = collect(comm, &reals);
    let coupled: Vec<i64> = mesh.coupled.iter().flat_map(|f| [global(f.owner), f.global]).collect();
    let coupled = collect(comm, &coupled);
    let deltas: Vec<f64> = mesh.coupled.iter().flat_map(|f| f.delta.into_iter().chain([f.coeff])).collect();
    let deltas = collect(comm, &deltas);
    // Cell by cell, all modes of each.
    let modes: Vec<f64> = (0..mesh.n_cells())
        .flat_map(|c| mesh.elastic.iter().flat_map(move |e| e.vectors.iter().flat_map(move |v| v[c])))
        .collect();
    let modes = collect(comm, &modes);

    let cells = cells?;
    let n = cells.len();
    let mut whole = Mesh {
        directions: mesh.directions.clone(),
        cell_global: (0..n as i64).collect(),
        patches: mesh.patches.clone(),
        ..Mesh::default()
    };
    let order = match permutation(&cells, "cell") {
        Ok(order) => order,
        Err(e) => return Some(Err(e)),
    };
    let (centres, volumes) = (centres?, volumes?);
    let centres = centres.as_chunks::<3>().0;
    if centres.len() != n || volumes.len() != n {
        return Some(Err(Error::Mesh(format!(
            "{n} cells with {} centres and {} volumes",
            centres.len(),
            volumes.len()
        ))));
    }
    whole.cell_centres = order.iter().map(|&i| centres[i]).collect();
    whole.cell_volumes = order.iter().map(|&i| volumes[i]).collect();

    if let Some(elastic) = &mesh.elastic {
        let (m, modes) = (elastic.eigenvalues.len(), modes?);
        let modes = modes.as_chunks::<3>().0;
        whole.elastic = Some(ElasticModes {
            eigenvalues: elastic.eigenvalues.clone(),
            vectors: (0..m).map(|k| order.iter().map(|&i| modes[i * m + k]).collect()).collect(),
        });
    }

    let mut faces: Vec<(i64, i64, f64)> =
        pairs?.chunks_exact(2).zip(coeff?).map(|(p, c)| (p[0].min(p[1]), p[0].max(p[1]), c)).collect();
    for (&[owner, neighbour], d) in coupled?.as_chunks::<2>().0.iter().zip(deltas?.as_chunks::<4>().0) {
        let outside = [owner, neighbour].iter().any(|&g| usize::try_from(g).map_or(true, |g| g >= n));
        if outside {
            return Some(Err(Error::Mesh(format!(
                "a coupled face joins cells {owner} and {neighbour} of {n}"
            ))));
        }
        let (from, to) = (whole.cell_centres[owner as usize], whole.cell_centres[neighbour as usize]);
        let length = d[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
        let straight = (0..3).all(|k| (to[k] - from[k] - d[k]).abs() <= 1e-5 * length);
        if !straight {
            let (owner, delta) = (owner as i32, [d[0], d[1], d[2]]);
            whole.coupled.push(CoupledFace { owner, rank: 0, global: neighbour, delta, coeff: d[3] });
        } else if owner < neighbour {
            // The other side's entry is the same face.
            faces.push((owner, neighbour, d[3]));
        }
    }
    faces.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
    whole.coupled.sort_by(|a, b| {
        let deltas = a.delta.iter().zip(&b.delta).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne());
        (a.owner, a.global).cmp(&(b.owner, b.global)).then(deltas.unwrap_or(std::cmp::Ordering::Equal))
    });
    whole.face_owner = faces.iter().map(|f| f.0 as i32).collect();
    whole.face_neighbour = faces.iter().map(|f| f.1 as i32).collect();
    whole.face_coeff = faces.iter().map(|f| f.2).collect();

    let boundary = boundary(labels?.as_chunks().0, reals?.as_chunks().0);
    Some(boundary.map(|boundary| Mesh { boundary, ..whole }))
}

fn boundary(labels: &[[i64; 4]], reals: &[[f64; 7]]) -> Result<Vec<BoundaryFace>> {
    let numbers: Vec<i64> = labels.iter().map(|l| l[0]).collect();
    permutation(&numbers, "boundary face")?
        .into_iter()
        .map(|i| {
            let ([global, owner, kind, patch], r) = (labels[i], reals[i]);
            Ok(BoundaryFace {
                owner: owner as i32,
                global,
                centre: [r[0], r[1], r[2]],
                area: [r[3], r[4], r[5]],
                coeff: r[6],
                kind: NodeType::from_code(kind as i32)?,
                patch: patch as i32,
            })
        })
        .collect()
}

/// Where each global number is; an error unless the numbers are a permutation of 0..n.
fn permutation(numbers: &[i64], what: &str) -> Result<Vec<usize>> {
    let mut order = vec![usize::MAX; numbers.len()];
    for (i, &g) in numbers.iter().enumerate() {
        match usize::try_from(g).ok().and_then(|g| order.get_mut(g)) {
            Some(place) if *place == usize::MAX => *place = i,
            _ => {
                return Err(Error::Mesh(format!(
                    "global {what} number {g} of {} is out of range or there twice; expected a permutation over all ranks",
                    numbers.len()
                )));
            }
        }
    }
    Ok(order)
}
