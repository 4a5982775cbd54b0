//! What is in a trajectory of a deforming body.

use super::{megabytes, short};
use crate::Result;
use crate::dataset::{PointType, SolidTrajectory};
use crate::solids::elements::ElementKind;
use crate::solids::holding::{Score, cell_size, score};
use serde_json::{Value, json};
use std::fmt::Write;

/// `metrics`: also reads every frame and scores the predictions that need no model.
pub(super) fn describe(t: &SolidTrajectory, bytes: u64, metrics: bool) -> Result<(String, Value)> {
    let body = t.body();
    let handles = body.types.iter().filter(|&&t| t == PointType::Handle).count();
    let size = cell_size(&body.positions, &body.edges);
    let mut text = format!(
        "{}: trajectory at points, {:.1} MB, split {}\n",
        t.path().display(),
        megabytes(bytes),
        t.split().name()
    );
    let kinds: Vec<String> = ElementKind::ALL
        .iter()
        .filter_map(|&kind| {
            let count = body.elements.kind.iter().filter(|&&k| k == kind).count();
            (count > 0).then(|| format!("{count} {}", kind.name()))
        })
        .collect();
    let _ = writeln!(
        text,
        "body        {} points ({handles} handle), {}, {} edges, mean edge {size:.4} m",
        body.positions.len(),
        kinds.join(", "),
        body.edges.len()
    );
    let range = |of: fn(&crate::dataset::Material) -> f64| {
        let values = body.material.iter().map(of);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
            (a.min(v), b.max(v))
        });
        if low == high {
            format!("{low}")
        } else {
            format!("{low} to {high}")
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
        let _ = writeln!(
            text,
            "obstacle    {} points, {} triangles",
            o.positions.len(),
            o.triangles.len()
        );
    }
    let times = t.times();
    let (first, last) = (times[0], times[times.len() - 1]);
    let _ = writeln!(
        text,
        "frames      {} from {} to {} s",
        times.len(),
        short(first),
        short(last)
    );
    let frame = t.read_frame(times.len() - 1)?;
    let largest = frame
        .displacement
        .as_flattened()
        .iter()
        .fold(0f32, |m, v| m.max(v.abs()));
    let _ = writeln!(
        text,
        "last frame  largest displacement {largest:.4} m in a direction"
    );
    let mut recorded = Vec::new();
    for (name, matrix) in [("stiffness", t.stiffness()?), ("mass", t.mass()?)] {
        if let Some(m) = matrix {
            let _ = writeln!(
                text,
                "{name:<11} {} rows, {} entries",
                m.start.len() - 1,
                m.value.len()
            );
            recorded.push(name);
        }
    }
    if t.has_von_mises() {
        recorded.push("von_mises");
    }
    let mut figures = json!({
        "kind": "solid trajectory", "path": t.path(), "bytes": bytes, "split": t.split(),
        "points": body.positions.len(), "handles": handles, "elements": body.elements.len(),
        "edges": body.edges.len(), "cell_size": size, "obstacle_points": t.obstacle().map(|o| o.positions.len()),
        "frames": times.len(), "first_time": first, "last_time": last, "largest_displacement": largest,
        "recorded": recorded, "provenance": t.provenance(),
    });
    if metrics {
        let scores = score(t, 1)?;
        if let Some(gap) = scores.worst_gap {
            let _ = writeln!(
                text,
                "worst gap   {:+.4} cell sizes to the obstacle's surface",
                gap.cells
            );
        }
        let _ = writeln!(
            text,
            "{:<11} {:>10} {:>10} {:>10} {:>10} {:>10}",
            "prediction", "rmse m", "gf_h m", "gf_c m2", "mc", "ar"
        );
        for (name, Score { rmse, quality: q }) in [
            ("persistence", scores.persistence),
            ("hold first", scores.hold_first),
        ] {
            let _ = writeln!(
                text,
                "{name:<11} {rmse:>10.3e} {:>10.3e} {:>10.3e} {:>10.3e} {:>10.3e}",
                q.gf_h, q.gf_c, q.mc, q.ar
            );
        }
        figures["holding"] = json!(scores);
    }
    Ok((text, figures))
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
    let redraws: Vec<&Value> = rows
        .iter()
        .filter_map(|r| r["provenance"]["redraws"].as_array())
        .flatten()
        .collect();
    let lost: f64 = redraws.iter().filter_map(|r| r["cpu_seconds"].as_f64()).sum();
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
