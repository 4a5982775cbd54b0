//! Parameters of a family: what each is, what the user sets it to, and how it is drawn.

use m4gn_base::{Error, Result, listed, refuse};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A parameter as family.toml describes it: with a `range` it is drawn, with a `value` it has that unless it is set.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameter {
    /// Name, in templates between `@`.
    pub name: String,
    /// What it is, with its unit.
    #[serde(default)]
    pub about: String,
    /// Lowest and highest value of the draw.
    pub range: Option<[f64; 2]>,
    /// Value when nothing is set.
    pub value: Option<Value>,
    /// Words that stand for numbers.
    #[serde(default)]
    pub choices: BTreeMap<String, f64>,
    /// What it must be greater than.
    pub above: Option<f64>,
}

/// The value of a parameter: a number, or the name of a choice.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A number.
    Number(f64),
    /// A choice.
    Name(String),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Value::Number(v) => write!(f, "{v}"),
            Value::Name(name) => f.write_str(name),
        }
    }
}

/// What the user sets a parameter to.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// One value for all cases.
    Value(Value),
    /// Drawn between these.
    Range([f64; 2]),
}

impl std::fmt::Display for Setting {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Setting::Value(v) => write!(f, "{v}"),
            Setting::Range([low, high]) => write!(f, "{low}:{high}"),
        }
    }
}

impl std::str::FromStr for Setting {
    type Err = Error;

    /// `VALUE`, `LOW:HIGH` or the name of a choice.
    fn from_str(text: &str) -> Result<Self> {
        let number = |t: &str| t.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        if let Some((low, high)) = text.split_once(':') {
            return match (number(low), number(high)) {
                (Some(low), Some(high)) if low <= high => Ok(Setting::Range([low, high])),
                _ => Err(Error::Input(format!(
                    "'{text}': expected LOW:HIGH with two numbers, the lower one first"
                ))),
            };
        }
        match number(text) {
            Some(v) => Ok(Setting::Value(Value::Number(v))),
            // Not nan or inf
            None if is_word(text) && text.parse::<f64>().is_err() => {
                Ok(Setting::Value(Value::Name(text.into())))
            }
            None => {
                Err(Error::Input(format!("'{text}': expected a number, LOW:HIGH, or the name of a choice")))
            }
        }
    }
}

impl<'de> Deserialize<'de> for Setting {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        match Value::deserialize(from)? {
            Value::Name(text) => text.parse().map_err(serde::de::Error::custom),
            number => Ok(Setting::Value(number)),
        }
    }
}

/// What the user sets, by the name of the parameter.
pub type Settings = BTreeMap<String, Setting>;

/// `NAME=VALUE`, `NAME=LOW:HIGH`, as on the command line.
///
/// # Errors
/// [`Error::Input`] where it is neither.
pub fn parse_setting(text: &str) -> Result<(String, Setting)> {
    match text.split_once('=') {
        Some((name, value)) => Ok((name.trim().to_string(), value.trim().parse()?)),
        None => Err(Error::Input(format!("'{text}': expected NAME=VALUE or NAME=LOW:HIGH"))),
    }
}

/// Whether the text can stand in a dictionary, a template and a command as it is.
pub(crate) fn is_word(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    text.len() <= LONGEST_NAME
        && text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(plain)
}

/// Most letters of a name.
const LONGEST_NAME: usize = 64;

/// A text in a message: no more of it than helps.
pub(crate) fn shortened(text: &str) -> String {
    text.chars().take(LONGEST_NAME).collect()
}

/// A value with so many decimals.
pub(super) fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10f64.powi(decimals);
    (value * scale).round() / scale
}

/// Whether values can be rounded to so many decimals.
///
/// # Errors
/// [`Error::Input`] where not.
pub(super) fn check_decimals(decimals: i32) -> Result<()> {
    refuse(!(-15..=15).contains(&decimals), Error::Input, || {
        format!("decimals = {decimals}: expected -15 to 15")
    })
}

impl Parameter {
    /// Checks what family.toml says of it.
    pub(super) fn check(&self) -> Result<()> {
        let fault = |what: &str| Err(Error::Input(format!("parameter '{}': {what}", shortened(&self.name))));
        if !is_word(&self.name) || self.name.contains('-') {
            return fault("expected a name of at most 64 letters, digits and _");
        }
        let numbers = self.choices.values().copied();
        if let Some(bad) = { numbers }.find(|v| !self.allows(*v)) {
            return fault(&format!("choices: {bad} cannot be, by 'above' or since it is not finite"));
        }
        match (&self.range, &self.value) {
            (Some([low, high]), None) => {
                if low > high {
                    return fault("range: expected two finite numbers, the lower one first");
                }
                self.check_setting(&Setting::Range([*low, *high]))
            }
            (None, Some(value)) => self.check_setting(&Setting::Value(value.clone())),
            _ => fault("expected either 'range', which is drawn, or 'value'"),
        }
    }

    /// Whether it can be set to this.
    ///
    /// # Errors
    /// [`Error::Input`] that says what it can be set to.
    pub fn check_setting(&self, setting: &Setting) -> Result<()> {
        let choices = listed(self.choices.keys());
        let expected = match (choices.is_empty(), self.above) {
            (false, _) => format!("one of {choices}"),
            (true, Some(above)) => format!("numbers above {above}"),
            (true, None) => "a number or LOW:HIGH".into(),
        };
        let good = match setting {
            Setting::Value(Value::Name(name)) => self.choices.contains_key(name),
            Setting::Value(Value::Number(v)) => choices.is_empty() && self.allows(*v),
            Setting::Range([low, high]) => {
                let between = self.allows(*low) && self.allows(*high) && (high - low).is_finite();
                choices.is_empty() && between
            }
        };
        refuse(!good, Error::Input, || {
            format!("parameter '{}' is set to {setting}: expected {expected}", self.name)
        })
    }

    fn allows(&self, value: f64) -> bool {
        value.is_finite() && self.above.is_none_or(|above| value > above)
    }

    /// The number that a value stands for in expressions and templates.
    pub(super) fn number(&self, value: &Value) -> f64 {
        match value {
            Value::Number(v) => *v,
            Value::Name(name) => self.choices.get(name).copied().unwrap_or(f64::NAN),
        }
    }
}

/// Values of all parameters for case `index` of the set `seed`.
///
/// Parameters with a range of their own are drawn one after the other, also where the user sets them, so that a
/// setting changes nothing but its parameter. Where the user gives a range to a parameter that has none, it is drawn
/// from a stream of its own.
///
/// # Errors
/// [`Error::Input`] for a draw that is what its parameter cannot be once it is rounded.
pub(super) fn draw(
    parameters: &[Parameter],
    settings: &Settings,
    seed: u64,
    index: u64,
    decimals: i32,
) -> Result<Vec<Value>> {
    let stream = |number: u64| {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(number);
        random
    };
    let mut common = stream(index);
    let one = |(place, p): (usize, &Parameter)| {
        let setting = settings.get(&p.name);
        let range = match setting {
            Some(Setting::Range(range)) => Some(*range),
            _ => None,
        };
        let drawn = p.range.map(|usual| {
            let [low, high] = range.unwrap_or(usual);
            rounded(common.random_range(low..=high), decimals)
        });
        let value = match (setting, drawn, range) {
            (Some(Setting::Value(value)), ..) => value.clone(),
            (_, Some(drawn), _) => Value::Number(drawn),
            (_, None, Some(range @ [low, high])) => {
                let mut own = stream(index.wrapping_add((place as u64 + 1) << 40));
                Value::Number(short(own.random_range(low..=high), range))
            }
            // `check` has seen to it that there is one.
            (_, None, None) => p.value.clone().unwrap_or(Value::Number(f64::NAN)),
        };
        match p.allows(p.number(&value)) {
            true => Ok(value),
            false => Err(Error::Input(format!(
                "parameter '{}' of case {index} is {value} with {decimals} decimals: expected a finite number{}; raise 'decimals'",
                p.name,
                p.above.map_or(String::new(), |above| format!(" above {above}"))
            ))),
        }
    };
    parameters.iter().enumerate().map(one).collect()
}

/// A number of a range with six significant digits, and more where the range is narrow beside its ends.
pub(crate) fn short(value: f64, [low, high]: [f64; 2]) -> f64 {
    let narrow = (low.abs().max(high.abs()) / (high - low)).log10().round().clamp(0.0, 11.0);
    let digits = 5 + narrow as usize;
    format!("{value:.digits$e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameter(text: &str) -> Parameter {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn settings_are_read() {
        assert_eq!(parse_setting("u0=0.6:2.8").unwrap(), ("u0".into(), Setting::Range([0.6, 2.8])));
        assert_eq!(parse_setting("nu=5e-4").unwrap().1, Setting::Value(Value::Number(5e-4)));
        assert_eq!(parse_setting("shape=square").unwrap().1.to_string(), "square".to_string());
        for bad in ["u0", "u0=", "u0=2:1", "u0=1:x", "u0=nan", "u0=a b", "u0=;"] {
            assert!(parse_setting(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn a_setting_changes_nothing_but_its_parameter() {
        let all = [
            parameter("name = 'a'\nrange = [0, 1]"),
            parameter("name = 'b'\nrange = [5, 6]"),
            parameter("name = 'c'\nvalue = 3"),
        ];
        let drawn = |settings: &[&str]| {
            let settings = settings.iter().map(|s| parse_setting(s).unwrap()).collect();
            draw(&all, &settings, 7, 2, 6).unwrap()
        };
        let usual = drawn(&[]);
        assert_eq!(usual[2], Value::Number(3.0));
        assert_ne!(usual, draw(&all, &Settings::new(), 7, 3, 6).unwrap());
        let fixed = drawn(&["a=0.5"]);
        assert_eq!((&fixed[0], &fixed[1]), (&Value::Number(0.5), &usual[1]));
        let wider = drawn(&["a=0:10", "c=1:2"]);
        assert_eq!(wider[1], usual[1]);
        let number = |v: &Value| match v {
            Value::Number(v) => *v,
            Value::Name(_) => f64::NAN,
        };
        assert!((number(&wider[0]) - 10.0 * number(&usual[0])).abs() < 1e-5);
        assert!((1.0..=2.0).contains(&number(&wider[2])) && number(&wider[2]) != 1.5);
        let narrow = number(&drawn(&["c=101325:101325.02"])[2]);
        assert!(narrow > 101325.0 && narrow < 101325.02, "{narrow}");
    }

    #[test]
    fn what_a_parameter_cannot_be_is_refused() {
        let shape = parameter("name = 's'\nchoices = { round = 0, square = 1 }\nvalue = 'round'");
        let speed = parameter("name = 'u'\nrange = [1, 2]\nabove = 0");
        shape.check().unwrap();
        speed.check().unwrap();
        let refused = |p: &Parameter, setting: &str| p.check_setting(&setting.parse().unwrap()).unwrap_err();
        assert!(refused(&shape, "oval").to_string().contains("one of round, square"));
        assert!(refused(&shape, "1:2").to_string().contains("one of"));
        assert!(refused(&speed, "-1:2").to_string().contains("above 0"));
        assert!(refused(&speed, "fast").to_string().contains("above 0"));
        assert!(parameter("name = 'a b'\nvalue = 1").check().is_err());
        assert!(parameter("name = 'a'").check().is_err());
        assert!(parameter("name = 'a'\nrange = [2, 1]").check().is_err());
        assert!(parameter("name = 'a'\nvalue = 'x'").check().is_err());
        let below = parameter("name = 'a'\nchoices = { x = -5 }\nvalue = 'x'\nabove = 0");
        assert!(below.check().unwrap_err().to_string().contains("-5 cannot be"));
        assert!(parameter("name = 'a'\nrange = [-1e308, 1e308]").check().is_err());
        assert!(parameter("name = 'a'\nrange = [nan, 1]").check().is_err());
        assert!(
            refused(&parameter("name = 'a'\nrange = [1, 2]"), "-1e308:1e308")
                .to_string()
                .contains("expected")
        );
        let long = parameter(&format!("name = '{}'\nvalue = 1", "a".repeat(70_000)));
        assert!(long.check().unwrap_err().to_string().len() < 300);
    }

    #[test]
    fn a_draw_that_is_rounded_to_what_cannot_be_is_refused() {
        let small = [parameter("name = 'a'\nrange = [1e-9, 2e-9]\nabove = 0")];
        m4gn_samples::fails(draw(&small, &Settings::new(), 1, 0, 6), &["is 0 with 6 decimals", "above 0"]);
        assert!(draw(&small, &Settings::new(), 1, 0, 12).is_ok());
    }
}
