//! Commands of a family that make the mesh and the first fields.

use super::expression;
use super::family::Draw;
use m4gn_base::Result;
use serde::Deserialize;

/// A command that makes the mesh or the first fields: a program and its arguments, in some or in all cases.
#[derive(Clone, Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a list of a program and its arguments, or { when = \"CONDITION\", run = [such a list] }"
)]
pub enum Command {
    /// Runs in all cases.
    Always(Vec<String>),
    /// Runs where the condition holds.
    When(Conditional),
}

/// A command with a condition.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditional {
    /// Condition.
    pub when: String,
    /// The command.
    pub run: Vec<String>,
}

impl Command {
    /// The program and its arguments.
    pub fn words(&self) -> &[String] {
        match self {
            Command::Always(words) => words,
            Command::When(conditional) => &conditional.run,
        }
    }

    /// Whether the case needs it.
    ///
    /// # Errors
    /// As [`expression::number`], for the condition.
    pub fn applies(&self, draw: &Draw) -> Result<bool> {
        match self {
            Command::Always(_) => Ok(true),
            Command::When(conditional) => expression::holds(&conditional.when, &draw.variables),
        }
    }
}
