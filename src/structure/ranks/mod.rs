//! Which rank a segment lives on: METIS on the graph of segments, so that no segment straddles ranks.
//!
//! Vertex weights are the segments' node counts, edge weights the mesh edges that two segments share. Segments are few
//! and large, and METIS alone leaves ranks with one too many; so it is asked several times (both of its algorithms,
//! several tolerances and seeds), each answer is improved by moving and exchanging segments, and the best is taken: the
//! one whose slowest rank has least work. Work are the nodes of a rank and its ghosts, one a cut edge. The answer is a
//! function of the arguments alone.

mod graph;
mod refine;

use graph::SegmentGraph;
use m4gn_base::{Error, Result, refuse_any};

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

/// Of the answers of METIS on a large graph, this many are improved.
const IMPROVED: usize = 4;

/// Graphs of at most this many segments are small: every answer of METIS is improved.
const SMALL: usize = 512;

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
    let graph = SegmentGraph::new(sizes, adjacency, rank_weights)?;
    let (k, np) = (sizes.len(), rank_weights.len());
    if np == 1 {
        return Ok(vec![0; k]);
    }
    let mut candidates = vec![graph.greedy()];
    // With hardly more vertices than parts METIS bisects empty graphs, and says so on the solver's stdout.
    if 2 * k >= 3 * np && graph.has_edges() {
        candidates.extend(graph.metis()?);
    }
    for ranks in &mut candidates {
        graph.fill_empty(ranks);
    }
    candidates.sort();
    candidates.dedup();
    if k > SMALL {
        sort_by_key(&mut candidates, |ranks| graph.judge(ranks));
        candidates.truncate(IMPROVED);
    }
    for ranks in &mut candidates {
        graph.improve(ranks);
    }
    sort_by_key(&mut candidates, |ranks| graph.judge(ranks));
    candidates.into_iter().next().ok_or_else(|| Error::Internal("no assignment of segments to ranks".into()))
}

/// Stable, so that equals stay in order.
fn sort_by_key(candidates: &mut Vec<Vec<i32>>, key: impl Fn(&[i32]) -> (f64, f64)) {
    let mut keyed: Vec<_> = candidates.drain(..).map(|c| (key(&c), c)).collect();
    keyed.sort_by(|(a, _), (b, _)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    candidates.extend(keyed.into_iter().map(|(_, c)| c));
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
    refuse_any(rank_weights.iter().position(|w| !(w.is_finite() && *w > 0.0)), Error::Input, |rank| {
        format!("the weight of rank {rank} is {}: expected a positive finite number", rank_weights[rank])
    })?;
    if k < np {
        return Err(Error::Input(format!(
            "{k} segments for {np} ranks: each rank needs at least one whole segment; raise segments to {np} or more, \
             or use fewer ranks"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
