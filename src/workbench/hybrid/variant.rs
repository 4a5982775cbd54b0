//! What is run of a draw beside the full solver.

use crate::generate::family::{Family, Hybrid};
use crate::generate::parameter::{Settings, is_word, parse_setting};
use m4gn_base::{Error, Result, files};
use std::path::Path;

/// Name of the full run.
pub const FULL: &str = "full";
/// A network with the family's own schedule.
pub(super) const NETWORK: &str = "network";
/// What is run: name, surrogates, entries of the function object beside the usual ones, and the plain solver of the family whose settings
/// the solver has in it.
const HYBRIDS: [(&str, &str, &str, Option<&str>); 4] = [
    ("hybrid", NETWORK, "", None),
    ("dmd", "dmd", "", None),
    ("network-dmd", "network dmd", "control { tolerance 0.1; }", None),
    ("dmd-loose", "dmd", "", Some("loose")),
];

/// One way to run a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// Name: of its folder, in tables and figures.
    pub name: String,
    /// What is different from the full run.
    pub kind: Kind,
}

/// What is different from the full run.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// The solver and surrogates by turns.
    Hybrid {
        /// Those of the function object's entry `surrogates`.
        surrogates: &'static str,
        /// Entries that replace or join those of the function object.
        entries: String,
        /// Parameters of the case that are other ones.
        settings: Settings,
    },
    /// The solver alone with other settings.
    Plain(Settings),
}

impl Kind {
    /// Parameters of the case that are other ones than the full run's.
    pub fn settings(&self) -> &Settings {
        match self {
            Kind::Hybrid { settings, .. } | Kind::Plain(settings) => settings,
        }
    }
}

/// The hybrids with the family's schedule, those of a network where there is a model, those of a dmd surrogate where the family is of flows; then the variants `NAME=FILE` or `NAME=FILE,PARAMETER=VALUE,...`, whose file has
/// entries for the function object, and the plain solvers: those of the family, or, where any are given, these: `NAME` of the
/// family's, or `NAME=PARAMETER=VALUE,...`. The hybrids have the family's `hybrid_set`.
///
/// # Errors
/// [`Error::Input`] for a name that is none or occurs twice, or for settings that cannot be; [`Error::File`] for a file that
/// cannot be read.
pub fn variants(
    family: &Family,
    schedule: &Hybrid,
    (model, answers): (bool, bool),
    hybrids: &[String],
    plain: &[String],
) -> Result<Vec<Variant>> {
    let hybrid = |name: &str, surrogates, entries: &str, settings| Variant {
        name: name.into(),
        kind: Kind::Hybrid { surrogates, entries: entries.into(), settings },
    };
    let known = |name: &str| schedule.plain.iter().find(|p| p.name == name);
    let flows = family.recording.fields.iter().any(|f| f == "U");
    let mut all = Vec::new();
    if answers {
        all.push(Variant { name: "plain".into(), kind: Kind::Plain(Settings::default()) });
    }
    for (name, surrogates, entries, plain) in HYBRIDS {
        let has = |kind| surrogates.split(' ').any(|s| s == kind);
        if has(NETWORK) && !model || has("dmd") && !flows {
            continue;
        }
        let mut settings = schedule.hybrid_set.clone();
        match plain.map(known) {
            Some(Some(plain)) => settings.extend(plain.set.clone()),
            Some(None) => continue,
            None => {}
        }
        all.push(hybrid(name, surrogates, entries, settings));
    }
    for text in hybrids {
        let (name, rest) = text.split_once('=').ok_or_else(|| {
            Error::Input(format!("--variant {text}: expected NAME=FILE or NAME=FILE,PARAMETER=VALUE,..."))
        })?;
        let mut parts = rest.split(',');
        let file = parts.next().unwrap_or_default();
        let mut settings = schedule.hybrid_set.clone();
        for part in parts {
            let (parameter, value) = parse_setting(part)?;
            settings.insert(parameter, value);
        }
        family.check_settings(&settings)?;
        let entries = files::read_text(file).map_err(Error::cannot("read", Path::new(file)))?;
        all.push(hybrid(name, if model { NETWORK } else { "dmd" }, &entries, settings));
    }
    let own = schedule.plain.iter().map(|p| p.name.clone()).collect::<Vec<_>>();
    for text in if plain.is_empty() { &own } else { plain } {
        if text == "none" {
            continue;
        }
        let (name, settings) = match (text.split_once('='), known(text)) {
            (Some((name, settings)), _) => {
                let all = settings.split(',').map(parse_setting);
                (name.to_string(), all.collect::<Result<Settings>>()?)
            }
            (None, Some(plain)) => (plain.name.clone(), plain.set.clone()),
            (None, None) => {
                return Err(Error::Input(format!(
                    "--baseline {text}: expected NAME=PARAMETER=VALUE,..., none, or one of the family's: {}",
                    own.join(", ")
                )));
            }
        };
        family.check_settings(&settings)?;
        all.push(Variant { name, kind: Kind::Plain(settings) });
    }
    for (i, variant) in all.iter().enumerate() {
        let name = &variant.name;
        if !is_word(name) || name == FULL || all[..i].iter().any(|v| &v.name == name) {
            return Err(Error::Input(format!(
                "'{name}' cannot be the name of a variant, or is one already: expected another one, of letters, digits, - and _"
            )));
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_are_the_familys_or_what_is_given() {
        let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates/cylinder-flow");
        let family = Family::load(&home).unwrap();
        let schedule = family.hybrid.clone().unwrap();
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("v");
        std::fs::write(&file, "precision fp32;\n").unwrap();
        let hybrid = [format!("fp32={}", file.display())];
        let names = |hybrids: &[String], plain: &[&str]| {
            let plain: Vec<String> = plain.iter().map(ToString::to_string).collect();
            variants(&family, &schedule, (true, false), hybrids, &plain)
                .map(|all| all.into_iter().map(|v| v.name).collect::<Vec<_>>())
        };
        assert_eq!(
            names(&hybrid, &[]).unwrap(),
            ["hybrid", "dmd", "network-dmd", "dmd-loose", "fp32", "loose", "coarse"]
        );
        assert_eq!(names(&[], &["none"]).unwrap(), ["hybrid", "dmd", "network-dmd", "dmd-loose"]);
        // Without a model those that need none.
        let alone = variants(&family, &schedule, (false, false), &[], &["none".into()]).unwrap();
        assert_eq!(alone.iter().map(|v| v.name.as_str()).collect::<Vec<_>>(), ["dmd", "dmd-loose"]);
        let loose = &schedule.plain.iter().find(|p| p.name == "loose").unwrap().set;
        assert!(loose.iter().all(|(name, value)| alone[1].kind.settings()[name] == *value));
        // A variant is then the dmd surrogate's.
        let dmd = variants(&family, &schedule, (false, false), &hybrid, &["none".into()]).unwrap();
        assert!(matches!(&dmd[2].kind, Kind::Hybrid { surrogates: "dmd", .. }), "{dmd:?}");
        let coarse = [hybrid[0].clone() + ",cells=0.5"];
        let all = variants(&family, &schedule, (true, false), &coarse, &["none".into()]).unwrap();
        assert_eq!(all[4].kind.settings()["cells"].to_string(), "0.5");
        assert!(all[0].kind.settings().is_empty());
        let unknown = [hybrid[0].clone() + ",size=2"];
        m4gn_samples::fails(names(&unknown, &[]), &["no parameter 'size'"]);
        assert_eq!(names(&[], &["loose", "half=cells=0.5,courant=2"]).unwrap()[4..], ["loose", "half"]);
        for (plain, words) in [
            ("fine", "loose, coarse"),
            ("full=cells=2", "'full' cannot be"),
            ("a=size=2", "no parameter 'size'"),
        ] {
            m4gn_samples::fails(names(&[], &[plain]), &[words]);
        }
        assert!(names(&["a=/nowhere".into()], &[]).is_err());
        let twice = [hybrid[0].clone(), hybrid[0].clone()];
        assert!(names(&twice, &[]).is_err());
    }
}
