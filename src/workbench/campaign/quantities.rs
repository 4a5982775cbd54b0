//! The quantities that a case's function objects suggest, as text of `campaign.toml`.

use super::settings::{Quantity, Statistic};
use m4gn_base::{Error, Result};

/// What `controlDict` says, by paths as `functions/forces/type`.
pub struct Entries<'a> {
    /// Value of an entry; none: it has none.
    pub value: &'a dyn Fn(&str) -> Option<String>,
    /// Names of the entries of a dictionary.
    pub keywords: &'a dyn Fn(&str) -> Vec<String>,
}

/// Quantities as text, and whether any is known well enough to be asked for: those of the case's own m4gnAverages, else the coefficients of a
/// `forceCoeffs`. Of others there are comments. `functions`: names and types of the function objects.
///
/// # Errors
/// [`Error::Input`] for a quantity of m4gnAverages that campaigns cannot have.
pub fn quantities(functions: &[(String, String)], entries: &Entries) -> Result<(String, bool)> {
    let own = functions.iter().filter(|(_, kind)| kind == "m4gnAverages");
    let own: Vec<Quantity> = own
        .map(|(name, _)| of_averages(name, entries))
        .collect::<Result<Vec<_>>>()?
        .into_iter()
        .flatten()
        .collect();
    if !own.is_empty() {
        return Ok((own.iter().map(|q| text(q, "")).collect::<Result<_>>()?, true));
    }
    // Function objects have names with dots and brackets, which those of quantities have not
    let mean = |name: &str, object: &str, result: &str| Quantity {
        name: name.replace(|c: char| !c.is_ascii_alphanumeric() && !"_-".contains(c), "_"),
        function_object: object.into(),
        result: result.into(),
        relative: Some(0.01),
        ..Quantity::default()
    };
    let (mut all, mut known) = (String::new(), false);
    for (object, kind) in functions {
        match kind.as_str() {
            "forceCoeffs" if !known => {
                let lift = Quantity {
                    statistic: Statistic::Rms,
                    relative: Some(0.02),
                    ..mean("Cl_rms", object, "Cl")
                };
                all += &(text(&mean("Cd", object, "Cd"), "")? + &text(&lift, "")?);
                known = true;
            }
            "forceCoeffs" => all += &text(&mean(&format!("Cd_{object}"), object, "Cd"), "# ")?,
            "surfaceFieldValue" | "volFieldValue" => {
                let found = of_field_value(object, entries).unwrap_or("OPERATION(REGION,FIELD)".into());
                all += &text(&mean(object, object, &found), "# ")?;
            }
            _ => {}
        }
    }
    if all.is_empty() {
        all = text(&mean("Cd", "forces", "Cd"), "# ")?;
    }
    Ok((all, known))
}

/// The largest value that an entry has in the case's own m4gnAverages, which have the usual one without it.
pub fn largest(functions: &[(String, String)], entries: &Entries, name: &str, usual: f64) -> f64 {
    let own = functions.iter().filter(|(_, kind)| kind == "m4gnAverages");
    let value = |object: &str| (entries.value)(&format!("functions/{object}/{name}"))?.parse::<f64>().ok();
    own.map(|(object, _)| value(object).unwrap_or(usual)).max_by(f64::total_cmp).unwrap_or(usual)
}

/// What the function object m4gnAverages of this name asks for.
fn of_averages(object: &str, entries: &Entries) -> Result<Vec<Quantity>> {
    let all = format!("functions/{object}/quantities");
    let one = |name: &String| {
        let of = |entry: &str| (entries.value)(&format!("{all}/{name}/{entry}"));
        let number = |entry: &str| of(entry).and_then(|text| text.parse().ok());
        let statistic = match of("statistic").as_deref() {
            None | Some("mean") => Statistic::Mean,
            Some("rms") => Statistic::Rms,
            Some(other) => {
                return Err(Error::Input(format!(
                    "{all}/{name}: its statistic is {other}: expected mean or rms, which a campaign can ask for"
                )));
            }
        };
        Ok(Quantity {
            name: name.clone(),
            function_object: of("functionObject").unwrap_or_default(),
            result: of("result").unwrap_or_default(),
            component: of("component"),
            statistic,
            tolerance: number("tolerance"),
            relative: number("relative"),
        })
    };
    (entries.keywords)(&all).iter().map(one).collect()
}

/// The name of the first result of a `volFieldValue` or `surfaceFieldValue`.
fn of_field_value(object: &str, entries: &Entries) -> Option<String> {
    let of = |name: &str| (entries.value)(&format!("functions/{object}/{name}"));
    let (operation, fields) = (of("operation")?, of("fields")?);
    let first = fields.split_once('(')?.1.rsplit_once(')')?.0.split_whitespace().next()?.to_string();
    match of("regionType")?.as_str() {
        "all" => Some(format!("{operation}({first})")),
        _ => Some(format!("{operation}({},{first})", of("name")?)),
    }
}

/// A quantity as a table of `campaign.toml`, each line behind `mark`.
fn text(quantity: &Quantity, mark: &str) -> Result<String> {
    let entries = toml::to_string(quantity).map_err(|e| Error::Internal(e.to_string()))?;
    let lines = ["[[quantity]]"].into_iter().chain(entries.lines());
    Ok(lines.map(|line| format!("{mark}{line}\n")).collect::<String>() + "\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// The quantities that are read again from what is written, whether any is known, and the text.
    fn of(functions: &[(&str, &str)], dictionary: &[(&str, &str)]) -> (Vec<Quantity>, bool, String) {
        #[derive(serde::Deserialize)]
        struct Read {
            #[serde(default)]
            quantity: Vec<Quantity>,
        }
        let functions: Vec<_> = functions.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
        let values: BTreeMap<String, String> =
            dictionary.iter().map(|(a, b)| (format!("functions/{a}"), b.to_string())).collect();
        let keywords = |path: &str| {
            let below =
                values.keys().filter_map(|k| k.strip_prefix(path)?.strip_prefix('/')?.split('/').next());
            let mut below: Vec<String> = below.map(str::to_string).collect();
            below.dedup();
            below
        };
        let entries = Entries { value: &|path| values.get(path).cloned(), keywords: &keywords };
        let (text, known) = quantities(&functions, &entries).unwrap();
        (toml::from_str::<Read>(&text).unwrap().quantity, known, text)
    }

    #[test]
    fn what_ends_a_run_is_that_of_the_case() {
        let [means, later, forces] =
            [("means", "m4gnAverages"), ("later", "m4gnAverages"), ("forces", "forceCoeffs")]
                .map(|(a, b)| (a.to_string(), b.to_string()));
        let value = |path: &str| {
            let times = [("means", "5"), ("later", "40"), ("forces", "60")];
            let found = times.iter().find(|(name, _)| path == format!("functions/{name}/minTime"));
            found.map(|(_, time)| time.to_string())
        };
        let entries = Entries { value: &value, keywords: &|_| Vec::new() };
        let all = [means, later, forces];
        assert_eq!(largest(&all, &entries, "minTime", 0.0), 40.0);
        assert_eq!(largest(&[], &entries, "minTime", 0.0), 0.0);
        assert_eq!(largest(&all, &entries, "confidence", 0.95), 0.95);
    }

    #[test]
    fn what_a_case_averages_is_what_its_campaign_asks_for() {
        let (found, known, _) = of(
            &[("forces", "forceCoeffs"), ("means", "m4gnAverages")],
            &[
                ("means/quantities/V/functionObject", "blockage"),
                ("means/quantities/V/result", "volAverage(zone,U)"),
                ("means/quantities/V/component", "y"),
                ("means/quantities/V/statistic", "rms"),
                ("means/quantities/V/relative", "0.02"),
            ],
        );
        assert!(known && found.len() == 1, "{found:?}");
        assert_eq!((found[0].name.as_str(), found[0].component.as_deref()), ("V", Some("y")));
        assert_eq!(
            (found[0].statistic, found[0].relative, found[0].tolerance),
            (Statistic::Rms, Some(0.02), None)
        );
    }

    #[test]
    fn coefficients_are_asked_for_and_other_results_are_named() {
        let (found, known, _) = of(&[("forces", "forceCoeffs"), ("probes", "probes")], &[]);
        assert_eq!((found.len(), known), (2, true));
        let zone =
            [("mean/operation", "volAverage"), ("mean/fields", "2 ( T U )"), ("mean/regionType", "all")];
        let (found, known, text) = of(&[("mean", "volFieldValue")], &zone);
        assert!(found.is_empty() && !known && text.contains("# result = \"volAverage(T)\""), "{text}");
        let patch =
            [("q/operation", "sum"), ("q/fields", "(phi)"), ("q/regionType", "patch"), ("q/name", "outlet")];
        let text = of(&[("q", "surfaceFieldValue")], &patch).2;
        assert!(text.contains("# result = \"sum(outlet,phi)\""), "{text}");
        let text = of(&[("out.1(a=b)", "surfaceFieldValue")], &[]).2;
        assert!(text.contains("# name = \"out_1_a_b_\"\n# function_object = \"out.1(a=b)\""), "{text}");
        assert!(of(&[], &[]).2.contains("# [[quantity]]"));
    }
}
