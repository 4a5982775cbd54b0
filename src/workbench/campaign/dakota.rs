//! A run for Dakota: values from its parameters file, figures into its results file.
//!
//! The formats are those of Dakota's User's Manual: "Parameters file format (standard)" and "(APREPRO)", "The Active Set Vector", "Results file
//! data format", and the keyword `failure_capture`.

use super::settings::{Quantity, Settings};
use super::table::{self, Table};
use super::{Campaign, Outcome, one};
use crate::generate::parameter::shortened;
use crate::generate::process::Surroundings;
use m4gn_base::{Error, Result, files, lock};
use std::path::Path;

/// The blocks of a parameters file, in the standard format and in APREPRO's.
const BLOCKS: [[&str; 2]; 5] = [
    ["variables", "DAKOTA_VARS"],
    ["functions", "DAKOTA_FNS"],
    ["derivative_variables", "DAKOTA_DER_VARS"],
    ["analysis_components", "DAKOTA_AN_COMPS"],
    ["metadata", "DAKOTA_METADATA"],
];
/// The line that is no block.
const EVALUATION: [&str; 2] = ["eval_id", "DAKOTA_EVAL_ID"];

/// What a parameters file asks for.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Descriptors and values of the variables.
    pub variables: Vec<(String, String)>,
    /// Descriptors of the responses whose values are asked for, in order; none: the file has no active set vector.
    pub responses: Option<Vec<String>>,
}

struct Line<'a> {
    number: usize,
    tag: &'a str,
    value: &'a str,
}

impl Request {
    /// Reads a parameters file.
    ///
    /// # Errors
    /// [`Error::File`] with the line; for several evaluations in a file, and for derivatives and metadata, which a run does not give.
    pub fn read(path: &Path) -> Result<Self> {
        let text = files::read_text(path).map_err(Error::cannot("read", path))?;
        Request::parse(&text).map_err(|message| Error::file(path, message))
    }

    fn parse(text: &str) -> std::result::Result<Self, String> {
        let texts = text.lines().enumerate().map(|(i, t)| (i + 1, t.trim())).filter(|(_, t)| !t.is_empty());
        let format = usize::from(text.trim_start().starts_with('{'));
        let mut lines = texts.map(|(number, text)| line(number, text, format));
        let mut blocks: [Option<Vec<Line>>; 5] = Default::default();
        while let Some(head) = lines.next().transpose()? {
            let Line { number, tag, value } = head;
            if tag == EVALUATION[format] {
                continue;
            }
            let expected = || BLOCKS.map(|b| b[format]).join(", ");
            let Some(block) = BLOCKS.iter().position(|b| b[format] == tag) else {
                return Err(format!(
                    "line {number}: expected a number of {} or {}, found '{}'",
                    expected(),
                    EVALUATION[format],
                    shortened(tag)
                ));
            };
            let count: usize = value.parse().map_err(|_| {
                format!("line {number}: expected a whole number before {tag}, found '{}'", shortened(value))
            })?;
            let items = lines.by_ref().take(count).collect::<std::result::Result<Vec<Line>, String>>()?;
            if items.len() < count {
                return Err(format!("line {number}: expected {count} lines of {tag}, found {}", items.len()));
            }
            if blocks[block].replace(items).is_some() {
                return Err(format!(
                    "line {number}: expected one evaluation, found a second one: take the keyword batch out of Dakota's interface"
                ));
            }
        }
        let [variables, functions, _, _, metadata] = blocks;
        let Some(variables) = variables else {
            return Err(format!(
                "expected Dakota's parameters, a line '2 {}' or '{{ {} = 2 }}' and those behind it, found none",
                BLOCKS[0][0], BLOCKS[0][1]
            ));
        };
        if let Some(first) = metadata.iter().flatten().next() {
            return Err(format!("line {}: asks for metadata: expected none", first.number));
        }
        let variables = variables.iter().map(|l| (l.tag.to_string(), l.value.to_string())).collect();
        let responses = functions.map(|all| all.iter().filter_map(|l| response(l).transpose()).collect());
        Ok(Request { variables, responses: responses.transpose()? })
    }

    /// The values of a campaign's parameters, in the order of its table.
    ///
    /// # Errors
    /// What is missing, or is not a parameter, or has no value.
    pub fn values(&self, table: &Table) -> std::result::Result<Vec<String>, String> {
        let all = table.parameters.join(", ");
        if let Some((name, _)) = self.variables.iter().find(|(name, _)| !table.parameters.contains(name)) {
            return Err(format!("variable '{}': expected the campaign's parameters, {all}", shortened(name)));
        }
        let value = |parameter: &String| {
            let mut found = self.variables.iter().filter(|(name, _)| name == parameter);
            match (found.next(), found.next()) {
                (Some((_, value)), None) => table::value(value).ok_or_else(|| {
                    format!(
                        "variable {parameter}: expected a number or a word of OpenFOAM, found '{}'",
                        shortened(value)
                    )
                }),
                (None, _) => {
                    Err(format!("expected a variable {parameter}, found none: the campaign's are {all}"))
                }
                _ => Err(format!("variable {parameter}: expected it once")),
            }
        };
        table.parameters.iter().map(value).collect()
    }

    /// The figures that are asked for, in order: all where the file has no active set vector.
    ///
    /// # Errors
    /// A response that is none of the campaign's quantities.
    fn figures(&self, quantities: &[Quantity]) -> std::result::Result<Vec<String>, String> {
        let all: Vec<String> = quantities.iter().map(|q| q.name.clone()).collect();
        let asked = self.responses.clone().unwrap_or_else(|| all.clone());
        match asked.iter().find(|name| !all.contains(name)) {
            None => Ok(asked),
            Some(name) => {
                let all = all.join(", ");
                Err(format!("response '{}': expected a [[quantity]] of the campaign, {all}", shortened(name)))
            }
        }
    }
}

/// `value tag`, or `{ tag = value }`.
fn line(number: usize, text: &str, format: usize) -> std::result::Result<Line<'_>, String> {
    let unquoted = |v: &'_ str| v.len() >= 2 && v.starts_with('"') && v.ends_with('"');
    let found = match format {
        0 => text.rsplit_once(char::is_whitespace).map(|(value, tag)| (tag, value.trim())),
        _ => text
            .strip_prefix('{')
            .and_then(|t| t.strip_suffix('}')?.split_once('='))
            .map(|(tag, value)| (tag.trim(), value.trim()))
            .map(|(tag, v)| (tag, if unquoted(v) { &v[1..v.len() - 1] } else { v })),
    };
    let (tag, value) = found.ok_or_else(|| {
        let expected = ["'value descriptor'", "'{ descriptor = value }'"][format];
        format!("line {number}: expected {expected}, found '{}'", shortened(text))
    })?;
    Ok(Line { number, tag, value })
}

/// The descriptor of `ASV_1:descriptor`, if its value is asked for.
fn response(line: &Line) -> std::result::Result<Option<String>, String> {
    let Line { number, tag, value } = line;
    let (Some(("ASV", name)), Ok(set)) = (
        tag.split_once(':').map(|(asv, name)| (asv.split('_').next().unwrap_or(""), name)),
        value.parse::<u8>(),
    ) else {
        return Err(format!(
            "line {number}: expected a number and ASV_i:descriptor, found '{}'",
            shortened(tag)
        ));
    };
    match set {
        0 => Ok(None),
        1 => Ok(Some(name.to_string())),
        _ => Err(format!(
            "line {number}: asks for {set} of '{}': expected 0 or 1, as a run gives no derivatives: have no_gradients or numerical_gradients, and \
             no_hessians, in Dakota's responses",
            shortened(name)
        )),
    }
}

/// Makes the run of a parameters file, unless it is there, and writes the results file: figures, or the word `fail` and why. Returns the run's name.
///
/// The run is the row of the table that has these values, or one that is appended.
///
/// # Errors
/// As [`Request::read`], [`Campaign::open`] and [`one`]; where the results cannot be written. Nothing is written when the user stops, so that
/// Dakota does not take it for a failure of the run.
pub fn evaluate(
    (folder, parameters, results): (&Path, &Path, &Path),
    anew: bool,
    tools: &mut Surroundings,
    say: &mut dyn FnMut(&str),
) -> Result<(String, Outcome)> {
    let _claimed = lock::outputs([results], [parameters])?;
    let made = make(folder, parameters, anew, tools, say);
    let text = match &made {
        Ok((_, _, text)) => text.clone(),
        Err(Error::Interrupted(e)) => return Err(Error::Interrupted(e.clone())),
        Err(e) => format!("fail\n{e}\n"),
    };
    let written = files::write_whole(results, text.as_bytes());
    let (name, outcome, _) = made?;
    written.map(|()| (name, outcome))
}

fn make(
    folder: &Path,
    parameters: &Path,
    anew: bool,
    tools: &mut Surroundings,
    say: &mut dyn FnMut(&str),
) -> Result<(String, Outcome, String)> {
    let wrong = |message: String| Error::file(parameters, message);
    let request = Request::read(parameters)?;
    let asked = request.figures(&Settings::read(folder)?.quantity).map_err(wrong)?;
    let values = request.values(&Table::read(folder)?).map_err(wrong)?;
    let name = {
        let _turn = tools.take_turn(folder, say)?;
        table::with_row(folder, values)?
    };
    let campaign = Campaign::open(folder, tools)?;
    let outcome = one(&campaign, campaign.unit(&name, false)?, anew, tools, say)?;
    let figures = asked.iter().filter_map(|q| Some((q, outcome.record.quantities.get(q)?.value)));
    let text = figures.map(|(name, value)| format!("{value:.16E} {name}\n")).collect();
    Ok((name, outcome, text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::campaign::table::Row;
    use m4gn_samples::fails;

    /// As Dakota 6.16 and newer write them; older ones have no metadata.
    const STANDARD: &str = "                                          3 variables
                      1.500000000000000e+00 Uin
                                         20 n
                                  kOmegaSST model
                                          3 functions
                                          1 ASV_1:Cl_rms
                                          0 ASV_2:Cd
                                          1 ASV_3:speed
                                          2 derivative_variables
                                          1 DVV_1:Uin
                                          2 DVV_2:n
                                          1 analysis_components
                                        a b AC_1:m4gn
                                      2:7:1 eval_id
                                          0 metadata
";
    const APREPRO: &str = "                    { DAKOTA_VARS     =                      3 }
                    { Uin             =  1.500000000000000e+00 }
                    { n               =                     20 }
                    { model           =            \"kOmegaSST\" }
                    { DAKOTA_FNS      =                      3 }
                    { ASV_1:Cl_rms    =                      1 }
                    { ASV_2:Cd        =                      0 }
                    { ASV_3:speed     =                      1 }
                    { DAKOTA_DER_VARS =                      2 }
                    { DVV_1:Uin       =                      1 }
                    { DVV_2:n         =                      2 }
                    { DAKOTA_AN_COMPS =                      1 }
                    { AC_1:m4gn       =                  \"a b\" }
                    { DAKOTA_EVAL_ID  =                  2:7:1 }
";

    fn table() -> Table {
        let parameters = ["model", "Uin", "n"].map(String::from).to_vec();
        let values = ["kEpsilon", "1.5", "20"].map(String::from).to_vec();
        Table { parameters, rows: vec![Row { name: "r01".into(), values }] }
    }

    #[test]
    fn both_formats_ask_for_the_same() {
        let of = |text: &str| Request::parse(text).unwrap();
        let standard = of(STANDARD);
        assert_eq!(of(APREPRO), standard);
        assert_eq!(standard.responses.as_deref(), Some(&["Cl_rms".to_string(), "speed".to_string()][..]));
        assert_eq!(standard.values(&table()).unwrap(), ["kOmegaSST", "1.5", "20"]);
        let quantity = |name: &str| Quantity { name: name.into(), ..Quantity::default() };
        let quantities = ["Cd", "speed", "Cl_rms"].map(quantity);
        assert_eq!(standard.figures(&quantities).unwrap(), ["Cl_rms", "speed"]);
        let short = of("1 variables\n2 Uin\n");
        assert_eq!(short.figures(&quantities).unwrap(), ["Cd", "speed", "Cl_rms"]);
        fails(
            standard.figures(&quantities[..2]),
            &["response 'Cl_rms': expected a [[quantity]] of the campaign, Cd, speed"],
        );
    }

    #[test]
    fn what_cannot_be_given_is_told() {
        for (from, to, expected) in [
            ("1 ASV_1", "3 ASV_1", "line 6: asks for 3 of 'Cl_rms': expected 0 or 1"),
            ("1 ASV_1", "x ASV_1", "line 6: expected a number and ASV_i:descriptor"),
            ("0 metadata", "1 metadata\n seconds MD_1", "line 16: asks for metadata"),
            ("0 metadata", "3 variables\n1 a\n2 b\n3 c", "line 15: expected one evaluation"),
            ("0 metadata", "9999999999 metadata", "line 15: expected 9999999999 lines of metadata, found 0"),
            ("3 functions", "-1 functions", "line 5: expected a whole number before functions, found '-1'"),
            ("3 functions", "2 functions", "line 8: expected a number of variables, functions"),
            ("3 variables", "variables", "line 1: expected 'value descriptor', found 'variables'"),
        ] {
            assert!(STANDARD.contains(from), "{from}");
            fails(Request::parse(&STANDARD.replacen(from, to, 1)), &[expected]);
        }
        for (text, expected) in [
            ("", "'2 variables' or '{ DAKOTA_VARS = 2 }'"),
            ("{\n \"variables\": [] }", "line 1: expected '{ descriptor = value }', found '{'"),
        ] {
            fails(Request::parse(text), &[expected]);
        }
        for (from, to, expected) in [
            ("Uin\n ", "U\n ", "variable 'U': expected the campaign's parameters, model, Uin, n"),
            ("20 n\n", "20 Uin\n", "variable Uin: expected it once"),
            ("kOmegaSST model\n", "20 n\n", "expected a variable model, found none"),
            (
                "1.500000000000000e+00",
                "nan",
                "variable Uin: expected a number or a word of OpenFOAM, found 'nan'",
            ),
            (
                "kOmegaSST",
                "a b; c",
                "variable model: expected a number or a word of OpenFOAM, found 'a b; c'",
            ),
        ] {
            assert!(STANDARD.contains(from), "{from}");
            let message =
                Request::parse(&STANDARD.replacen(from, to, 1)).unwrap().values(&table()).unwrap_err();
            assert!(message.contains(expected), "{to}: {message}");
        }
    }
}
