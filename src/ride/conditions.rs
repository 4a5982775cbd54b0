//! What a run is made under: boundary conditions, properties, schemes, as its host names them. What was fitted and measured under others does
//! not hold.

use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Figures that differ by less than this part of the largest of them are the same: files have them rounded.
const ROUNDED: f64 = 1e-4;

/// The same of a number in a text, as part of itself.
const ROUNDED_IN_TEXT: f64 = 1e-5;

/// Changes that are named; the others are counted.
const NAMED: usize = 5;

/// Characters of a value that are named.
const EXCERPT: usize = 60;

/// One of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
enum Condition {
    /// As it is given, word by word; numbers are rounded.
    Text(String),
    /// Of a field: rounded.
    Figures(Vec<f64>),
}

/// All of them, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Conditions(BTreeMap<String, Condition>);

impl Conditions {
    /// From the text of a JSON object: texts, and lists of numbers.
    pub fn parse(text: &str) -> Result<Self> {
        serde_json::from_str(text).map_err(|e| {
            Error::Input(format!("conditions: expected a JSON object of texts and lists of numbers: {e}"))
        })
    }

    /// What is another one than before, for people; empty: nothing.
    pub fn changed(&self, before: &Conditions) -> String {
        let names = self.0.keys().chain(before.0.keys().filter(|name| !self.0.contains_key(*name)));
        let others: Vec<&String> =
            names.filter(|name| !same(name, self.0.get(*name), before.0.get(*name))).collect();
        let changes = others.iter().take(NAMED).map(|name| {
            format!("{name} was {} and is {}", excerpt(before.0.get(*name)), excerpt(self.0.get(*name)))
        });
        let mut changes = changes.collect::<Vec<_>>().join("; ");
        if others.len() > NAMED {
            changes += &format!("; and {} more", others.len() - NAMED);
        }
        changes
    }
}

fn same(name: &str, a: Option<&Condition>, b: Option<&Condition>) -> bool {
    // Of a field that the solver makes in its first step, or an entry that its condition writes, one of the runs says nothing.
    if name.contains(" at ") && (a.is_none() || b.is_none()) {
        return true;
    }
    match (a, b) {
        (Some(Condition::Figures(a)), Some(Condition::Figures(b))) => {
            let largest = a.iter().chain(b).fold(0.0_f64, |most, v| most.max(v.abs()));
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= ROUNDED * largest)
        }
        (Some(Condition::Text(a)), Some(Condition::Text(b))) => a == b || same_words(a, b),
        // A figure that one of the runs alone has says nothing.
        (a, b) => [a, b].iter().all(|c| matches!(c, None | Some(Condition::Figures(_)))),
    }
}

fn same_words(a: &str, b: &str) -> bool {
    let words = |text: &str| -> Vec<String> {
        let apart: String = text
            .chars()
            .flat_map(|c| if "(){};,".contains(c) { vec![' ', c, ' '] } else { vec![c] })
            .collect();
        apart.split_whitespace().map(str::to_string).collect()
    };
    let same = |(a, b): (&String, &String)| match (a.parse::<f64>(), b.parse::<f64>()) {
        _ if a == b => true,
        (Ok(a), Ok(b)) => (a - b).abs() <= ROUNDED_IN_TEXT * a.abs().max(b.abs()),
        _ => false,
    };
    let (a, b) = (words(a), words(b));
    a.len() == b.len() && a.iter().zip(&b).all(same)
}

fn excerpt(condition: Option<&Condition>) -> String {
    match condition {
        None => "not there".into(),
        Some(Condition::Text(text)) if text.chars().count() > EXCERPT => {
            text.chars().take(EXCERPT).chain("...".chars()).collect()
        }
        Some(Condition::Text(text)) => text.clone(),
        Some(Condition::Figures(figures)) => {
            let figures: Vec<String> = figures.iter().map(|v| format!("{v:.6e}")).collect();
            format!("({})", figures.join(" "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Conditions {
        Conditions::parse(text).unwrap()
    }

    #[test]
    fn what_differs_by_rounding_is_the_same_and_what_is_another_is_named() {
        let before = of(r#"{"nu": "1e-3", "U at inlet": [1.0, 0.0, 2.5e-9], "scheme": "Euler"}"#);
        let rounded = of(r#"{"nu": "1e-3", "U at inlet": [1.00001, 1e-6, 0], "scheme": "Euler"}"#);
        assert_eq!(rounded.changed(&before), "");
        let written = of(
            r#"{"nu": "0.00100000001", "U at inlet": [1.0, 0.0, 0.0], "scheme": "Euler", "k in cells": [3]}"#,
        );
        assert_eq!(written.changed(&before), "");
        let other = of(r#"{"nu": "1.1e-3", "U at inlet": [1.5, 0, 0], "source": "(on 1)"}"#);
        assert_eq!(
            other.changed(&before),
            "U at inlet was (1.000000e0 0.000000e0 2.500000e-9) and is (1.500000e0 0.000000e0 0.000000e0); nu was 1e-3 and is 1.1e-3; source \
             was not there and is (on 1); scheme was Euler and is not there"
        );
        assert!(!other.changed(&of(r#"{"nu": "1.1e-3", "source": "(on 1 2)"}"#)).is_empty());
        assert!(of("{}").changed(&of("{}")).is_empty());
    }

    #[test]
    fn many_changes_are_counted_and_long_ones_cut() {
        let many: Vec<String> = (0..9).map(|i| format!("\"k{i}\": \"{}\"", "x".repeat(100))).collect();
        let changes = of(&format!("{{{}}}", many.join(","))).changed(&of("{}"));
        assert!(changes.ends_with("; and 4 more") && changes.len() < 600, "{changes}");
        assert!(Conditions::parse("[]").is_err() && Conditions::parse(r#"{"a": {}}"#).is_err());
    }
}
