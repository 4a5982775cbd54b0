//! Times of many runs, and the rate of matrix products that the machine can do.

use m4gn_base::Result;
use m4gn_engine::{EngineOptions, Isa, Peak};
use rustix::time::{ClockId, clock_gettime};
use std::time::{Duration, Instant};

/// Times of many runs, ms.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timing {
    sorted: Vec<f64>,
    /// Processor time of all runs over their wall time: the threads that ran, on average.
    pub busy: f64,
}

impl Timing {
    /// Of these times, ms.
    pub fn new(mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        Timing { sorted: times, busy: f64::NAN }
    }

    /// Number of runs.
    pub fn count(&self) -> usize {
        self.sorted.len()
    }

    /// The time below which this share of the runs stays, ms, interpolated; NaN without a run.
    pub fn quantile(&self, share: f64) -> f64 {
        let Some(last) = self.sorted.len().checked_sub(1) else {
            return f64::NAN;
        };
        let at = share.clamp(0.0, 1.0) * last as f64;
        let (low, high) = (at.floor() as usize, at.ceil() as usize);
        self.sorted[low] + (self.sorted[high] - self.sorted[low]) * at.fract()
    }

    /// The median, ms.
    pub fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    /// The shortest, ms.
    pub fn least(&self) -> f64 {
        self.quantile(0.0)
    }
}

/// How often to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Runs {
    /// This many times.
    Exactly(usize),
    /// For this long, at least five times.
    For(Duration),
}

impl Runs {
    /// Times of a thing that is run so often, after a run that does not count.
    ///
    /// # Errors
    /// The first that it returns.
    pub fn time(self, mut thing: impl FnMut() -> Result<()>) -> Result<Timing> {
        thing()?;
        let mut times = Vec::new();
        let (began, processor) = (Instant::now(), processor_time());
        loop {
            let start = Instant::now();
            thing()?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
            let done = match self {
                Runs::Exactly(n) => times.len() >= n,
                Runs::For(time) => times.len() >= 5 && began.elapsed() >= time,
            };
            if done {
                let busy = (processor_time() - processor) / began.elapsed().as_secs_f64();
                return Ok(Timing { busy, ..Timing::new(times) });
            }
        }
    }
}

/// Rates of all threads together, GFLOP/s: what the units give on registers, and a product of `[8192 x 128]` with
/// `[128 x 128]`, measured at the same time on every thread.
pub fn peak(options: &EngineOptions) -> Peak {
    let isa = options.isa.unwrap_or_else(Isa::detect);
    std::thread::scope(|scope| {
        let one = || m4gn_engine::peak(options.precision, isa);
        let handles: Vec<_> = (0..options.n_threads.max(1)).map(|_| scope.spawn(one)).collect();
        let found = handles.into_iter().filter_map(|h| h.join().ok());
        let none = Peak { units: 0.0, product: 0.0 };
        found.fold(none, |sum, p| Peak { units: sum.units + p.units, product: sum.product + p.product })
    })
}

/// Processor time of all threads of this process so far, s.
pub fn processor_time() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_are_interpolated() {
        let t = Timing::new(vec![4.0, 1.0, 3.0, 2.0]);
        assert_eq!((t.least(), t.quantile(0.25), t.median(), t.quantile(1.0)), (1.0, 1.75, 2.5, 4.0));
        assert!(Timing::new(vec![]).median().is_nan());
    }

    #[test]
    fn one_run_more_than_is_counted() {
        let mut runs = 0;
        let found = Runs::Exactly(3).time(|| {
            runs += 1;
            Ok(())
        });
        assert_eq!((found.unwrap().count(), runs), (3, 4));
        let found = Runs::For(Duration::ZERO).time(|| Ok(()));
        assert_eq!(found.unwrap().count(), 5);
        assert!(Runs::Exactly(1).time(|| Err(m4gn_base::Error::Input("no".into()))).is_err());
    }
}
