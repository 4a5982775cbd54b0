//! Is a mesh whole? Everything that later code relies on is checked here once, with the place named.

use crate::{ElasticModes, Mesh, NodeType};
use m4gn_base::{Error, Result, refuse, refuse_any};
use m4gn_parallel::{Comm, same_on_all_ranks};

/// Sizes of a mesh over all ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GlobalSizes {
    /// Cells.
    pub cells: i64,
    /// Boundary faces that carry values.
    pub boundary: i64,
}

impl Mesh {
    /// Checks lengths, label ranges, finite geometry, positive volumes and coefficients, and that the global
    /// numbers are permutations over all ranks. Returns the global sizes. Collective; all ranks fail together.
    pub fn check(&self, comm: &Comm) -> Result<GlobalSizes> {
        comm.agree(self.check_local(comm.size()))?;
        let cells = permutation(comm, "cell_global", &self.cell_global)?;
        let boundary: Vec<i64> = self.boundary.iter().map(|b| b.global).collect();
        let boundary = permutation(comm, "boundary_global", &boundary)?;
        refuse(cells == 0, Error::Mesh, || "the mesh has no cells on any rank")?;
        same_on_all_ranks(comm, &[("number of directions", self.dim() as i64)])?;
        let outside = self.coupled.iter().find(|c| !(0..cells).contains(&c.global));
        comm.agree(refuse_any(outside, Error::Mesh, |c| {
            format!("coupled_global holds {}: expected 0 to {}", c.global, cells - 1)
        }))?;
        let values = self.elastic.iter().flat_map(|e| e.eigenvalues.iter().copied());
        let own: Vec<f64> =
            std::iter::once(if self.elastic.is_some() { 1.0 } else { 0.0 }).chain(values).collect();
        let mut of_root = own.clone();
        comm.broadcast(&mut of_root);
        let words =
            "the eigenvalues of the elastic modes differ between ranks: expected the same modes on all";
        comm.agree(refuse(of_root != own, Error::Mesh, || words))?;
        Ok(GlobalSizes { cells, boundary })
    }

    /// Checks that this rank's cells are finite places and the global numbers a permutation of 0 to N - 1 over all
    /// ranks; returns N. Collective; all ranks fail together.
    pub(crate) fn check_points(&self, comm: &Comm) -> Result<usize> {
        let local = || {
            length("cell_centres", self.cell_centres.len(), "cells", self.cell_global.len())?;
            let mut centres = self.cell_centres.iter().enumerate();
            centres.try_for_each(|(i, centre)| finite("cell_centres", i, centre))
        };
        comm.agree(local())?;
        Ok(permutation(comm, "cell_global", &self.cell_global)? as usize)
    }

    fn check_local(&self, size: i32) -> Result<()> {
        let n = self.n_cells();
        let limit = i32::MAX as usize / 4;
        if n > limit
            || self.face_owner.len() > limit
            || self.boundary.len() > limit
            || self.coupled.len() > limit
        {
            return Err(Error::Mesh(format!(
                "{n} cells and {} faces on one rank: at most {limit} of each; use more ranks",
                self.face_owner.len()
            )));
        }
        directions(&self.directions, 1)?;
        length("cell_global", self.cell_global.len(), "cells", n)?;
        length("cell_centres", self.cell_centres.len(), "cells", n)?;
        let faces = self.face_owner.len();
        length("face_neighbour", self.face_neighbour.len(), "faces", faces)?;
        length("face_coeff", self.face_coeff.len(), "faces", faces)?;
        for (i, (centre, &volume)) in self.cell_centres.iter().zip(&self.cell_volumes).enumerate() {
            finite("cell_centres", i, centre)?;
            positive("cell_volumes", i, volume)?;
        }
        for f in 0..faces {
            let (owner, neighbour) = (self.face_owner[f], self.face_neighbour[f]);
            label("face_owner", f, owner, n)?;
            label("face_neighbour", f, neighbour, n)?;
            refuse(owner == neighbour, Error::Mesh, || format!("face {f} has cell {owner} on both sides"))?;
            positive("face_coeff", f, self.face_coeff[f])?;
        }
        for (i, b) in self.boundary.iter().enumerate() {
            label("boundary_owner", i, b.owner, n)?;
            finite("boundary_centres", i, &b.centre)?;
            finite("boundary_area", i, &b.area)?;
            refuse(!(b.coeff.is_finite() && b.coeff >= 0.0), Error::Mesh, || {
                format!("boundary_coeff[{i}] is {}: expected a finite number, not negative", b.coeff)
            })?;
            refuse(b.kind == NodeType::Fluid, Error::Mesh, || {
                format!("boundary_type[{i}] is fluid: expected wall, inlet, outlet, symmetry or obstacle")
            })?;
            label("boundary_patch", i, b.patch, self.patches.len())?;
        }
        for (i, c) in self.coupled.iter().enumerate() {
            label("coupled_owner", i, c.owner, n)?;
            refuse(c.rank < 0 || c.rank >= size, Error::Mesh, || {
                format!("coupled_rank[{i}] is {}: expected 0 to {}", c.rank, size - 1)
            })?;
            finite("coupled_delta", i, &c.delta)?;
            positive("coupled_coeff", i, c.coeff)?;
        }
        self.elastic.as_ref().map_or(Ok(()), |modes| modes.check(n))
    }
}

impl ElasticModes {
    fn check(&self, n_cells: usize) -> Result<()> {
        length("mode_cells", self.vectors.len(), "mode_eigenvalues", self.eigenvalues.len())?;
        let falls = self.eigenvalues.windows(2).position(|pair| pair[1] < pair[0]);
        refuse_any(falls, Error::Mesh, |i| {
            let (before, value) = (self.eigenvalues[i], self.eigenvalues[i + 1]);
            format!("mode_eigenvalues[{}] is {value}, after {before}: expected ascending ones", i + 1)
        })?;
        for (i, vector) in self.vectors.iter().enumerate() {
            length("mode_cells", vector.len(), "cells", n_cells)?;
            let finite = self.eigenvalues[i].is_finite() && vector.iter().flatten().all(|v| v.is_finite());
            refuse(!finite, Error::Mesh, || format!("elastic mode {i} holds a number that is not finite"))?;
        }
        Ok(())
    }
}

/// Whether these are different axes, `least` of them or more.
pub fn directions(axes: &[usize], least: usize) -> Result<()> {
    let different = (0..3).filter(|d| axes.contains(d)).count();
    refuse(different != axes.len() || different < least, Error::Mesh, || {
        format!("directions {axes:?}: expected {least} to 3 different ones of 0 (x), 1 (y), 2 (z)")
    })
}

/// Whether a list is as long as what it belongs to.
pub fn length(name: &str, found: usize, of: &str, expected: usize) -> Result<()> {
    refuse(found != expected, Error::Mesh, || {
        format!("{name} has {found} entries, but there are {expected} {of}")
    })
}

fn label(name: &str, i: usize, value: i32, n: usize) -> Result<()> {
    refuse(usize::try_from(value).map_or(true, |v| v >= n), Error::Mesh, || match n {
        0 => format!("{name}[{i}] is {value}, but there is nothing to refer to"),
        _ => format!("{name}[{i}] is {value}: expected 0 to {}", n - 1),
    })
}

/// Whether a place or a vector is one.
pub fn finite(name: &str, i: usize, v: &[f64; 3]) -> Result<()> {
    let bad = v.iter().any(|x| !x.is_finite());
    refuse(bad, Error::Mesh, || format!("{name}[{i}] is {v:?}: expected finite numbers"))
}

fn positive(name: &str, i: usize, v: f64) -> Result<()> {
    let good = v.is_finite() && v > 0.0;
    refuse(!good, Error::Mesh, || format!("{name}[{i}] is {v}: expected a positive finite number"))
}

/// Checks that the ranks' numbers are 0..N, each once; returns N. Collective.
///
/// Each number goes to the rank that keeps its block, which marks it: exact, and no rank sees more than its share.
fn permutation(comm: &Comm, name: &str, numbers: &[i64]) -> Result<i64> {
    let total = comm.total(numbers.len());
    let outside = numbers.iter().find(|&&g| g < 0 || g >= total);
    let result = refuse_any(outside, Error::Mesh, |g| {
        format!("{name} holds {g}: expected a permutation of 0 to {} over all ranks", total - 1)
    });
    comm.agree(result)?;
    let size = comm.size() as i64;
    let block = (total + size - 1) / size;
    let mut keepers = vec![Vec::new(); size as usize];
    for &g in numbers {
        keepers[(g / block.max(1)) as usize].push(g);
    }
    let first = block * comm.rank() as i64;
    let mut seen = vec![false; block as usize];
    let mut twice = None;
    for g in comm.all_to_all(&keepers).into_iter().flatten() {
        let mark = &mut seen[(g - first) as usize];
        if std::mem::replace(mark, true) {
            twice = Some(g);
        }
    }
    comm.agree(refuse_any(twice, Error::Mesh, |g| {
        format!(
            "{name} holds {g} more than once: expected a permutation of 0 to {} over all ranks",
            total - 1
        )
    }))?;
    Ok(total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CoupledFace, sample};

    #[test]
    fn sample_meshes_are_whole() {
        let sizes = sample::rectangle(4, 3, 1.0, 1.0).check(&Comm::serial()).unwrap();
        assert_eq!(sizes, GlobalSizes { cells: 12, boundary: 14 });
        sample::triangles(3, 3, 1.0, 1.0).check(&Comm::serial()).unwrap();
        sample::block([2, 3, 2], [1.0, 1.0, 1.0]).check(&Comm::serial()).unwrap();
    }

    fn coupled(global: i64) -> CoupledFace {
        CoupledFace { owner: 0, rank: 0, global, delta: [1.0, 0.0, 0.0], coeff: 1.0 }
    }

    #[test]
    fn errors_name_the_place() {
        type Change = fn(&mut Mesh);
        let changes: [(Change, &str); 10] = [
            (|m| m.cell_volumes[4] = -1.0, "cell_volumes[4] is -1"),
            (|m| m.face_owner[2] = 77, "face_owner[2] is 77: expected 0 to 5"),
            (|m| m.cell_global[0] = 5, "5 more than once"),
            (|m| m.cell_centres.truncate(5), "cell_centres has 5 entries"),
            (|m| m.face_owner.truncate(2), "face_neighbour has 7 entries, but there are 2 faces"),
            (|m| m.cell_volumes.truncate(2), "cell_global has 6 entries, but there are 2 cells"),
            (|m| m.boundary[0].patch = 9, "boundary_patch[0]"),
            (|m| m.directions = vec![0, 0], "directions [0, 0]: expected 1 to 3 different ones"),
            (|m| m.coupled = vec![coupled(6)], "coupled_global holds 6: expected 0 to 5"),
            (|m| *m = Mesh { directions: vec![0, 1], ..Default::default() }, "no cells"),
        ];
        for (change, expected) in changes {
            let mut mesh = sample::rectangle(3, 2, 1.0, 1.0);
            change(&mut mesh);
            let message = mesh.check(&Comm::serial()).expect_err("a broken mesh").to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
