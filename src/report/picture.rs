//! Pictures of a field on the cells of a 2-D mesh, from two sources, and of their difference.

use super::{Page, seconds};
use m4gn_base::{Error, Result};

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// Outside of the mesh.
const PAPER: Rgb = [255; 3];
/// The colour of values that are none (NaN).
const NO_VALUE: Rgb = [170; 3];

/// Viridis, for magnitudes.
const VIRIDIS: &[Rgb] = &[
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
/// White over yellow to dark red, for errors.
const HEAT: &[Rgb] = &[[255, 255, 245], [254, 217, 118], [253, 141, 60], [227, 26, 28], [128, 0, 38]];

/// Colours of the values from 0 to `high`; beyond, those of the ends.
#[derive(Clone, Debug)]
pub struct Scale {
    /// What is shown, with its unit.
    pub label: String,
    /// Value of the last colour.
    pub high: f64,
    /// Colours at equal distances.
    pub colours: &'static [Rgb],
}

impl Scale {
    fn colour(&self, value: f64) -> Rgb {
        let position = if self.high > 0.0 { (value / self.high).clamp(0.0, 1.0) } else { 0.0 };
        let x = position * (self.colours.len() - 1) as f64;
        let i = (x as usize).min(self.colours.len() - 2);
        let [a, b] = [i, i + 1].map(|i| self.colours[i].map(f64::from));
        std::array::from_fn(|c| (a[c] + (b[c] - a[c]) * (x - i as f64)).round() as u8)
    }
}

/// Which cell each pixel of a picture shows.
#[derive(Clone, Debug)]
pub struct CellMap {
    width: usize,
    height: usize,
    /// `[height x width]`, from the top; -1 outside the mesh.
    cells: Vec<i32>,
}

impl CellMap {
    /// Pixels in a row; twice as many as a page shows, which smooths edges.
    const WIDTH: usize = 1040;

    /// From the cells' polygons (`start[i]..start[i + 1]` of `points`, m). None without area.
    pub fn new(start: &[usize], points: &[[f64; 2]]) -> Option<Self> {
        let bound = |axis: usize, pick: fn(f64, f64) -> f64| points.iter().map(|p| p[axis]).reduce(pick);
        let (left, right) = (bound(0, f64::min)?, bound(0, f64::max)?);
        let (bottom, top) = (bound(1, f64::min)?, bound(1, f64::max)?);
        // A very tall domain gets a narrower picture.
        let aspect = (top - bottom) / (right - left);
        if !(right > left && top > bottom && aspect.is_finite() && aspect > 0.0) {
            return None;
        }
        let width = ((Self::WIDTH as f64 * (2.0 / aspect).min(1.0)) as usize).max(8);
        // One that is narrower than eight pixels then is drawn wider than it is.
        let height = ((width as f64 * aspect).round() as usize).clamp(8, 2 * Self::WIDTH);
        let scale = [width as f64 / (right - left), height as f64 / (top - bottom)];
        let mut map = CellMap { width, height, cells: vec![-1; width * height] };
        for (cell, range) in start.windows(2).enumerate() {
            let Some(corners) = points.get(range[0]..range[1]).filter(|c| c.len() > 2) else {
                continue;
            };
            let pixel = |p: &[f64; 2]| [(p[0] - left) * scale[0], (top - p[1]) * scale[1]];
            map.fill(&corners.iter().map(pixel).collect::<Vec<_>>(), cell as i32);
        }
        Some(map)
    }

    /// Fills a polygon, given in pixels, by the even-odd rule at the pixels' centres.
    fn fill(&mut self, corners: &[[f64; 2]], cell: i32) {
        let low = corners.iter().map(|c| c[1]).fold(f64::INFINITY, f64::min);
        let high = corners.iter().map(|c| c[1]).fold(f64::NEG_INFINITY, f64::max);
        let mut crossings = Vec::new();
        for row in (low - 0.5).max(0.0) as usize..((high + 0.5).max(0.0) as usize).min(self.height) {
            let y = row as f64 + 0.5;
            crossings.clear();
            for (k, a) in corners.iter().enumerate() {
                let b = corners[(k + 1) % corners.len()];
                if (a[1] <= y) != (b[1] <= y) {
                    // From below whatever the direction: neighbours then agree on their common edge to the last bit.
                    let (a, b) = if a[1] <= y { (*a, b) } else { (b, *a) };
                    crossings.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
                }
            }
            crossings.sort_by(f64::total_cmp);
            for pair in crossings.chunks_exact(2) {
                let [first, last] = [0, 1].map(|i| (pair[i] - 0.5).ceil().max(0.0) as usize);
                let last = last.min(self.width);
                self.cells[row * self.width..][first.min(last)..last].fill(cell);
            }
        }
    }

    /// A PNG file of values, one a cell.
    fn png(&self, values: &[f64], scale: &Scale) -> Result<Vec<u8>> {
        let colour = |cell: &i32| match usize::try_from(*cell).ok().and_then(|c| values.get(c)) {
            None => PAPER,
            Some(v) if v.is_nan() => NO_VALUE,
            Some(&v) => scale.colour(v),
        };
        let pixels: Vec<u8> = self.cells.iter().flat_map(colour).collect();
        let failed =
            |e: png::EncodingError| Error::Internal(format!("PNG of {} x {}: {e}", self.width, self.height));
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&pixels).and_then(|()| writer.finish()).map_err(failed)?;
        Ok(bytes)
    }
}

/// A field of both sources at one time (of a vector its length), and the magnitude of their difference, a value a cell.
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

impl Page {
    /// A row of pictures a time; `field` is the field's name and unit. Colours are scaled by the reference: another one that runs away must not darken
    /// all.
    ///
    /// # Errors
    /// Of a picture that cannot be encoded.
    pub fn snapshots(
        &mut self,
        map: &CellMap,
        names: [&str; 2],
        [field, unit]: [&str; 2],
        rows: &[Snapshot],
    ) -> Result<()> {
        let high = rows.iter().flat_map(|r| &r.reference).copied().fold(0.0, f64::max);
        let of_both = Scale { label: format!("|{field}| [{unit}]"), high, colours: VIRIDIS };
        let difference = format!("|{field} {} - {field} {}| [{unit}]", names[1], names[0]);
        let of_difference = Scale { label: difference, high: 0.5 * high, colours: HEAT };
        let scales = [&of_both, &of_both, &of_difference];
        let mut pictures = Vec::new();
        for row in rows {
            let panels =
                [(names[0], &row.reference), (names[1], &row.other), ("difference", &row.difference)];
            for ((name, values), scale) in panels.into_iter().zip(scales) {
                let caption = format!("{name}, t = {} s", seconds(row.time));
                pictures.push((caption, map.png(values, scale)?));
            }
        }
        self.pictures(&pictures, &scales);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(map: &CellMap, cell: i32) -> f64 {
        map.cells.iter().filter(|&&c| c == cell).count() as f64 / map.cells.len() as f64
    }

    #[test]
    fn polygons_cover_their_area() {
        // A square cut along its diagonal into two triangles.
        let points = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let map = CellMap::new(&[0, 3, 6], &points).unwrap();
        assert_eq!((map.width, map.height), (1040, 1040));
        assert!((shares(&map, 0) - 0.5).abs() < 0.01 && (shares(&map, 1) - 0.5).abs() < 0.01);
        assert!(shares(&map, -1) < 1e-9 && CellMap::new(&[0], &[]).is_none());
    }

    /// Cells in a column: however long it is, the picture has a bounded size, and each end shows its cell.
    #[test]
    fn a_long_domain_has_a_bounded_picture() {
        for length in [1e3, 1e7, 1e300] {
            let points =
                [[0.0, 0.0], [1.0, 0.0], [1.0, length], [0.0, length], [0.0, -length], [1.0, -length]];
            let corners: Vec<[f64; 2]> = [0, 1, 2, 3, 4, 5, 1, 0].map(|p| points[p]).into();
            let map = CellMap::new(&[0, 4, 8], &corners).unwrap();
            assert_eq!((map.width, map.height), (8, 2080), "{length}");
            assert!((shares(&map, 0) - 0.5).abs() < 0.01 && (shares(&map, 1) - 0.5).abs() < 0.01);
        }
    }

    #[test]
    fn a_picture_shows_the_colours_of_its_values() {
        let points = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        let map = CellMap::new(&[0, 4], &points).unwrap();
        let scale = Scale { label: "|U| [m/s]".into(), high: 2.0, colours: VIRIDIS };
        let bytes = map.png(&[2.0], &scale).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height, &pixels[..3]), (1040, 520, &VIRIDIS[8][..]));
        assert_eq!((scale.colour(1.0), scale.colour(0.125)), (VIRIDIS[4], [70, 23, 103]));
    }

    #[test]
    fn magnitudes_on_paper() {
        let s = Snapshot::new(1.0, &[3.0, 4.0, 0.0, 1.0], &[3.0, 4.0, 1.0, 0.0], 2);
        assert_eq!((&s.reference, &s.other), (&vec![5.0, 1.0], &vec![5.0, 1.0]));
        assert!((s.difference[1] - 2.0_f64.sqrt()).abs() < 1e-15 && s.difference[0] == 0.0);
        let map = CellMap::new(
            &[0, 3, 6],
            &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0], [0.0, 1.0]],
        );
        let mut page = Page::new("p");
        page.snapshots(&map.unwrap(), ["full", "hybrid"], ["U", "m/s"], &[s]).unwrap();
        let html = page.html();
        for text in ["hybrid, t = 1 s", "|U hybrid - U full| [m/s]", "rgb(253,231,37)", "<span>2.50</span>"] {
            assert!(html.contains(text), "{text}");
        }
        assert_eq!(html.matches("data:image/png;base64,").count(), 3);
    }
}
