//! Trainings from data on disk to model files: they learn, and stop and go on exactly.

use m4gn_base::Error;
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_samples::training::{folder, losses, request};
use m4gn_torch::backend::TorchBackend;
use m4gn_torch::device::parse_device;
use m4gn_train::Request;
use m4gn_train::checkpoint::Checkpoint;
use std::sync::atomic::{AtomicU8, Ordering};

fn train(request: &Request, stop: &AtomicU8) -> Result<serde_json::Value, Error> {
    let device = parse_device(request.device.as_deref().unwrap_or("cpu"))?;
    m4gn_train::train(request, stop, &Comm::serial(), |task| Ok(Box::new(TorchBackend::new(task, device)?)))
}

fn run(request: &Request) -> Result<serde_json::Value, Error> {
    train(request, &AtomicU8::new(0))
}

/// Everything that the next step depends on.
fn state(request: &Request) -> (u64, Vec<Vec<f32>>) {
    let c = Checkpoint::read(&request.checkpoint()).unwrap();
    (c.progress.step, vec![c.weights, c.first, c.second, c.average.unwrap()])
}

#[test]
fn resumed_training_is_the_uninterrupted_one_bit_for_bit() {
    let folder = folder();
    let whole = request(folder.path(), "whole", "", 12);
    run(&whole).unwrap();
    // In pieces, one in the normalisers' accumulation and one across the change of the unrolling; on two threads
    // too, and interrupted wherever it happens to be.
    let mut parts = request(folder.path(), "parts", "", 3);
    run(&parts).unwrap();
    parts.resume = true;
    parts.steps = Some(8);
    parts.threads = Some(2);
    run(&parts).unwrap();
    parts.steps = Some(12);
    parts.threads = Some(1);
    let (stop, log) = (AtomicU8::new(0), parts.log());
    let outcome = std::thread::scope(|scope| {
        let training = scope.spawn(|| train(&parts, &stop));
        while !training.is_finished() {
            if std::fs::read_to_string(&log).is_ok_and(|text| text.contains("\n10,")) {
                stop.store(1, Ordering::Relaxed);
            }
            std::thread::yield_now();
        }
        training.join().unwrap()
    });
    match outcome {
        Ok(_) => {}
        Err(Error::Interrupted(message)) => assert!(message.contains("--resume"), "{message}"),
        Err(other) => panic!("{other}"),
    }
    run(&parts).unwrap();
    assert!(state(&whole) == state(&parts), "the weights differ");
    // The log has each interval once.
    let steps = |r: &Request| -> Vec<String> {
        let text = std::fs::read_to_string(r.log()).unwrap();
        text.lines().skip(1).map(|l| l.split(',').next().unwrap().to_string()).collect()
    };
    assert_eq!(steps(&whole), ["2", "4", "6", "8", "10", "12"]);
    assert_eq!(steps(&parts), ["2", "3", "4", "6", "8", "10", "12"]);
    let last = |r: &Request| losses(r).last().copied();
    assert_eq!(last(&whole), last(&parts), "the loss of the interval that was interrupted");
}

#[test]
fn training_lowers_the_loss_and_leaves_a_model() {
    let folder = folder();
    let request = request(folder.path(), "model", "validation_interval = 100", 150);
    let figures = run(&request).unwrap();
    let loss = losses(&request);
    // The first row is the normalisers' warm-up.
    assert!(loss.last().unwrap() < &(0.3 * loss[1]), "{loss:?}");
    let ratio =
        figures["model"]["rmse_1"].as_f64().unwrap() / figures["persistence"]["rmse_1"].as_f64().unwrap();
    assert!(ratio < 0.7, "one step is no better than persistence: {figures}");
    let model = Model::read(&request.out).unwrap();
    assert_eq!(model.spec.stride, 0.02);
    assert_eq!(model.spec.fields[0].dimensions, [0, 1, -1, 0, 0, 0, 0]);
    assert_eq!(model.tensors["norm.node.mean"].data.len(), 3);
    let written = std::fs::read_to_string(request.json.as_ref().unwrap()).unwrap();
    assert_eq!(written, format!("{}\n", serde_json::to_string_pretty(&figures).unwrap()));
}

#[test]
fn bfloat16_products_train_as_well() {
    let folder = folder();
    let request = request(folder.path(), "half", "precision = \"bf16\"", 60);
    run(&request).unwrap();
    let loss = losses(&request);
    assert!(loss.last().unwrap() < &(0.7 * loss[1]), "{loss:?}");
}

#[test]
fn what_does_not_fit_is_refused_before_anything_is_written() {
    let folder = folder();
    let mut first = request(folder.path(), "first", "", 2);
    run(&first).unwrap();
    let again = run(&first).unwrap_err().to_string();
    assert!(again.contains("--resume"), "{again}");
    first.resume = true;
    first.steps = Some(3);
    let text = std::fs::read_to_string(&first.config).unwrap();
    std::fs::write(&first.config, text.replace("width = 16", "width = 8")).unwrap();
    let other = run(&first).unwrap_err().to_string();
    assert!(other.contains("[model]"), "{other}");

    let message = |change: &dyn Fn(&mut Request)| {
        let mut request = request(folder.path(), "bad", "", 2);
        change(&mut request);
        let message = run(&request).unwrap_err().to_string();
        assert!(!request.out.exists() && !request.checkpoint().exists());
        message
    };
    let edit = |from: &'static str, to: &'static str| {
        message(&move |r| {
            let text = std::fs::read_to_string(&r.config).unwrap();
            std::fs::write(&r.config, text.replace(from, to)).unwrap();
        })
    };
    assert!(edit("stride = 0.02", "stride = 0.015").contains("model.stride"));
    assert!(edit("stride = 0.02", "stride = 0.2").contains("than the 41"));
    assert!(
        edit("fields = [", "fields = [{ name = \"T\", input = true, output = \"none\" }, ")
            .contains("recorded are U, p")
    );
    assert!(edit("count = 4", "count = 400").contains("400 segments"));
    assert!(message(&|r| r.device = Some("gpu".into())).contains("cuda:N"));
    assert!(message(&|r| r.data = "nowhere".into()).contains("nowhere"));
    let cut = folder.path().join("data/000.h5");
    let bytes = std::fs::read(&cut).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    assert!(message(&|_| ()).contains("000.h5"));
}

#[test]
fn what_libtorch_does_not_know_is_refused() {
    let folder = folder();
    for (key, value) in [("noise_spread", "2.0"), ("noise_correction", "0.5")] {
        let error = run(&request(folder.path(), key, &format!("{key} = {value}"), 3)).unwrap_err();
        let text = error.to_string();
        let found = format!("{key}: found {}", value.trim_end_matches(".0"));
        assert!(text.contains(&found) && text.contains("--backend native"), "{text}");
    }
}
