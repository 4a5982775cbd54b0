//! Fuzz target: tables over time, and what is made of their columns.
#![allow(unsafe_code)]

#[path = "../fuzzing/mod.rs"]
mod fuzzing;

use fuzzing::fuzz;
use m4gn_averages::{estimate, table};

#[test]
fn table() {
    let rows = (1..200)
        .map(|i| format!("{} ({} {} 0) {}\n", 0.1 * f64::from(i), (0.3 * f64::from(i)).sin(), i % 7, i));
    let good = format!("# Force\n# Time (total_x total_y total_z) Cd(f)\n{}", rows.collect::<String>());
    fuzz("table", |r| {
        let mut bytes = good.clone().into_bytes();
        match r.below(4) {
            0 => {}
            1 => {
                let at = r.below(bytes.len());
                r.damage_number(&mut bytes, at);
            }
            _ => r.damage(&mut bytes),
        }
        let text = String::from_utf8_lossy(&bytes);
        for name in ["total_y", "Cd(f)", "1"] {
            if let Ok(column) = table::column(&text, name) {
                assert_eq!(column.times.len(), column.values.len());
                let _ = estimate(&column.series(f64::NEG_INFINITY), 0.95);
            }
        }
        bytes.len()
    });
}
