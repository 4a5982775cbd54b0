//! How much memory there is, and what of it frames may take.

use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use std::path::Path;

/// Bytes of a GB, as everywhere in what people read here.
const GB: f64 = 1e9;

/// Bytes of all memory of this machine; none where it does not say.
pub(super) fn whole() -> Option<u64> {
    entry(&read(Path::new("/proc/meminfo"))?, "MemTotal:")
}

/// Bytes that the frames of this rank may take: as asked (GB), else half of what is free on this machine, shared by its ranks.
///
/// # Errors
/// [`Error::Input`] for a size that is none.
pub(super) fn for_frames(asked: Option<f64>, comm: &Comm) -> Result<u64> {
    match asked {
        // The conversion holds numbers beyond the largest integer.
        Some(size) if size >= 0.0 => Ok((size * GB) as u64),
        Some(size) => Err(Error::Input(format!(
            "--memory: found {size}, expected the GB that the frames of each rank may take, 0 or more"
        ))),
        None => Ok(free().map_or(u64::MAX, |bytes| bytes / 2 / ranks_here(comm))),
    }
}

/// A size for people.
pub(super) fn size(bytes: u64) -> String {
    let (unit, name) = if bytes as f64 >= GB { (GB, "GB") } else { (1e6, "MB") };
    format!("{} {name}", m4gn_report::number(bytes as f64 / unit, 3))
}

/// What this process could still take: of the machine, and within the limits of its control groups (containers, batch jobs).
fn free() -> Option<u64> {
    let machine = entry(&read(Path::new("/proc/meminfo"))?, "MemAvailable:")?;
    let groups = read(Path::new("/proc/self/cgroup")).unwrap_or_default();
    let own = groups.lines().find_map(|line| line.strip_prefix("0::/"));
    let root = Path::new("/sys/fs/cgroup");
    let left = own.into_iter().flat_map(|own| {
        let own = root.join(own);
        let folders: Vec<_> = own.ancestors().take_while(|f| f.starts_with(root)).collect();
        folders.into_iter().filter_map(left_in).collect::<Vec<_>>()
    });
    Some(left.fold(machine, u64::min))
}

/// What is left of the limit of a control group; none without a limit. Files that were read and are kept in memory for the next reader
/// count as used there, and make room.
fn left_in(folder: &Path) -> Option<u64> {
    let number = |text: &str| text.trim().parse::<u64>().ok();
    let of = |name: &str| number(&read(&folder.join(name))?);
    let cached = |text: String| text.lines().find_map(|line| number(line.strip_prefix("inactive_file ")?));
    let cached = read(&folder.join("memory.stat")).and_then(cached).unwrap_or(0);
    Some(of("memory.max")?.saturating_sub(of("memory.current")?.saturating_sub(cached)))
}

/// Ranks on this machine, as the launchers of OpenMPI and MPICH tell; all of them where none does.
fn ranks_here(comm: &Comm) -> u64 {
    let told = ["OMPI_COMM_WORLD_LOCAL_SIZE", "MPI_LOCALNRANKS"]
        .iter()
        .find_map(|name| std::env::var(name).ok()?.parse().ok());
    told.unwrap_or(comm.size() as u64).max(1)
}

fn read(path: &Path) -> Option<String> {
    std::fs::read_to_string(path).ok()
}

/// Bytes of an entry of `/proc/meminfo`, which is in KiB.
fn entry(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find(|l| l.starts_with(name))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()?.saturating_mul(1024))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_size_that_was_asked_for_is_taken() {
        let comm = Comm::serial();
        assert_eq!(for_frames(Some(0.0), &comm).unwrap(), 0);
        assert_eq!(for_frames(Some(1.5), &comm).unwrap(), 1_500_000_000);
        assert_eq!(for_frames(Some(f64::INFINITY), &comm).unwrap(), u64::MAX);
        for bad in [-1.0, f64::NAN] {
            m4gn_samples::fails(for_frames(Some(bad), &comm), &["--memory: found"]);
        }
    }

    #[test]
    fn files_that_were_read_take_nothing_of_a_limit() {
        let group = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| std::fs::write(group.path().join(name), text).unwrap();
        put("memory.max", "max\n");
        put("memory.current", "900\n");
        assert_eq!(left_in(group.path()), None);
        put("memory.max", "1000\n");
        assert_eq!(left_in(group.path()), Some(100));
        put("memory.stat", "anon 600\nactive_file 50\ninactive_file 250\n");
        assert_eq!(left_in(group.path()), Some(350));
    }

    #[test]
    fn without_one_it_is_at_most_half_of_the_machine() {
        let most = for_frames(None, &Comm::serial()).unwrap();
        assert!(0 < most && most <= whole().unwrap() / 2, "{most}");
        assert_eq!(entry("MemTotal:  2 kB\nMemAvailable: 1 kB", "MemAvailable:"), Some(1024));
        assert_eq!(entry("MemTotal:  2 kB", "MemAvailable:"), None);
        assert_eq!([1_234_000_000, 73_440].map(size), ["1.23 GB", "0.0734 MB"]);
    }
}
