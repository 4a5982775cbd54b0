//! At which resolution a network runs in a case.

use m4gn_base::{Error, Result};
use serde::{Deserialize, Serialize};

/// What a case says about the graph's resolution: a word or a length, m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub enum Resolution {
    /// The model's own.
    #[default]
    Auto,
    /// A node a cell, whatever the mesh.
    Off,
    /// This mean distance of neighbouring nodes, m.
    Length(f64),
}

/// As it is written.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected auto, off or a positive length in m")]
enum Written {
    Length(f64),
    /// OpenFOAM's dictionaries hand `off` over as a switch.
    Switch(bool),
    Word(String),
}

impl TryFrom<Written> for Resolution {
    type Error = Error;

    fn try_from(written: Written) -> Result<Self> {
        match written {
            Written::Word(word) => word.parse(),
            Written::Switch(false) => Ok(Resolution::Off),
            Written::Switch(true) => Err(refused("on")),
            Written::Length(length) if length.is_finite() && length > 0.0 => Ok(Resolution::Length(length)),
            Written::Length(length) => Err(refused(&length.to_string())),
        }
    }
}

impl From<Resolution> for Written {
    fn from(resolution: Resolution) -> Self {
        match resolution {
            Resolution::Auto => Written::Word("auto".into()),
            Resolution::Off => Written::Word("off".into()),
            Resolution::Length(length) => Written::Length(length),
        }
    }
}

impl std::str::FromStr for Resolution {
    type Err = Error;

    fn from_str(word: &str) -> Result<Self> {
        match (word, word.parse::<f64>()) {
            ("auto", _) => Ok(Resolution::Auto),
            ("off", _) => Ok(Resolution::Off),
            (_, Ok(length)) => Written::Length(length).try_into(),
            _ => Err(refused(word)),
        }
    }
}

fn refused(found: &str) -> Error {
    Error::Input(format!("resolution: expected auto, off or a positive length in m, found {found}"))
}

impl Resolution {
    /// Mean distance of neighbouring nodes that a graph is to have, m, where the model's own is `trained`
    /// ([`crate::ModelSpec::resolution`]); none: a node a cell.
    pub fn of(self, trained: Option<f64>) -> Option<f64> {
        match self {
            Resolution::Auto => trained,
            Resolution::Off => None,
            Resolution::Length(length) => Some(length),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_and_lengths() {
        let of = |word: &str| word.parse::<Resolution>().unwrap().of(Some(0.25));
        assert_eq!((of("auto"), of("off"), of("0.5")), (Some(0.25), None, Some(0.5)));
        for word in ["", "fine", "-1", "0", "nan", "inf"] {
            m4gn_samples::fails(word.parse::<Resolution>(), &["expected auto, off or a positive length"]);
        }
    }

    #[test]
    fn written_as_json() {
        for text in ["\"auto\"", "\"off\"", "0.5"] {
            let resolution: Resolution = serde_json::from_str(text).unwrap();
            assert_eq!(serde_json::to_string(&resolution).unwrap(), text);
        }
        let switch: Resolution = serde_json::from_str("false").unwrap();
        assert_eq!(switch, Resolution::Off);
        for text in ["-2.0", "true", "[]", "\"fine\""] {
            let error = serde_json::from_str::<Resolution>(text).unwrap_err().to_string();
            assert!(error.contains("expected auto, off or a positive length"), "{error}");
        }
    }
}
