//! What a solver says of the solid that it computes, beside its fields: a model of solids is right for what it was trained on.

use m4gn_mesh::body::Body;
use serde::{Deserialize, Serialize};

/// Moduli outside a range by more than this share are reported: an eigenfrequency goes with the root of E over rho, and a
/// phase that is off by a per cent is soon another one.
const MARGIN: f64 = 0.02;

/// Lowest and highest value.
pub type Range = [f64; 2];

/// Material, loads and schemes of a body; over several trajectories what all of them have. What is not known, or does not
/// count for the body's motion, is left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Solid {
    /// Young's modulus, Pa. Settings have all names in small letters.
    #[serde(rename = "E", alias = "e", skip_serializing_if = "Option::is_none")]
    pub young: Option<Range>,
    /// Poisson's ratio.
    #[serde(rename = "nu", skip_serializing_if = "Option::is_none")]
    pub poisson: Option<Range>,
    /// Density, kg/m^3.
    #[serde(rename = "rho", skip_serializing_if = "Option::is_none")]
    pub density: Option<Range>,
    /// Largest traction on a face of the boundary, Pa.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub traction: Option<Range>,
    /// Names of the material laws.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub laws: Vec<String>,
    /// Names of the time schemes of the displacement (OpenFOAM's `d2dt2Schemes`).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub schemes: Vec<String>,
}

impl Solid {
    /// Of a body at points that obstacles and its handles move: what it does in equilibrium under prescribed displacements
    /// depends on Poisson's ratio alone.
    pub fn of_body(body: &Body) -> Self {
        let poisson = body.material.iter().map(|m| [m.poisson; 2]);
        let poisson = poisson.reduce(|[low, high], [nu, _]| [low.min(nu), high.max(nu)]);
        Solid { poisson, ..Solid::default() }
    }

    /// Takes in what another trajectory has.
    pub(super) fn widen(&mut self, other: &Solid) {
        let ranges = [
            (&mut self.young, other.young),
            (&mut self.poisson, other.poisson),
            (&mut self.density, other.density),
            (&mut self.traction, other.traction),
        ];
        for (all, one) in ranges {
            *all = match (*all, one) {
                (Some([low, high]), Some([least, most])) => Some([low.min(least), high.max(most)]),
                // Of one trajectory it is not known, so that nothing can be said of all.
                _ => None,
            };
        }
        for (all, one) in [(&mut self.laws, &other.laws), (&mut self.schemes, &other.schemes)] {
            all.extend(one.iter().filter(|name| !all.contains(name)).cloned().collect::<Vec<_>>());
            all.sort();
        }
    }

    /// Name, unit and range of each quantity.
    fn quantities(&self) -> [(&'static str, &'static str, Option<Range>); 4] {
        [
            ("Young's modulus", " Pa", self.young),
            ("Poisson's ratio", "", self.poisson),
            ("the density", " kg/m^3", self.density),
            ("the largest traction", " Pa", self.traction),
        ]
    }

    /// Quantities and their ranges, laws and schemes, for people.
    pub(super) fn described(&self) -> Vec<[String; 2]> {
        let known = self.quantities().into_iter();
        let known = known.filter_map(|(what, unit, values)| Some((what, unit, values?)));
        let mut lines: Vec<[String; 2]> = known
            .map(|(what, unit, values)| {
                [what.trim_start_matches("the ").into(), format!("{}{unit}", range(values))]
            })
            .collect();
        for (what, names) in [("material law", &self.laws), ("time scheme", &self.schemes)] {
            if !names.is_empty() {
                lines.push([what.into(), names.join(", ")]);
            }
        }
        lines
    }

    /// In which respects a case lies outside, one a line for people.
    pub(super) fn outside(&self, case: &Solid) -> Vec<String> {
        let mut found = Vec::new();
        for ((what, unit, trained), (_, _, case)) in self.quantities().into_iter().zip(case.quantities()) {
            let (Some([low, high]), Some([least, most])) = (trained, case) else {
                continue;
            };
            // Not finite is outside.
            if !(least >= low - MARGIN * low.abs() && most <= high + MARGIN * high.abs()) {
                found.push(format!(
                    "{what} is {}{unit}, and the model was trained on {}{unit}",
                    range([least, most]),
                    range([low, high])
                ));
            }
        }
        for (what, trained, case) in [
            ("the material law", &self.laws, &case.laws),
            ("the time scheme of the displacement", &self.schemes, &case.schemes),
        ] {
            let other = |name: &&String| !trained.is_empty() && !trained.contains(name);
            let others: Vec<&str> = case.iter().filter(other).map(String::as_str).collect();
            if !others.is_empty() {
                let (others, known) = (others.join(", "), trained.join(", "));
                found.push(format!("{what} is {others}, and the model was trained on {known}"));
            }
        }
        found
    }

    /// What is wrong in it; none: nothing.
    pub fn fault(&self) -> Option<String> {
        let ranges =
            [("E", self.young), ("nu", self.poisson), ("rho", self.density), ("traction", self.traction)];
        ranges.into_iter().find_map(|(name, range)| match range {
            Some([low, high]) if !(low <= high && low.is_finite() && high.is_finite()) => {
                Some(format!("{name}: expected the lowest and the highest value, found [{low}, {high}]"))
            }
            _ => None,
        })
    }
}

/// A range for people.
pub(super) fn range([low, high]: Range) -> String {
    match low == high {
        true => format!("{low:.3e}"),
        false => format!("{low:.3e} to {high:.3e}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn steel(young: f64) -> Solid {
        Solid {
            young: Some([young, young]),
            poisson: Some([0.3, 0.3]),
            density: Some([7800.0, 7800.0]),
            traction: Some([0.0, 0.0]),
            laws: vec!["linearElastic".into()],
            schemes: vec!["Euler".into()],
        }
    }

    #[test]
    fn what_differs_is_named_and_what_does_not_is_not() {
        let mut trained = steel(2e11);
        trained.widen(&steel(2.1e11));
        assert_eq!(trained.young, Some([2e11, 2.1e11]));
        assert!(trained.outside(&steel(2.05e11)).is_empty());
        assert!(trained.outside(&steel(2.14e11)).is_empty());
        let far = trained.outside(&steel(8e11));
        assert_eq!(
            far,
            ["Young's modulus is 8.000e11 Pa, and the model was trained on 2.000e11 to 2.100e11 Pa"]
        );
        let case = Solid {
            traction: Some([0.0, 1e3]),
            poisson: Some([f64::NAN, 0.3]),
            laws: vec!["linearElastic".into(), "neoHookeanElastic".into()],
            schemes: vec!["backward".into()],
            ..steel(2e11)
        };
        let found = trained.outside(&case);
        assert_eq!(found.len(), 4, "{found:?}");
        assert!(
            found[0].contains("Poisson") && found[1].contains("largest traction is 0.000e0 to 1.000e3 Pa")
        );
        assert!(found[2].contains("law is neoHookeanElastic,") && found[3].contains("backward"));
        // What one of the two does not say is not compared.
        assert!(trained.outside(&Solid::default()).is_empty());
        assert!(Solid::default().outside(&case).is_empty());
    }

    #[test]
    fn what_one_trajectory_does_not_say_is_not_known_of_all() {
        let mut all = steel(1e6);
        all.widen(&Solid { density: None, laws: vec!["ab".into()], ..steel(2e6) });
        assert_eq!((all.density, all.young), (None, Some([1e6, 2e6])));
        assert_eq!(all.laws, ["ab", "linearElastic"]);
        assert_eq!(all.fault(), None);
        all.young = Some([2.0, 1.0]);
        assert_eq!(all.fault().unwrap(), "E: expected the lowest and the highest value, found [2, 1]");
        let json = serde_json::to_string(&steel(1.0)).unwrap();
        assert!(json.starts_with(r#"{"E":[1.0,1.0],"nu":[0.3,0.3],"rho""#), "{json}");
        assert_eq!(serde_json::from_str::<Solid>(&json).unwrap(), steel(1.0));
        assert_eq!(serde_json::to_string(&Solid::default()).unwrap(), "{}");
    }
}
