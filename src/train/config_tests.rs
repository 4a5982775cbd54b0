//! Configurations, right and wrong.

use super::*;
use m4gn_learn::Restart;

const SMALL: &str = r#"
    [model]
    stride = 0.05
    width = 8
    hidden_layers = 1
    activation = "relu"
    kind = "mesh-graph-net"
    layers = 1
    fields = [{ name = "U", input = true, output = "delta" }, { name = "p", input = false, output = "value" }]
    [training]
    steps = 10
    learning_rate = 1e-4
    learning_rate_end = 1e-6
    decay_start = 1000
    decay_steps = 1000
    unroll = [[0, 1], [20, 2]]
    noise = { U = 0.02 }
"#;

#[test]
fn schedule_is_the_papers() {
    let t = Config::parse(SMALL).unwrap().training;
    assert_eq!(t.learning_rate_at(0), 1e-4);
    assert_eq!(t.learning_rate_at(1000), 1e-4);
    assert!((t.learning_rate_at(1500) - 1e-5).abs() < 1e-18);
    assert!((t.learning_rate_at(5000) - 1e-6).abs() < 1e-18);
    assert_eq!((t.unroll_at(19), t.unroll_at(20)), (1, 2));
}

#[test]
fn a_restart_decays_to_the_last_step() {
    let text = SMALL.replace(
        "steps = 10\n",
        "steps = 6000\nrestarts = [{ step = 2000, learning_rate = 1e-3 }, { step = 5000, learning_rate = 1e-4 }]\n",
    );
    let t = Config::parse(&text).unwrap().training;
    assert!((t.learning_rate_at(1999) - 1e-6).abs() < 1e-8);
    assert_eq!((t.learning_rate_at(2000), t.learning_rate_at(5000)), (1e-3, 1e-4));
    assert!((t.learning_rate_at(4999) - 1e-6).abs() < 1e-8);
    assert!((t.learning_rate_at(5500) - 1e-5).abs() < 1e-18);
    assert!((t.learning_rate_at(6000) - 1e-6).abs() < 1e-18);
}

/// Half of 2 minutes is the middle of 1000 steps, at 10 updates or at 5000.
#[test]
fn a_schedule_by_time_goes_by_its_share() {
    let text = "steps = 1000\nschedule = \"time\"\nmax_minutes = 2.0\n";
    let small = SMALL.replace("steps = 10\n", text).replace("decay_start = 1000", "decay_start = 0");
    let t = Config::parse(&small).unwrap().training;
    for step in [10, 5000] {
        let places = [0.0, 60.0, 119.99, 120.0, 130.0].map(|seconds| t.place(step, seconds));
        assert_eq!(places, [0, 500, 999, 1000, 1000]);
        assert_eq!(TrainingConfig { schedule: Schedule::Updates, ..t.clone() }.place(step, 60.0), step);
    }
    assert!((t.learning_rate_at(t.place(10, 60.0)) - 1e-5).abs() < 1e-18);
}

#[test]
fn what_a_shorter_training_does_not_reach_is_named() {
    let mut t = TrainingConfig {
        steps: 1000,
        decay_start: 0,
        decay_steps: 1000,
        unroll: vec![[0, 1], [500, 4]],
        ..TrainingConfig::default()
    };
    assert_eq!(t.unreached(), Vec::<String>::new());
    t.steps = 400;
    assert_eq!(
        t.unreached(),
        ["the decay of the learning rate ends at step 1000", "unroll has 4 strides from step 500 on"]
    );
    t.restarts = vec![Restart { step: 700, learning_rate: 1e-4 }];
    assert_eq!(t.unreached()[1], "restarts has one at step 700");
}

#[test]
fn shipped_configurations_are_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut read = 0;
    let inside = |folder: &Path| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    for path in inside(&folder).chain(inside(&folder.join("paper"))).filter(|p| p.is_file()) {
        Config::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        read += 1;
    }
    assert!(read > 10, "{read} configurations");
}

#[test]
fn each_wrong_value_is_named() {
    for (from, to, key) in [
        ("width = 8", "widht = 8", "widht"),
        ("width = 8", "width = 0", "width: expected 1"),
        ("\"value\"", "\"value\", floor = -1.0", "field 'p': floor: expected a positive number"),
        ("stride = 0.05", "stride = -1.0", "stride: expected"),
        ("hidden_layers = 1", "hidden_layers = 0", "hidden_layers: expected 1"),
        ("kind = \"mesh-graph-net\"", "kind = \"gat\"", "gcn"),
        ("kind = \"mesh-graph-net\"", "kind = \"m4gn\"", "the macro stage"),
        ("[training]", "[contact]\nradius = 0.01\n[training]", "the displacement"),
        ("[training]", "[segments]\ncount = 0\n[training]", "segments.count"),
        ("[training]", "[segments]\ntau = -2.0\n[training]", "segments.tau"),
        ("[training]", "[segments]\nmethod = \"slic-x\"\n[training]", "slic-mdode"),
        ("layers = 1", "layers = 1\nlayers_after = 2", "layers_after"),
        ("\n    layers = 1", "\n    layers = 1\n    node_sums = \"both\"", "before"),
        (
            "\n    layers = 1",
            "\n    layers = 1\n    world_edges = \"apart\"",
            "world_edges: \"apart\" is of bodies",
        ),
        (
            "\n    layers = 1",
            "\n    layers = 1\n    node_rwse_steps = 65",
            "node_rwse_steps: expected 0 to 64",
        ),
        ("[[0, 1], [20, 2]]", "[[5, 1]]", "training.unroll"),
        ("{ U = 0.02 }", "{ p = 0.02 }", "training.noise.p"),
        ("[training]", "[training]\nema_decay = 1.0", "training.ema_decay"),
        ("[training]", "[training]\nnoise_spread = 0.5", "training.noise_spread"),
        (" steps = 10\n", " steps = 0\n", "training.steps"),
        ("[training]", "[training]\nschedule = \"time\"", "expected max_minutes"),
        ("[training]", "[training]\nvalidation_rollouts = 0", "training.validation_rollouts"),
        (
            "[training]",
            "[macro]\nlayers = 1\nheads = 3\nffn_width = 8\nrwse_steps = 0\ncentroids = false\noffsets = false\n[training]",
            "has no macro stage",
        ),
    ] {
        let text = SMALL.replace(from, to);
        assert_ne!(text, SMALL);
        m4gn_samples::fails(Config::parse(&text), &[key]);
    }
}

#[test]
fn without_a_kind_the_macro_table_tells() {
    let small = SMALL.replace("kind = \"mesh-graph-net\"\n", "");
    let kind = |text: &str| Config::parse(text).unwrap().architecture().unwrap().name();
    assert_eq!(kind(&small), KindName::MeshGraphNet);
    let old = small.replace("    layers = 1", "    layers_before = 1");
    let stage = "[macro]\nlayers = 1\nheads = 2\nffn_width = 8\nrwse_steps = 0\ncentroids = false\noffsets = false\n[training]";
    assert_eq!(kind(&old.replace("[training]", stage)), KindName::M4gn);
    assert_eq!(kind(&SMALL.replace("mesh-graph-net", "gcn")), KindName::Gcn);
    let switched = SMALL
        .replace("\n    layers =", "\n    node_sums = \"before\"\n    node_rwse_steps = 4\n    layers =");
    let micro = Config::parse(&switched).unwrap().architecture().unwrap().micro;
    assert_eq!((micro.node_sums, micro.node_rwse_steps), (NodeSums::Before, 4));
    let levels = SMALL.replace("mesh-graph-net", "bsms-gnn").replace("\n    layers =", "\n    levels =");
    assert_eq!(kind(&levels), KindName::BsmsGnn);
    let heads = stage.replace("heads = 2", "heads = 3");
    let message = Config::parse(&old.replace("[training]", &heads)).unwrap_err();
    assert!(message.to_string().contains("heads: 3 does not divide the width 8"));
}
