//! What the machine can do, measured: the rate of matrix products and that of the memory.

use m4gn_engine as engine;
use m4gn_engine::{EngineOptions, Isa, Peak};
use std::fs;
use std::sync::Barrier;
use std::time::Instant;

/// Size of the last-level cache, bytes; 64 MiB where the kernel does not tell.
fn last_level_cache() -> usize {
    let read = |index: usize| {
        let path = format!("/sys/devices/system/cpu/cpu0/cache/index{index}/size");
        let text = fs::read_to_string(path).ok()?;
        let (number, unit) = text.trim().split_at(text.trim().len().checked_sub(1)?);
        let factor = match unit {
            "K" => 1 << 10,
            "M" => 1 << 20,
            _ => return None,
        };
        Some(number.parse::<usize>().ok()? * factor)
    };
    (0..8).filter_map(read).max().unwrap_or(64 << 20)
}

/// Rate of the memory, bytes a second: the triad a = b + s c of STREAM (McCalpin 1995) over arrays twice as large as
/// the last-level cache, counting two reads and one write; the best of `rounds`.
pub fn bandwidth(threads: usize, rounds: usize) -> f64 {
    let threads = threads.max(1);
    let n = 2 * last_level_cache() / 8 / threads;
    let start = Barrier::new(threads);
    let worker = || {
        let (b, c) = (vec![1.0f64; n], vec![2.0f64; n]);
        let mut a = vec![0.0f64; n];
        let mut times = Vec::with_capacity(rounds);
        for round in 0..rounds.max(1) {
            let s = round as f64;
            start.wait();
            let began = Instant::now();
            for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
                *a = b + s * c;
            }
            std::hint::black_box(&mut a);
            times.push(began.elapsed().as_secs_f64());
        }
        times
    };
    let all: Vec<Vec<f64>> = std::thread::scope(|scope| {
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(worker)).collect();
        handles.into_iter().filter_map(|h| h.join().ok()).collect()
    });
    // A round takes as long as its slowest thread.
    let best = (0..rounds.max(1))
        .map(|round| all.iter().map(|times| times[round]).fold(0.0, f64::max))
        .fold(f64::INFINITY, f64::min);
    (3 * 8 * n * threads) as f64 / best
}

/// Rates of all threads together, GFLOP/s: what the units give on registers, and a product of `[8192 x 128]` with
/// `[128 x 128]`, measured at the same time on every thread.
pub fn peak(options: &EngineOptions) -> Peak {
    let isa = options.isa.unwrap_or_else(Isa::detect);
    let threads = options.n_threads.max(1);
    std::thread::scope(|scope| {
        let one = || engine::peak(options.precision, isa);
        let handles: Vec<_> = (0..threads).map(|_| scope.spawn(one)).collect();
        let found = handles.into_iter().filter_map(|h| h.join().ok());
        let none = Peak { units: 0.0, product: 0.0 };
        found.fold(none, |sum, p| Peak { units: sum.units + p.units, product: sum.product + p.product })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_memory_moves() {
        let rate = bandwidth(1, 2);
        assert!(rate > 1e8 && rate < 1e13, "{rate}");
        assert!(last_level_cache() >= 1 << 18);
    }
}
