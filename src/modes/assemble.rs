//! The Laplacian and the volumes as distributed rows.

use crate::ffi::petsc::SymmetricRows;
use crate::graph::Graph;
use crate::mesh::Mesh;
use crate::parallel::Comm;
use crate::{Error, Result};

/// K phi = lambda V phi on this rank, and sizes over all ranks.
pub(super) struct System {
    /// Rows of K; rows are numbered rank after rank.
    pub k: SymmetricRows,
    /// Cell volumes, m^3.
    pub v: Vec<f64>,
    /// Cells of all ranks.
    pub n_global: usize,
    /// Volume of all ranks, m^3.
    pub volume: f64,
    /// Corners of the box around all cell centres and boundary faces, m.
    pub low: [f64; 3],
    /// As `low`.
    pub high: [f64; 3],
    /// 1 / (diagonal of that box)^2, 1/m^2: the size of the smallest eigenvalues.
    pub scale: f64,
}

/// Assembles the system. Collective.
pub(super) fn assemble(mesh: &Mesh, graph: &mut Graph, comm: &Comm) -> Result<System> {
    let n = mesh.n_cells();
    let first = comm.exclusive_scan_i64(n as i64);
    let mut total = [n as i64];
    comm.sum_i64(&mut total);
    if total[0] > i32::MAX as i64 {
        return Err(Error::Input(format!(
            "{} cells: PETSc's integers count to {}",
            total[0],
            i32::MAX
        )));
    }
    let mut number = vec![-1i64; graph.n_local];
    for (i, g) in number.iter_mut().take(n).enumerate() {
        *g = first + i as i64;
    }
    graph.halo.exchange_i64(comm, &mut number, 1);
    let coupled = comm.agree(Graph::coupled_nodes(mesh, comm))?;

    let mut entries: Vec<(i32, i32, f64)> =
        Vec::with_capacity(n + 2 * mesh.face_owner.len() + mesh.coupled.len());
    let mut diagonal = vec![0.0; n];
    for ((&a, &b), &c) in mesh
        .face_owner
        .iter()
        .zip(&mesh.face_neighbour)
        .zip(&mesh.face_coeff)
    {
        entries.push((a, number[b as usize] as i32, -c));
        entries.push((b, number[a as usize] as i32, -c));
        diagonal[a as usize] += c;
        diagonal[b as usize] += c;
    }
    for (c, &node) in mesh.coupled.iter().zip(&coupled) {
        entries.push((c.owner, number[node as usize] as i32, -c.coeff));
        diagonal[c.owner as usize] += c.coeff;
    }
    for b in &mesh.boundary {
        diagonal[b.owner as usize] += b.coeff;
    }
    for (i, &d) in diagonal.iter().enumerate() {
        entries.push((i as i32, number[i] as i32, d));
    }
    let extent = Extent::of(mesh, comm);
    let mut volume = [mesh.cell_volumes.iter().sum::<f64>()];
    comm.sum_f64(&mut volume);
    let diagonal_square: f64 = mesh
        .directions
        .iter()
        .map(|&d| (extent.high[d] - extent.low[d]).powi(2))
        .sum();
    Ok(System {
        k: compress(n, entries),
        v: mesh.cell_volumes.clone(),
        n_global: total[0] as usize,
        volume: volume[0],
        low: extent.low,
        high: extent.high,
        scale: if diagonal_square > 0.0 {
            1.0 / diagonal_square
        } else {
            1.0
        },
    })
}

/// Box around all cell centres and boundary face centres, over all ranks, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Extent {
    /// Lowest coordinates.
    pub low: [f64; 3],
    /// Highest coordinates.
    pub high: [f64; 3],
}

impl Extent {
    /// The box of this mesh. Collective; exact, so the same on any number of ranks.
    pub fn of(mesh: &Mesh, comm: &Comm) -> Self {
        let mut high = [f64::NEG_INFINITY; 6];
        for x in mesh
            .cell_centres
            .iter()
            .chain(mesh.boundary.iter().map(|b| &b.centre))
        {
            for d in 0..3 {
                high[d] = high[d].max(x[d]);
                high[3 + d] = high[3 + d].max(-x[d]);
            }
        }
        comm.max_f64(&mut high);
        Extent {
            low: [-high[3], -high[4], -high[5]],
            high: [high[0], high[1], high[2]],
        }
    }
}

/// Sorts entries into rows and adds up those of the same place.
fn compress(n: usize, mut entries: Vec<(i32, i32, f64)>) -> SymmetricRows {
    entries.sort_by_key(|&(row, column, _)| (row, column));
    let mut rows = SymmetricRows {
        row: vec![0; n + 1],
        ..Default::default()
    };
    let mut at = (-1, -1);
    for (row, column, value) in entries {
        if at == (row, column) {
            if let Some(last) = rows.value.last_mut() {
                *last += value;
            }
            continue;
        }
        at = (row, column);
        rows.column.push(column);
        rows.value.push(value);
        rows.row[row as usize + 1] += 1;
    }
    for i in 0..n {
        rows.row[i + 1] += rows.row[i];
    }
    rows
}
