//! Rows of a series: a value and the time that it stands for.

/// One row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// Time at the end of what the row stands for, s.
    pub time: f64,
    /// The value.
    pub value: f64,
    /// Time that the row stands for, s; more than 0.
    pub weight: f64,
    /// Whether the value came from a surrogate, and not from the solver.
    pub surrogate: bool,
}

/// Rows in the order of time. Row i has its value all over the interval of length `weight` that ends at it; where the intervals leave
/// gaps, the gaps do not count.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Series {
    rows: Vec<Row>,
    /// Time that the rows up to and with this one stand for together, s.
    ends: Vec<f64>,
}

impl Series {
    /// Adds a row. One whose time is not later than the last one's, whose weight is not positive, or that is not finite is left out:
    /// the answer is then false.
    pub fn push(&mut self, row: Row) -> bool {
        let finite = row.time.is_finite() && row.value.is_finite() && row.weight.is_finite();
        let later = self.rows.last().is_none_or(|last| row.time > last.time);
        if !finite || !later || row.weight <= 0.0 {
            return false;
        }
        self.ends.push(self.duration() + row.weight);
        self.rows.push(row);
        true
    }

    /// A series of values at times; each row stands for the time since the one before, the first for as long as the second.
    ///
    /// Rows that [`Series::push`] refuses are left out.
    pub fn of(times: &[f64], values: &[f64]) -> Self {
        let mut series = Series::default();
        let mut before = match times {
            [first, second, ..] => first - (second - first),
            _ => f64::NAN,
        };
        for (&time, &value) in times.iter().zip(values) {
            let weight = if before.is_finite() { time - before } else { 1.0 };
            if series.push(Row { time, value, weight, surrogate: false }) {
                before = time;
            }
        }
        series
    }

    /// The rows.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Time that all rows stand for together, s.
    pub fn duration(&self) -> f64 {
        self.ends.last().copied().unwrap_or(0.0)
    }

    /// The time at which the rows stand for `at` s.
    pub(crate) fn time_at(&self, at: f64) -> f64 {
        let i = self.ends.partition_point(|end| *end < at).min(self.len().saturating_sub(1));
        match self.rows.get(i) {
            Some(row) => row.time - (self.ends[i] - at).clamp(0.0, row.weight),
            None => 0.0,
        }
    }

    /// Integral of `f` of the rows over each of `n` equal pieces between `from` and `to`, divided by the piece's length.
    pub(crate) fn pieces(&self, (from, to): (f64, f64), n: usize, f: impl Fn(&Row) -> f64) -> Vec<f64> {
        let width = (to - from) / n as f64;
        let edge = |k: usize| if k == n { to } else { from + k as f64 * width };
        let mut means = vec![0.0; n];
        let mut k = 0;
        let first = self.ends.partition_point(|end| *end <= from);
        let mut at = from;
        for (row, &end) in self.rows.iter().zip(&self.ends).skip(first) {
            if k >= n {
                break;
            }
            let value = f(row);
            while k < n {
                let stop = end.min(edge(k + 1));
                means[k] += (stop - at).max(0.0) * value;
                at = at.max(stop);
                if end < edge(k + 1) {
                    break;
                }
                k += 1;
            }
        }
        means.iter_mut().for_each(|m| *m /= width);
        means
    }

    /// The rows that end within the range.
    pub(crate) fn within(&self, (from, to): (f64, f64)) -> &[Row] {
        let first = self.ends.partition_point(|end| *end <= from);
        let last = self.ends.partition_point(|end| *end <= to);
        &self.rows[first..last.max(first)]
    }

    /// Mean of `f` of the rows between `from` and `to`.
    pub(crate) fn mean(&self, range: (f64, f64), f: impl Fn(&Row) -> f64) -> f64 {
        self.pieces(range, 1, f)[0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cut_rows_where_they_end() {
        // 1 over (0, 1], 5 over (1, 3]
        let series = Series::of(&[1.0, 3.0], &[1.0, 5.0]);
        assert_eq!(series.duration(), 4.0, "the first row stands for as long as the second");
        let mut series = Series::default();
        assert!(series.push(Row { time: 1.0, value: 1.0, weight: 1.0, surrogate: false }));
        assert!(series.push(Row { time: 3.0, value: 5.0, weight: 2.0, surrogate: true }));
        assert_eq!(series.pieces((0.0, 3.0), 2, |r| r.value), [(1.0 + 2.5) / 1.5, 5.0]);
        assert_eq!(series.mean((0.5, 1.5), |r| r.value), 3.0);
        assert_eq!(series.mean((0.0, 3.0), |r| f64::from(r.surrogate)), 2.0 / 3.0);
        assert_eq!(series.pieces((0.0, 3.0), 6, |r| r.value), [1.0, 1.0, 5.0, 5.0, 5.0, 5.0]);
        assert_eq!([0.0, 0.5, 2.0, 3.0].map(|at| series.time_at(at)), [0.0, 0.5, 2.0, 3.0]);
    }

    #[test]
    fn rows_that_are_not_later_or_not_finite_are_refused() {
        let mut series = Series::of(&[1.0, 2.0], &[0.0, 0.0]);
        let row = Row { time: 3.0, value: 1.0, weight: 1.0, surrogate: false };
        for wrong in [
            Row { time: 2.0, ..row },
            Row { time: f64::NAN, ..row },
            Row { value: f64::INFINITY, ..row },
            Row { weight: 0.0, ..row },
        ] {
            assert!(!series.push(wrong), "{wrong:?}");
        }
        assert!(series.push(row));
        assert_eq!(series.len(), 3);
    }
}
