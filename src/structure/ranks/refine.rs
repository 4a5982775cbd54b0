//! Moves and exchanges of segments that take work from the ranks that have most.

use super::graph::SegmentGraph;

/// What a cut edge costs the ranks on both its sides, in nodes: a ghost is received, and its row of the network's
/// first layers computed.
const GHOST: f64 = 1.0;

/// Ranks count by this power of their work over their share: the slowest decides, the others as far as they are near.
const POWER: i32 = 8;

/// Sweeps over all segments at most; they end when nothing changes.
const SWEEPS: usize = 50;

/// An assignment with each rank's work.
struct State<'g, 'r> {
    graph: &'g SegmentGraph<'g>,
    ranks: &'r mut [i32],
    /// Nodes and ghosts of each rank.
    work: Vec<f64>,
    /// Segments of each rank.
    members: Vec<Vec<usize>>,
}

impl SegmentGraph<'_> {
    /// Moves segments to other ranks, or exchanges two, as long as that makes the work more even.
    pub fn improve(&self, ranks: &mut [i32]) {
        let mut state = State::new(self, ranks);
        for _ in 0..SWEEPS {
            let mut changed = false;
            for segment in 0..self.sizes.len() {
                changed |= state.improve(segment);
            }
            if !changed {
                return;
            }
        }
    }

    /// Largest work over its rank's share, and the cut: less is better.
    pub fn judge(&self, ranks: &[i32]) -> (f64, f64) {
        let mut copy = ranks.to_vec();
        let state = State::new(self, &mut copy);
        let relative = state.work.iter().zip(&self.shares).map(|(w, s)| w / s);
        // Equal to rounding is equal.
        let most = relative.fold(0.0, f64::max);
        ((most * 1e9).round() / 1e9, self.report(ranks).cut)
    }
}

impl<'g, 'r> State<'g, 'r> {
    fn new(graph: &'g SegmentGraph<'g>, ranks: &'r mut [i32]) -> Self {
        let np = graph.shares.len();
        let mut work = vec![0.0; np];
        let mut members = vec![Vec::new(); np];
        for (segment, &rank) in ranks.iter().enumerate() {
            members[rank as usize].push(segment);
            work[rank as usize] += graph.sizes[segment];
            for (other, edges) in graph.neighbours(segment) {
                if ranks[other] != rank {
                    work[rank as usize] += GHOST * edges;
                }
            }
        }
        State { graph, ranks, work, members }
    }

    fn rank(&self, segment: usize) -> usize {
        self.ranks[segment] as usize
    }

    fn cost(&self, rank: usize, change: f64) -> f64 {
        ((self.work[rank] + change) / self.graph.shares[rank]).powi(POWER)
    }

    /// Edges of a segment: to rank `a`, to rank `b`, and to all others.
    fn edges(&self, segment: usize, a: usize, b: usize) -> [f64; 3] {
        let mut found = [0.0; 3];
        for (other, edges) in self.graph.neighbours(segment) {
            let place = match self.rank(other) {
                r if r == a => 0,
                r if r == b => 1,
                _ => 2,
            };
            found[place] += edges;
        }
        found
    }

    /// What the two ranks' work changes by when the segment goes to rank `to`.
    fn moved(&self, segment: usize, to: usize) -> (f64, f64) {
        let size = self.graph.sizes[segment];
        let [own, there, rest] = self.edges(segment, self.rank(segment), to);
        (GHOST * (own - there - rest) - size, GHOST * (own - there + rest) + size)
    }

    /// The best move or exchange of a segment, done if it is one.
    fn improve(&mut self, segment: usize) -> bool {
        let from = self.rank(segment);
        let mut best = (-1e-9 * self.cost(from, 0.0).max(1.0), None);
        for to in self.candidates(segment) {
            let (left, added) = self.moved(segment, to);
            let now = self.cost(from, 0.0) + self.cost(to, 0.0);
            if self.members[from].len() > 1 {
                let gain = self.cost(from, left) + self.cost(to, added) - now;
                if gain < best.0 {
                    best = (gain, Some((to, None)));
                }
            }
            for &other in self.members[to].iter() {
                let (back, taken) = self.moved(other, from);
                // The edges between the two stay cut, though each by itself would have mended them.
                let shared: f64 = self
                    .graph
                    .neighbours(segment)
                    .filter(|&(o, _)| o == other)
                    .map(|(_, e)| 2.0 * GHOST * e)
                    .sum();
                let gain =
                    self.cost(from, left + taken + shared) + self.cost(to, added + back + shared) - now;
                if gain < best.0 {
                    best = (gain, Some((to, Some(other))));
                }
            }
        }
        let Some((to, back)) = best.1 else {
            return false;
        };
        self.go(segment, to);
        if let Some(other) = back {
            self.go(other, from);
        }
        true
    }

    /// Ranks that a segment may go to: its neighbours', and all if its own is the slowest.
    fn candidates(&self, segment: usize) -> Vec<usize> {
        let from = self.rank(segment);
        let np = self.work.len();
        let relative = |r: usize| self.work[r] / self.graph.shares[r];
        let mut ranks: Vec<usize> = match (0..np).any(|r| relative(r) > relative(from)) {
            true => self.graph.neighbours(segment).map(|(o, _)| self.rank(o)).collect(),
            false => (0..np).collect(),
        };
        ranks.sort_unstable();
        ranks.dedup();
        ranks.retain(|&r| r != from);
        ranks
    }

    fn go(&mut self, segment: usize, to: usize) {
        let from = self.rank(segment);
        let (left, added) = self.moved(segment, to);
        self.work[from] += left;
        self.work[to] += added;
        self.members[from].retain(|&s| s != segment);
        self.members[to].push(segment);
        self.ranks[segment] = to as i32;
    }
}
