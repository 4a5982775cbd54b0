//! Recording from all ranks of a solver: gathered to the root in the undecomposed mesh's order, written there.

use super::{FieldMeta, Frame, WriteOptions, Writer};
use crate::mesh::{BoundaryFace, CoupledFace, ElasticModes, Mesh, NodeType};
use crate::parallel::Comm;
use crate::{Error, Result};
use std::path::Path;

/// One field of one rank at one time, as a solver has it.
#[derive(Clone, Copy, Debug)]
pub struct FieldValues<'a> {
    /// Name, as declared in [`WriteOptions::fields`].
    pub name: &'a str,
    /// 1, or 3 for a vector (x, y, z; directions that are not solved are left out of the file).
    pub components: usize,
    /// `[components * n_cells]` of this rank.
    pub cells: &'a [f64],
    /// `[components * n_boundary]` of this rank.
    pub boundary: &'a [f64],
}

/// A trajectory being recorded by all ranks of a communicator.
///
/// All methods but [`Recorder::n_frames`] are collective and give the same class of result on every rank.
/// Dropped before [`Recorder::finish`], it leaves nothing behind.
#[derive(Debug)]
pub struct Recorder {
    comm: Comm,
    fields: Vec<FieldMeta>,
    directions: Vec<usize>,
    n_cells: usize,
    n_boundary: usize,
    n_frames: usize,
    root: Option<Root>,
}

/// What the root has: the file, and where each rank's rows go.
#[derive(Debug)]
struct Root {
    writer: Writer,
    /// For each rank, the global numbers of its cells.
    cells: Vec<Vec<i64>>,
    /// For each rank, the global numbers of its boundary faces.
    boundary: Vec<Vec<i64>>,
    n_cells: usize,
    n_boundary: usize,
}

impl Recorder {
    /// Starts a file. Collective.
    ///
    /// # Errors
    /// [`Error::Mesh`] when the global numbers of cells or boundary faces are no permutation; what
    /// [`Writer::create`] says.
    pub fn create(comm: &Comm, mesh: &Mesh, path: &Path, options: &WriteOptions) -> Result<Self> {
        let cells = comm.gather(&mesh.cell_global);
        let numbers: Vec<i64> = mesh.boundary.iter().map(|f| f.global).collect();
        let boundary = comm.gather(&numbers);
        let whole = assemble(comm, mesh);
        let root = match (cells, boundary, whole) {
            (Some(cells), Some(boundary), Some(whole)) => whole
                .and_then(|whole| {
                    let writer = Writer::create(path, &whole, options)?;
                    let (n_cells, n_boundary) = (whole.n_cells(), whole.boundary.len());
                    Ok(Root {
                        writer,
                        cells,
                        boundary,
                        n_cells,
                        n_boundary,
                    })
                })
                .map(Some),
            _ => Ok(None),
        };
        Ok(Recorder {
            root: comm.agree(root)?,
            comm: comm.clone(),
            fields: options.fields.clone(),
            directions: mesh.directions.clone(),
            n_cells: mesh.n_cells(),
            n_boundary: mesh.boundary.len(),
            n_frames: 0,
        })
    }

    /// Appends a frame with all fields, by name. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] and [`Error::Numerical`] leave the recording as it was; after [`Error::File`] it is
    /// given up (see [`Writer::append`]).
    pub fn append(&mut self, time: f64, values: &[FieldValues]) -> Result<()> {
        let local = self.comm.agree(self.select(values))?;
        let gathered = self.comm.gather(&local);
        let result = match (&mut self.root, gathered) {
            (Some(root), Some(ranks)) => {
                let widths: Vec<usize> = self
                    .fields
                    .iter()
                    .map(|f| f.components(self.directions.len()))
                    .collect();
                root.frames(&ranks, &widths)
                    .and_then(|frames| root.writer.append(time, &frames))
            }
            _ => Ok(()),
        };
        self.comm.agree(result)?;
        self.n_frames += 1;
        Ok(())
    }

    /// Number of frames so far.
    pub fn n_frames(&self) -> usize {
        self.n_frames
    }

    /// Completes the file and gives it its final name. Collective; appending is an error afterwards.
    ///
    /// # Errors
    /// What [`Writer::finish`] says.
    pub fn finish(&mut self) -> Result<()> {
        let result = self.root.as_mut().map_or(Ok(()), |root| root.writer.finish());
        self.comm.agree(result)
    }

    /// This rank's values as they are stored: for each field its cells, then its boundary faces.
    fn select(&self, values: &[FieldValues]) -> Result<Vec<f32>> {
        let mut local = Vec::new();
        for field in &self.fields {
            let name = &field.name;
            let given = values
                .iter()
                .find(|v| v.name == name)
                .ok_or_else(|| Error::Input(format!("field {name} is missing from the frame")))?;
            let c = if field.vector { 3 } else { 1 };
            let (n, b) = (c * self.n_cells, c * self.n_boundary);
            if given.components != c || given.cells.len() != n || given.boundary.len() != b {
                return Err(Error::Input(format!(
                    "field {name}: {} components with {} cell and {} boundary values, expected {c}, {n} and {b}",
                    given.components,
                    given.cells.len(),
                    given.boundary.len()
                )));
            }
            for part in [given.cells, given.boundary] {
                if field.vector {
                    local.extend(
                        part.chunks_exact(3)
                            .flat_map(|v| self.directions.iter().map(|&d| v[d] as f32)),
                    );
                } else {
                    local.extend(part.iter().map(|&v| v as f32));
                }
            }
        }
        Ok(local)
    }
}

impl Root {
    /// Puts what the ranks sent into the undecomposed order.
    fn frames(&self, ranks: &[Vec<f32>], widths: &[usize]) -> Result<Vec<Frame>> {
        let mut frames: Vec<Frame> = widths
            .iter()
            .map(|c| Frame {
                cells: vec![0.0; self.n_cells * c],
                boundary: vec![0.0; self.n_boundary * c],
            })
            .collect();
        for (rank, values) in ranks.iter().enumerate() {
            let mut rest = values.as_slice();
            for (frame, &c) in frames.iter_mut().zip(widths) {
                for (target, rows) in [
                    (&mut frame.cells, &self.cells[rank]),
                    (&mut frame.boundary, &self.boundary[rank]),
                ] {
                    let Some((part, after)) = rest.split_at_checked(rows.len() * c) else {
                        return Err(Error::Internal(format!(
                            "rank {rank} sent {} values",
                            values.len()
                        )));
                    };
                    for (row, value) in rows.iter().zip(part.chunks_exact(c)) {
                        let start = *row as usize * c;
                        target[start..start + c].copy_from_slice(value);
                    }
                    rest = after;
                }
            }
        }
        Ok(frames)
    }
}

/// The undecomposed mesh, on the root; collective.
///
/// Faces between ranks become internal faces again; they are told from cyclic faces by their geometry: the
/// vector between the cells through a processor face is the difference of their centres.
fn assemble(comm: &Comm, mesh: &Mesh) -> Option<Result<Mesh>> {
    let global = |cell: i32| mesh.cell_global.get(cell as usize).copied().unwrap_or(-1);
    let centres = comm.gather(&flat(mesh.cell_centres.iter()));
    let volumes = comm.gather(&mesh.cell_volumes);
    let cells = comm.gather(&mesh.cell_global);
    let pairs: Vec<i64> = mesh
        .face_owner
        .iter()
        .zip(&mesh.face_neighbour)
        .flat_map(|(&o, &n)| [global(o), global(n)])
        .collect();
    let pairs = comm.gather(&pairs);
    let coeff = comm.gather(&mesh.face_coeff);
    let b = &mesh.boundary;
    let labels: Vec<i64> = b
        .iter()
        .flat_map(|f| [f.global, global(f.owner), f.kind as i64, i64::from(f.patch)])
        .collect();
    let labels = comm.gather(&labels);
    let reals: Vec<f64> = b
        .iter()
        .flat_map(|f| f.centre.into_iter().chain(f.area).chain([f.coeff]))
        .collect();
    let reals = comm.gather(&reals);
    let coupled: Vec<i64> = mesh
        .coupled
        .iter()
        .flat_map(|f| [global(f.owner), f.global])
        .collect();
    let coupled = comm.gather(&coupled);
    let deltas: Vec<f64> = mesh
        .coupled
        .iter()
        .flat_map(|f| f.delta.into_iter().chain([f.coeff]))
        .collect();
    let deltas = comm.gather(&deltas);
    // Cell by cell, all modes of each.
    let modes: Vec<f64> = (0..mesh.n_cells())
        .flat_map(|c| {
            mesh.elastic
                .iter()
                .flat_map(move |e| e.vectors.iter().flat_map(move |v| v[c]))
        })
        .collect();
    let modes = comm.gather(&modes);

    let cells = cells?.concat();
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
    let (centres, volumes) = (rows::<3>(&centres?.concat()), volumes?.concat());
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
        let (m, modes) = (elastic.eigenvalues.len(), rows::<3>(&modes?.concat()));
        whole.elastic = Some(ElasticModes {
            eigenvalues: elastic.eigenvalues.clone(),
            vectors: (0..m)
                .map(|k| order.iter().map(|&i| modes[i * m + k]).collect())
                .collect(),
        });
    }

    let mut faces: Vec<(i64, i64, f64)> = pairs?
        .concat()
        .chunks_exact(2)
        .zip(coeff?.concat())
        .map(|(p, c)| (p[0].min(p[1]), p[0].max(p[1]), c))
        .collect();
    for (pair, d) in rows_i::<2>(&coupled?.concat())
        .into_iter()
        .zip(rows::<4>(&deltas?.concat()))
    {
        let [owner, neighbour] = pair;
        let outside = [owner, neighbour]
            .iter()
            .any(|&g| usize::try_from(g).map_or(true, |g| g >= n));
        if outside {
            return Some(Err(Error::Mesh(format!(
                "a coupled face joins cells {owner} and {neighbour} of {n}"
            ))));
        }
        let (from, to) = (
            whole.cell_centres[owner as usize],
            whole.cell_centres[neighbour as usize],
        );
        let length = d[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
        let straight = (0..3).all(|k| (to[k] - from[k] - d[k]).abs() <= 1e-5 * length);
        if !straight {
            let delta = [d[0], d[1], d[2]];
            whole.coupled.push(CoupledFace {
                owner: owner as i32,
                rank: 0,
                global: neighbour,
                delta,
                coeff: d[3],
            });
        } else if owner < neighbour {
            // The other side's entry is the same face.
            faces.push((owner, neighbour, d[3]));
        }
    }
    faces.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
    whole.coupled.sort_by(|a, b| {
        let deltas = a
            .delta
            .iter()
            .zip(&b.delta)
            .map(|(a, b)| a.total_cmp(b))
            .find(|o| o.is_ne());
        (a.owner, a.global)
            .cmp(&(b.owner, b.global))
            .then(deltas.unwrap_or(std::cmp::Ordering::Equal))
    });
    whole.face_owner = faces.iter().map(|f| f.0 as i32).collect();
    whole.face_neighbour = faces.iter().map(|f| f.1 as i32).collect();
    whole.face_coeff = faces.iter().map(|f| f.2).collect();

    Some(
        boundary(&rows_i::<4>(&labels?.concat()), &rows::<7>(&reals?.concat()))
            .map(|boundary| Mesh { boundary, ..whole }),
    )
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

fn flat<'a>(values: impl Iterator<Item = &'a [f64; 3]>) -> Vec<f64> {
    values.flatten().copied().collect()
}

fn rows<const N: usize>(values: &[f64]) -> Vec<[f64; N]> {
    values.as_chunks::<N>().0.to_vec()
}

fn rows_i<const N: usize>(values: &[i64]) -> Vec<[i64; N]> {
    values.as_chunks::<N>().0.to_vec()
}
