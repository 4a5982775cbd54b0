//! Higher-order dynamic mode decomposition of snapshots in a file of doubles, one state after the other: eigenvalues, and what it took.
//!
//!     cargo run --release -p m4gn-dmd --example decompose -- FILE STATES DELAYS RANK
//!
//! Prints a JSON object; bench/dmd.py compares it with PyDMD.

use m4gn_dmd::{FitSettings, OnlineDmd, Settings, Storage};
use m4gn_parallel::Comm;
use m4gn_state::Array;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, states, delays, rank] = &arguments[..] else {
        return Err("usage: decompose FILE STATES DELAYS RANK".into());
    };
    let (states, delays, rank): (usize, usize, usize) = (states.parse()?, delays.parse()?, rank.parse()?);
    let values: Vec<f64> = std::fs::read(file)?
        .chunks_exact(8)
        .filter_map(|c| Some(f64::from_le_bytes(c.try_into().ok()?)))
        .collect();
    let n = values.len() / states.max(1);
    let fields = vec![Array::solved("x", 1, vec![1.0; n])];
    let fit = FitSettings {
        window: states,
        min_snapshots: states,
        hold_out: 1,
        delays: vec![delays],
        svd_rank: vec![rank],
        unstable_modes: Some(true),
    };
    let mut linear = OnlineDmd::new(
        &Comm::serial(),
        fields,
        Settings { interval: 1.0, storage: Storage::Double, fit, held: 0, rest: Vec::new() },
    )?;
    let begun = Instant::now();
    for (k, state) in values.chunks_exact(n).enumerate() {
        linear.offer(k as f64, 1.0, &[state])?;
        // As in a run: products of five states at a time, without a fit before all are there
        if k % 5 == 4 && k + 1 < states {
            linear.fit();
        }
    }
    linear.fit();
    let both = begun.elapsed().as_secs_f64();
    let begun = Instant::now();
    let fit = linear.fit().ok_or("no fit: too few states, or nothing varies")?;
    let small = begun.elapsed().as_secs_f64();
    let products = both - small;
    let eigenvalues: Vec<String> =
        fit.model.eigenvalues().iter().map(|e| format!("[{:?}, {:?}]", e[0], e[1])).collect();
    let prediction = linear.predict(100.0).ok_or("no prediction")?;
    let mut out = vec![0.0; n];
    let begun = Instant::now();
    linear.field(0, &prediction, &mut out);
    println!(
        "{{\"eigenvalues\": [{}], \"products_s\": {products}, \"fit_s\": {small}, \"stride_s\": {}, \"bytes\": {}}}",
        eigenvalues.join(", "),
        begun.elapsed().as_secs_f64(),
        linear.snapshots().memory()
    );
    Ok(())
}
