//! A digest of all that something was made from: tells it from what other inputs would make.

use crate::{Error, Result, files};
use std::io::Read;
use std::path::Path;

/// FNV-1a with 128 bits over named parts.
#[derive(Clone, Copy, Debug)]
pub struct Digest(u128);

impl Default for Digest {
    fn default() -> Self {
        Digest(0x6c62_272e_07bb_0142_62b8_2175_6295_c58d)
    }
}

impl Digest {
    /// Adds a part. Its name and length count, so that no two lists of parts run together.
    pub fn add(&mut self, name: &str, bytes: &[u8]) {
        self.bytes(&(name.len() as u64).to_le_bytes());
        self.bytes(name.as_bytes());
        self.bytes(&(bytes.len() as u64).to_le_bytes());
        self.bytes(bytes);
    }

    /// Adds the content of a file as a part.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be read.
    pub fn add_file(&mut self, name: &str, path: &Path) -> Result<()> {
        let failed = |e: std::io::Error| Error::file(path, format!("cannot be read: {e}"));
        files::check_plain(path).map_err(failed)?;
        let mut file = std::fs::File::open(path).map_err(failed)?;
        let mut content = Digest::default();
        let mut part = vec![0; 1 << 16];
        loop {
            match file.read(&mut part) {
                Ok(0) => break,
                Ok(n) => content.bytes(&part[..n]),
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(failed(e)),
            }
        }
        self.add(name, content.text().as_bytes());
        Ok(())
    }

    fn bytes(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u128::from(b)).wrapping_mul(0x0000_0000_0100_0000_0000_0000_0000_013b);
        }
    }

    /// As 32 hexadecimal digits behind a letter: a word in a dictionary.
    pub fn text(&self) -> String {
        format!("x{:032x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_do_not_run_together() {
        let of = |parts: &[(&str, &str)]| {
            let mut digest = Digest::default();
            parts.iter().for_each(|(name, text)| digest.add(name, text.as_bytes()));
            digest.text()
        };
        let one = of(&[("a", "bc")]);
        assert_eq!((one.len(), &one), (33, &of(&[("a", "bc")])));
        for other in [of(&[("ab", "c")]), of(&[("a", "b"), ("c", "")]), of(&[("a", "bd")]), of(&[])] {
            assert_ne!(one, other);
        }
        // The published value of the empty text
        assert_eq!(of(&[]), "x6c62272e07bb014262b821756295c58d");
    }
}
