//! Rows of K and M of the points that this rank owns, held displacements removed.

use super::numbering::Numbering;
use super::strain::{CellMass, Strain, Term};
use crate::Rows;
use m4gn_parallel::Comm;

/// Points that can move, numbered anew rank after rank.
pub(super) struct Movable {
    /// Places among this rank's own points.
    pub own: Vec<usize>,
    /// Held components of those.
    pub held: Vec<[bool; 3]>,
    first: i64,
    /// New number and held components of every own point; -1 where all are held.
    all: Vec<f64>,
}

impl Movable {
    /// Takes out the points whose `dim` components are all held. Collective.
    pub fn new(held: &[[bool; 3]], dim: usize, comm: &Comm) -> Self {
        let own: Vec<usize> = (0..held.len()).filter(|&i| !held[i][..dim].iter().all(|h| *h)).collect();
        let first = comm.exclusive_scan_i64(own.len() as i64);
        let mut all: Vec<f64> = held
            .iter()
            .flat_map(|h| {
                let flag = |d: usize| f64::from(u8::from(h[d]));
                [-1.0, flag(0), flag(1), flag(2)]
            })
            .collect();
        for (i, &p) in own.iter().enumerate() {
            all[4 * p] = (first + i as i64) as f64;
        }
        Movable { held: own.iter().map(|&p| held[p]).collect(), own, first, all }
    }
}

/// One matrix of blocks before the held displacements are removed: this rank's rows.
struct Blocks {
    /// For each own movable point the points it is coupled with, as places in `seen`, and where their blocks are.
    row: Vec<usize>,
    column: Vec<usize>,
    value: Vec<f64>,
}

/// Points that this rank's terms name, and what became of them.
struct Seen {
    /// Numbers, ascending.
    numbers: Vec<i64>,
    /// New number of each, or -1.
    moved: Vec<i64>,
    /// Held components.
    held: Vec<[bool; 3]>,
}

impl Seen {
    fn new(numbers: Vec<i64>, numbering: &Numbering, movable: &Movable, comm: &Comm) -> Self {
        let mut numbers = numbers;
        numbers.sort_unstable();
        numbers.dedup();
        let found = numbering.fetch(comm, &numbers, &movable.all, 4);
        Seen {
            numbers,
            moved: found.chunks_exact(4).map(|f| f[0] as i64).collect(),
            held: found.chunks_exact(4).map(|f| [f[1] != 0.0, f[2] != 0.0, f[3] != 0.0]).collect(),
        }
    }

    fn place(&self, number: i64) -> usize {
        self.numbers.partition_point(|&n| n < number)
    }
}

/// K from strains and M from cell masses, `dim` rows a movable point. Collective.
///
/// Held components of points that move otherwise keep a row: their stiffness alone on the diagonal, no mass.
pub(super) fn rows(
    strains: &[Strain],
    masses: &[CellMass],
    dim: usize,
    numbering: &Numbering,
    movable: &Movable,
    comm: &Comm,
) -> (Rows, Rows) {
    let names = strains.iter().flat_map(|s| s.points()).chain(masses.iter().flat_map(|m| m.points()));
    let seen = Seen::new(names.copied().collect(), numbering, movable, comm);
    let stiffness = blocks(strains, dim * dim, &seen, movable, |strain, i, j, block| {
        let (gi, gj) = (&strain.gradients[i], &strain.gradients[j]);
        let dot: f64 = gi.iter().zip(gj).map(|(a, b)| a * b).sum();
        for a in 0..dim {
            for b in 0..dim {
                block[a * dim + b] += strain.lambda * gi[a] * gj[b] + strain.mu * gi[b] * gj[a];
            }
            block[a * dim + a] += strain.mu * dot;
        }
    });
    let mass = blocks(masses, 1, &seen, movable, |cell, i, j, block| {
        block[0] += cell.mass[i * cell.points.len() + j];
    });
    (
        scalar(&stiffness, dim, &seen, movable, Held::Diagonal, |block, a, b| Some(block[a * dim + b])),
        scalar(&mass, dim, &seen, movable, Held::Nothing, |block, a, b| (a == b).then_some(block[0])),
    )
}

/// Adds up terms, row by row: each row's columns first, then their values.
fn blocks<T: Term>(
    terms: &[T],
    size: usize,
    seen: &Seen,
    movable: &Movable,
    add: impl Fn(&T, usize, usize, &mut [f64]),
) -> Blocks {
    let n = movable.own.len();
    // For each row the terms that have its point, and where.
    let mut of_row: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n];
    let places: Vec<Vec<usize>> =
        terms.iter().map(|t| t.points().iter().map(|&p| seen.place(p)).collect()).collect();
    for (t, points) in places.iter().enumerate() {
        for (i, &p) in points.iter().enumerate() {
            let own = seen.moved[p] - movable.first;
            if seen.moved[p] >= 0 && (0..n as i64).contains(&own) {
                of_row[own as usize].push((t as u32, i as u32));
            }
        }
    }
    let mut blocks = Blocks { row: vec![0], column: Vec::new(), value: Vec::new() };
    const NONE: usize = usize::MAX;
    let mut slot = vec![NONE; seen.numbers.len()];
    for terms_here in &of_row {
        let first = blocks.column.len();
        for &(t, _) in terms_here {
            for &p in &places[t as usize] {
                if slot[p] == NONE && seen.moved[p] >= 0 {
                    slot[p] = 0;
                    blocks.column.push(p);
                }
            }
        }
        blocks.column[first..].sort_unstable();
        for (k, &p) in blocks.column[first..].iter().enumerate() {
            slot[p] = k;
        }
        blocks.value.resize(blocks.column.len() * size, 0.0);
        let values = &mut blocks.value[first * size..];
        for &(t, i) in terms_here {
            for (j, &p) in places[t as usize].iter().enumerate() {
                if slot[p] != NONE {
                    let block = &mut values[slot[p] * size..(slot[p] + 1) * size];
                    add(&terms[t as usize], i as usize, j, block);
                }
            }
        }
        for &p in &blocks.column[first..] {
            slot[p] = NONE;
        }
        blocks.row.push(blocks.column.len());
    }
    blocks
}

/// What stands in the row of a held component.
#[derive(Clone, Copy, PartialEq)]
enum Held {
    Diagonal,
    Nothing,
}

/// `dim` rows a point, without the held components' couplings.
fn scalar(
    blocks: &Blocks,
    dim: usize,
    seen: &Seen,
    movable: &Movable,
    held: Held,
    entry: impl Fn(&[f64], usize, usize) -> Option<f64>,
) -> Rows {
    let size = blocks.value.len() / blocks.column.len().max(1);
    let mut rows = Rows { row: vec![0], column: Vec::new(), value: Vec::new() };
    for (i, window) in blocks.row.windows(2).enumerate() {
        let here = movable.first + i as i64;
        for a in 0..dim {
            for k in window[0]..window[1] {
                let (p, block) = (blocks.column[k], &blocks.value[k * size..(k + 1) * size]);
                for b in 0..dim {
                    let diagonal = a == b && seen.moved[p] == here;
                    let free = !movable.held[i][a] && !seen.held[p][b];
                    if free || diagonal && held == Held::Diagonal {
                        // Zeros too: PETSc's orderings need a symmetric pattern.
                        if let Some(value) = entry(block, a, b) {
                            rows.column.push(seen.moved[p] * dim as i64 + b as i64);
                            rows.value.push(value);
                        }
                    }
                }
            }
            rows.row.push(rows.column.len());
        }
    }
    rows
}
