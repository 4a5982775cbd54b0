//! Recording on several ranks gives the file that one rank gives, and errors reach every rank.
//!
//! Run as `mpirun -np P <this binary>` for P = 1, 2, 3; without mpirun this is a run on one rank.

#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_base::{Error, Result};
use m4gn_data::{FieldMeta, Recorder, Split, Trajectory, WriteOptions};
use m4gn_mesh::{Field, Mesh};
use m4gn_parallel::Comm;
use m4gn_samples::mesh as sample;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    ranks::run("mpi_recorder", |comm| checks(comm).map(|()| Vec::new()))
}

fn checks(comm: &Comm) -> Result<()> {
    // Only the root writes; the others' folder is never looked at.
    let folder = tempfile::tempdir().map_err(|e| Error::Internal(e.to_string()))?;
    let mut cyclic = sample::rectangle(6, 3, 1.2, 0.6);
    sample::make_cyclic(&mut cyclic, 1.2);
    let meshes = [
        ("triangles", sample::triangles(5, 4, 1.0, 1.0)),
        ("cyclic", cyclic),
        ("block", sample::block([4, 3, 3], [1.0, 1.0, 1.0])),
    ];
    for (name, whole) in &meshes {
        same_file(comm, name, whole, folder.path())?;
        errors(comm, whole, folder.path())?;
    }
    Ok(())
}

fn options() -> WriteOptions {
    let field =
        |name: &str, vector| FieldMeta { name: name.into(), vector, dimensions: [0, 1, -1, 0, 0, 0, 0] };
    WriteOptions {
        fields: vec![field("U", true), field("p", false)],
        provenance: serde_json::json!({"test": true}),
        split: Split::Train,
        overwrite: true,
    }
}

/// Values that tell which cell or face, component and frame they belong to.
struct Values {
    u: [Vec<f64>; 2],
    p: [Vec<f64>; 2],
}

impl Values {
    fn new(mesh: &Mesh, frame: usize) -> Self {
        let faces: Vec<i64> = mesh.boundary.iter().map(|f| f.global).collect();
        let make = |numbers: &[i64], c: usize, offset: f64| -> Vec<f64> {
            let value = |g: i64, k: usize| offset + 1000.0 * frame as f64 + g as f64 + 0.25 * k as f64;
            numbers.iter().flat_map(|&g| (0..c).map(move |k| value(g, k))).collect()
        };
        Values {
            u: [make(&mesh.cell_global, 3, 0.0), make(&faces, 3, 0.5)],
            p: [make(&mesh.cell_global, 1, 0.0), make(&faces, 1, 0.5)],
        }
    }

    fn fields(&self) -> [Field<'_>; 2] {
        // Not in the order of the declaration: fields go by name.
        [
            Field { name: "p", components: 1, cells: &self.p[0], boundary: &self.p[1] },
            Field { name: "U", components: 3, cells: &self.u[0], boundary: &self.u[1] },
        ]
    }
}

fn record(comm: &Comm, mesh: &Mesh, path: &Path) -> Result<()> {
    let mut recorder = Recorder::create(comm, mesh, path, &options())?;
    for frame in 0..3 {
        recorder.append(0.1 * frame as f64, &Values::new(mesh, frame).fields())?;
    }
    recorder.finish()
}

fn ensure(holds: bool, what: impl FnOnce() -> String) -> Result<()> {
    if holds { Ok(()) } else { Err(Error::Internal(what())) }
}

fn same_file(comm: &Comm, name: &str, whole: &Mesh, folder: &Path) -> Result<()> {
    // Cells dealt out in turn, so that every rank has many neighbours.
    let ranks: Vec<i32> = (0..whole.n_cells()).map(|c| c as i32 % comm.size()).collect();
    let mesh = sample::part(whole, &ranks, comm.rank());
    let path = folder.join(format!("{name}.h5"));
    record(comm, &mesh, &path)?;
    let compare = || -> Result<()> {
        let alone = folder.join(format!("{name}-alone.h5"));
        record(&Comm::serial(), whole, &alone)?;
        let (a, b) = (Trajectory::open(&path)?, Trajectory::open(&alone)?);
        ensure(a.mesh() == b.mesh(), || format!("{name}: another mesh than on one rank"))?;
        ensure(a.mesh().n_cells() == whole.n_cells(), || format!("{name}: cells were lost"))?;
        ensure(a.mesh().face_owner.len() == whole.face_owner.len(), || format!("{name}: faces were lost"))?;
        ensure(a.mesh().coupled.len() == whole.coupled.len(), || format!("{name}: cyclic faces were lost"))?;
        for field in ["U", "p"] {
            let (x, y) = (a.read_frames(field, 0, 1, 3)?, b.read_frames(field, 0, 1, 3)?);
            ensure(x == y, || format!("{name}: other values of {field} than on one rank"))?;
        }
        let u = a.read_frame("U", 2)?;
        let width = whole.directions.len();
        let expected = 2000.0 + 5.0 + 0.25 * whole.directions[1] as f32;
        ensure(u.cells[5 * width + 1] == expected, || {
            format!("{name}: U of cell 5 is {}", u.cells[5 * width + 1])
        })
    };
    comm.agree(if comm.is_root() { compare() } else { Ok(()) })
}

/// What one rank meets, all are told, and no rank waits for another.
fn errors(comm: &Comm, whole: &Mesh, folder: &Path) -> Result<()> {
    let ranks: Vec<i32> = sample::strips(whole.n_cells(), comm.size());
    let mesh = sample::part(whole, &ranks, comm.rank());
    let nowhere = Recorder::create(comm, &mesh, Path::new("/proc/none/a.h5"), &options());
    ensure(nowhere.is_err(), || "a file was made in /proc".into())?;

    let mut twice = mesh.clone();
    if comm.rank() == comm.size() - 1 {
        twice.cell_global[0] = whole.n_cells() as i64;
    }
    let path = folder.join("errors.h5");
    ensure(Recorder::create(comm, &twice, &path, &options()).is_err(), || {
        "a cell beyond the last was taken".into()
    })?;

    let mut recorder = Recorder::create(comm, &mesh, &path, &options())?;
    let mut values = Values::new(&mesh, 0);
    recorder.append(0.0, &values.fields())?;
    let last = comm.rank() == comm.size() - 1;
    if last {
        values.p[0][0] = f64::NAN;
    }
    ensure(recorder.append(1.0, &values.fields()).is_err(), || "NaN was recorded".into())?;
    let fields = values.fields();
    let given = if last { &fields[..1] } else { &fields[..] };
    ensure(recorder.append(1.0, given).is_err(), || "a missing field went unnoticed".into())?;
    ensure(recorder.n_frames() == 1, || "a refused frame was counted".into())?;
    // Dropped unfinished: nothing stays.
    drop(recorder);
    let left = folder.join("errors.h5").exists() || folder.join(".errors.h5.partial").exists();
    ensure(!left, || "a recording that was given up left a file".into())
}
