//! A small picture in memory: pixels, text, PNG.

use m4gn_base::{Error, Result};
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// Near black, for text.
pub const INK: Rgb = [40, 40, 40];
/// White.
pub const PAPER: Rgb = [255, 255, 255];

const FONT: (FontWeight, RasterHeight) = (FontWeight::Regular, RasterHeight::Size20);
/// Height of a line of text, pixels.
pub const TEXT_HEIGHT: usize = 20;

/// An image, row by row from the top.
#[derive(Clone, Debug)]
pub struct Raster {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    pixels: Vec<Rgb>,
}

impl Raster {
    /// A white image.
    pub fn new(width: usize, height: usize) -> Self {
        Raster { width, height, pixels: vec![PAPER; width * height] }
    }

    /// Sets a pixel; outside the image nothing happens.
    pub fn set(&mut self, x: usize, y: usize, colour: Rgb) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// The colour of a pixel; white outside.
    pub fn get(&self, x: usize, y: usize) -> Rgb {
        if x < self.width && y < self.height { self.pixels[y * self.width + x] } else { PAPER }
    }

    /// Outline of a rectangle.
    pub fn frame(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Rgb) {
        for i in x..x + width {
            self.set(i, y, colour);
            self.set(i, y + height.saturating_sub(1), colour);
        }
        for j in y..y + height {
            self.set(x, j, colour);
            self.set(x + width.saturating_sub(1), j, colour);
        }
    }

    /// Writes ASCII text with its upper left corner at x, y.
    pub fn text(&mut self, x: usize, y: usize, text: &str) {
        let mut left = x;
        for c in text.chars() {
            let Some(glyph) = get_raster(c, FONT.0, FONT.1).or_else(|| get_raster('?', FONT.0, FONT.1))
            else {
                continue;
            };
            for (j, row) in glyph.rows().enumerate() {
                for (i, &ink) in row.iter().enumerate() {
                    let under = self.get(left + i, y + j);
                    let mix =
                        |a: u8, b: u8| ((a as u32 * (255 - ink as u32) + b as u32 * ink as u32) / 255) as u8;
                    self.set(left + i, y + j, std::array::from_fn(|c| mix(under[c], INK[c])));
                }
            }
            left += glyph.width();
        }
    }

    /// Width that [`Self::text`] needs, pixels.
    pub fn text_width(text: &str) -> usize {
        text.chars().count() * get_raster_width(FONT.0, FONT.1)
    }

    /// The image as a PNG file.
    pub fn png(&self) -> Result<Vec<u8>> {
        let failed =
            |e: png::EncodingError| Error::Internal(format!("PNG of {} x {}: {e}", self.width, self.height));
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::High);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(self.pixels.as_flattened()).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_reads_back() {
        let mut raster = Raster::new(60, 24);
        raster.set(3, 1, [255, 0, 10]);
        raster.set(600, 1, [255, 0, 10]);
        raster.text(10, 2, "0.5");
        let bytes = raster.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (60, 24));
        assert_eq!(pixels[3 * (60 + 3)..][..3], [255, 0, 10]);
        assert!(pixels.chunks(3).skip(10).any(|p| p[0] < 100), "no ink");
    }
}
