//! The comparison as a page to read and a picture to show.

use super::{Comparison, Snapshot, seconds};
use crate::foam_case::Polygons;
use m4gn_mesh::Result;
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::raster::Raster;
use m4gn_report::{CellMap, Chart, Page, Series, VelocityRow, number, percent, velocity};

/// Width of one panel, pixels.
const PANEL: usize = 520;

/// |U| of the full and the hybrid run and their difference, one row a snapshot. None where there is no 2-D mesh.
pub fn picture(polygons: &Polygons, snapshots: &[Snapshot]) -> Option<Raster> {
    let map = CellMap::from_polygons(&polygons.start, &polygons.points, PANEL)?;
    if snapshots.is_empty() {
        return None;
    }
    let rows: Vec<VelocityRow> = snapshots
        .iter()
        .map(|s| VelocityRow {
            time: seconds(s.time),
            reference: &s.full,
            other: &s.hybrid,
            difference: &s.difference,
        })
        .collect();
    Some(velocity::picture(map, ["full", "hybrid"], ["U", "m/s"], &rows).raster())
}

/// The report.
pub fn report(c: &Comparison, picture: Option<&Raster>) -> Result<Page> {
    let mut page = Page::new("Hybrid run against the full run");
    page.paragraph(&verdict(c));

    page.heading("Velocity error");
    page.paragraph(&format!(
        "Root mean square over {} cells and the solved components, over the stored times from the takeover at {} s up to the \
         horizon. Hold last: the full run's field at the takeover, kept. The full run's own root-mean-square velocity \
         is {} m/s.",
        c.cells,
        seconds(c.takeover),
        number(c.velocity_rms, 3)
    ));
    page.table(&c.error_table());
    c.field_tables().iter().for_each(|t| page.table(t));
    let chart = |y: &str, series, axis| Chart {
        x_label: "t [s]".into(),
        y_label: y.into(),
        series,
        axis,
    };
    let errors = vec![
        Series::new("hold last", &c.times, &c.hold_last_error, GREY),
        Series::new("hybrid", &c.times, &c.velocity_error, ORANGE),
    ];
    page.svg(
        &chart("error of U [m/s]", errors, Axis::FromZero).svg()?,
        "Error of the velocity at each stored time.",
    );
    let errors = vec![
        Series::new("hold last", &c.times, &c.hold_last_rmse, GREY),
        Series::new("hybrid", &c.times, &c.velocity_rmse, ORANGE),
    ];
    page.svg(
        &chart("RMSE of U up to t [m/s]", errors, Axis::FromZero).svg()?,
        "The same over all stored times up to t.",
    );

    page.heading("Fields");
    match picture {
        Some(raster) => page.png(
            &raster.png()?,
            raster.width,
            "Magnitude of the velocity, and of the difference.",
        ),
        None => page.paragraph("Pictures are drawn of 2-D cases (with empty patches) only."),
    }

    page.heading("Forces and wall time");
    page.table(&c.figure_table());
    if let Some(r) = &c.reference {
        page.paragraph(&format!(
            "Forces on patch {} from the stored p and U: pressure and viscous part, as OpenFOAM's forces function object. \
             Coefficients with speed {} m/s, length {} m, area {} m2; frequency from a least-squares sine through the lift.",
            r.patch,
            number(r.speed, 4),
            number(r.length, 4),
            number(r.area, 4)
        ));
        let pair = |a, b| {
            vec![
                Series::new("full", &c.times, a, BLUE),
                Series::new("hybrid", &c.times, b, ORANGE),
            ]
        };
        page.svg(
            &chart("drag coefficient", pair(&c.drag_a, &c.drag_b), Axis::Range).svg()?,
            "Drag.",
        );
        page.svg(
            &chart("lift coefficient", pair(&c.lift_a, &c.lift_b), Axis::Range).svg()?,
            "Lift.",
        );
    }

    page.heading("Where this comes from");
    page.paragraph(&format!("Full: {}. Hybrid: {}.", c.case_a, c.case_b));
    if let Some(summary) = &c.surrogate {
        page.listing(&serde_json::to_string_pretty(summary).unwrap_or_default());
    }
    Ok(page)
}

/// The result in a sentence or two.
fn verdict(c: &Comparison) -> String {
    let mut text = match c.replaced_fraction {
        Some(f) => format!(
            "The surrogate replaced {} of the simulated time after start-up. ",
            percent(Some(f))
        ),
        None => String::new(),
    };
    if let (Some(model), Some(hold)) = (c.velocity_rmse.last(), c.hold_last_rmse.last()) {
        text += &format!("Velocity error over all stored times: {} m/s", number(*model, 3));
        text += &format!(" (hold last: {} m/s).", number(*hold, 3));
    }
    if let (true, Some(a), Some(b)) = (c.cost.wall_measured, c.cost.wall_a, c.cost.wall_b) {
        text += &format!(
            " Wall time: {} s in full, {} s hybrid.",
            number(a, 3),
            number(b, 3)
        );
    }
    text
}
