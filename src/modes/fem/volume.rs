//! Whose volume average a point's surroundings belong to.
//!
//! A point has an average of its own unless at least half of its cells are cells of a point with more cells, or all of
//! them are cells of another point: points at faces, edges and corners of a body, then. Their surroundings join the
//! average of that point, the one with which they have the most cells in common. So there are about as many volume
//! constraints as points inside the body, whatever the cells; with one more for each point of the surface, bodies a few
//! cells thick lock as nu approaches 1/2.

use super::mesh::Cell;
use super::numbering::{Numbering, take};
use m4gn_parallel::Comm;
use std::collections::BTreeMap;

/// For a point the numbers of the points whose averages have its surroundings, ascending, and their shares, of sum 1.
pub(super) type Shares = Vec<(i64, f64)>;

/// The shares of each local point; empty for those that carry no unknowns. The choice does not depend on ranks.
/// Collective.
pub(super) fn averages(cells: &[Cell], globals: &[i64], numbering: &Numbering, comm: &Comm) -> Vec<Shares> {
    let n = globals.len();
    let mut around = vec![Vec::new(); n];
    for (c, cell) in cells.iter().enumerate() {
        for &p in &cell.points {
            around[p].push(c);
        }
    }
    let local: Vec<usize> = (0..n).filter(|&p| numbering.number[p].is_some()).collect();
    let numbers: Vec<i64> = local.iter().filter_map(|&p| numbering.number[p]).collect();
    let counts: Vec<f64> = local.iter().map(|&p| around[p].len() as f64).collect();
    let own_totals = numbering.sum_at_owner(comm, &numbers, &counts, 1);
    let mut total = vec![0i64; n];
    for (&p, t) in local.iter().zip(numbering.fetch(comm, &numbers, &own_totals, 1)) {
        total[p] = t as i64;
    }
    // Cells that points share with those that may have their averages: (number, total, shared) for each.
    let mut send = vec![Vec::new(); comm.size() as usize];
    for (&p, &number) in local.iter().zip(&numbers) {
        let mut shared = BTreeMap::new();
        for &q in around[p].iter().flat_map(|&c| &cells[c].points) {
            if (total[q], -globals[q]) > (total[p], -globals[p]) {
                *shared.entry(q).or_insert(0i64) += 1;
            }
        }
        let list = &mut send[numbering.owner(number)];
        list.extend([number, shared.len() as i64]);
        for (q, count) in shared {
            list.extend([numbering.number[q].unwrap_or(-1), total[q], count]);
        }
    }
    let mut found: Vec<BTreeMap<i64, (i64, i64)>> = vec![BTreeMap::new(); numbering.owned.len()];
    for list in comm.all_to_all(&send) {
        let mut rest = &list[..];
        while let [number, count, tail @ ..] = rest {
            let (entries, tail) = tail.split_at(3 * *count as usize);
            let of_point = &mut found[(number - numbering.first_own()) as usize];
            for entry in entries.chunks_exact(3) {
                let (shared, _) = of_point.entry(entry[0]).or_insert((0, entry[1]));
                *shared += entry[2];
            }
            rest = tail;
        }
    }
    let mut shares: Vec<Shares> = found
        .iter()
        .zip(&own_totals)
        .enumerate()
        .map(|(i, (candidates, &total))| {
            first_shares(numbering.first_own() + i as i64, total as i64, candidates)
        })
        .collect();
    follow(&mut shares, numbering, comm);
    let mut all = vec![Vec::new(); n];
    for (&p, list) in local.iter().zip(fetch(&numbers, &shares, numbering, comm)) {
        all[p] = list;
    }
    all
}

/// The points that take over point `own` of `total` cells, from the cells that it shares with each and their totals.
fn first_shares(own: i64, total: i64, candidates: &BTreeMap<i64, (i64, i64)>) -> Shares {
    let takes = |&(shared, theirs): &(i64, i64)| shared == total || theirs > total && 2 * shared >= total;
    let Some(most) = candidates.values().copied().filter(takes).max() else {
        return vec![(own, 1.0)];
    };
    let equal: Vec<i64> = candidates.iter().filter(|c| *c.1 == most).map(|c| *c.0).collect();
    let share = 1.0 / equal.len() as f64;
    equal.into_iter().map(|q| (q, share)).collect()
}

/// Hands the shares of points that have no average on to those that have: each is taken over by one with more cells,
/// or of a lower number, so that this ends. Collective.
fn follow(shares: &mut [Shares], numbering: &Numbering, comm: &Comm) {
    let mut changed = [1i64];
    while changed[0] > 0 {
        changed[0] = 0;
        let mut ask: Vec<i64> = shares.iter().flatten().map(|s| s.0).collect();
        ask.sort_unstable();
        ask.dedup();
        let answers = fetch(&ask, shares, numbering, comm);
        for list in shares.iter_mut() {
            let mut next: BTreeMap<i64, f64> = BTreeMap::new();
            for &(q, share) in list.iter() {
                for &(r, of_it) in &answers[ask.partition_point(|&a| a < q)] {
                    *next.entry(r).or_insert(0.0) += share * of_it;
                }
            }
            let next: Shares = next.into_iter().collect();
            if *list != next {
                *list = next;
                changed[0] = 1;
            }
        }
        comm.sum_i64(&mut changed);
    }
}

/// The lists of any numbers from their owners. Collective.
fn fetch(numbers: &[i64], own: &[Shares], numbering: &Numbering, comm: &Comm) -> Vec<Shares> {
    let answers = numbering.answers(comm, numbers, |at, to| {
        to.push(own[at].len() as f64);
        // Numbers below 2^53 are exact as doubles.
        to.extend(own[at].iter().flat_map(|&(q, share)| [q as f64, share]));
    });
    let mut rest: Vec<&[f64]> = answers.iter().map(Vec::as_slice).collect();
    let list = |&number: &i64| -> Shares {
        let from = &mut rest[numbering.owner(number)];
        let count = take(from, 1)[0] as usize;
        take(from, 2 * count).chunks_exact(2).map(|c| (c[0] as i64, c[1])).collect()
    };
    numbers.iter().map(list).collect()
}
