//! Segments of each method side by side, and the first modes.

use super::{Entry, Survey};
use m4gn_mesh::Mesh;
use m4gn_report::picture::{Palette, Panel, Scale};
use m4gn_report::raster::Raster;
use m4gn_report::{CellMap, FieldPicture};

/// What a picture shows.
#[derive(Clone, Debug)]
pub struct Pictured {
    /// Segmentations with these K, a row each.
    pub counts: Vec<usize>,
    /// Most modes.
    pub modes: usize,
}

/// For each K a row with the segments of each method, and rows of the same width with the first modes. No two segments that
/// touch have the same colour, as long as there are enough; modes are blue where negative, red where positive.
pub fn picture(survey: &Survey, mesh: &Mesh, map: CellMap, what: &Pictured) -> Raster {
    let panel = |e: &Entry| Panel {
        title: format!("{}, {} segments", e.method, e.count),
        values: colours(e, mesh).into_iter().map(|c| c as f64).collect(),
        scale: 0,
    };
    let row = |&count: &usize| -> Vec<Panel> {
        let entries = survey.entries.iter().filter(|e| e.count == count);
        entries.map(panel).collect()
    };
    let mut rows: Vec<Vec<Panel>> = what.counts.iter().map(row).collect();
    let modes = &survey.modes;
    let largest = modes.vectors.iter().take(what.modes).flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    let shapes: Vec<Panel> = modes
        .vectors
        .iter()
        .zip(&modes.eigenvalues)
        .take(what.modes)
        .enumerate()
        .map(|(i, (phi, lambda))| Panel {
            title: format!("mode {}, {} 1/m2", i + 1, m4gn_report::number(*lambda, 4)),
            values: phi.clone(),
            scale: 1,
        })
        .collect();
    let scale = |label: &str, high: f64, palette| Scale { label: label.into(), low: -high, high, palette };
    let mut scales = vec![scale("", 0.0, Palette::Labels)];
    if !shapes.is_empty() {
        scales.push(scale("modes, rms 1", largest, Palette::Diverging));
    }
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0).max(2);
    rows.extend(shapes.chunks(columns).map(<[Panel]>::to_vec));
    FieldPicture { map, scales, rows }.raster()
}

/// A colour number for each cell, the same within a segment: the least used one that no segment across a face has.
fn colours(entry: &Entry, mesh: &Mesh) -> Vec<usize> {
    let mut touching = vec![std::collections::BTreeSet::new(); entry.count];
    let internal = mesh.face_owner.iter().zip(&mesh.face_neighbour);
    for (&a, &b) in internal {
        let (a, b) = (entry.labels[a as usize] as usize, entry.labels[b as usize] as usize);
        if a != b {
            touching[a].insert(b);
            touching[b].insert(a);
        }
    }
    let n = Palette::LABELS.len();
    let mut used = vec![0usize; n];
    let mut colour: Vec<Option<usize>> = vec![None; entry.count];
    for segment in 0..entry.count {
        let taken: Vec<usize> = touching[segment].iter().filter_map(|&t| colour[t]).collect();
        let free = (0..n).filter(|c| !taken.contains(c)).min_by_key(|&c| used[c]);
        let chosen = free.unwrap_or(segment % n);
        used[chosen] += 1;
        colour[segment] = Some(chosen);
    }
    entry.labels.iter().map(|&l| colour[l as usize].unwrap_or(0)).collect()
}
