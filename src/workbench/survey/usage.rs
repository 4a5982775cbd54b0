//! What a part of a run uses: memory and processor time, as Linux tells; none elsewhere.

/// Clock ticks a second in /proc: Linux's USER_HZ, the same for all processors that m4gn is built for.
const TICKS: f64 = 100.0;

/// Starts counting the peak anew, where the system can; else it goes on from the start of the process.
pub fn reset_peak() {
    // 5: "reset the peak resident set size" (proc(5), clear_refs). Without the right to it nothing is lost.
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Largest resident memory of this process since [`reset_peak`], bytes.
pub fn peak() -> Option<u64> {
    peak_of(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// Processor time of this process so far, s, in steps of 0.01. Other programs on the same cores do not count.
pub fn cpu_seconds() -> Option<f64> {
    cpu_of(&std::fs::read_to_string("/proc/self/stat").ok()?)
}

fn peak_of(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kib)
}

fn cpu_of(stat: &str) -> Option<f64> {
    // The name of the program stands in brackets and may hold anything. After it utime and stime are 12th and 13th.
    let (_, rest) = stat.rsplit_once(')')?;
    let mut fields = rest.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<u64>().ok();
    Some((ticks()? + ticks()?) as f64 / TICKS)
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

    #[test]
    fn ticks_of_user_and_system() {
        let stat = "42 (a) b) R 1 42 42 0 -1 4194304 100 0 0 0 250 50 0 0 20 0 1 0 100 1000 10";
        assert_eq!(cpu_of(stat), Some(3.0));
        assert_eq!(cpu_of("42 (a) R 1"), None);
    }
}
