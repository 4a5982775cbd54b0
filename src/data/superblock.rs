//! The mark in an HDF5 file that a program has it open. A program that is killed leaves the mark, and HDF5 then refuses the file.
//!
//! Layout of a superblock of version 3 (HDF5 File Format Specification 3.0, II.A): signature [0, 8), version 8, sizes of offsets and
//! lengths 9 and 10, consistency flags 11, four addresses of 8 bytes [12, 44), checksum [44, 48).

use std::fs::OpenOptions;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

const SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Takes the mark off the file; leaves a file without one as it is.
///
/// # Errors
/// Those of reading and writing, and [`io::ErrorKind::InvalidData`] for a file that does not begin with a superblock of version 3
/// whose checksum is right.
pub fn clear_open_mark(path: &Path) -> io::Result<()> {
    let file = OpenOptions::new().read(true).write(true).open(path)?;
    let mut block = [0; 48];
    file.read_exact_at(&mut block, 0)?;
    let known = block[..8] == SIGNATURE && block[8..11] == [3, 8, 8];
    if !known || block[44..] != checksum(&block[..44]).to_le_bytes() {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "no superblock of version 3 at its start"));
    }
    if block[11] == 0 {
        return Ok(());
    }
    block[11] = 0;
    let sum = checksum(&block[..44]);
    block[44..].copy_from_slice(&sum.to_le_bytes());
    file.write_all_at(&block, 0)
}

/// HDF5's checksum of metadata: Bob Jenkins' lookup3 (`hashlittle`) from 0.
fn checksum(bytes: &[u8]) -> u32 {
    let start = 0xdead_beef_u32.wrapping_add(bytes.len() as u32);
    let (mut a, mut b, mut c) = (start, start, start);
    let mut rest = bytes;
    while !rest.is_empty() {
        let n = rest.len().min(12);
        let mut padded = [0; 12];
        padded[..n].copy_from_slice(&rest[..n]);
        let word = |i: usize| u32::from_le_bytes([padded[i], padded[i + 1], padded[i + 2], padded[i + 3]]);
        a = a.wrapping_add(word(0));
        b = b.wrapping_add(word(4));
        c = c.wrapping_add(word(8));
        rest = &rest[n..];
        if rest.is_empty() {
            for (x, y, bits) in
                [(2, 1, 14), (0, 2, 11), (1, 0, 25), (2, 1, 16), (0, 2, 4), (1, 0, 14), (2, 1, 24)]
            {
                let mut words = [a, b, c];
                words[x] = (words[x] ^ words[y]).wrapping_sub(words[y].rotate_left(bits));
                [a, b, c] = words;
            }
        } else {
            for (x, y, z, bits) in
                [(0, 2, 1, 4), (1, 0, 2, 6), (2, 1, 0, 8), (0, 2, 1, 16), (1, 0, 2, 19), (2, 1, 0, 4)]
            {
                let mut words = [a, b, c];
                words[x] = words[x].wrapping_sub(words[y]) ^ words[y].rotate_left(bits);
                words[y] = words[y].wrapping_add(words[z]);
                [a, b, c] = words;
            }
        }
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_jenkins_lookup3() {
        // Values of lookup3.c's own driver5
        assert_eq!(checksum(b""), 0xdead_beef);
        assert_eq!(checksum(b"Four score and seven years ago"), 0x1777_0551);
    }
}
