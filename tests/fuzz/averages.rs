//! Fuzz targets: tables over time, and what is made of their columns; the series of a run that carries on.

use crate::fuzzing::fuzz;
use m4gn_averages::{Goal, Row, Watch, estimate, saved, table};

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

#[test]
fn state() {
    let mut watch = Watch::new(0.95, Goal::default());
    for i in 1..100 {
        let time = 0.1 * f64::from(i);
        watch.series.push(Row { time, value: time.sin(), weight: 0.1, surrogate: i % 7 == 0 });
    }
    let path = tempfile::tempdir().unwrap().keep().join("a.state");
    saved::write(&path, [("Cd", &watch), ("Cl rms", &watch)]).unwrap();
    let good = std::fs::read(&path).unwrap();
    std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    fuzz("state", |r| {
        let mut bytes = good.clone();
        r.damage(&mut bytes);
        // What is not as it was written is not read
        assert!(saved::parse(&bytes).is_none() || bytes == good);
        // What has the right sum all the same does no harm
        bytes.truncate(bytes.len().saturating_sub(4));
        bytes.extend(crc32c::crc32c(&bytes).to_le_bytes());
        for series in saved::parse(&bytes).unwrap_or_default() {
            let mut watch = Watch::new(0.95, Goal::default());
            watch.carry_on(series.state, &series.rows);
            watch.check();
        }
        bytes.len()
    });
}
