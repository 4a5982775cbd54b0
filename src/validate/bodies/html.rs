//! The validation of a model of bodies as a page: table, error and gap over time, pictures of one trajectory.

use super::{Case, Track, summaries};
use crate::Result;
use crate::compare::seconds;
use crate::dataset::{SolidFrame, SolidTrajectory};
use crate::model::ModelSpec;
use crate::report::{
    Chart, FieldPicture, Page, Series,
    chart::{BLUE, GREY, ORANGE},
    picture::{Palette, Panel, Scale},
    surface::View,
};
use crate::validate::{rmse::SquaredError, that_count};

type Vector = [f64; 3];
type Pick = fn(&Case) -> Option<&Track>;

/// Width of one panel, pixels.
const PANEL: usize = 520;
/// Parts of the rollout after which there are pictures.
const SHOWN: [f64; 3] = [0.2, 0.6, 1.0];

/// The report on a model.
///
/// # Errors
/// When the pictured trajectory cannot be read again, or a chart fails.
pub fn report(model: &str, spec: &ModelSpec, cases: &[Case]) -> Result<Page> {
    let mut page = Page::new("Validation of a model of bodies");
    page.paragraph(&format!(
        "Model {model}, stride {} s. Root-mean-square errors of the displacement over free points, components and steps, \
         averaged over trajectories; the obstacle's motion is prescribed. RMSE-1: one step from every frame at the model's \
         stride. RMSE-50 and RMSE-all: rollouts from the first frame, over its first {} s and over all. Persistence holds \
         the recorded frame one stride before, extrapolation is the line through the two before, hold first the first \
         one. GFh and GFc: Hausdorff and chamfer distance of the points; MC and AR: mean differences of mesh continuity and \
         aspect ratio from the true mesh; means over the rollout. Gaps to the obstacle are in mean edges, negative where \
         it sinks in.",
        spec.stride,
        cases.first().map_or("-".into(), |c| seconds(c.horizon))
    ));
    for summary in summaries(cases) {
        page.heading(&format!("Split {}: {} trajectories", summary.name, summary.count));
        page.table(&summary.table());
        let mut text = summary.line() + ".";
        if summary.diverged > 0 {
            text += &format!(" {} trajectories with a non-finite rollout.", summary.diverged);
        }
        page.paragraph(&text);
    }

    let (name, chosen) = that_count(cases, |c| c.split);
    page.heading("Error over time");
    let mut series = vec![
        curve("hold first", GREY, &chosen, |c| rmse(&c.errors.hold_first)),
        curve("persistence", BLUE, &chosen, |c| rmse(&c.errors.persistence)),
    ];
    let tracks: [(&str, (u8, u8, u8), Pick); 2] = [
        ("model", ORANGE, |c| c.errors.model.as_ref()),
        ("model, projected", GREEN, |c| c.errors.projected.as_ref()),
    ];
    let there = |of: Pick| chosen.iter().any(|c| of(c).is_some());
    for (label, colour, of) in tracks.iter().filter(|t| there(t.2)) {
        series.push(curve(label, *colour, &chosen, |c| {
            of(c).map_or(Vec::new(), |t| rmse(&t.rollout))
        }));
    }
    chart(
        &mut page,
        "error of D [m]",
        series,
        true,
        &format!("Rollout error at each step, mean over the trajectories of split {name}."),
    )?;
    if chosen.iter().any(|c| !c.errors.gap.is_empty()) {
        let mut series = vec![lowest("data", GREY, &chosen, |c| c.errors.gap.clone())];
        for (label, colour, of) in tracks.iter().filter(|t| there(t.2)) {
            series.push(lowest(label, *colour, &chosen, |c| {
                of(c).map_or(Vec::new(), |t| t.gap.clone())
            }));
        }
        page.heading("Gap over time");
        chart(
            &mut page,
            "gap [mean edges]",
            series,
            true,
            &format!("Smallest gap to the obstacle at each step, worst of the trajectories of split {name}."),
        )?;
    }

    if let Some(case) = chosen.iter().find(|c| c.tracks().any(|t| !t.kept.is_empty()))
        && let Some(picture) = picture(case)?
    {
        page.heading("Shapes");
        let raster = picture.raster();
        page.png(
            &raster.png()?,
            raster.width,
            &format!(
                "Rollout on {}{}. The obstacle is grey.",
                case.path.display(),
                if case.errors.projected.is_some() {
                    ", contact projected"
                } else {
                    ""
                }
            ),
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

/// Told apart from the others by colour-blind people too.
const GREEN: (u8, u8, u8) = (0, 158, 115);

fn rmse(errors: &[SquaredError]) -> Vec<f64> {
    errors.iter().map(SquaredError::rmse).collect()
}

/// The mean over cases, step by step.
fn curve(name: &str, colour: (u8, u8, u8), cases: &[&Case], of: impl Fn(&Case) -> Vec<f64>) -> Series {
    combined(name, colour, cases, of, |v| {
        v.iter().sum::<f64>() / v.len() as f64
    })
}

/// The smallest of all cases, step by step.
fn lowest(name: &str, colour: (u8, u8, u8), cases: &[&Case], of: impl Fn(&Case) -> Vec<f64>) -> Series {
    combined(name, colour, cases, of, |v| {
        v.iter().copied().fold(f64::INFINITY, f64::min)
    })
}

fn combined(
    name: &str,
    colour: (u8, u8, u8),
    cases: &[&Case],
    of: impl Fn(&Case) -> Vec<f64>,
    one: impl Fn(&[f64]) -> f64,
) -> Series {
    let longest = cases.iter().map(|c| &c.errors.times).max_by_key(|t| t.len());
    let times = longest.cloned().unwrap_or_default();
    let columns: Vec<Vec<f64>> = cases.iter().map(|c| of(c)).collect();
    let value = |i: usize| {
        let all: Vec<f64> = columns.iter().filter_map(|c| c.get(i).copied()).collect();
        if all.is_empty() { f64::NAN } else { one(&all) }
    };
    let values: Vec<f64> = (0..times.len()).map(value).collect();
    Series::new(name, &times, &values, colour)
}

fn chart(page: &mut Page, y: &str, series: Vec<Series>, from_zero: bool, caption: &str) -> Result<()> {
    let chart = Chart {
        x_label: "time from the first frame [s]".into(),
        y_label: y.into(),
        series,
        from_zero,
    };
    page.svg(&chart.svg()?, caption);
    Ok(())
}

/// Truth, prediction and error at some steps, each on its own shape, in one view.
fn picture(case: &Case) -> Result<Option<FieldPicture>> {
    let Some(track) = case.errors.projected.as_ref().or(case.errors.model.as_ref()) else {
        return Ok(None);
    };
    let trajectory = SolidTrajectory::open(&case.path)?;
    let body = trajectory.body();
    let skin: Vec<[i32; 3]> = body
        .elements
        .skin()
        .iter()
        .flat_map(|f| {
            (1..f.len() - 1)
                .map(|i| [f[0], f[i], f[i + 1]])
                .collect::<Vec<_>>()
        })
        .collect();
    let mut steps: Vec<usize> = SHOWN
        .iter()
        .map(|part| ((part * track.kept.len() as f64).ceil() as usize).max(1))
        .filter(|&s| s <= track.kept.len())
        .collect();
    steps.dedup();
    let frames: Vec<SolidFrame> = steps
        .iter()
        .map(|s| trajectory.read_frame(s * case.pace.frames))
        .collect::<Result<_>>()?;
    let truth: Vec<Vec<Vector>> = frames
        .iter()
        .map(|f| f.displacement.iter().map(|u| u.map(f64::from)).collect())
        .collect();
    let empty = Vec::new();
    let obstacle = |f: &SolidFrame| -> Vec<[Vector; 3]> {
        let Some(o) = trajectory.obstacle() else {
            return Vec::new();
        };
        let place = crate::solids::moved(&o.positions, &f.obstacle);
        o.triangles.iter().map(|t| t.map(|p| place[p as usize])).collect()
    };
    let shape = |u: &[Vector]| -> Vec<[Vector; 3]> {
        let at = |p: i32| std::array::from_fn(|i| body.positions[p as usize][i] + u[p as usize][i]);
        skin.iter().map(|t| t.map(at)).collect()
    };
    let scenes: Vec<[Vec<[Vector; 3]>; 2]> = steps
        .iter()
        .zip(frames.iter().zip(&truth))
        .map(|(s, (frame, truth))| {
            [truth, track.kept.get(s - 1).unwrap_or(&empty)].map(|u| [shape(u), obstacle(frame)].concat())
        })
        .collect();
    let everything = scenes.iter().flatten().flatten().flatten().copied();
    let Some(view) = View::of(everything, PANEL) else {
        return Ok(None);
    };
    let mut maps = Vec::new();
    let mut rows = Vec::new();
    let length = |u: Vector| u.iter().map(|v| v * v).sum::<f64>().sqrt();
    // One value a triangle; the obstacle has none.
    let values = |of: &dyn Fn(usize) -> f64, all: usize| -> Vec<f64> {
        let mut values: Vec<f64> = skin
            .iter()
            .map(|t| t.iter().map(|&p| of(p as usize)).sum::<f64>() / 3.0)
            .collect();
        values.resize(all, f64::NAN);
        values
    };
    let mut largest = 0.0f64;
    for ((s, scene), truth) in steps.iter().zip(&scenes).zip(&truth) {
        let found = &track.kept[s - 1];
        let time = seconds(case.errors.times[s - 1]);
        let all = scene[0].len();
        largest = truth.iter().fold(largest, |m, u| m.max(length(*u)));
        maps.extend([view.map(&scene[0]), view.map(&scene[1])]);
        let panel = |title: &str, map: usize, values: Vec<f64>, scale: usize| Panel {
            title: format!("{title}, t = {time} s"),
            map,
            values,
            scale,
        };
        let last = maps.len() - 1;
        let error = |p: usize| length(std::array::from_fn(|i| found[p][i] - truth[p][i]));
        rows.push(vec![
            panel("solver", last - 1, values(&|p| length(truth[p]), all), 0),
            panel("model", last, values(&|p| length(found[p]), all), 0),
            panel("difference", last, values(&error, all), 1),
        ]);
    }
    let scale = |label: &str, high: f64, palette| Scale {
        label: label.into(),
        low: 0.0,
        high,
        palette,
    };
    Ok(Some(FieldPicture {
        maps,
        scales: vec![
            scale("|D| [m]", largest, Palette::Viridis),
            scale("|D model - D solver| [m]", 0.25 * largest, Palette::Heat),
        ],
        rows,
    }))
}
