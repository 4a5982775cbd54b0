//! Figures of trajectories, together and one by one: tables for people, and the figures file.

use super::{Case, FieldErrors, Pace, Prediction};
use m4gn_base::listed;
use m4gn_base::settings::object;
use m4gn_data::Split;
use m4gn_domain::body::quality::Quality;
use m4gn_report::{Table, number};
use m4gn_train::errors::Figures;
use serde_json::{Map, Value, json};

fn figures_cells(f: Figures) -> [String; 3] {
    [f.rmse_1, f.rmse_50, f.rmse_all].map(error_cell)
}

fn error_cell(v: f64) -> String {
    match v.is_finite() {
        true => number(v, 3),
        false if v.is_nan() => "-".into(),
        false => "not finite".into(),
    }
}

/// Data that vary by less than this part of their root mean square hardly move: on them who holds the first frame is right.
const MOVES: f64 = 0.02;

/// A way to predict, and what it scores.
#[derive(Clone, Debug)]
pub struct Row {
    /// Name in figures files.
    pub key: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Errors of each predicted field, the headline first.
    pub figures: Vec<Figures>,
    /// Mesh metrics of the rollout.
    pub quality: Option<Quality>,
    /// Smallest gap of the rollout, mean edges.
    pub gap: Option<f64>,
    /// Error of the headline field at the rollout's end but for a shift in time; the mean over the trajectories that end in a cycle.
    pub phase_free: Option<f64>,
    /// Largest value of the headline field over the largest recorded one.
    pub largest: Option<f64>,
    /// Wall seconds of all steps, and their number.
    pub seconds: (f64, usize),
}

impl Row {
    fn of(p: &Prediction, pace: Pace, horizon: f64) -> Self {
        let steps = [pace.steps_within(horizon), pace.steps];
        let diverged = p.diverged.is_some();
        let figures = |f: &FieldErrors| Figures::of(&f.single, &f.rollout, steps, diverged);
        Row {
            key: p.key,
            name: p.name,
            figures: p.fields.iter().map(figures).collect(),
            quality: p.quality.as_ref().map(|all| match p.diverged {
                None => Quality::mean(all),
                Some(_) => Quality::of(|_| f64::INFINITY),
            }),
            gap: smallest(&p.gap),
            phase_free: p.phase_free,
            largest: p.largest,
            seconds: p.seconds,
        }
    }

    /// The same row of several trajectories.
    fn merged(all: &[&Row]) -> Self {
        let rows = || all.iter();
        let quality: Option<Vec<Quality>> = rows().map(|r| r.quality).collect();
        let phase_free: Vec<f64> = rows().filter_map(|r| r.phase_free).collect();
        let mean = || phase_free.iter().sum::<f64>() / phase_free.len() as f64;
        let seconds = rows().fold((0.0, 0), |(s, n), r| (s + r.seconds.0, n + r.seconds.1));
        Row {
            figures: (0..all[0].figures.len())
                .map(|k| Figures::mean(rows().map(|r| &r.figures[k])))
                .collect(),
            quality: quality.map(|q| Quality::mean(&q)),
            gap: rows().filter_map(|r| r.gap).reduce(f64::min),
            phase_free: (!phase_free.is_empty()).then(mean),
            largest: rows().filter_map(|r| r.largest).reduce(f64::max),
            seconds,
            ..all[0].clone()
        }
    }

    /// Mean wall time of a step, ms; none of predictions that take none.
    pub fn step_ms(&self) -> Option<f64> {
        let (seconds, count) = self.seconds;
        (count > 0).then(|| 1e3 * seconds / count as f64)
    }

    fn json(&self) -> Value {
        // What is not finite is null
        let mut row = object(json!(self.figures[0]));
        row.extend(object(json!(self.quality)));
        let others = [
            ("phase_free", self.phase_free),
            ("worst_gap", self.gap),
            ("largest_ratio", self.largest),
            ("ms_per_step", self.step_ms()),
        ];
        row.extend(others.into_iter().filter_map(|(key, v)| Some((key.to_string(), json!(v?)))));
        Value::Object(row)
    }
}

fn smallest(gaps: &[f64]) -> Option<f64> {
    gaps.iter().copied().reduce(f64::min)
}

impl Case {
    /// All ways to predict: the model's first.
    pub fn rows(&self) -> Vec<Row> {
        let row = |p| Row::of(p, self.pace, self.horizon);
        self.predictions.iter().map(row).collect()
    }
}

/// The figures of the trajectories of one split, or of all.
#[derive(Clone, Debug)]
pub struct Summary {
    /// `test`, `valid`, `train` or `all`.
    pub name: &'static str,
    /// Number of trajectories.
    pub count: usize,
    /// Names and units of the predicted fields, the headline first.
    pub fields: Vec<(String, String)>,
    /// Ways to predict, the model's first.
    pub rows: Vec<Row>,
    /// Smallest gap of the data, mean edges.
    pub data_gap: Option<f64>,
    /// Trajectories with a rollout that became non-finite.
    pub diverged: usize,
    /// Names of the trajectories whose data hardly move.
    pub still: Vec<String>,
    /// The rows of the others; empty where all are of one sort.
    pub moving: Vec<Row>,
    /// Mean processor time of the data's solver over one stride, ms, where it was recorded.
    pub solver_ms: Option<f64>,
    /// Times that RMSE-50 covers, s: the shortest and the longest of the trajectories.
    pub horizon: [f64; 2],
}

impl Summary {
    fn of(name: &'static str, cases: &[&Case]) -> Option<Self> {
        let first = cases.first()?;
        let tables: Vec<Vec<Row>> = cases.iter().map(|c| c.rows()).collect();
        let over = |tables: &[&Vec<Row>]| -> Vec<Row> {
            let rows = 0..tables.first().map_or(0, |t| t.len());
            rows.map(|i| Row::merged(&tables.iter().map(|t| &t[i]).collect::<Vec<_>>())).collect()
        };
        let (moving, still): (Vec<_>, Vec<_>) =
            tables.iter().zip(cases).partition(|(_, case)| case.variation >= MOVES);
        let moving: Vec<&Vec<Row>> = moving.into_iter().map(|(table, _)| table).collect();
        let file = |case: &Case| case.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let solver = cases.iter().map(|c| Some(1e3 * c.solver? * c.pace.frames as f64));
        let solver: Option<Vec<f64>> = solver.collect();
        let horizons = cases.iter().map(|c| c.horizon);
        Some(Summary {
            name,
            count: cases.len(),
            fields: first.fields.clone(),
            rows: over(&tables.iter().collect::<Vec<_>>()),
            moving: if still.is_empty() { Vec::new() } else { over(&moving) },
            still: still.iter().map(|(_, case)| file(case)).collect(),
            data_gap: cases.iter().filter_map(|c| smallest(&c.data_gap)).reduce(f64::min),
            diverged: cases.iter().filter(|c| c.diverged().is_some()).count(),
            solver_ms: solver.map(|s| s.iter().sum::<f64>() / s.len() as f64),
            horizon: horizons.fold([f64::INFINITY, 0.0], |[a, b], v| [a.min(v), b.max(v)]),
        })
    }

    /// The rows that people compare, a table a predicted field. The headline's has the mesh metrics and gaps as well.
    pub fn tables(&self) -> Vec<Table> {
        let [shortest, longest] = self.horizon;
        let time = match longest - shortest > 1e-6 * longest {
            true => format!("{} to {} s", number(shortest, 3), number(longest, 3)),
            false => format!("{} s", number(longest, 3)),
        };
        let table = |(k, (field, unit)): (usize, &(String, String))| {
            let mut columns = vec![
                format!("{}, {field}", self.name),
                format!("RMSE-1 [{unit}]"),
                format!("RMSE-50 ({time}) [{unit}]"),
                format!("RMSE-all [{unit}]"),
            ];
            let has_quality = k == 0 && self.rows.iter().any(|r| r.quality.is_some());
            let has_gap = k == 0 && self.rows.iter().any(|r| r.gap.is_some());
            let has_cycle = k == 0 && self.rows.iter().any(|r| r.phase_free.is_some());
            columns.extend(has_cycle.then(|| format!("phase-free [{unit}]")));
            if has_quality {
                columns.extend(["GFh [m]", "GFc [m2]", "MC", "AR"].map(String::from));
            }
            columns.extend(has_gap.then(|| "worst gap [cells]".to_string()));
            let mut table = Table::new(columns);
            for row in &self.rows {
                let mut cells = vec![row.name.to_string()];
                cells.extend(figures_cells(row.figures[k]));
                if has_cycle {
                    cells.push(row.phase_free.map_or(String::new(), error_cell));
                }
                if has_quality {
                    let quality = row.quality.map(|q| [q.gf_h, q.gf_c, q.mc, q.ar]);
                    cells.extend(quality.map_or([const { String::new() }; 4], |q| q.map(|v| number(v, 3))));
                }
                if has_gap {
                    cells.push(row.gap.map_or(String::new(), |g| format!("{g:+.4}")));
                }
                table.row(cells);
            }
            table
        };
        self.fields.iter().enumerate().map(table).collect()
    }

    /// Times, the largest value, and the gap of the data, in a sentence or two.
    pub fn line(&self) -> String {
        let times = self.rows.iter().filter_map(|r| Some((r.name, r.step_ms()?)));
        let times = listed(times.map(|(name, ms)| format!("{} ms a step ({name})", number(ms, 3))));
        let mut text = format!("{} trajectories, {times}", self.count);
        if let (Some(ms), Some(ratio)) = (self.solver_ms, self.ratio()) {
            text += &format!(
                "; the data's solver took {} ms for as much, {} times as long",
                number(ms, 3),
                number(ratio, 3)
            );
        }
        if let Some(largest) = self.rows.iter().filter_map(|r| r.largest).reduce(f64::max) {
            let field = &self.fields[0].0;
            text += &match self.diverged {
                0 => {
                    format!(". Largest {field} of a rollout: {} of the largest recorded", number(largest, 3))
                }
                n => format!(". {n} trajectories with a rollout that became non-finite"),
            };
        }
        if !self.still.is_empty() {
            let (still, percent) = (listed(&self.still), 100.0 * MOVES);
            text += &format!(". Data that vary by less than {percent} % in their second half: {still}");
            let of = |r: &Row| format!("{} ({})", error_cell(r.figures[0].rmse_all), r.name);
            let chosen = self.moving.iter().filter(|r| ["model", "hold_first"].contains(&r.key)).map(of);
            if !self.moving.is_empty() {
                text += &format!("; RMSE-all without them: {}", listed(chosen));
            }
        }
        if let Some(gap) = self.data_gap {
            text += &format!(". Worst gap of the data {gap:+.4} cells");
        }
        text
    }

    /// Solver's time over the time of a step of the model.
    fn ratio(&self) -> Option<f64> {
        let own = self.rows.iter().find_map(Row::step_ms)?;
        self.solver_ms.filter(|_| own > 0.0).map(|s| s / own)
    }

    fn json(&self) -> Value {
        let mut figures = json!({
            "trajectories": self.count,
            "rmse_50_seconds": self.horizon[1],
            "worst_gap_data": self.data_gap,
            "diverged": self.diverged,
            "still": self.still,
            "solver_ms_per_step": self.solver_ms,
            "solver_ratio": self.ratio(),
        });
        add_rows(&mut figures, &self.rows, &self.fields);
        figures
    }
}

/// Adds the headline field with its rows, and the other fields with theirs.
fn add_rows(figures: &mut Value, rows: &[Row], fields: &[(String, String)]) {
    figures["field"] = json!(fields[0].0);
    figures["unit"] = json!(fields[0].1);
    for row in rows {
        figures[row.key] = row.json();
    }
    let mut others = Map::new();
    for (k, (name, unit)) in fields.iter().enumerate().skip(1) {
        let mut other = json!({ "unit": unit });
        for row in rows {
            other[row.key] = json!(row.figures[k]);
        }
        others.insert(name.clone(), other);
    }
    figures["fields"] = Value::Object(others);
}

/// The cases that count: those of the test split where there are any, else all.
pub(super) fn that_count(cases: &[Case]) -> (&'static str, Vec<&Case>) {
    let test = of_split(cases, Split::Test);
    match test.is_empty() {
        false => (Split::Test.name(), test),
        true => ("all", cases.iter().collect()),
    }
}

fn of_split(cases: &[Case], split: Split) -> Vec<&Case> {
    cases.iter().filter(|c| c.split == split).collect()
}

/// One summary a split that has trajectories: test, valid, train.
pub fn summaries(cases: &[Case]) -> Vec<Summary> {
    let splits = [Split::Test, Split::Valid, Split::Train].into_iter();
    splits.filter_map(|s| Summary::of(s.name(), &of_split(cases, s))).collect()
}

/// The figures that count: those of the test split where there is one, else of all trajectories.
pub fn headline(cases: &[Case]) -> Option<Summary> {
    let (name, cases) = that_count(cases);
    Summary::of(name, &cases)
}

/// The figures file: those of [`headline`] at the top, all splits and trajectories below.
pub fn json(cases: &[Case]) -> Value {
    let mut figures = headline(cases).map_or(json!({}), |s| {
        let mut object = s.json();
        object["split"] = json!(s.name);
        object
    });
    let splits = summaries(cases).into_iter().map(|s| (s.name.to_string(), s.json()));
    figures["splits"] = Value::Object(splits.collect());
    let one = |c: &Case| {
        let mut case = json!({
            "path": c.path.to_string_lossy(),
            "split": c.split.name(),
            "diameter": c.diameter,
            "horizon": c.horizon,
            "diverged": c.diverged(),
            "variation": c.variation,
            "outside": c.outside,
        });
        if !c.node_segment.is_empty() {
            case["node_segment"] = json!(c.node_segment);
        }
        add_rows(&mut case, &c.rows(), &c.fields);
        for p in c.predictions.iter().filter(|p| !p.over_segments.is_empty()) {
            let rows =
                p.over_segments.iter().map(|(step, rmse)| json!({ "time": c.times[step - 1], "rmse": rmse }));
            case[p.key]["over_segments"] = rows.collect();
        }
        case
    };
    figures["cases"] = cases.iter().map(one).collect();
    figures
}
