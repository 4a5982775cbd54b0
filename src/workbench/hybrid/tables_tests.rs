//! Tests of the tables.

use super::*;
use crate::hybrid::Cost;

fn record(time: f64, end: Option<f64>) -> RunRecord {
    // Two seconds of start-up
    let cost = Cost { wall: 2.0 * (2.0 + time), processor: 2.0 + time, after_takeover: time };
    let score = end.map(|end| Score {
        first: Some(0.1),
        jump: None,
        end: Some(end),
        horizons: [0.1, 0.2, 0.3],
        errors: [0.0; 3],
        hold_last: [1.0; 3],
        drag: Some(-0.02),
        unsteadiness: Some(0.5),
        replaced: Some(0.9),
        pace: Some(0.1 * (1.0 + end)),
        // Of the 4 s of the full run 3 s are behind the takeover
        solver_pace: Some(3.0 / 0.3),
        cells: 10,
        ..Score::default()
    });
    RunRecord { made_with: String::new(), cost, score, ..RunRecord::default() }
}

fn draws(n: u64) -> Vec<DrawResult> {
    (0..n)
        .map(|index| DrawResult {
            index,
            order: 100.0 - index as f64,
            full: Some(record(4.0, None)),
            runs: [("hybrid".to_string(), record(1.0, Some(index as f64)))].into(),
            ..DrawResult::default()
        })
        .collect()
}

#[test]
fn medians_and_worst_on_paper() {
    let all = draws(7);
    let names = ["hybrid".to_string()];
    let found = summary(&all, &names);
    let whole = &found[0]["runs"]["hybrid"];
    assert_eq!((whole["end"]["median"].as_f64(), whole["end"]["worst"].as_f64()), (Some(3.0), Some(6.0)));
    assert_eq!(whole["drag"]["worst"], 2.0);
    assert_eq!(whole["time"]["median"], 25.0);
    assert!(whole["jump"]["median"].is_null());
    // Counted whole, with the start-up: 3 s of 6 s, by either clock
    assert_eq!((&whole["whole"]["median"], &whole["whole_wall"]["worst"]), (&json!(50.0), &json!(50.0)));
    // The full run takes 6 s of wall time for 0.3 s; the surrogate of the last case 0.7 s a second.
    let fast = &whole["times_as_fast"]["worst"];
    assert!((fast.as_f64().unwrap() - 6.0 / 0.3 / 0.7).abs() < 1e-9, "{fast}");
    // Three bands in the order of 94 to 100, of two, two and three cases
    assert_eq!(found.as_array().unwrap().len(), 4);
    assert_eq!(found[1]["order"], json!([94.0, 95.0]));
    assert_eq!(found[3]["cases"], 3);
    assert_eq!(summary(&draws(5), &names).as_array().unwrap().len(), 1);
    let (title, table) = &summary_tables(&all, &names, "Re")[0];
    assert!(title.contains("7 cases, Re 94"), "{title}");
    assert!(table.to_string().contains("3.00 (6.00)"), "{table}");
    let table = case_table(&all, &names, "Re").to_string();
    assert!(table.contains("sheds") && table.contains("-2.00"), "{table}");
    // Of flows there is no displacement to show.
    assert!(!table.contains("D %") && table.contains("drag %"), "{table}");
}

/// One draw of a solid: the hybrid run with a force at some times, the plain one with none.
#[test]
fn what_solids_have_is_shown_and_a_dash_where_it_is_not_known() {
    let solid = |reaction: Option<f64>, left: Option<&str>| {
        let mut run = record(1.0, Some(0.5));
        let score = run.score.as_mut().unwrap();
        (score.drag, score.unsteadiness) = (None, None);
        (score.displacement, score.range) = (Some(0.2), Some(0.0123));
        (score.reaction, score.reaction_max) = (reaction, reaction.map(|r| 2.0 * r));
        score.stress = reaction.map(|r| 10.0 * r);
        score.reaction_of_solver = reaction.map(|r| 0.5 * r);
        score.reaction_of_range = reaction.map(|r| 0.25 * r);
        score.reaction_of_range_of_surrogate = reaction.map(|r| 0.75 * r);
        score.reaction_left_out = left.map(Into::into);
        run
    };
    let mut draw = draws(1).remove(0);
    let left = "reaction force on clamp: compared at 1 of 4 times";
    draw.runs =
        [("hybrid".to_string(), solid(Some(0.04), Some(left))), ("loose".to_string(), solid(None, None))]
            .into();
    let all = [draw];
    let names = ["hybrid".to_string(), "loose".to_string()];
    let table = case_table(&all, &names, "depth").to_string();
    let row = |name: &str| {
        let line = table.lines().find(|l| l.split_whitespace().nth(2) == Some(name));
        line.unwrap_or_else(|| panic!("{table}")).split_whitespace().map(str::to_string).collect::<Vec<_>>()
    };
    // Of 'D %', 'stress %' and 'D/range %', of the force
    let hybrid = row("hybrid").join(" ");
    assert!(hybrid.contains("20.0 40.0 1.23") && hybrid.contains("4.00 2.00 8.00 1.00 3.00"), "{table}");
    assert!(row("loose").join(" ").contains("20.0 - 1.23 - - - - -"), "{table}");
    assert_eq!(remarks(&all), [format!("0000 hybrid: {left}")]);
    let found = &summary(&all, &names)[0]["runs"];
    assert!(found["loose"]["reaction"]["worst"].is_null());
}
