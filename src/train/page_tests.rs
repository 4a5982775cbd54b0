use super::*;
use crate::checkpoint::Checkpoint;
use crate::sample::{self, request};
use crate::tests::{data, edit, losses, run};
use crate::{Request, train_native};
use m4gn_mesh::parallel::Comm;
use std::sync::atomic::{AtomicU8, Ordering};

fn row(step: u64, seconds: f64, validation: Option<Validation>) -> Row {
    Row {
        step,
        samples: 2 * step,
        seconds,
        learning_rate: 1e-3,
        loss: 1.0 / step as f64,
        losses: vec![0.75 / step as f64, 0.25 / step as f64],
        gradient: 3.0,
        validation,
    }
}

fn page(steps: u64, limit: Option<f64>) -> TrainingPage {
    let mut config = Config::parse(&sample::config("")).unwrap();
    config.training.steps = steps;
    config.training.max_minutes = limit;
    let fields = vec!["U".into(), "p".into()];
    let notes = vec!["Resumed at step <100>.".into()];
    TrainingPage::new(Path::new("p.html"), Path::new("a&b.safetensors"), &config, fields, notes).unwrap()
}

#[test]
fn speed_and_time_left_are_those_of_the_last_intervals() {
    // 200 steps of two graphs in 30 s, 800 are left.
    let rows = [row(100, 10.0, None), row(200, 30.0, None)];
    let expected = |left| Some(Pace { samples_per_second: 400.0 / 30.0, seconds_left: left });
    assert_eq!(page(1000, None).pace(&rows), expected(120.0));
    assert_eq!(page(1000, Some(1.0)).pace(&rows), expected(30.0));
    assert_eq!(page(1000, Some(0.25)).pace(&rows), expected(0.0));
    assert_eq!(page(200, None).pace(&rows), expected(0.0));
    // Two slow intervals, and ten of a step a second.
    let seconds = |step: u64| {
        if step <= 2 { 100.0 * step as f64 } else { 198.0 + step as f64 }
    };
    let rows: Vec<Row> = (1..=12).map(|step| row(step, seconds(step), None)).collect();
    let pace = page(22, None).pace(&rows).unwrap();
    assert_eq!((pace.samples_per_second, pace.seconds_left), (2.0, 10.0));
    assert_eq!(page(22, None).pace(&[]), None);
    assert_eq!(page(22, None).pace(&[row(4, 0.0, None)]), None);
}

#[test]
fn a_page_shows_where_the_training_stands() {
    let good = Validation { rmse_1: [0.5e-6, 1e-6], rmse_horizon: [1.0, 4.0], rmse_all: [1.0, 1.0] };
    let worse = Validation { rmse_1: [0.5, 1.0], rmse_horizon: [3.0, 4.0], rmse_all: [f64::INFINITY, 1.0] };
    let rows = [row(100, 10.0, Some(good)), row(150, 20.0, None), row(200, 30.0, Some(worse))];
    let running = page(1000, None).page(&rows, &State::Running).unwrap().html();
    for part in [
        "<meta http-equiv=\"refresh\"",
        "Training of a&amp;b.safetensors",
        "<td>step</td><td>200 of 1000</td>",
        "<td>loss</td><td>0.005000</td>",
        "<td>learning rate</td><td>0.00100</td>",
        "<td>samples/s</td><td>13.3</td>",
        "<td>time left</td><td>2 min</td>",
        "<td>best: 100</td><td>5.000e-7</td><td>1.000e-6</td>",
        "<td>200</td><td>0.5000</td>",
        "Resumed at step &lt;100&gt;.",
        "batch_size = 3",
        // What was not given.
        "checkpoint_interval = 1000",
        "RMSE-all",
    ] {
        assert!(running.contains(part), "{part}: {running}");
    }
    assert_eq!(running.matches("<svg").count(), 5);
    let ended = page(1000, None).page(&rows, &State::Ended("stopped")).unwrap().html();
    assert!(ended.contains("Not running: stopped.") && !ended.contains("http-equiv"));
    assert!(!ended.contains("time left"));
    // Before the first row of the log there are no curves.
    let first = page(1000, None).page(&[], &State::Running).unwrap().html();
    assert!(first.contains("step 0 of 1000") && !first.contains("<svg"));
}

#[test]
fn long_logs_are_drawn_as_means() {
    let points: Vec<(f64, f64)> = (0..1000).map(|i| (f64::from(i), f64::from(i % 2))).collect();
    let thin = thinned(points.clone());
    assert_eq!((thin.len(), thin[0], thin[499]), (500, (0.5, 0.5), (998.5, 0.5)));
    assert_eq!(thinned(points[..500].to_vec()), points[..500]);
    assert_eq!(thinned(vec![]), []);
}

#[test]
fn times_are_said_as_people_do() {
    let said = [59.4, 60.0, 3540.0, 12_000.0].map(duration);
    assert_eq!(said, ["59 s", "1 min", "59 min", "3 h 20 min"]);
}

#[test]
fn a_file_that_cannot_be_the_page_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let out = at("a.safetensors");
    check(&at("page.html"), &[&out]).unwrap();
    std::fs::write(at("page.html"), "old").unwrap();
    check(&at("page.html"), &[&out]).unwrap();
    let message = |path: &Path| check(path, &[&out]).unwrap_err().to_string();
    assert!(message(&out).contains("a name of its own"));
    std::fs::write(&out, "").unwrap();
    assert!(
        message(&dir.path().join("../").join(dir.path().file_name().unwrap()).join("a.safetensors"))
            .contains("its own")
    );
    assert!(message(&at("none/page.html")).contains("cannot be written"));
    assert!(message(dir.path()).contains("it is a folder"));
    let made = std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap();
    assert!(made.success());
    assert!(message(&at("pipe")).contains("is no plain file"));
}

/// Rows of the log with a loss: there is none while the normalisers warm up.
fn learned(request: &Request) -> usize {
    losses(request).into_iter().filter(|loss| *loss > 0.0).count()
}

/// Points of the first curve of the loss on a page.
fn points_of_the_loss(page: &str) -> usize {
    let curve = page.split("<polyline").find(|line| line.contains("#D55E00")).unwrap();
    let (_, points) = curve.split_once("points=\"").unwrap();
    points.split('"').next().unwrap().split_whitespace().count()
}

#[test]
fn the_page_of_a_training_shows_all_of_it_and_what_was_changed() {
    let folder = data();
    let mut r = request(folder.path(), "shown", "validation_interval = 4", 8);
    r.html = Some(folder.path().join("shown.html"));
    let page = || std::fs::read_to_string(folder.path().join("shown.html")).unwrap();
    run(&r).unwrap();
    assert!(page().contains("Not running: ended at step 8."), "{}", page());
    assert!(!page().contains("http-equiv") && !page().contains("Resumed"));
    assert_eq!(points_of_the_loss(&page()), learned(&r));

    // Stopped as soon as the page says that the training runs.
    r.resume = true;
    r.steps = Some(100_000);
    edit(&r.config, "learning_rate = 2e-3", "learning_rate = 1e-3");
    let stop = AtomicU8::new(0);
    let outcome = std::thread::scope(|scope| {
        let training = scope.spawn(|| train_native(&r, &stop, &Comm::serial()));
        while !training.is_finished() && !page().contains("http-equiv") {
            std::thread::yield_now();
        }
        stop.store(1, Ordering::Relaxed);
        training.join().unwrap()
    });
    assert!(matches!(outcome, Err(Error::Interrupted(_))), "{outcome:?}");
    assert!(page().contains("Not running: interrupted at step"), "{}", page());
    assert!(page().contains("learning_rate 0.002 -&gt; 0.001, steps 8 -&gt; 100000"), "{}", page());
    assert!(!page().contains("http-equiv"));

    let step = Checkpoint::read(&r.checkpoint()).unwrap().progress.step;
    r.steps = Some(step + 4);
    run(&r).unwrap();
    assert!(page().contains(&format!("Resumed at step {step}")), "{}", page());
    assert!(!page().contains("learning_rate 0.002"));
    assert_eq!(points_of_the_loss(&page()), learned(&r));
    assert!(learned(&r) > 4);
}
