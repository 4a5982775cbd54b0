//! A rollout for ParaView: the true shape, the predicted one and the obstacle, step by step.

use super::{Case, scene::recorded};
use m4gn_base::{Error, Result};
use m4gn_data::Trajectory;
use m4gn_mesh::vector::{Vector, moved};
use m4gn_report::{Grid, series, write_file};
use std::path::Path;

/// Writes `truth.pvd`, `prediction.pvd` and `obstacle.pvd` with their files into a folder. Points lie where
/// they are; vectors are the displacement `D` (m) and, of the prediction, `D_true` and `error` = D - D_true.
///
/// # Errors
/// When the trajectory is none of a body or cannot be read again, no step of the rollout was kept, or a file cannot be
/// written.
pub fn write(folder: &Path, case: &Case) -> Result<()> {
    let trajectory = Trajectory::open(&case.path)?;
    let Some(body) = trajectory.body() else {
        return Err(Error::file(
            &case.path,
            "is a trajectory at cells: a series of shapes is written of a body at points",
        ));
    };
    let Some(rollout) = case.rollout() else {
        return Err(Error::Numerical(format!(
            "{}: there is no finite step of a rollout to write",
            case.path.display()
        )));
    };
    let grid = Grid::of_elements(&body.elements);
    let name = &case.fields[0].0;
    let first = recorded(&trajectory, name, 0)?;
    let states = || std::iter::once((&0, &first)).chain(&rollout.states);
    let times: Vec<_> =
        states().map(|(step, _)| (*step, trajectory.times()[step * case.pace.frames])).collect();
    let names = ["truth", "prediction", "obstacle"]
        .into_iter()
        .take(2 + usize::from(trajectory.obstacle().is_some()));
    let files = names.map(|name| series::begin(&folder.join(format!("{name}.pvd")), &times));
    let files: Vec<_> = files.collect::<Result<_>>()?;
    for (i, (step, found)) in states().enumerate() {
        let frame = step * case.pace.frames;
        let truth = recorded(&trajectory, name, frame)?;
        let error: Vec<f64> = found.iter().zip(&truth).map(|(a, b)| a - b).collect();
        let [found_at, true_at] = [found, &truth].map(|v| moved(&body.positions, v.as_chunks::<3>().0));
        let mut texts = vec![
            grid.vtu(&true_at, &[("D", 3, &truth)])?,
            grid.vtu(&found_at, &[("D", 3, found), ("D_true", 3, &truth), ("error", 3, &error)])?,
        ];
        if let Some(o) = trajectory.obstacle() {
            let motion = trajectory.read_motion(frame, 1, 1)?.concat();
            let motion: Vec<Vector> = motion.into_iter().map(|u| u.map(f64::from)).collect();
            let surface = Grid::of_triangles(&o.triangles);
            texts.push(surface.vtu(&moved(&o.positions, &motion), &[("D", 3, motion.as_flattened())])?);
        }
        for (files, text) in files.iter().zip(texts) {
            write_file(&files[i], text.as_bytes())?;
        }
    }
    Ok(())
}
