//! What a study is made of: a TOML file with data sets, networks and seeds, of which each with each makes a cell.

use m4gn_base::{Error, Result};
use m4gn_train::delta::{self, merge, remove};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// The file.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Title of the report.
    pub title: String,
    /// Updates of every training. Of this and `minutes` one is given, or none: then each configuration says its own.
    pub steps: Option<u64>,
    /// Time of every training, min, in which it goes through the schedule of its configuration.
    pub minutes: Option<f64>,
    /// Seeds of every training.
    #[serde(default = "one_seed")]
    pub seeds: Vec<u64>,
    /// `native` or `torch`, as in 'm4gn train'.
    pub backend: Option<String>,
    /// `cpu`, `cuda`, `cuda:N`.
    pub device: Option<String>,
    /// Threads of every training and validation.
    #[serde(default = "one_thread")]
    pub threads: usize,
    /// The network whose margin over the best of the others is told; the first one by default.
    pub margin_of: Option<String>,
    /// Data sets.
    pub data: Vec<Data>,
    /// Networks, and what is switched in them.
    pub network: Vec<Network>,
}

/// A data set.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    /// Its name in the report.
    pub name: String,
    /// Folder of trajectories that networks are trained on.
    pub train: PathBuf,
    /// What all networks share: a configuration of 'm4gn train', which need not be whole.
    pub config: PathBuf,
    /// Entries in place of that file's.
    #[serde(default)]
    pub set: Table,
    /// What networks are tested on; the test split of `train` by default.
    #[serde(default)]
    pub test: Vec<Test>,
}

/// Trajectories to test on.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Test {
    /// Name in the report.
    pub name: String,
    /// Folder of trajectories.
    pub data: PathBuf,
    /// Which of them: test, valid, train, all.
    #[serde(default = "all")]
    pub split: String,
}

/// A network, or one with something switched.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Network {
    /// Name in the report.
    pub name: String,
    /// The network that this one is, but for what is set here.
    pub base: Option<String>,
    /// Tables and keys of the configuration that are taken out, such as `segments` or `model.layers`.
    #[serde(default)]
    pub remove: Vec<String>,
    /// Entries of the configuration.
    #[serde(default)]
    pub set: Table,
    /// Data sets that it is trained on; all by default.
    pub data: Option<Vec<String>>,
    /// Numbers of segments to test it with as well.
    #[serde(default)]
    pub segments: Vec<usize>,
}

fn one_seed() -> Vec<u64> {
    vec![1]
}

fn one_thread() -> usize {
    1
}

fn all() -> String {
    "all".into()
}

impl Data {
    /// What networks are tested on.
    pub fn tests(&self) -> Cow<'_, [Test]> {
        match self.test.is_empty() {
            true => {
                Cow::Owned(vec![Test { name: "test".into(), data: self.train.clone(), split: "test".into() }])
            }
            false => Cow::Borrowed(&self.test),
        }
    }
}

impl Plan {
    /// Reads and checks a file, which may have a `base` ([`delta`]). Its paths are taken from its folder.
    ///
    /// # Errors
    /// [`Error::File`] that names the file and the entry.
    pub fn read(path: &Path) -> Result<Self> {
        let mut plan: Plan = delta::read(path)?;
        plan.check().map_err(|message| Error::file(path, message))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        for data in &mut plan.data {
            data.train = folder.join(&data.train);
            data.config = folder.join(&data.config);
            data.test.iter_mut().for_each(|t| t.data = folder.join(&t.data));
        }
        Ok(plan)
    }

    fn check(&self) -> std::result::Result<(), String> {
        let budget = match (self.steps, self.minutes) {
            (Some(steps), None) => steps > 0,
            (None, Some(minutes)) => minutes.is_finite() && minutes > 0.0,
            (None, None) => true,
            _ => false,
        };
        if !budget {
            return Err("expected steps = N or minutes = T, at most one of them, above 0".into());
        }
        // Those of a session, with which a training that took hours could not be validated.
        if !(1..=1024).contains(&self.threads) {
            return Err(format!("threads = {}: expected 1 to 1024", self.threads));
        }
        if self.seeds.is_empty() || self.seeds.iter().collect::<HashSet<_>>().len() < self.seeds.len() {
            return Err(format!("seeds {:?}: expected one seed or several, none twice", self.seeds));
        }
        for (what, names) in [("data", names(&self.data, |d| &d.name)), ("network", self.networks())]
            .into_iter()
            .chain(self.data.iter().map(|d| ("data.test", names(&d.test, |t| &t.name))))
        {
            let plain = |n: &str| {
                !n.is_empty()
                    && !n.starts_with('.')
                    && n.chars().all(|c| c.is_alphanumeric() || "+-_., ".contains(c))
            };
            if let Some(name) = names.iter().find(|n| !plain(n)) {
                return Err(format!(
                    "{what}.name \"{name}\": expected letters, digits, spaces and + - _ . , as it names a folder"
                ));
            }
            if names.iter().collect::<HashSet<_>>().len() < names.len()
                || (names.is_empty() && what != "data.test")
            {
                return Err(format!(
                    "{what}: expected one or several, each with its own name; found {names:?}"
                ));
            }
        }
        for (i, network) in self.network.iter().enumerate() {
            if let Some(base) = &network.base
                && !self.network[..i].iter().any(|n| n.name == *base)
            {
                return Err(format!("network \"{}\": base \"{base}\" is no network before it", network.name));
            }
            let unknown = |d: &&String| !self.data.iter().any(|set| set.name == **d);
            if let Some(name) = network.data.iter().flatten().find(unknown) {
                return Err(format!("network \"{}\": there is no data set \"{name}\"", network.name));
            }
        }
        if let Some(name) = self.margin_of.as_ref().filter(|n| !self.networks().contains(n)) {
            return Err(format!("margin_of: there is no network \"{name}\""));
        }
        if let Some(split) = self
            .data
            .iter()
            .flat_map(|d| &d.test)
            .map(|t| &t.split)
            .find(|s| !["test", "valid", "train", "all"].contains(&s.as_str()))
        {
            return Err(format!("data.test.split \"{split}\": expected test, valid, train or all"));
        }
        Ok(())
    }

    fn networks(&self) -> Vec<&String> {
        names(&self.network, |n| &n.name)
    }

    /// Data set, network and seed of every cell.
    pub fn cells(&self) -> Vec<(&Data, &Network, u64)> {
        let trained = |d: &Data, n: &Network| n.data.as_ref().is_none_or(|names| names.contains(&d.name));
        let pairs = self.data.iter().flat_map(|d| self.network.iter().map(move |n| (d, n)));
        let pairs = pairs.filter(|(d, n)| trained(d, n));
        pairs.flat_map(|(d, n)| self.seeds.iter().map(move |&seed| (d, n, seed))).collect()
    }

    /// The kind of a network on a data set; none where its configuration cannot be read.
    pub fn kind(&self, data: &str, network: &str) -> Option<String> {
        let data = self.data.iter().find(|d| d.name == data)?;
        let network = self.network.iter().find(|n| n.name == network)?;
        let config: Table = self.config(data, network).ok()?.parse().ok()?;
        let said = config.get("model").and_then(|m| m.get("kind")).and_then(Value::as_str);
        let unsaid = if config.contains_key("macro") { "m4gn" } else { "mesh-graph-net" };
        Some(said.unwrap_or(unsaid).to_string())
    }

    /// The configuration of a network on a data set: the data set's file, what it sets, and what the network sets. The study's budget, where
    /// it has one, takes the place of the configuration's; one of steps is where the learning rate reaches its end, one of
    /// minutes where the schedule does.
    ///
    /// # Errors
    /// As [`delta::table`].
    pub fn config(&self, data: &Data, network: &Network) -> Result<String> {
        let mut config = delta::table(&data.config)?;
        merge(&mut config, &data.set);
        let mut chain = vec![network];
        while let Some(base) = chain[0].base.as_ref().and_then(|b| self.network.iter().find(|n| n.name == *b))
        {
            chain.insert(0, base);
        }
        for network in chain {
            network.remove.iter().for_each(|key| {
                remove(&mut config, key);
            });
            merge(&mut config, &network.set);
        }
        let training = config.entry("training").or_insert_with(|| Table::new().into());
        if let Some(training) = training.as_table_mut() {
            if let Some(minutes) = self.minutes {
                training.insert("max_minutes".into(), minutes.into());
                training.insert("schedule".into(), "time".into());
            }
            if let Some(steps) = self.steps {
                let steps = i64::try_from(steps).unwrap_or(i64::MAX);
                training.insert("steps".into(), steps.into());
                training.remove("max_minutes");
                training.remove("schedule");
                let start =
                    training.get("decay_start").and_then(Value::as_integer).unwrap_or(0).min(steps - 1);
                training.insert("decay_start".into(), start.into());
                training.insert("decay_steps".into(), steps.saturating_sub(start).into());
            }
        }
        Ok(config.to_string())
    }
}

fn names<T>(all: &[T], name: impl Fn(&T) -> &String) -> Vec<&String> {
    all.iter().map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = r#"
title = "t"
steps = 100
seeds = [1, 2]
[[data]]
name = "flow"
train = "d"
config = "c.toml"
set = { training = { batch_size = 2 } }
[[data]]
name = "beam"
train = "d"
config = "c.toml"
[[network]]
name = "M4GN"
set = { model = { kind = "m4gn" }, segments = { count = 9 } }
[[network]]
name = "no segments"
base = "M4GN"
remove = ["segments"]
set = { model = { width = 8 } }
data = ["flow"]
"#;

    #[test]
    fn networks_are_their_base_but_for_what_they_set() {
        let config =
            "[model]\nstride = 0.1\nwidth = 64\n[training]\nsteps = 9\nmax_minutes = 5.0\nbatch_size = 1\n";
        let dir = crate::fixtures::folder(&[("c.toml", config), ("s.toml", STUDY)]);
        let plan = Plan::read(&dir.path().join("s.toml")).unwrap();
        let cells = plan.cells();
        let told: Vec<String> = cells.iter().map(|(d, n, s)| format!("{} {} {s}", d.name, n.name)).collect();
        assert_eq!(
            told,
            [
                "flow M4GN 1",
                "flow M4GN 2",
                "flow no segments 1",
                "flow no segments 2",
                "beam M4GN 1",
                "beam M4GN 2"
            ]
        );
        let whole: Table = plan.config(cells[2].0, cells[2].1).unwrap().parse().unwrap();
        let expected = "[model]\nstride = 0.1\nwidth = 8\nkind = \"m4gn\"\n[training]\nsteps = 100\ndecay_start = 0\ndecay_steps = 100\nbatch_size = 2\n";
        assert_eq!(whole, expected.parse::<Table>().unwrap());
        let kinds = ["M4GN", "no segments", "GCN"].map(|network| plan.kind("flow", network));
        assert_eq!(kinds, [Some("m4gn".into()), Some("m4gn".into()), None]);
        // Without a budget it is the configuration's; with one of time the schedule takes all of it.
        for (minutes, expected) in
            [(None, "max_minutes = 5.0"), (Some(2.0), "max_minutes = 2.0\nschedule = \"time\"")]
        {
            let own = Plan { steps: None, minutes, ..plan.clone() };
            assert_eq!(own.check(), Ok(()));
            let whole: Table = own.config(&own.data[1], &own.network[0]).unwrap().parse().unwrap();
            let expected = format!("steps = 9\nbatch_size = 1\n{expected}\n");
            assert_eq!(whole["training"].as_table(), expected.parse::<Table>().ok().as_ref());
        }
    }

    /// Appendix B.2 and B.3.
    #[test]
    fn the_papers_study_has_the_papers_updates_noise_and_radius() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/study/paper.toml");
        let plan = Plan::read(&file).unwrap();
        let mut seen = 0;
        for (data, network, _) in plan.cells().into_iter().filter(|c| c.0.name == "DeformingBeam") {
            let text = plan.config(data, network).unwrap();
            let config = m4gn_train::config::Config::parse(&text).unwrap();
            let ours = ["M4GN", "EAGLE, 38 clusters"].contains(&network.name.as_str());
            let radius = if network.name == "MGN of beams" { 0.003 } else { 0.002 };
            assert_eq!(config.training.noise["D"], if ours { 1e-4 } else { 1e-3 }, "{}", network.name);
            assert_eq!(config.contact.map(|c| c.radius), Some(radius), "{}", network.name);
            assert_eq!((config.training.steps, config.training.decay_steps), (1_000_000, 500_000));
            seen += 1;
        }
        assert_eq!(seen, 6 * plan.seeds.len());
    }

    #[test]
    fn shipped_studies_are_of_networks_that_can_be() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/study");
        let mut cells = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let plan = Plan::read(&path).unwrap();
            for (data, network, _) in plan.cells() {
                let config =
                    plan.config(data, network).and_then(|text| m4gn_train::config::Config::parse(&text));
                config.unwrap_or_else(|e| panic!("{}: {}: {e}", path.display(), network.name));
                cells += 1;
            }
        }
        assert!(cells > 10, "{cells} cells");
    }

    #[test]
    fn entries_that_cannot_be_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("s.toml");
        for (from, to, expected) in [
            ("steps = 100", "steps = 0", "steps = N or minutes = T"),
            ("steps = 100", "steps = 100\nminutes = 3.0", "one of them"),
            ("[1, 2]", "[1, 1]", "none twice"),
            ("steps = 100", "steps = 100\nthreads = 0", "threads = 0: expected 1 to 1024"),
            ("\"beam\"", "\"flow\"", "each with its own name"),
            ("\"beam\"", "\"../beam\"", "names a folder"),
            ("base = \"M4GN\"", "base = \"M5GN\"", "no network before it"),
            ("[\"flow\"]", "[\"flaw\"]", "no data set \"flaw\""),
            ("title", "margin_of = \"x\"\ntitle", "no network \"x\""),
            ("title", "titel", "titel"),
        ] {
            std::fs::write(&file, STUDY.replacen(from, to, 1)).unwrap();
            m4gn_samples::fails(Plan::read(&file), &[expected, "s.toml"]);
        }
    }
}
