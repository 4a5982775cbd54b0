//! What a model of deforming bodies learns from the first part of recorded trajectories, on the rest of them: rollouts from where
//! the learning ends, and single strides, with the weights of the file and with adapted ones (docs/adaptation.md).
//!
//!     cargo run --release --example adapt_body -- MODEL.safetensors 0.4 '{"mode": "before"}' data/beam/0009.h5 ...

use m4gn_adapt::{Adaptation, Settings};
use m4gn_data::Trajectory;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Result};
use m4gn_model::Model;
use m4gn_step::{Field, Session, SessionOptions};
use std::path::Path;

type Points = Vec<[f64; 3]>;

/// The displacement of the body's and of the obstacle's points in all frames, m.
struct Recorded {
    body: Vec<Points>,
    obstacle: Vec<Points>,
}

/// Errors over those of holding the frame at which the learning ends, or of holding each frame for a stride.
struct Errors {
    rollout: f64,
    stride: f64,
}

fn main() -> Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [model, share, settings, files @ ..] = &words[..] else {
        return Err(Error::Input(
            "expected a model, the share of the frames to learn from, settings of adapt, and trajectories"
                .into(),
        ));
    };
    let share: f64 = share
        .parse()
        .ok()
        .filter(|share| (0.05..=0.95).contains(share))
        .ok_or_else(|| Error::Input(format!("share '{share}': expected a number from 0.05 to 0.95")))?;
    let model = Model::read(Path::new(model))?;
    println!("| trajectory | a stride: file, adapted | rollout: file, adapted | s |");
    println!("| --- | --- | --- | --- |");
    let mut all = Vec::new();
    for file in files {
        let (before, after, seconds) = one(&model, share, Settings::parse(settings)?, Path::new(file))?;
        println!(
            "| {file} | {:.3}, {:.3} | {:.3}, {:.3} | {seconds:.1} |",
            before.stride, after.stride, before.rollout, after.rollout
        );
        all.push([before.stride, after.stride, before.rollout, after.rollout]);
    }
    let figure = |i: usize| {
        let mut values: Vec<f64> = all.iter().map(|row| row[i]).collect();
        values.sort_by(f64::total_cmp);
        match values.last() {
            Some(worst) => format!("{:.3} ({worst:.3})", values[values.len() / 2]),
            None => "-".into(),
        }
    };
    println!("| median (worst) | {}, {} | {}, {} | |", figure(0), figure(1), figure(2), figure(3));
    Ok(())
}

fn one(model: &Model, share: f64, settings: Settings, file: &Path) -> Result<(Errors, Errors, f64)> {
    let trajectory = Trajectory::open(file)?;
    let (Some(body), Some(_)) = (trajectory.body(), model.spec.contact) else {
        return Err(Error::file(file, "expected a deforming body, and a model of such bodies"));
    };
    let mesh = body.mesh(trajectory.obstacle());
    let name = &model.spec.fields[0].name;
    let (recorded, times) = (read(&trajectory, name)?, trajectory.times());
    let stride = (model.spec.stride / (times[1] - times[0])).round().max(1.0) as usize;
    let cut = (share * times.len() as f64) as usize;
    let mut session = Session::new(Comm::serial(), &mesh, model, &SessionOptions::default())?;
    let before = errors(&mut session, &recorded, cut, stride)?;
    let mut adaptation = Adaptation::new(&session, &mesh, model, settings)?;
    for (frame, &time) in times.iter().enumerate().take(cut + 1) {
        let field = Field {
            name,
            components: 3,
            cells: recorded.body[frame].as_flattened(),
            boundary: recorded.obstacle[frame].as_flattened(),
        };
        adaptation.frame(time, frame == 0, &[field])?;
    }
    let outcome = adaptation.run((times.len() - 1 - cut) / stride)?;
    eprintln!("{}: {}", file.display(), outcome.note);
    session.set_weights(&mesh, &adaptation.model())?;
    let after = errors(&mut session, &recorded, cut, stride)?;
    Ok((before, after, outcome.seconds))
}

fn read(trajectory: &Trajectory, field: &str) -> Result<Recorded> {
    let states = trajectory.states(&[field])?;
    let mut recorded = Recorded { body: Vec::new(), obstacle: Vec::new() };
    let wide = |rows: &[[f32; 3]]| rows.iter().map(|row| row.map(f64::from)).collect();
    for frame in 0..trajectory.times().len() {
        let (values, obstacle) = states.read(frame)?;
        recorded.body.push(wide(values[0].cells.as_chunks().0));
        recorded.obstacle.push(wide(&obstacle));
    }
    Ok(recorded)
}

/// From the frame `cut` on.
fn errors(session: &mut Session, recorded: &Recorded, cut: usize, stride: usize) -> Result<Errors> {
    let (body, obstacle) = (&recorded.body, &recorded.obstacle);
    let frames = (cut + stride..body.len()).step_by(stride);
    let mut state = body[cut].clone();
    // One stride before it.
    let mut past = body[cut.saturating_sub(stride)].clone();
    let [mut rolled, mut held, mut single, mut kept] = [0.0; 4];
    for next in frames {
        let now = next - stride;
        let motion = [&obstacle[now][..], &obstacle[next][..]];
        let start = state.clone();
        let earlier = now.saturating_sub(stride);
        session.set_before(&past, &obstacle[earlier])?;
        session.step_body(&mut state, motion)?;
        past = start;
        rolled += square(&state, &body[next]);
        held += square(&body[cut], &body[next]);
        let mut one = body[now].clone();
        session.set_before(&body[earlier], &obstacle[earlier])?;
        session.step_body(&mut one, motion)?;
        single += square(&one, &body[next]);
        kept += square(&body[now], &body[next]);
    }
    Ok(Errors { rollout: (rolled / held).sqrt(), stride: (single / kept).sqrt() })
}

fn square(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(a, b)| (a - b).powi(2)).sum()
}
