//! What came of a study: a table a test, for people (text, Markdown) and for programs (JSON).

use super::figures::{Spread, TRAJECTORIES, counts, figure, logarithms};
use super::paired::Paired;
use super::{Cell, Data, Failure, Plan};
use m4gn_base::{Result, files, listed};
use m4gn_report::{Table, number};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Predictions that need no training, in every table.
const BASELINES: [(&str, &str); 4] = [
    ("persistence", "persistence"),
    ("hold_first", "hold first"),
    ("extrapolation", "extrapolation"),
    ("dmd", "dmd"),
];

/// Horizons of the paper's tables.
const HORIZONS: [(&str, &str); 3] = [("rmse_1", "RMSE-1"), ("rmse_50", "RMSE-50"), ("rmse_all", "RMSE-all")];

/// What not all data have: cycles, and the mesh metrics of bodies (appendix C.2).
const OF_SOME: [(&str, &str); 5] =
    [("phase_free", "phase-free"), ("gf_h", "GFh"), ("gf_c", "GFc"), ("mc", "MC"), ("ar", "AR")];

impl Cell {
    /// Its figures in a line.
    pub(super) fn line(&self) -> String {
        let [steps, seconds] = ["steps", "seconds"].map(|key| self.training[key].as_f64().unwrap_or(0.0));
        let mut text = format!("{steps} updates in {} s", number(seconds, 3));
        for (test, count, figures) in &self.tests {
            let of = |(key, name)| Some(format!("{name} {}", number(figures["model"][key].as_f64()?, 3)));
            let more = count.map_or(String::new(), |n| format!(" with {n} segments"));
            text += &format!("; {test}{more}: {}", listed(HORIZONS.into_iter().filter_map(of)));
        }
        text
    }
}

/// A table and what it is of.
#[derive(Clone, Debug)]
struct Section {
    heading: String,
    note: String,
    table: Table,
}

/// A report.
#[derive(Clone, Debug)]
pub struct Report {
    title: String,
    sections: Vec<Section>,
    json: Value,
    /// How many trainings or validations failed.
    pub failures: usize,
}

impl Report {
    /// Of the cells that there are, and of what failed.
    pub fn new(plan: &Plan, cells: &[Cell], failures: &[Failure]) -> Self {
        let tests = plan.data.iter().flat_map(|data| {
            let tests = data.tests().into_owned().into_iter();
            tests.map(move |test| section(plan, data, &test.name, (cells, failures)))
        });
        let (sections, tests): (Vec<Section>, Vec<Value>) = tests.unzip();
        let trained = |c: &Cell| json!({ "data": c.data, "network": c.network, "seed": c.seed, "training": c.training });
        let json = json!({
            "title": plan.title, "plan": plan, "failed": failures, "tests": tests, "cells": cells.iter().map(trained).collect::<Vec<_>>(),
        });
        Report { title: plan.title.clone(), sections, json, failures: failures.len() }
    }

    /// The tables as text.
    pub fn text(&self) -> String {
        let one = |s: &Section| format!("{}\n{}\n\n{}\n", s.heading, s.note, s.table);
        self.sections.iter().map(one).collect()
    }

    /// Writes `study.json` and `study.md` into a folder.
    ///
    /// # Errors
    /// [`m4gn_base::Error::File`] for the one that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let section = |s: &Section| format!("\n## {}\n\n{}\n\n{}", s.heading, s.note, s.table.markdown());
        let sections: String = self.sections.iter().map(section).collect();
        files::write_whole(&folder.join("study.md"), format!("# {}\n{sections}", self.title).as_bytes())?;
        files::write_whole(&folder.join("study.json"), format!("{:#}\n", self.json).as_bytes())
    }
}

/// A network's cells of a test, with one number of segments.
struct Row<'a> {
    network: &'a str,
    count: Option<usize>,
    /// Cells and their figures.
    own: Vec<(&'a Cell, &'a Value)>,
}

impl Row<'_> {
    fn name(&self) -> String {
        self.count.map_or(self.network.into(), |n| format!("{}, {n} segments", self.network))
    }

    fn spread(&self, of: impl Fn(&Cell, &Value) -> Option<f64>) -> Option<Spread> {
        Spread::of(&self.own.iter().map(|(cell, figures)| of(cell, figures)).collect::<Vec<_>>())
    }

    /// Its figures with these seeds.
    fn with<'b>(&'b self, seeds: &'b [u64]) -> impl Iterator<Item = &'b Value> {
        self.own.iter().filter(|(cell, _)| seeds.contains(&cell.seed)).map(|(_, figures)| *figures)
    }

    /// The mean of RMSE-all over these seeds.
    fn mean(&self, seeds: &[u64]) -> Option<f64> {
        let values: Vec<_> = self.with(seeds).map(|f| figure(f, "model", "rmse_all")).collect();
        Spread::of(&values).map(|s| s.mean)
    }

    /// [`logarithms`] of each of these seeds.
    fn logarithms<'b>(&'b self, seeds: &'b [u64]) -> Vec<BTreeMap<&'b str, f64>> {
        let of_seed = |figures| logarithms(figures).collect();
        self.with(seeds).map(of_seed).collect()
    }

    fn cells(&self, columns: &[(&str, &str)], seeds: usize) -> Vec<String> {
        let mean = |of: fn(&Cell, &Value) -> Option<f64>| {
            self.spread(of).map_or(String::new(), |s| number(s.mean, 3))
        };
        let weights = self.own.first().and_then(|(cell, _)| cell.training["weights"].as_u64());
        let mut row = vec![
            self.name(),
            format!("{} of {seeds}", self.own.len()),
            weights.map_or(String::new(), |n| n.to_string()),
            mean(|cell, _| Some(cell.training["seconds"].as_f64()? / 60.0)),
            mean(|_, figures| figures["model"]["ms_per_step"].as_f64()),
        ];
        let told = |(key, _): &(&str, &str)| {
            self.spread(|_, f| figure(f, "model", key)).map_or("-".into(), Spread::text)
        };
        row.extend(columns.iter().map(told));
        row
    }

    fn json(&self, columns: &[(&str, &str)]) -> Value {
        let pair = |(key, _): &(&str, &str)| {
            let s = self.spread(|_, f| figure(f, "model", key))?;
            Some((key.to_string(), json!({ "mean": s.mean, "deviation": s.deviation })))
        };
        let mut json = Value::Object(columns.iter().filter_map(pair).collect());
        json["network"] = self.name().into();
        json["seeds"] = self.own.len().into();
        json["over_diameter"] = over_diameter(self.own.iter().map(|(_, f)| *f));
        json
    }
}

/// By how much a network is ahead of another, as parts of the other's RMSE-all.
struct Margin<'a> {
    part: f64,
    other: &'a str,
    /// Those that both have.
    seeds: Vec<u64>,
    /// Over the trajectories one by one, with its interval; none of a single trajectory.
    paired: Option<Paired>,
}

/// The margin of a network by RMSE-all over the best of the others, each over the seeds that both have: of another kind, where there is one.
fn margin<'a>(rows: &[Row<'a>], of: &str, is_other: impl Fn(&str) -> bool) -> Option<Margin<'a>> {
    let trained = || rows.iter().filter(|row| row.count.is_none());
    let own = trained().find(|row| row.network == of)?;
    let over = |other: &Row<'a>| {
        let has = |seed: &u64| other.own.iter().any(|(cell, _)| cell.seed == *seed);
        let seeds: Vec<u64> = own.own.iter().map(|(cell, _)| cell.seed).filter(has).collect();
        let theirs = other.mean(&seeds).filter(|mean| mean.is_finite())?;
        let paired = Paired::of(&own.logarithms(&seeds), &other.logarithms(&seeds));
        Some(Margin { part: 1.0 - own.mean(&seeds)? / theirs, other: other.network, seeds, paired })
    };
    let all = trained().filter(|row| row.network != of && is_other(row.network)).filter_map(over);
    all.min_by(|a, b| a.part.total_cmp(&b.part)).filter(|margin| margin.part.is_finite())
}

/// The table of a test, and the same as JSON.
fn section(
    plan: &Plan,
    data: &Data,
    test: &str,
    (cells, failures): (&[Cell], &[Failure]),
) -> (Section, Value) {
    let own: Vec<&Cell> = cells.iter().filter(|c| c.data == data.name).collect();
    let figures = |c: &'_ Cell, n: Option<usize>| c.tests.iter().position(|t| t.0 == test && t.1 == n);
    let mut rows = Vec::new();
    for network in plan.network.iter().filter(|n| n.data.as_ref().is_none_or(|d| d.contains(&data.name))) {
        for count in std::iter::once(None).chain(network.segments.iter().map(|&n| Some(n))) {
            let found = own.iter().filter(|c| c.network == network.name);
            let found = found.filter_map(|&c| Some((c, &c.tests[figures(c, count)?].2)));
            rows.push(Row { network: &network.name, count, own: found.collect() });
        }
    }
    let all = || rows.iter().filter(|r| r.count.is_none()).flat_map(|r| r.own.iter().map(|(_, f)| *f));
    let none = Value::Null;
    let first = all().next().unwrap_or(&none);
    // Validations by an earlier version, or at another stride, may lack what others have
    let in_all = |key: &str| !first.is_null() && all().all(|f| f["hold_first"][key].is_number());
    let of_some = OF_SOME.into_iter().filter(|(key, _)| in_all(key));
    let columns: Vec<(&str, &str)> = HORIZONS.into_iter().chain(TRAJECTORIES).chain(of_some).collect();
    let unit = first["unit"].as_str().unwrap_or_default();
    let mut table = Table::new(["network", "seeds", "weights", "training, min", "ms a step"]);
    let has_unit = |key: &str| !OF_SOME[1..].iter().any(|c| c.0 == key);
    let header = |(key, name): &(&str, &str)| {
        if has_unit(key) { format!("{name} [{unit}]") } else { name.to_string() }
    };
    table.headers.extend(columns.iter().map(header));
    rows.iter().for_each(|row| table.row(row.cells(&columns, plan.seeds.len())));
    let mut baselines = serde_json::Map::new();
    for (key, name) in BASELINES {
        let mut row = [name, "", "", "", ""].map(String::from).to_vec();
        let told = |c: &(&str, &str)| m4gn_report::figure(figure(first, key, c.0), 3);
        row.extend(columns.iter().map(told));
        table.row(row);
        baselines.insert(key.into(), first[key].clone());
    }
    let of = plan.margin_of.as_ref().unwrap_or(&plan.network[0].name);
    let kind = plan.kind(&data.name, of);
    let is_alike = |network: &str| kind.is_some() && plan.kind(&data.name, network) == kind;
    let variants = rows.iter().all(|row| is_alike(row.network));
    let is_other = |network: &str| variants || !is_alike(network);
    let margin = margin(&rows, of, is_other);
    let mut note = note(plan, first);
    if let Some(Margin { part, other, seeds, paired }) = &margin {
        let (percent, way) = (number(100.0 * part.abs(), 2), if *part < 0.0 { "above" } else { "below" });
        let whose = if variants { "other network" } else { "network of another kind" };
        note += &format!(" RMSE-all of {of} is {percent} % {way} that of the best {whose}, {other}");
        if seeds.len() < plan.seeds.len() {
            note += &format!(", over the seeds that both have: {}", listed(seeds));
        }
        note += ".";
        if let Some(Paired { part, low, high }) = paired {
            let [part, low, high] = [part, low, high].map(|x| number(100.0 * x, 2));
            note += &format!(" Trajectory by trajectory the margin is {part} % (95 %: {low} to {high} %).");
        }
    }
    // Who does not beat the first frame has learned nothing that a rollout can use.
    let held = figure(first, "hold_first", "rmse_all");
    let above = |row: &&Row| {
        let own = row.spread(|_, f| figure(f, "model", "rmse_all"));
        own.zip(held).is_some_and(|(own, held)| own.mean >= held)
    };
    let worse: Vec<String> = rows.iter().filter(above).map(Row::name).collect();
    if !worse.is_empty() {
        note += &format!(" RMSE-all not below that of holding the first frame: {}.", listed(worse));
    }
    for f in failures.iter().filter(|f| f.data == data.name) {
        // In a line
        let error: Vec<&str> = f.error.split_whitespace().collect();
        note +=
            &format!(" Failed: {}, seed {}: {}.", f.network, f.seed, error.join(" ").trim_end_matches('.'));
    }
    let margin = margin.as_ref();
    let json = json!({
        "data": data.name, "test": test, "field": first["field"], "unit": unit, "margin": margin.map(|m| m.part),
        "margin_seeds": margin.map(|m| &m.seeds), "margin_paired": margin.and_then(|m| m.paired), "margin_of": of,
        "networks": rows.iter().filter(|r| !r.own.is_empty()).map(|r| r.json(&columns)).collect::<Vec<_>>(), "baselines": baselines,
    });
    (Section { heading: format!("{}, {test}", data.name), note, table }, json)
}

/// What a table is of.
fn note(plan: &Plan, figures: &Value) -> String {
    let splits =
        figures["splits"].as_object().into_iter().flatten().filter(|(name, _)| counts(figures, name));
    let trajectories: u64 = splits.filter_map(|(_, v)| v["trajectories"].as_u64()).sum();
    let budget = match (plan.steps, plan.minutes) {
        (Some(steps), _) => format!("{steps} updates"),
        (None, Some(minutes)) => format!("{} min of training", number(minutes, 3)),
        (None, None) => "the configuration's updates".into(),
    };
    format!(
        "{trajectories} trajectories, {}; mean ± standard deviation over seeds, {budget} each.",
        figures["field"].as_str().unwrap_or("field")
    )
}

/// Data of the paper's Figure 4b: each trajectory's graph diameter and its RMSE-all, mean over the seeds, by ascending diameter.
fn over_diameter<'a>(figures: impl Iterator<Item = &'a Value>) -> Value {
    let mut cases: BTreeMap<(u64, String), Vec<f64>> = BTreeMap::new();
    for case in figures.filter_map(|f| f["cases"].as_array()).flatten() {
        let key =
            (case["diameter"].as_u64().unwrap_or(0), case["path"].as_str().unwrap_or_default().to_string());
        cases.entry(key).or_default().push(case["model"]["rmse_all"].as_f64().unwrap_or(f64::INFINITY));
    }
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let row = |((diameter, path), all): (&(u64, String), &Vec<f64>)| json!({ "diameter": diameter, "path": path, "rmse_all": mean(all) });
    cases.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(network: &str, seed: u64, all: Value) -> Cell {
        let figures = json!({ "field": "U", "unit": "m/s", "model": { "rmse_1": 0.1, "rmse_50": 0.2, "rmse_all": all, "ms_per_step": 3.0 },
            "persistence": { "rmse_1": 0.4, "rmse_50": 0.4, "rmse_all": 0.4 }, "splits": { "test": { "trajectories": 2 } },
            "cases": [{ "diameter": 30, "path": "b", "model": { "rmse_all": all } }, { "diameter": 11, "path": "a", "model": { "rmse_all": 0.1 } }] });
        Cell {
            data: "flow".into(),
            network: network.into(),
            seed,
            training: json!({ "steps": 9, "seconds": 60.0, "weights": 1234 }),
            tests: vec![("test".into(), None, figures)],
        }
    }

    fn plan(seeds: &str) -> Plan {
        toml::from_str(&format!(
            "title = 't'\nsteps = 9\nseeds = {seeds}\n[[data]]\nname = 'flow'\ntrain = 'd'\nconfig = 'c'\n[[network]]\nname = 'M4GN'\n[[network]]\nname = 'GCN'\n[[network]]\nname = 'MGN'\n",
        ))
        .unwrap()
    }

    #[test]
    fn networks_that_do_not_beat_the_first_frame_are_named() {
        let of = |held: f64| {
            let mut cells =
                [cell("M4GN", 1, json!(0.2)), cell("GCN", 1, json!(0.5)), cell("MGN", 1, Value::Null)];
            cells.iter_mut().for_each(|c| c.tests[0].2["hold_first"] = json!({ "rmse_all": held }));
            Report::new(&plan("[1]"), &cells, &[]).text()
        };
        let expected = "RMSE-all not below that of holding the first frame: GCN, MGN.";
        assert!(of(0.4).contains(expected), "{}", of(0.4));
        let mgn_alone = "RMSE-all not below that of holding the first frame: MGN.";
        assert!(of(0.6).contains(mgn_alone), "{}", of(0.6));
    }

    #[test]
    fn seeds_are_averaged_and_the_margin_is_over_the_best_other() {
        let cells = [
            cell("M4GN", 1, json!(0.2)),
            cell("M4GN", 2, json!(0.4)),
            cell("GCN", 1, json!(0.5)),
            cell("GCN", 2, json!(0.5)),
            cell("MGN", 1, Value::Null),
            cell("MGN", 2, json!(0.1)),
        ];
        let report = Report::new(&plan("[1, 2]"), &cells, &[]);
        let text = report.text();
        for expected in [
            "0.300 ± 0.14",
            "not finite",
            "RMSE-all of M4GN is 40 % below that of the best network of another kind, GCN.",
            "Trajectory by trajectory the margin is 25 % (95 %: ",
            "0.200 ± 0.071",
            "persistence",
            "dmd",
            "2 trajectories",
        ] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        let test = &report.json["tests"][0];
        assert!((test["margin"].as_f64().unwrap() - 0.4).abs() < 1e-12, "{test}");
        let over = &test["networks"][0]["over_diameter"];
        assert_eq!((&over[0]["diameter"], &over[0]["path"]), (&json!(11), &json!("a")));
        assert!((over[1]["rmse_all"].as_f64().unwrap() - 0.3).abs() < 1e-12, "{over}");
        assert_eq!((&test["networks"][0]["seeds"], &report.json["failed"]), (&json!(2), &json!([])));
        let dir = tempfile::tempdir().unwrap();
        report.write(dir.path()).unwrap();
        let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
        assert!(read("study.md").contains("| M4GN | 2 of 2 | 1234 |"), "{}", read("study.md"));
    }

    /// Of data that end in cycles; a rollout that became non-finite is far from any.
    #[test]
    fn errors_but_for_phase_have_a_column_where_the_data_have_cycles() {
        let mut cells = [cell("M4GN", 1, json!(0.2)), cell("GCN", 1, Value::Null)];
        let header = |cells: &[Cell]| Report::new(&plan("[1]"), cells, &[]).text();
        assert!(!header(&cells).contains("phase-free"), "{}", header(&cells));
        for (cell, of_model) in cells.iter_mut().zip([json!(0.125), Value::Null]) {
            cell.tests[0].2["model"]["phase_free"] = of_model;
            cell.tests[0].2["hold_first"] = json!({ "rmse_all": 0.5, "phase_free": 0.75 });
        }
        let text = header(&cells);
        assert!(text.contains("phase-free [m/s]"), "{text}");
        let row = |name: &str| text.lines().find(|line| line.trim_start().starts_with(name)).unwrap();
        assert!(row("M4GN").contains("0.125") && row("hold first").contains("0.750"), "{text}");
        assert!(row("GCN").matches("not finite").count() == 4, "{text}");
        // One of an earlier version
        cells[1].tests[0].2["hold_first"] = json!({ "rmse_all": 0.5 });
        assert!(!header(&cells).contains("phase-free"), "{}", header(&cells));
    }

    /// A seed that failed is in no mean, and in no margin; every table says so.
    #[test]
    fn what_failed_is_in_each_table_and_margins_are_of_seeds_that_both_have() {
        let failure = |network: &str, seed| {
            let error = "log.train: m4gn failed:\nit has diverged.".to_string();
            Failure { data: "flow".into(), network: network.into(), seed, error }
        };
        let cells = [
            cell("M4GN", 1, json!(0.2)),
            cell("M4GN", 3, json!(0.9)),
            cell("GCN", 1, json!(0.5)),
            cell("GCN", 2, json!(0.1)),
        ];
        let failures =
            [failure("M4GN", 2), failure("GCN", 3), failure("MGN", 1), failure("MGN", 2), failure("MGN", 3)];
        let report = Report::new(&plan("[1, 2, 3]"), &cells, &failures);
        let dir = tempfile::tempdir().unwrap();
        report.write(dir.path()).unwrap();
        let text = std::fs::read_to_string(dir.path().join("study.md")).unwrap();
        for expected in [
            "2 of 3",
            "0 of 3",
            "Failed: M4GN, seed 2: log.train: m4gn failed: it has diverged. Failed: GCN, seed 3: ",
            // 0.2 over 0.5, those of seed 1
            "RMSE-all of M4GN is 60 % below that of the best network of another kind, GCN, over the seeds that both have: 1.",
        ] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
        assert_eq!((report.failures, &report.json["tests"][0]["margin_seeds"]), (5, &json!([1])));
        assert_eq!(
            report.json["failed"][1],
            json!({ "data": "flow", "network": "GCN", "seed": 3, "error": failures[0].error })
        );
        // None has a seed of the other.
        let report =
            Report::new(&plan("[1, 2]"), &[cell("M4GN", 1, json!(0.2)), cell("GCN", 2, json!(0.1))], &[]);
        assert!(!report.text().contains("M4GN is"), "{}", report.text());
    }
}
