//! What is lost of a recorded change on its way to groups of cells and back: the floor of a network that lives on them.
//!
//! `cargo run --release --example coarse_floor -- TRAJECTORY [STRIDE]` prints, for groups of 2, 4, 8 and 12 cells,
//! the rms of what is lost over that of the change over STRIDE frames (5), when the change is carried back as
//! one value a group, linearly, and as [`Transfer::prolong`](m4gn_structure::coarse::Transfer::prolong) does, which knows walls; in all
//! cells, and in those at walls whose values are held.

use m4gn_data::Trajectory;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{NodeType, Result};
use m4gn_structure::coarse::Coarse;
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
    println!("{} cells, {size:.5} m apart; changes over {stride} frames", mesh.n_cells());
    for cells_a_group in [2.0, 4.0, 8.0, 12.0f64] {
        let length = size * cells_a_group.powf(1.0 / mesh.dim() as f64);
        let Some(coarse) = Coarse::new(mesh, length, &comm)? else {
            continue;
        };
        for field in trajectory.fields() {
            let n = if field.vector { mesh.dim() } else { 1 };
            let frames = trajectory.read_frames(&field.name, 0, 1, count)?;
            let mut at_walls = vec![false; mesh.n_cells()];
            for face in mesh.boundary.iter().filter(|face| face.kind == NodeType::Wall) {
                at_walls[face.owner as usize] = true;
            }
            // In all cells, and at walls: of the change, and of what is lost in each way.
            let mut sums = [[0.0; 4]; 2];
            let mut any = false;
            for (before, after) in frames.iter().zip(frames.iter().skip(stride)).step_by(20) {
                let cells = after.cells.iter().zip(&before.cells);
                let faces = after.boundary.iter().zip(&before.boundary);
                let change: Vec<f32> = cells.chain(faces).map(|(a, b)| a - b).collect();
                let state: Vec<f32> = before.cells.iter().chain(&before.boundary).copied().collect();
                let restricted = coarse.transfer.restrict(&state, n, &comm);
                let walls = coarse.transfer.at_walls(&state, &restricted, &comm);
                any |= walls.iter().any(|share| *share > 0.0);
                let groups: Vec<f64> = coarse.transfer.restrict(&change, n, &comm).values
                    [..coarse.n_groups * n]
                    .iter()
                    .map(|&x| f64::from(x))
                    .collect();
                let linear = coarse.transfer.prolong(&groups, &vec![0.0; walls.len()], &comm);
                let back = coarse.transfer.prolong(&groups, &walls, &comm);
                for (i, (linear, back)) in linear.iter().zip(&back).enumerate() {
                    let (x, constant) =
                        (f64::from(change[i]), groups[coarse.group[i / n] as usize * n + i % n]);
                    let off = [x, x - constant, x - linear, x - back];
                    for sums in &mut sums[..=usize::from(at_walls[i / n])] {
                        sums.iter_mut().zip(off).for_each(|(sum, off)| *sum += off * off);
                    }
                }
            }
            if sums[0][0] == 0.0 {
                continue;
            }
            let of = |sums: [f64; 4]| {
                let [all, lost @ ..] = sums.map(f64::sqrt);
                let [constant, linear, back] = lost.map(|x| x / all);
                format!("constant {constant:.3}, linear {linear:.3}, as prolonged {back:.3}")
            };
            println!("{:>6} groups, {:>4}: {}", coarse.n_groups, field.name, of(sums[0]));
            if any {
                println!("{:>20}: {}", "at walls", of(sums[1]));
            }
        }
    }
    Ok(())
}
