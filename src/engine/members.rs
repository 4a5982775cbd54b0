//! Which nodes are members of which segments.

use super::kernels::{self, Isa};
use m4gn_base::{Error, Result};
use m4gn_model::ModelSpec;
use m4gn_structure::Segmentation;
use std::ops::Range;

/// Segments of the nodes, by place in the engine's order.
#[derive(Clone, Debug)]
pub struct Members {
    /// K.
    pub count: usize,
    /// Segments of place p: `member[row[p]..row[p + 1]]`.
    row: Vec<u32>,
    member: Vec<i32>,
    /// Places of segment s on this rank, ascending: `place[place_row[s]..place_row[s + 1]]`.
    place_row: Vec<u32>,
    place: Vec<u32>,
    /// 1 / members of each segment, over all ranks.
    pub inverse_sizes: Vec<f64>,
}

impl Members {
    /// Of these segments; `node` is the graph's node at each place.
    ///
    /// # Errors
    /// [`Error::Input`] for segments of another graph, or without what the model reads of them.
    pub fn new(segments: &Segmentation, spec: &ModelSpec, node: &[u32]) -> Result<Self> {
        check(segments, node.len(), spec)?;
        let inverse_sizes = segments.sizes.iter().map(|s| 1.0 / s.max(1.0)).collect();
        Ok(Self::ordered((&segments.member_row, &segments.member), node, inverse_sizes))
    }

    /// The same in another order: what is at each place now was at these.
    pub fn reordered(&self, before: &[u32]) -> Self {
        Self::ordered((&self.row, &self.member), before, self.inverse_sizes.clone())
    }

    fn ordered((rows, members): (&[u32], &[i32]), node: &[u32], inverse_sizes: Vec<f64>) -> Self {
        let k = inverse_sizes.len();
        let mut row = Vec::with_capacity(node.len() + 1);
        let mut member = Vec::with_capacity(members.len());
        row.push(0);
        for &i in node {
            let own = rows[i as usize] as usize..rows[i as usize + 1] as usize;
            member.extend_from_slice(&members[own]);
            row.push(member.len() as u32);
        }
        let mut place_row = vec![0u32; k + 1];
        member.iter().for_each(|&s| place_row[s as usize + 1] += 1);
        (0..k).for_each(|s| place_row[s + 1] += place_row[s]);
        let mut next = place_row.clone();
        let mut place = vec![0; member.len()];
        for (p, bounds) in row.windows(2).enumerate() {
            for &s in &member[bounds[0] as usize..bounds[1] as usize] {
                place[next[s as usize] as usize] = p as u32;
                next[s as usize] += 1;
            }
        }
        Members { count: k, row, member, place_row, place, inverse_sizes }
    }

    /// Segments of a place.
    pub fn of(&self, place: usize) -> &[i32] {
        &self.member[self.row[place] as usize..self.row[place + 1] as usize]
    }

    /// Places of a segment on this rank, ascending.
    pub fn places(&self, segment: usize) -> &[u32] {
        &self.place[self.place_row[segment] as usize..self.place_row[segment + 1] as usize]
    }

    /// Adds to a row of each of these places the mean of its segments' rows of a table.
    pub fn add_means(&self, isa: Isa, x: &mut [f32], columns: usize, table: &[f32], places: Range<usize>) {
        kernels::add_means(isa, x, columns, table, &self.row[places.start..=places.end], &self.member);
    }
}

fn check(segments: &Segmentation, n_owned: usize, spec: &ModelSpec) -> Result<()> {
    let k = segments.count;
    let encodings = k * spec.n_position_features();
    let offsets = n_owned * spec.n_offset_features();
    let rows_fit = segments.member_row.len() == n_owned + 1
        && segments.member_row[0] == 0
        && segments.member_row.windows(2).all(|w| w[0] < w[1])
        && segments.member_row[n_owned] as usize == segments.member.len();
    let members_fit = segments.member.iter().all(|&s| usize::try_from(s).is_ok_and(|s| s < k));
    if !rows_fit
        || !members_fit
        || segments.sizes.len() != k
        || segments.position.len() != encodings
        || segments.offsets.len() != offsets
    {
        return Err(Error::Input(format!(
            "segments: expected one or more of {k} for each of {n_owned} nodes, {k} sizes, {encodings} encodings and {offsets} \
             offsets; found {} nodes, {} sizes, {} encodings, {} offsets, segment numbers {} within range",
            segments.member_row.len().saturating_sub(1),
            segments.sizes.len(),
            segments.position.len(),
            segments.offsets.len(),
            if members_fit { "all" } else { "not all" }
        )));
    }
    Ok(())
}
