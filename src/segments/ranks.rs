//! Which rank a segment lives on: METIS on the graph of segments, so that no segment straddles ranks.
//!
//! Vertex weights are the segments' node counts, edge weights the mesh edges that two segments share. METIS is asked
//! several times (both of its algorithms, a few seeds: the graph is tiny); what it gives is balanced to
//! [`TOLERANCE`] where whole segments allow it, and of the balanced answers the one with the fewest cut edges wins.
//! The answer is a function of the arguments alone.

use super::partition::METIS_TURN;
use crate::{Error, Result};

/// A rank may have this many times its share of nodes; more is mended at the cost of cut edges.
pub const TOLERANCE: f64 = 1.05;

/// Seeds of METIS's random choices that are tried.
const SEEDS: std::ops::Range<i32> = 1..9;

/// METIS counts in 32 bits: sums of weights are scaled to stay below this.
const LARGEST_SUM: f64 = (1 << 30) as f64;

/// How good an assignment is.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Nodes of each rank.
    pub loads: Vec<f64>,
    /// Segments of each rank.
    pub segments: Vec<usize>,
    /// Mesh edges (faces) between segments of different ranks.
    pub cut: f64,
    /// Largest load over that rank's share, 1 for a perfect balance.
    pub imbalance: f64,
}

/// The rank of each of the K segments; every rank has at least one.
///
/// `sizes` are the node counts `[K]`, `adjacency` `[K x K]` the directed edges from one segment to another as in
/// [`super::Segmentation::adjacency`] (the diagonal is not looked at), `rank_weights` the shares of the ranks
/// `[NP]`, of any sum.
///
/// # Errors
/// [`Error::Input`] if there are fewer segments than ranks, if lengths do not fit, or if a number is not finite, a
/// size or an edge count is negative, or a rank's weight is not positive.
pub fn assign(sizes: &[f64], adjacency: &[f64], rank_weights: &[f64]) -> Result<Vec<i32>> {
    assign_with(sizes, adjacency, rank_weights, &vec![-1; sizes.len()])
}

/// [`assign`] with some segments bound to a rank: `fixed` `[K]` gives it, -1 for a free segment.
///
/// # Errors
/// As [`assign`]; [`Error::Input`] too if a rank of `fixed` is none, or if the free segments are too few for the ranks
/// to which none is bound.
pub fn assign_with(
    sizes: &[f64],
    adjacency: &[f64],
    rank_weights: &[f64],
    fixed: &[i32],
) -> Result<Vec<i32>> {
    let mut graph = SegmentGraph::new(sizes, adjacency, rank_weights)?;
    let (k, np) = (sizes.len(), rank_weights.len());
    check_fixed(fixed, k, np)?;
    graph.fixed = fixed;
    if np == 1 {
        return Ok(vec![0; k]);
    }
    let mut candidates = vec![graph.greedy()];
    // With hardly more vertices than parts METIS bisects empty graphs, and says so on the solver's stdout.
    if 2 * k >= 3 * np && !graph.column.is_empty() {
        candidates.extend(graph.metis()?);
    }
    let judged = candidates.into_iter().map(|mut ranks| {
        graph.respect_fixed(&mut ranks);
        graph.fill_empty(&mut ranks);
        graph.balance(&mut ranks);
        let report = graph.report(&ranks);
        (report.imbalance, report.cut, ranks)
    });
    let judged: Vec<_> = judged.collect();
    let best = judged.iter().fold(f64::INFINITY, |m, j| m.min(j.0));
    let allowed = best.max(TOLERANCE) * (1.0 + 1e-12);
    judged
        .into_iter()
        .filter(|j| j.0 <= allowed)
        .min_by(|a, b| {
            (a.1, a.0)
                .partial_cmp(&(b.1, b.0))
                .unwrap_or(std::cmp::Ordering::Equal)
        })
        .map(|j| j.2)
        .ok_or_else(|| Error::Internal("no assignment of segments to ranks".into()))
}

/// Loads, cut and imbalance of an assignment; arguments as for [`assign`], `ranks` from 0 to NP - 1.
pub fn report(sizes: &[f64], adjacency: &[f64], rank_weights: &[f64], ranks: &[i32]) -> Result<Report> {
    let graph = SegmentGraph::new(sizes, adjacency, rank_weights)?;
    let np = rank_weights.len();
    if ranks.len() != sizes.len() || ranks.iter().any(|&r| r < 0 || r as usize >= np) {
        return Err(Error::Input(format!(
            "ranks of {} segments: expected {} numbers from 0 to {}",
            sizes.len(),
            sizes.len(),
            np - 1
        )));
    }
    Ok(graph.report(ranks))
}

/// The undirected graph of segments in compressed rows, and each rank's share of the nodes.
struct SegmentGraph<'a> {
    sizes: &'a [f64],
    /// Rank that a segment is bound to, -1 for none.
    fixed: &'a [i32],
    /// Nodes that each rank should have.
    shares: Vec<f64>,
    row: Vec<usize>,
    column: Vec<usize>,
    /// Mesh edges between the two segments.
    weight: Vec<f64>,
}

impl<'a> SegmentGraph<'a> {
    fn new(sizes: &'a [f64], adjacency: &[f64], rank_weights: &[f64]) -> Result<Self> {
        let (k, np) = (sizes.len(), rank_weights.len());
        check(sizes, adjacency, rank_weights)?;
        let total: f64 = sizes.iter().sum();
        let weights: f64 = rank_weights.iter().sum();
        let mut graph = SegmentGraph {
            sizes,
            fixed: &[],
            shares: rank_weights.iter().map(|w| total * w / weights).collect(),
            row: Vec::with_capacity(k + 1),
            column: Vec::new(),
            weight: Vec::new(),
        };
        graph.row.push(0);
        for a in 0..k {
            for b in (0..k).filter(|&b| b != a) {
                let shared = 0.5 * (adjacency[a * k + b] + adjacency[b * k + a]);
                if shared > 0.0 {
                    graph.column.push(b);
                    graph.weight.push(shared);
                }
            }
            graph.row.push(graph.column.len());
        }
        debug_assert_eq!(graph.shares.len(), np);
        Ok(graph)
    }

    fn neighbours(&self, segment: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.row[segment]..self.row[segment + 1];
        range.map(|e| (self.column[e], self.weight[e]))
    }

    /// METIS's answers that it did not fail on.
    fn metis(&self) -> Result<Vec<Vec<i32>>> {
        let scaled = |values: &[f64]| -> Vec<i32> {
            let sum: f64 = values.iter().sum();
            let factor = (LARGEST_SUM / sum.max(1.0)).min(1.0);
            values
                .iter()
                .map(|v| ((v * factor).round() as i32).max(1))
                .collect()
        };
        let index = |values: &[usize]| -> Vec<i32> { values.iter().map(|&v| v as i32).collect() };
        let (row, column) = (index(&self.row), index(&self.column));
        let (nodes, edges) = (scaled(self.sizes), scaled(&self.weight));
        let total: f64 = self.shares.iter().sum();
        let targets: Vec<f32> = self.shares.iter().map(|s| (s / total) as f32).collect();
        let mut answers = Vec::new();
        let _turn = METIS_TURN.lock().unwrap_or_else(|e| e.into_inner());
        for seed in SEEDS {
            for recursive in [true, false] {
                let mut ranks = vec![0i32; self.sizes.len()];
                let graph = metis::Graph::new(1, targets.len() as i32, &row, &column)
                    .map_err(|e| {
                        Error::Internal(format!("METIS does not accept the graph of segments: {e}"))
                    })?
                    .set_vwgt(&nodes)
                    .set_adjwgt(&edges)
                    .set_tpwgts(&targets)
                    .set_option(metis::option::Seed(seed));
                let done = match recursive {
                    true => graph.part_recursive(&mut ranks),
                    false => graph.part_kway(&mut ranks),
                };
                if done.is_ok() && ranks.iter().all(|&r| r >= 0 && (r as usize) < targets.len()) {
                    answers.push(ranks);
                }
            }
        }
        Ok(answers)
    }

    /// Segments from large to small, each to the rank with the most room for it; of ranks with about as much room to
    /// the one with most edges to it.
    fn greedy(&self) -> Vec<i32> {
        let mut order: Vec<usize> = (0..self.sizes.len()).collect();
        order.sort_by(|&a, &b| self.sizes[b].total_cmp(&self.sizes[a]).then(a.cmp(&b)));
        let np = self.shares.len();
        let mut ranks = vec![-1i32; self.sizes.len()];
        let mut loads = vec![0.0; np];
        for segment in order {
            let after = |r: usize| (loads[r] + self.sizes[segment]) / self.shares[r];
            let lowest = (0..np).map(after).fold(f64::INFINITY, f64::min);
            let mut shared = vec![0.0; np];
            for (other, weight) in self.neighbours(segment) {
                if let Ok(r) = usize::try_from(ranks[other]) {
                    shared[r] += weight;
                }
            }
            let room = (0..np).filter(|&r| after(r) <= lowest * (1.0 + 1e-9));
            let chosen = room.fold(None, |best: Option<usize>, r| match best {
                Some(b) if shared[b] >= shared[r] => Some(b),
                _ => Some(r),
            });
            let chosen = chosen.unwrap_or(0);
            loads[chosen] += self.sizes[segment];
            ranks[segment] = chosen as i32;
        }
        ranks
    }

    fn is_free(&self, segment: usize) -> bool {
        self.fixed[segment] < 0
    }

    /// Renames the ranks so that bound segments are mostly where they belong, and moves the others there.
    fn respect_fixed(&self, ranks: &mut [i32]) {
        let np = self.shares.len();
        let bound: Vec<usize> = (0..ranks.len()).filter(|&s| !self.is_free(s)).collect();
        if bound.is_empty() {
            return;
        }
        // Nodes that part `from` has of what belongs to rank `to`; only parts of the same share are exchanged.
        let mut overlap: Vec<(f64, usize, usize)> = Vec::new();
        for &s in &bound {
            let (from, to) = (ranks[s] as usize, self.fixed[s] as usize);
            match overlap.iter_mut().find(|o| (o.1, o.2) == (from, to)) {
                Some(o) => o.0 += self.sizes[s],
                None => overlap.push((self.sizes[s], from, to)),
            }
        }
        overlap.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut name: Vec<usize> = (0..np).collect();
        let mut settled = vec![false; np];
        for (_, from, to) in overlap {
            let other = name.iter().position(|&n| n == to).unwrap_or(from);
            let same_share = (self.shares[name[from]] - self.shares[to]).abs() <= 1e-9 * self.shares[to];
            if !settled[from] && !settled[other] && same_share {
                name.swap(from, other);
                settled[from] = true;
            }
        }
        for (s, rank) in ranks.iter_mut().enumerate() {
            *rank = match self.is_free(s) {
                true => name[*rank as usize] as i32,
                false => self.fixed[s],
            };
        }
    }

    /// Gives each rank without a segment one of a rank that has several, with the least new cut.
    fn fill_empty(&self, ranks: &mut [i32]) {
        let mut counts = vec![0usize; self.shares.len()];
        ranks.iter().for_each(|&r| counts[r as usize] += 1);
        for empty in 0..counts.len() {
            if counts[empty] > 0 {
                continue;
            }
            let held = |s: usize| -> f64 {
                let own = self.neighbours(s).filter(|&(o, _)| ranks[o] == ranks[s]);
                own.map(|(_, w)| w).sum()
            };
            let rich = |s: usize| counts[ranks[s] as usize];
            let movable = (0..ranks.len()).filter(|&s| self.is_free(s) && rich(s) > 1);
            let order = |a: &usize, b: &usize| {
                let most = rich(*b).cmp(&rich(*a));
                most.then(held(*a).total_cmp(&held(*b))).then(a.cmp(b))
            };
            let Some(segment) = movable.min_by(order) else {
                return;
            };
            counts[ranks[segment] as usize] -= 1;
            counts[empty] = 1;
            ranks[segment] = empty as i32;
        }
    }

    /// Moves a segment away from the most loaded rank, or exchanges it for a smaller one, as long as that lowers the
    /// larger of the two loads and the balance is not good enough.
    fn balance(&self, ranks: &mut [i32]) {
        let np = self.shares.len();
        for _ in 0..4 * ranks.len() {
            let report = self.report(ranks);
            if report.imbalance <= TOLERANCE {
                return;
            }
            let relative = |r: usize, change: f64| (report.loads[r] + change) / self.shares[r];
            let full = (0..np)
                .max_by(|&a, &b| relative(a, 0.0).total_cmp(&relative(b, 0.0)).then(b.cmp(&a)))
                .unwrap_or(0);
            // (larger load of the two afterwards, added cut, segment, its new rank, what comes back)
            let mut best: Option<(f64, f64, usize, usize, Option<usize>)> = None;
            let mut consider = |load: f64, cut: f64, segment: usize, to: usize, back: Option<usize>| {
                if load < relative(full, 0.0) * (1.0 - 1e-9) && best.is_none_or(|b| (load, cut) < (b.0, b.1))
                {
                    best = Some((load, cut, segment, to, back));
                }
            };
            let leaving = (0..ranks.len()).filter(|&s| ranks[s] as usize == full && self.is_free(s));
            for segment in leaving {
                let size = self.sizes[segment];
                if report.segments[full] > 1 {
                    for to in (0..np).filter(|&r| r != full) {
                        let load = relative(full, -size).max(relative(to, size));
                        consider(load, self.added_cut(ranks, segment, to), segment, to, None);
                    }
                }
                let smaller = (0..ranks.len())
                    .filter(|&o| ranks[o] as usize != full && self.is_free(o) && self.sizes[o] < size);
                for other in smaller {
                    let (to, change) = (ranks[other] as usize, size - self.sizes[other]);
                    let load = relative(full, -change).max(relative(to, change));
                    let cut = self.added_cut(ranks, segment, to) + self.added_cut(ranks, other, full);
                    consider(load, cut, segment, to, Some(other));
                }
            }
            let Some((_, _, segment, to, back)) = best else {
                return;
            };
            ranks[segment] = to as i32;
            if let Some(other) = back {
                ranks[other] = full as i32;
            }
        }
    }

    /// Cut edges more if this segment goes to rank `to`.
    fn added_cut(&self, ranks: &[i32], segment: usize, to: usize) -> f64 {
        let gain = |(other, weight): (usize, f64)| match ranks[other] {
            r if r == ranks[segment] => weight,
            r if r as usize == to => -weight,
            _ => 0.0,
        };
        self.neighbours(segment).map(gain).sum()
    }

    fn report(&self, ranks: &[i32]) -> Report {
        let np = self.shares.len();
        let mut report = Report {
            loads: vec![0.0; np],
            segments: vec![0; np],
            cut: 0.0,
            imbalance: 0.0,
        };
        for (segment, &rank) in ranks.iter().enumerate() {
            report.loads[rank as usize] += self.sizes[segment];
            report.segments[rank as usize] += 1;
            let across = self
                .neighbours(segment)
                .filter(|&(o, _)| o > segment && ranks[o] != rank);
            report.cut += across.map(|(_, w)| w).sum::<f64>();
        }
        let relative = report.loads.iter().zip(&self.shares).map(|(l, s)| l / s);
        report.imbalance = relative.fold(0.0, f64::max);
        report
    }
}

fn check_fixed(fixed: &[i32], k: usize, np: usize) -> Result<()> {
    if fixed.len() != k || fixed.iter().any(|&r| r < -1 || r >= np as i32) {
        return Err(Error::Input(format!(
            "segments bound to ranks: expected {k} numbers from -1 (free) to {}",
            np - 1
        )));
    }
    let free = fixed.iter().filter(|&&r| r < 0).count();
    let without = (0..np as i32).filter(|r| !fixed.contains(r)).count();
    if free < without {
        return Err(Error::Input(format!(
            "{without} of {np} ranks have no segment bound to them and only {free} segments are free: raise segments, \
             or bind fewer of them"
        )));
    }
    Ok(())
}

fn check(sizes: &[f64], adjacency: &[f64], rank_weights: &[f64]) -> Result<()> {
    let (k, np) = (sizes.len(), rank_weights.len());
    if np == 0 || adjacency.len() != k * k {
        return Err(Error::Input(format!(
            "segments to ranks: {k} sizes, {} edge counts, {np} rank weights; expected K sizes, K x K counts and at \
             least one rank",
            adjacency.len()
        )));
    }
    let number = |v: &f64| v.is_finite() && *v >= 0.0;
    if !sizes.iter().all(number) || !adjacency.iter().all(number) || sizes.iter().sum::<f64>() <= 0.0 {
        return Err(Error::Input(
            "segments to ranks: expected finite sizes and edge counts, not negative, and some node".into(),
        ));
    }
    if let Some(rank) = rank_weights.iter().position(|w| !(w.is_finite() && *w > 0.0)) {
        return Err(Error::Input(format!(
            "the weight of rank {rank} is {}: expected a positive finite number",
            rank_weights[rank]
        )));
    }
    if k < np {
        return Err(Error::Input(format!(
            "{k} segments for {np} ranks: each rank needs at least one whole segment; raise segments to {np} or more, \
             or use fewer ranks"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Directed edge counts of a ring of `k` segments that share `weight` edges each.
    fn ring(k: usize, weight: f64) -> Vec<f64> {
        let mut a = vec![0.0; k * k];
        for i in 0..k {
            let j = (i + 1) % k;
            a[i * k + j] = weight;
            a[j * k + i] = weight;
        }
        a
    }

    #[test]
    fn a_ring_is_cut_into_arcs() {
        let (k, np) = (12, 3);
        let ranks = assign(&[10.0; 12], &ring(k, 5.0), &vec![1.0; np]).unwrap();
        let report = report(&[10.0; 12], &ring(k, 5.0), &vec![1.0; np], &ranks).unwrap();
        assert_eq!(report.loads, [40.0; 3]);
        assert_eq!(report.segments, [4; 3]);
        // Three arcs have three ends.
        assert_eq!((report.cut, report.imbalance), (15.0, 1.0));
    }

    #[test]
    fn shares_follow_the_weights() {
        let ranks = assign(&[10.0; 12], &ring(12, 5.0), &[2.0, 1.0]).unwrap();
        let report = report(&[10.0; 12], &ring(12, 5.0), &[2.0, 1.0], &ranks).unwrap();
        assert_eq!(report.loads, [80.0, 40.0]);
        assert_eq!((report.cut, report.imbalance), (10.0, 1.0));
    }

    #[test]
    fn no_rank_is_empty_for_any_number_of_segments() {
        for np in 1..7 {
            for k in np..14 {
                let sizes: Vec<f64> = (0..k).map(|i| 1.0 + (i * i % 7) as f64).collect();
                for adjacency in [ring(k, 3.0), vec![0.0; k * k]] {
                    let ranks = assign(&sizes, &adjacency, &vec![1.0; np]).unwrap();
                    assert!(
                        (0..np as i32).all(|r| ranks.contains(&r)),
                        "{k} on {np}: {ranks:?}"
                    );
                    assert_eq!(ranks, assign(&sizes, &adjacency, &vec![1.0; np]).unwrap());
                }
            }
        }
    }

    #[test]
    fn as_many_segments_as_ranks_are_matched_by_size() {
        let ranks = assign(&[10.0, 30.0, 20.0], &ring(3, 1.0), &[3.0, 2.0, 1.0]).unwrap();
        assert_eq!(ranks, [2, 0, 1]);
    }

    #[test]
    fn a_large_segment_does_not_get_company() {
        // 6 + 2 x 3: the balance of 6 : 6 goes before the edges.
        let mut a = vec![0.0; 9];
        (a[1], a[3]) = (100.0, 100.0);
        let ranks = assign(&[6.0, 3.0, 3.0], &a, &[1.0, 1.0]).unwrap();
        assert_eq!(ranks[1], ranks[2]);
        assert_ne!(ranks[0], ranks[1]);
    }

    #[test]
    fn a_grid_of_segments_is_balanced_and_its_cut_small() {
        // 8 x 8 segments on 4 ranks: the best is four squares with 16 cut edges.
        let (n, k) = (8, 64);
        let mut a = vec![0.0; k * k];
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            for (x, y) in [(i + 1, j), (i, j + 1)] {
                if x < n && y < n {
                    let (p, q) = (i * n + j, x * n + y);
                    (a[p * k + q], a[q * k + p]) = (1.0, 1.0);
                }
            }
        }
        let ranks = assign(&vec![7.0; k], &a, &[1.0; 4]).unwrap();
        let report = report(&vec![7.0; k], &a, &[1.0; 4], &ranks).unwrap();
        assert!(report.imbalance <= TOLERANCE, "{report:?}");
        assert!(report.cut <= 20.0, "{report:?}");
    }

    #[test]
    fn bound_segments_stay_where_they_are_bound() {
        // Opposite ends of the ring, and a pair whose cheapest place would be with them.
        let mut fixed = vec![-1; 12];
        (fixed[0], fixed[1], fixed[6]) = (2, 2, 0);
        let ranks = assign_with(&[10.0; 12], &ring(12, 5.0), &[1.0; 3], &fixed).unwrap();
        assert_eq!((ranks[0], ranks[1], ranks[6]), (2, 2, 0));
        let found = report(&[10.0; 12], &ring(12, 5.0), &[1.0; 3], &ranks).unwrap();
        assert_eq!((found.loads, found.cut), (vec![40.0; 3], 15.0));
        // All on one rank but one: the other rank has that one.
        let fixed = [0, 0, 0, -1];
        assert_eq!(
            assign_with(&[1.0; 4], &ring(4, 1.0), &[1.0; 2], &fixed).unwrap(),
            [0, 0, 0, 1]
        );
        let refused = assign_with(&[1.0; 4], &ring(4, 1.0), &[1.0; 3], &fixed).unwrap_err();
        assert!(
            refused.to_string().contains("only 1 segments are free"),
            "{refused}"
        );
        assert!(assign_with(&[1.0; 4], &ring(4, 1.0), &[1.0; 2], &[0, 0, 2, -1]).is_err());
    }

    #[test]
    fn bad_input_is_said() {
        let message = |r: Result<Vec<i32>>| r.unwrap_err().to_string();
        assert!(message(assign(&[1.0; 3], &ring(3, 1.0), &[1.0; 4])).contains("raise segments to 4"));
        assert!(message(assign(&[1.0; 3], &ring(3, 1.0), &[1.0, 0.0])).contains("weight of rank 1"));
        assert!(matches!(
            assign(&[1.0; 3], &[0.0; 4], &[1.0]),
            Err(Error::Input(_))
        ));
        assert!(matches!(
            assign(&[1.0; 3], &ring(3, 1.0), &[]),
            Err(Error::Input(_))
        ));
        assert!(matches!(
            assign(&[f64::NAN; 3], &ring(3, 1.0), &[1.0]),
            Err(Error::Input(_))
        ));
        assert!(matches!(
            report(&[1.0; 3], &ring(3, 1.0), &[1.0], &[0, 0, 1]),
            Err(Error::Input(_))
        ));
    }
}
