//! Times of things that are measured by turns.

use crate::Result;
use std::time::{Duration, Instant};

/// Times of many runs, ms.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timing {
    sorted: Vec<f64>,
}

impl Timing {
    /// Of these times, ms.
    pub fn new(mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        Timing { sorted: times }
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

/// Runs several things by turns, so that a machine that slows down does so for all of them, after one run of each
/// that does not count.
///
/// # Errors
/// The first that one of them returns.
pub fn alternate(runs: Runs, things: &mut [&mut dyn FnMut() -> Result<()>]) -> Result<Vec<Timing>> {
    for thing in things.iter_mut() {
        thing()?;
    }
    let mut times = vec![Vec::new(); things.len()];
    let began = Instant::now();
    let more = |done: usize| match runs {
        Runs::Exactly(n) => done < n.max(1),
        Runs::For(time) => done < 5 || began.elapsed() < time,
    };
    while more(times.first().map_or(0, Vec::len)) {
        for (thing, times) in things.iter_mut().zip(&mut times) {
            let start = Instant::now();
            thing()?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        if things.is_empty() {
            break;
        }
    }
    Ok(times.into_iter().map(Timing::new).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_are_interpolated() {
        let t = Timing::new(vec![4.0, 1.0, 3.0, 2.0]);
        assert_eq!(
            (t.least(), t.quantile(0.25), t.median(), t.quantile(1.0)),
            (1.0, 1.75, 2.5, 4.0)
        );
        assert!(Timing::new(vec![]).median().is_nan());
    }

    #[test]
    fn things_take_turns() {
        let order = std::cell::RefCell::new(String::new());
        let mut a = || {
            order.borrow_mut().push('a');
            Ok(())
        };
        let mut b = || {
            order.borrow_mut().push('b');
            Ok(())
        };
        let found = alternate(Runs::Exactly(2), &mut [&mut a, &mut b]).unwrap();
        assert_eq!(*order.borrow(), "ababab");
        assert_eq!((found.len(), found[0].count(), found[1].count()), (2, 2, 2));
        let mut failing = || Err(crate::Error::Input("no".into()));
        assert!(alternate(Runs::For(Duration::from_secs(1)), &mut [&mut failing]).is_err());
        assert!(alternate(Runs::Exactly(3), &mut []).unwrap().is_empty());
    }
}
