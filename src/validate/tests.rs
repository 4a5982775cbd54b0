use super::*;

fn case(split: Split, pace: Pace, single: f64, rollout: &[f64], hold: &[f64]) -> Case {
    let errors = |values: &[f64]| {
        values
            .iter()
            .map(|v| SquaredError::between(&[*v], &[0.0]))
            .collect::<Vec<_>>()
    };
    let errors = Errors {
        single: errors(&vec![single; hold.len()]),
        rollout: errors(rollout),
        persistence: errors(&vec![2.0 * single; hold.len()]),
        hold_first: errors(hold),
        speed_ratio: 1.1,
        diverged: (rollout.len() < hold.len()).then(|| "step 2".into()),
        seconds: (0.4, 4),
        times: hold
            .iter()
            .enumerate()
            .map(|(i, _)| 0.2 * (i + 1) as f64)
            .collect(),
        snapshots: Vec::new(),
    };
    Case {
        path: "x.h5".into(),
        split,
        horizon: HORIZON as f64 * pace.interval,
        pace,
        field: ("U".into(), "m/s".into()),
        errors,
    }
}

/// 20 frames a step: two steps within the first 50 frames.
const PACE: Pace = Pace {
    interval: 0.01,
    frames: 20,
    steps: 3,
};

#[test]
fn figures_on_paper() {
    let c = case(Split::Test, PACE, 0.5, &[1.0, 7.0, 4.0], &[2.0, 2.0, 2.0]);
    let f = c.model();
    assert!(
        (f.rmse_1 - 0.5).abs() < 1e-15 && (f.rmse_50 - 5.0).abs() < 1e-12,
        "{f:?}"
    );
    assert!((f.rmse_all - 22.0_f64.sqrt()).abs() < 1e-12, "{f:?}");
    assert_eq!(
        c.persistence(),
        Figures {
            rmse_1: 1.0,
            rmse_50: 1.0,
            rmse_all: 1.0
        }
    );
    assert_eq!(
        c.hold_first(),
        Figures {
            rmse_1: 1.0,
            rmse_50: 2.0,
            rmse_all: 2.0
        }
    );
    // A stride beyond 50 frames: one step.
    let long = Pace {
        interval: 0.01,
        frames: 100,
        steps: 3,
    };
    assert_eq!(
        case(Split::Test, long, 0.5, &[1.0, 7.0, 4.0], &[2.0; 3])
            .model()
            .rmse_50,
        1.0
    );
}

#[test]
fn splits_are_averaged_apart_and_test_counts() {
    let cases = [
        case(Split::Train, PACE, 0.1, &[1.0; 3], &[2.0; 3]),
        case(Split::Test, PACE, 0.2, &[2.0; 3], &[4.0; 3]),
        case(Split::Test, PACE, 0.4, &[4.0; 3], &[4.0; 3]),
    ];
    let figures = json(&cases);
    assert_eq!(
        (figures["split"].as_str(), figures["trajectories"].as_u64()),
        (Some("test"), Some(2))
    );
    assert!((figures["model"]["rmse_1"].as_f64().unwrap() - 0.3).abs() < 1e-12);
    assert!((figures["model"]["rmse_50"].as_f64().unwrap() - 3.0).abs() < 1e-12);
    assert!((figures["splits"]["train"]["model"]["rmse_all"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    assert_eq!(figures["ms_per_step"], 100.0);
    assert_eq!(headline(&cases[..1]).unwrap().name, "all");
    assert!(headline(&[]).is_none());
}

#[test]
fn a_rollout_that_blew_up_has_no_figures() {
    let cases = [case(Split::Test, PACE, 0.1, &[1.0], &[2.0; 3])];
    let figures = json(&cases);
    assert!(figures["model"]["rmse_all"].is_null() && figures["model"]["rmse_1"].is_number());
    assert_eq!(figures["diverged"], 1);
    assert!(summaries(&cases)[0].table().to_string().contains("not finite"));
}
