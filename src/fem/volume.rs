//! Which points have a volume average of their own.

use super::mesh::Cell;
use super::numbering::Numbering;
use crate::parallel::Comm;

/// False for a point whose cells are all cells of another point too; of points with the same cells the one with the
/// lowest global number stays. Every cell keeps at least one of its points. The choice does not depend on ranks.
/// Collective.
pub(super) fn constraints(cells: &[Cell], globals: &[i64], numbering: &Numbering, comm: &Comm) -> Vec<bool> {
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
    let totals = numbering.sum_at_owner(comm, &numbers, &counts, 1);
    let totals = numbering.fetch(comm, &numbers, &totals, 1);
    let mut total = vec![0.0; n];
    for (&p, &t) in local.iter().zip(&totals) {
        total[p] = t;
    }
    // Points that are in all cells of p here, and may replace it.
    let mut send = vec![Vec::new(); comm.size() as usize];
    for (&p, &number) in local.iter().zip(&numbers) {
        let Some((&first, others)) = around[p].split_first() else {
            continue;
        };
        let covers = |q: usize| {
            (total[q] > total[p] || total[q] == total[p] && globals[q] < globals[p])
                && others.iter().all(|&c| cells[c].points.contains(&q))
        };
        let found: Vec<i64> = cells[first]
            .points
            .iter()
            .filter(|&&q| q != p && covers(q))
            .map(|&q| globals[q])
            .collect();
        let list = &mut send[numbering.owner(number)];
        list.extend([number, found.len() as i64]);
        list.extend(found);
    }
    // It is replaced if one of them is in its cells on all ranks.
    let mut common: Vec<Option<Vec<i64>>> = vec![None; numbering.owned.len()];
    for list in comm.all_to_all(&send) {
        let mut rest = &list[..];
        while let [number, count, tail @ ..] = rest {
            let (found, tail) = tail.split_at(*count as usize);
            let so_far = &mut common[(number - numbering.first_own()) as usize];
            match so_far {
                None => *so_far = Some(found.to_vec()),
                Some(list) => list.retain(|g| found.contains(g)),
            }
            rest = tail;
        }
    }
    let own: Vec<f64> = common
        .iter()
        .map(|c| f64::from(u8::from(c.as_ref().is_none_or(Vec::is_empty))))
        .collect();
    let mut constraint = vec![false; n];
    for (&p, flag) in local.iter().zip(numbering.fetch(comm, &numbers, &own, 1)) {
        constraint[p] = flag != 0.0;
    }
    constraint
}
