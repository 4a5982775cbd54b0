//! What the machine can do, measured: the rate of matrix products.

use m4gn_engine as engine;
use m4gn_engine::{EngineOptions, Isa, Peak};

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
