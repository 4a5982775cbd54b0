//! Which values the parameters of a campaign's runs have.

use super::table::{Row, Table, check_names};
use crate::generate::parameter::short;
use m4gn_base::{Error, Result, refuse};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Most runs of a campaign: so many Sobol points there are.
const MOST: usize = 1 << 16;

/// How values are chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The i-th run has the i-th value of each list.
    List,
    /// Every value with every other one; of a range, as many values as runs are asked for, both ends among them.
    Grid,
    /// Owen-scrambled Sobol points.
    Sobol,
    /// A Latin hypercube: each parameter has one value in each of as many equal parts of its range as there are runs.
    LatinHypercube,
}

/// The values that a parameter may have.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Between these.
    Range([f64; 2]),
    /// These.
    List(Vec<String>),
}

/// A parameter of a campaign that is to be made.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Its name in the case, without the `$`.
    pub name: String,
    /// What it may be.
    pub values: Values,
}

impl std::str::FromStr for Parameter {
    type Err = Error;

    /// `NAME=LOW:HIGH` or `NAME=VALUE,VALUE,...`
    fn from_str(text: &str) -> Result<Self> {
        let wrong = || {
            Error::Input(format!(
                "'{text}': expected NAME=LOW:HIGH with the lower number first, or NAME=VALUE,VALUE,... of numbers or words; of a vector \
                 each component is a parameter"
            ))
        };
        let (name, values) = text.split_once('=').ok_or_else(wrong)?;
        let number = |t: &str| super::table::number(t.trim()).ok_or_else(wrong);
        let values = match values.split_once(':') {
            Some((low, high)) => Values::Range([number(low)?, number(high)?]),
            None => {
                let value = |text: &str| super::table::value(text.trim()).ok_or_else(wrong);
                Values::List(values.split(',').map(value).collect::<Result<_>>()?)
            }
        };
        let empty = matches!(&values, Values::Range([low, high]) if low >= high);
        refuse(empty, |_| wrong(), || "")?;
        Ok(Parameter { name: name.trim().to_string(), values })
    }
}

/// The runs of a campaign. No method: a grid of lists, Sobol points where there is a range. `count`: runs, or values of a range in a grid.
///
/// # Errors
/// [`Error::Input`] that says what does not go together.
pub fn sample(parameters: &[Parameter], method: Option<Method>, count: usize, seed: u64) -> Result<Table> {
    let names: Vec<String> = parameters.iter().map(|p| p.name.clone()).collect();
    check_names(&names).map_err(Error::Input)?;
    let ranges = parameters.iter().any(|p| matches!(p.values, Values::Range(_)));
    let method = method.unwrap_or(if ranges { Method::Sobol } else { Method::Grid });
    refuse(count == 0 || count > MOST, Error::Input, || format!("{count} runs: expected 1 to {MOST}"))?;
    let dimensions = parameters.len();
    let runs = match method {
        Method::List => listed(parameters)?,
        Method::Grid => grid(parameters, count)?,
        Method::Sobol => {
            refuse(dimensions > sobol_burley::NUM_DIMENSIONS as usize, Error::Input, || {
                format!("{dimensions} parameters: Sobol points have at most {}", sobol_burley::NUM_DIMENSIONS)
            })?;
            let point = |i: u32| {
                (0..dimensions as u32).map(|d| f64::from(sobol_burley::sample(i, d, seed as u32))).collect()
            };
            placed(parameters, (0..count as u32).map(point).collect())
        }
        Method::LatinHypercube => placed(parameters, latin_hypercube(dimensions, count, seed)),
    };
    let width = runs.len().to_string().len().max(2);
    let name = |i: usize| format!("r{:0width$}", i + 1);
    let rows = runs.into_iter().enumerate().map(|(i, values)| Row { name: name(i), values }).collect();
    Ok(Table { parameters: names, rows })
}

fn listed(parameters: &[Parameter]) -> Result<Vec<Vec<String>>> {
    let mut lists = Vec::new();
    for p in parameters {
        match &p.values {
            Values::List(values) => lists.push(values),
            Values::Range(_) => {
                return Err(Error::Input(format!(
                    "parameter {}: expected a list of values for sampling list, found a range",
                    p.name
                )));
            }
        }
    }
    let count = lists.first().map_or(0, |l| l.len());
    refuse(count == 0 || lists.iter().any(|l| l.len() != count), Error::Input, || {
        format!(
            "sampling list: expected as many values of each parameter, found {:?}",
            lists.iter().map(|l| l.len()).collect::<Vec<_>>()
        )
    })?;
    Ok((0..count).map(|i| lists.iter().map(|l| l[i].clone()).collect()).collect())
}

fn grid(parameters: &[Parameter], count: usize) -> Result<Vec<Vec<String>>> {
    let mut runs: Vec<Vec<String>> = vec![Vec::new()];
    for p in parameters {
        let values: Vec<String> = match &p.values {
            Values::List(values) => values.clone(),
            Values::Range([low, high]) => {
                let last = (count - 1).max(1) as f64;
                (0..count).map(|i| within([*low, *high], i as f64 / last)).collect()
            }
        };
        refuse(runs.len() * values.len() > MOST, Error::Input, || {
            format!("the grid has more than {MOST} runs")
        })?;
        runs = runs
            .iter()
            .flat_map(|run| values.iter().map(move |v| [&run[..], std::slice::from_ref(v)].concat()))
            .collect();
    }
    Ok(runs)
}

/// The value at a place of a range, from 0 to 1.
fn within(range @ [low, high]: [f64; 2], place: f64) -> String {
    let text = short(low + (high - low) * place, range).to_string();
    super::table::value(&text).unwrap_or(text)
}

/// Points of the unit cube as values.
fn placed(parameters: &[Parameter], points: Vec<Vec<f64>>) -> Vec<Vec<String>> {
    let value = |(p, x): (&Parameter, &f64)| match &p.values {
        Values::Range([low, high]) => within([*low, *high], *x),
        Values::List(values) => values[((x * values.len() as f64) as usize).min(values.len() - 1)].clone(),
    };
    points.iter().map(|point| parameters.iter().zip(point).map(value).collect()).collect()
}

fn latin_hypercube(dimensions: usize, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut points = vec![Vec::new(); count];
    for _ in 0..dimensions {
        let mut parts: Vec<usize> = (0..count).collect();
        parts.shuffle(&mut random);
        for (point, part) in points.iter_mut().zip(parts) {
            point.push((part as f64 + random.random_range(0.0..1.0)) / count as f64);
        }
    }
    points
}

/// The rows that are also made cold and plain: a share of all, one in each of as many equal parts of the table; one at least of a share above 0.
///
/// Its place in its part goes on by the golden ratio, from the middle of the first: at the same place in each, all of a grid would have one value of
/// a parameter.
pub fn held_out(rows: usize, share: f64) -> Vec<usize> {
    let count = if share > 0.0 { ((share * rows as f64).round() as usize).clamp(1, rows) } else { 0 };
    let row = |i: usize| {
        let (first, next) = (i * rows / count, (i + 1) * rows / count);
        let place = (0.5 + i as f64 * 0.618_033_988_749_895).fract();
        first + (place * (next - first) as f64) as usize
    };
    (0..count).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    fn parameters(texts: &[&str]) -> Vec<Parameter> {
        texts.iter().map(|t| t.parse().unwrap()).collect()
    }

    fn values(texts: &[&str], method: Option<Method>, count: usize) -> Vec<Vec<String>> {
        sample(&parameters(texts), method, count, 1).unwrap().rows.into_iter().map(|r| r.values).collect()
    }

    #[test]
    fn lists_and_grids() {
        assert_eq!(values(&["a=1,2", "b=x,y"], None, 9), [["1", "x"], ["1", "y"], ["2", "x"], ["2", "y"]]);
        assert_eq!(values(&["a=1,2", "b=x,y"], Some(Method::List), 9), [["1", "x"], ["2", "y"]]);
        assert_eq!(values(&["a=0:1"], Some(Method::Grid), 3), [["0"], ["0.5"], ["1"]]);
        let narrow = values(&["a=101325:101325.02"], Some(Method::Grid), 3);
        assert_eq!(narrow, [["101325"], ["101325.01"], ["101325.02"]]);
        fails(sample(&parameters(&["a=1,2", "b=x"]), Some(Method::List), 9, 1), &["found [2, 1]"]);
        for (text, expected) in [
            ("a=2:1", "lower number first"),
            ("a", "NAME=LOW:HIGH"),
            ("a=1,,2", "NAME=VALUE"),
            ("a=x:y", "NAME=LOW"),
            ("a=(1 0 0)", "of a vector each component is a parameter"),
            ("a=1,nan", "of numbers or words"),
        ] {
            fails(text.parse::<Parameter>(), &[expected]);
        }
    }

    /// Of eight points each parameter has one in each eighth of its range: of a Latin hypercube, and of Sobol points as well.
    #[test]
    fn points_fill_their_ranges_evenly_and_are_the_same_again() {
        for method in [Method::Sobol, Method::LatinHypercube] {
            let of = || values(&["a=1:2", "b=-1:1", "m=u,v"], Some(method), 8);
            let points = of();
            assert_eq!(points, of());
            for (c, low, high) in [(0, 1.0, 2.0), (1, -1.0, 1.0)] {
                let mut parts: Vec<usize> = points
                    .iter()
                    .map(|p| (8.0 * (p[c].parse::<f64>().unwrap() - low) / (high - low)) as usize)
                    .collect();
                parts.sort();
                assert_eq!(parts, [0, 1, 2, 3, 4, 5, 6, 7], "{method:?} {c}: {points:?}");
            }
            assert_eq!(points.iter().filter(|p| p[2] == "u").count(), 4, "{method:?}: {points:?}");
        }
    }

    #[test]
    fn one_run_in_ten_is_held_out() {
        assert_eq!(held_out(30, 0.1), [5, 11, 27]);
        // Of a grid of ten by ten nine values of the second parameter
        let columns: std::collections::BTreeSet<usize> =
            held_out(100, 0.1).into_iter().map(|row| row % 10).collect();
        assert_eq!(columns.len(), 9);
        let all: Vec<usize> = (0..17).collect();
        assert_eq!(held_out(17, 1.0), all);
        assert_eq!((held_out(3, 0.1), held_out(3, 0.0).len(), held_out(2, 1.0)), (vec![1], 0, vec![0, 1]));
    }
}
