use super::hosting::{Event::*, Host};
use crate::toy::Toy;

#[test]
fn frames_are_the_steps_from_its_start_on_and_rounds_precede_jumps() {
    let toy = Toy::new(0.5).biased(0.3).learning(0.0);
    let learned = toy.learned.clone();
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "timeStart": 3, "adapt": {"mode": "during"}}"#;
    let mut host = Host::of(settings, vec![toy], 6.0);
    host.run().unwrap();
    let learned = learned.borrow();
    // From a third of the time before the first jump; the state that a jump hands back begins a stretch.
    assert_eq!(learned.frames[0], (1.0, false));
    let begun: Vec<f64> = learned.frames.iter().filter(|f| f.1).map(|f| f.0).collect();
    assert_eq!(begun, [4.0, 5.5]);
    assert_eq!(learned.rounds, [2, 2]);
    assert!(
        host.log.contains("m4gn: learned from 21 frames; all adaptation so far is 5 % of"),
        "{}",
        host.log
    );
    let summary = host.ride.end();
    for entry in [
        "\"adapt_runs\": 2,",
        "\"adapt_runs_used\": 1,",
        "\"adapt_steps\": 6,",
        "\"adapt_seconds\": 1,",
        "\"adapt_error_before\": 0.3,",
        "\"adapt_error_after\": 0,",
    ] {
        assert!(summary.contains(entry), "{entry} {summary}");
    }
}

#[test]
fn without_adapt_or_with_mode_off_nothing_is_learned() {
    for adapt in ["", r#", "adapt": {"mode": "off"}"#] {
        let toy = Toy::new(0.5).learning(0.0);
        let learned = toy.learned.clone();
        let settings = format!(r#"{{"mode": "replace", "solverSteps": 5, "surrogateSteps": 2{adapt}}}"#);
        let mut host = Host::of(&settings, vec![toy], 3.0);
        host.run().unwrap();
        assert!(learned.borrow().frames.is_empty() && !host.ride.end().contains("adapt"));
    }
}

#[test]
fn an_observed_surrogate_learns_before_its_first_rollout_and_its_model_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("adapted");
    let toy = Toy::new(0.5).biased(0.3).learning(0.01);
    let learned = toy.learned.clone();
    let settings = format!(
        r#"{{"mode": "observe", "rolloutSteps": 7, "timeStart": 2, "adapt": {{"start": 1.5, "writeModel": {:?}}}}}"#,
        model.to_str().unwrap()
    );
    let mut host = Host::of(&settings, vec![toy], 4.0);
    host.run().unwrap();
    assert_eq!((learned.borrow().frames[0].0, &learned.borrow().rounds[..]), (1.5, &[7][..]));
    assert_eq!(std::fs::read_to_string(model).unwrap(), "0.01");
    assert_eq!(host.events, [Solved(40)]);
    let row = host.tables[2].lines().last().unwrap();
    assert_eq!(row.split('\t').nth(2), Some("0.01"), "with what was learned");
}

#[test]
fn a_round_needs_frames_and_room_for_a_jump() {
    // Frames from later than the first jump.
    let toy = Toy::new(0.5).learning(0.0);
    let learned = toy.learned.clone();
    let settings = r#"{"mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "adapt": {"start": 1.7}}"#;
    let mut host = Host::of(settings, vec![toy], 3.0);
    host.run().unwrap();
    assert_eq!(learned.borrow().rounds, [2; 1]);
    // No room.
    let toy = Toy::new(0.5).learning(0.0);
    let learned = toy.learned.clone();
    let mut host = Host::of(settings, vec![toy], 0.9);
    host.run().unwrap();
    assert!(learned.borrow().rounds.is_empty());
}
