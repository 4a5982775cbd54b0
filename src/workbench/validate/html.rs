//! The validation as a page: tables, error and gap over time, pictures of one trajectory.

use super::summary::{summaries, that_count};
use super::{Case, Prediction, pictures};
use m4gn_base::Result;
use m4gn_model::ModelSpec;
use m4gn_report::chart::{Axis, BLUE, GREY, ORANGE};
use m4gn_report::seconds;
use m4gn_report::{Chart, Page, Series};
use m4gn_train::errors::SquaredError;

type Colour = (u8, u8, u8);

/// Colours of the ways to predict.
const COLOURS: [(&str, Colour); 3] = [("hold_first", GREY), ("persistence", BLUE), ("model", ORANGE)];

/// The report on a model.
///
/// # Errors
/// When the pictured trajectory cannot be read again, or a chart fails.
pub fn report(model: &str, spec: &ModelSpec, cases: &[Case]) -> Result<Page> {
    let mut page = Page::new("Validation of a model");
    let has_elements = cases.iter().any(|c| c.predictions.iter().any(|p| p.quality.is_some()));
    let mut text = format!(
        "Model {model}, stride {} s. Root-mean-square errors over nodes, solved components and steps, averaged over \
         trajectories; boundary values, held points and the motion of an obstacle are prescribed. RMSE-1: one step from every \
         frame at the model's stride. RMSE-50 and RMSE-all: rollouts from the first frame, over its first {} s and over all. \
         Persistence holds the recorded frame one stride before, extrapolation is the line through the two before, dmd a dynamic mode decomposition fitted to the frames before, hold first \
         the first one.",
        spec.stride,
        cases.first().map_or("-".into(), |c| seconds(c.horizon))
    );
    if has_elements {
        text += " GFh and GFc: Hausdorff and chamfer distance of the points; MC and AR: mean differences of mesh continuity \
                 and aspect ratio from the true mesh; means over the rollout. Gaps to the obstacle are in mean edges, negative \
                 where it sinks in.";
    }
    page.paragraph(&text);
    for summary in summaries(cases) {
        page.heading(&format!("Split {}: {} trajectories", summary.name, summary.count));
        summary.tables().iter().for_each(|t| page.table(t));
        page.paragraph(&(summary.line() + "."));
    }

    let (name, chosen) = that_count(cases);
    let Some(first) = chosen.first() else {
        return Ok(page);
    };
    let (field, unit) = &first.fields[0];
    page.heading("Error over time");
    let series = |of: &dyn Fn(&Prediction) -> Vec<f64>, one: &dyn Fn(&[f64]) -> f64| {
        let shown = COLOURS.iter().filter_map(|(key, colour)| {
            let i = first.predictions.iter().position(|p| p.key == *key)?;
            let name = first.predictions[i].name;
            Some(combined(name, *colour, &chosen, &|c| of(&c.predictions[i]), one))
        });
        shown.collect::<Vec<_>>()
    };
    let rmse = |p: &Prediction| p.fields[0].rollout.iter().map(SquaredError::rmse).collect();
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    chart(
        &mut page,
        &format!("error of {field} [{unit}]"),
        series(&rmse, &mean),
        &format!("Rollout error at each step, mean over the trajectories of split {name}."),
    )?;
    if chosen.iter().any(|c| !c.data_gap.is_empty()) {
        let lowest = |v: &[f64]| v.iter().copied().fold(f64::INFINITY, f64::min);
        let mut curves = vec![combined("data", GREY, &chosen, &|c| c.data_gap.clone(), &lowest)];
        let of_models = series(&|p| p.gap.clone(), &lowest).into_iter();
        curves.extend(of_models.filter(|s| s.points.iter().any(|p| p.1.is_finite())));
        page.heading("Gap over time");
        chart(
            &mut page,
            "gap [mean edges]",
            curves,
            &format!(
                "Smallest gap to the obstacle, and between bodies, at each step, worst of the trajectories of split {name}."
            ),
        )?;
    }

    if let Some((case, rollout)) = chosen.iter().find_map(|c| Some((c, c.kept()?)))
        && let Some(picture) = pictures::picture(case, rollout)?
    {
        page.heading("Fields");
        let raster = picture.raster();
        let caption = format!("Rollout of {} on {}.", rollout.name, case.path.display());
        page.png(&raster.png()?, raster.width, &caption);
    }

    page.heading("Where this comes from");
    page.listing(&serde_json::to_string_pretty(spec).unwrap_or_default());
    let files: Vec<String> =
        cases.iter().map(|c| format!("{} ({})", c.path.display(), c.split.name())).collect();
    page.listing(&files.join("\n"));
    Ok(page)
}

/// One value a step of what the cases have there.
fn combined(
    name: &str,
    colour: Colour,
    cases: &[&Case],
    of: &dyn Fn(&Case) -> Vec<f64>,
    one: &dyn Fn(&[f64]) -> f64,
) -> Series {
    let longest = cases.iter().map(|c| &c.times).max_by_key(|t| t.len());
    let times = longest.cloned().unwrap_or_default();
    let columns: Vec<Vec<f64>> = cases.iter().map(|c| of(c)).collect();
    let value = |i: usize| {
        let all: Vec<f64> = columns.iter().filter_map(|c| c.get(i).copied()).collect();
        if all.is_empty() { f64::NAN } else { one(&all) }
    };
    let values: Vec<f64> = (0..times.len()).map(value).collect();
    Series::new(name, &times, &values, colour)
}

fn chart(page: &mut Page, y: &str, series: Vec<Series>, caption: &str) -> Result<()> {
    let chart = Chart {
        x_label: "time from the first frame [s]".into(),
        y_label: y.into(),
        series,
        axis: Axis::FromZero,
    };
    page.svg(&chart.svg()?, caption);
    Ok(())
}
