//! Memory of this process, from the kernel.

use std::fs;

/// Bytes of memory in use now and at most so far; none where the kernel does not tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Memory {
    /// Resident now.
    pub now: u64,
    /// Most so far, or since [`restart_peak`].
    pub peak: u64,
}

impl Memory {
    /// As it is.
    pub fn read() -> Option<Self> {
        parse(&fs::read_to_string("/proc/self/status").ok()?)
    }
}

/// Lets the peak begin anew at what is in use now. False where the kernel does not allow it: the peak is then that of
/// the whole process.
pub fn restart_peak() -> bool {
    fs::write("/proc/self/clear_refs", "5").is_ok()
}

fn parse(status: &str) -> Option<Memory> {
    let kib = |key: &str| {
        let line = status.lines().find(|l| l.starts_with(key))?;
        line.split_whitespace().nth(1)?.parse::<u64>().ok()
    };
    Some(Memory { now: kib("VmRSS:")? * 1024, peak: kib("VmHWM:")? * 1024 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_kernel() {
        let text = "Name:\tm4gn\nVmHWM:\t    1756 kB\nVmRSS:\t     200 kB\n";
        let expected = Memory { now: 200 * 1024, peak: 1756 * 1024 };
        assert_eq!(parse(text), Some(expected));
        assert_eq!(parse("VmRSS: 1 kB"), None);
    }

    #[test]
    fn a_large_array_shows() {
        let Some(before) = Memory::read() else { return };
        let block = std::hint::black_box(vec![1u8; 64 << 20]);
        let after = Memory::read().unwrap();
        assert!(after.peak >= before.now + (48 << 20), "{before:?} {after:?}");
        drop(block);
    }
}
