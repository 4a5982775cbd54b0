//! `m4gn train` from outside: its files, its refusals, and how the process ends.

use crate::program::{failure, figures, names, refused, run_in, success};
use m4gn_data::Split;
use m4gn_engine::torch::LIBRARY;
use m4gn_mesh::NodeType;
use m4gn_model::Model;
use m4gn_samples::training as sample;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

/// Data, and a configuration whose segments need the modes of PETSc and SLEPc.
fn folder() -> tempfile::TempDir {
    let folder = sample::folder();
    let config = sample::config("").replace("\"metis\"", "\"slic-md\"");
    std::fs::write(folder.path().join("config.toml"), config).unwrap();
    folder
}

fn train(folder: &Path, name: &str, extra: &[&str]) -> Output {
    run_in(folder, &[&["train", "--data", "data", "--config", "config.toml", "--out", name], extra].concat())
}

/// What a training says that ends well.
fn trained(folder: &Path, name: &str, extra: &[&str]) -> String {
    let output = train(folder, name, extra);
    success(&output);
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// What a command prints.
fn m4gn(folder: &Path, arguments: &[&str]) -> String {
    success(&run_in(folder, arguments))
}

#[test]
fn a_training_takes_a_suggested_configuration() {
    let folder = sample::folder();
    let in_minutes = |minutes: &str, data: &str, out: &str| {
        run_in(folder.path(), &["suggest", data, "--minutes", minutes, "--out", out])
    };
    let suggest = |data: &str, out: &str| in_minutes("0.05", data, out);
    let said = success(&suggest("data", "config.toml"));
    // Of three trajectories one is for validation; 6 x 4 rectangles are two triangles each.
    assert!(said.starts_with("2 trajectories of 48 nodes, "), "{said}");
    assert!(said.contains("\nm4gn train --data \"data\" --config \"config.toml\" --out "), "{said}");
    let config = std::fs::read_to_string(folder.path().join("config.toml")).unwrap();
    for words in [
        "stride = 0.01 ",
        "{ name = \"U\", input = true, output = \"delta\" }",
        "{ name = \"p\", input = true, output = \"value\" }",
        "max_minutes = 0.05\n",
    ] {
        assert!(config.contains(words), "{words}: {config}");
    }
    // Its schedule goes by time, which ends the training.
    let said = trained(folder.path(), "a.safetensors", &["--steps", "2"]);
    assert!(said.contains(": max_minutes reached"), "{said}");
    assert!(folder.path().join("a.safetensors").is_file());

    refused(&suggest("data", "data/000.h5"), "it would replace what is read (data)");
    let edited = format!("# edited\n{config}");
    std::fs::write(folder.path().join("config.toml"), &edited).unwrap();
    refused(
        &suggest("data", "config.toml"),
        "config.toml: is there already: give another --out, or delete it",
    );
    assert_eq!(std::fs::read_to_string(folder.path().join("config.toml")).unwrap(), edited);
    refused(&in_minutes("1e-6", "data", "none.toml"), "0.000001 minutes are too few");
    let valid = folder.path().join("valid");
    std::fs::create_dir(&valid).unwrap();
    sample::write_trajectory(&valid.join("000.h5"), 0, Split::Valid, 8).unwrap();
    refused(&suggest("valid", "none.toml"), "no trajectory of split `train`");
    assert!(!folder.path().join("none.toml").exists());
}

#[test]
fn a_model_is_trained_carried_on_and_trained_further() {
    let folder = folder();
    // Three trajectories of 30 frames, 68 nodes and 3 components in 4 bytes.
    let said = trained(folder.path(), "a.safetensors", &["--steps", "4"]);
    assert!(said.contains("frames: 0.0734 MB in memory"), "{said}");
    // The same 50 recorded frames as in `m4gn validate`, with their time
    assert!(said.contains("(RMSE-50 over "), "{said}");
    // The loss of each field by its name, and which of them is validated
    for words in [
        " (U ",
        ", p ",
        "validation of U at step 4: RMSE-1 ",
        "validation of p at step 4: RMSE-1 ",
        "best at step 4, U: RMSE-1 ",
    ] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let said = trained(folder.path(), "s.safetensors", &["--steps", "4", "--memory", "5e-5"]);
    let expected =
        "frames: 0.0734 MB in all, 0.0490 MB of 2 trajectories in memory; 1 are read frame by frame";
    assert!(said.contains(expected), "{said}");
    for file in ["a.safetensors", "a.checkpoint", "a.csv"] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
    assert!(failure(&train(folder.path(), "a.safetensors", &[])).contains("--resume"));
    assert!(
        trained(folder.path(), "a.safetensors", &["--resume", "--steps", "6"]).contains("resumed at step 4")
    );
    // A model that was removed is written again, with its weights, though there is nothing left to learn
    let model = folder.path().join("a.safetensors");
    let weights = || {
        let bytes = std::fs::read(&model).unwrap();
        let (length, rest) = bytes.split_first_chunk::<8>().unwrap();
        rest[u64::from_le_bytes(*length) as usize..].to_vec()
    };
    let before = weights();
    std::fs::remove_file(&model).unwrap();
    trained(folder.path(), "a.safetensors", &["--resume", "--steps", "6"]);
    assert!(weights() == before);
    let options = ["--from", "a.safetensors", "--steps", "2"];
    trained(folder.path(), "b.safetensors", &options);
    // No weight depends on the resolution: a model goes on with another one.
    let config = sample::config("").replacen("[model]", "[model]\n        resolution = 0.5", 1);
    std::fs::write(folder.path().join("config.toml"), config).unwrap();
    let said = trained(folder.path(), "c.safetensors", &options);
    assert!(
        said.contains("resolution: off in the model to start from, 0.5 m in the configuration"),
        "{said}"
    );
    assert!(m4gn(folder.path(), &["info", "c.safetensors"]).contains("resolution"));
}

/// Keys of a network without a macro stage, in place of those of the sample.
fn of_kind(config: &str, kind: &str, depth: &str) -> String {
    let (before, rest) = config.split_once("[macro]").unwrap();
    let (_, after) = rest.split_once("[segments]").unwrap();
    let before = before
        .replace("layers_before = 1", &format!("kind = \"{kind}\"\n        {depth} = 2"))
        .replace("layers_after = 1", "");
    format!("{before}[segments]{after}")
}

/// A configuration of another kind; without a `depth` one that has a macro stage.
fn config_of(kind: &str, depth: &str) -> String {
    match depth {
        "" => sample::config("").replacen("[model]", &format!("[model]\n        kind = \"{kind}\""), 1),
        _ => of_kind(&sample::config(""), kind, depth),
    }
}

#[test]
fn every_kind_learns_one_trajectory_by_heart_and_is_validated() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    std::fs::create_dir(&data).unwrap();
    for (file, split) in [("000.h5", Split::Train), ("001.h5", Split::Valid)] {
        sample::write_trajectory(&data.join(file), 0, split, 8).unwrap();
    }
    for (kind, depth) in [
        ("m4gn", ""),
        ("eagle", ""),
        ("mesh-graph-net", "layers"),
        ("gcn", "layers"),
        ("bsms-gnn", "levels"),
        ("g-u-net", "levels"),
    ] {
        let config = config_of(kind, depth)
            .replace("width = 16", "width = 32")
            .replace("{ U = 0.01, p = 0.01 }", "{}")
            .replace("mirror = true", "decay = \"cosine\"")
            .replace("[6, 2]", "[9999, 2]")
            .replace("normaliser_steps", "validation_interval = 1000\n        normaliser_steps");
        std::fs::write(folder.path().join("config.toml"), config).unwrap();
        let name = format!("{kind}.safetensors");
        trained(folder.path(), &name, &["--steps", "1000", "--threads", "1", "--json", "f.json"]);
        let found = figures(folder.path().join("f.json"));
        let rmse = |who: &str| found[who]["rmse_1"].as_f64().unwrap();
        let left = rmse("model") / rmse("persistence");
        println!("{kind}: {left:.4} of persistence");
        assert!(left < 0.05, "{kind}: {found}");
        let said = m4gn(folder.path(), &["info", &name]);
        let network = said.lines().find(|l| l.starts_with("architecture ")).unwrap();
        assert!(network.contains(&format!("kind {kind}, ")) && network.contains("width 32"), "{said}");
        let layers = match depth {
            "" => "layers_after 1, layers_before 1, segment_transformer (".to_string(),
            _ => format!("{depth} 2"),
        };
        assert!(network.contains(&layers) && said.contains("\nsegments") == depth.is_empty(), "{said}");
        m4gn(folder.path(), &["validate", "--model", &name, "--data", "data", "--json", "v.json"]);
        assert!(std::fs::read_to_string(folder.path().join("v.json")).unwrap().contains("rmse"));
    }
}

/// What a training says of its validation is what 'm4gn validate' says of the model: of flows whose pressure has no level, too.
#[test]
fn a_training_and_a_validation_measure_alike() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("data")).unwrap();
    let mut mesh = m4gn_samples::mesh::triangles(6, 4, 1.5, 1.0);
    // Closed, so that a rollout's pressure drifts
    mesh.boundary.iter_mut().filter(|b| b.kind == NodeType::Outlet).for_each(|b| b.kind = NodeType::Wall);
    for (number, split) in [Split::Train, Split::Valid, Split::Valid].into_iter().enumerate() {
        sample::write_trajectory_on(&at(&format!("data/{number}.h5")), &mesh, number, split, 70 - 9 * number)
            .unwrap();
    }
    for output in ["value", "delta"] {
        let config = sample::config("validation_interval = 8").replace(
            "name = \"p\", input = true, output = \"value\"",
            &format!("name = \"p\", input = true, output = \"{output}\""),
        );
        std::fs::write(at("config.toml"), config).unwrap();
        let out = format!("{output}.safetensors");
        trained(folder.path(), &out, &["--steps", "8", "--json", "f.json"]);
        m4gn(
            folder.path(),
            &["validate", "--model", &out, "--data", "data", "--split", "valid", "--json", "v.json"],
        );
        let (training, validation) = (figures(at("f.json")), figures(at("v.json")));
        let log = std::fs::read_to_string(at(&format!("{output}.csv"))).unwrap();
        let (head, last) = (log.lines().next().unwrap(), log.lines().last().unwrap());
        let of_log = |column: &str| -> f64 {
            let place = head.split(',').position(|c| c == column).unwrap();
            last.split(',').nth(place).unwrap().parse().unwrap()
        };
        for (key, held) in [("rmse_1", "persistence"), ("rmse_50", "hold_first"), ("rmse_all", "hold_first")]
        {
            let number = |v: &serde_json::Value| v.as_f64().unwrap();
            let p = &validation["fields"]["p"];
            let column = format!("{held}_{}", &key[5..]);
            for (found, expected) in [
                (number(&training["model"][key]), number(&validation["model"][key])),
                (of_log(key), number(&validation["model"][key])),
                (of_log(&format!("{key}_p")), number(&p["model"][key])),
                (number(&training[held][key]), number(&validation[held][key])),
                (of_log(&format!("{column}_p")), number(&p[held][key])),
            ] {
                assert!((found / expected - 1.0).abs() < 1e-4, "p {output}, {key}: {found} and {expected}");
            }
        }
    }
}

#[test]
fn a_training_has_its_files_for_itself() {
    let folder = folder();
    // Of another ending, with the same checkpoint and log
    let held = m4gn_base::lock::file(&folder.path().join("a.checkpoint")).unwrap();
    let expected = format!("a.checkpoint: is being written by process {} on ", std::process::id());
    refused(&train(folder.path(), "a.safetensors", &["--steps", "4"]), &expected);
    assert!(!folder.path().join("a.csv").exists() && !folder.path().join("a.safetensors").exists());
    drop(held);
    trained(folder.path(), "a.safetensors", &["--steps", "4"]);
    assert!(names(folder.path()).iter().all(|name| !name.contains("lock")));
    // A model whose checkpoint was deleted is kept, unless it is trained further in its own place
    std::fs::remove_file(folder.path().join("a.checkpoint")).unwrap();
    let kept = "a.safetensors: is there already: give another --out";
    refused(&train(folder.path(), "a.safetensors", &["--steps", "4"]), kept);
    trained(folder.path(), "a.safetensors", &["--steps", "4", "--from", "a.safetensors"]);
}

#[test]
fn a_model_says_what_it_was_trained_on_and_an_older_one_can_be_told() {
    let folder = folder();
    trained(folder.path(), "a.safetensors", &["--steps", "4"]);
    let mut model = Model::read(folder.path().join("a.safetensors")).unwrap();
    let ranges = model.spec.trained_on.clone().unwrap();
    // Triangles in 6 x 4 rectangles of 0.25 x 0.25; speeds are 1 and the vortex's.
    let [low, high] = ranges.cell_size;
    assert!(0.05 < low && low <= high && high < 0.25, "{low} to {high}");
    let [slow, fast] = ranges.speed.unwrap();
    assert!(1.0 < slow && slow <= fast && fast < 3.0, "{slow} to {fast}");
    let inputs: Vec<&str> = ranges.inputs.iter().map(|i| i.field.as_str()).collect();
    assert_eq!(inputs, ["U", "p"]);

    model.spec.trained_on = None;
    model.write(folder.path().join("old.safetensors")).unwrap();
    // Such a model stays what it is, whatever a configuration says of nodes and segments, and nothing else is said.
    let config = sample::config("").replacen("[model]", "[model]\n        resolution = 0.5", 1);
    std::fs::write(folder.path().join("config.toml"), config).unwrap();
    let options = ["--from", "old.safetensors", "--steps", "0", "--json", "new.json"];
    let said = trained(folder.path(), "new.safetensors", &options);
    assert!(!said.contains("note: resolution") && !said.contains("note: segments"), "{said}");
    let new = Model::read(folder.path().join("new.safetensors")).unwrap();
    assert_eq!((new.spec.resolution, &new.spec.segments), (None, &model.spec.segments));
    assert_eq!(new.spec.trained_on, Some(ranges));
    assert_eq!(figures(folder.path().join("new.json"))["trained_on"]["inputs"][1]["field"], "p");
    assert_eq!((&new.tensors, &new.spec.training), (&model.tensors, &model.spec.training));
    assert!(!folder.path().join("new.checkpoint").exists());
    let options = ["--resume", "--from", "old.safetensors", "--steps", "0"];
    let held = "a.checkpoint holds an earlier training";
    refused(&train(folder.path(), "a.safetensors", &options), held);
    refused(&train(folder.path(), "b.safetensors", &["--steps", "0"]), "--from MODEL");
}

#[test]
fn a_calibrated_model_says_how_its_errors_grow() {
    let folder = folder();
    trained(folder.path(), "a.safetensors", &["--steps", "4"]);
    let calibrate = |model: &str, extra: &[&str]| {
        let all = ["calibrate", "--data", "data", "--split", "all", "--starts", "2", "--model", model];
        run_in(folder.path(), &[&all, extra].concat())
    };
    refused(&calibrate("a.safetensors", &["--check"]), "no calibration to check");
    let replaced = "it would replace what is read (a.safetensors)";
    refused(&calibrate("a.safetensors", &["--json", "a.safetensors"]), replaced);
    for (coverage, least) in [("0.99", 99), ("0.9", 9), ("0.8", 4)] {
        let said = success(&calibrate("a.safetensors", &["--strides", "1", "--coverage", coverage]));
        let expected = format!(
            "3 trajectories cannot tell of more than 0.750; a coverage of {coverage} takes at least {least}\n"
        );
        assert!(said.contains(&expected), "{said}");
    }
    refused(&calibrate("a.safetensors", &["--strides", "1000"]), "ask for fewer");

    let options = ["--strides", "2", "--coverage", "0.5", "--out", "b.safetensors", "--json", "b.json"];
    success(&calibrate("a.safetensors", &options));
    let [a, b] =
        ["a", "b"].map(|name| Model::read(folder.path().join(format!("{name}.safetensors"))).unwrap());
    assert_eq!(a.tensors, b.tensors);
    let found = b.spec.calibration.unwrap();
    assert_eq!((found.coverage, found.trajectories, found.rollouts), (0.5, 3, 6));
    for (growth, field) in found.growth.iter().zip(["U", "p"]) {
        assert_eq!((growth.field.as_str(), growth.factors.len()), (field, 2));
        assert!(0.0 < growth.factors[0] && growth.factors[0] <= growth.factors[1], "{growth:?}");
    }
    let figures = figures(folder.path().join("b.json"));
    // Of 6 rollouts, of weight 1/8 each, the fourth ratio: 4 of 6 are within, and more after two strides where factors would fall
    assert!(figures["covered"][0][0].as_f64().unwrap() > 0.66, "{figures}");
    let said = success(&calibrate("b.safetensors", &["--check"]));
    assert!(said.contains("checked on 6 of 3"), "{said}");
}

/// OpenBLAS spins for ever where it gets no address space for its buffers.
#[test]
fn a_limit_of_the_address_space_is_an_error_with_a_message() {
    let folder = folder();
    let mesh = m4gn_samples::mesh::triangles(12, 8, 1.5, 1.0);
    let path = folder.path().join("data/003.h5");
    sample::write_trajectory_on(&path, &mesh, 3, m4gn_data::Split::Train, 30).unwrap();
    for kilobytes in [200_000, 300_000, 400_000, 500_000] {
        let limited = format!("ulimit -v {kilobytes}; exec timeout -s KILL 600 \"$0\" \"$@\"");
        let output = Command::new("bash")
            .current_dir(folder.path())
            .args(["-c", &limited, env!("CARGO_BIN_EXE_m4gn"), "train", "--data", "data"])
            .args(["--config", "config.toml", "--out", "limited.safetensors"])
            .output()
            .unwrap();
        let said = failure(&output);
        assert!(said.contains("003.h5") && said.contains("ulimit -v"), "{kilobytes}: {said}");
    }
}

#[test]
fn backends_and_devices_that_do_not_go_together_are_refused() {
    let folder = folder();
    refused(&train(folder.path(), "a.safetensors", &["--backend", "jax"]), "expected native or torch");
    let options = ["--backend", "native", "--device", "cuda"];
    refused(&train(folder.path(), "a.safetensors", &options), "use --backend torch");
}

/// The library of libtorch.
///
/// # Panics
/// Where it was not built: a test of it that cannot run must not pass.
fn library() -> PathBuf {
    LIBRARY.find().unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn libtorch_ends_with_its_own_status() {
    library();
    let folder = folder();
    let options = ["--backend", "torch", "--steps", "4"];
    trained(folder.path(), "a.safetensors", &options);
    // What one backend began the other carries on.
    trained(folder.path(), "a.safetensors", &["--resume", "--steps", "6"]);
    assert!(failure(&train(folder.path(), "a.safetensors", &options)).contains("--resume"));
    let options = ["--backend", "torch", "--device", "gpu"];
    assert!(failure(&train(folder.path(), "b.safetensors", &options)).contains("cuda:N"));
}

/// Each of these ended with SIGSEGV (139), when the library was unloaded before PETSc's handlers at the end of the process.
#[test]
fn libtorch_ends_with_its_own_status_on_ctrl_c_a_full_disk_and_bad_data() {
    library();
    let folder = folder();
    let path = folder.path();
    let torch = |name: &str, limit: &str, steps: &str| {
        let mut command = Command::new("bash");
        command.current_dir(path).args(["-c", &format!(
            "{limit} exec '{}' train --data data --config config.toml --backend torch --out {name} --steps {steps}",
            env!("CARGO_BIN_EXE_m4gn")
        )]);
        command
    };
    // Ctrl-C, once the first row of the journal shows that it learns
    let running =
        torch("stopped.safetensors", "", "1000000").stderr(std::process::Stdio::piped()).spawn().unwrap();
    let journal = path.join("stopped.csv");
    let started = Instant::now();
    while std::fs::read_to_string(&journal).map_or(0, |text| text.lines().count()) < 2 {
        assert!(started.elapsed() < Duration::from_secs(1200), "it does not learn");
        std::thread::sleep(Duration::from_millis(50));
    }
    let id = running.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let said = failure(&running.wait_with_output().unwrap());
    assert!(said.contains("interrupted at step") && said.contains("--resume"), "{said}");
    assert!(path.join("stopped.checkpoint").is_file());

    // Files may have 8 KiB: the first checkpoint does not fit
    let full = torch("full.safetensors", "ulimit -f 8;", "4").output().unwrap();
    let said = failure(&full);
    assert!(said.contains("full.") && said.contains("File too large"), "{said}");
    let mut left = names(path);
    left.retain(|name| name.contains("full.") && !name.ends_with(".csv"));
    assert!(left.is_empty(), "{left:?}");

    let damaged = path.join("data/000.h5");
    let mut bytes = std::fs::read(&damaged).unwrap();
    let half = bytes.len() / 2;
    bytes.truncate(half);
    std::fs::write(&damaged, bytes).unwrap();
    refused(&torch("bad.safetensors", "", "4").output().unwrap(), "000.h5");
}

#[test]
fn a_training_on_libtorch_that_diverges_keeps_what_was_good() {
    library();
    let folder = folder();
    let config = folder.path().join("config.toml");
    let tame = std::fs::read_to_string(&config).unwrap();
    let options = |steps| ["--backend", "torch", "--steps", steps];
    trained(folder.path(), "a.safetensors", &options("8"));
    let files =
        || ["a.safetensors", "a.checkpoint"].map(|name| std::fs::read(folder.path().join(name)).unwrap());
    let good = files();
    let wild = "learning_rate = 1e37\nlearning_rate_end = 1e37\ncheckpoint_interval = 400";
    std::fs::write(&config, tame.replace("learning_rate = 2e-3", wild)).unwrap();
    let carried_on = ["--resume", "--backend", "torch", "--steps", "400"];
    let said = failure(&train(folder.path(), "a.safetensors", &carried_on));
    assert!(said.contains("diverged") && said.contains("Lower learning_rate"), "{said}");
    assert!(files() == good, "what was good was overwritten");
}

/// A program that was taken out of its checkout: the message names the script that builds the library, which ./Allrun does not.
#[test]
fn without_the_library_the_message_says_what_builds_it() {
    let folder = folder();
    let alone = folder.path().join("m4gn");
    std::fs::copy(env!("CARGO_BIN_EXE_m4gn"), &alone).unwrap();
    let output = Command::new(alone)
        .current_dir(folder.path())
        .env_remove("M4GN_HOME")
        .args(["train", "--data", "data", "--config", "config.toml"])
        .args(["--out", "a.safetensors", "--backend", "torch"])
        .output()
        .unwrap();
    let said = failure(&output);
    assert!(
        said.contains(LIBRARY.file) && said.contains("type setup/all.sh") && !said.contains("Allrun"),
        "{said}"
    );
}

/// PETSc's handlers at the end of the process are in the library where it came with it: unloaded, they would be gone.
#[test]
fn the_library_of_libtorch_is_never_unloaded() {
    drop(LIBRARY.load_from(library()).unwrap());
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    assert!(maps.contains(LIBRARY.file), "unloaded");
}
