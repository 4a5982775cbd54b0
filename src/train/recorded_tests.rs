use crate::config;
use crate::sample::{self, folder, request};
use crate::tests::{edit, run, state};
use m4gn_learn::normaliser::Normaliser;
use m4gn_learn::{Backend, Batch, Example, NativeBackend, Rollout, Workload};

/// In memory, on disk, and the first trajectory (30 frames of 68 nodes and 3 components in 4 bytes) in memory.
#[test]
fn frames_that_stay_on_disk_give_the_same_weights_bit_for_bit() {
    let folder = folder();
    for (name, resolution) in [("cells", ""), ("groups", "resolution = 0.3\n")] {
        let mut models = Vec::new();
        for (i, memory) in [None, Some(0.0), Some(24_480e-9), Some(24_479e-9)].into_iter().enumerate() {
            let training = "validation_interval = 7\nbalance = 0.5";
            let mut r = request(folder.path(), &format!("{name}{i}"), training, 14);
            edit(&r.config, "stride = 0.02\n", &format!("stride = 0.02\n{resolution}"));
            (r.memory, r.threads) = (memory, Some(1 + i % 2));
            run(&r).unwrap();
            // The model file has the ranges of the data as well.
            models.push((state(&r), std::fs::read(&r.out).unwrap()));
        }
        for (i, model) in models.iter().enumerate() {
            assert!(*model == models[0], "{name}: training {i} differs from that in memory");
        }
    }
    let mut r = request(folder.path(), "bad", "", 2);
    r.memory = Some(-1.0);
    m4gn_samples::fails(run(&r), &["--memory: found -1"]);
}

#[test]
fn a_file_that_vanishes_is_named_by_the_step_that_needs_it() {
    let folder = folder();
    let spec = m4gn_samples::model::spec();
    let path = folder.path().join("data/000.h5");
    let sample = super::read_within(&m4gn_data::Trajectory::open(&path).unwrap(), &spec, 0).unwrap();
    let sample = std::sync::Arc::new(sample);
    let work = Workload { train: vec![sample.clone()], valid: vec![sample], frames_a_step: 2, names: vec![] };
    let config = config::Config::parse(&sample::config("")).unwrap();
    let mut backend = NativeBackend::new(&config.training, &spec, &work, 2).unwrap();
    let weights = vec![0.01; m4gn_engine::backward::Layout::new(&spec).len()];
    let normaliser = Normaliser::new(&spec);
    let example = Example { sample: 0, frame: 3, mirror: false, seed: 1, weight: 1.0 };
    let batch =
        Batch { examples: &[example; 2], micro: 1, total: 2, unroll: 1, accumulate: true, learn: false };
    assert!(backend.learn(&weights, &normaliser, &batch).is_ok());
    std::fs::remove_file(&path).unwrap();
    m4gn_samples::fails(backend.learn(&weights, &normaliser, &batch), &["000.h5: cannot be read"]);
    let rollout = Rollout { sample: 0, frame: 0, steps: 1, single: false };
    assert!(backend.roll_out(&weights, &normaliser, &[rollout]).is_err());
    assert!(work.weights(&spec, 1.0).is_err());
}
