//! A rollout for ParaView: the true shape, the predicted one and the obstacle, step by step.

use super::Case;
use crate::dataset::SolidTrajectory;
use crate::report::vtu::pvd;
use crate::report::{Grid, write_file};
use crate::{Error, Result};
use std::path::Path;

type Vector = [f64; 3];

/// Writes `truth.pvd`, `prediction.pvd` and `obstacle.pvd` with their files into a folder, which is made. Points lie where
/// they are; vectors are `D` (m) and, of the prediction, `D_true` and `error` = D - D_true. The rollout is the one with
/// contact projection, where there is one.
///
/// # Errors
/// When the trajectory cannot be read again, the rollout was not kept, or a file cannot be written.
pub fn write(folder: &Path, case: &Case) -> Result<()> {
    let track = case.errors.projected.as_ref().or(case.errors.model.as_ref());
    let kept = track.map_or(&[][..], |t| &t.kept);
    if kept.is_empty() {
        return Err(Error::Numerical(format!(
            "{}: there is no finite step of a rollout to write",
            case.path.display()
        )));
    }
    std::fs::create_dir_all(folder).map_err(|e| Error::file(folder, format!("cannot be made: {e}")))?;
    let trajectory = SolidTrajectory::open(&case.path)?;
    let body = trajectory.body();
    let grid = Grid::of_elements(&body.elements);
    let wide = |v: &[[f32; 3]]| -> Vec<Vector> { v.iter().map(|u| u.map(f64::from)).collect() };
    let moved = |rest: &[Vector], u: &[Vector]| -> Vec<Vector> {
        let pairs = rest.iter().zip(u);
        pairs.map(|(x, u)| std::array::from_fn(|i| x[i] + u[i])).collect()
    };
    let mut series = [
        ("truth", Vec::new()),
        ("prediction", Vec::new()),
        ("obstacle", Vec::new()),
    ];
    // The state from which the rollout starts is the same in both.
    let start = trajectory.read_frame(0)?;
    let first = wide(&start.displacement);
    for (step, found) in std::iter::once(&first).chain(kept).enumerate() {
        let frame = trajectory.read_frame(step * case.pace.frames)?;
        let time = trajectory.times()[step * case.pace.frames];
        let truth = wide(&frame.displacement);
        let error: Vec<Vector> = found
            .iter()
            .zip(&truth)
            .map(|(a, b)| std::array::from_fn(|i| a[i] - b[i]))
            .collect();
        let mut texts = vec![
            grid.vtu(&moved(&body.positions, &truth), &[("D", &truth)])?,
            grid.vtu(
                &moved(&body.positions, found),
                &[("D", found), ("D_true", &truth), ("error", &error)],
            )?,
        ];
        if let Some(o) = trajectory.obstacle() {
            let motion = wide(&frame.obstacle);
            let surface = Grid::of_triangles(&o.triangles);
            texts.push(surface.vtu(&moved(&o.positions, &motion), &[("D", &motion)])?);
        }
        for ((name, files), text) in series.iter_mut().zip(texts) {
            let file = format!("{name}_{step:04}.vtu");
            write_file(&folder.join(&file), text.as_bytes())?;
            files.push((time, file));
        }
    }
    for (name, files) in series.iter().filter(|(_, files)| !files.is_empty()) {
        write_file(&folder.join(format!("{name}.pvd")), pvd(files).as_bytes())?;
    }
    Ok(())
}
