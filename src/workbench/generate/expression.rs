//! Derived quantities of a family: arithmetic over its parameters, as minijinja's expressions have it.
//!
//! `+ - * / **`, parentheses, comparisons, `and`, `or`, `not`, `A if C else B`, and the functions `sqrt`, `cos`, `sin`, `exp`, `min`, `max`,
//! `round`, `ceil`, and `steps(x)`: the smallest number of steps, at least x, that makes their length a short decimal.

use m4gn_mesh::{Error, Result};
use minijinja::{Environment, ErrorKind, UndefinedBehavior, Value};
use std::collections::BTreeMap;

/// Numbers by name.
pub type Variables = BTreeMap<String, f64>;

/// The value of an expression.
///
/// # Errors
/// [`Error::Input`] naming the expression, where it is none, has an unknown name, or is no finite number.
pub fn number(expression: &str, variables: &Variables) -> Result<f64> {
    let value = evaluate(expression, variables)?;
    match f64::try_from(value.clone()) {
        Ok(v) if v.is_finite() => Ok(v),
        _ => Err(fault(
            expression,
            variables,
            &format!("is {value}: expected a finite number"),
        )),
    }
}

/// Whether a condition holds.
///
/// # Errors
/// As [`number`].
pub fn holds(expression: &str, variables: &Variables) -> Result<bool> {
    Ok(evaluate(expression, variables)?.is_true())
}

fn evaluate(expression: &str, variables: &Variables) -> Result<Value> {
    let mut environment = Environment::new();
    environment.set_undefined_behavior(UndefinedBehavior::Strict);
    for (name, function) in FUNCTIONS {
        environment.add_function(name, function);
    }
    environment.add_function("min", f64::min);
    environment.add_function("max", f64::max);
    environment.add_function("steps", steps);
    environment
        .compile_expression(expression)
        .and_then(|e| e.eval(variables))
        .map_err(|e| fault(expression, variables, &e.to_string()))
}

type Function = fn(f64) -> f64;

const FUNCTIONS: [(&str, Function); 6] = [
    ("sqrt", f64::sqrt),
    ("cos", f64::cos),
    ("sin", f64::sin),
    ("exp", f64::exp),
    ("round", f64::round),
    ("ceil", f64::ceil),
];

/// The smallest number without prime factors but 2 and 5 that is at least `least`.
fn steps(least: f64) -> std::result::Result<f64, minijinja::Error> {
    if least.is_nan() || least > 1e9 {
        return Err(minijinja::Error::new(
            ErrorKind::InvalidOperation,
            format!("steps({least}): expected at most 1e9"),
        ));
    }
    let powers = |base: f64| (0..31).map(move |k| base.powi(k));
    let all = powers(5.0).flat_map(|five| powers(2.0).map(move |two| two * five));
    Ok(all.filter(|&n| n >= least).fold(f64::INFINITY, f64::min))
}

fn fault(expression: &str, variables: &Variables, what: &str) -> Error {
    let known: Vec<&str> = variables.keys().map(String::as_str).collect();
    Error::Input(format!(
        "expression '{expression}': {what}; the names here are {}",
        known.join(", ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(expression: &str) -> Result<f64> {
        let variables = [("u0", 1.5), ("nu", 1e-3)].map(|(k, v)| (k.to_string(), v));
        number(expression, &variables.into())
    }

    #[test]
    fn arithmetic_on_paper() {
        assert_eq!(at("2/3*u0").unwrap(), 1.0);
        assert_eq!(at("-4*u0 + sqrt(9)**2").unwrap(), 3.0);
        assert_eq!(at("max(1, 2) if u0 > 1 and nu < 1 else 0").unwrap(), 2.0);
        assert_eq!(at("cos(0)").unwrap(), 1.0);
    }

    #[test]
    fn steps_are_short_decimals() {
        let nice: Vec<f64> = (1..=50).map(|n| at(&format!("steps({n})")).unwrap()).collect();
        let expected = [1, 2, 4, 5, 8, 10, 16, 20, 25, 32, 40, 50];
        let mut found: Vec<u32> = nice.iter().map(|&n| n as u32).collect();
        found.dedup();
        assert_eq!(found, expected);
        assert_eq!(at("steps(6.04)").unwrap(), 8.0);
        assert_eq!(at("steps(-3)").unwrap(), 1.0);
    }

    #[test]
    fn what_is_no_number_is_told() {
        for (bad, words) in [
            ("u1 + 1", "the names here are nu, u0"),
            ("1 +", "syntax error"),
            ("1/0", "1 / 0"),
            ("sqrt(0 - 1)", "finite number"),
            ("'text'", "finite number"),
            ("steps(1e300)", "at most 1e9"),
            ("exp(1000)", "finite number"),
        ] {
            let message = at(bad).unwrap_err().to_string();
            assert!(message.contains(words), "{bad}: {message}");
        }
    }
}
