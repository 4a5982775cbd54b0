//! Running one tool: output into a log file, ended when it takes too long, the user stops, or this program ends.

use super::guard::Guard;
use crate::user_case::log::fatal;
use m4gn_base::ffi::ask_to_end;
use m4gn_base::{Error, Result, lock};
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

/// Least and longest time between two looks whether a tool has ended.
const LOOKS: [Duration; 2] = [Duration::from_millis(1), Duration::from_millis(20)];

/// Conditions under which tools run.
#[derive(Clone, Debug)]
pub struct Surroundings {
    /// Nonzero: end what runs and start nothing more.
    pub stop: &'static AtomicU8,
    /// Longest time for one tool.
    pub timeout: Duration,
    /// Whether a tool is asked to end then, and waited for, so that it can save what it has; else it is ended.
    pub asks: bool,
    /// Variables to set.
    pub environment: Vec<(String, std::ffi::OsString)>,
}

impl Surroundings {
    /// Whether the user has asked to stop.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed) != 0
    }

    /// Claims a folder; while another program has it, waits, and tells `say` once for whom.
    ///
    /// # Errors
    /// As [`lock::folder_in_turn`]; [`Error::Interrupted`] when the user stops.
    pub fn take_turn(&self, folder: &Path, say: &mut dyn FnMut(&str)) -> Result<lock::Lock> {
        let mut told = false;
        lock::folder_in_turn(folder, |held| {
            if !std::mem::replace(&mut told, true) {
                say(&format!("waiting: {held}"));
            }
            match self.stopped() {
                true => Err(Error::Interrupted("stopped by the user".into())),
                false => Ok(()),
            }
        })
    }

    /// Runs a command, a program (a name, or a path) and its arguments, in `folder` and waits for it; its output goes to
    /// `log.<name>` there. What the program started and left running is ended with it.
    ///
    /// # Errors
    /// [`Error::Interrupted`] when the user stops; [`Error::File`], naming the log, when the program cannot be
    /// started, fails or takes too long. The program is not running any more then.
    pub fn run(&self, folder: &Path, command: &[impl AsRef<str>]) -> Result<()> {
        let words: Vec<&str> = command.iter().map(AsRef::as_ref).collect();
        let [program, arguments @ ..] = words.as_slice() else {
            return Err(Error::Internal("a command without a program".into()));
        };
        let name = program.rsplit('/').next().unwrap_or(program);
        let log = folder.join(format!("log.{name}"));
        let unwritable = |e: std::io::Error| Error::file(&log, format!("cannot be written: {e}"));
        let output = std::fs::File::create(&log).map_err(unwritable)?;
        let errors = output.try_clone().map_err(unwritable)?;
        let cannot_start = |e: std::io::Error| Error::file(program, format!("cannot be started: {e}"));
        let guard = Guard::start().map_err(cannot_start)?;
        let mut command = Command::new(program);
        command
            .args(arguments)
            .current_dir(folder)
            // OpenFOAM's programs warn of another one, amid what they are asked for
            .envs(folder.is_absolute().then_some(("PWD", folder)))
            .envs(self.environment.iter().map(|(k, v)| (k, v)))
            .stdin(Stdio::null())
            .stdout(output)
            .stderr(errors);
        let mut child = guard.join(&mut command).spawn().map_err(cannot_start)?;
        let start = Instant::now();
        let (mut asked, stopped) = (false, || Error::Interrupted("stopped by the user".into()));
        let ended = loop {
            match child.try_wait() {
                Ok(Some(_)) if asked => break Err(stopped()),
                Ok(Some(status)) => break Ok(status),
                Ok(None) if self.stopped() && self.asks => {
                    if !asked {
                        ask_to_end(child.id());
                    }
                    asked = true;
                    std::thread::sleep(LOOKS[1]);
                }
                Ok(None) if self.stopped() => break Err(stopped()),
                Ok(None) if start.elapsed() > self.timeout => {
                    let seconds = self.timeout.as_secs();
                    break Err(Error::file(&log, format!("{name} was ended after {seconds} s (--timeout)")));
                }
                // Many tools take less than the longest pause
                Ok(None) => std::thread::sleep((start.elapsed() / 8).clamp(LOOKS[0], LOOKS[1])),
                Err(e) => break Err(Error::file(&log, format!("{name} cannot be waited for: {e}"))),
            }
        };
        drop(guard);
        if ended.is_err() {
            let _ = child.wait();
        }
        let status = ended?;
        if status.success() {
            return Ok(());
        }
        // A signal to all of a job ends the program first, and is noticed here a moment later
        if status.signal().is_some() {
            std::thread::sleep(Duration::from_millis(50));
        }
        if self.stopped() {
            return Err(stopped());
        }
        Err(Error::file(&log, format!("{name} failed ({status}){}{}", reason(&log), full(folder))))
    }
}

/// Removes a folder that an earlier run has left. Programs of one that was killed may write for a moment yet, on a busy machine for seconds.
pub(crate) fn clear(folder: &Path) -> Result<()> {
    for _ in 0..100 {
        match std::fs::remove_dir_all(folder) {
            Ok(()) if !folder.exists() => return Ok(()),
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
            Err(e) if e.kind() != ErrorKind::DirectoryNotEmpty => {
                return Err(Error::file(folder, format!("cannot be replaced: {e}")));
            }
            _ => std::thread::sleep(Duration::from_millis(200)),
        }
    }
    Err(Error::file(folder, "cannot be replaced, as another program writes there: wait until it has ended"))
}

/// Least space, kB, with which nothing is said of it.
const LITTLE: u64 = 1024;

/// What is said of a folder on a full disk, as programs themselves often do not.
pub(crate) fn full(folder: &Path) -> String {
    let left = rustix::fs::statvfs(folder).map(|s| s.f_bavail * s.f_frsize / 1024);
    let little = left.ok().filter(|kb| *kb < LITTLE);
    little.map_or(String::new(), |kb| format!("; {kb} kB of disk space are left in {}", folder.display()))
}

/// Most of each end of a log that is read: a program may have written without end.
const READ: usize = 1 << 20;

/// A log, of a long one its begin and its end.
pub fn excerpt(log: &Path) -> String {
    ends(log, READ)
}

/// A file, of one longer than twice `each` bytes so many of its begin and of its end. Empty: it cannot be read.
pub(crate) fn ends(path: &Path, each: usize) -> String {
    let read = || -> std::io::Result<Vec<u8>> {
        let mut file = std::fs::File::open(path)?;
        let (length, each) = (file.metadata()?.len(), each as u64);
        let mut bytes = Vec::new();
        let begin = if length > 2 * each { each } else { length };
        (&mut file).take(begin).read_to_end(&mut bytes)?;
        if begin < length {
            file.seek(SeekFrom::End(-(each as i64)))?;
            bytes.push(b'\n');
            file.take(each).read_to_end(&mut bytes)?;
        }
        Ok(bytes)
    };
    String::from_utf8_lossy(&read().unwrap_or_default()).into_owned()
}

/// What an OpenFOAM program says of its fatal error, or the last line of the log that says something: no rule of Open MPI, and no call that OpenFOAM
/// lists on a signal.
fn reason(log: &Path) -> String {
    let text = excerpt(log);
    let told = |l: &&str| !l.starts_with('#') && l.contains(char::is_alphanumeric);
    let last = || text.lines().map(str::trim).rfind(told).map(|l| l.chars().take(400).collect());
    let shown = fatal(&text).map(|(said, _)| said).or_else(last).filter(|shown| !shown.is_empty());
    shown.map_or(String::new(), |shown| format!(": {shown}"))
}

/// Where each program is in PATH; None where it is not.
pub fn find_program(name: &str) -> Option<PathBuf> {
    use std::os::unix::fs::PermissionsExt;
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|d| d.join(name))
        .find(|p| p.metadata().is_ok_and(|m| m.is_file() && m.permissions().mode() & 0o111 != 0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use m4gn_samples::fails;

    static GO: AtomicU8 = AtomicU8::new(0);
    static STOP: AtomicU8 = AtomicU8::new(1);

    fn surroundings(stop: &'static AtomicU8, milliseconds: u64) -> Surroundings {
        let (timeout, environment) = (Duration::from_millis(milliseconds), vec![("A".into(), "b".into())]);
        Surroundings { stop, timeout, environment, ..crate::fixtures::tools() }
    }

    #[test]
    fn output_and_failures_are_told() {
        let dir = tempfile::tempdir().unwrap();
        let run = |s: Surroundings, script: &str| s.run(dir.path(), &["sh", "-c", script]);
        run(surroundings(&GO, 600_000), "echo $A").unwrap();
        assert_eq!(std::fs::read_to_string(dir.path().join("log.sh")).unwrap(), "b\n");
        let fatal =
            "printf -- '--> FOAM FATAL ERROR: \\n\\nm4gnRecorder cannot record: full\\n\\n From\\n'; exit 1";
        fails(run(surroundings(&GO, 600_000), fatal), &["log.sh", "cannot record: full"]);
        fails(run(surroundings(&GO, 600_000), "kill -9 $$"), &["signal: 9"]);
        let calls = "echo 'Courant Number mean: 1e+56'; echo '#0  sigFpe at ??:?'; echo '#1  ? in icoFoam'; echo -----; kill -8 $$";
        fails(run(surroundings(&GO, 600_000), calls), &["SIGFPE)): Courant Number mean: 1e+56"]);
        fails(run(surroundings(&GO, 100), "sleep 60"), &["--timeout"]);
        assert!(matches!(run(surroundings(&STOP, 600_000), "sleep 60"), Err(Error::Interrupted(_))));
        // A signal to the whole job ends the tool before it is heard of here
        assert!(matches!(run(surroundings(&STOP, 600_000), "kill -15 $$"), Err(Error::Interrupted(_))));
        fails(surroundings(&GO, 9).run(dir.path(), &["no-such-program"]), &["cannot be started"]);
    }

    /// What it does when it is asked is done when the error comes.
    #[test]
    fn a_tool_that_is_asked_to_end_saves_first() {
        static LATER: AtomicU8 = AtomicU8::new(0);
        let dir = tempfile::tempdir().unwrap();
        let script =
            "trap 'sleep 0.2; echo saved > it; exit 1' TERM; echo > begun; while :; do sleep 0.02; done";
        let begun = dir.path().join("begun");
        let stop = std::thread::spawn(move || {
            while !begun.exists() {
                std::thread::sleep(Duration::from_millis(5));
            }
            LATER.store(1, Ordering::Relaxed);
        });
        let tools = Surroundings { asks: true, ..surroundings(&LATER, 60_000) };
        assert!(matches!(tools.run(dir.path(), &["sh", "-c", script]), Err(Error::Interrupted(_))));
        stop.join().unwrap();
        assert_eq!(std::fs::read_to_string(dir.path().join("it")).unwrap(), "saved\n");
    }

    /// A tool that ends leaves nothing of what it started behind.
    #[test]
    fn what_a_tool_started_ends_with_it() {
        let dir = tempfile::tempdir().unwrap();
        let script = "sleep 600 & echo $!";
        surroundings(&GO, 600_000).run(dir.path(), &["sh", "-c", script]).unwrap();
        let log = std::fs::read_to_string(dir.path().join("log.sh")).unwrap();
        let stat = format!("/proc/{}/stat", log.trim());
        // Gone, or a zombie that nobody has waited for.
        let goes_on = || std::fs::read_to_string(&stat).is_ok_and(|state| !state.contains(") Z "));
        let start = Instant::now();
        while goes_on() {
            assert!(start.elapsed() < Duration::from_secs(60), "it goes on");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    #[test]
    fn of_a_long_log_both_ends_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("log");
        std::fs::write(&log, "begin, much between, end").unwrap();
        assert_eq!(ends(&log, 5), "begin\n, end");
        assert_eq!(ends(&log, 12), "begin, much between, end");
        assert_eq!(ends(&dir.path().join("none"), 5), "");
    }

    #[test]
    fn programs_are_found_in_path() {
        assert!(find_program("sh").is_some_and(|p| p.is_absolute()));
        assert_eq!(find_program("no-such-program"), None);
    }
}
