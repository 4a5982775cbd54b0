//! The validation as a page: table, error over time, pictures of one trajectory.

use super::{Case, headline, rmse::SquaredError, summaries};
use crate::{
    Result,
    compare::seconds,
    dataset::{Split, Trajectory},
    mesh::BoundaryFace,
    model::ModelSpec,
    report::{
        CellMap, Chart, FieldPicture, Page, Series,
        chart::{BLUE, GREY, ORANGE},
        number,
        picture::{Palette, Panel, Scale},
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

    let chosen = chosen(cases);
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
        y_label: "error of U [m/s]".into(),
        series,
        from_zero: true,
    };
    let name = headline(cases).map_or("all", |s| s.name);
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

/// The cases of the headline.
fn chosen(cases: &[Case]) -> Vec<&Case> {
    let test: Vec<&Case> = cases.iter().filter(|c| c.split == Split::Test).collect();
    if test.is_empty() {
        cases.iter().collect()
    } else {
        test
    }
}

fn picture(case: &Case) -> Result<Option<FieldPicture>> {
    let trajectory = Trajectory::open(&case.path)?;
    let mesh = trajectory.mesh();
    let [i, j] = mesh.directions[..] else {
        return Ok(None);
    };
    let flat = |p: &[f64; 3]| [p[i], p[j]];
    let centres: Vec<[f64; 2]> = mesh.cell_centres.iter().map(flat).collect();
    let face = |b: &BoundaryFace| {
        // Outward as seen from the owner, whatever the file says: a picture must not fall to pieces over a sign.
        let (centre, owner, area) = (flat(&b.centre), centres[b.owner as usize], flat(&b.area));
        let sign = ((centre[0] - owner[0]) * area[0] + (centre[1] - owner[1]) * area[1]).signum();
        (centre, area.map(|a| sign * a))
    };
    let boundary: Vec<_> = mesh.boundary.iter().map(face).collect();
    let Some(map) = CellMap::from_centres(&centres, &boundary, PANEL) else {
        return Ok(None);
    };
    let all = || case.errors.snapshots.iter();
    // Of the recorded ones: a model that runs away must not darken the others.
    let speed = all().flat_map(|s| &s.recorded).copied().fold(0.0, f64::max);
    let scales = vec![
        Scale {
            label: "|U| [m/s]".into(),
            low: 0.0,
            high: speed,
            palette: Palette::Viridis,
        },
        Scale {
            label: "|U model - U solver| [m/s]".into(),
            low: 0.0,
            high: 0.5 * speed,
            palette: Palette::Heat,
        },
    ];
    let rows = all()
        .map(|s| {
            let panel = |name: &str, values: &Vec<f64>, scale| Panel {
                title: format!("{name}, t = {} s", seconds(s.time)),
                values: values.clone(),
                scale,
            };
            vec![
                panel("solver", &s.recorded, 0),
                panel("model", &s.predicted, 0),
                panel("difference", &s.difference, 1),
            ]
        })
        .collect();
    Ok(Some(FieldPicture { map, scales, rows }))
}
