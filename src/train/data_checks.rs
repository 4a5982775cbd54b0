//! What the training data cannot teach with a configuration, told before it begins: noise that dwarfs a field, fields that never change.

use m4gn_base::Result;
use m4gn_domain::Components;
use m4gn_learn::{TrainingConfig, Workload};
use m4gn_model::{ModelSpec, Output};
use m4gn_report::number;

/// Most frames of a trajectory, and most trajectories, that are looked at.
const FRAMES: usize = 16;
const TRAJECTORIES: usize = 32;

/// Changes below this, relative to the values, are what single precision makes of none.
const STILL: f64 = 2e-7;

/// A field in the training trajectories: sums over cells, components and frames.
#[derive(Clone, Debug, Default)]
struct Course {
    values: f64,
    squares: f64,
    /// Squares of what it changes by in a model step.
    changes: f64,
    count: f64,
}

impl Course {
    fn rms(&self, sum: f64) -> f64 {
        (sum / self.count.max(1.0)).max(0.0).sqrt()
    }

    /// Standard deviation.
    fn deviation(&self) -> f64 {
        self.rms(self.squares - self.values * self.values / self.count.max(1.0))
    }

    fn change(&self) -> f64 {
        self.rms(self.changes)
    }
}

/// Notes on a training before it begins: what in its data or configuration should be known.
pub(super) fn notes(work: &Workload, spec: &ModelSpec, t: &TrainingConfig) -> Result<Vec<String>> {
    let courses = courses(work, spec)?;
    let mut notes = Vec::new();
    for (field, course) in spec.fields.iter().zip(&courses) {
        // Noise is on the scale that networks see.
        let unit = if field.floor.is_some() { "of its logarithm".into() } else { field.unit() };
        let name = &field.name;
        let (deviation, change) = (course.deviation(), course.change());
        if field.output != Output::None && change <= STILL * course.rms(course.squares) {
            notes.push(format!(
                "note: {name} does not change in the training trajectories: there is nothing to learn of it. Are these the frames that \
                 were meant?"
            ));
            continue;
        }
        let noise = t.noise.get(name).copied().unwrap_or(0.0);
        if noise > deviation || (field.output != Output::None && noise > change) {
            notes.push(format!(
                "note: training.noise.{name} = {noise} {unit} is more than {name} changes by in a model step, {} {unit}, or varies by, \
                 {} {unit} (root mean squares of the training trajectories): the model learns to take away noise, and little else",
                number(change, 3),
                number(deviation, 3)
            ));
        }
    }
    Ok(notes)
}

fn courses(work: &Workload, spec: &ModelSpec) -> Result<Vec<Course>> {
    let components = Components::new(spec);
    let mut courses = vec![Course::default(); spec.fields.len()];
    for sample in work.train.iter().take(TRAJECTORIES) {
        let last = sample.n_frames.saturating_sub(work.frames_a_step);
        for frame in (0..last).step_by(last.div_ceil(FRAMES).max(1)) {
            let (now, then) = (sample.frame(frame)?, sample.frame(frame + work.frames_a_step)?);
            let rows = now.chunks_exact(components.count).zip(then.chunks_exact(components.count));
            for (now, then) in rows.take(sample.n_cells()) {
                for (&field, (&a, &b)) in components.field.iter().zip(now.iter().zip(then)) {
                    let (a, b, course) = (f64::from(a), f64::from(b), &mut courses[field]);
                    course.values += a;
                    course.squares += a * a;
                    course.changes += (b - a).powi(2);
                    course.count += 1.0;
                }
            }
        }
    }
    Ok(courses)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::folder;
    use crate::tests::run;
    use crate::{Request, recorded, sample};
    use m4gn_learn::samples::Sample;
    use m4gn_mesh::NodeType;
    use std::path::PathBuf;

    /// What is told of a training trajectory after `change`, with so much noise on U.
    fn warnings(noise: f64, change: impl Fn(&mut Sample)) -> Vec<String> {
        let folder = folder();
        let spec = m4gn_samples::model::spec();
        let trajectory = m4gn_data::Trajectory::open(folder.path().join("data/000.h5")).unwrap();
        let mut sample = recorded::read(&trajectory, &spec).unwrap();
        change(&mut sample);
        let sample = std::sync::Arc::new(sample);
        let work =
            Workload { train: vec![sample.clone()], valid: vec![sample], frames_a_step: 2, names: vec![] };
        let t = TrainingConfig { noise: [("U".to_string(), noise)].into(), ..TrainingConfig::default() };
        notes(&work, &spec, &t).unwrap()
    }

    #[test]
    fn noise_that_dwarfs_a_field_is_told() {
        assert_eq!(warnings(1e-3, |_| ()), Vec::<String>::new());
        let found = warnings(10.0, |_| ());
        assert!(found.len() == 1 && found[0].contains("training.noise.U = 10 m/s"), "{found:?}");
        let small = |sample: &mut Sample| sample.frames.iter_mut().for_each(|x| *x *= 1e-4);
        let found = warnings(1e-3, small);
        assert!(found.len() == 1 && found[0].contains("training.noise.U = 0.001 m/s"), "{found:?}");
    }

    #[test]
    fn fields_that_never_change_are_told() {
        let still = |sample: &mut Sample| {
            let first = sample.frame(0).unwrap().into_owned();
            sample.frames = first.repeat(sample.n_frames);
        };
        let found = warnings(1e-3, still);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(
            found[0].contains("U does not change") && found[1].contains("p does not change"),
            "{found:?}"
        );
    }

    #[test]
    fn the_folder_of_the_model_is_made() {
        let folder = folder();
        let mut r = sample::request(folder.path(), "a", "", 4);
        r.out = folder.path().join("new/models/a.safetensors");
        run(&r).unwrap();
        assert!(r.out.exists() && r.log().exists());
        let model = r.out.clone();
        let claimed = |out: PathBuf, json: Option<PathBuf>| {
            let own = Request { out, json, from: Some(model.clone()), ..r.clone() };
            run(&own).unwrap_err().to_string()
        };
        let message = claimed(r.log(), None);
        assert!(message.contains("a.csv: is being written by"), "{message}");
        let message = claimed(folder.path().join("b.safetensors"), Some(model.clone()));
        assert!(message.contains("a.safetensors: it would replace what is read"), "{message}");
        r.out = r.log().join("b.safetensors");
        assert!(run(&r).unwrap_err().to_string().contains("the folder of --out cannot be made"));
    }

    #[test]
    fn a_node_type_that_only_validation_has_is_refused() {
        let folder = folder();
        let path = folder.path().join("data/002.h5");
        std::fs::remove_file(&path).unwrap();
        let mut mesh = m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0);
        let walls = mesh.boundary.iter_mut().filter(|face| face.kind == NodeType::Wall);
        walls.for_each(|face| face.kind = NodeType::Symmetry);
        sample::write_trajectory_on(&path, &mesh, 2, m4gn_data::Split::Valid, 30).unwrap();
        let message = run(&sample::request(folder.path(), "a", "", 4)).unwrap_err().to_string();
        assert!(message.contains("002.h5") && message.contains("node type symmetry"), "{message}");
    }
}
