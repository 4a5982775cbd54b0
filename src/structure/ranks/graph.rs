//! The graph of segments, and first answers to where they should live.

use super::super::partition::METIS_TURN;
use super::Report;
use m4gn_base::{Error, Result};

/// Seeds of METIS's random choices that are tried.
const SEEDS: std::ops::Range<i32> = 1..6;

/// Imbalances that METIS may allow, in thousandths.
const TOLERANCES: [i32; 3] = [30, 100, 200];

/// METIS counts in 32 bits: sums of weights are scaled to stay below this.
const LARGEST_SUM: f64 = (1 << 30) as f64;

/// The undirected graph of segments, and each rank's share of the nodes.
pub(super) struct SegmentGraph<'a> {
    pub sizes: &'a [f64],
    /// Nodes that each rank should have.
    pub shares: Vec<f64>,
    /// Segments that share mesh edges with each, and how many.
    near: Vec<Vec<(usize, f64)>>,
}

impl<'a> SegmentGraph<'a> {
    pub fn new(sizes: &'a [f64], adjacency: &[f64], rank_weights: &[f64]) -> Result<Self> {
        let k = sizes.len();
        super::check(sizes, adjacency, rank_weights)?;
        let total: f64 = sizes.iter().sum();
        let weights: f64 = rank_weights.iter().sum();
        let shared = |a: usize, b: usize| 0.5 * (adjacency[a * k + b] + adjacency[b * k + a]);
        let near = |a: usize| {
            let others = (0..k).filter(|&b| b != a).map(|b| (b, shared(a, b)));
            others.filter(|(_, shared)| *shared > 0.0).collect()
        };
        Ok(SegmentGraph {
            sizes,
            shares: rank_weights.iter().map(|w| total * w / weights).collect(),
            near: (0..k).map(near).collect(),
        })
    }

    pub fn has_edges(&self) -> bool {
        self.near.iter().any(|near| !near.is_empty())
    }

    /// Segments that share edges with this one, and how many.
    pub fn neighbours(&self, segment: usize) -> impl Iterator<Item = (usize, f64)> {
        self.near[segment].iter().copied()
    }

    /// METIS's answers that it did not fail on.
    pub fn metis(&self) -> Result<Vec<Vec<i32>>> {
        let scaled = |values: &[f64]| -> Vec<i32> {
            let sum: f64 = values.iter().sum();
            let factor = (LARGEST_SUM / sum.max(1.0)).min(1.0);
            values.iter().map(|v| ((v * factor).round() as i32).max(1)).collect()
        };
        let (column, weight): (Vec<i32>, Vec<f64>) =
            self.near.iter().flatten().map(|&(b, shared)| (b as i32, shared)).unzip();
        let ends = self.near.iter().scan(0, |end, near| {
            *end += near.len() as i32;
            Some(*end)
        });
        let row: Vec<i32> = std::iter::once(0).chain(ends).collect();
        let (nodes, edges) = (scaled(self.sizes), scaled(&weight));
        let total: f64 = self.shares.iter().sum();
        let targets: Vec<f32> = self.shares.iter().map(|s| (s / total) as f32).collect();
        let mut answers = Vec::new();
        let _turn = METIS_TURN.lock().unwrap_or_else(|e| e.into_inner());
        for (seed, tolerance) in SEEDS.flat_map(|s| TOLERANCES.map(|t| (s, t))) {
            for recursive in [true, false] {
                let mut ranks = vec![0i32; self.sizes.len()];
                let graph = metis::Graph::new(1, targets.len() as i32, &row, &column)
                    .map_err(|e| {
                        Error::Internal(format!("METIS does not accept the graph of segments: {e}"))
                    })?
                    .set_vwgt(&nodes)
                    .set_adjwgt(&edges)
                    .set_tpwgts(&targets)
                    .set_option(metis::option::Seed(seed))
                    .set_option(metis::option::UFactor(tolerance));
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
    pub fn greedy(&self) -> Vec<i32> {
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

    /// Gives each rank without a segment one of a rank that has several, with the least new cut.
    pub fn fill_empty(&self, ranks: &mut [i32]) {
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
            let movable = (0..ranks.len()).filter(|&s| rich(s) > 1);
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

    pub fn report(&self, ranks: &[i32]) -> Report {
        let np = self.shares.len();
        let mut report = Report { loads: vec![0.0; np], segments: vec![0; np], cut: 0.0, imbalance: 0.0 };
        for (segment, &rank) in ranks.iter().enumerate() {
            report.loads[rank as usize] += self.sizes[segment];
            report.segments[rank as usize] += 1;
            let across = self.neighbours(segment).filter(|&(o, _)| o > segment && ranks[o] != rank);
            report.cut += across.map(|(_, w)| w).sum::<f64>();
        }
        let relative = report.loads.iter().zip(&self.shares).map(|(l, s)| l / s);
        report.imbalance = relative.fold(0.0, f64::max);
        report
    }
}
