//! `m4gn info`: what is in a trajectory, a data set or a model.

mod body;

use super::write_json;
use m4gn_base::{Error, Result, listed};
use m4gn_data::{Frame, Split, Trajectory, interval, list};
use m4gn_mesh::{Mesh, NodeType};
use m4gn_model::{Model, TrainedOn};
use m4gn_report::{number, seconds};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Say what is in a trajectory, a folder of trajectories, or a model
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Trajectory (*.h5), folder of trajectories, or model (*.safetensors)
    path: PathBuf,
    /// Write the figures to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; a folder's damaged trajectories are told after the table.
pub fn run(args: Args) -> Result<()> {
    let _claimed = super::claim_outputs([args.json.as_deref()], [Some(&*args.path)])?;
    let path = args.path.as_path();
    let is_model = path.extension().is_some_and(|e| e == "safetensors");
    let mut damaged = Vec::new();
    let (text, figures) = if path.is_dir() {
        folder(path, &mut damaged)?
    } else if is_model {
        model(path)?
    } else {
        trajectory(&Trajectory::open(path)?)?
    };
    print!("{text}");
    write_json(args.json.as_deref(), &figures)?;
    match damaged.len() {
        0 => Ok(()),
        1 => Err(damaged.remove(0)),
        n => Err(Error::Input(format!("{n} damaged trajectories; the first: {}", damaged[0]))),
    }
}

/// The interval of equidistant times, and that or the range of intervals in words.
fn spacing(times: &[f64]) -> (Option<f64>, String) {
    match interval(times) {
        None => (None, String::new()),
        Some((interval, None)) => (Some(interval), format!(", every {} s", seconds(interval))),
        Some(_) => {
            let all = times.windows(2).map(|w| w[1] - w[0]);
            let [low, high] = all.fold([f64::INFINITY, 0.0], |[a, b], v| [a.min(v), b.max(v)]);
            (None, format!(", at irregular intervals of {} to {} s", seconds(low), seconds(high)))
        }
    }
}

fn trajectory(t: &Trajectory) -> Result<(String, Value)> {
    let path = t.path();
    let bytes = path.metadata().map_or(0, |m| m.len());
    let mut text =
        format!("{}: trajectory, {:.1} MB, split {}\n", path.display(), megabytes(bytes), t.split().name());
    let times = t.times();
    let (first, last) = (times[0], times[times.len() - 1]);
    let (interval, every) = spacing(times);
    let mut figures = json!({
        "kind": "trajectory", "path": path.to_string_lossy(), "bytes": bytes, "split": t.split(),
        "frames": times.len(), "first_time": first, "last_time": last, "interval": interval, "provenance": t.provenance(),
    });
    match t.body() {
        Some(body) => body::describe(t, body, &mut text, &mut figures),
        None => mesh(t.mesh(), &mut text, &mut figures),
    }
    let _ =
        writeln!(text, "frames      {} from {} to {} s{every}", times.len(), seconds(first), seconds(last));
    let mut fields = Vec::new();
    for field in t.fields() {
        let (from, to) = range(&t.read_frame(&field.name, times.len() - 1)?);
        let kind = if field.vector { "vector" } else { "scalar" };
        let d = field.dimensions.map(|d| d.to_string()).join(" ");
        let _ = writeln!(
            text,
            "field       {:<16} {kind} [{d}], last frame {} to {}",
            field.name,
            number(from.into(), 4),
            number(to.into(), 4)
        );
        fields.push(json!({"name": field.name, "vector": field.vector, "dimensions": field.dimensions, "last_range": [from, to]}));
    }
    figures["fields"] = fields.into();
    if let Some(entries) = t.provenance().as_object() {
        for (key, value) in entries {
            let _ = writeln!(text, "provenance  {key:<16} {}", words(value));
        }
    }
    Ok((text, figures))
}

/// The mesh of fields at cells, added to text and figures.
fn mesh(mesh: &Mesh, text: &mut String, figures: &mut Value) {
    let directions: String = mesh.directions.iter().map(|&d| ['x', 'y', 'z'][d]).collect();
    let _ = writeln!(
        text,
        "mesh        {} cells, {} internal faces, {} boundary faces, {} cyclic faces, solved in {directions}",
        mesh.n_cells(),
        mesh.face_owner.len(),
        mesh.boundary.len(),
        mesh.coupled.len()
    );
    let parts = m4gn_structure::parts(mesh);
    if parts > 1 {
        let _ = writeln!(text, "parts       {parts}, which no face joins");
    }
    let mut patches = Vec::new();
    for (i, name) in mesh.patches.iter().enumerate() {
        let faces: Vec<_> = mesh.boundary.iter().filter(|f| f.patch == i as i32).collect();
        let kinds: Vec<&str> =
            NodeType::ALL.iter().filter(|k| faces.iter().any(|f| f.kind == **k)).map(|k| k.name()).collect();
        if !faces.is_empty() {
            let _ = writeln!(text, "patch       {name:<16} {} faces, {}", faces.len(), kinds.join(" and "));
            patches.push(json!({"name": name, "faces": faces.len(), "types": kinds}));
        }
    }
    figures["cells"] = mesh.n_cells().into();
    figures["internal_faces"] = mesh.face_owner.len().into();
    figures["boundary_faces"] = mesh.boundary.len().into();
    figures["cyclic_faces"] = mesh.coupled.len().into();
    figures["parts"] = parts.into();
    figures["directions"] = json!(mesh.directions);
    figures["patches"] = patches.into();
}

/// A row a trajectory; damaged files are rows too.
fn folder(path: &Path, damaged: &mut Vec<Error>) -> Result<(String, Value)> {
    let files = list(path)?;
    let mut text = format!(
        "{:<20} {:<6} {:>8} {:>9} {:>7}  {:<18} {:>8}\n",
        "file", "split", "nodes", "boundary", "frames", "times (s)", "MB"
    );
    let mut rows = Vec::new();
    let mut count = [0usize; 3];
    let mut bytes = 0;
    for file in files {
        let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let t = match Trajectory::open(&file) {
            Ok(t) => t,
            Err(e) => {
                let _ = writeln!(text, "{name:<20} damaged");
                rows.push(json!({"file": name, "error": e.to_string()}));
                damaged.push(e);
                continue;
            }
        };
        let size = file.metadata().map_or(0, |m| m.len());
        let (frames, split) = (t.times().len(), t.split());
        let (first, last) = (t.times()[0], t.times()[frames - 1]);
        let mut row = json!({
            "file": name, "split": split, "frames": frames, "first_time": first, "last_time": last, "bytes": size,
            "provenance": t.provenance(),
        });
        let (nodes, boundary) = match t.body() {
            Some(body) => {
                row["elements"] = body.elements.len().into();
                row["points"] = body.positions.len().into();
                (body.positions.len(), t.obstacle().map_or(0, |o| o.positions.len()))
            }
            None => {
                let (cells, faces) = (t.mesh().n_cells(), t.mesh().boundary.len());
                row["cells"] = cells.into();
                row["boundary_faces"] = faces.into();
                (cells, faces)
            }
        };
        bytes += size;
        count[split as usize] += 1;
        let _ = writeln!(
            text,
            "{name:<20} {:<6} {nodes:>8} {boundary:>9} {frames:>7}  {:<18} {:>8.1}",
            split.name(),
            format!("{} to {}", seconds(first), seconds(last)),
            megabytes(size)
        );
        rows.push(row);
    }
    let [train, valid, test] = [Split::Train, Split::Valid, Split::Test].map(|s| count[s as usize]);
    let _ = writeln!(
        text,
        "{} trajectories: {train} train, {valid} valid, {test} test; {:.1} MB",
        train + valid + test,
        megabytes(bytes)
    );
    let mut figures = json!({
        "kind": "dataset", "path": path.to_string_lossy(), "bytes": bytes, "train": train, "valid": valid, "test": test,
    });
    if let Some((line, generated)) = body::generated(&rows) {
        let _ = writeln!(text, "{line}");
        figures["generated"] = generated;
    }
    figures["trajectories"] = rows.into();
    Ok((text, figures))
}

fn model(path: &Path) -> Result<(String, Value)> {
    let model = Model::read(path)?;
    let spec = &model.spec;
    let numbers: usize = model.tensors.values().map(|t| t.data.len()).sum();
    let bytes = path.metadata().map_or(0, |m| m.len());
    let mut text = format!("{}: model, {:.2} MB, {numbers} numbers\n", path.display(), megabytes(bytes));
    for field in &spec.fields {
        let input = if field.input { "input" } else { "no input" };
        let output = format!("{:?}", field.output).to_lowercase();
        let d = field.dimensions.map(|d| d.to_string()).join(" ");
        let floor = field.floor.map_or(String::new(), |floor| format!(", positive, floor {floor}"));
        let _ = writeln!(text, "field       {:<16} [{d}], {input}, output {output}{floor}", field.name);
    }
    let header = serde_json::to_value(spec).map_err(|e| Error::Internal(format!("a model's header: {e}")))?;
    for key in
        ["dim", "stride", "resolution", "node_types", "architecture", "segments", "contact", "precision"]
    {
        let needed = key != "segments" || spec.architecture.needs().segments;
        if let Some(value) = header.get(key).filter(|_| needed) {
            let _ = writeln!(text, "{:<11} {}", key.replace('_', " "), words(value));
        }
    }
    for [what, values] in spec.trained_on.iter().flat_map(TrainedOn::described) {
        let _ = writeln!(text, "trained on  {what:<32} {values}");
    }
    if let Some(entries) = spec.training.as_object() {
        for (key, value) in entries {
            let _ = writeln!(text, "training    {key:<16} {}", words(value));
        }
    }
    Ok((
        text,
        json!({"kind": "model", "path": path.to_string_lossy(), "bytes": bytes, "parameters": numbers, "spec": header}),
    ))
}

/// Entries of a header or a provenance in a line: names and values, those of an entry of its own in brackets.
fn words(value: &Value) -> String {
    let inner = |value: &Value| match value {
        Value::Object(_) => format!("({})", words(value)),
        _ => words(value),
    };
    match value {
        Value::String(text) => text.clone(),
        Value::Array(list) if !list.is_empty() => list.iter().map(inner).collect::<Vec<_>>().join(" "),
        Value::Object(entries) => {
            let given = entries.iter().filter(|(_, value)| !value.is_null());
            listed(given.map(|(key, value)| format!("{key} {}", inner(value))))
        }
        _ => value.to_string(),
    }
}

fn megabytes(bytes: u64) -> f64 {
    bytes as f64 * 1e-6
}

fn range(frame: &Frame) -> (f32, f32) {
    frame.cells.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_in_two_parts_is_said_so() {
        let shown = |of: &Mesh| {
            let (mut text, mut figures) = (String::new(), json!({}));
            mesh(of, &mut text, &mut figures);
            (text, figures["parts"].clone())
        };
        let mut duct = m4gn_samples::mesh::triangles(2, 1, 1.0, 1.0);
        let (text, parts) = shown(&duct);
        assert!(!text.contains("parts") && parts == 1, "{text}");
        duct.face_owner.clear();
        duct.face_neighbour.clear();
        let (text, parts) = shown(&duct);
        assert!(text.contains("parts       4, which no face joins") && parts == 4, "{text}");
    }

    #[test]
    fn irregular_times_have_no_interval() {
        assert_eq!(spacing(&[0.0, 0.5, 1.0]), (Some(0.5), ", every 0.5 s".into()));
        // Written with six digits.
        assert!(spacing(&[0.0, 0.333333, 0.666667, 1.0]).0.is_some());
        let (interval, text) = spacing(&[0.0, 0.001, 0.0079]);
        assert_eq!(interval, None);
        assert_eq!(text, ", at irregular intervals of 0.001 to 0.0069 s");
        assert_eq!(spacing(&[1.0]), (None, String::new()));
    }
}
