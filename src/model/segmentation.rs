//! How the mesh is cut into segments: part of a model's description and of a training configuration.

use crate::modal::{ModalOptions, ModalSolver};
use m4gn_base::settings::{self, object};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Map, Value};
use std::fmt;

/// Largest number of segments that a description may ask for.
const MOST: usize = 1 << 20;

/// Most sweeps of SLIC. Ten are mostly enough; on some meshes the sweeps go to and fro between two answers, so that only their
/// number ends them.
const MOST_SWEEPS: usize = 10_000;

/// First partition and its refinement (paper, section 3.3.3 and appendix B.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum SegmentMethod {
    /// METIS alone.
    #[serde(rename = "metis")]
    Metis,
    /// METIS refined by SLIC on modes and positions (SLIC-MD).
    #[serde(rename = "slic-md", alias = "slic")]
    Slic,
    /// SLIC-MD with the logarithm of the distance to the obstacle (SLIC-MDOD_l, eq. 14).
    #[serde(rename = "slic-mdodl")]
    SlicLog,
    /// SLIC-MD with the exponential of minus the distance to the obstacle (SLIC-MDOD_e, eq. 14).
    #[serde(rename = "slic-mdode")]
    SlicExp,
}

m4gn_base::names! {
    SegmentMethod: Metis "metis", Slic "slic-md", SlicLog "slic-mdodl", SlicExp "slic-mdode"
}

impl SegmentMethod {
    /// Whether modes are features of this method.
    pub fn uses_modes(self) -> bool {
        self != SegmentMethod::Metis
    }

    /// Whether the distance to the obstacle is a feature of this method.
    pub fn uses_obstacle(self) -> bool {
        matches!(self, SegmentMethod::SlicLog | SegmentMethod::SlicExp)
    }
}

impl fmt::Display for SegmentMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Whose modes are features of the segments (Algorithm 1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ModalOperator {
    /// The solver's Laplacian on the mesh's cells (eq. 6).
    Laplacian,
    /// The elastic body's stiffness and mass (eq. 5), whose modes the mesh has with it.
    Elastic,
}

/// The entry that says how the modes are computed, and nothing of what the segments are.
const WAY: &str = "modal_solver";

/// Default of [`SegmentSpec::margin`].
const MARGIN: f64 = 1e-5;

fn is_default_margin(value: &f64) -> bool {
    *value == MARGIN
}

m4gn_base::settings! {
    /// How the mesh is cut into segments (Algorithms 1 and 2).
    ///
    /// A description without the key `connected` has it true, as [`Default`]; a model file without it was trained
    /// before there was such a key, and has it false.
    pub struct SegmentSpec in "segments" {
        /// `metis`, METIS alone; `slic-md`, METIS refined by SLIC on modes and positions; `slic-mdodl` or `slic-mdode`, with the
        /// logarithm or the exponential of the distance to the obstacle as well (eq. 14).
        pub method: SegmentMethod = SegmentMethod::Slic;
        /// Number of segments K.
        pub count: usize = 36;
        /// Number of modes m that SLIC uses.
        pub modes: usize = 6;
        // A training writes down which it took.
        /// Whose modes: `elastic`, the body's (eq. 5), or `laplacian`, the mesh's (eq. 6).
        pub operator: Option<ModalOperator> = None, "`elastic` where there is a displacement and the material is known";
        /// Weight of positions against modes, tau of eq. 8.
        pub tau: f64 = 1.0;
        /// Size S of a segment in Algorithm 2.
        pub size: Option<f64> [m] = None, "from K";
        /// Most sweeps of SLIC, up to 10000.
        pub iterations: usize = 20;
        /// Whether pieces of a segment apart from its largest one go to a neighbour; in the paper they stay.
        pub connected: bool = true;
        // The feature is S log(d/l), to which l does not matter, or S exp(-d/l).
        /// Length that distances to the obstacle are divided by; 0: none, metres as in the paper.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub distance_scale: Option<f64> [m] = None, "S";
        // With S a change of a mode by its root mean square counts as one cluster size. The paper does not say the norm of its modes.
        /// Factor of modes of root mean square 1, beside positions in metres; 1/sqrt(N) gives them unit length on N cells.
        #[serde(skip_serializing_if = "Option::is_none")]
        pub mode_scale: Option<f64> [m] = None, "S";
        /// Share of S by which a centroid must be nearer to take a cell, so that ties of symmetric meshes stay; 0 in the paper.
        #[serde(skip_serializing_if = "is_default_margin")]
        pub margin: f64 = MARGIN;
        /// What is the obstacle: patches, or pieces of walls by the names that logs and `m4gn segment` have for them, such as `walls:2`.
        #[serde(skip_serializing_if = "Vec::is_empty")]
        pub obstacles: Vec<String> = Vec::new(), "patches of node type obstacle, else pieces of walls that do not reach the box around the mesh, else all walls";
        /// Layers of neighbours that segments reach into each other.
        pub overlap: usize = 0;
        /// The way to the modes: `auto` (by size), `direct` (factorisation) or `iterative` (multigrid).
        #[serde(skip_serializing_if = "m4gn_base::settings::is_default")]
        pub modal_solver: ModalSolver = ModalSolver::default();
    }
}

impl SegmentSpec {
    /// The description that a training left in a model or a checkpoint, where `connected` may be missing: it was not
    /// done then. Without `operator`, modes were the Laplacian's.
    ///
    /// # Errors
    /// For entries that are no description.
    pub fn of_training(mut entries: serde_json::Map<String, serde_json::Value>) -> serde_json::Result<Self> {
        entries.entry("connected").or_insert(false.into());
        entries.entry("operator").or_insert("laplacian".into());
        serde_json::from_value(entries.into())
    }

    /// Whether the modes are those of the elastic body that this mesh has with it.
    ///
    /// # Errors
    /// [`Error::Input`] if they should be and there are none.
    pub fn is_elastic(&self, mesh: &Mesh) -> Result<bool> {
        match (self.operator, &mesh.elastic) {
            (Some(ModalOperator::Laplacian), _) | (None, None) => Ok(false),
            (_, Some(_)) => Ok(true),
            (Some(ModalOperator::Elastic), None) => Err(Error::Input(
                "segments of elastic modes: the mesh has none with it; expected E, nu and rho of the body in the \
                 case or the function object's dictionary, or a trajectory that was recorded with them"
                    .into(),
            )),
        }
    }

    /// How many modes, and the way to them.
    pub fn modal(&self) -> ModalOptions {
        ModalOptions { count: self.modes, solver: self.modal_solver }
    }

    /// The entries that the segments themselves depend on: all but the way to the modes.
    pub fn entries(&self) -> Map<String, Value> {
        let mut all = object(serde_json::to_value(self).unwrap_or_default());
        all.remove(WAY);
        all
    }

    /// Checks what does not need a mesh.
    ///
    /// # Errors
    /// [`Error::Input`] naming the entry, what was expected and what was found.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, expected: &str, found: f64| {
            Err(Error::Input(format!("segments.{what}: expected {expected}, found {found}")))
        };
        if !(1..=MOST).contains(&self.count) {
            return bad("count", &format!("1 to {MOST}"), self.count as f64);
        }
        if self.iterations > MOST_SWEEPS {
            return bad("iterations", &format!("0 to {MOST_SWEEPS}"), self.iterations as f64);
        }
        if !(self.tau.is_finite() && self.tau >= 0.0) {
            return bad("tau", "a finite number that is not negative", self.tau);
        }
        if !(0.0..1.0).contains(&self.margin) {
            return bad("margin", "a share of S from 0, the paper's, to below 1", self.margin);
        }
        if let Some(size) = self.size
            && !(size.is_finite() && size > 0.0)
        {
            return bad("size", "a positive length in m", size);
        }
        if let Some(scale) = self.mode_scale
            && !(scale.is_finite() && scale >= 0.0)
        {
            return bad("mode_scale", "a length in m, or 0 for no modes", scale);
        }
        match self.distance_scale {
            Some(l) if !(l.is_finite() && l >= 0.0) => {
                bad("distance_scale", "a length in m, or 0 for the paper's", l)
            }
            _ => Ok(()),
        }
    }
}

/// Some entries of a description of segments, which differ from another one: what a case, a host or a command line
/// says. Each is of the type that [`SegmentSpec`] has; whether its value is in range, [`SegmentEntries::over`] says.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Map<String, Value>")]
pub struct SegmentEntries(Map<String, Value>);

impl TryFrom<Map<String, Value>> for SegmentEntries {
    type Error = serde_json::Error;

    fn try_from(entries: Map<String, Value>) -> serde_json::Result<Self> {
        SegmentSpec::deserialize(Value::Object(entries.clone()))?;
        Ok(SegmentEntries(entries))
    }
}

impl SegmentEntries {
    /// The entry `name` in place of what was said of it before.
    pub fn set(&mut self, name: &str, value: impl Into<Value>) {
        self.0.insert(name.into(), value.into());
    }

    /// Names of the entries that the segments themselves depend on.
    pub fn names(&self) -> Vec<String> {
        let all = self.0.keys().cloned();
        all.filter(|name| name != WAY).collect()
    }

    /// Whether there is an entry of this name.
    pub fn has(&self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// `base` with these entries in place of its own.
    ///
    /// # Errors
    /// [`Error::Input`] for a name that is not known, and as [`SegmentSpec::check`].
    pub fn over(&self, base: &SegmentSpec) -> Result<SegmentSpec> {
        let wrong = |e: serde_json::Error| Error::Internal(format!("segments: {e}"));
        let mut whole = object(serde_json::to_value(base).map_err(wrong)?);
        whole.extend(self.0.clone());
        let spec: SegmentSpec = settings::read("segments", &whole.into())?;
        spec.check()?;
        Ok(spec)
    }
}

/// The segmentation of a model file.
pub(super) fn of_model_file<'de, D: Deserializer<'de>>(
    deserializer: D,
) -> std::result::Result<SegmentSpec, D::Error> {
    SegmentSpec::of_training(serde_json::Map::deserialize(deserializer)?).map_err(serde::de::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ModelSpec;
    use crate::sample::spec;
    use m4gn_samples::fails;

    #[test]
    fn names_go_both_ways() {
        for method in SegmentMethod::ALL {
            let json = serde_json::to_string(&method).unwrap();
            assert_eq!(json, format!("\"{method}\""));
            assert_eq!(serde_json::from_str::<SegmentMethod>(&json).unwrap(), method);
        }
        assert_eq!(serde_json::from_str::<SegmentMethod>("\"slic\"").unwrap(), SegmentMethod::Slic);
        let message = settings::read::<SegmentMethod>("method", &"SLIC".into()).unwrap_err().to_string();
        assert!(message.contains("expected one of metis,") && message.contains("found SLIC"), "{message}");
    }

    #[test]
    fn only_model_files_of_old_mean_what_they_did() {
        let old =
            r#"{"method":"slic","count":4,"modes":3,"tau":1.0,"size":null,"iterations":20,"overlap":0}"#;
        let new: SegmentSpec = serde_json::from_str(old).unwrap();
        assert!(new.connected && new.method == SegmentMethod::Slic);
        let mut model = serde_json::to_value(spec()).unwrap();
        model["segments"] = serde_json::from_str(old).unwrap();
        let read: ModelSpec = serde_json::from_value(model.clone()).unwrap();
        assert_eq!(
            read.segments,
            SegmentSpec { connected: false, operator: Some(ModalOperator::Laplacian), ..new }
        );
        model["segments"]["conected"] = true.into();
        assert!(serde_json::from_value::<ModelSpec>(model).is_err());
        assert!(spec().segments.connected);
    }

    #[test]
    fn entries_go_over_a_description() {
        let entries =
            |text: &str| m4gn_base::settings::parse::<SegmentEntries>("segments", text, &[]).unwrap();
        let base = SegmentSpec { tau: 0.5, size: Some(0.1), ..SegmentSpec::default() };
        assert_eq!(entries("{}").over(&base).unwrap(), base);
        let given = entries(r#"{"count": 9, "size": null, "modalSolver": "direct"}"#);
        let found = given.over(&base).unwrap();
        assert_eq!((found.count, found.tau, found.size), (9, 0.5, None));
        assert_eq!(found.modal().solver, ModalSolver::Direct);
        assert_eq!(given.names(), ["count", "size"]);
        assert!(!found.entries().contains_key("modal_solver"));
        let message = entries(r#"{"tau": -2}"#).over(&base).unwrap_err().to_string();
        assert!(message.contains("segments.tau: expected a finite number that is not negative"), "{message}");
        let mut unknown = SegmentEntries::default();
        unknown.set("cuont", 3);
        fails(unknown.over(&base), &["segments.cuont: unknown entry"]);
        let mut wrong = SegmentEntries::default();
        wrong.set("tau", f64::NAN);
        fails(wrong.over(&base), &["segments.tau: expected a number, found null"]);
    }

    #[test]
    fn each_wrong_value_is_named() {
        type Change = fn(&mut SegmentSpec);
        let broken: [(&str, Change); 9] = [
            ("count", |s| s.count = 0),
            ("iterations", |s| s.iterations = 1 << 40),
            ("tau", |s| s.tau = -1.0),
            ("tau", |s| s.tau = f64::NAN),
            ("margin", |s| s.margin = -1e-5),
            ("margin", |s| s.margin = f64::NAN),
            ("size", |s| s.size = Some(0.0)),
            ("distance_scale", |s| s.distance_scale = Some(-1.0)),
            ("mode_scale", |s| s.mode_scale = Some(-1.0)),
        ];
        assert!(SegmentSpec::default().check().is_ok());
        for (name, change) in broken {
            let mut s = SegmentSpec::default();
            change(&mut s);
            fails(s.check(), &[&format!("segments.{name}")]);
        }
    }
}
