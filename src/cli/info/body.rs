//! What is in a trajectory of a deforming body beside its fields.

use m4gn_base::listed;
use m4gn_data::Trajectory;
use m4gn_domain::body::gap::cell_size;
use m4gn_mesh::NodeType;
use m4gn_mesh::body::{Body, Material};
use m4gn_mesh::elements::ElementKind;
use serde_json::{Value, json};
use std::fmt::Write;

/// The body and its obstacle, added to text and figures.
pub(super) fn describe(t: &Trajectory, body: &Body, text: &mut String, figures: &mut Value) {
    let handles = body.types.iter().filter(|&&t| t == NodeType::Handle).count();
    let size = cell_size(&body.positions, &body.edges);
    let kinds = ElementKind::ALL.iter().filter_map(|&kind| {
        let count = body.elements.kind.iter().filter(|&&k| k == kind).count();
        (count > 0).then(|| format!("{count} {}", kind.name()))
    });
    let _ = writeln!(
        text,
        "body        {} points ({handles} handle), {}, {} edges, mean edge {size:.4} m",
        body.positions.len(),
        listed(kinds),
        body.edges.len()
    );
    let range = |of: fn(&Material) -> f64| {
        let values = body.material.iter().map(of);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        match low == high {
            true => format!("{low}"),
            false => format!("{low} to {high}"),
        }
    };
    let _ = writeln!(
        text,
        "material    E {} Pa, nu {}, rho {} kg/m^3",
        range(|m| m.young),
        range(|m| m.poisson),
        range(|m| m.density)
    );
    if let Some(o) = t.obstacle() {
        let _ = writeln!(text, "obstacle    {} points, {} triangles", o.positions.len(), o.triangles.len());
    }
    figures["points"] = body.positions.len().into();
    figures["handles"] = handles.into();
    figures["elements"] = body.elements.len().into();
    figures["edges"] = body.edges.len().into();
    figures["cell_size"] = size.into();
    figures["obstacle_points"] = json!(t.obstacle().map(|o| o.positions.len()));
}

/// What the generator recorded of a folder's trajectories, together; None where it recorded none of them.
pub(super) fn generated(rows: &[Value]) -> Option<(String, Value)> {
    let of = |key: &str| {
        let values = rows.iter().filter_map(|r| r["provenance"][key].as_f64());
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        values
    };
    let (gaps, seconds) = (of("worst_gap"), of("cpu_seconds"));
    let (worst, median) = (*gaps.first()?, *seconds.get(seconds.len() / 2)?);
    let redraws: Vec<&Value> =
        rows.iter().filter_map(|r| r["provenance"]["redraws"].as_array()).flatten().collect();
    let lost = redraws.iter().filter_map(|r| r["cpu_seconds"].as_f64());
    // The sum of no numbers is -0.
    let lost = lost.sum::<f64>() + 0.0;
    let line = format!(
        "{} redraws, worst gap {worst:+.4} cell sizes, median {median:.1} s of processor time ({:.1} to {:.1}), redraws \
         {lost:.0} s in all",
        redraws.len(),
        seconds[0],
        seconds[seconds.len() - 1]
    );
    let figures = json!({
        "redraws": redraws.len(), "worst_gap": worst, "median_cpu_seconds": median, "redraw_cpu_seconds": lost,
    });
    Some((line, figures))
}
