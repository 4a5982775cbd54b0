//! Runs that are carried on from the states that were kept.

use super::*;
use crate::{Restored, State};

/// What was lost.
fn lost(restored: m4gn_base::Result<Restored>) -> String {
    match restored.unwrap() {
        Restored::Lost(message) => message,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_run_that_is_carried_on_has_the_same_bits() {
    let waves = Waves::new(&[(1.0, 0.6), (0.999, 1.3)]);
    let folder = tempfile::tempdir().unwrap();
    for storage in [Storage::Double, Storage::Single] {
        let path = folder.path().join(format!("{storage:?}/linear.snapshots"));
        let mut linear = two(storage);
        feed(&mut linear, 0..35, |k| waves.at(k));
        linear.save(&path).unwrap();
        feed(&mut linear, 35..60, |k| waves.at(k));
        linear.fit().unwrap();
        linear.jump(4.0, 31.5, 0.5);
        let state = linear.save(&path).unwrap();
        let behind = std::fs::metadata(&path).unwrap().len() as usize;
        // What is written later is none of this state's.
        feed(&mut linear, 64..70, |k| waves.at(k));
        linear.save(&path).unwrap();
        let size = std::fs::metadata(&path).unwrap().len();
        let mut other = two(storage);
        assert_eq!(other.restore(&path, state.clone()).unwrap(), Restored::Whole);
        feed(&mut other, 64..70, |k| waves.at(k));
        for strides in [1.0, 33.0] {
            let bits = |l: &OnlineDmd| {
                predicted(l, strides).map(|v| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
            };
            assert_eq!(bits(&linear), bits(&other));
        }
        other.save(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), size, "each snapshot is there once");
        // Half a record behind its own is none of this state's either.
        let mut bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..behind + 20]).unwrap();
        assert_eq!(two(storage).restore(&path, state.clone()).unwrap(), Restored::Whole);
        // A damaged tail is dropped, and said.
        let at = bytes.len() - 40;
        bytes[at] ^= 4;
        std::fs::write(&path, &bytes).unwrap();
        let late = linear.save(&folder.path().join("elsewhere")).unwrap();
        let mut third = two(storage);
        let message = lost(third.restore(&path, late));
        assert!(message.contains("checksum"), "{message}");
        assert_eq!(third.snapshots().numbers().last(), Some(68));
        assert!(third.fitted().is_none());
        // States of the same numbers, fields and interval, of another run
        let mut stranger = two(storage);
        feed(&mut stranger, 0..60, |k| Waves::new(&[(1.0, 0.6), (0.999, 1.31)]).at(k));
        stranger.save(&path).unwrap();
        let mut misled = two(storage);
        let message = lost(misled.restore(&path, state.clone()));
        assert!(message.contains("found those of another"), "{message}");
        assert!(misled.fitted().is_none() && misled.snapshots().numbers().count() == 0);
        bytes.truncate(30);
        std::fs::write(&path, &bytes).unwrap();
        let mut fourth = two(storage);
        assert!(lost(fourth.restore(&path, state)).contains("header"));
        assert_eq!(fourth.snapshots().numbers().count(), 0);
    }
}

#[test]
fn snapshots_that_someone_removed_are_written_anew_and_a_pipe_is_not_waited_for() {
    let waves = Waves::new(&[(1.0, 0.6), (0.999, 1.3)]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("post/states");
    let mut linear = seen(&waves, 35);
    linear.save(&path).unwrap();
    std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    feed(&mut linear, 35..45, |k| waves.at(k));
    let state = linear.save(&path).unwrap();
    assert_eq!(two(Storage::Double).restore(&path, state.clone()).unwrap(), Restored::Whole);
    std::fs::remove_file(&path).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    let message = lost(two(Storage::Double).restore(&path, state));
    assert!(message.contains("found a pipe or a device"), "{message}");
    let message = linear.save(&path).unwrap_err().to_string();
    assert!(message.contains("found a pipe or a device"), "{message}");
}

#[test]
fn a_file_that_is_begun_leaves_the_states_of_the_one_before() {
    let waves = Waves::new(&[(1.0, 0.6), (0.999, 1.3)]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("states");
    let mut linear = two(Storage::Double);
    let mut states = Vec::new();
    for k in 0..120 {
        feed(&mut linear, 10 * k..10 * k + 10, |k| waves.at(k));
        states.push(linear.save(&path).unwrap());
        // A run that is killed before the next time is whole has this one or the one before it.
        for state in states.iter().rev().take(2) {
            assert_eq!(two(Storage::Double).restore(&path, state.clone()).unwrap(), Restored::Whole, "{k}");
        }
    }
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    assert_eq!(files(), 2, "room is taken by two files at most");
    let taken_up = |s: &State| two(Storage::Double).restore(&path, s.clone()).unwrap() == Restored::Whole;
    assert!(states.iter().filter(|s| taken_up(s)).count() > 10);
    // Earlier ones have made room: the window begins anew, beside what is there.
    let mut other = two(Storage::Double);
    assert_eq!(other.restore(&path, states[0].clone()).unwrap(), Restored::Superseded);
    feed(&mut other, 10..20, |k| waves.at(k));
    let state = other.save(&path).unwrap();
    assert!(taken_up(&state) && taken_up(states.last().unwrap()));
    // So does a run that is carried on under other conditions.
    let mut other = two(Storage::Double);
    other.begin_beside(&path, &state);
    feed(&mut other, 1200..1210, |k| waves.at(k));
    other.save(&path).unwrap();
    assert!(taken_up(&state));
}

#[test]
fn a_sample_between_the_last_step_and_the_next_is_there_in_a_run_that_is_carried_on() {
    let waves = Waves::new(&[(1.0, 0.6), (0.999, 1.3)]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("states");
    let dt = 0.3;
    let offer = |linear: &mut OnlineDmd, k: usize| {
        let (time, u) = (dt * k as f64, waves.at(dt * k as f64));
        if linear.wants(time, dt) {
            linear.offer(time, dt, &[&u, &phi(&u)]).unwrap();
        }
    };
    let numbers = |l: &OnlineDmd| l.snapshots().numbers().collect::<Vec<_>>();
    let mut uninterrupted = two(Storage::Double);
    (0..60).for_each(|k| offer(&mut uninterrupted, k));
    let mut stopped = two(Storage::Double);
    for k in 0..40 {
        offer(&mut stopped, k);
        let mut other = two(Storage::Double);
        assert_eq!(other.restore(&path, stopped.save(&path).unwrap()).unwrap(), Restored::Whole);
        // The time as a folder's name has it.
        let (time, u) = (format!("{:.6}", dt * k as f64).parse().unwrap(), waves.at(dt * k as f64));
        other.stand(time, dt, &[&u, &phi(&u)]);
        (k + 1..60).for_each(|k| offer(&mut other, k));
        assert_eq!(numbers(&other), numbers(&uninterrupted), "carried on at {time}");
    }
}
