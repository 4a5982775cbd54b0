//! The calls that are tried, what may be odd in them, and how they end.

use crate::host::*;
use crate::{SCENARIO, timed};
use m4gn_parallel::{Comm, operations_since, panic_after};
use m4gn_samples::mesh as sample;
use std::ffi::CString;
use std::ptr::null;

/// What is wrong on the odd rank.
pub type Oddity = &'static str;

/// What may be wrong in a call, by name.
pub fn oddities(call: &str) -> impl Iterator<Item = Oddity> {
    let names = match call {
        "model_open" => "null, no path, no file, other model",
        "session_new" => {
            "null, no mesh, no model, volume, owner, global, components, segments, modes, overlap, \
             iterations, tau, size, method, precision, connected, distance, obstacles, solver, operator, \
             model, labels, text, backend, resolution, solid"
        }
        "session_new_of_body" => {
            "null, no mesh, type, element, inverted, material, position, global, obstacle, triangle, \
             overlap, no obstacle, no types, elements, faces, backend"
        }
        "session_step_of_body" => {
            "nan, obstacle nan, infinite, turned, no displacement, no obstacle, no place"
        }
        "session_step" => "null, no faces, nowhere, no cells, no boundary, no place, nan, infinite",
        "session_outside" => "null, size",
        "segments_new" => {
            "null, no mesh, no options, volume, owner, global, spec, json, solver, modes, labels"
        }
        "modes_new" => "null, no stiffness, no options, nan, column, modes, block, shift, solver, mass",
        "solid_modes_new" => {
            "null, no body, no options, start, global, point, face point, turned, faces, young, no \
             young, poisson, density, modes, free, solver, block, fixed"
        }
        "recorder_new" => "null, no mesh, no options, path, fields, split, overwrite, volume, json",
        "recorder_finish" => "taken, lost",
        "recorder_append" => "null, no faces, no cells, no boundary, nan, time",
        "segments_fit" => "null, no mesh, no options, spec, json, labels, size",
        "ride_new" => {
            "null, no mesh, no settings, no start, time, json, mode, steps, no arrays, count, fewer, more, \
             order, name, no name, other name, place, no place, role, no role, components, items, \
             items below 0, solved, floor, weights"
        }
        "ride_new_of_fit" => {
            "null, no settings, no start, time, json, window, no host, no arrays, count, fewer, name, role, \
             components, items below 0, solved, floor, weights"
        }
        "ride_solved" => "null, missing, nan, no step, time",
        "ride_stride" => "null, missing",
        "ride_stride_of_own" => "null, missing, fails",
        "ride_stride_of_fit" => "null, missing, ahead fails",
        "ride_handed_back" => "null, missing, name, no step, time",
        "ride_save" => "no path, path",
        "ride_load" => "no path, path, time, null, missing",
        _ => "",
    };
    names.split_terminator(", ")
}

/// How a call ended on this rank.
pub struct Ended {
    pub status: i32,
    pub message: String,
    /// Collective operations of it.
    pub operations: i64,
    /// Whether the handle can be used afterwards as it should.
    pub usable: bool,
}

/// How a call ended, or the one that makes what it is given.
pub type Tried = Result<Ended, Ended>;

/// What a good call made.
pub fn made<T>((ended, made): (Ended, T)) -> Result<T, Ended> {
    if ended.status == 0 { Ok(made) } else { Err(ended) }
}

/// Null, or an object that is freed once, under the clock, by its own function.
pub struct Owned<T>(pub *mut T, pub unsafe extern "C" fn(*mut T));

impl<T> Drop for Owned<T> {
    fn drop(&mut self) {
        // SAFETY: of a host's objects, which nothing uses any more.
        timed(|| unsafe { (self.1)(self.0) });
    }
}

/// What all calls are made with.
pub struct Bench {
    pub world: Comm,
    pub folder: tempfile::TempDir,
}

pub const TESTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests");

/// Many more than a call has.
const NEVER: u32 = 1 << 30;

impl Bench {
    pub fn new(world: Comm) -> Self {
        Bench { world, folder: tempfile::tempdir().unwrap() }
    }

    pub fn range(&self, status: i32) -> (i64, i64) {
        let mut both = [i64::from(status), -i64::from(status)];
        self.world.min_i64(&mut both);
        (both[0], -both[1])
    }

    pub fn host(&self, odd: Option<Oddity>) -> Host {
        let whole = sample::triangles(8, 6, 1.0, 0.7);
        let ranks = sample::strips(whole.n_cells(), self.world.size());
        let mut mesh = sample::part(&whole, &ranks, self.world.rank());
        match odd {
            Some("volume") => mesh.cell_volumes[2] = -1.0,
            Some("owner") => mesh.face_owner[1] = 1 << 30,
            Some("global") => mesh.cell_global[0] = 1 << 40,
            _ => (),
        }
        Host::new(mesh)
    }

    /// Makes the call with something odd on this rank, or a panic at an operation of it.
    pub fn run(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        *SCENARIO.lock().unwrap() = format!("{call}, odd {odd:?}, panic {panic:?}");
        let tried = match call {
            "model_open" => Ok(self.model_open(odd, panic)),
            "session_new" => Ok(self.session_new(odd, panic).0),
            "session_new_of_body" => Ok(self.body_new(odd, panic).0),
            "session_step_of_body" => self.body_step(odd, panic),
            "session_step" => self.session_step(odd, panic),
            "session_outside" => self.session_outside(odd, panic),
            "segments_new" => Ok(self.segments_new(odd, panic)),
            "modes_new" => Ok(self.modes_new(odd, panic)),
            "solid_modes_new" => Ok(self.solid_modes_new(odd, panic)),
            "recorder_new" => Ok(self.recorder_new(odd, panic).0),
            "recorder_append" => self.recorder_append(odd, panic),
            "segments_fit" => Ok(self.segments_fit(odd, panic)),
            "ride_new" | "ride_new_of_fit" => self.ride_new(call, odd, panic),
            "recorder_finish" => self.recorder_finish(odd, panic),
            _ => self.ride_call(call, odd, panic),
        };
        tried.unwrap_or_else(|unmade| unmade)
    }

    /// What a call's end is, where the same handle was used again: after bad input it works, after a panic it refuses, on
    /// all ranks. Collective.
    pub fn then(&self, mut ended: Ended, again: Ended) -> Ended {
        let (low_before, _) = self.range(ended.status);
        let (low, high) = self.range(again.status);
        let expected = match low_before < 0 {
            true => high < 0,
            false => low == 0 && high == 0,
        };
        if !expected {
            ended.usable = false;
            let first = ended.message;
            ended.message = format!("{first}; the next call gives {low} to {high}: {}", again.message);
        }
        ended
    }

    /// The call itself, which is under the clock and has the panic.
    pub fn made(&self, panic: Option<u32>, call: impl FnOnce() -> i32) -> Ended {
        self.world.barrier();
        let after = panic.unwrap_or(NEVER);
        panic_after(after);
        let status = timed(call);
        Ended {
            status,
            operations: operations_since(after),
            message: if status != 0 { message() } else { String::new() },
            usable: true,
        }
    }

    pub fn model_open(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let path = c(match odd {
            Some("no file") => "/nowhere/other.safetensors".into(),
            Some("other model") => format!("{TESTS}/e2e/solid.safetensors"),
            _ => format!("{TESTS}/cabi/small.safetensors"),
        });
        let path = unless(odd == Some("no path"), path.as_ptr());
        let mut opened = Owned(none(), m4gn_model_free);
        let place = unless_mut(odd == Some("null"), &raw mut opened.0);
        // SAFETY: a C string or null, and a place or null.
        self.made(panic, || unsafe { m4gn_model_open(self.world.fortran(), path, place) })
    }
}

/// The pointer, or null where that is what is odd.
pub fn unless<T>(is_odd: bool, pointer: *const T) -> *const T {
    if is_odd { null() } else { pointer }
}

/// As [`unless`], of a place that is written to.
pub fn unless_mut<T>(is_odd: bool, pointer: *mut T) -> *mut T {
    unless(is_odd, pointer).cast_mut()
}

pub fn c(text: String) -> CString {
    CString::new(text).unwrap()
}

/// U and p in cells, and zeros at boundary faces.
pub fn values(host: &Host) -> Flow {
    let mut flow = Flow::of(host, 0.0);
    flow.u.iter_mut().enumerate().for_each(|(i, u)| *u = 0.01 * i as f64);
    flow.p.fill(1.0);
    flow
}
