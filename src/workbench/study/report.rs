//! What came of a study: a table a test, for people (text, HTML, Markdown, LaTeX) and for programs (JSON).

use super::{Cell, Plan};
use m4gn_base::{Result, files};
use m4gn_report::{Page, Table, number};
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

/// Mesh metrics of bodies (appendix C.2).
const SHAPES: [(&str, &str); 4] = [("gf_h", "GFh"), ("gf_c", "GFc"), ("mc", "MC"), ("ar", "AR")];

impl Cell {
    /// Its figures in a line.
    pub(super) fn line(&self) -> String {
        let [steps, seconds] = ["steps", "seconds"].map(|key| self.training[key].as_f64().unwrap_or(0.0));
        let mut text = format!("{steps} updates in {} s", number(seconds, 3));
        for (test, count, figures) in &self.tests {
            let of = |(key, name)| Some(format!("{name} {}", number(figures["model"][key].as_f64()?, 3)));
            let all: Vec<String> = HORIZONS.into_iter().filter_map(of).collect();
            let more = count.map_or(String::new(), |n| format!(" with {n} segments"));
            text += &format!("; {test}{more}: {}", all.join(", "));
        }
        text
    }
}

/// RMSE-all of the trajectories: in the middle, and the largest.
const TRAJECTORIES: [(&str, &str); 2] = [("median", "median"), ("worst", "worst")];

/// A figure of a row, over all trajectories or of these.
fn figure(figures: &Value, row: &str, key: &str) -> Option<f64> {
    if !TRAJECTORIES.iter().any(|t| t.0 == key) {
        return figures[row][key].as_f64();
    }
    let of_case =
        |case: &Value| case[row].is_object().then(|| case[row]["rmse_all"].as_f64().unwrap_or(f64::INFINITY));
    let mut all: Vec<f64> = figures["cases"].as_array()?.iter().filter_map(of_case).collect();
    all.sort_by(f64::total_cmp);
    let n = all.len();
    match key {
        "worst" => all.last().copied(),
        _ => Some(0.5 * (all.get(n.checked_sub(1)? / 2)? + all.get(n / 2)?)),
    }
}

/// Mean and standard deviation over seeds; none of one seed, and infinite where a figure is not finite.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Spread {
    mean: f64,
    deviation: f64,
}

impl Spread {
    fn of(values: &[Option<f64>]) -> Option<Self> {
        let n = values.len() as f64;
        let values: Vec<f64> = values.iter().map(|v| v.unwrap_or(f64::INFINITY)).collect();
        let mean = values.iter().sum::<f64>() / n;
        let square = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>();
        (n > 0.0)
            .then(|| Spread { mean, deviation: if n > 1.0 { (square / (n - 1.0)).sqrt() } else { f64::NAN } })
    }

    fn text(self) -> String {
        match (self.mean.is_finite(), self.deviation.is_finite()) {
            (false, _) => "not finite".into(),
            (_, false) => number(self.mean, 3),
            _ => format!("{} ± {}", number(self.mean, 3), number(self.deviation, 2)),
        }
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
}

impl Report {
    /// Of the cells that there are.
    pub fn new(plan: &Plan, cells: &[Cell], failed: usize) -> Self {
        let mut report = Report { title: plan.title.clone(), sections: Vec::new(), json: Value::Null };
        let mut tests = Vec::new();
        for data in &plan.data {
            let own: Vec<&Cell> = cells.iter().filter(|c| c.data == data.name).collect();
            let mut names: Vec<&String> = Vec::new();
            for (name, ..) in own.iter().flat_map(|c| &c.tests) {
                if !names.contains(&name) {
                    names.push(name);
                }
            }
            for name in names {
                let (section, json) = section(plan, &data.name, name, &own);
                report.sections.push(section);
                tests.push(json);
            }
        }
        let trained = |c: &Cell| json!({ "data": c.data, "network": c.network, "seed": c.seed, "training": c.training });
        report.json = json!({
            "title": plan.title, "plan": plan, "failed": failed, "tests": tests, "cells": cells.iter().map(trained).collect::<Vec<_>>(),
        });
        report
    }

    /// The tables as text.
    pub fn text(&self) -> String {
        let one = |s: &Section| format!("{}\n{}\n\n{}\n", s.heading, s.note, s.table);
        self.sections.iter().map(one).collect()
    }

    /// Writes `study.json`, `study.html`, `study.md` and `study.tex` into a folder.
    ///
    /// # Errors
    /// [`m4gn_base::Error::File`] for the one that cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let mut page = Page::new(&self.title);
        let (mut markdown, mut latex) = (format!("# {}\n", self.title), String::new());
        for s in &self.sections {
            page.heading(&s.heading);
            page.paragraph(&s.note);
            page.table(&s.table);
            markdown += &format!("\n## {}\n\n{}\n\n{}", s.heading, s.note, s.table.markdown());
            latex += &format!("% {}: {}\n{}\n", s.heading, s.note, s.table.latex());
        }
        page.write(&folder.join("study.html"))?;
        for (name, text) in
            [("study.md", markdown), ("study.tex", latex), ("study.json", format!("{:#}\n", self.json))]
        {
            files::write_whole(&folder.join(name), text.as_bytes())?;
        }
        Ok(())
    }
}

/// The table of a test, and the same as JSON.
fn section(plan: &Plan, data: &str, test: &str, cells: &[&Cell]) -> (Section, Value) {
    let figures =
        |c: &Cell, n: Option<usize>| c.tests.iter().find(|t| t.0 == test && t.1 == n).map(|t| t.2.clone());
    let first = cells.iter().find_map(|c| figures(c, None)).unwrap_or_default();
    let has = |key: &str| cells.iter().filter_map(|c| figures(c, None)).any(|f| f["model"][key].is_number());
    let shapes: Vec<(&str, &str)> = SHAPES.into_iter().filter(|(key, _)| has(key)).collect();
    let columns: Vec<(&str, &str)> = HORIZONS.into_iter().chain(TRAJECTORIES).chain(shapes).collect();
    let unit = first["unit"].as_str().unwrap_or_default();
    let mut table = Table::new(["network", "weights", "training, min", "ms a step"]);
    let with_unit = |(key, name): &(&str, &str)| match key.starts_with("rmse")
        || TRAJECTORIES.iter().any(|t| t.0 == *key)
    {
        true => format!("{name} [{unit}]"),
        false => name.to_string(),
    };
    table.headers.extend(columns.iter().map(with_unit));
    let mut rows = Vec::new();
    for network in &plan.network {
        for count in std::iter::once(None).chain(network.segments.iter().map(|&n| Some(n))) {
            let own = cells.iter().filter(|c| c.network == network.name);
            let own: Vec<(&Cell, Value)> = own.filter_map(|c| Some((*c, figures(c, count)?))).collect();
            if own.is_empty() {
                continue;
            }
            let spread = |of: &dyn Fn(&(&Cell, Value)) -> Option<f64>| {
                Spread::of(&own.iter().map(of).collect::<Vec<_>>())
            };
            let training = |key: &str, unit: f64| spread(&|(c, _)| Some(c.training[key].as_f64()? / unit));
            let scores: Vec<Option<Spread>> =
                columns.iter().map(|(key, _)| spread(&|(_, f)| figure(f, "model", key))).collect();
            let name = count.map_or(network.name.clone(), |n| format!("{}, {n} segments", network.name));
            let told = |s: Option<Spread>| s.map_or(String::new(), Spread::text);
            let weights = own[0].0.training["weights"].as_u64().unwrap_or(0);
            let mean = |s: Option<Spread>| s.map_or(String::new(), |s| number(s.mean, 3));
            let mut row = vec![name.clone(), weights.to_string(), mean(training("seconds", 60.0))];
            row.push(mean(spread(&|(_, f)| f["model"]["ms_per_step"].as_f64())));
            row.extend(scores.iter().map(|s| told(*s)));
            table.row(row);
            let pairs =
                columns.iter().zip(&scores).filter_map(|((key, _), s)| Some((key.to_string(), (*s)?)));
            let json = pairs.map(|(key, s)| (key, json!({ "mean": s.mean, "deviation": s.deviation })));
            let mut json = Value::Object(json.collect());
            json["network"] = name.into();
            json["seeds"] = own.len().into();
            json["over_diameter"] = over_diameter(own.iter().map(|(_, f)| f));
            rows.push((network.name.as_str(), count, [scores[2], scores[3]], json));
        }
    }
    let mut baselines = serde_json::Map::new();
    for (key, name) in BASELINES {
        let mut row = vec![name.to_string(), String::new(), String::new(), String::new()];
        let told = |c: &(&str, &str)| figure(&first, key, c.0).map_or("-".into(), |v| number(v, 3));
        row.extend(columns.iter().map(told));
        table.row(row);
        baselines.insert(key.into(), first[key].clone());
    }
    let of = plan.margin_of.as_ref().unwrap_or(&plan.network[0].name);
    // Over the best of the others, with its name, by RMSE-all and by its median over the trajectories: of another kind, where there is one.
    let kind = plan.kind(data, of);
    let alike: Vec<bool> = rows.iter().map(|r| kind.is_some() && plan.kind(data, r.0) == kind).collect();
    let variants = !alike.contains(&false);
    let [margin, by_median] = [0, 1].map(|i: usize| {
        let trained = || rows.iter().zip(&alike).filter(|(r, _)| r.1.is_none());
        let scored = || trained().filter_map(|(r, alike)| Some((r.0, r.2[i]?.mean, *alike)));
        let own = scored().find(|(name, ..)| name == of)?.1;
        let others = scored().filter(|(name, _, alike)| name != of && (variants || !alike));
        let (name, other, _) = others.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let margin = 1.0 - own / other;
        margin.is_finite().then_some((margin, name))
    });
    let mut note = format!(
        "{} trajectories, {}; mean ± standard deviation over seeds, {} each.",
        first["splits"]
            .as_object()
            .map_or(0, |s| s.values().filter_map(|v| v["trajectories"].as_u64()).sum()),
        first["field"].as_str().unwrap_or("field"),
        match (plan.steps, plan.minutes) {
            (Some(steps), _) => format!("{steps} updates"),
            (_, minutes) => format!("{} min of training", number(minutes.unwrap_or(0.0), 3)),
        }
    );
    for (margin, what) in [(margin, "RMSE-all"), (by_median, "The median")] {
        let Some((margin, name)) = margin else { continue };
        let (percent, way) = (number(100.0 * margin.abs(), 2), if margin < 0.0 { "above" } else { "below" });
        let other = if variants { "other network" } else { "network of another kind" };
        note += &format!(" {what} of {of} is {percent} % {way} that of the best {other}, {name}.");
    }
    let heading = format!("{data}, {test}");
    let json = json!({
        "data": data, "test": test, "field": first["field"], "unit": unit, "margin": margin.map(|m| m.0), "margin_of_medians": by_median.map(|m| m.0), "margin_of": of,
        "networks": rows.into_iter().map(|r| r.3).collect::<Vec<_>>(), "baselines": baselines,
    });
    (Section { heading, note, table }, json)
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

    #[test]
    fn seeds_are_averaged_and_the_margin_is_over_the_best_other() {
        let plan: Plan = toml::from_str(
            "title = 't'\nsteps = 9\n[[data]]\nname = 'flow'\ntrain = 'd'\nconfig = 'c'\n[[network]]\nname = 'M4GN'\n[[network]]\nname = 'GCN'\n[[network]]\nname = 'MGN'\n",
        )
        .unwrap();
        let cells = [
            cell("M4GN", 1, json!(0.2)),
            cell("M4GN", 2, json!(0.4)),
            cell("GCN", 1, json!(0.5)),
            cell("MGN", 1, Value::Null),
        ];
        let report = Report::new(&plan, &cells, 1);
        let text = report.text();
        for expected in [
            "0.300 ± 0.14",
            "not finite",
            "RMSE-all of M4GN is 40 % below that of the best network of another kind, GCN",
            // Of 0.1 and 0.2, and 0.1 and 0.4; of 0.1 and 0.5.
            "The median of M4GN is 33 % below that of the best network of another kind, GCN",
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
        assert_eq!((&test["networks"][0]["seeds"], &report.json["failed"]), (&json!(2), &json!(1)));
        let dir = tempfile::tempdir().unwrap();
        report.write(dir.path()).unwrap();
        let read = |name: &str| std::fs::read_to_string(dir.path().join(name)).unwrap();
        assert!(read("study.md").contains("| M4GN | 1234 |"), "{}", read("study.md"));
        assert!(read("study.tex").contains(r"$\pm$") && read("study.html").contains("<td>M4GN</td>"));
    }
}
