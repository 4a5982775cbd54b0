//! Points shared by ranks: each has one owner, and one number; numbers run rank after rank.

use super::mesh::PointMesh;
use m4gn_base::{Error, Result, refuse_any};
use m4gn_mesh::Extent;
use m4gn_parallel::Comm;

/// Numbers of the points that carry unknowns.
pub(super) struct Numbering {
    /// Number of each local point; none where a point carries no unknown (the back of a 2-D mesh).
    pub number: Vec<Option<i64>>,
    /// First number of each rank, then the count of all.
    pub first: Vec<i64>,
    /// Local points that this rank owns, in the order of their numbers.
    pub owned: Vec<usize>,
    rank: usize,
}

impl Numbering {
    /// Gives every point with `carries` an owner, the lowest rank that has a cell at it, and a number. Collective.
    ///
    /// Errors: numbers that are not 0..N, twice on a rank, or at different places on different ranks; points without
    /// a cell, unless `paired` (then only those that carry).
    pub fn new(mesh: &PointMesh, carries: &[bool], paired: bool, comm: &Comm) -> Result<Self> {
        let size = comm.size() as usize;
        let directory = Directory::new(mesh, comm)?;
        let holders = directory.send(comm, &mesh.point_global, |p| i64::from(carries[p]));
        // For each point of this rank's block of the directory: its owner.
        let mut owner = vec![-1i64; directory.n_kept];
        for (rank, flags) in holders.iter().enumerate().rev() {
            for &(at, carries) in flags {
                if carries != 0 {
                    owner[at] = rank as i64;
                }
            }
        }
        let lonely = owner.iter().position(|&o| o < 0).filter(|_| !paired);
        comm.agree(refuse_any(lonely, Error::Mesh, |at| {
            let number = directory.first_kept + at as i64;
            format!("the point with global number {number} belongs to no cell: remove it from the mesh")
        }))?;
        let owners = directory.reply(comm, &mesh.point_global, &holders, &owner);
        let rank = comm.rank() as usize;
        let owned: Vec<usize> = (0..owners.len()).filter(|&p| owners[p] == rank as i64).collect();
        let mut counts = vec![0i64; size];
        counts[rank] = owned.len() as i64;
        comm.sum_i64(&mut counts);
        let mut first = vec![0i64; size + 1];
        for r in 0..size {
            first[r + 1] = first[r] + counts[r];
        }
        // The owner tells the directory, the directory tells the holders.
        let mut mine = vec![-1i64; mesh.points.len()];
        for (i, &p) in owned.iter().enumerate() {
            mine[p] = first[rank] + i as i64;
        }
        let told = directory.send(comm, &mesh.point_global, |p| mine[p]);
        let mut numbers = vec![-1i64; directory.n_kept];
        for &(at, number) in told.iter().flatten().filter(|t| t.1 >= 0) {
            numbers[at] = number;
        }
        let numbers = directory.reply(comm, &mesh.point_global, &told, &numbers);
        let number =
            (0..mesh.points.len()).map(|p| (carries[p] && numbers[p] >= 0).then_some(numbers[p])).collect();
        Ok(Numbering { number, first, owned, rank })
    }

    /// Rank that owns a number.
    pub fn owner(&self, number: i64) -> usize {
        self.first.partition_point(|&f| f <= number) - 1
    }

    /// First number of this rank.
    pub fn first_own(&self) -> i64 {
        self.first[self.rank]
    }

    /// Points of all ranks that carry unknowns.
    pub fn total(&self) -> i64 {
        self.first.last().copied().unwrap_or(0)
    }

    /// For each number its owner's values, `width` of them, from `own` (those of this rank's own). Collective.
    pub fn fetch(&self, comm: &Comm, numbers: &[i64], own: &[f64], width: usize) -> Vec<f64> {
        let write = |at: usize, to: &mut Vec<f64>| to.extend_from_slice(&own[at * width..][..width]);
        let answers = self.answers(comm, numbers, write);
        let mut rest: Vec<&[f64]> = answers.iter().map(Vec::as_slice).collect();
        numbers.iter().flat_map(|&n| take(&mut rest[self.owner(n)], width)).copied().collect()
    }

    /// From each rank what it writes of those of the numbers that it owns, in their order: `write` gets a number's place
    /// among this rank's own. Collective.
    pub fn answers(
        &self,
        comm: &Comm,
        numbers: &[i64],
        write: impl Fn(usize, &mut Vec<f64>),
    ) -> Vec<Vec<f64>> {
        let mut ask = vec![Vec::new(); self.first.len() - 1];
        numbers.iter().for_each(|&n| ask[self.owner(n)].push(n));
        let answer = |list: &Vec<i64>| {
            let mut to = Vec::new();
            list.iter().for_each(|n| write((n - self.first_own()) as usize, &mut to));
            to
        };
        let answers: Vec<Vec<f64>> = comm.all_to_all(&ask).iter().map(answer).collect();
        comm.all_to_all(&answers)
    }

    /// Sums of all ranks' `values`, `width` a number, at the owner. Collective.
    pub fn sum_at_owner(&self, comm: &Comm, numbers: &[i64], values: &[f64], width: usize) -> Vec<f64> {
        let size = self.first.len() - 1;
        let (mut to, mut data) = (vec![Vec::new(); size], vec![Vec::new(); size]);
        for (i, &n) in numbers.iter().enumerate() {
            let owner = self.owner(n);
            to[owner].push(n);
            data[owner].extend_from_slice(&values[i * width..(i + 1) * width]);
        }
        let (to, data) = (comm.all_to_all(&to), comm.all_to_all(&data));
        let mut sum = vec![0.0; self.owned.len() * width];
        for (n, values) in to.iter().flatten().zip(data.iter().flat_map(|d| d.chunks_exact(width))) {
            let at = (n - self.first_own()) as usize * width;
            sum[at..at + width].iter_mut().zip(values).for_each(|(s, v)| *s += v);
        }
        sum
    }
}

/// The first values of a list, which is moved on to those behind them.
pub(super) fn take<'a>(values: &mut &'a [f64], n: usize) -> &'a [f64] {
    let (head, tail) = values.split_at(n);
    *values = tail;
    head
}

/// Keeps for each global number who holds it: rank r keeps the block of numbers that starts at r times its length.
struct Directory {
    block: i64,
    first_kept: i64,
    n_kept: usize,
    size: usize,
}

impl Directory {
    fn new(mesh: &PointMesh, comm: &Comm) -> Result<Self> {
        let size = comm.size() as usize;
        let held = comm.total(mesh.points.len());
        let mut most = [mesh.point_global.iter().copied().max().unwrap_or(-1)];
        comm.max_i64(&mut most);
        let bad = mesh.point_global.iter().find(|&&g| g < 0 || g >= held);
        comm.agree(refuse_any(bad, Error::Mesh, |g| {
            format!("point_global holds {g}: expected 0 to N - 1 for N points, at most {held} here")
        }))?;
        let total = most[0] + 1;
        let block = (total + size as i64 - 1) / size as i64;
        let first_kept = block * comm.rank() as i64;
        let directory = Directory {
            block: block.max(1),
            first_kept,
            n_kept: (total - first_kept).clamp(0, block) as usize,
            size,
        };
        directory.check(mesh, comm)?;
        Ok(directory)
    }

    /// Each number held, by no rank twice, and at one place.
    fn check(&self, mesh: &PointMesh, comm: &Comm) -> Result<()> {
        let mut places = vec![Vec::new(); self.size];
        for (x, &g) in mesh.points.iter().zip(&mesh.point_global) {
            places[(g / self.block) as usize].extend_from_slice(x);
        }
        let places = comm.all_to_all(&places);
        let numbers = self.send(comm, &mesh.point_global, |_| 0);
        let Extent { low, high } = Extent::around(mesh.points.iter(), comm);
        let tolerance = 1e-8 * (0..3).map(|d| high[d] - low[d]).fold(0.0, f64::max);
        let mut seen: Vec<Option<(usize, [f64; 3])>> = vec![None; self.n_kept];
        let mut problem = None;
        for (rank, (list, x)) in numbers.iter().zip(&places).enumerate() {
            for (&(at, _), x) in list.iter().zip(x.chunks_exact(3)) {
                let (g, x) = (self.first_kept + at as i64, [x[0], x[1], x[2]]);
                match seen[at] {
                    Some((before, _)) if before == rank => {
                        problem = Some(format!("point_global of rank {rank} holds {g} twice"));
                    }
                    Some((before, y)) if (0..3).any(|d| (x[d] - y[d]).abs() > tolerance) => {
                        problem = Some(format!(
                            "the point with global number {g} is at {y:?} on rank {before} and at {x:?} on rank \
                             {rank}: expected one place; check point_global"
                        ));
                    }
                    _ => {}
                }
                seen[at] = Some((rank, x));
            }
        }
        if let Some(at) = seen.iter().position(Option::is_none) {
            problem = Some(format!(
                "no rank holds the point with global number {}: expected each of 0 to N - 1",
                self.first_kept + at as i64
            ));
        }
        comm.agree(refuse_any(problem, Error::Mesh, |p| p))
    }

    /// Sends a value for each local point to its keeper: from each rank (place in the block, value).
    fn send(&self, comm: &Comm, globals: &[i64], value: impl Fn(usize) -> i64) -> Vec<Vec<(usize, i64)>> {
        let mut send = vec![Vec::new(); self.size];
        for (p, &g) in globals.iter().enumerate() {
            send[(g / self.block) as usize].extend([g, value(p)]);
        }
        let unpack = |list: Vec<i64>| {
            list.chunks_exact(2).map(|c| ((c[0] - self.first_kept) as usize, c[1])).collect()
        };
        comm.all_to_all(&send).into_iter().map(unpack).collect()
    }

    /// Answers what [`Directory::send`] brought with the keeper's values: one for each local point.
    fn reply(&self, comm: &Comm, globals: &[i64], asked: &[Vec<(usize, i64)>], kept: &[i64]) -> Vec<i64> {
        let answers: Vec<Vec<i64>> =
            asked.iter().map(|list| list.iter().map(|&(at, _)| kept[at]).collect()).collect();
        let mut answers: Vec<_> = comm.all_to_all(&answers).into_iter().map(Vec::into_iter).collect();
        globals.iter().map(|&g| answers[(g / self.block) as usize].next().unwrap_or(-1)).collect()
    }
}
