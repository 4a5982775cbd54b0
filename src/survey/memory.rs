//! Peak memory of a part of a run.

/// Starts counting the peak anew, where the system can (Linux); else it goes on from the start of the process.
pub fn reset_peak() {
    // 5: "reset the peak resident set size" (proc(5), clear_refs). Without the right to it nothing is lost.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Largest resident memory of this process since [`reset_peak`], bytes; none where the system does not say.
pub fn peak() -> Option<u64> {
    peak_of(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn peak_of(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kib)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_found_and_broken_ones_are_none() {
        assert_eq!(
            peak_of("VmPeak:\t 9 kB\nVmHWM:\t   1300 kB\nVmRSS:\t 7 kB\n"),
            Some(1_331_200)
        );
        assert_eq!(peak_of("VmHWM:\t many kB\n"), None);
        assert_eq!(peak_of(""), None);
    }
}
