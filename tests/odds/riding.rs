//! Hybrid runs, whose model learns.

use crate::calls::{Bench, Ended, Oddity, c, unless, unless_mut, values};
use crate::host::*;
use crate::timed;
use std::ffi::{CStr, CString};
use std::ptr::null;

/// A stride of the model is two of these, s.
const STEP: f64 = 0.005;

/// Steps of the solver before the call, after which a jump begins.
const STEPS: i64 = 12;

fn now(index: i64) -> RideStep {
    RideStep {
        time: STEP * index as f64,
        delta_t: STEP,
        end_time: f64::INFINITY,
        shown: 0.0,
        wall: 0.0,
        index,
        name: null(),
        correctors: -1,
        most_correctors: -1,
    }
}

impl Bench {
    /// A ride of this session's model.
    pub fn ride_made(
        &self,
        session: Session,
        host: &Host,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> (Ended, *mut RideHandle) {
        let steps = if odd == Some("steps") { 3 } else { 2 };
        // Random weights predict changes that control would not let a jump have
        let control = match odd {
            Some("uncontrolled") => "",
            _ => r#""control": {"tolerance": 1e9, "relTol": 1e9}, "#,
        };
        let settings = match odd {
            Some("json") => c("{\"mode\": ".into()),
            Some("mode") => c("{\"mode\": \"always\"}".into()),
            _ => c(format!(
                r#"{{"mode": "replace", "solverSteps": 12, "surrogateSteps": {steps}, {control}"adapt": {{"mode": "during", "steps": 2,
                "stepsEach": 1, "batch": 1, "maxFrames": 40, "start": 0}}}}"#
            )),
        };
        let mut ride = none();
        let place = unless_mut(odd == Some("null"), &raw mut ride);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no settings"), settings.as_ptr());
        let start = now(if odd == Some("time") { 3 } else { 0 });
        let start = unless(odd == Some("no start"), &raw const start);
        // SAFETY: a session, and arrays of their lengths, or the null pointers that the call refuses.
        let ended = self.made(panic, || unsafe {
            m4gn_ride_new(m4gn_parallel::NO_MPI, &surrogates(session), mesh, given, start, place)
        });
        (ended, ride)
    }

    pub fn ride_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (made, session) = self.session_new(None, None);
        if made.status != 0 {
            return made;
        }
        let (ended, ride) = self.ride_made(session, &self.host(odd), odd, panic);
        // SAFETY: null, or freed once.
        timed(|| unsafe {
            m4gn_ride_free(ride);
            m4gn_session_free(session);
        });
        ended
    }

    /// A call on a ride that has frames, and a state of it on disk.
    pub fn ride_call(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (made, session) = self.session_new(None, None);
        if made.status != 0 {
            return made;
        }
        let host = self.host(None);
        let settings = (call == "ride_handed_back").then_some("uncontrolled");
        let (made, ride) = self.ride_made(session, &host, settings, None);
        if made.status != 0 {
            return made;
        }
        if call != "ride_load" {
            for index in 1..STEPS {
                self.solved(ride, index);
                self.ride_decide(ride, &host, index, None, None);
            }
            self.solved(ride, STEPS);
        }
        let decide = |odd, panic| self.ride_decide(ride, &host, STEPS, odd, panic);
        let stride = |odd, panic| self.ride_stride(ride, &host, odd, panic);
        let (ended, again) = match call {
            "ride_decide" => (decide(odd, panic), decide(None, None)),
            "ride_stride" => {
                decide(None, None);
                let ended = stride(odd, panic);
                (ended, stride(None, None))
            }
            "ride_handed_back" => {
                decide(None, None);
                for i in 1..=2 {
                    stride(None, None);
                    // SAFETY: a ride of ours.
                    unsafe { m4gn_ride_advanced(ride, &now(STEPS + 2 * i), &mut RideAnswer::default()) };
                }
                let back = |odd, panic| self.ride_back(ride, &host, odd, panic);
                (back(odd, panic), back(None, None))
            }
            "ride_load" => {
                let (made, other) = self.ride_made(session, &host, None, None);
                if made.status != 0 {
                    return made;
                }
                for index in 1..4 {
                    self.solved(other, index);
                    self.ride_decide(other, &host, index, None, None);
                }
                self.solved(other, 4);
                self.ride_file("ride_save", other, None, None);
                // SAFETY: freed once.
                timed(|| unsafe { m4gn_ride_free(other) });
                let load = |odd, panic| self.ride_file("ride_load", ride, odd, panic);
                (load(odd, panic), load(None, None))
            }
            _ => {
                let save = |odd, panic| self.ride_file("ride_save", ride, odd, panic);
                (save(odd, panic), save(None, None))
            }
        };
        // SAFETY: freed once.
        timed(|| unsafe {
            m4gn_ride_free(ride);
            m4gn_session_free(session);
        });
        self.then(ended, again)
    }

    fn solved(&self, ride: *mut RideHandle, index: i64) {
        // SAFETY: a ride of ours.
        unsafe { m4gn_ride_solved(ride, &now(index), &mut RideAnswer::default()) };
    }

    fn ride_decide(
        &self,
        ride: *mut RideHandle,
        host: &Host,
        index: i64,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let (mut u, p, b) = values(host);
        u.iter_mut().enumerate().for_each(|(i, u)| *u *= (0.15 * index as f64 + i as f64).cos());
        if odd == Some("nan") {
            u[1] = f64::NAN;
        }
        let mut fields = [field(c"U", 3, &u, &b), field(c"p", 1, &p, &b)];
        if odd == Some("null") {
            fields[1].cells = null();
        }
        let n = match odd {
            Some("missing") => 1,
            Some("count") => -1,
            _ => 2,
        };
        let mut answer = RideAnswer::default();
        let place = unless_mut(odd == Some("no answer"), &raw mut answer);
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe { m4gn_ride_decide(ride, fields.as_ptr(), null(), n, place) })
    }

    fn ride_stride(
        &self,
        ride: *mut RideHandle,
        host: &Host,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let (u, p, b) = values(host);
        let (mut next_u, mut next_p) = (u.clone(), p.clone());
        let fields = [field(c"U", 3, &u, &b), field(c"p", 1, &p, &b)];
        let mut out = [output(c"U", 3, &mut next_u), output(c"p", 1, &mut next_p)];
        if odd == Some("null") {
            out[1].cells = std::ptr::null_mut();
        }
        let (n, n_out) = match odd {
            Some("missing") => (1, 2),
            Some("no places") => (2, 1),
            Some("count") => (-1, 2),
            _ => (2, 2),
        };
        let mut answer = RideAnswer::default();
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_ride_stride(ride, fields.as_ptr(), n, out.as_ptr(), n_out, &mut answer)
        })
    }

    fn ride_back(
        &self,
        ride: *mut RideHandle,
        host: &Host,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let (u, p, b) = values(host);
        let fields = [field(c"U", 3, &u, &b), field(c"p", 1, &p, &b)];
        let quantity = RideQuantity { name: unless(odd == Some("name"), c"energy".as_ptr()), value: 1.0 };
        let n = if odd == Some("missing") { 1 } else { 2 };
        let step = now(STEPS + if odd == Some("time") { 9 } else { 4 });
        let mut answer = RideAnswer::default();
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_ride_handed_back(ride, &step, &quantity, 1, fields.as_ptr(), n, &mut answer)
        })
    }

    fn ride_file(&self, call: &str, ride: *mut RideHandle, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let name = match odd {
            Some("path") => "b",
            _ => "a",
        };
        let path: CString = c(self.folder.path().join(name).display().to_string());
        let path: &CStr = &path;
        let path = unless(odd == Some("null"), path.as_ptr());
        let step = now(if odd == Some("time") { 9 } else { 4 });
        // SAFETY: a C string or null, and objects of ours.
        self.made(panic, || unsafe {
            match call {
                "ride_save" => m4gn_ride_save(ride, path),
                _ => m4gn_ride_load(ride, path, &step, &mut RideAnswer::default()),
            }
        })
    }
}
