//! The validation as a page: table, error over time, pictures of one trajectory.

use super::{Case, rmse::SquaredError, summaries};
use crate::{
    Result,
    compare::seconds,
    dataset::Trajectory,
    model::ModelSpec,
    report::{
        CellMap, Chart, FieldPicture, Page, Series, VelocityRow,
        chart::{BLUE, GREY, ORANGE},
        number, velocity,
    },
};

/// Width of one panel, pixels.
const PANEL: usize = 520;

/// The report on a model.
pub fn report(model: &str, spec: &ModelSpec, cases: &[Case]) -> Result<Page> {
    let mut page = Page::new("Validation of a model");
    page.paragraph(&format!(
        "Model {model}, stride {} s. Root-mean-square errors of the velocity over cells, solved components and steps, averaged \
         over trajectories; boundary values are prescribed. RMSE-1: one step from every frame at the model's stride. \
         RMSE-50 and RMSE-all: rollouts from the first frame, over its first {} s and over all. Persistence holds \
         the recorded frame one stride before, hold first the first one.",
        spec.stride,
        cases.first().map_or("-".into(), |c| seconds(c.horizon))
    ));
    for summary in summaries(cases) {
        page.heading(&format!("Split {}: {} trajectories", summary.name, summary.count));
        page.table(&summary.table());
        let mut text = format!("{} ms a step.", number(summary.step_ms, 3));
        text += &match summary.diverged {
            0 => format!(
                " Largest speed of a rollout: {} of the largest recorded.",
                number(summary.speed_ratio, 3)
            ),
            n => format!(" {n} rollouts became non-finite."),
        };
        page.paragraph(&text);
    }

    let (name, chosen) = super::that_count(cases, |c| c.split);
    page.heading("Error over time");
    let curve = |name: &str, of: fn(&Case) -> &Vec<SquaredError>, colour| {
        let longest = chosen
            .iter()
            .map(|c| &c.errors.times)
            .max_by_key(|t| t.len())
            .cloned()
            .unwrap_or_default();
        let mean = |i: usize| {
            let all: Vec<f64> = chosen
                .iter()
                .filter_map(|c| of(c).get(i))
                .map(SquaredError::rmse)
                .collect();
            if all.is_empty() {
                f64::NAN
            } else {
                all.iter().sum::<f64>() / all.len() as f64
            }
        };
        let values: Vec<f64> = (0..longest.len()).map(mean).collect();
        Series::new(name, &longest, &values, colour)
    };
    let series = vec![
        curve("hold first", |c| &c.errors.hold_first, GREY),
        curve("persistence", |c| &c.errors.persistence, BLUE),
        curve("model", |c| &c.errors.rollout, ORANGE),
    ];
    let chart = Chart {
        x_label: "time from the first frame [s]".into(),
        y_label: chosen.first().map_or(String::new(), |c| {
            format!("error of {} [{}]", c.field.0, c.field.1)
        }),
        series,
        from_zero: true,
    };
    page.svg(
        &chart.svg()?,
        &format!("Rollout error at each step, mean over the trajectories of split {name}."),
    );

    if let Some(case) = chosen.iter().find(|c| !c.errors.snapshots.is_empty())
        && let Some(picture) = picture(case)?
    {
        page.heading("Fields");
        let raster = picture.raster();
        page.png(
            &raster.png()?,
            raster.width,
            &format!("Rollout on {}.", case.path.display()),
        );
    }

    page.heading("Where this comes from");
    page.listing(&serde_json::to_string_pretty(spec).unwrap_or_default());
    let files: Vec<String> = cases
        .iter()
        .map(|c| format!("{} ({})", c.path.display(), c.split.name()))
        .collect();
    page.listing(&files.join("\n"));
    Ok(page)
}

fn picture(case: &Case) -> Result<Option<FieldPicture>> {
    let trajectory = Trajectory::open(&case.path)?;
    let Some(map) = CellMap::from_mesh(trajectory.mesh(), PANEL) else {
        return Ok(None);
    };
    let rows: Vec<VelocityRow> = case
        .errors
        .snapshots
        .iter()
        .map(|s| VelocityRow {
            time: seconds(s.time),
            reference: &s.recorded,
            other: &s.predicted,
            difference: &s.difference,
        })
        .collect();
    Ok(Some(velocity::picture(map, ["solver", "model"], &rows)))
}
