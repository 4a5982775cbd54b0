//! Pictures of fields on the cells of 2-D meshes.

use super::cells::CellMap;
use super::raster::{INK, Raster, Rgb, TEXT_HEIGHT};

const GAP: usize = 10;
const BAR: usize = 14;

/// Colours from low to high.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Palette {
    /// Viridis, for magnitudes.
    Viridis,
    /// White over yellow to dark red, for errors.
    Heat,
}

impl Palette {
    fn stops(self) -> &'static [Rgb] {
        match self {
            Palette::Viridis => &[
                [68, 1, 84],
                [71, 44, 122],
                [59, 81, 139],
                [44, 113, 142],
                [33, 144, 141],
                [39, 173, 129],
                [92, 200, 99],
                [170, 220, 50],
                [253, 231, 37],
            ],
            Palette::Heat => &[[255, 255, 245], [254, 217, 118], [253, 141, 60], [227, 26, 28], [128, 0, 38]],
        }
    }

    /// The colour at `position`, 0 to 1; outside, the end's colour.
    pub fn colour(self, position: f64) -> Rgb {
        let stops = self.stops();
        let x = position.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let i = (x as usize).min(stops.len() - 2);
        let f = x - i as f64;
        std::array::from_fn(|c| {
            (f64::from(stops[i][c]) * (1.0 - f) + f64::from(stops[i + 1][c]) * f).round() as u8
        })
    }
}

/// Values that a palette's ends stand for.
#[derive(Clone, Debug)]
pub struct Scale {
    /// Text of the colour bar, with the unit.
    pub label: String,
    /// Value of the first colour.
    pub low: f64,
    /// Value of the last colour.
    pub high: f64,
    /// Colours.
    pub palette: Palette,
}

impl Scale {
    /// The colour of a value.
    pub fn colour(&self, value: f64) -> Rgb {
        let range = self.high - self.low;
        self.palette.colour(if range > 0.0 { (value - self.low) / range } else { 0.0 })
    }
}

/// One field in a picture.
#[derive(Clone, Debug)]
pub struct Panel {
    /// Text above it.
    pub title: String,
    /// A value for each cell of the map.
    pub values: Vec<f64>,
    /// Index of its scale.
    pub scale: usize,
}

/// Rows of panels of the same size, with their colour bars below.
#[derive(Clone, Debug)]
pub struct FieldPicture {
    /// What the panels show their values on.
    pub map: CellMap,
    /// Colour scales that the panels refer to.
    pub scales: Vec<Scale>,
    /// Panels, row by row.
    pub rows: Vec<Vec<Panel>>,
}

impl FieldPicture {
    /// Draws everything.
    pub fn raster(&self) -> Raster {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0).max(1);
        let (width, height) = (self.map.width, self.map.height);
        let (cell_w, cell_h) = (width + GAP, height + TEXT_HEIGHT + GAP);
        let bars = match self.scales.len() {
            0 => 0,
            _ => BAR + 2 * TEXT_HEIGHT + GAP + 4,
        };
        let mut raster = Raster::new(columns * cell_w + GAP, self.rows.len() * cell_h + bars + GAP);
        for (r, row) in self.rows.iter().enumerate() {
            for (c, panel) in row.iter().enumerate() {
                let (left, top) = (GAP + c * cell_w, GAP / 2 + r * cell_h);
                raster.text(left, top, &panel.title);
                if let Some(scale) = self.scales.get(panel.scale) {
                    self.map.paint(&mut raster, left, top + TEXT_HEIGHT, &panel.values, scale);
                }
            }
        }
        let top = self.rows.len() * cell_h + GAP;
        for (i, scale) in self.scales.iter().enumerate() {
            // Under the first column that uses the scale.
            let uses = |row: &Vec<Panel>| row.iter().position(|p| p.scale == i);
            let column = self.rows.iter().find_map(uses).unwrap_or(i);
            bar(&mut raster, GAP + column * cell_w, top, width, scale);
        }
        raster
    }
}

fn bar(raster: &mut Raster, left: usize, top: usize, width: usize, scale: &Scale) {
    raster.text(left, top, &scale.label);
    let top = top + TEXT_HEIGHT + 3;
    for x in 0..width {
        for y in 0..BAR {
            raster.set(left + x, top + y, scale.palette.colour(x as f64 / (width - 1).max(1) as f64));
        }
    }
    raster.frame(left, top, width, BAR, INK);
    for (position, value) in [(0.0, scale.low), (0.5, 0.5 * (scale.low + scale.high)), (1.0, scale.high)] {
        let text = super::number(value, 3);
        let w = Raster::text_width(&text);
        let x = left + (position * (width.saturating_sub(w)) as f64) as usize;
        raster.text(x, top + BAR + 1, &text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_shows_the_colours_of_its_values() {
        let points = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        let map = CellMap::from_polygons(&[0, 4], &points, 200).unwrap();
        let scale = Scale { label: "|U| [m/s]".into(), low: 0.0, high: 2.0, palette: Palette::Viridis };
        let panel = Panel { title: "full".into(), values: vec![2.0], scale: 0 };
        let raster = FieldPicture { map, scales: vec![scale], rows: vec![vec![panel]] }.raster();
        assert_eq!(raster.get(GAP + 100, GAP / 2 + TEXT_HEIGHT + 50), [253, 231, 37]);
        assert!(CellMap::from_polygons(&[0], &[], 200).is_none());
    }
}
