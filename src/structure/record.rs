//! What is stored with segments: how they were made, and marks of the mesh and of the labels, so that a later run knows
//! whether they are the ones that it wants.
//!
//! The marks are sums over the cells of all ranks. They depend neither on the order of the cells nor on the
//! decomposition, as long as every label stays with its cell (renumberMesh, redistributePar).

use super::obstacle::obstacle_note;
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::{ModalOperator, SegmentSpec};
use m4gn_parallel::Comm;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

/// Largest difference of two marks that is rounding: of points in files with six digits, say.
const TOLERANCE: f64 = 1e-5;

/// How stored segments were made, and of which mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// As computed: with the operator whose modes were taken.
    spec: SegmentSpec,
    cells: i64,
    /// Sum of the volumes V, of V^2, and of V x and V x^2 in each direction.
    mesh: Vec<f64>,
    /// Sum of V (l + 1), and of V (l + 1) x in each direction, over the labels l.
    labels: Vec<f64>,
    /// What was taken for the obstacle, for people; empty where none was.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    obstacle: String,
}

/// Sums with the sums of their terms' sizes, which differences are judged by.
struct Marks {
    cells: i64,
    mesh: Vec<[f64; 2]>,
    labels: Vec<[f64; 2]>,
}

impl Marks {
    /// Collective.
    fn new(mesh: &Mesh, labels: &[i32], comm: &Comm) -> Self {
        let mut sums = [[0.0; 2]; 12];
        let mut add = |at: usize, term: f64| {
            sums[at][0] += term;
            sums[at][1] += term.abs();
        };
        for ((&v, x), &label) in mesh.cell_volumes.iter().zip(&mesh.cell_centres).zip(labels) {
            let l = f64::from(label) + 1.0;
            add(0, v);
            add(1, v * v);
            add(8, v * l);
            for (d, x) in x.iter().enumerate() {
                add(2 + d, v * x);
                add(5 + d, v * x * x);
                add(9 + d, v * l * x);
            }
        }
        let mut flat = sums.concat();
        comm.sum_f64(&mut flat);
        let cells = comm.total(mesh.n_cells());
        let pairs: Vec<[f64; 2]> = flat.chunks_exact(2).map(|c| [c[0], c[1]]).collect();
        Marks { cells, mesh: pairs[..8].to_vec(), labels: pairs[8..].to_vec() }
    }
}

fn same(stored: &[f64], now: &[[f64; 2]]) -> bool {
    // NaN is not the same as anything.
    stored.len() == now.len()
        && stored.iter().zip(now).all(|(s, [sum, size])| (s - sum).abs() <= TOLERANCE * size)
}

/// The entries of a description that its labels depend on.
fn entries(spec: &SegmentSpec) -> Map<String, Value> {
    let mut all = spec.entries();
    // It is added to the labels afterwards.
    all.remove("overlap");
    if !spec.method.uses_modes() {
        for key in ["modes", "operator", "tau", "size", "iterations", "mode_scale", "margin"] {
            all.remove(key);
        }
    }
    if !spec.method.uses_obstacle() {
        all.remove("obstacles");
        all.remove("distance_scale");
    }
    all
}

/// Equal but for rounding in files.
fn equal(a: &Value, b: &Value) -> bool {
    match (a.as_f64(), b.as_f64()) {
        (Some(a), Some(b)) => (a - b).abs() <= 1e-9 * a.abs().max(b.abs()),
        _ => a == b,
    }
}

/// As OpenFOAM's users and the manual call it.
fn dictionary_name(key: &str) -> &str {
    match key {
        "distance_scale" => "distanceScale",
        "mode_scale" => "modeScale",
        _ => key,
    }
}

impl Record {
    /// Of segments, one label a cell, that were computed by `spec`. Collective.
    ///
    /// # Errors
    /// [`Error::Input`] as [`SegmentSpec::is_elastic`].
    pub fn new(mesh: &Mesh, spec: &SegmentSpec, labels: &[i32], comm: &Comm) -> Result<Self> {
        let elastic = spec.method.uses_modes() && comm.agree(spec.is_elastic(mesh))?;
        let obstacle = match spec.method.uses_obstacle() {
            // Where nothing was refined there may be none.
            true => obstacle_note(mesh, &spec.obstacles, comm).unwrap_or_default(),
            false => String::new(),
        };
        let marks = Marks::new(mesh, labels, comm);
        let sums = |pairs: &[[f64; 2]]| pairs.iter().map(|p| p[0]).collect();
        Ok(Record {
            spec: SegmentSpec {
                operator: spec.method.uses_modes().then_some(match elastic {
                    true => ModalOperator::Elastic,
                    false => ModalOperator::Laplacian,
                }),
                ..spec.clone()
            },
            cells: marks.cells,
            mesh: sums(&marks.mesh),
            labels: sums(&marks.labels),
            obstacle,
        })
    }

    /// For the file beside the segments: one line of JSON.
    ///
    /// # Errors
    /// [`Error::Internal`] if it cannot be written as JSON.
    pub fn text(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|e| Error::Internal(format!("record of the segments: {e}")))
    }
}

/// Why stored labels are not what `wanted` describes on this mesh; none: they are. Of `wanted` the entries `only` count,
/// or all. `record` is the text that was stored with them, empty if there was none. Collective, with the same record on
/// all ranks.
pub fn misfit(
    mesh: &Mesh,
    labels: &[i32],
    record: &str,
    wanted: &SegmentSpec,
    only: Option<&[String]>,
    comm: &Comm,
) -> Option<String> {
    let marks = Marks::new(mesh, labels, comm);
    if record.is_empty() {
        return match only {
            Some([]) => None,
            _ => Some("nothing is stored with them that says how they were made".into()),
        };
    }
    let record: Record = match serde_json::from_str(record) {
        Ok(record) => record,
        Err(e) => return Some(format!("what is stored with them cannot be read: {e}")),
    };
    if record.cells != marks.cells {
        return Some(format!(
            "they were made for a mesh of {} cells, and this one has {}",
            record.cells, marks.cells
        ));
    }
    if !same(&record.mesh, &marks.mesh) {
        return Some(format!("they were made for another mesh of {} cells", record.cells));
    }
    if !same(&record.labels, &marks.labels) {
        return Some(
            "the labels are not those that were stored, or not on the same cells (edited, mapped, or cells in another \
             order)"
                .into(),
        );
    }
    let (stored, named, wanted) = (entries(&record.spec), wanted.entries(), entries(wanted));
    let asked = |key: &String| only.is_none_or(|keys| keys.contains(key));
    let mut other = Vec::new();
    for (key, value) in &wanted {
        let found = stored.get(key).unwrap_or(&Value::Null);
        // Modes of whatever the case has
        let open = key == "operator" && value.is_null();
        if asked(key) && !open && !equal(found, value) {
            other.push(format!("{} is {found} there, and {value} is wanted", dictionary_name(key)));
        }
    }
    // An entry that is as by default is not named.
    if other.is_empty() {
        let gone = stored.iter().filter(|(key, _)| asked(key) && !named.contains_key(*key));
        other.extend(
            gone.map(|(key, value)| format!("{} is {value} there, and not wanted", dictionary_name(key))),
        );
    }
    match other.is_empty() {
        true => None,
        false => Some(other.join("; ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Graph;
    use crate::segment;
    use m4gn_model::SegmentMethod;
    use m4gn_samples::mesh as sample;

    fn spec(method: SegmentMethod, count: usize) -> SegmentSpec {
        SegmentSpec { method, count, modes: 3, ..SegmentSpec::default() }
    }

    fn cut(mesh: &Mesh, spec: &SegmentSpec) -> (Vec<i32>, String) {
        let comm = Comm::serial();
        let mut graph = Graph::new(mesh, &comm).unwrap();
        let found = segment(mesh, &mut graph, spec, &m4gn_modes::Modal::default(), &comm, None).unwrap();
        let labels = found.node_segment[..mesh.n_cells()].to_vec();
        let record = Record::new(mesh, spec, &labels, &comm).unwrap();
        (labels, record.text().unwrap())
    }

    fn why(mesh: &Mesh, labels: &[i32], record: &str, wanted: &SegmentSpec) -> String {
        misfit(mesh, labels, record, wanted, None, &Comm::serial()).unwrap_or_default()
    }

    #[test]
    fn the_same_description_fits_and_others_are_named() {
        let mesh = sample::rectangle(12, 8, 1.2, 0.8);
        let slic = spec(SegmentMethod::Slic, 6);
        let (labels, record) = cut(&mesh, &slic);
        assert_eq!(why(&mesh, &labels, &record, &slic), "");
        // Overlap is no part of the labels, and no operator means whichever there is.
        let other = SegmentSpec { overlap: 2, operator: Some(ModalOperator::Laplacian), ..slic.clone() };
        assert_eq!(why(&mesh, &labels, &record, &other), "");
        type Change = fn(&mut SegmentSpec);
        let changes: [(&str, Change); 6] = [
            ("method is \"slic-md\"", |s| s.method = SegmentMethod::Metis),
            ("count is 6 there, and 7 is wanted", |s| s.count = 7),
            ("modes is 3", |s| s.modes = 4),
            ("tau is 1.0", |s| s.tau = 1.001),
            ("connected is true", |s| s.connected = false),
            ("operator is \"laplacian\"", |s| s.operator = Some(ModalOperator::Elastic)),
        ];
        for (expected, change) in changes {
            let mut wanted = slic.clone();
            change(&mut wanted);
            let message = why(&mesh, &labels, &record, &wanted);
            assert!(message.contains(expected), "{expected}: {message}");
        }
        let only = |keys: &[&str]| {
            let keys: Vec<String> = keys.iter().map(|k| k.to_string()).collect();
            let wanted = spec(SegmentMethod::Metis, 6);
            misfit(&mesh, &labels, &record, &wanted, Some(&keys), &Comm::serial())
        };
        assert_eq!(only(&["count"]), None);
        assert!(only(&["method"]).is_some());
        // What is asked for as it is by default.
        let (labels, record) = cut(&mesh, &SegmentSpec { margin: 0.0, ..slic.clone() });
        for (key, fits) in [("margin", false), ("tau", true)] {
            let found = misfit(&mesh, &labels, &record, &slic, Some(&[key.to_string()]), &Comm::serial());
            assert_eq!(found.is_none(), fits, "{key}: {found:?}");
        }
    }

    #[test]
    fn another_mesh_and_other_labels_do_not_fit() {
        let mesh = sample::rectangle(12, 8, 1.2, 0.8);
        let metis = spec(SegmentMethod::Metis, 6);
        let (labels, record) = cut(&mesh, &metis);
        assert_eq!(why(&mesh, &labels, &record, &metis), "");

        let more = sample::rectangle(12, 9, 1.2, 0.8);
        assert!(why(&more, &[0; 108], &record, &metis).contains("96 cells, and this one has 108"));
        // As many cells of the same domain
        let turned = sample::rectangle(8, 12, 1.2, 0.8);
        assert!(why(&turned, &labels, &record, &metis).contains("another mesh of 96 cells"));
        let mut edited = labels.clone();
        edited[0] = (edited[0] + 1) % 6;
        assert!(why(&mesh, &edited, &record, &metis).contains("the labels are not those"));

        // Cells in another order, with their labels
        let mut renumbered = mesh.clone();
        renumbered.cell_centres.reverse();
        renumbered.cell_volumes.reverse();
        let reversed: Vec<i32> = labels.iter().rev().copied().collect();
        assert_eq!(why(&renumbered, &reversed, &record, &metis), "");
    }

    #[test]
    fn what_was_not_stored_or_is_damaged_does_not_fit() {
        let mesh = sample::rectangle(12, 8, 1.2, 0.8);
        let metis = spec(SegmentMethod::Metis, 6);
        let (labels, record) = cut(&mesh, &metis);
        assert!(why(&mesh, &labels, "", &metis).contains("nothing is stored"));
        assert!(why(&mesh, &labels, &record[..40], &metis).contains("cannot be read"));
        let nobody_asks = misfit(&mesh, &labels, "", &metis, Some(&[]), &Comm::serial());
        assert_eq!(nobody_asks, None);
    }
}
