//! A field of two sources side by side, and their difference.

use super::cells::CellMap;
use super::picture::{FieldPicture, Palette, Panel, Scale};
use super::seconds;

/// A field of both at one time (of a vector its length), and the magnitude of their difference, a value a cell.
#[derive(Clone, Debug)]
pub struct Snapshot {
    time: f64,
    reference: Vec<f64>,
    other: Vec<f64>,
    difference: Vec<f64>,
}

impl Snapshot {
    /// From rows of `width` components a cell, at a time in s: what is right, and what is compared with it.
    pub fn new(time: f64, reference: &[f64], other: &[f64], width: usize) -> Self {
        let norm = |u: &[f64]| u.iter().map(|v| v * v).sum::<f64>().sqrt();
        let lengths = |values: &[f64]| values.chunks_exact(width).map(norm).collect();
        let difference: Vec<f64> = other.iter().zip(reference).map(|(a, b)| a - b).collect();
        let (reference, other) = (lengths(reference), lengths(other));
        Snapshot { time, reference, other, difference: lengths(&difference) }
    }
}

/// One row of panels a time; `field` is the field's name and unit. Colours are scaled by the reference: another one that runs away must not darken all.
pub fn picture(map: CellMap, names: [&str; 2], [field, unit]: [&str; 2], rows: &[Snapshot]) -> FieldPicture {
    let speed = rows.iter().flat_map(|r| &r.reference).copied().fold(0.0, f64::max);
    let scale = |label: String, high, palette| Scale { label, low: 0.0, high, palette };
    let difference = format!("|{field} {} - {field} {}| [{unit}]", names[1], names[0]);
    let row = |r: &Snapshot| {
        let panel = |name: &str, values: &[f64], scale| Panel {
            title: format!("{name}, t = {} s", seconds(r.time)),
            values: values.to_vec(),
            scale,
        };
        vec![
            panel(names[0], &r.reference, 0),
            panel(names[1], &r.other, 0),
            panel("difference", &r.difference, 1),
        ]
    };
    FieldPicture {
        map,
        scales: vec![
            scale(format!("|{field}| [{unit}]"), speed, Palette::Viridis),
            scale(difference, 0.5 * speed, Palette::Heat),
        ],
        rows: rows.iter().map(row).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magnitudes_on_paper() {
        let s = Snapshot::new(1.0, &[3.0, 4.0, 0.0, 1.0], &[3.0, 4.0, 1.0, 0.0], 2);
        assert_eq!((s.reference, s.other), (vec![5.0, 1.0], vec![5.0, 1.0]));
        assert!((s.difference[1] - 2.0_f64.sqrt()).abs() < 1e-15 && s.difference[0] == 0.0);
    }
}
