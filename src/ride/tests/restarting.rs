use super::hosting::{Event::*, Host, from, view};
use crate::toy::{self, Toy, at};
use crate::{Action, host_of};
use m4gn_base::Error;
use m4gn_samples::fails;

/// Makes the surrogates of a run.
type Makes = fn() -> Toy;

fn schedules() -> Vec<(String, Makes)> {
    let base = r#""mode": "replace", "name": "test", "solverSteps": 5, "surrogateSteps": 3, "timeStart": 1"#;
    let toy: Makes = || Toy::new(0.5).biased(0.01);
    vec![
        (format!("{{{base}}}"), toy),
        (format!("{{{base}, \"control\": {{\"tolerance\": 0.02}}}}"), toy),
        (format!("{{{base}, \"control\": {{\"tolerance\": 0.2}}}}"), || Toy::new(0.5).jumping(1.0, 0.3)),
        (format!("{{{base}, \"control\": {{\"tolerance\": 1e-9}}}}"), toy),
        // Jumps of 3, 1 and no strides
        (
            format!(
                r#"{{{base}, "quantities": [{{"object": "probe", "result": "first", "tolerance": 0.05}}]}}"#
            ),
            toy,
        ),
    ]
}

#[test]
fn a_run_that_is_carried_on_is_the_uninterrupted_one_from_every_time() {
    for (settings, toys) in schedules() {
        let folder = tempfile::tempdir().unwrap();
        let mut whole = Host::of(&settings, toys(), 9.0);
        whole.folder = Some(folder.path().into());
        whole.report = settings.contains("quantities").then_some(0.3);
        whole.run().unwrap();
        let summary = whole.ride.end();
        let times: Vec<f64> = std::fs::read_dir(&folder)
            .unwrap()
            .filter_map(|entry| entry.unwrap().file_name().to_str()?.strip_suffix(".state")?.parse().ok())
            .collect();
        assert!(times.len() > 30, "{times:?}");
        let mut carried = 0;
        for &time in times.iter().filter(|t| **t < 8.95) {
            let mut host = Host::carried_on(&whole, &settings, toys(), time).unwrap();
            host.run().unwrap();
            assert_eq!(host.state, whole.state, "carried on at {time}: {settings}");
            assert_eq!(host.time, whole.time);
            assert_eq!(host.ride.end(), summary, "carried on at {time}: {settings}");
            assert!(host.log.contains("test goes on from its state at time"), "{}", host.log);
            carried += 1;
        }
        assert!(carried > 20, "{carried}");
    }
}

#[test]
fn a_run_that_was_stopped_in_a_jump_goes_on_with_the_rest_of_it() {
    let settings =
        r#"{"mode": "replace", "name": "test", "solverSteps": 5, "surrogateSteps": 6, "timeStart": 1}"#;
    let toys = || Toy::new(0.5).biased(0.01);
    let mut whole = Host::ran(settings, toys(), 9.0);
    let folder = tempfile::tempdir().unwrap();
    let mut stopped = Host::of(settings, toys(), 9.0);
    (stopped.folder, stopped.stop_after) = (Some(folder.path().into()), 1.9);
    // It ends at 2 s, where the jump has been handed back; the solver's step is not made.
    stopped.run().unwrap();
    assert_eq!(stopped.events, [Solved(10), Jumped(0, 2)]);
    stopped.end = 9.0;
    let mut host = Host::carried_on(&stopped, settings, toys(), 2.0).unwrap();
    assert!(host.log.contains("in a jump of which 4 steps are left"), "{}", host.log);
    host.run().unwrap();
    assert_eq!((host.state, host.ride.end()), (whole.state, whole.ride.end()));
}

#[test]
fn under_other_conditions_a_jump_is_judged_by_its_own_strides() {
    let settings = r#"{"mode": "replace", "name": "test", "solverSteps": 5, "surrogateSteps": 4}"#;
    let folder = tempfile::tempdir().unwrap();
    let mut first = Host::of(settings, Toy::new(0.5), 3.0);
    first.folder = Some(folder.path().into());
    first.run().unwrap();
    let mut host = Host::new(from(settings, Some(Toy::new(0.5)), 2.8).unwrap(), 9.0);
    (host.time, host.index, host.state) = (2.8, 28, toy::state(2.8));
    host.ride.made_under(r#"{"nu": "2"}"#).unwrap();
    let file = folder.path().join("2.8.state");
    host.ride.load(&file, host.step(), &view(&host.state)).unwrap();
    host.correctors = vec![[3, 10]; 5];
    host.correctors.extend(vec![[10, 10]; 100]);
    host.run().unwrap();
    assert_eq!(host.events[..4], [Solved(5), Jumped(0, 4), Solved(5), Jumped(0, 2)], "{}", host.log);
}

#[test]
fn states_that_do_not_fit_are_refused_by_name_and_change_nothing() {
    let settings = r#"{"mode": "replace", "name": "test", "host": "a b", "solverSteps": 5, "surrogateSteps": 3,
        "control": {"tolerance": 0.5}}"#;
    let folder = tempfile::tempdir().unwrap();
    let mut whole = Host::of(settings, Toy::new(0.5), 3.0);
    whole.folder = Some(folder.path().into());
    whole.run().unwrap();
    let refused = |toy: Toy| Host::carried_on(&whole, settings, toy, 2.1).err().unwrap();
    let other = refused(Toy::new(0.5).named("other"));
    assert!(
        matches!(other, Error::Model(_)) && other.to_string().contains("had another model, toy.model"),
        "{other}"
    );
    let file = folder.path().join("2.1.state");
    let fields = toy::state(2.1);
    let state = view(&fields);
    let mut ride = from(settings, Some(Toy::new(0.5)), 3.0).unwrap();
    let late = ride.load(&file, at(3.0, 0.1, 9.0, 30), &state);
    fails(late, &["the state at 2.1 s, and this run begins at 3 s"]);
    assert_eq!(host_of(&file).unwrap(), "a b");
    let mut damaged = std::fs::read(&file).unwrap();
    damaged[50] ^= 4;
    std::fs::write(&file, &damaged).unwrap();
    assert!(host_of(&file).is_err());
    let error = ride.load(&file, at(2.1, 0.1, 9.0, 21), &state).unwrap_err();
    assert!(matches!(error, Error::File { .. }), "{error}");
    fails(ride.load(&folder.path().join("none"), at(2.1, 0.1, 9.0, 21), &state), &["none"]);
    // The ride begins anew as if there had been no state.
    assert_eq!(
        ride.solved(at(3.1, 0.1, 9.0, 31), None).unwrap_err().status(),
        1,
        "it wants a state to measure by"
    );
    assert_eq!(ride.solved(at(3.1, 0.1, 9.0, 31), Some(&state)).unwrap().action, Action::Solve);
}
