//! The Laplacian and the volumes of a mesh as a pair of matrices.

use super::frame::Frame;
use super::problem::{Mass, Problem, Rows};
use m4gn_base::Result;
use m4gn_mesh::{Extent, Ghosts, Mesh};
use m4gn_parallel::Comm;

/// K phi = lambda V phi of eq. 6, and where the cells are. Collective.
pub(super) fn laplacian<'a>(mesh: &'a Mesh, comm: &Comm) -> Result<(Problem, Frame<'a>)> {
    mesh.check(comm)?;
    let mut ghosts = Ghosts::of(mesh, comm)?;
    let n = mesh.n_cells();
    let first = comm.exclusive_scan_i64(n as i64);
    let mut number = vec![-1i64; ghosts.n_local(mesh)];
    for (i, g) in number.iter_mut().take(n).enumerate() {
        *g = first + i as i64;
    }
    ghosts.halo.exchange_i64(comm, &mut number, 1);

    let mut row = vec![1usize; n];
    for (&a, &b) in mesh.face_owner.iter().zip(&mesh.face_neighbour) {
        row[a as usize] += 1;
        row[b as usize] += 1;
    }
    mesh.coupled.iter().for_each(|c| row[c.owner as usize] += 1);
    // Ends of the rows; each entry moves its row's end down, so that they are starts when all are in.
    let mut sum = 0;
    for r in &mut row {
        sum += *r;
        *r = sum;
    }
    row.push(sum);
    let mut column = vec![0i64; sum];
    let mut value = vec![0.0; sum];
    let mut diagonal = vec![0.0; n];
    let mut put = |a: i32, to: i64, x: f64| {
        let at = &mut row[a as usize];
        *at -= 1;
        column[*at] = to;
        value[*at] = x;
    };
    for ((&a, &b), &c) in mesh.face_owner.iter().zip(&mesh.face_neighbour).zip(&mesh.face_coeff) {
        put(a, number[b as usize], -c);
        put(b, number[a as usize], -c);
        diagonal[a as usize] += c;
        diagonal[b as usize] += c;
    }
    for (c, &node) in mesh.coupled.iter().zip(&ghosts.behind) {
        put(c.owner, number[node as usize], -c.coeff);
        diagonal[c.owner as usize] += c.coeff;
    }
    for b in &mesh.boundary {
        diagonal[b.owner as usize] += b.coeff;
    }
    for (i, &d) in diagonal.iter().enumerate() {
        put(i as i32, number[i], d);
    }
    let extent = Extent::of(mesh, comm);
    let square: f64 = mesh.directions.iter().map(|&d| (extent.high[d] - extent.low[d]).powi(2)).sum();
    let frame =
        Frame { positions: &mesh.cell_centres, axes: mesh.directions.clone(), extent, first: first as usize };
    let problem = Problem {
        stiffness: Rows { row, column, value },
        mass: Mass::Diagonal(mesh.cell_volumes.clone()),
        block: 1,
        positions: Vec::new(),
        // Eigenvalues are of the size of 1 / diagonal^2 or larger, or 0.
        shift: Some(if square > 0.0 { -0.01 / square } else { -0.01 }),
    };
    Ok((problem, frame))
}
