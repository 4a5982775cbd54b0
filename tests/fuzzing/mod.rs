//! What all fuzz targets share: valid input that is damaged by a seeded generator, and what must hold for each case.
//!
//! No panic, no crash, no case longer than [`PATIENCE`], and no more memory than ten times the input and a constant.
//! `M4GN_FUZZ_SECONDS` is the time of each target (3 s by default; an hour: 3600), `M4GN_FUZZ_SEED` where it begins. The
//! number of the case under way stands in `$TMPDIR/m4gn-fuzz-TARGET`, so that a crash can be made again:
//! `M4GN_FUZZ_SEED=N M4GN_FUZZ_SECONDS=0`.
// Each test program uses a part of it.
#![allow(dead_code, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Longest that a case may take, on a busy machine too: the slowest take seconds.
pub const PATIENCE: Duration = Duration::from_secs(600);

/// Memory that a case may hold beside ten times its input.
pub const CONSTANT: usize = 64 << 20;

// ---- memory ----

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

/// Counts what each thread holds.
pub struct Counting;

fn count(change: isize) {
    // A thread that is being torn down counts no more.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + change);
        PEAK.with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: the system's allocator does the work.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's contract.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: the caller's contract.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // The old and the new one are both there for a while.
        count(size as isize);
        count(-(layout.size() as isize));
        // SAFETY: the caller's contract.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// ---- the generator ----

/// splitmix64: small, and the same everywhere.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x6a09_e667_f3bc_c908)
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// 0 to n - 1; 0 for none.
    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }

    /// Numbers at which programs break.
    pub fn integer(&mut self) -> i64 {
        let odd = [0, 1, -1, 2, 3, 7, 8, 63, 255, 256, 16777217, 2147483647, i64::MAX, i64::MIN];
        match self.below(5) {
            0 => self.next() as i64,
            1 => self.next() as i64 % 40,
            2 => *self.pick(&[-1, 1, 1]) << self.below(63),
            _ => *self.pick(&odd),
        }
    }

    /// The same for reals.
    pub fn real(&mut self) -> f64 {
        let (inf, nan, most, step) = (f64::INFINITY, f64::NAN, f64::MAX, f64::EPSILON);
        let odd = [
            0.0, -0.0, 1.0, -1.0, 0.5, nan, inf, -inf, most, -most, 1e300, -1e300, 1e154, 1e38, 1e-38,
            1e-300, 5e-324, step, 1e11, -7.25,
        ];
        match self.below(4) {
            0 => f64::from_bits(self.next()),
            _ => *self.pick(&odd),
        }
    }

    /// Damages bytes: one to a few times, in any of the ways files get damaged, and some that only an enemy finds.
    pub fn damage(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..1 + self.below(3) {
            let n = bytes.len();
            if n == 0 {
                bytes.push(self.next() as u8);
                continue;
            }
            let at = self.below(n);
            match self.below(10) {
                0 => bytes[at] ^= 1 << self.below(8),
                1 => {
                    bytes[at] =
                        *self.pick(&[0, 1, 0x7f, 0x80, 0xff, b'"', b'{', b'}', b'[', b'-', b'\n', b'e'])
                }
                2 => bytes.truncate(at),
                3 => {
                    let end = (at + 1 + self.below(64)).min(n);
                    bytes.drain(at..end);
                }
                4 => {
                    let end = (at + 1 + self.below(64)).min(n);
                    let copy = bytes[at..end].to_vec();
                    let to = self.below(n);
                    bytes.splice(to..to, copy);
                }
                5 => put(bytes, at & !3, &self.integer().to_le_bytes()[..4]),
                6 => put(bytes, at & !7, &self.integer().to_le_bytes()),
                7 => put(bytes, at & !7, &self.real().to_le_bytes()),
                8 => self.damage_number(bytes, at),
                _ => {
                    let end = (at + 1 + self.below(16)).min(n);
                    for b in &mut bytes[at..end] {
                        *b = self.next() as u8;
                    }
                }
            }
        }
    }

    /// Damages a text: a number of it, or bytes.
    pub fn damage_text(&mut self, bytes: &mut Vec<u8>) {
        let at = self.below(bytes.len());
        match self.below(2) {
            0 => self.damage_number(bytes, at),
            _ => self.damage(bytes),
        }
    }

    /// Puts another number in the place of the next one that is written in digits.
    pub fn damage_number(&mut self, bytes: &mut Vec<u8>, from: usize) {
        let digit = |b: &u8| b.is_ascii_digit();
        let Some(start) = bytes[from..].iter().position(digit).map(|i| i + from) else {
            return;
        };
        let length = bytes[start..].iter().take_while(|b| digit(b)).count();
        let text = match self.below(3) {
            0 => format!("{:e}", self.real()),
            _ => self.integer().to_string(),
        };
        bytes.splice(start..start + length, text.into_bytes());
    }
}

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    let end = (at + value.len()).min(bytes.len());
    bytes[at..end].copy_from_slice(&value[..end - at]);
}

// ---- the run ----

/// Runs cases of a target for its time: `case` damages something by the generator, gives it to what is tested, and says
/// how large it was, bytes.
///
/// # Panics
/// When a case does, is too slow, or takes too much memory; the message says which one.
pub fn fuzz(target: &str, mut case: impl FnMut(&mut Random) -> usize) {
    let number =
        |name: &str, default: u64| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(default);
    let (seconds, first) = (number("M4GN_FUZZ_SECONDS", 3), number("M4GN_FUZZ_SEED", 1));
    let path = std::env::temp_dir().join(format!("m4gn-fuzz-{target}"));
    let mut note = std::fs::File::create(&path).unwrap();
    watch();
    let began = Instant::now();
    let (mut seed, mut slowest, mut most) = (first, Duration::ZERO, 0);
    loop {
        // Over the same place, so that the file stays small.
        let _ = std::os::unix::fs::FileExt::write_all_at(&note, format!("{seed:<20}\n").as_bytes(), 0);
        UNDER_WAY.lock().unwrap().push((target.to_string(), seed, Instant::now()));
        let started = Instant::now();
        let held = HELD.with(Cell::get);
        PEAK.with(|p| p.set(held));
        let outcome = catch_unwind(AssertUnwindSafe(|| case(&mut Random::new(seed))));
        let grown = (PEAK.with(Cell::get) - held).max(0) as usize;
        UNDER_WAY.lock().unwrap().retain(|c| c.0 != target);
        let again = format!("fuzz target {target}, M4GN_FUZZ_SEED={seed}");
        match outcome {
            Ok(size) => assert!(
                grown <= CONSTANT + 10 * size,
                "{again}: {grown} bytes of memory for an input of {size}"
            ),
            Err(_) => panic!("{again}: panicked, see above"),
        }
        slowest = slowest.max(started.elapsed());
        most = most.max(grown);
        seed += 1;
        if began.elapsed().as_secs() >= seconds {
            break;
        }
    }
    let _ = note.flush();
    let _ = std::fs::remove_file(path);
    println!(
        "{target}: {} cases, the slowest {:.2} s, the most memory {:.1} MB",
        seed - first,
        slowest.as_secs_f64(),
        most as f64 / 1e6
    );
}

/// Cases under way, and since when.
static UNDER_WAY: Mutex<Vec<(String, u64, Instant)>> = Mutex::new(Vec::new());

/// Ends the process when a case takes too long: it cannot be stopped otherwise.
fn watch() {
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        std::thread::spawn(|| {
            loop {
                std::thread::sleep(Duration::from_millis(500));
                let late = |c: &&(String, u64, Instant)| c.2.elapsed() > PATIENCE;
                if let Some((target, seed, _)) = UNDER_WAY.lock().unwrap().iter().find(late) {
                    eprintln!("fuzz target {target}, M4GN_FUZZ_SEED={seed}: more than {PATIENCE:?}");
                    std::process::abort();
                }
            }
        });
    });
}
