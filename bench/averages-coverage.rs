//! How often the intervals of m4gn-averages hold, and how often a run would have been stopped too early, on processes whose means are
//! known; beside the criterion `average` of OpenFOAM's runTimeControl on the same series.
//!
//!     cargo run --release -p m4gn-averages --example averages-coverage [-- SERIES [PROCESS]]

#[path = "../src/averages/processes.rs"]
mod processes;

use m4gn_averages::{Estimate, Goal, Row, Series, Tolerance, Watch, estimate};
use processes::{ALL, Kind, Process};

fn main() {
    let count: u64 = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(200);
    let only = std::env::args().nth(2).unwrap_or_default();
    let chosen = || ALL.into_iter().filter(|(name, _)| name.contains(&only));
    println!("{count} series of each process, 95 % intervals, each with a transient of five rms.");
    println!("Lengths in independent samples of the mean, of Lorenz z and the sines in periods.\n");
    println!("Fixed lengths: share of intervals that hold the true value, %\n");
    println!("| process | length | mean | rms |\n| --- | --- | --- | --- |");
    for (name, kind) in chosen() {
        for length in [50.0, 200.0, 800.0] {
            let [mean, rms] = fixed(kind, length, count);
            println!("| {name} | {length} | {mean:.1} | {rms:.1} |");
        }
    }
    println!(
        "\nStopped when settled at a tolerance that a mean of this length would just have; of the rms at half of sqrt(40 / length)"
    );
    println!(
        "of it. False: farther off than the tolerance, of all that stop, %. Rows: over those of the length.\n"
    );
    println!(
        "| process | length | mean: stops | holds | false | rows | rms: stops | holds | false | runTimeControl: stops | false | rows |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, kind) in chosen() {
        for length in [30.0, 100.0, 400.0] {
            let [mean, rms, foam] = sequential(kind, length, count);
            println!(
                "| {name} | {length} | {} | {} | {} |",
                mean.all(),
                rms.without_rows(),
                foam.without_holds()
            );
        }
    }
}

/// What became of the runs of one criterion.
#[derive(Default)]
struct Tally {
    stops: f64,
    holds: f64,
    wrong: f64,
    rows: f64,
}

impl Tally {
    fn add(&mut self, holds: bool, wrong: bool, rows: f64) {
        self.stops += 1.0;
        self.holds += f64::from(holds);
        self.wrong += f64::from(wrong);
        self.rows += rows;
    }

    fn percent(&self, part: f64) -> String {
        format!("{:.1}", 100.0 * part / self.stops)
    }

    fn all(&self) -> String {
        let rows = self.rows / self.stops;
        format!("{} | {} | {} | {rows:.2}", self.stops, self.percent(self.holds), self.percent(self.wrong))
    }

    fn without_rows(&self) -> String {
        format!("{} | {} | {}", self.stops, self.percent(self.holds), self.percent(self.wrong))
    }

    fn without_holds(&self) -> String {
        format!("{} | {} | {:.2}", self.stops, self.percent(self.wrong), self.rows / self.stops)
    }
}

/// Rows of a process from its beginning on.
struct Rows {
    process: Process,
    time: f64,
}

impl Rows {
    fn new(kind: Kind, seed: u64) -> Self {
        Rows { process: Process::new(kind, seed, true), time: 0.0 }
    }

    fn next(&mut self) -> Row {
        let (weight, value) = self.process.next_row();
        self.time += weight;
        Row { time: self.time, value, weight, surrogate: false }
    }
}

/// Shares of the intervals of mean and rms that hold.
fn fixed(kind: Kind, length: f64, count: u64) -> [f64; 2] {
    let (mean, rms, per) = kind.truth();
    let mut held = [0.0; 2];
    for seed in 0..count {
        let mut rows = Rows::new(kind, seed);
        let mut series = Series::default();
        for _ in 0..((length * per) as usize).max(64) {
            series.push(rows.next());
        }
        if let Some(found) = estimate(&series, 0.95) {
            held[0] += f64::from((found.mean - mean).abs() <= found.half_width);
            held[1] += f64::from((found.rms - rms).abs() <= found.rms_half_width);
        }
    }
    held.map(|h| 100.0 * h / count as f64)
}

/// Runs until the mean is settled, until the rms is, and until runTimeControl stops.
fn sequential(kind: Kind, length: f64, count: u64) -> [Tally; 3] {
    let (mean, rms, per) = kind.truth();
    let tolerance = 1.96 * rms / length.sqrt();
    let rms_tolerance = rms / length.sqrt();
    let longest = (20.0 * length * per).max(8000.0) as usize;
    let mut tallies: [Tally; 3] = Default::default();
    for seed in 0..count {
        let mut rows = Rows::new(kind, 1_000_000 + seed);
        let goal = |mean: Option<f64>, rms: Option<f64>| Goal {
            mean: mean.map(Tolerance::Absolute),
            rms: rms.map(Tolerance::Absolute),
        };
        let mut watches =
            [goal(Some(tolerance), None), goal(None, Some(rms_tolerance))].map(|g| Some(Watch::new(0.95, g)));
        let mut foam = Some(RunTimeControl::new(tolerance));
        for i in 1..=longest {
            let row = rows.next();
            let share = i as f64 / (length * per);
            for (k, place) in watches.iter_mut().enumerate() {
                let Some(found) = place.as_mut().and_then(|watch| settled(watch, row)) else { continue };
                let (off, half_width, limit) = match k {
                    0 => ((found.mean - mean).abs(), found.half_width, tolerance),
                    _ => ((found.rms - rms).abs(), found.rms_half_width, rms_tolerance),
                };
                tallies[k].add(off <= half_width, off > limit, share);
                *place = None;
            }
            if let Some(average) = foam.as_mut().and_then(|f| f.step(row)) {
                tallies[2].add(false, (average - mean).abs() > tolerance, share);
                foam = None;
            }
            if foam.is_none() && watches.iter().all(Option::is_none) {
                break;
            }
        }
    }
    tallies
}

/// The estimate at which a watch is settled with this row.
fn settled(watch: &mut Watch, row: Row) -> Option<Estimate> {
    watch.series.push(row);
    let found = if watch.due() { watch.check() } else { None };
    found.filter(|_| watch.settled())
}

/// The condition `average` of runTimeControl as OpenFOAM v1912 has it (averageConditionTemplates.C, no window): the mean so far and the
/// present value differ by no more than the tolerance, after nIterStartUp (10) iterations.
struct RunTimeControl {
    tolerance: f64,
    total: f64,
    mean: f64,
    iterations: i64,
}

impl RunTimeControl {
    fn new(tolerance: f64) -> Self {
        RunTimeControl { tolerance, total: 0.0, mean: 0.0, iterations: -1 }
    }

    fn step(&mut self, row: Row) -> Option<f64> {
        let may = self.iterations > 10;
        self.iterations += 1;
        self.total += row.weight;
        let beta = row.weight / self.total;
        self.mean = (1.0 - beta) * self.mean + beta * row.value;
        (may && (self.mean - row.value).abs() <= self.tolerance).then_some(self.mean)
    }
}
