//! `campaign.toml`: what all runs of a campaign have in common.

use super::start::Start;
use crate::generate::parameter::is_word;
use m4gn_base::settings::is_default;
use m4gn_base::{Error, Result, files, refuse, refuse_any};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Name of the file in the campaign's folder.
pub const FILE: &str = "campaign.toml";

/// The file.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Folder of the OpenFOAM case that all runs are copies of.
    pub case: PathBuf,
    /// Commands that make mesh and first fields in a copy, each a program and its arguments.
    #[serde(default)]
    pub prepare: Vec<Vec<String>>,
    /// The solver and its arguments, as in a serial run.
    pub solver: Vec<String>,
    /// Ranks of the solver.
    #[serde(default = "one")]
    pub ranks: usize,
    /// What runs start from.
    #[serde(default)]
    pub start: Start,
    /// Parameter that is a velocity: the fields of a sister are scaled by the ratio of both runs' values.
    pub scale: Option<String>,
    /// `dmd`: runs have this surrogate.
    pub surrogate: Option<String>,
    /// Entries of its m4gnSurrogate.
    #[serde(default)]
    pub surrogate_entries: String,
    /// Whether a run ends when its quantities are known.
    #[serde(default = "yes")]
    pub stop: bool,
    /// Time before which no run is ended, s.
    #[serde(default)]
    pub min_time: f64,
    /// Time at which runs end at the latest, s; none: `endTime` of the case.
    pub end_time: Option<f64>,
    /// Probability that an interval holds the true value.
    #[serde(default = "usual_confidence")]
    pub confidence: f64,
    /// Share of the runs that are made a second time, cold and plain and to the end.
    #[serde(default = "usual_share")]
    pub held_out: f64,
    /// Runs at once.
    #[serde(default = "one")]
    pub jobs: usize,
    /// Longest wall time of a program, s.
    #[serde(default = "a_day")]
    pub time_limit: u64,
    /// What is to be known.
    #[serde(default)]
    pub quantity: Vec<Quantity>,
}

/// A figure, as m4gnAverages takes it.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Quantity {
    /// Its name in the results.
    pub name: String,
    /// Function object of the case that publishes it.
    pub function_object: String,
    /// Name of the result.
    pub result: String,
    /// `x`, `y` or `z` of a vector.
    pub component: Option<String>,
    /// Mean or rms of the fluctuations.
    #[serde(default, skip_serializing_if = "is_default")]
    pub statistic: Statistic,
    /// Largest half-width of the interval when the figure is known.
    pub tolerance: Option<f64>,
    /// The same over the figure's magnitude.
    pub relative: Option<f64>,
}

impl Quantity {
    /// Its tolerance at a value, in its unit; none: it has none.
    pub fn tolerance_at(&self, value: f64) -> Option<f64> {
        self.tolerance.or(self.relative.map(|r| r * value.abs()))
    }
}

/// What of a series is asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Statistic {
    /// Its mean.
    #[default]
    Mean,
    /// The root mean square of the fluctuations.
    Rms,
}

fn one() -> usize {
    1
}

fn yes() -> bool {
    true
}

fn usual_confidence() -> f64 {
    0.95
}

fn usual_share() -> f64 {
    0.1
}

fn a_day() -> u64 {
    86_400
}

impl Settings {
    /// Reads and checks `campaign.toml` of a folder. The case's path is taken from there.
    ///
    /// # Errors
    /// [`Error::File`] naming the file and the entry.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(FILE);
        let text = files::read_text(&path).map_err(|e| {
            Error::file(
                &path,
                format!("cannot be read: {e}; 'm4gn campaign init CASE --out FOLDER' makes it"),
            )
        })?;
        let mut settings: Settings =
            toml::from_str(&text).map_err(|e| Error::file(&path, e.to_string().trim_end()))?;
        settings.check().map_err(|e| Error::file(&path, e.to_string()))?;
        settings.case = folder.join(&settings.case);
        Ok(settings)
    }

    fn check(&self) -> Result<()> {
        let positive = |v: f64| v.is_finite() && v > 0.0;
        for (what, command) in self.prepare.iter().map(|c| ("prepare", c)).chain([("solver", &self.solver)]) {
            refuse(command.is_empty(), Error::Input, || {
                format!("{what}: expected a program and its arguments, found []")
            })?;
        }
        for (what, n) in [("ranks", self.ranks), ("jobs", self.jobs)] {
            refuse(n == 0, Error::Input, || format!("{what} = 0: expected at least 1"))?;
        }
        refuse(self.time_limit == 0, Error::Input, || "time_limit = 0: expected seconds, at least 1")?;
        refuse(!(0.0..=1.0).contains(&self.held_out), Error::Input, || {
            format!("held_out = {}: expected a share between 0 and 1", self.held_out)
        })?;
        refuse(!(self.confidence > 0.0 && self.confidence < 1.0), Error::Input, || {
            format!("confidence = {}: expected a number between 0 and 1, without them", self.confidence)
        })?;
        refuse(!(self.min_time.is_finite() && self.min_time >= 0.0), Error::Input, || {
            format!("min_time = {}: expected seconds, at least 0", self.min_time)
        })?;
        refuse_any(self.end_time.filter(|t| !t.is_finite()), Error::Input, |t| {
            format!("end_time = {t}: expected seconds")
        })?;
        refuse_any(self.surrogate.as_ref().filter(|s| *s != "dmd"), Error::Input, |s| {
            format!("surrogate = \"{s}\": expected \"dmd\", or no such entry")
        })?;
        refuse(
            self.surrogate.is_none() && !self.surrogate_entries.is_empty(),
            Error::Input,
            || "surrogate_entries without surrogate: expected surrogate = \"dmd\" as well",
        )?;
        let mut names = HashSet::new();
        for q in &self.quantity {
            let fault = |what: String| Err(Error::Input(format!("quantity '{}': {what}", q.name)));
            if !is_word(&q.name) || !names.insert(&q.name) {
                return fault("expected a name of its own, of letters, digits, _ and -".into());
            }
            if ["time", "Time"].contains(&q.name.as_str()) {
                return fault("expected another name, as m4gnAverages has the run's time by this one".into());
            }
            if let Some(c) = q.component.as_ref().filter(|c| !["x", "y", "z"].contains(&c.as_str())) {
                return fault(format!("component = \"{c}\": expected x, y or z"));
            }
            for text in [&q.function_object, &q.result] {
                if text.is_empty() || text.contains(|c: char| c.is_whitespace() || ";{}\"$".contains(c)) {
                    return fault(format!("'{text}': expected a word of OpenFOAM"));
                }
            }
            if q.tolerance.is_some() && q.relative.is_some() {
                return fault("expected tolerance or relative, found both".into());
            }
            if let Some(v) = q.tolerance.or(q.relative).filter(|v| !positive(*v)) {
                return fault(format!("tolerance {v}: expected a positive number"));
            }
        }
        Ok(())
    }

    /// What has to be there before a run is made.
    ///
    /// # Errors
    /// [`Error::File`] naming what `campaign.toml` lacks.
    pub fn check_quantities(&self, folder: &Path) -> Result<()> {
        let file = |message: &str| Err(Error::file(folder.join(FILE), message));
        if self.quantity.is_empty() {
            return file(
                "has no [[quantity]]: expected at least one; the file shows how one looks (docs/how-to/run-a-campaign.md)",
            );
        }
        if self.stop && self.quantity.iter().all(|q| q.tolerance.is_none() && q.relative.is_none()) {
            return file(
                "expected tolerance or relative of a [[quantity]], which says when a run ends, or stop = false; found neither",
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "case = \"../cavity\"\nsolver = [\"icoFoam\"]\nscale = \"U\"\n[[quantity]]\nname = \"Cd\"\n\
                        function_object = \"forces\"\nresult = \"Cd\"\nrelative = 0.01\n";

    fn read(text: &str) -> Result<Settings> {
        Settings::read(crate::fixtures::folder(&[(FILE, text)]).path())
    }

    #[test]
    fn what_is_not_said_has_its_usual_value() {
        let s = read(GOOD).unwrap();
        assert!(s.case.ends_with("../cavity") && s.case.is_absolute());
        assert_eq!((s.ranks, s.jobs, s.held_out, s.stop), (1, 1, 0.1, true));
        assert_eq!((s.start, s.quantity[0].statistic), (Start::Auto, Statistic::Mean));
        s.check_quantities(Path::new("c")).unwrap();
    }

    #[test]
    fn wrong_entries_are_named() {
        for (from, to, expected) in [
            ("solver = [\"icoFoam\"]", "solver = []", "solver: expected a program"),
            ("scale", "scales", "unknown field `scales`"),
            ("scale = \"U\"", "ranks = 0", "ranks = 0"),
            ("scale = \"U\"", "held_out = 2", "held_out = 2: expected a share"),
            ("scale = \"U\"", "surrogate = \"pod\"", "expected \"dmd\""),
            ("scale = \"U\"", "surrogate_entries = \"a 1;\"", "expected surrogate = \"dmd\" as well"),
            (
                "scale = \"U\"",
                "start = \"warm\"",
                "unknown variant `warm`, expected one of `cold`, `nearest`, `auto`",
            ),
            ("relative = 0.01", "relative = 0.01\ntolerance = 1.0", "found both"),
            ("relative = 0.01", "relative = -1", "expected a positive number"),
            ("relative = 0.01", "component = \"w\"", "expected x, y or z"),
            ("\"Cd\"\nfunc", "\"a b\"\nfunc", "expected a name"),
            ("\"Cd\"\nfunc", "\"time\"\nfunc", "expected another name"),
            ("\"forces\"", "\"a; b\"", "expected a word"),
        ] {
            assert!(GOOD.contains(from), "{from}");
            m4gn_samples::fails(read(&GOOD.replacen(from, to, 1)), &[expected, FILE]);
        }
        let none = read(&GOOD.replace("relative = 0.01", "")).unwrap();
        assert!(none.check_quantities(Path::new("c")).unwrap_err().to_string().contains("stop = false"));
    }
}
