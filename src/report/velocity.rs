//! A field of two sources side by side, and their difference.

use super::cells::CellMap;
use super::picture::{FieldPicture, Palette, Panel, Scale};

/// The field of both at one time (of a vector its length), and the magnitude of their difference, a value a cell.
#[derive(Clone, Debug)]
pub struct VelocityRow<'a> {
    /// Time as it is to be read, s.
    pub time: String,
    /// What is right.
    pub reference: &'a [f64],
    /// What is compared with it.
    pub other: &'a [f64],
    /// Their difference.
    pub difference: &'a [f64],
}

/// One row of panels a time; `field` is the field's name and unit. Colours are scaled by the reference: another one that runs away must not darken all.
pub fn picture(
    map: CellMap,
    names: [&str; 2],
    [field, unit]: [&str; 2],
    rows: &[VelocityRow],
) -> FieldPicture {
    let speed = rows.iter().flat_map(|r| r.reference).copied().fold(0.0, f64::max);
    let scale = |label: String, high, palette| Scale { label, low: 0.0, high, palette };
    let difference = format!("|{field} {} - {field} {}| [{unit}]", names[1], names[0]);
    let row = |r: &VelocityRow| {
        let panel = |name: &str, values: &[f64], scale| Panel {
            title: format!("{name}, t = {} s", r.time),
            map: 0,
            values: values.to_vec(),
            scale,
        };
        vec![
            panel(names[0], r.reference, 0),
            panel(names[1], r.other, 0),
            panel("difference", r.difference, 1),
        ]
    };
    FieldPicture {
        maps: vec![map],
        scales: vec![
            scale(format!("|{field}| [{unit}]"), speed, Palette::Viridis),
            scale(difference, 0.5 * speed, Palette::Heat),
        ],
        rows: rows.iter().map(row).collect(),
    }
}
