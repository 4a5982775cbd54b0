//! What reading a frame of a trajectory takes, as a training does of trajectories beyond its memory.
//!
//! cargo run --release -p m4gn-train --example frame_time -- data/cylinder/0000.h5 models/cylinder-flow.safetensors

use m4gn_data::Trajectory;
use m4gn_mesh::{Error, Result};
use m4gn_model::Model;
use m4gn_train::recorded::read_within;
use std::time::Instant;

fn main() {
    if let Err(error) = run() {
        eprintln!("frame_time: {error}");
        std::process::exit(1);
    }
}

fn run() -> Result<()> {
    let usage = || Error::Input("expected a trajectory (*.h5) and a model (*.safetensors)".into());
    let mut arguments = std::env::args().skip(1);
    let (path, model) = (arguments.next().ok_or_else(usage)?, arguments.next().ok_or_else(usage)?);
    let sample = read_within(&Trajectory::open(&path)?, &Model::read(&model)?.spec, 0)?;
    // Frames in an order in which none follows the one before.
    let mut times = Vec::new();
    for i in 0..sample.n_frames {
        let began = Instant::now();
        sample.frame(i * 389 % sample.n_frames)?;
        times.push(began.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{} frames of {} kB: median {:.3} ms, nine of ten below {:.3} ms",
        times.len(),
        sample.frame_bytes() / 1000 / sample.n_frames as u64,
        1e3 * times[times.len() / 2],
        1e3 * times[times.len() * 9 / 10]
    );
    Ok(())
}
