//! How often the intervals of m4gn-averages hold, and how often a run would have been stopped too early, on processes whose means are
//! known, or on pieces of a long run's table; beside the criterion `average` of OpenFOAM's runTimeControl on the same series.
//!
//!     cargo run --release -p m4gn-averages --example averages-coverage [-- SERIES [PROCESS]]
//!     cargo run --release -p m4gn-averages --example averages-coverage -- SERIES START COLUMN,... TABLE...
//!
//! Of a table the true mean and rms are those of all its columns from the time START on. Its pieces begin at equal distances within its first
//! three quarters, also before START, and may go on to its end.

#[path = "../src/averages/processes.rs"]
mod processes;

use m4gn_averages::{Estimate, Goal, Row, Series, Tolerance, Watch, estimate, table};
use processes::{ALL, Kind, Process};
use std::path::Path;

fn main() -> m4gn_base::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let count = args.first().and_then(|a| a.parse().ok()).unwrap_or(200);
    let sources: Vec<(String, Vec<Source>)> = match args.get(1..) {
        Some([start, columns, tables @ ..]) => {
            let start = start.parse().expect("START, a time in s");
            let all: m4gn_base::Result<Vec<Source>> =
                tables.iter().map(|path| Source::of_table(Path::new(path), columns, start)).collect();
            vec![(format!("column {columns}"), all?)]
        }
        _ => {
            let only = args.get(1).map_or("", String::as_str);
            let chosen = ALL.into_iter().filter(|(name, _)| name.contains(only));
            chosen.map(|(name, kind)| (name.to_string(), vec![Source::of_process(kind)])).collect()
        }
    };
    println!("{count} series of each source, 95 % intervals; processes begin with a transient of five rms.");
    println!("Lengths in independent samples of the mean, of what repeats itself in periods.\n");
    println!("Fixed lengths: share of intervals that hold the true value, %\n");
    println!("| source | length | mean | rms |\n| --- | --- | --- | --- |");
    for (name, sources) in &sources {
        for length in [50.0, 200.0, 800.0] {
            let [mean, rms] = fixed(sources, length, count);
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
        "| source | length | mean: stops | holds | false | rows | rms: stops | holds | false | runTimeControl: stops | false | rows |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, sources) in &sources {
        for length in [30.0, 100.0, 400.0] {
            let [mean, rms, foam] = sequential(sources, length, count);
            println!(
                "| {name} | {length} | {} | {} | {} |",
                mean.all(),
                rms.without_rows(),
                foam.without_holds()
            );
        }
    }
    Ok(())
}

/// Where series come from, with the true mean, the true rms of the fluctuations, and rows for one independent sample of the mean.
struct Source {
    truth: (f64, f64, f64),
    from: From,
}

enum From {
    Process(Kind),
    /// Rows of each column.
    Table(Vec<Vec<Row>>),
}

impl Source {
    fn of_process(kind: Kind) -> Self {
        Source { truth: kind.truth(), from: From::Process(kind) }
    }

    fn of_table(path: &Path, columns: &str, start: f64) -> m4gn_base::Result<Self> {
        let columns: Vec<table::Column> =
            columns.split(',').map(|name| table::read(path, name)).collect::<m4gn_base::Result<_>>()?;
        let found: Vec<Estimate> = columns.iter().filter_map(|c| estimate(&c.series(start), 0.95)).collect();
        let mean_of = |of: &dyn Fn(&Estimate) -> f64| found.iter().map(of).sum::<f64>() / found.len() as f64;
        let mean = mean_of(&|e| e.mean);
        let rms = mean_of(&|e| e.rms.powi(2) + (e.mean - mean).powi(2)).sqrt();
        let per = mean_of(&|e| e.rows as f64 / e.periods.map_or(e.independent_samples, |n| n as f64));
        eprintln!("{}: mean {mean:.6}, rms {rms:.6}, {per:.1} rows for a sample", path.display());
        let rows = columns.iter().map(|c| c.series(f64::NEG_INFINITY).rows().to_vec()).collect();
        Ok(Source { truth: (mean, rms, per), from: From::Table(rows) })
    }

    /// Series `i` of `count`; one of a process begins with a transient, is of seed `seeds` + `i`, and does not end.
    fn series(&self, i: u64, count: u64, seeds: u64) -> Box<dyn Iterator<Item = Row> + '_> {
        match &self.from {
            From::Process(kind) => {
                let mut process = Process::new(*kind, seeds + i, true);
                let mut time = 0.0;
                Box::new(std::iter::repeat_with(move || {
                    let (weight, value) = process.next_row();
                    time += weight;
                    Row { time, value, weight, surrogate: false }
                }))
            }
            From::Table(columns) => {
                let (i, number) = (i as usize, columns.len());
                let rows = &columns[i % number];
                let begin = (i / number) * (rows.len() * 3 / 4) / (count as usize).div_ceil(number);
                Box::new(rows[begin..].iter().copied())
            }
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

/// Shares of the intervals of mean and rms that hold, %, of `count` series of all sources.
fn fixed(sources: &[Source], length: f64, count: u64) -> [f64; 2] {
    let (mut held, mut all) = ([0.0; 2], 0.0);
    for (source, i, of) in each(sources, count) {
        let (mean, rms, per) = source.truth;
        let rows = ((length * per) as usize).max(64);
        let mut series = Series::default();
        for row in source.series(i, of, 0).take(rows) {
            series.push(row);
        }
        if let Some(found) = estimate(&series, 0.95).filter(|found| found.rows == rows) {
            all += 1.0;
            held[0] += f64::from((found.mean - mean).abs() <= found.half_width);
            held[1] += f64::from((found.rms - rms).abs() <= found.rms_half_width);
        }
    }
    held.map(|h| 100.0 * h / all)
}

/// Series of all sources, `count` together: the source, the number of the series in it, and how many it has.
fn each(sources: &[Source], count: u64) -> impl Iterator<Item = (&Source, u64, u64)> {
    let of = count.div_ceil(sources.len() as u64);
    sources.iter().flat_map(move |source| (0..of).map(move |i| (source, i, of)))
}

/// Runs until the mean is settled, until the rms is, and until runTimeControl stops.
fn sequential(sources: &[Source], length: f64, count: u64) -> [Tally; 3] {
    let mut tallies: [Tally; 3] = Default::default();
    for (source, i, of) in each(sources, count) {
        let (mean, rms, per) = source.truth;
        let tolerance = 1.96 * rms / length.sqrt();
        let rms_tolerance = rms / length.sqrt();
        let longest = (20.0 * length * per).max(8000.0) as usize;
        let goal = |mean: Option<f64>, rms: Option<f64>| Goal {
            mean: mean.map(Tolerance::Absolute),
            rms: rms.map(Tolerance::Absolute),
        };
        let mut watches =
            [goal(Some(tolerance), None), goal(None, Some(rms_tolerance))].map(|g| Some(Watch::new(0.95, g)));
        let mut foam = Some(RunTimeControl::new(tolerance));
        for (k, row) in source.series(i, of, 1_000_000).take(longest).enumerate() {
            let share = (k + 1) as f64 / (length * per);
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
