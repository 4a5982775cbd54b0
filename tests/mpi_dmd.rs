//! A linear surrogate on several ranks against the same on one: run as `mpirun -np P <this binary>` for P = 1, 2, 3.

#[path = "ranks/mod.rs"]
mod ranks;

use m4gn_dmd::{FitSettings, OnlineDmd, Settings, Storage};
use m4gn_parallel::Comm;
use m4gn_state::{Array, Role};
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
        match compare_driven(comm, mine, &all) {
            Ok(worst) if worst < TOLERANCE => {}
            other => failures.push(format!("{how}, with an input: {other:?}")),
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

/// A number by chance, which moves a wave at once, and its rate later.
fn input(k: i64) -> f64 {
    (k.rem_euclid(97) * 7919 % 97) as f64 / 97.0
}

/// Largest difference to one rank of what a fit with an input says, which some faces alone have.
fn compare_driven(comm: &Comm, mine: &[usize], all: &[usize]) -> m4gn_base::Result<f64> {
    let surrogate = |comm: &Comm, mine: &[usize]| {
        let faces = mine.iter().filter(|i| **i < 7).count();
        let inlet = Array { role: Role::Prescribed, ..Array::carried("inlet", faces) };
        let fields = vec![Array::solved("U", 1, vec![1.0; mine.len()]), inlet];
        let (fit, rest) = (FitSettings::default(), Vec::new());
        OnlineDmd::new(comm, fields, Settings { interval: 0.1, storage: Storage::Double, fit, held: 0, rest })
    };
    let (mut here, mut alone) = (surrogate(comm, mine)?, surrogate(&Comm::serial(), all)?);
    let inlet = |mine: &[usize], k: i64| {
        let faces = mine.iter().filter(|i| **i < 7);
        faces.map(|i| (1.0 + *i as f64) * input(k)).collect::<Vec<f64>>()
    };
    let mut wave = [1.0, 0.0];
    let mut offer = |here: &mut OnlineDmd, alone: &mut OnlineDmd, k: i64| -> m4gn_base::Result<()> {
        let [x, y] = wave;
        wave = [0.9 * x - 0.4 * y + input(k + 1), 0.4 * x + 0.9 * y - 0.3 * input(k)];
        let at = |i: usize| (i as f64 * 0.3).sin() * wave[0] + (i as f64 * 0.7).cos() * wave[1];
        let state = |mine: &[usize]| mine.iter().map(|i| at(*i) + input(k + 1)).collect::<Vec<f64>>();
        let time = 0.1 * k as f64;
        here.offer(time, 0.1, &[&state(mine), &inlet(mine, k + 1)])?;
        alone.offer(time, 0.1, &[&state(all), &inlet(all, k + 1)])?;
        Ok(())
    };
    (0..40).try_for_each(|k| offer(&mut here, &mut alone, k))?;
    let inputs = [&mut here, &mut alone].map(|l| l.fit().map_or(0, |fit| fit.model.inputs()));
    for s in here.asks(12.0) {
        let k = 40 + s as i64;
        here.foresee(s, &[&[], &inlet(mine, k)]);
        alone.foresee(s, &[&[], &inlet(all, k)]);
    }
    let (Some(a), Some(b), [1, 1]) = (here.predict(12.0), alone.predict(12.0), inputs) else {
        return Err(m4gn_base::Error::Numerical(format!("no prediction, or other inputs: {inputs:?}")));
    };
    let (mut own, mut whole) = (vec![0.0; mine.len()], vec![0.0; CELLS]);
    here.field(0, &a, &mut own);
    alone.field(0, &b, &mut whole);
    let differences = own.iter().zip(part(&whole, mine)).map(|(a, b)| (a - b).abs());
    let mut most = [differences.fold(0.0, f64::max)];
    comm.max_f64(&mut most);
    // Behind a gap all states can be used, as a rank that has no such face must know as well
    here.break_off();
    alone.break_off();
    (40..60).try_for_each(|k| offer(&mut here, &mut alone, k))?;
    match (here.usable(), alone.usable()) {
        (a, b) if a == b && a > 20 => Ok(most[0]),
        other => Err(m4gn_base::Error::Numerical(format!("states that can be used: {other:?}"))),
    }
}
