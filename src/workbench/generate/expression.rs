//! Derived quantities of a family: arithmetic over its parameters.
//!
//! `+ - * / **`, parentheses, comparisons, `and`, `or`, `not`, `A if C else B`, and the functions `sqrt`, `cos`, `sin`, `exp`, `min`, `max`,
//! `round`, `ceil`, and `steps(x)`: the smallest number of steps, at least x, that makes their length a short decimal. As on paper
//! and in Python `-2**2` is -4 and `2**3**2` is 512. Each number on the way is finite, or the expression is an error.

use m4gn_base::{Error, Result, listed};
use std::collections::BTreeMap;

/// Numbers by name.
pub type Variables = BTreeMap<String, f64>;

/// Longest expression, bytes: what is read and computed by recursion stays small.
const LONGEST: usize = 1000;
/// Deepest nesting of parentheses, functions, signs and powers.
const DEEPEST: usize = 60;
/// Words that cannot name a quantity.
const WORDS: [&str; 7] = ["and", "or", "not", "if", "else", "true", "false"];

/// Whether an expression could mean something else by this name.
pub(super) fn is_reserved(name: &str) -> bool {
    WORDS.contains(&name) || function(name).is_some()
}

/// The value of an expression.
///
/// # Errors
/// [`Error::Input`] naming the expression, where it is none, has an unknown name, or a value on the way is no finite number.
pub fn number(expression: &str, variables: &Variables) -> Result<f64> {
    let value = computed(expression, variables).and_then(Value::number);
    value.map_err(|what| fault(expression, variables, &what))
}

/// Whether a condition holds: a comparison, or a number other than zero.
///
/// # Errors
/// As [`number`].
pub fn holds(expression: &str, variables: &Variables) -> Result<bool> {
    let value = computed(expression, variables);
    Ok(value.map_err(|what| fault(expression, variables, &what))?.holds())
}

fn fault(expression: &str, variables: &Variables, what: &str) -> Error {
    let shown: String = expression.chars().take(200).collect();
    Error::Input(format!("expression '{shown}': {what}; the names here are {}", listed(variables.keys())))
}

/// What went wrong, in words.
type Fallible<T> = std::result::Result<T, String>;

#[derive(Clone, Copy, Debug, PartialEq)]
enum Value {
    Number(f64),
    Truth(bool),
}

impl Value {
    fn number(self) -> Fallible<f64> {
        match self {
            Value::Number(v) => Ok(v),
            Value::Truth(v) => Err(format!("is {v}: expected a number")),
        }
    }

    fn holds(self) -> bool {
        match self {
            Value::Number(v) => v != 0.0,
            Value::Truth(v) => v,
        }
    }
}

/// A function of one or two numbers.
enum Function {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
}

fn function(name: &str) -> Option<Function> {
    Some(match name {
        "sqrt" => Function::One(f64::sqrt),
        "cos" => Function::One(f64::cos),
        "sin" => Function::One(f64::sin),
        "exp" => Function::One(f64::exp),
        "round" => Function::One(f64::round),
        "ceil" => Function::One(f64::ceil),
        "steps" => Function::One(steps),
        "min" => Function::Two(f64::min),
        "max" => Function::Two(f64::max),
        _ => return None,
    })
}

/// The smallest number without prime factors but 2 and 5 that is at least `least`; infinite beyond 1e9.
fn steps(least: f64) -> f64 {
    if least > 1e9 {
        return f64::INFINITY;
    }
    let powers = |base: f64| (0..31).map(move |k| base.powi(k));
    let all = powers(5.0).flat_map(|five| powers(2.0).map(move |two| two * five));
    all.filter(|&n| n >= least).fold(f64::INFINITY, f64::min)
}

/// A number that may be the value of what is shown.
fn finite(value: f64, shown: impl FnOnce() -> String) -> Fallible<Value> {
    match value.is_finite() {
        true => Ok(Value::Number(value)),
        false => Err(format!("{} is {value}: expected a finite number", shown())),
    }
}

/// What an operation makes of both sides. The second side of `and` and `or` counts where the first one does not decide.
fn operation(sign: &str, left: Fallible<Value>, right: Fallible<Value>) -> Fallible<Value> {
    if sign == "and" || sign == "or" {
        let first = left?.holds();
        let decided = first == (sign == "or");
        return Ok(Value::Truth(if decided { first } else { right?.holds() }));
    }
    let (a, b) = (left?.number()?, right?.number()?);
    let shown = || format!("{a} {sign} {b}");
    match sign {
        "+" => finite(a + b, shown),
        "-" => finite(a - b, shown),
        "*" => finite(a * b, shown),
        "/" => finite(a / b, shown),
        "**" => finite(a.powf(b), shown),
        "<" => Ok(Value::Truth(a < b)),
        "<=" => Ok(Value::Truth(a <= b)),
        ">" => Ok(Value::Truth(a > b)),
        ">=" => Ok(Value::Truth(a >= b)),
        "==" => Ok(Value::Truth(a == b)),
        _ => Ok(Value::Truth(a != b)),
    }
}

fn applied(name: &str, arguments: Vec<Fallible<Value>>) -> Fallible<Value> {
    let values = arguments.into_iter().map(|v| v?.number()).collect::<Fallible<Vec<f64>>>()?;
    let shown = || format!("{name}({})", listed(&values));
    match (function(name), &values[..]) {
        (Some(Function::One(f)), [x]) => finite(f(*x), shown),
        (Some(Function::Two(f)), [x, y]) => finite(f(*x, *y), shown),
        (Some(_), _) => Err(format!("{}: another number of arguments is expected", shown())),
        (None, _) => Err(format!("there is no function '{name}'")),
    }
}

/// Numbers, names and signs of an expression.
fn tokens(text: &str) -> Fallible<Vec<&str>> {
    let (mut found, mut rest) = (Vec::new(), text.trim_start());
    while let Some(first) = rest.chars().next() {
        let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let length = if first.is_ascii_digit() || first == '.' {
            let bytes = rest.as_bytes();
            let mut end = rest.find(|c: char| !(word(c) || c == '.')).unwrap_or(rest.len());
            // The sign of an exponent
            if matches!(bytes[end - 1], b'e' | b'E') && matches!(bytes.get(end), Some(b'+' | b'-')) {
                let more = rest[end + 1..].find(|c: char| !c.is_ascii_digit());
                end = more.map_or(rest.len(), |n| end + 1 + n);
            }
            end
        } else if word(first) {
            rest.find(|c| !word(c)).unwrap_or(rest.len())
        } else {
            let signs = ["**", "<=", ">=", "==", "!=", "<", ">", "+", "-", "*", "/", "(", ")", ","];
            match signs.iter().find(|s| rest.starts_with(**s)) {
                Some(sign) => sign.len(),
                None => return Err(format!("syntax error at '{first}'")),
            }
        };
        found.push(&rest[..length]);
        rest = rest[length..].trim_start();
    }
    Ok(found)
}

/// Reads an expression and computes it on the way.
struct Reader<'a> {
    tokens: Vec<&'a str>,
    at: usize,
    depth: usize,
    variables: &'a Variables,
}

/// What is read: a value, or what is wrong with it, which counts where the value does.
type Read = Fallible<Fallible<Value>>;

fn computed(text: &str, variables: &Variables) -> Fallible<Value> {
    if text.len() > LONGEST {
        return Err(format!("has {} letters: expected at most {LONGEST}", text.len()));
    }
    let mut reader = Reader { tokens: tokens(text)?, at: 0, depth: 0, variables };
    let found = reader.choice()?;
    match reader.tokens.get(reader.at) {
        None => found,
        Some(token) => Err(format!("syntax error at '{token}'")),
    }
}

/// Operations of two sides that are read from the left, those that bind least first.
const LEVELS: [&[&str]; 5] =
    [&["or"], &["and"], &["<", "<=", ">", ">=", "==", "!="], &["+", "-"], &["*", "/"]];
const COMPARISONS: usize = 2;

impl Reader<'_> {
    fn take(&mut self, token: &str) -> bool {
        let found = self.tokens.get(self.at) == Some(&token);
        self.at += usize::from(found);
        found
    }

    fn expect(&mut self, token: &str) -> Fallible<()> {
        let at = self.tokens.get(self.at).copied().unwrap_or("the end");
        match self.take(token) {
            true => Ok(()),
            false => Err(format!("syntax error at '{at}': expected '{token}'")),
        }
    }

    /// Reads something that is nested one deeper.
    fn deeper<T>(&mut self, read: impl FnOnce(&mut Self) -> Fallible<T>) -> Fallible<T> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return Err(format!("is nested deeper than {DEEPEST}"));
        }
        let found = read(self);
        self.depth -= 1;
        found
    }

    /// `A if C else B`
    fn choice(&mut self) -> Read {
        let yes = self.level(0)?;
        if !self.take("if") {
            return Ok(yes);
        }
        let condition = self.level(0)?;
        self.expect("else")?;
        let no = self.deeper(Self::choice)?;
        Ok(condition.and_then(|c| if c.holds() { yes } else { no }))
    }

    fn level(&mut self, level: usize) -> Read {
        let Some(signs) = LEVELS.get(level) else {
            return self.signed();
        };
        if level == COMPARISONS && self.take("not") {
            let not = self.deeper(|p| p.level(COMPARISONS))?;
            return Ok(not.map(|v| Value::Truth(!v.holds())));
        }
        let mut left = self.level(level + 1)?;
        let mut compared = false;
        while let Some(sign) = signs.iter().find(|sign| self.take(sign)) {
            if level == COMPARISONS && std::mem::replace(&mut compared, true) {
                return Err("compares twice: write A < B and B < C".into());
            }
            left = operation(sign, left, self.level(level + 1)?);
        }
        Ok(left)
    }

    /// A sign binds less than a power.
    fn signed(&mut self) -> Read {
        if self.take("-") {
            let value = self.deeper(Self::signed)?;
            return Ok(value.and_then(Value::number).map(|v| Value::Number(-v)));
        }
        if self.take("+") {
            return self.deeper(Self::signed);
        }
        let base = self.atom()?;
        match self.take("**") {
            true => Ok(operation("**", base, self.deeper(Self::signed)?)),
            false => Ok(base),
        }
    }

    fn atom(&mut self) -> Read {
        if self.take("(") {
            let inner = self.deeper(Self::choice)?;
            self.expect(")")?;
            return Ok(inner);
        }
        let token = self.tokens.get(self.at).copied();
        let token = token.ok_or("syntax error at the end: expected a number or a name")?;
        self.at += 1;
        if token.starts_with(|c: char| c.is_ascii_digit() || c == '.') {
            let number = token.parse().ok().filter(|v: &f64| v.is_finite());
            let number = number.ok_or_else(|| format!("syntax error: '{token}' is no number"))?;
            return Ok(Ok(Value::Number(number)));
        }
        match token {
            "true" | "false" => return Ok(Ok(Value::Truth(token == "true"))),
            word if WORDS.contains(&word)
                || !word.starts_with(|c: char| c == '_' || c.is_ascii_alphabetic()) =>
            {
                return Err(format!("syntax error at '{word}'"));
            }
            _ => {}
        }
        if !self.take("(") {
            let known = self.variables.get(token).ok_or_else(|| format!("there is no '{token}'"));
            return Ok(known.and_then(|&v| finite(v, || token.into())));
        }
        let mut arguments = Vec::new();
        while !self.take(")") {
            if !arguments.is_empty() {
                self.expect(",")?;
            }
            arguments.push(self.deeper(Self::choice)?);
        }
        Ok(applied(token, arguments))
    }
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
        for (expression, value) in [
            ("2/3*u0", 1.0),
            ("-4*u0 + sqrt(9)**2", 3.0),
            ("max(1, 2) if u0 > 1 and nu < 1 else 0", 2.0),
            ("cos(0)", 1.0),
            ("-2**2", -4.0),
            ("2**3**2", 512.0),
            ("2**-1", 0.5),
            ("10 - 4 - 3", 3.0),
            ("16/4/2", 2.0),
            ("2 + 3*4", 14.0),
            ("(2 + 3)*4", 20.0),
            ("1e-3 + 2.5E+1 + .5", 25.501),
            ("1 if not u0 < 1 or u0 == 2 else 1/0", 1.0),
            ("1 if u0 == 1 else 2 if u0 > 1 else 3", 2.0),
            ("- -u0", 1.5),
        ] {
            assert_eq!(at(expression).unwrap(), value, "{expression}");
        }
        assert!(holds("nu", &[("nu".to_string(), 2.0)].into()).unwrap());
        assert!(!holds("1 <= 0.5 or 1 != 1", &Variables::new()).unwrap());
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
        let long = "1+".repeat(30_000) + "1";
        let deep = "(".repeat(100) + "1" + &")".repeat(100);
        for (bad, words) in [
            ("u1 + 1", "the names here are nu, u0"),
            ("1 +", "syntax error"),
            ("1 2", "syntax error at '2'"),
            ("1/0", "1 / 0"),
            ("sqrt(0 - 1)", "finite number"),
            ("max(sqrt(u0 - 5), 0.1)", "sqrt(-3.5) is NaN"),
            ("'text'", "syntax error"),
            ("steps(1e300)", "finite number"),
            ("exp(1000)", "finite number"),
            ("1e400", "no number"),
            ("true + 1", "expected a number"),
            ("1 < 2", "expected a number"),
            ("0 < u0 < 2", "write A < B and B < C"),
            ("sqrt(1, 2)", "number of arguments"),
            ("floor(1)", "no function 'floor'"),
            ("é", "syntax error"),
            (&long, "expected at most 1000"),
            (&deep, "nested deeper"),
        ] {
            m4gn_samples::fails(at(bad), &[words]);
        }
        m4gn_samples::fails(holds("sqrt(0 - 1) < 1", &Variables::new()), &["sqrt(-1) is NaN"]);
    }
}
