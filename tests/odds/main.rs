//! One rank at odds with the others, in every collective call of m4gn.h: bad input, other options, a panic. All return the same class of status
//! within two minutes. Where a rank is killed, the job ends with a message.
//!
//! `cargo test --test odds` starts mpirun with this program on 2 and 3 ranks, once for what is odd in all calls and once for each
//! kill; `--test odds -- step` only for the calls with this in their names.
#![allow(unsafe_code)]

mod bodies;
mod calls;
#[path = "../host/mod.rs"]
mod host;
mod matrices;
mod recording;
mod riding;
mod surrogate;

use calls::{Bench, oddities};
use m4gn_parallel::{Comm, finalize, panic_text};
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Longest that any call may take on any rank, on a busy machine too: none waits for more than the ten seconds of `src/parallel/guard.rs`.
const LIMIT: Duration = Duration::from_secs(120);

/// Most places in a call at which a panic is tried.
const PLACES: i64 = 12;

/// What the panics say that a test asks for.
const FAULT: &str = "a fault that a test asked for";

const CALLS: [&str; 22] = [
    "model_open",
    "session_new",
    "session_step",
    "session_outside",
    "session_new_of_body",
    "session_step_of_body",
    "segments_new",
    "modes_new",
    "solid_modes_new",
    "recorder_new",
    "recorder_append",
    "recorder_finish",
    "segments_fit",
    "ride_new",
    "ride_new_of_fit",
    "ride_solved",
    "ride_stride",
    "ride_stride_of_own",
    "ride_stride_of_fit",
    "ride_handed_back",
    "ride_save",
    "ride_load",
];

fn main() -> ExitCode {
    let asked = std::env::var("M4GN_ODDS");
    match asked {
        Ok(asked) => worker(&asked),
        Err(_) => driver(),
    }
}

// ---- the driver: mpirun, and the clock ----

fn driver() -> ExitCode {
    let filter = std::env::args().nth(1).filter(|a| !a.starts_with('-'));
    let chosen = CALLS.iter().filter(|c| filter.as_ref().is_none_or(|f| c.contains(f.as_str())));
    let chosen: Vec<&str> = chosen.copied().collect();
    let mut jobs = Vec::new();
    for (ranks, kill) in [(2, "kill_first"), (3, "kill_middle")] {
        jobs.push((ranks, chosen.clone(), "odds"));
        // mpirun ends a job whose rank is killed, whatever the others wait in: one call shows it.
        jobs.extend(chosen.iter().filter(|c| **c == "ride_solved").map(|c| (ranks, vec![*c], kill)));
    }
    jobs.retain(|(_, calls, _)| !calls.is_empty());
    // The longest first; a start of mpirun is more waiting than work, so that each core has two
    jobs.sort_by_key(|(_, _, kind)| *kind != "odds");
    let at_once = 2 * std::thread::available_parallelism().map_or(1, usize::from);
    let (mut passed, mut failed) = (0, 0);
    for some in jobs.chunks(at_once) {
        let ended: Vec<_> = std::thread::scope(|scope| {
            let mut launched = Vec::new();
            for (ranks, calls, kind) in some {
                launched.push(scope.spawn(move || launch(calls, kind, *ranks)));
            }
            launched.into_iter().map(|job| job.join().expect("mpirun")).collect()
        });
        for ((ranks, calls, kind), (well, text)) in some.iter().zip(ended) {
            for call in calls {
                let good = well.contains(call);
                println!("test {call}::{kind}::on_{ranks} ... {}", if good { "ok" } else { "FAILED" });
                *(if good { &mut passed } else { &mut failed }) += 1;
            }
            if well.len() < calls.len() {
                println!("{text}");
            }
        }
    }
    let verdict = if failed == 0 { "ok" } else { "FAILED" };
    println!("\ntest result: {verdict}. {passed} passed; {failed} failed; 0 ignored");
    ExitCode::from(u8::from(failed > 0))
}

/// The calls that ended as they should, and what the job said.
fn launch<'a>(calls: &[&'a str], kind: &str, ranks: usize) -> (Vec<&'a str>, String) {
    let started = Instant::now();
    let mut job = Command::new("mpirun")
        .args(["--allow-run-as-root", "--oversubscribe", "-np", &ranks.to_string()])
        .arg(std::env::current_exe().unwrap())
        .env("M4GN_ODDS", format!("{kind} {}", calls.join(" ")))
        .env("OMPI_MCA_mpi_yield_when_idle", "1")
        .env("OMP_NUM_THREADS", "1")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("mpirun");
    // A killed rank ends the job at once; the other kind has a clock of its own for each call.
    let kill = kind.starts_with("kill");
    let limit = if kill { LIMIT } else { 20 * LIMIT };
    let status = loop {
        match job.try_wait().unwrap() {
            Some(status) => break Some(status),
            None if started.elapsed() > limit => {
                let _ = job.kill();
                break None;
            }
            None => std::thread::sleep(Duration::from_millis(50)),
        }
    };
    let output = job.wait_with_output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    let ended = status.map_or(format!("did not end in {} s", limit.as_secs()), |status| status.to_string());
    let well = |call: &&&str| match (status, kill) {
        (None, _) => false,
        (Some(status), true) => !status.success() && text.contains("signal 9"),
        (Some(_), false) => text.contains(&format!("odds: {call} passed\n")),
    };
    (calls.iter().filter(well).copied().collect(), format!("{ended}\n{text}"))
}

// ---- a rank ----

/// Seconds since the start at which the scenario under way is too late; 0: none is.
static DEADLINE: AtomicU64 = AtomicU64::new(0);

fn watch() {
    let started = Instant::now();
    std::thread::spawn(move || {
        loop {
            std::thread::sleep(Duration::from_millis(200));
            let deadline = DEADLINE.load(Ordering::Relaxed);
            if deadline != 0 && started.elapsed().as_millis() as u64 > deadline {
                let what = SCENARIO.lock().unwrap();
                eprintln!("odds: a call took more than {} s: {what}", LIMIT.as_secs());
                std::process::abort();
            }
        }
    });
    CLOCK.get_or_init(|| started);
}

/// What is tried.
static SCENARIO: std::sync::Mutex<String> = std::sync::Mutex::new(String::new());

static CLOCK: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();

/// Runs a call under the clock.
fn timed<T>(call: impl FnOnce() -> T) -> T {
    let now = CLOCK.get().unwrap().elapsed();
    DEADLINE.store((now + LIMIT).as_millis() as u64, Ordering::Relaxed);
    let value = call();
    DEADLINE.store(0, Ordering::Relaxed);
    value
}

fn worker(asked: &str) -> ExitCode {
    watch();
    let (kind, calls) = asked.split_once(' ').unwrap();
    let world = Comm::world().unwrap();
    for call in calls.split(' ') {
        let bench = Bench::new(world.clone());
        let failures = match kind {
            "odds" => {
                // The panics asked for are no news.
                std::panic::set_hook(Box::new(|_| ()));
                odds(&bench, call)
            }
            _ => vec![killed(&bench, call, kind)],
        };
        let failed = world.any(!failures.is_empty());
        for failure in &failures {
            eprintln!("rank {}: {call}: {failure}", world.rank());
        }
        if !failed && world.is_root() {
            println!("odds: {call} passed");
        }
    }
    drop(world);
    finalize();
    ExitCode::SUCCESS
}

/// One rank is gone in the middle of the call: mpirun ends the others before they come back with what is wrong.
fn killed(bench: &Bench, call: &str, kind: &str) -> String {
    let world = &bench.world;
    let (first, last) = (0, world.size() - 1);
    // Others wait for the first rank in another way than for the last.
    let (rank, at) = match kind {
        "kill_first" => (last, 0),
        _ => (first, bench.run(call, None, None).operations / 2),
    };
    let odd = world.rank() == rank;
    if odd {
        // The panic asked for kills instead; any other one is a fault of the test.
        std::panic::set_hook(Box::new(|panic| {
            if !panic_text(panic.payload()).contains(FAULT) {
                return eprintln!("odds: {panic}");
            }
            // SAFETY: ends this process.
            unsafe { libc::raise(libc::SIGKILL) };
        }));
    }
    bench.run(call, None, odd.then_some(at as u32));
    // A call that another rank's death does not keep may be over before mpirun knows of it.
    std::thread::sleep(LIMIT);
    "the job outlived the killed rank".into()
}

fn odds(bench: &Bench, call: &str) -> Vec<String> {
    let world = &bench.world;
    let mut failures = Vec::new();
    let good = bench.run(call, None, None);
    if good.status != 0 {
        return vec![format!("a good call gives {}: {}", good.status, good.message)];
    }
    for odd_rank in [0, world.size() - 1] {
        let odd = world.rank() == odd_rank;
        for what in oddities(call) {
            let found = bench.run(call, odd.then_some(what), None);
            let (low, high) = bench.range(found.status);
            if low <= 0 {
                failures.push(format!(
                    "'{what}' on rank {odd_rank}: statuses from {low} to {high}; here {} {}",
                    found.status, found.message
                ));
            }
            if !found.usable {
                failures.push(format!("'{what}' on rank {odd_rank} broke the handle: {}", found.message));
            }
        }
        let n = good.operations;
        let step = (n / PLACES).max(1);
        for at in (0..n).step_by(step as usize) {
            let found = bench.run(call, None, odd.then_some(at as u32));
            let (low, high) = bench.range(found.status);
            if high >= 0 || !found.message.contains(FAULT) {
                failures.push(format!(
                    "a panic on rank {odd_rank} at operation {at} of {n}: statuses from {low} to {high}; here {} {}",
                    found.status, found.message
                ));
            }
            if !found.usable {
                failures.push(format!(
                    "a panic on rank {odd_rank} at operation {at} of {n} left a handle that is not refused: {}",
                    found.message
                ));
            }
        }
        // The host and its communicator are as good as before.
        let after = bench.run(call, None, None);
        if after.status != good.status {
            failures.push(format!("a good call afterwards gives {}: {}", after.status, after.message));
        }
    }
    failures
}
