//! What is lost of a recorded change on its way to groups of cells and back: the floor of a network that lives on them.
//!
//! `cargo run --release --example coarse_floor -- TRAJECTORY [STRIDE]` prints, for groups of 2, 4, 8 and 12 cells,
//! the rms of what is lost over that of the change over STRIDE frames (5), when the change is carried back as
//! one value a group and linearly.

use m4gn_data::Trajectory;
use m4gn_mesh::Result;
use m4gn_mesh::parallel::Comm;
use m4gn_segments::coarse::Coarse;
use std::path::Path;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let Some(path) = arguments.next() else {
        eprintln!("usage: coarse_floor TRAJECTORY [STRIDE]");
        std::process::exit(2);
    };
    let stride: usize = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(5);
    let trajectory = Trajectory::open(Path::new(&path))?;
    let (mesh, comm) = (trajectory.cells()?, Comm::serial());
    let size = m4gn_model::cell_size(mesh, &comm);
    let count = trajectory.times().len();
    println!(
        "{} cells, {size:.5} m apart; changes over {stride} frames",
        mesh.n_cells()
    );
    for cells_a_group in [2.0, 4.0, 8.0, 12.0f64] {
        let length = size * cells_a_group.powf(1.0 / mesh.dim() as f64);
        let Some(coarse) = Coarse::new(mesh, length, &comm)? else {
            continue;
        };
        for field in trajectory.fields() {
            let n = if field.vector { mesh.dim() } else { 1 };
            let frames = trajectory.read_frames(&field.name, 0, 1, count)?;
            // Of the change, of what is lost by one value a group, and by linear ones.
            let mut sums = [0.0; 3];
            for (before, after) in frames.iter().zip(frames.iter().skip(stride)).step_by(20) {
                let cells = after.cells.iter().zip(&before.cells);
                let faces = after.boundary.iter().zip(&before.boundary);
                let change: Vec<f32> = cells.chain(faces).map(|(a, b)| a - b).collect();
                let groups = coarse.transfer.restrict(&change, n, &comm);
                let groups: Vec<f64> = groups[..coarse.n_groups * n]
                    .iter()
                    .map(|&x| f64::from(x))
                    .collect();
                let linear = coarse.transfer.prolong(&groups, n, &comm);
                for (i, linear) in linear.iter().enumerate() {
                    let (x, constant) = (
                        f64::from(change[i]),
                        groups[coarse.group[i / n] as usize * n + i % n],
                    );
                    for (sum, off) in sums.iter_mut().zip([x, x - constant, x - linear]) {
                        *sum += off * off;
                    }
                }
            }
            let [all, constant, linear] = sums.map(f64::sqrt);
            println!(
                "{:>6} groups, {:>4}: constant {:.3}, linear {:.3}",
                coarse.n_groups,
                field.name,
                constant / all,
                linear / all
            );
        }
    }
    Ok(())
}
