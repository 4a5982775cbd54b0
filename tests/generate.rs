//! `m4gn generate` with OpenFOAM's own tools: small cases, resumption, failures, interruption, a full disk.
//!
//! Needs gmsh, OpenFOAM and `lib/libm4gnFoam.so` (setup/build.sh).

use crate::program::{self, figures, names, refused, success, text};
use m4gn_data::{Split, Trajectory};
use m4gn_mesh::{Mesh, NodeType};
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn m4gn(arguments: &str, out: &Path) -> Command {
    let home = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");
    let library = Path::new(home).join("lib/libm4gnFoam.so");
    assert!(library.is_file(), "{} is missing: run setup/build.sh before the tests", library.display());
    let mut command = program::m4gn();
    command
        .env("M4GN_HOME", home)
        .env_remove("WM_PROJECT_DIR")
        .args(arguments.split_whitespace())
        .arg("--out")
        .arg(out);
    command
}

/// A quick case: 900 triangles, a few steps.
const QUICK: &str = "generate cylinder-flow --set mesh=coarse --frames 2 --spin-up 0.02 --seed 3";

/// A folder with a program that stands in for another one in PATH.
fn stand_in(name: &str, script: &str) -> (tempfile::TempDir, std::ffi::OsString) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    fs::write(&file, script).unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).unwrap();
    let mut path = vec![folder.path().to_path_buf()];
    path.extend(std::env::split_paths(&std::env::var_os("PATH").unwrap()));
    let path = std::env::join_paths(path).unwrap();
    (folder, path)
}

#[test]
fn cases_are_made_once_and_resumed() {
    let out = tempfile::tempdir().unwrap();
    let json = out.path().join("figures.json");
    let run = |extra: &str| {
        m4gn(&format!("{QUICK} {extra}"), out.path()).arg("--json").arg(&json).output().unwrap()
    };
    success(&run("--count 3 --jobs 2"));
    assert_eq!(names(out.path()), ["0000.h5", "0001.h5", "0002.h5", "figures.json"]);
    for (i, split) in [Split::Train, Split::Valid, Split::Test].into_iter().enumerate() {
        let t = Trajectory::open(out.path().join(format!("000{i}.h5"))).unwrap();
        assert_eq!(t.split(), split);
        assert_eq!(t.times().len(), 3);
        let errors = t.times().iter().zip([0.02, 0.03, 0.04]).map(|(a, b)| (a - b).abs());
        assert!(errors.fold(0.0, f64::max) < 1e-9, "{:?}", t.times());
        assert_eq!(t.provenance()["index"], i);
        assert_eq!(t.provenance()["application"], "icoFoam");
        assert_eq!(t.mesh().directions, [0, 1]);
        // The inlet's parabola, at every inlet face of the last frame
        let u0 = t.provenance()["u0"].as_f64().unwrap();
        let u = t.read_frame("U", 2).unwrap();
        let inlet = t.mesh().patches.iter().position(|p| p == "inlet").unwrap() as i32;
        let faces =
            t.mesh().boundary.iter().zip(u.boundary.chunks_exact(2)).filter(|(f, _)| f.patch == inlet);
        let worst = faces
            .map(|(f, u)| {
                (f64::from(u[0]) - 4.0 * u0 * f.centre[1] * (0.41 - f.centre[1]) / (0.41 * 0.41)).abs()
            })
            .fold(0.0, f64::max);
        assert!(worst < 1e-5, "inlet off by {worst} m/s");
    }
    assert_eq!(figures(&json)["made"].as_array().unwrap().len(), 3);

    // A trajectory that went is made again, the same; the others stay.
    let old = fs::read(out.path().join("0001.h5")).unwrap();
    fs::remove_file(out.path().join("0001.h5")).unwrap();
    let again = run("--count 3");
    assert!(again.status.success() && text(&again).contains("1 trajectories made"), "{}", text(&again));
    let values = |bytes: &[u8]| {
        let file = out.path().join("copy");
        fs::write(&file, bytes).unwrap();
        Trajectory::open(&file).unwrap().read_frame("U", 2).unwrap()
    };
    assert_eq!(values(&old), values(&fs::read(out.path().join("0001.h5")).unwrap()));

    let other = run("--count 3 --seed 4");
    assert_eq!(other.status.code(), Some(2), "an option given twice is bad usage: {}", text(&other));
    let other = format!("{QUICK} --count 3").replace("--frames 2", "--frames 9");
    refused(&m4gn(&other, out.path()).output().unwrap(), "frames 2 instead of 9");
}

#[test]
fn a_vibrating_beam_moves_as_it_was_drawn() {
    let out = tempfile::tempdir().unwrap();
    let make = |frames: &str| {
        m4gn("generate vibrating-beam --count 1 --seed 5", out.path())
            .args(["--frames", frames])
            .output()
            .unwrap()
    };
    success(&make("2"));
    let t = Trajectory::open(out.path().join("0000.h5")).unwrap();
    let times: Vec<f64> = t.times().iter().map(|t| (t * 1e9).round() / 1e9).collect();
    assert_eq!(times, [0.02, 0.03, 0.04]);
    let mesh = t.mesh();
    let kinds = |patch: &str| {
        let number = mesh.patches.iter().position(|p| p == patch).unwrap() as i32;
        mesh.boundary.iter().filter(|f| f.patch == number).map(|f| f.kind).collect::<Vec<_>>()
    };
    assert_eq!(kinds("clamp"), [NodeType::Handle; 8]);
    assert_eq!(kinds("sides"), [NodeType::Free; 80]);
    let number = |key: String| t.provenance()[&key].as_f64().unwrap();
    let tip = (0..mesh.n_cells())
        .max_by(|&i, &j| mesh.cell_centres[i][0].total_cmp(&mesh.cell_centres[j][0]))
        .unwrap();
    for (frame, &time) in times.iter().enumerate() {
        // (b/L)^2 sqrt(E I/(rho A)) of a beam without shear
        let modes = [1.8751040687, 4.6940911330, 7.8547574382]
            .map(|b: f64| (b / 0.6).powi(2) * (1e3f64 * 0.06 * 0.06 / 12.0).sqrt());
        let expected: f64 = (0..3)
            .map(|k| {
                let (a, phase) = (number(format!("amplitude{}", k + 1)), number(format!("phase{}", k + 1)));
                a * (modes[k] * time + phase).cos()
            })
            .sum();
        let found = f64::from(t.read_frame("D", frame).unwrap().cells[2 * tip + 1]);
        // Half a cell from the tip, with shear and Euler's damping
        assert!((found - expected).abs() < 1e-3, "{found} m at {time} s, expected {expected}");
    }
    // The rate is that of the solver's last step: nearly the change between frames
    let [d0, d1, v1] = [("D", 0), ("D", 2), ("ddt(D)", 1)]
        .map(|(name, frame)| f64::from(t.read_frame(name, frame).unwrap().cells[2 * tip + 1]));
    assert!(((d1 - d0) / 0.02 - v1).abs() < 0.02, "{} and {v1} m/s", (d1 - d0) / 0.02);

    refused(&make("3"), "frames 2 instead of 3");
}

#[test]
fn failed_cases_are_reported_and_skipped() {
    let out = tempfile::tempdir().unwrap();
    // The solver dies in the second case only.
    let script = "#!/bin/sh\ncase $PWD in *0001) printf -- '--> FOAM FATAL ERROR: \\nthe flux is wrong\\n'; exit 1;; esac\nexec /usr/bin/icoFoam\n";
    let solver = m4gn_solver();
    let (_folder, path) = stand_in("icoFoam", &script.replace("/usr/bin/icoFoam", &solver));
    let run = m4gn(&format!("{QUICK} --count 2"), out.path()).env("PATH", &path).output().unwrap();
    refused(&run, "the flux is wrong");
    refused(&run, "1 of 2 cases failed:\n  0001: ");
    assert_eq!(names(out.path()), ["0000.h5", "cases"]);
    assert!(out.path().join("cases/0001/log.icoFoam").is_file());

    // All of them: the command fails.
    let out = tempfile::tempdir().unwrap();
    let (_folder, path) = stand_in("gmsh", "#!/bin/sh\nkill -9 $$\n");
    let run = m4gn(&format!("{QUICK} --count 2"), out.path()).env("PATH", &path).output().unwrap();
    refused(&run, "signal: 9");
    refused(&run, "log.gmsh");
}

fn m4gn_solver() -> String {
    m4gn_workbench::generate::process::find_program("icoFoam").expect("icoFoam in PATH").display().to_string()
}

#[test]
fn a_solver_that_hangs_is_ended() {
    let out = tempfile::tempdir().unwrap();
    let (_folder, path) = stand_in("icoFoam", "#!/bin/sh\nexec sleep 600\n");
    let run =
        m4gn(&format!("{QUICK} --count 1 --timeout 2"), out.path()).env("PATH", &path).output().unwrap();
    refused(&run, "--timeout");
}

#[test]
fn interruption_leaves_nothing_half_written() {
    let out = tempfile::tempdir().unwrap();
    let long = "generate cylinder-flow --set mesh=coarse --frames 100000 --spin-up 0.02 --count 2 --jobs 2";
    let mut run = m4gn(long, out.path()).spawn().unwrap();
    let partial = out.path().join("cases/0000/.trajectory.h5.partial");
    wait_for("the recording never began", || partial.exists());
    assert!(Command::new("kill").args(["-TERM", &run.id().to_string()]).status().unwrap().success());
    assert_eq!(run.wait().unwrap().code(), Some(1));
    assert_eq!(names(out.path()), [] as [&str; 0]);
    // No tool goes on in the folder.
    assert_eq!(working_in(out.path()), 0);
}

/// Processes that work in a folder.
fn working_in(folder: &Path) -> usize {
    let all = fs::read_dir("/proc").unwrap();
    let places = all.filter_map(|e| fs::read_link(e.ok()?.path().join("cwd")).ok());
    places.filter(|cwd| cwd.starts_with(folder)).count()
}

fn wait_for(what: &str, done: impl Fn() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < Duration::from_secs(1200), "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The solver is started by a script here, so that it is no child of ours; neither of them outlives us.
#[test]
fn a_killed_command_leaves_nothing_running() {
    let out = tempfile::tempdir().unwrap();
    let script = format!("#!/bin/sh\n{}\n", m4gn_solver());
    let (_folder, path) = stand_in("icoFoam", &script);
    let long = "generate cylinder-flow --set mesh=coarse --frames 100000 --spin-up 0.02 --count 2 --jobs 2";
    let mut run = m4gn(long, out.path()).env("PATH", &path).spawn().unwrap();
    let partial = out.path().join("cases/0000/.trajectory.h5.partial");
    wait_for("the recording never began", || partial.exists());

    // Nobody else works in the folder meanwhile.
    refused(&m4gn(long, out.path()).output().unwrap(), "is being written by process ");
    assert!(working_in(out.path()) >= 2, "the first one was disturbed");

    run.kill().unwrap();
    run.wait().unwrap();
    wait_for("solvers go on in the folder", || working_in(out.path()) == 0);

    // The lock went with it.
    success(&m4gn(&format!("{QUICK} --count 1"), out.path()).output().unwrap());
}

/// A folder of the user's own; what it leaves out or sets is told.
#[test]
fn a_folder_of_data_is_a_family() {
    let out = tempfile::tempdir().unwrap();
    let own = out.path().join("my-flow");
    let templates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../openfoam/templates/cylinder-flow");
    let copied = Command::new("cp").arg("-r").arg(templates).arg(&own).status();
    assert!(copied.unwrap().success());
    let data = out.path().join("data");
    let command = format!(
        "generate {} --count 1 --frames 2 --spin-up 0.02 --set mesh=coarse --set cells=0.5 --set shape=square --set nu=2e-3:3e-3",
        own.display()
    );
    success(&m4gn(&command, &data).output().unwrap());
    let t = Trajectory::open(data.join("0000.h5")).unwrap();
    assert!((300..600).contains(&t.mesh().n_cells()), "{}", t.mesh().n_cells());
    let provenance = t.provenance();
    assert_eq!(provenance["family"], "my-flow");
    assert_eq!(provenance["shape"], "square");
    assert!((2e-3..=3e-3).contains(&provenance["nu"].as_f64().unwrap()));
    // The square: no face of the obstacle looks anywhere but along x or y
    let wall = t.mesh().patches.iter().position(|p| p == "cylinder").unwrap() as i32;
    let (x, y) = (provenance["x"].as_f64().unwrap(), provenance["y"].as_f64().unwrap());
    let radius = provenance["radius"].as_f64().unwrap();
    for f in t.mesh().boundary.iter().filter(|f| f.patch == wall) {
        let far = (f.centre[0] - x).abs().max((f.centre[1] - y).abs());
        assert!((far - radius).abs() < 1e-6, "{:?}", f.centre);
    }
    let other_kind = |kind: &str| {
        let out = out.path().join(kind);
        success(&m4gn(&format!("{command} --set elements={kind}"), &out).output().unwrap());
        let mesh = Trajectory::open(out.join("0000.h5")).unwrap().mesh().clone();
        assert!((300..800).contains(&mesh.n_cells()), "{kind}: {}", mesh.n_cells());
        let volume = mesh.cell_volumes.iter().sum::<f64>() / 0.01;
        (mesh, volume - (1.6 * 0.41 - 4.0 * radius * radius))
    };
    let faces_a_cell = |mesh: &Mesh| mesh.face_owner.len() as f64 / mesh.n_cells() as f64;
    // Nearly all quadrilaterals have four faces inside, where triangles have three
    let (mesh, excess) = other_kind("quads");
    assert!(faces_a_cell(&mesh) > 1.7 && excess.abs() < 1e-7, "{excess} m^2");
    // Most of the polyhedra inside have six faces or more there
    let (mesh, excess) = other_kind("polyhedra");
    assert!(faces_a_cell(&mesh) > 2.4 && excess.abs() < 1e-7, "{excess} m^2");
    // Hexahedra beside some of half their size have more than four faces; the corners of the square may be cut
    let (mesh, excess) = other_kind("hexahedra");
    let mut faces = vec![0; mesh.n_cells()];
    let ends = mesh.face_owner.iter().chain(&mesh.face_neighbour);
    ends.for_each(|&cell| faces[cell as usize] += 1);
    let hanging = faces.iter().filter(|&&n| n > 4).count();
    assert!(hanging > 20 && excess.abs() < 4e-4, "{hanging} cells, {excess} m^2");

    let other = m4gn(&command.replace("cells=0.5", "cells=0.6"), &data).output().unwrap();
    assert!(text(&other).contains("cells 0.5 instead of 0.6"), "{}", text(&other));

    // One that is broken
    fs::write(own.join("family.toml"), "about = 1").unwrap();
    refused(&m4gn(&command, &data).output().unwrap(), "family.toml");
    let none = m4gn("generate no-such-flow --count 1", &data).output().unwrap();
    refused(&none, "cylinder-flow, pressed-rubber, vibrating-beam");
}

/// The file size limit stands for a full disk: the solver stops with our message, and no recording is left.
#[test]
fn a_full_disk_is_told() {
    let out = tempfile::tempdir().unwrap();
    let command = m4gn(&format!("{QUICK} --frames 500 --count 1").replace("--frames 2 ", ""), out.path());
    let mut limited = Command::new("bash");
    limited
        .args(["-c", "trap '' XFSZ; ulimit -f 2000; exec \"$0\" \"$@\""])
        .arg(command.get_program())
        .args(command.get_args());
    for (key, value) in command.get_envs() {
        match value {
            Some(value) => limited.env(key, value),
            None => limited.env_remove(key),
        };
    }
    refused(&limited.output().unwrap(), "file size limit is reached");
    let case = names(&out.path().join("cases/0000"));
    assert!(!case.iter().any(|n| n.contains("trajectory")), "{case:?}");
}

#[test]
fn what_cannot_work_is_refused_at_once() {
    let out = tempfile::tempdir().unwrap();
    let run = m4gn(&format!("{QUICK} --count 1"), out.path()).env("PATH", "/nowhere").output().unwrap();
    refused(&run, "gmsh, gmshToFoam, changeDictionary, icoFoam not found");
    refused(&m4gn(&format!("{QUICK} --count 1"), &out.path().join("my data")).output().unwrap(), "blanks");
    for bad in [
        "--count 0",
        "--count 1 --frame-interval -1",
        "--count 1 --frame-interval nan",
        "--count 1 --split x",
        "",
    ] {
        let run = m4gn(&format!("generate cylinder-flow {bad}"), out.path()).output().unwrap();
        assert_eq!(run.status.code(), Some(2), "{bad}: {}", text(&run));
    }
    assert_eq!(names(out.path()), [] as [&str; 0]);
}

/// Two ranks record what one records: the same mesh in the same order, and the fields up to the solver's tolerance.
#[test]
fn two_ranks_record_the_undecomposed_mesh() {
    let out = tempfile::tempdir().unwrap();
    let run = m4gn(&format!("{QUICK} --count 1 --keep-cases"), out.path()).output().unwrap();
    assert!(run.status.success(), "{}", text(&run));
    let case = out.path().join("cases/0000");
    let dictionary = "FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }\n\
        numberOfSubdomains 2; method simple; simpleCoeffs { n (2 1 1); delta 0.001; }\n";
    fs::write(case.join("system/decomposeParDict"), dictionary).unwrap();
    let tool = |program: &str, arguments: &[&str]| {
        let output = Command::new(program)
            .args(arguments)
            .current_dir(&case)
            .env("LD_LIBRARY_PATH", Path::new(env!("CARGO_MANIFEST_DIR")).join("../../lib"))
            .env("WM_PROJECT_DIR", std::env::var_os("WM_PROJECT_DIR").unwrap_or("/usr/share/openfoam".into()))
            .env("OMPI_MCA_btl_vader_single_copy_mechanism", "none")
            .output()
            .unwrap();
        assert!(output.status.success(), "{program}: {}", text(&output));
    };
    tool("decomposePar", &[]);
    tool("mpirun", &["--allow-run-as-root", "--oversubscribe", "-np", "2", "icoFoam", "-parallel"]);
    let serial = Trajectory::open(out.path().join("0000.h5")).unwrap();
    let parallel = Trajectory::open(case.join("trajectory.h5")).unwrap();
    assert_eq!(parallel.provenance()["ranks"], 2);
    let (a, b) = (serial.mesh(), parallel.mesh());
    assert_eq!(
        (&a.face_owner, &a.face_neighbour, &a.patches),
        (&b.face_owner, &b.face_neighbour, &b.patches)
    );
    let close = |x: &[f64], y: &[f64], what: &str| {
        let scale = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let worst = x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        // Geometry is computed again from the same points.
        assert!(x.len() == y.len() && worst <= 1e-9 * scale, "{what}: {worst} of {scale}");
    };
    close(&a.cell_volumes, &b.cell_volumes, "volumes");
    close(&a.face_coeff, &b.face_coeff, "coefficients");
    close(a.cell_centres.as_flattened(), b.cell_centres.as_flattened(), "centres");
    assert!(
        a.boundary
            .iter()
            .zip(&b.boundary)
            .all(|(f, g)| (f.owner, f.kind, f.patch) == (g.owner, g.kind, g.patch))
    );
    for frame in 0..3 {
        let (x, y) = (serial.read_frame("U", frame).unwrap(), parallel.read_frame("U", frame).unwrap());
        let pairs = x.cells.iter().zip(&y.cells).chain(x.boundary.iter().zip(&y.boundary));
        let worst = pairs.map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
        // p is solved to 1e-6 relative of its own, U to 1e-6; a wrong order would show in metres a second.
        assert!(worst < 1e-3, "frame {frame}: {worst} m/s apart");
    }
}
