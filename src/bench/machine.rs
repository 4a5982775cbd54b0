//! What the machine can do, measured: the rate of matrix products and that of the memory.

use crate::Result;
use crate::engine::EngineOptions;
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
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

/// The best rate of n x 128 x 128 products that was seen so far: the ceiling of a network of this width.
pub struct Peak {
    threads: usize,
    best: f64,
}

impl Peak {
    /// For the precision, threads and instructions of an engine.
    ///
    /// # Errors
    /// None yet.
    pub fn new(options: &EngineOptions) -> Result<Self> {
        Ok(Peak {
            threads: options.n_threads.max(1),
            best: 0.0,
        })
    }

    /// One measurement of some milliseconds.
    ///
    /// # Errors
    /// None yet.
    pub fn probe(&mut self) -> Result<()> {
        const N: usize = 256;
        const D: usize = 128;
        const REPEATS: usize = 40;
        let worker = || {
            let (x, w, mut y) = (vec![1.0f32; N * D], vec![1.0f32; D * D], vec![0.0f32; N * D]);
            let began = Instant::now();
            for _ in 0..REPEATS {
                matmul(
                    MatMut::from_row_major_slice_mut(&mut y, N, D),
                    Accum::Replace,
                    MatRef::from_row_major_slice(&x, N, D),
                    MatRef::from_row_major_slice(&w, D, D),
                    1.0,
                    Par::Seq,
                );
            }
            began.elapsed().as_secs_f64()
        };
        let slowest = std::thread::scope(|scope| {
            let handles: Vec<_> = (0..self.threads).map(|_| scope.spawn(worker)).collect();
            handles
                .into_iter()
                .filter_map(|h| h.join().ok())
                .fold(0.0, f64::max)
        });
        self.best = self
            .best
            .max((2 * N * D * D * REPEATS * self.threads) as f64 / slowest);
        Ok(())
    }

    /// The best so far, operations a second.
    pub fn best(&self) -> f64 {
        self.best
    }

    /// Name of the instruction set.
    pub fn instructions(&self) -> &'static str {
        "faer"
    }
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
