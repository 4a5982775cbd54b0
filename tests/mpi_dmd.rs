//! A linear surrogate on several ranks against the same on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3.

#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_dmd::{FitSettings, OnlineDmd, Settings, Storage};
use m4gn_parallel::Comm;
use m4gn_state::Array;
use std::process::ExitCode;

const CELLS: usize = 240;
const TOLERANCE: f64 = 1e-9;

fn main() -> ExitCode {
    ranks::run("mpi_dmd", |comm| Ok(run(comm)))
}

/// Waves that travel at different speeds, with amplitudes over three decades, and a small one whose frequency changes.
fn state(k: f64) -> Vec<f64> {
    let x = |i: usize| i as f64 / CELLS as f64 * std::f64::consts::TAU;
    let wave = |i: usize, n: f64| {
        0.1f64.powf(n - 1.0) * (n * x(i) - 0.37 * n.sqrt() * k).sin() * 0.9995f64.powf(k * n)
    };
    let chirp = |i: usize| 1e-3 * (2.0 * x(i) + 4e-3 * k * k).sin();
    (0..CELLS).map(|i| 20.0 + chirp(i) + (1..4).map(|n| wave(i, n as f64)).sum::<f64>()).collect()
}

fn part(all: &[f64], mine: &[usize]) -> Vec<f64> {
    mine.iter().map(|i| all[*i]).collect()
}

fn surrogate(comm: &Comm, mine: &[usize], storage: Storage) -> m4gn_base::Result<OnlineDmd> {
    let volumes: Vec<f64> = mine.iter().map(|i| 1.0 + (i % 7) as f64).collect();
    let fields = vec![Array::solved("U", 1, volumes), Array::carried("phi", mine.len())];
    OnlineDmd::new(
        comm,
        fields,
        Settings { interval: 0.1, storage, fit: FitSettings::default(), held: 0, rest: Vec::new() },
    )
}

fn run(comm: &Comm) -> Vec<String> {
    let (rank, size) = (comm.rank() as usize, comm.size() as usize);
    let all: Vec<usize> = (0..CELLS).collect();
    let scattered: Vec<usize> = (0..CELLS).filter(|i| i * 7919 % 13 % size == rank).collect();
    let last_alone: Vec<usize> = if rank == size - 1 { all.clone() } else { Vec::new() };
    let mut failures = Vec::new();
    for (how, mine) in [("scattered", &scattered), ("the last rank alone", &last_alone)] {
        for storage in [Storage::Double, Storage::Single] {
            if let Err(e) = compare(comm, mine, &all, storage).and_then(|worst| match worst < TOLERANCE {
                true => Ok(()),
                false => Err(m4gn_base::Error::Numerical(format!("{worst:e} from one rank"))),
            }) {
                failures.push(format!("{how}, {storage:?}: {e}"));
            }
        }
    }
    failures
}

/// Largest difference to one rank.
fn compare(comm: &Comm, mine: &[usize], all: &[usize], storage: Storage) -> m4gn_base::Result<f64> {
    let mut here = surrogate(comm, mine, storage)?;
    let mut alone = surrogate(&Comm::serial(), all, storage)?;
    let mut worst: f64 = 0.0;
    for (from, to, jump) in [(0, 45, 25), (70, 71, 100), (171, 172, 0)] {
        for k in from..to {
            let whole = state(k as f64);
            let own = part(&whole, mine);
            here.offer(k as f64 * 0.1, 0.1, &[&own, &own])?;
            alone.offer(k as f64 * 0.1, 0.1, &[&whole, &whole])?;
        }
        if from == 0 {
            let tail = |l: &mut OnlineDmd| {
                l.fit().map(|f| ((f.model.delays(), f.model.rank(), f.model.inputs()), f.tail_error()))
            };
            let (a, b) = (tail(&mut here), tail(&mut alone));
            let same = a.zip(b).is_some_and(|(a, b)| a.0 == b.0 && (a.1 - b.1).abs() < TOLERANCE);
            if !same {
                return Err(m4gn_base::Error::Numerical(format!("fits differ: {a:?}, {b:?}")));
            }
        }
        for strides in [1.0, 2.5, 90.0] {
            let missing = || m4gn_base::Error::Numerical("no prediction".into());
            let (a, b) =
                (here.predict(strides).ok_or_else(missing)?, alone.predict(strides).ok_or_else(missing)?);
            let (mut own, mut whole) = (vec![0.0; mine.len()], vec![0.0; CELLS]);
            here.field(1, &a, &mut own);
            alone.field(1, &b, &mut whole);
            let differences = own.iter().zip(part(&whole, mine)).map(|(a, b)| (a - b).abs());
            worst = differences.fold(worst, f64::max);
        }
        let end = (to - 1 + jump) as f64;
        let jumps = |l: &mut OnlineDmd| l.jump(jump as f64, 0.1 * end, 0.1);
        if jump > 0 && !(jumps(&mut here) && jumps(&mut alone)) {
            return Err(m4gn_base::Error::Numerical("no jump".into()));
        }
    }
    let mut most = [worst];
    comm.max_f64(&mut most);
    Ok(most[0])
}
