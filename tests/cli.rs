//! What the command line does with its outputs: closed pipes, full devices, odd names.

use crate::program::{fails, m4gn, text};
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
}

fn model() -> PathBuf {
    root().join("models/vibrating-rubber.safetensors")
}

#[test]
fn a_full_device_is_an_error_with_a_message() {
    let full = || Stdio::from(fs::OpenOptions::new().write(true).open("/dev/full").unwrap());
    let run = m4gn().arg("info").arg(model()).stdout(full()).output().unwrap();
    fails(&run, "standard output cannot be written");
    let run = m4gn().args(["info", "--json", "/dev/full"]).arg(model()).output().unwrap();
    fails(&run, "/dev/full: cannot be written: No space left");
    // Nowhere to say it either.
    let run = m4gn().arg("info").arg("/nowhere").stderr(full()).output().unwrap();
    assert_eq!(run.status.code(), Some(1));
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("figures.json");
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let run =
        m4gn().args(["info", "--json"]).arg(&json).arg(model()).stdout(Stdio::from(writer)).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(run.stderr.is_empty(), "{}", String::from_utf8_lossy(&run.stderr));
    assert!(json.is_file(), "the figures are written all the same");
}

#[test]
fn devices_and_standard_output_are_written_to() {
    let before = fs::metadata("/dev/null").unwrap();
    let run = m4gn().args(["info", "--json", "/dev/null"]).arg(model()).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let after = fs::metadata("/dev/null").unwrap();
    assert_eq!(before.file_type(), after.file_type(), "the device is still one");

    // Into a pipe, and into a file, where the figures follow what was printed.
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("out");
    let piped = m4gn().args(["info", "--json", "/dev/stdout"]).arg(model()).output().unwrap();
    let mut command = m4gn();
    command.args(["info", "--json", "/dev/stdout"]).arg(model());
    let status = command.stdout(fs::File::create(&file).unwrap()).status().unwrap();
    assert!(piped.status.success() && status.success());
    assert_eq!(fs::read(&file).unwrap(), piped.stdout);
    let text = String::from_utf8(piped.stdout).unwrap();
    let figures = text.find("\n{").expect("figures after the text");
    serde_json::from_str::<serde_json::Value>(&text[figures..]).unwrap();
}

#[test]
fn a_file_that_may_not_grow_is_an_error_with_a_message() {
    let folder = tempfile::tempdir().unwrap();
    let json = folder.path().join("figures.json");
    let script = format!(
        "ulimit -f 0; exec '{}' info --json '{}' '{}'",
        env!("CARGO_BIN_EXE_m4gn"),
        json.display(),
        model().display()
    );
    fails(&Command::new("bash").args(["-c", &script]).output().unwrap(), "File too large");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");
}

#[test]
fn names_may_be_anything() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join(std::ffi::OsStr::from_bytes(b"m\xff\xfe.safetensors"));
    fs::copy(model(), &odd).unwrap();
    let json = folder.path().join("figures.json");
    let run = m4gn().args(["info", "--json"]).arg(&json).arg(&odd).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let run = m4gn()
        .args(["train", "--data", "/nowhere", "--config", "/nowhere", "--out"])
        .arg(&odd)
        .output()
        .unwrap();
    fails(&run, "expected UTF-8");

    // A name that would colour the terminal, or worse.
    let bytes = fs::read(root().join("tests/cabi/small.safetensors")).unwrap();
    let end = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header = String::from_utf8(bytes[8..end].to_vec()).unwrap();
    let evil = header.replace("\\\"name\\\":\\\"p\\\"", "\\\"name\\\":\\\"p\\\\u001b[31m\\\\u0007\\\"");
    assert_ne!(header, evil);
    let mut file = (evil.len() as u64).to_le_bytes().to_vec();
    file.extend(evil.as_bytes());
    file.extend(&bytes[end..]);
    let path = folder.path().join("evil.safetensors");
    fs::write(&path, file).unwrap();
    let run = m4gn().arg("info").arg(&path).output().unwrap();
    let shown = [run.stdout, run.stderr].concat();
    let text = String::from_utf8_lossy(&shown);
    assert!(text.contains("\\u{1b}[31m"), "{text}");
    assert!(!shown.contains(&0x1b) && !shown.contains(&7), "{text}");
}

#[test]
fn outputs_are_checked_before_anything_is_computed() {
    for (command, option, rest) in [
        ("compare", "--html", &["/no/case", "/no/case"][..]),
        ("validate", "--json", &["--model", "/no/model", "--data", "/no/data"]),
    ] {
        let run = m4gn().args([command, option, "/nowhere/report"]).args(rest).output().unwrap();
        fails(&run, "/nowhere/report: cannot be written");
    }
}

#[test]
fn a_pipe_that_nobody_writes_to_is_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let (pipe, model) = (pipe.to_str().unwrap(), model());
    let (model, variant) = (model.to_str().unwrap(), format!("x={pipe}"));
    let out = folder.path().join("out");
    for command in [
        &["train", "--data", "/nowhere", "--config", pipe, "--out"][..],
        &["hybrid", "--family", "cylinder-flow", "--model", model, "--variant", &variant, "--out"],
        &["validate", "--model", pipe, "--data", "/nowhere", "--json"],
        &["validate", "--model", model, "--data", pipe, "--json"],
    ] {
        let mut run = Command::new("timeout");
        run.args(["60", env!("CARGO_BIN_EXE_m4gn")]).args(command).arg(&out);
        fails(&run.output().unwrap(), "expected a plain file, found a pipe");
    }
}

#[test]
fn times_may_be_negative() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("a.dat");
    let rows = (0..60).map(|i| format!("{} {}\n", f64::from(i) - 50.0, i % 3));
    fs::write(&table, rows.collect::<String>()).unwrap();
    let run = m4gn().arg("averages").arg(&table).args(["--column", "1", "--start", "-0.5"]).output().unwrap();
    fails(&run, "found 10 rows from time -0.5 on");
    let run = m4gn().arg("averages").arg(&table).args(["--column", "1", "--start", "nan"]).output().unwrap();
    fails(&run, "--start NaN: expected a time");
}

#[test]
fn figures_replace_no_table_that_they_are_of() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("0/a.dat");
    fs::create_dir(folder.path().join("0")).unwrap();
    let rows = (0..60).map(|i| format!("{i} {}\n", i % 3)).collect::<String>();
    fs::write(&table, &rows).unwrap();
    let mut command = m4gn();
    command.arg("averages").arg(folder.path().join("a.dat")).args(["--column", "1", "--json"]).arg(&table);
    fails(&command.output().unwrap(), "it would replace what is read");
    assert_eq!(fs::read_to_string(&table).unwrap(), rows);
}

/// Before any file is looked at.
#[test]
fn numbers_out_of_their_range_are_bad_usage() {
    for (arguments, expected) in [
        ("averages t --column Cd --confidence 1", "expected a number between 0 and 1"),
        ("averages t --column Cd --relative 0", "expected a number above 0"),
        ("bench --steps 0", "at least 1"),
        ("calibrate --model m --data d --coverage 1.5", "expected a number between 0 and 1"),
        ("calibrate --model m --data d --starts 0", "at least 1"),
        ("compare a b --wall-a 0", "expected a number above 0"),
        ("convert a --out b --count 0", "at least 1"),
        ("generate deforming-plate --count 1 --out d --poisson 0.5", "from 0 to 0.49"),
        ("hybrid --out d --end 1e-7", "a time of at least 1e-6 s"),
        ("validate --model m --data d --horizon nan", "expected a number above 0"),
    ] {
        let run = m4gn().args(arguments.split(' ')).output().unwrap();
        let told = text(&run);
        assert!(run.status.code() == Some(2) && told.contains(expected), "{arguments}: {told}");
    }
}

#[test]
fn what_is_no_case_is_bad_usage() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    for (case, words) in [
        (folder.path(), "is a folder without system/controlDict"),
        (&file, "is no folder"),
        (Path::new("/nowhere"), "does not exist: expected the folder of an OpenFOAM case, or a family"),
    ] {
        let run = m4gn().arg("check").arg(case).output().unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert!(run.status.code() == Some(2) && text.contains(words), "{text}");
    }
    assert_eq!(m4gn().arg("check").status().unwrap().code(), Some(2));
}
