//! The C interface of m4gn-averages; `m4gn_averages.h` says what each function does.
#![allow(unsafe_code)]

use m4gn_averages::estimate::MIN_ROWS;
use m4gn_averages::{Estimate, Goal, Row, Tolerance, Watch, saved};
use m4gn_base::ffi::fpe::without_traps;
use m4gn_base::{Error, Result, refuse_any};
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

struct Quantity {
    name: String,
    /// Name and source, by which it is found in a file.
    key: String,
    of_rms: bool,
    watch: Watch,
    last: Option<Estimate>,
    /// Whether the value that came last was not finite: rows end there, and the run may have diverged.
    broken_off: bool,
}

/// `m4gn_averages`.
pub struct Averages {
    confidence: f64,
    all: Vec<Quantity>,
}

/// `m4gn_averages_figures`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Figures {
    mean: f64,
    half_width: f64,
    rms: f64,
    rms_half_width: f64,
    frequency: f64,
    frequency_resolution: f64,
    transient_end: f64,
    independent_samples: f64,
    surrogate_share: f64,
    rows: i64,
    settled: i32,
    unvaried: i32,
}

/// Runs `body` with the host's floating-point traps off; a panic becomes an error.
fn guarded<T>(body: impl FnOnce() -> Result<T>) -> Result<T> {
    without_traps(|| catch_unwind(AssertUnwindSafe(body)))
        .unwrap_or_else(|_| Err(Error::Internal("a panic in m4gn-averages".into())))
}

/// The text of a pointer; empty of null.
///
/// # Safety
/// Null, or a string that ends with a zero.
unsafe fn text<'a>(pointer: *const c_char) -> std::borrow::Cow<'a, str> {
    match pointer.is_null() {
        true => "".into(),
        // SAFETY: the caller's contract.
        false => unsafe { CStr::from_ptr(pointer) }.to_string_lossy(),
    }
}

/// Puts as much of a text as there is room for, and a zero behind it.
///
/// # Safety
/// Null, or room for `size` bytes.
unsafe fn put(text: &str, to: *mut c_char, size: usize) {
    if to.is_null() || size == 0 {
        return;
    }
    let mut count = text.len().min(size - 1);
    while !text.is_char_boundary(count) {
        count -= 1;
    }
    // SAFETY: count and the zero are no more than size bytes, and the text is not the host's.
    unsafe {
        std::ptr::copy_nonoverlapping(text.as_ptr(), to.cast(), count);
        to.add(count).write(0);
    }
}

/// 0, or 1 with the error's message where the host wants it.
///
/// # Safety
/// As [`put`].
unsafe fn status(result: Result<()>, why: *mut c_char, size: usize) -> i32 {
    match result {
        Ok(()) => 0,
        Err(e) => {
            // SAFETY: the caller's contract.
            unsafe { put(&e.to_string(), why, size) };
            1
        }
    }
}

/// `m4gn_averages_new`.
#[unsafe(no_mangle)]
pub extern "C" fn m4gn_averages_new(confidence: f64) -> *mut Averages {
    match confidence > 0.0 && confidence < 1.0 {
        true => Box::into_raw(Box::new(Averages { confidence, all: Vec::new() })),
        false => std::ptr::null_mut(),
    }
}

/// `m4gn_averages_free`.
///
/// # Safety
/// Null, or a handle that is not used any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_free(averages: *mut Averages) {
    if !averages.is_null() {
        // SAFETY: m4gn_averages_new made it.
        drop(unsafe { Box::from_raw(averages) });
    }
}

/// `m4gn_averages_add`.
///
/// # Safety
/// A handle, and strings that end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_add(
    averages: *mut Averages,
    name: *const c_char,
    source: *const c_char,
    tolerance: f64,
    relative: i32,
    of_rms: i32,
) {
    // SAFETY: the caller's contract.
    let (Some(averages), name, source) = (unsafe { (averages.as_mut(), text(name), text(source)) }) else {
        return;
    };
    let limit = match tolerance > 0.0 {
        false => None,
        true if relative != 0 => Some(Tolerance::Relative(tolerance)),
        true => Some(Tolerance::Absolute(tolerance)),
    };
    let goal = match of_rms != 0 {
        true => Goal { mean: None, rms: limit },
        false => Goal { mean: limit, rms: None },
    };
    averages.all.push(Quantity {
        key: format!("{name}\n{source}"),
        name: name.into_owned(),
        of_rms: of_rms != 0,
        watch: Watch::new(averages.confidence, goal),
        last: None,
        broken_off: false,
    });
}

/// `m4gn_averages_carry_on`.
///
/// # Safety
/// Two handles.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_carry_on(averages: *mut Averages, before: *const Averages) -> i32 {
    // SAFETY: the caller's contract.
    let (Some(averages), Some(before)) = (unsafe { (averages.as_mut(), before.as_ref()) }) else { return 0 };
    let mut found = 0;
    for quantity in &mut averages.all {
        if let Some(old) = before.all.iter().find(|old| old.key == quantity.key) {
            quantity.watch.carry_on(old.watch.state(), old.watch.series.rows());
            found += 1;
        }
    }
    found
}

/// `m4gn_averages_push`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_push(
    averages: *mut Averages,
    series: usize,
    time: f64,
    value: f64,
    weight: f64,
    surrogate: i32,
) -> i32 {
    // SAFETY: the caller's contract.
    let found = unsafe { averages.as_mut() }.and_then(|a| a.all.get_mut(series));
    let Some(quantity) = found else { return 1 };
    quantity.broken_off = !value.is_finite();
    i32::from(!quantity.watch.series.push(Row { time, value, weight, surrogate: surrogate != 0 }))
}

/// `m4gn_averages_due`.
///
/// # Safety
/// A handle.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_due(averages: *const Averages) -> i32 {
    // SAFETY: the caller's contract.
    let all = unsafe { averages.as_ref() }.map(|a| a.all.as_slice()).unwrap_or_default();
    // A series that began later is looked at with the others: two checks in a row are not to rest on the same rows
    let longest = all.iter().max_by_key(|q| q.watch.series.len());
    i32::from(longest.is_some_and(|q| q.watch.due()))
}

/// `m4gn_averages_check`.
///
/// # Safety
/// A handle, and a place for the figures.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_check(
    averages: *mut Averages,
    series: usize,
    figures: *mut Figures,
) -> i32 {
    // SAFETY: the caller's contract.
    let (averages, figures) = unsafe { (averages.as_mut(), figures.as_mut()) };
    let (Some(quantity), Some(figures)) = (averages.and_then(|a| a.all.get_mut(series)), figures) else {
        return 1;
    };
    *figures = Figures { rows: quantity.watch.series.len() as i64, ..Figures::default() };
    quantity.last = guarded(|| Ok(quantity.watch.check())).unwrap_or_default();
    // Of a run that has diverged the rows before say nothing
    let Some(found) = quantity.last.as_ref().filter(|_| !quantity.broken_off) else { return 1 };
    *figures = Figures {
        mean: found.mean,
        half_width: found.half_width,
        rms: found.rms,
        rms_half_width: found.rms_half_width,
        frequency: found.frequency.unwrap_or(0.0),
        frequency_resolution: found.frequency_resolution.unwrap_or(0.0),
        transient_end: found.transient_end,
        independent_samples: found.independent_samples,
        surrogate_share: found.surrogate_share,
        rows: figures.rows,
        settled: i32::from(quantity.watch.settled()),
        unvaried: i32::from(found.unvaried),
    };
    0
}

/// `m4gn_averages_line`.
///
/// # Safety
/// A handle, and room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_line(
    averages: *const Averages,
    series: usize,
    to: *mut c_char,
    size: usize,
) {
    // SAFETY: the caller's contract.
    let found = unsafe { averages.as_ref() }.and_then(|a| Some((a.all.get(series)?, a.confidence)));
    let mut line = match found {
        Some((Quantity { name, last: Some(e), of_rms, .. }, confidence)) => {
            if *of_rms {
                e.rms_line(name, confidence)
            } else {
                e.line(name, confidence)
            }
        }
        Some((Quantity { name, watch, .. }, _)) => match watch.series.len() {
            rows if rows < MIN_ROWS => format!("{name}: too few rows, {rows}"),
            rows => format!("{name}: the squares of {rows} values are too large; look for what diverged"),
        },
        None => String::new(),
    };
    if found.is_some_and(|(quantity, _)| quantity.broken_off) {
        line += ", the last value is not finite";
    }
    // SAFETY: the caller's contract.
    unsafe { put(&line, to, size) };
}

/// `m4gn_averages_save`.
///
/// # Safety
/// A handle, a string that ends with a zero, and room for `size` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_save(
    averages: *const Averages,
    path: *const c_char,
    why: *mut c_char,
    size: usize,
) -> i32 {
    // SAFETY: the caller's contract.
    let (averages, path) = unsafe { (averages.as_ref(), text(path)) };
    let all = averages.map(|a| a.all.as_slice()).unwrap_or_default();
    let done = guarded(|| saved::write(Path::new(&*path), all.iter().map(|q| (q.key.as_str(), &q.watch))));
    // SAFETY: the caller's contract.
    unsafe { status(done, why, size) }
}

/// `m4gn_averages_load`.
///
/// # Safety
/// As [`m4gn_averages_save`].
#[unsafe(no_mangle)]
pub unsafe extern "C" fn m4gn_averages_load(
    averages: *mut Averages,
    path: *const c_char,
    latest: f64,
    why: *mut c_char,
    size: usize,
) -> i32 {
    // SAFETY: the caller's contract.
    let (averages, path) = unsafe { (averages.as_mut(), text(path)) };
    let done = guarded(|| {
        let found = saved::read(Path::new(&*path))?;
        let ends = found.iter().filter_map(|saved| saved.rows.last()).map(|row| row.time);
        let behind = ends.max_by(f64::total_cmp).filter(|end| *end > latest);
        refuse_any(
            behind,
            |m| Error::file(&*path, m),
            |end| {
                format!(
                    "has series up to time {end}, later than this run starts: expected those of a run that was at this time, and not of a folder that was renamed"
                )
            },
        )?;
        let mut any = false;
        for quantity in averages.map(|a| a.all.as_mut_slice()).unwrap_or_default() {
            if let Some(saved) = found.iter().find(|saved| saved.name == quantity.key) {
                quantity.watch.carry_on(saved.state, &saved.rows);
                any = true;
            }
        }
        let other = || {
            Error::file(
                &*path,
                "has series of other quantities: expected functionObject, result and component as in the run before",
            )
        };
        any.then_some(()).ok_or_else(other)
    });
    // SAFETY: the caller's contract.
    unsafe { status(done, why, size) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_gets_what_the_crate_finds_and_carries_on_with_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = std::ffi::CString::new(folder.path().join("a.state").to_str().unwrap()).unwrap();
        let why = &mut [0 as c_char; 200];
        // SAFETY: handles, strings and rooms are this test's own and as large as is said.
        unsafe {
            assert!(m4gn_averages_new(1.0).is_null());
            let make = || {
                let a = m4gn_averages_new(0.95);
                m4gn_averages_add(a, c"Cl".as_ptr(), c"forces Cl none".as_ptr(), 0.05, 1, 1);
                a
            };
            let a = make();
            for i in 1..=500 {
                let time = 0.02 * f64::from(i);
                assert_eq!(m4gn_averages_push(a, 0, time, (std::f64::consts::TAU * time).sin(), 0.02, 0), 0);
            }
            assert_eq!(m4gn_averages_push(a, 0, 1.0, 0.0, 0.02, 0), 1, "earlier");
            assert_eq!(m4gn_averages_push(a, 1, 20.0, 0.0, 0.02, 0), 1, "no such series");
            assert_eq!(m4gn_averages_due(a), 1);
            let mut figures = Figures::default();
            assert_eq!(m4gn_averages_check(a, 0, &mut figures), 0);
            assert!((figures.rms - 0.5_f64.sqrt()).abs() < 0.01 && figures.settled == 0, "{figures:?}");
            assert_eq!(m4gn_averages_due(a), 0);
            m4gn_averages_line(a, 0, why.as_mut_ptr(), why.len());
            let line = text(why.as_ptr()).into_owned();
            assert!(line.starts_with("Cl rms 0.7"), "{line}");
            m4gn_averages_line(a, 0, why.as_mut_ptr(), 4);
            assert_eq!(text(why.as_ptr()), "Cl ");
            assert_eq!(m4gn_averages_save(a, path.as_ptr(), why.as_mut_ptr(), why.len()), 0);
            let b = make();
            assert_eq!(m4gn_averages_load(b, path.as_ptr(), 9.9, why.as_mut_ptr(), why.len()), 1);
            assert!(text(why.as_ptr()).contains("has series up to time 10, later"), "{}", text(why.as_ptr()));
            assert_eq!(m4gn_averages_check(b, 0, &mut figures), 1, "no rows");
            assert_eq!(m4gn_averages_load(b, path.as_ptr(), 10.0, why.as_mut_ptr(), why.len()), 0);
            assert_eq!(m4gn_averages_check(b, 0, &mut figures), 0);
            assert_eq!((figures.rows, figures.settled), (500, 1), "the second check in a row");
            assert_eq!(m4gn_averages_push(b, 0, 10.02, f64::NAN, 0.02, 0), 1);
            assert_eq!(m4gn_averages_check(b, 0, &mut figures), 1, "a run that has diverged knows nothing");
            assert_eq!((figures.rows, figures.settled), (500, 0));
            m4gn_averages_line(b, 0, why.as_mut_ptr(), why.len());
            assert!(text(why.as_ptr()).ends_with(", the last value is not finite"), "{}", text(why.as_ptr()));
            assert_eq!(m4gn_averages_push(b, 0, 10.04, 0.0, 0.02, 0), 0);
            m4gn_averages_line(b, 0, why.as_mut_ptr(), why.len());
            assert!(!text(why.as_ptr()).contains("finite"), "{}", text(why.as_ptr()));
            let c = m4gn_averages_new(0.9);
            m4gn_averages_add(c, c"Cd".as_ptr(), c"forces Cd none".as_ptr(), 0.05, 1, 0);
            m4gn_averages_add(c, c"Cl".as_ptr(), c"forces Cl none".as_ptr(), 0.1, 1, 1);
            assert_eq!(m4gn_averages_carry_on(c, a), 1, "Cl alone");
            assert_eq!(m4gn_averages_check(c, 0, &mut figures), 1, "no rows");
            assert_eq!(m4gn_averages_check(c, 1, &mut figures), 0);
            assert_eq!((figures.rows, figures.settled), (500, 0), "the first check of this tolerance");
            m4gn_averages_free(c);
            let other = m4gn_averages_new(0.95);
            m4gn_averages_add(other, c"Cl".as_ptr(), c"forces2 Cl none".as_ptr(), 0.05, 1, 1);
            assert_eq!(m4gn_averages_load(other, path.as_ptr(), 10.0, why.as_mut_ptr(), why.len()), 1);
            assert!(text(why.as_ptr()).contains("has series of other quantities"));
            m4gn_averages_free(other);
            let large = make();
            for i in 1..=20 {
                assert_eq!(m4gn_averages_push(large, 0, f64::from(i), 1e200 * f64::from(i), 1.0, 0), 0);
            }
            assert_eq!(m4gn_averages_check(large, 0, &mut figures), 1);
            m4gn_averages_line(large, 0, why.as_mut_ptr(), why.len());
            assert!(text(why.as_ptr()).starts_with("Cl: the squares of 20 values are too large"));
            m4gn_averages_free(large);
            assert_eq!(m4gn_averages_load(b, c"/nowhere".as_ptr(), 10.0, why.as_mut_ptr(), why.len()), 1);
            assert!(text(why.as_ptr()).starts_with("/nowhere: cannot be read"));
            m4gn_averages_free(a);
            m4gn_averages_free(b);
            m4gn_averages_free(std::ptr::null_mut());
        }
    }
}
