//! Pictures of one rollout: the recorded headline field, the predicted one and their difference at some steps; on the cells
//! of a flow, or on the shape of a body, each on its own.

use super::scene::lengths;
use super::{Case, Prediction};
use m4gn_data::Trajectory;
use m4gn_mesh::Result;
use m4gn_mesh::body::Body;
use m4gn_mesh::vector::{Vector, moved};
use m4gn_report::picture::{Palette, Panel, Scale};
use m4gn_report::seconds;
use m4gn_report::surface::View;
use m4gn_report::{CellMap, FieldPicture, VelocityRow, velocity};

/// Width of one panel, pixels.
const PANEL: usize = 520;

/// A state at the end of a step, recorded and predicted.
struct State<'a> {
    time: String,
    /// Rows of the headline field, as the recording has them.
    truth: Vec<f64>,
    found: &'a [f64],
    /// Displacement of the obstacle's points; empty without obstacle.
    motion: Vec<[f32; 3]>,
}

/// The states that were kept; None where there is nothing to see.
///
/// # Errors
/// When the trajectory cannot be read again.
pub(super) fn picture(case: &Case, rollout: &Prediction) -> Result<Option<FieldPicture>> {
    let trajectory = Trajectory::open(&case.path)?;
    let field = &case.fields[0];
    let states = rollout.kept.iter().map(|(&step, found)| {
        let frame = step * case.pace.frames;
        Ok(State {
            time: seconds(case.times[step - 1]),
            truth: super::scene::recorded(&trajectory, &field.0, frame)?,
            found,
            motion: trajectory.read_motion(frame, 1, 1)?.concat(),
        })
    });
    let states: Vec<State> = states.collect::<Result<_>>()?;
    let vector = trajectory.field(&field.0)?.vector;
    Ok(match trajectory.body() {
        Some(body) => shapes(&trajectory, body, field, &states),
        None => CellMap::from_mesh(trajectory.mesh(), PANEL).map(|map| cells(map, field, vector, &states)),
    })
}

fn cells(map: CellMap, field: &(String, String), vector: bool, states: &[State]) -> FieldPicture {
    let width = if vector { 3 } else { 1 };
    let shown: Vec<[Vec<f64>; 3]> = states
        .iter()
        .map(|s| {
            let difference: Vec<f64> = s.found.iter().zip(&s.truth).map(|(a, b)| a - b).collect();
            [&s.truth[..], s.found, &difference].map(|v| lengths(v, width))
        })
        .collect();
    let rows: Vec<VelocityRow> = states
        .iter()
        .zip(&shown)
        .map(|(s, [reference, other, difference])| VelocityRow {
            time: s.time.clone(),
            reference,
            other,
            difference,
        })
        .collect();
    velocity::picture(map, ["solver", "model"], [&field.0, &field.1], &rows)
}

fn shapes(
    trajectory: &Trajectory,
    body: &Body,
    (name, unit): &(String, String),
    states: &[State],
) -> Option<FieldPicture> {
    let fan = |f: &Vec<i32>| -> Vec<[i32; 3]> { (1..f.len() - 1).map(|i| [f[0], f[i], f[i + 1]]).collect() };
    let skin: Vec<[i32; 3]> = body.elements.skin().iter().flat_map(fan).collect();
    let at = |points: &[Vector], triangles: &[[i32; 3]]| -> Vec<[Vector; 3]> {
        triangles.iter().map(|t| t.map(|p| points[p as usize])).collect()
    };
    let scene = |u: &[f64], motion: &[[f32; 3]]| -> Vec<[Vector; 3]> {
        let mut triangles = at(&moved(&body.positions, u.as_chunks().0), &skin);
        if let Some(o) = trajectory.obstacle() {
            triangles.extend(at(&moved(&o.positions, motion), &o.triangles));
        }
        triangles
    };
    let scenes: Vec<[Vec<[Vector; 3]>; 2]> =
        states.iter().map(|s| [&s.truth[..], s.found].map(|u| scene(u, &s.motion))).collect();
    let view = View::of(scenes.iter().flatten().flatten().flatten().copied(), PANEL)?;
    // One value a triangle; the obstacle has none.
    let values = |rows: &[f64], all: usize| -> Vec<f64> {
        let of = lengths(rows, 3);
        let mean = |t: &[i32; 3]| t.iter().map(|&p| of[p as usize]).sum::<f64>() / 3.0;
        let mut values: Vec<f64> = skin.iter().map(mean).collect();
        values.resize(all, f64::NAN);
        values
    };
    let (mut maps, mut rows, mut largest) = (Vec::new(), Vec::new(), 0.0f64);
    for (state, scene) in states.iter().zip(&scenes) {
        largest = lengths(&state.truth, 3).into_iter().fold(largest, f64::max);
        let difference: Vec<f64> = state.found.iter().zip(&state.truth).map(|(a, b)| a - b).collect();
        let (all, first) = (scene[0].len(), maps.len());
        maps.extend([view.map(&scene[0]), view.map(&scene[1])]);
        let panel = |title: &str, map: usize, rows: &[f64], scale: usize| Panel {
            title: format!("{title}, t = {} s", state.time),
            map,
            values: values(rows, all),
            scale,
        };
        rows.push(vec![
            panel("solver", first, &state.truth, 0),
            panel("model", first + 1, state.found, 0),
            panel("difference", first + 1, &difference, 1),
        ]);
    }
    let scale = |label: String, high: f64, palette| Scale { label, low: 0.0, high, palette };
    Some(FieldPicture {
        maps,
        scales: vec![
            scale(format!("|{name}| [{unit}]"), largest, Palette::Viridis),
            scale(format!("|{name} model - {name} solver| [{unit}]"), 0.25 * largest, Palette::Heat),
        ],
        rows,
    })
}
