//! Settings as text: what a case dictionary, a host program and a configuration say, in one vocabulary, checked once.
//!
//! The name of a setting is that of its entry in a model's description, `distance_scale`. Names in OpenFOAM's spelling,
//! `distanceScale`, are taken for the same.

pub mod table;

use crate::{Error, Result};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Most letters that a misspelt name is away from the one that is suggested.
const SLIP: usize = 2;

/// Whether an entry says what holds without it, and need not be written.
pub fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// Settings from a JSON object. Within the entries `free`, names are the user's own and stay as they are.
///
/// # Errors
/// [`Error::Input`] that begins with `what` and names the entry, what was expected and what was found.
pub fn parse<T: DeserializeOwned>(what: &str, text: &str, free: &[&str]) -> Result<T> {
    let bad = |problem: String| Error::Input(format!("{what}: {problem}"));
    let mut whole: Value = serde_json::from_str(text)
        .map_err(|e| bad(format!("expected a JSON object with settings, found {text}: {e}")))?;
    if !whole.is_object() {
        return Err(bad(format!("expected a JSON object with settings, found {text}")));
    }
    let mut given = BTreeMap::new();
    rename(&mut whole, free, &mut given).map_err(bad)?;
    T::deserialize(&whole).map_err(|e| {
        let (path, mut problem) = culprit::<T>(&whole, &e);
        // As a dictionary spells names, unless only ours are there
        if problem.starts_with("unknown entry") && (!given.is_empty() || !text.contains('_')) {
            problem = their_spelling(&problem);
        }
        let spelt: Vec<&str> =
            path.iter().map(|name| given.get(name).map_or(name.as_str(), String::as_str)).collect();
        bad(match spelt.is_empty() {
            true => problem,
            false => format!("{}: {problem}", spelt.join(".")),
        })
    })
}

/// Settings that stand as an entry of this name in others, in our spelling.
pub fn read<T: DeserializeOwned>(name: &str, entries: &Value) -> Result<T> {
    T::deserialize(entries).map_err(|e| {
        let (path, problem) = culprit::<T>(entries, &e);
        let whole: Vec<&str> = std::iter::once(name).chain(path.iter().map(String::as_str)).collect();
        Error::Input(format!("{}: {problem}", whole.join(".")))
    })
}

/// A line for each entry, `segments.tau 0.5`: the form in which ranks compare what they were given.
pub fn lines(settings: &impl Serialize) -> Result<String> {
    let value =
        serde_json::to_value(settings).map_err(|e| Error::Internal(format!("settings as JSON: {e}")))?;
    let mut text = String::new();
    write_lines(&value, "", &mut text);
    Ok(text)
}

fn write_lines(value: &Value, path: &str, text: &mut String) {
    match value {
        Value::Object(entries) => {
            for (key, inner) in entries {
                let dot = if path.is_empty() { "" } else { "." };
                write_lines(inner, &format!("{path}{dot}{key}"), text);
            }
        }
        leaf => {
            let _ = writeln!(text, "{path} {leaf}");
        }
    }
}

/// `distanceScale` as `distance_scale`.
fn our_spelling(name: &str) -> String {
    let mut ours = String::with_capacity(name.len() + 2);
    for c in name.chars() {
        if c.is_ascii_uppercase() && !ours.is_empty() {
            ours.push('_');
        }
        ours.push(c.to_ascii_lowercase());
    }
    ours
}

/// `distance_scale` as `distanceScale`.
fn their_spelling(text: &str) -> String {
    let mut words = text.split('_');
    let mut theirs = words.next().unwrap_or_default().to_string();
    for word in words {
        theirs.extend(word.chars().take(1).map(|c| c.to_ascii_uppercase()).chain(word.chars().skip(1)));
    }
    theirs
}

/// Gives all names our spelling; `given` keeps those that the user wrote.
fn rename(
    value: &mut Value,
    free: &[&str],
    given: &mut BTreeMap<String, String>,
) -> std::result::Result<(), String> {
    let Value::Object(entries) = value else {
        return Ok(());
    };
    for (name, mut inner) in std::mem::take(entries) {
        let ours = our_spelling(&name);
        if !free.contains(&ours.as_str()) {
            rename(&mut inner, free, given)?;
        }
        if entries.insert(ours.clone(), inner).is_some() {
            return Err(format!("{ours} is given twice, also as {name}"));
        }
        if ours != name {
            given.insert(ours, name);
        }
    }
    Ok(())
}

/// The entry that is refused alone with the same words, by its path, and what is wrong with it. What all entries at a place lack is said
/// of the place.
fn culprit<T: DeserializeOwned>(whole: &Value, problem: &serde_json::Error) -> (Vec<String>, String) {
    let (mut path, problem, mut at) = (Vec::new(), problem.to_string(), whole);
    while let Value::Object(entries) = at {
        let is_refused = |(name, inner): &(&String, &Value)| {
            let alone = |inner: Value, name: &String| json!({ name.as_str(): inner });
            let nested = path.iter().rev().fold(alone((*inner).clone(), name), alone);
            T::deserialize(&nested).is_err_and(|e| e.to_string() == problem)
        };
        let refused: Vec<_> = entries.iter().filter(is_refused).collect();
        let Some(&(name, inner)) = refused.first().filter(|_| refused.len() < entries.len().max(2)) else {
            break;
        };
        path.push(name.clone());
        at = inner;
    }
    (path, in_words(&problem))
}

/// Serde's message in the words of ours: what was expected, what was found, and the name that may be meant.
fn in_words(problem: &str) -> String {
    let Some((found, expected)) = problem.split_once(", expected ") else {
        return problem.replace('`', "");
    };
    let expected = match expected {
        "usize" => "a whole number that is not negative".into(),
        "f64" => "a number".into(),
        "a boolean" => "yes or no (in JSON true or false)".into(),
        other => other.replace('`', ""),
    };
    let names: Vec<&str> = problem.split('`').skip(1).step_by(2).collect();
    let unknown = found.starts_with("unknown field") || found.starts_with("unknown variant");
    let meant = match names.split_first() {
        Some((word, others)) if unknown => suggestion(word, others),
        _ => String::new(),
    };
    let found = found.replace('`', "");
    match found.split_once(' ') {
        Some(("unknown", _)) if found.starts_with("unknown field") => {
            format!("unknown entry, expected {expected}{meant}")
        }
        Some(("unknown", word)) => {
            let word = word.trim_start_matches("variant ");
            format!("expected {expected}, found {word}{meant}")
        }
        Some(("invalid", rest)) => {
            let rest = rest.split_once(": ").map_or(rest, |(_, value)| value);
            format!("expected {expected}, found {rest}")
        }
        _ => format!("expected {expected}, found {found}"),
    }
}

/// `; is NAME meant?` where one of the names is but a slip away from the word; else nothing.
pub fn suggestion(word: &str, names: &[&str]) -> String {
    let nearest = names.iter().map(|name| (strsim::levenshtein(word, name), name)).min();
    match nearest {
        Some((far, name)) if far <= SLIP && far < word.len() => format!("; is {name} meant?"),
        _ => String::new(),
    }
}

/// The entries of a JSON object; of anything else none.
pub fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(entries) => entries,
        _ => Map::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_model::{SegmentEntries, SegmentSpec};
    use m4gn_samples::fails;
    use serde::Deserialize;

    #[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Whole {
        n_threads: usize,
        segments: SegmentEntries,
        notes: Map<String, Value>,
    }

    fn whole(text: &str) -> Result<Whole> {
        parse("case", text, &["notes"])
    }

    #[test]
    fn both_spellings_are_the_same_setting() {
        let ours = whole(r#"{"n_threads": 2, "segments": {"distance_scale": 0.1}, "notes": {"deltaT": 1}}"#)
            .unwrap();
        let theirs =
            whole(r#"{"nThreads": 2, "segments": {"distanceScale": 0.1}, "notes": {"deltaT": 1}}"#).unwrap();
        assert_eq!(ours, theirs);
        assert_eq!(theirs.notes["deltaT"], 1);
        let spec = theirs.segments.over(&SegmentSpec::default()).unwrap();
        assert_eq!(spec.distance_scale, Some(0.1));
        fails(whole(r#"{"nThreads": 2, "n_threads": 3}"#), &["n_threads is given twice"]);
    }

    #[test]
    fn each_message_names_entry_expectation_and_finding() {
        for (text, expected) in [
            ("[1]", "case: expected a JSON object with settings, found [1]"),
            ("{", "case: expected a JSON object with settings, found {"),
            (
                r#"{"nThread": 2}"#,
                "case: nThread: unknown entry, expected one of nThreads, segments, notes; is nThreads meant?",
            ),
            (
                r#"{"nThreads": -2}"#,
                "case: nThreads: expected a whole number that is not negative, found integer -2",
            ),
            (
                r#"{"segments": {"tau": 1, "cuont": 3}}"#,
                "case: segments.cuont: unknown entry, expected one of method, count,",
            ),
            (r#"{"segments": {"cuont": 3}}"#, "; is count meant?"),
            (
                r#"{"note": 3}"#,
                "case: note: unknown entry, expected one of nThreads, segments, notes; is notes meant?",
            ),
            (r#"{"n_thread": 3}"#, "expected one of n_threads, segments, notes"),
            (
                r#"{"segments": {"connected": "maybe"}}"#,
                r#"case: segments.connected: expected yes or no (in JSON true or false), found string "maybe""#,
            ),
            (
                r#"{"segments": {"method": "slic-mdodx"}}"#,
                "case: segments.method: expected one of metis, slic, slic-md, slic-mdodl, slic-mdode, found slic-mdodx; is slic-mdod",
            ),
            (r#"{"segments": 3}"#, "case: segments: expected a map, found integer 3"),
        ] {
            fails(whole(text), &[expected]);
        }
    }

    #[test]
    fn a_name_is_found_beside_a_right_one_where_another_entry_is_required() {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Inner {
            #[serde(rename = "interval")]
            _interval: Option<f64>,
        }
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Outer {
            #[serde(rename = "mode")]
            _mode: String,
            #[serde(rename = "linear")]
            _linear: Option<Inner>,
        }
        let found = |text| parse::<Outer>("ride", text, &[]).unwrap_err().to_string();
        let message = found(r#"{"linear": {"interval": 1, "intervall": 2}, "mode": "replace"}"#);
        assert!(message.contains("linear") && message.contains("intervall"), "{message}");
        assert!(message.contains("interval") && !message.contains("mode"), "{message}");
        let message = found(r#"{"linear": {"interval": 1}, "other": 1, "mode": "replace"}"#);
        assert!(message.contains("other") && !message.contains("missing"), "{message}");
        assert!(found(r#"{"linear": {"interval": 1}}"#).contains("missing field mode"));
    }

    #[test]
    fn a_line_for_each_entry() {
        let settings = whole(r#"{"segments": {"tau": 0.5, "obstacles": ["a", "b"]}}"#).unwrap();
        assert_eq!(
            lines(&settings).unwrap(),
            "n_threads 0\nsegments.obstacles [\"a\",\"b\"]\nsegments.tau 0.5\n"
        );
    }
}
