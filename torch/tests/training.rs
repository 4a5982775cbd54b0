//! Trainings from data on disk to model files: they learn, and stop and go on exactly.

use m4gn_base::Error;
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_samples::training::{folder, interrupt, losses, request};
use m4gn_torch::backend::TorchBackend;
use m4gn_torch::device::parse_device;
use m4gn_train::Request;
use m4gn_train::checkpoint::Checkpoint;
use std::sync::atomic::AtomicU8;

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
    interrupt(&parts, |text| text.contains("\n10,"), |stop| train(&parts, stop));
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
    for (precision, steps, most) in [("fp32", 150, 0.3), ("bf16", 60, 0.7)] {
        let training = format!("validation_interval = 100\nprecision = \"{precision}\"");
        let request = request(folder.path(), precision, &training, steps);
        let figures = run(&request).unwrap();
        let loss = losses(&request);
        // The first row is the normalisers' warm-up.
        assert!(loss.last().unwrap() < &(most * loss[1]), "{loss:?}");
        let rmse = |who: &str| figures[who]["rmse_1"].as_f64().unwrap();
        let better = rmse("model") < 0.7 * rmse("persistence");
        assert!(better || precision == "bf16", "one step is no better than persistence: {figures}");
        assert_eq!(Model::read(&request.out).unwrap().tensors["norm.node.mean"].data.len(), 3);
    }
}

#[test]
fn what_libtorch_does_not_know_is_refused() {
    let folder = folder();
    let error = run(&request(folder.path(), "spread", "noise_spread = 2.0", 3)).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("noise_spread: found 2") && text.contains("--backend native"), "{text}");
    let mut request = request(folder.path(), "device", "", 3);
    request.device = Some("gpu".into());
    let text = run(&request).unwrap_err().to_string();
    assert!(text.contains("cuda:N") && !request.out.exists(), "{text}");
}
