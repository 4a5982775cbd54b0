//! Export: the check of settings before they are used.

use super::modes::ModesOptions;
use super::pointers;
use super::recorder::RecorderOptions;
use super::segments::Request;
use m4gn_base::settings::{self, table::Table};
use m4gn_base::{Error, Result};
use m4gn_model::SegmentSpec;
use m4gn_ride::control::ControlSettings;
use m4gn_ride::{DmdSettings, QuantitySettings, RideSettings};
use m4gn_step::SessionOptions;
use serde_json::{Value, json};
use std::ffi::c_char;

/// The settings of the call that makes an object of this kind. `others` among them are names of entries that the host reads itself: one that is
/// unknown may be meant for one of these.
fn check(kind: &str, options: &str) -> Result<()> {
    let mut entries = settings::object(serde_json::from_str(options).unwrap_or_default());
    let Some(others) = entries.remove("others") else { return check_own(kind, options) };
    let others: Vec<&str> = others.as_array().into_iter().flatten().filter_map(Value::as_str).collect();
    let rest = Value::Object(entries.clone()).to_string();
    check_own(kind, &rest).map_err(|error| {
        let unknown = |name: &&String| {
            check_own(kind, &json!({ name.as_str(): entries[*name] }).to_string()).is_err()
                && !others.contains(&name.as_str())
        };
        let meant = entries.keys().filter(unknown).map(|name| (name, settings::suggestion(name, &others)));
        match meant.into_iter().find(|(_, meant)| !meant.is_empty()) {
            Some((name, meant)) => Error::Input(format!("{name}: unknown entry{meant}")),
            None => error,
        }
    })
}

fn check_own(kind: &str, options: &str) -> Result<()> {
    match kind {
        "session" => SessionOptions::parse(options).map(|_| ()),
        "segments" => Request::parse(options).map(|_| ()),
        "modes" => ModesOptions::parse(options).map(|_| ()),
        "solid_modes" => ModesOptions::of_body(options).map(|_| ()),
        "recorder" => RecorderOptions::parse(options).map(|_| ()),
        "ride" => RideSettings::parse(options).map(|_| ()),
        _ => Err(Error::Input(format!(
            "kind of options '{kind}': expected session, segments, modes, solid_modes, recorder or ride"
        ))),
    }
}

/// The entries of all settings.
pub fn tables() -> Vec<Table> {
    vec![
        SegmentSpec::table(),
        SessionOptions::table(),
        RideSettings::table(),
        ControlSettings::table(),
        QuantitySettings::table(),
        DmdSettings::table(),
        Request::table(),
        ModesOptions::table(),
        RecorderOptions::table(),
    ]
}

exports! {
    /// Whether settings are valid, as far as they can be without a mesh, a model or other ranks.
    fn m4gn_options_check(kind: *const c_char, options: *const c_char) -> i32, or |status| status; {
        // SAFETY: the host's strings, or null.
        let (kind, options) = unsafe { (pointers::text("kind", kind)?, pointers::options(options)?) };
        check(kind, options).map(|()| 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_has_its_own_settings() {
        for (kind, good, bad, message) in [
            ("session", r#"{"nThreads": 2}"#, r#"{"n_threads": 0}"#, "n_threads: expected 1 to"),
            ("session", "{}", r#"{"backend": "abacus"}"#, "backend: backend 'abacus': expected native"),
            (
                "segments",
                r#"{"segments": {"count": 3}}"#,
                r#"{"segments": {"count": 0}}"#,
                "segments.count: expected",
            ),
            ("modes", r#"{"block": 2}"#, r#"{"block": -1}"#, "block: expected a whole number"),
            ("solid_modes", r#"{"modes": 2}"#, r#"{"block": 2}"#, "block and shift are for matrices"),
            (
                "ride",
                r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 4}"#,
                r#"{"mode": "replace", "solverSteps": 5}"#,
                "surrogateSteps",
            ),
            (
                "recorder",
                r#"{"path": "a", "split": "test"}"#,
                r#"{"path": "a", "split": "tset"}"#,
                "is test meant",
            ),
            ("recorder", r#"{"path": "a", "provenance": {"aB": 1}}"#, "{}", "missing field path"),
            (
                "recorder",
                r#"{"path": "a"}"#,
                r#"{"path": "a", "provenance": [1]}"#,
                "provenance: expected a map",
            ),
        ] {
            check(kind, good).unwrap();
            let found = check(kind, bad).unwrap_err().to_string();
            assert!(found.contains(message), "{kind} {bad}: {found}");
        }
        assert!(check("surrogate", "{}").is_err());
    }

    #[test]
    fn an_entry_that_may_be_meant_for_the_host_is_named() {
        let check = |entry: &str| {
            let options = format!(r#"{{"precision": "fp32", {entry}, "others": ["surrogates", "mode"]}}"#);
            check("session", &options).unwrap_err().to_string()
        };
        assert!(check(r#""surrogate": ["dmd"]"#).contains("surrogate: unknown entry; is surrogates meant?"));
        assert!(check(r#""surogates": ["dmd"]"#).contains("is surrogates meant?"));
        assert!(check(r#""n_threads": 0"#).contains("n_threads: expected"));
        assert!(check(r#""presicion": "fp32""#).contains("is precision meant?"));
    }
}
