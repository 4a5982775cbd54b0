//! Hybrid runs: of a network, of a surrogate of the host's own, and of a fit.

use crate::calls::{Bench, Ended, Oddity, Owned, Tried, c, made, unless, unless_mut, values};
use crate::host::*;
use serde_json::json;
use std::cell::Cell;
use std::ffi::c_void;
use std::ptr::null;

/// A stride of all surrogates is two of these, s.
const STEP: f64 = 0.005;

/// Steps of the solver before the call, after which a network jumps.
const STEPS: i64 = 12;

/// Steps after which a fit has jumped.
const MOST: i64 = 60;

/// Index of p and of the prescribed array in the state.
const P: usize = 1;
const INLET: usize = 4;

/// What rides.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Network,
    Own,
    Fit,
}

fn kind_of(call: &str) -> Kind {
    match call {
        "ride_stride_of_own" => Kind::Own,
        // A network of random weights is not let jump by its control, and without one the last call needs no state.
        "ride_new_of_fit" | "ride_stride_of_fit" | "ride_handed_back" => Kind::Fit,
        _ => Kind::Network,
    }
}

/// What the host's functions are given, which are called within a call.
struct Back {
    /// Numbers of p on this rank.
    n: usize,
    index: Cell<i64>,
    /// How they end.
    status: Cell<i32>,
}

fn inlet(index: f64) -> f64 {
    (0.15 * index).cos()
}

extern "C" fn step(data: *mut c_void, state: *const *const f64, next: *const *mut f64) -> i32 {
    // SAFETY: the data of a ride below, and arrays of the lengths that it described.
    unsafe {
        let back = &*data.cast::<Back>();
        for i in 0..back.n {
            *(*next.add(P)).add(i) = *(*state.add(P)).add(i) + 1.0;
        }
        back.status.get()
    }
}

extern "C" fn ahead(data: *mut c_void, later: f64, arrays: *const *mut f64) -> i32 {
    // SAFETY: as above.
    unsafe {
        let back = &*data.cast::<Back>();
        **arrays.add(INLET) = inlet(back.index.get() as f64 + later / STEP);
        back.status.get()
    }
}

fn now(index: i64) -> RideStep {
    ride_step(index, STEP)
}

/// A ride on a mesh, with what it is given.
struct Riding<'a> {
    /// Freed before what it may call.
    ride: Owned<RideHandle>,
    bench: &'a Bench,
    host: Host,
    back: Box<Back>,
    /// Steps so far.
    index: Cell<i64>,
    /// What is due.
    answer: Cell<RideAnswer>,
}

impl Bench {
    fn settings(kind: Kind, odd: Option<Oddity>) -> serde_json::Value {
        if kind == Kind::Fit {
            let window = if odd == Some("window") { 9 } else { 8 };
            return json!({
                "mode": "replace", "surrogates": ["dmd"],
                "dmd": {
                    "snapshotInterval": 2.0 * STEP, "jumpTolerance": 1e9, "fitTolerance": 1e9, "initialJump": 2,
                    "window": window, "minSnapshots": 8, "holdOut": 1, "refitInterval": 1, "delays": [2], "svdRank": [4]
                }
            });
        }
        let strides = if odd == Some("steps") { 3 } else { 2 };
        let mut settings = json!({ "mode": "replace", "solverSteps": STEPS, "surrogateSteps": strides });
        // Random weights predict changes that control would not let a jump have.
        if kind == Kind::Network {
            settings["control"] = json!({ "tolerance": 1e9, "relTol": 1e9 });
        }
        settings
    }

    /// The state of a ride, and the number of its arrays.
    fn arrays(host: &Host, odd: Option<Oddity>, weights: &mut [f64]) -> Vec<ArrayData> {
        let mut arrays = flow_and_inlet(host);
        if odd == Some("weights") {
            weights[1] = -1.0;
        }
        arrays[0].weights = weights.as_ptr();
        match odd {
            Some("fewer") => arrays.truncate(3),
            Some("more") => arrays.push(array(c"more", 2, 2, 1, 0)),
            Some("order") => arrays.swap(2, 3),
            Some("name") => arrays[P].name = c"q".as_ptr(),
            Some("no name") => arrays[P].name = null(),
            Some("other name") => arrays[INLET].name = c"outlet".as_ptr(),
            Some("place") => arrays[INLET].place = 1,
            Some("role") => arrays[INLET].role = 2,
            Some("no place") => arrays[INLET].place = 7,
            Some("no role") => arrays[INLET].role = -1,
            Some("components") => arrays[P].components = 0,
            Some("items") => arrays[P].n -= 1,
            Some("items below 0") => arrays[P].n = -1,
            Some("solved") => arrays[0].solved = 4,
            Some("floor") => arrays[P].floor = 0.0,
            _ => (),
        }
        arrays
    }

    /// A ride of this session's model, or of what needs none.
    fn begin(
        &self,
        kind: Kind,
        session: Session,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> (Ended, Riding<'_>) {
        let host = self.host(odd);
        let back = Back { n: host.mesh.n_cells(), index: Cell::new(0), status: Cell::new(0) };
        let mut riding = Riding {
            bench: self,
            host,
            back: Box::new(back),
            ride: Owned(none(), m4gn_ride_free),
            index: Cell::new(0),
            answer: Cell::default(),
        };
        let settings = match odd {
            Some("json") => c("{\"mode\": ".into()),
            Some("mode") => c("{\"mode\": \"always\"}".into()),
            _ => options(&Self::settings(kind, odd)),
        };
        let mut weights = riding.host.mesh.cell_volumes.clone();
        let arrays = Self::arrays(&riding.host, odd, &mut weights);
        let fields = [c"p".as_ptr()];
        let data = (&raw const *riding.back).cast_mut().cast();
        let own = SurrogateData {
            name: c"own".as_ptr(),
            stride: 2.0 * STEP,
            n_fields: 1,
            fields: fields.as_ptr(),
            step: Some(step),
            data,
        };
        let mut given = ride_host(session, &riding.host, &arrays);
        given.ahead = Some(ahead);
        given.data = data;
        if kind != Kind::Network {
            given.session = none();
        }
        given.own = unless(kind != Kind::Own, &raw const own);
        given.mesh = unless(kind == Kind::Fit || odd == Some("no mesh"), given.mesh);
        given.arrays = unless(odd == Some("no arrays"), given.arrays);
        if odd == Some("count") {
            given.n_arrays = -1;
        }
        let place = unless_mut(odd == Some("null"), &raw mut riding.ride.0);
        let text = unless(odd == Some("no settings"), settings.as_ptr());
        let start = now(if odd == Some("time") { 3 } else { 0 });
        let start = unless(odd == Some("no start"), &raw const start);
        let given = unless(odd == Some("no host"), &raw const given);
        // SAFETY: a session, and arrays of their lengths, or the null pointers that the call refuses.
        let ended =
            self.made(panic, || unsafe { m4gn_ride_new(self.world.fortran(), given, text, start, place) });
        (ended, riding)
    }

    pub fn ride_new(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let session = made(self.session_new(None, None))?;
        Ok(self.begin(kind_of(call), session.0, odd, panic).0)
    }

    /// A call on a ride that has states, and a state of it on disk.
    pub fn ride_call(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let session = made(self.session_new(None, None))?;
        let riding = made(self.begin(kind_of(call), session.0, None, None))?;
        let steps = match call {
            "ride_solved" | "ride_save" => STEPS - 1,
            "ride_load" => 0,
            _ => MOST,
        };
        riding.solve(steps);
        let (ended, again) = match call {
            "ride_solved" => (riding.solved(odd, panic), riding.solved(None, None)),
            "ride_stride" | "ride_stride_of_own" | "ride_stride_of_fit" => {
                (riding.stride(odd, panic), riding.stride(None, None))
            }
            "ride_handed_back" => {
                for _ in 0..2 {
                    riding.stride(None, None);
                    riding.advanced();
                }
                (riding.back(odd, panic), riding.back(None, None))
            }
            "ride_load" => {
                let other = made(self.begin(Kind::Network, session.0, None, None))?;
                other.solve(4);
                other.file("ride_save", None, None);
                riding.index.set(4);
                let load = |odd, panic| riding.file("ride_load", odd, panic);
                (load(odd, panic), load(None, None))
            }
            _ => {
                let save = |odd, panic| riding.file("ride_save", odd, panic);
                (save(odd, panic), save(None, None))
            }
        };
        Ok(self.then(ended, again))
    }
}

impl Riding<'_> {
    /// The state at this step.
    fn state(&self) -> (Flow, f64) {
        let index = self.index.get();
        let mut flow = values(&self.host);
        flow.u.iter_mut().enumerate().for_each(|(i, u)| *u *= (0.15 * index as f64 + i as f64).cos());
        (flow, inlet(index as f64))
    }

    /// Calls with the state, or what is odd about it.
    fn with_state<T>(&self, odd: Option<Oddity>, call: impl FnOnce(*const *const f64) -> T) -> T {
        let (mut flow, inlet) = self.state();
        if odd == Some("nan") {
            flow.u[1] = f64::NAN;
        }
        let [u, p, a, b] = flow.state();
        let p = unless(odd == Some("missing"), p);
        let state = [u, p, a, b, &raw const inlet];
        call(unless(odd == Some("null"), state.as_ptr()))
    }

    /// So many steps of the solver, or until a stride is due.
    fn solve(&self, steps: i64) {
        for _ in 0..steps {
            if self.answer.get().action == 0 {
                self.solved(None, None);
            }
        }
    }

    /// The solver's next step.
    fn solved(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let before = self.index.get();
        self.index.set(before + 1);
        self.back.index.set(before + 1);
        let step = now(before + if odd == Some("time") { 2 } else { 1 });
        let step = unless(odd == Some("no step"), &raw const step);
        let mut answer = RideAnswer::default();
        let ended = self.with_state(odd, |state| {
            // SAFETY: a ride of ours; arrays of their lengths, or what the call refuses.
            self.bench.made(panic, || unsafe { m4gn_ride_solved(self.ride.0, step, state, &mut answer) })
        });
        match ended.status {
            0 => self.answer.set(answer),
            _ => self.index.set(before),
        }
        ended
    }

    fn stride(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (mut next, _) = self.state();
        let mut faces = next.faces.clone();
        let [u, p] = next.next();
        let mut places = [u, p, next.faces.as_mut_ptr(), faces.as_mut_ptr(), none()];
        places[P] = unless_mut(odd == Some("missing"), places[P]);
        let places = unless(odd == Some("null"), places.as_ptr());
        let fails = matches!(odd, Some("fails" | "ahead fails"));
        self.back.status.set(if fails { 2 } else { 0 });
        let mut answer = RideAnswer::default();
        // SAFETY: a ride of ours; arrays of their lengths, or what the call refuses.
        let ended = self.bench.made(panic, || unsafe { m4gn_ride_stride(self.ride.0, places, &mut answer) });
        self.back.status.set(0);
        if ended.status == 0 {
            self.answer.set(answer);
        }
        ended
    }

    fn advanced(&self) {
        let mut answer = self.answer.get();
        self.index.set(self.index.get() + answer.solver_steps);
        let step = now(self.index.get());
        // SAFETY: a ride of ours, and arrays of their lengths.
        self.with_state(None, |state| unsafe { m4gn_ride_advanced(self.ride.0, &step, state, &mut answer) });
        self.answer.set(answer);
    }

    fn back(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let quantity = RideQuantity { name: unless(odd == Some("name"), c"energy".as_ptr()), value: 1.0 };
        let step = now(self.index.get() + if odd == Some("time") { 9 } else { 0 });
        let step = unless(odd == Some("no step"), &raw const step);
        let mut answer = RideAnswer::default();
        self.with_state(odd, |state| {
            // SAFETY: a ride of ours; arrays of their lengths, or what the call refuses.
            self.bench.made(panic, || unsafe {
                m4gn_ride_handed_back(self.ride.0, step, state, &quantity, 1, &mut answer)
            })
        })
    }

    fn file(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let name = if odd == Some("path") { "b" } else { "a" };
        let path = c(self.bench.folder.path().join(name).display().to_string());
        let path = unless(odd == Some("no path"), path.as_ptr());
        let step = now(self.index.get() + if odd == Some("time") { 5 } else { 0 });
        self.with_state(odd, |state| {
            // SAFETY: a C string or null, and objects of ours.
            self.bench.made(panic, || unsafe {
                match call {
                    "ride_save" => m4gn_ride_save(self.ride.0, path),
                    _ => m4gn_ride_load(self.ride.0, path, &step, state, &mut RideAnswer::default()),
                }
            })
        })
    }
}
