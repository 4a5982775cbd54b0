//! A hybrid run: states as they are read, settings, and what a controller is told.

use crate::damaged::{at, not_internal, word};
use crate::fuzzing::{Random, fuzz};
use crate::host::*;
use crate::{damage_header, place, root};
use m4gn_parallel::NO_MPI;
use m4gn_ride::Growth;
use m4gn_ride::control::{Control, ControlSettings, Controlled, Measured, StrideError};
use m4gn_samples::mesh as sample;
use serde_json::{Value, json};
use std::ffi::{CString, c_void};
use std::ptr::null;

/// The solver's time step, s; five are a stride.
const DT: f64 = 0.002;

/// Index of the array that the host prescribes.
const INLET: usize = 4;

/// What the prescribed array is, and whether the host knows it.
struct Prescribed {
    time: f64,
    n_arrays: usize,
    status: i32,
}

/// The value of a state.
fn wave(time: f64) -> f64 {
    (100.0 * time).sin()
}

extern "C" fn ahead(data: *mut c_void, later: f64, arrays: *const *mut f64) -> i32 {
    // SAFETY: what the host of a ride below gives, and room for the prescribed array.
    unsafe {
        let prescribed = &*data.cast::<Prescribed>();
        if prescribed.n_arrays > INLET && !(*arrays.add(INLET)).is_null() {
            **arrays.add(INLET) = wave(prescribed.time + later);
        }
        prescribed.status
    }
}

/// A host whose fields are one number.
struct Run<'a> {
    host: &'a Host,
    prescribed: Box<Prescribed>,
    ride: *mut RideHandle,
    index: i64,
}

impl<'a> Run<'a> {
    /// A ride of a session, or of a fit where that is null, with this state.
    fn begin(host: &'a Host, session: Session, arrays: &[ArrayData], settings: &Value) -> (i32, Run<'a>) {
        let prescribed = Box::new(Prescribed { time: 0.0, n_arrays: arrays.len(), status: 0 });
        let mut run = Run { host, prescribed, ride: none(), index: 0 };
        let settings = options(settings);
        let mut given = ride_host(session, host, arrays);
        given.ahead = Some(ahead);
        given.data = (&raw mut *run.prescribed).cast();
        // SAFETY: null, or a session on this mesh; arrays of these lengths.
        let made = unsafe { m4gn_ride_new(NO_MPI, &given, settings.as_ptr(), &run.now(), &mut run.ride) };
        (made, run)
    }

    fn now(&self) -> RideStep {
        ride_step(self.index, DT)
    }

    /// Goes on with a state that is all of one value, or part of one.
    fn load(&mut self, path: &CString, r: &mut Random) -> RideAnswer {
        let values = self.values(r);
        let mut answer = RideAnswer::default();
        // SAFETY: a ride of ours, a text, and arrays of the lengths that were described.
        unsafe {
            m4gn_ride_load(self.ride, path.as_ptr(), &self.now(), values.state().as_ptr(), &mut answer);
        }
        answer
    }

    fn values(&self, r: &mut Random) -> State {
        let value = if r.below(40) == 0 { r.real() } else { wave(DT * self.index as f64) };
        State { flow: Flow::of(self.host, value), inlet: wave(DT * self.index as f64) }
    }

    /// So many steps of the solver, and what the ride says between them, until it refuses something.
    fn go_on(&mut self, steps: usize, mut answer: RideAnswer, r: &mut Random) {
        let mut solved = 0;
        for _ in 0..10 * steps {
            match answer.action {
                0 if solved == steps => return,
                0 => (solved, self.index) = (solved + 1, self.index + 1),
                2 => self.index += answer.solver_steps,
                _ => {}
            }
            self.prescribed.time = DT * self.index as f64;
            let (values, now) = (self.values(r), self.now());
            let mut state = values.state();
            if r.below(40) == 0 {
                *at(&mut state, r) = null();
            }
            let state = state.as_ptr();
            let mut next = Flow::of(self.host, 0.0);
            let mut faces = next.faces.clone();
            let [u, p] = next.next();
            let mut places = [u, p, next.faces.as_mut_ptr(), faces.as_mut_ptr(), none()];
            if r.below(40) == 0 {
                *at(&mut places, r) = none();
            }
            // SAFETY: a ride on this mesh, arrays of the lengths that were described, or null.
            let status = unsafe {
                match answer.action {
                    0 => {
                        let mut wants = -1;
                        assert_eq!(m4gn_ride_wants(self.ride, &now, &mut wants), 0, "{}", message());
                        let state = if wants == 0 { null() } else { state };
                        m4gn_ride_solved(self.ride, &now, state, &mut answer)
                    }
                    1 => m4gn_ride_stride(self.ride, places.as_ptr(), &mut answer),
                    2 => {
                        let state = if answer.state == 0 { null() } else { state };
                        m4gn_ride_advanced(self.ride, &now, state, &mut answer)
                    }
                    _ => m4gn_ride_handed_back(self.ride, &now, state, null(), 0, &mut answer),
                }
            };
            if status != 0 {
                return;
            }
        }
    }
}

impl Drop for Run<'_> {
    fn drop(&mut self) {
        // SAFETY: null, or freed once.
        unsafe { m4gn_ride_free(self.ride) };
    }
}

/// The state of a host.
struct State {
    flow: Flow,
    inlet: f64,
}

impl State {
    fn state(&self) -> [*const f64; 5] {
        let [u, p, a, b] = self.flow.state();
        [u, p, a, b, &raw const self.inlet]
    }
}

fn session(host: &Host) -> Session {
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    let mut session = none();
    // SAFETY: arrays of the lengths that the counts say.
    unsafe {
        let made = m4gn_session_new(NO_MPI, &host.data, model, null(), null(), &mut session);
        m4gn_model_free(model);
        assert_eq!(made, 0, "{}", message());
    }
    session
}

/// Settings of a ride of a network, or of a fit.
fn usual(fits: bool) -> Value {
    match fits {
        false => json!({
            "mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "timeStart": 0.024,
            "control": { "tolerance": 1e9, "relTol": 1e9 }
        }),
        true => json!({
            "mode": "replace", "surrogates": ["dmd"],
            "dmd": {
                "snapshotInterval": 0.01, "jumpTolerance": 1e9, "fitTolerance": 1e9, "initialJump": 2, "window": 5,
                "minSnapshots": 5, "holdOut": 1, "refitInterval": 1, "delays": [1, 2], "svdRank": [2]
            }
        }),
    }
}

/// Gives a damaged state the checksum of its bytes, so that what is behind it is read.
fn seal(bytes: &mut [u8]) {
    if let Some(tail) = bytes.len().checked_sub(4) {
        let crc = crc32fast::hash(&bytes[..tail]).to_le_bytes();
        bytes[tail..].copy_from_slice(&crc);
    }
}

#[test]
fn ride_states() {
    let host = Host::new(sample::triangles(4, 3, 1.0, 0.7));
    let arrays = flow_and_inlet(&host);
    let network = session(&host);
    let (_folder, path) = place("a.state");
    let name = CString::new(path.to_str().unwrap()).unwrap();
    let of = |fits: bool| if fits { none() } else { network };
    let good = [false, true].map(|fits| {
        let (made, mut run) = Run::begin(&host, of(fits), &arrays, &usual(fits));
        assert_eq!(made, 0, "{}", message());
        run.go_on(if fits { 26 } else { 14 }, RideAnswer::default(), &mut Random::new(3));
        // SAFETY: a ride of ours.
        let saved = unsafe { m4gn_ride_save(run.ride, name.as_ptr()) };
        assert_eq!(saved, 0, "{}", message());
        (fits, run.index, std::fs::read(&path).unwrap())
    });
    fuzz("ride", |r| {
        let (fits, index, good) = r.pick(&good);
        let mut settings = usual(*fits);
        match r.below(6) {
            0 if *fits => {
                let keys = "snapshotInterval jumpTolerance fitTolerance initialJump maxJump window minSnapshots holdOut";
                let keys: Vec<&str> = keys.split(' ').collect();
                settings["dmd"][*r.pick(&keys)] = match r.below(2) {
                    0 => Value::from(r.below(5)),
                    _ => r.real().into(),
                };
            }
            1 => {
                settings[*r.pick(&["solverSteps", "surrogateSteps", "writePrecision", "unknown"])] =
                    r.integer().into()
            }
            2 => settings[*r.pick(&["timeStart", "timeEnd", "setupSeconds"])] = r.real().into(),
            _ => {}
        }
        let mut bytes = good.clone();
        match r.below(4) {
            0 => {}
            1 => r.damage(&mut bytes),
            2 => {
                r.damage(&mut bytes);
                seal(&mut bytes);
            }
            _ => {
                // Its description is text with a length before it.
                let mut rest = bytes.split_off(12);
                damage_header(&mut rest, r);
                bytes.extend(rest);
                seal(&mut bytes);
            }
        }
        std::fs::write(&path, &bytes).unwrap();
        let (made, mut run) = Run::begin(&host, of(*fits), &arrays, &settings);
        run.prescribed.status = if r.below(8) == 0 { r.integer() as i32 } else { 0 };
        if made == 0 {
            run.index = *index;
            let answer = run.load(&name, r);
            run.go_on(8, answer, r);
            // SAFETY: a ride of ours.
            unsafe { m4gn_ride_text(run.ride, 6) };
        }
        not_internal();
        bytes.len()
    });
    // SAFETY: made above, and freed once.
    unsafe { m4gn_session_free(network) };
}

/// Whatever a host says that its arrays are: what is taken is the state of a run.
#[test]
fn ride_arrays() {
    let host = Host::new(sample::triangles(4, 3, 1.0, 0.7));
    let network = session(&host);
    let weights: Vec<f64> = vec![0.5; host.mesh.n_cells()];
    fuzz("arrays", |r| {
        let mut arrays = flow_and_inlet(&host);
        let fits = r.below(2) == 0;
        let weights: Vec<f64> =
            weights.iter().map(|w| if r.below(99) == 0 { r.real() } else { *w }).collect();
        arrays[0].weights = weights.as_ptr();
        for _ in 0..r.below(3) {
            let array = at(&mut arrays, r);
            match r.below(9) {
                0 => array.name = word(r, &[c"U", c"p", c"T", c"", c"\xff", c"inlet"]),
                1 => array.place = r.below(7) as i32 - 1,
                2 => array.role = r.below(7) as i32 - 1,
                3 => array.place = r.integer() as i32,
                4 => array.floor = r.real(),
                5 => array.solved = r.below(5) as i32 - 1,
                // No longer than what there is.
                6 => array.components = *r.pick(&[array.components, 1, 0, -1]),
                7 => array.n = *r.pick(&[array.n / 2, 0, -1, i64::MIN]),
                _ => array.weights = null(),
            }
        }
        if r.below(8) == 0 {
            arrays.remove(r.below(5));
        }
        let session = if fits { none() } else { network };
        let (made, mut run) = Run::begin(&host, session, &arrays, &usual(fits));
        run.prescribed.status = if r.below(8) == 0 { r.integer() as i32 } else { 0 };
        if made == 0 && arrays.len() == 5 {
            run.go_on(30, RideAnswer::default(), r);
        }
        not_internal();
        100
    });
    // SAFETY: made above, and freed once.
    unsafe { m4gn_session_free(network) };
}

/// Whatever the figures are: a jump has as many strides as the estimate allows, and never one of which nothing is known.
#[test]
fn control_figures() {
    fuzz("control", |r| {
        let mut settings = json!({ "tolerance": *r.pick(&[1e-9, 0.05, 1.0, 1e300]) });
        match r.below(8) {
            0 => settings["tolerance"] = r.real().into(),
            1 => settings["patience"] = r.integer().into(),
            2 => settings["fields"] = json!([r.pick(&["U", "p", "T", ""])]),
            3 => settings["onFailure"] = (*r.pick(&["stop", "solver", "goOn"])).into(),
            4 => settings["unknown"] = r.integer().into(),
            5 => settings["relTol"] = r.real().into(),
            _ => (),
        }
        let mut figure = || match r.below(3) {
            0 => r.real(),
            n => n as f64,
        };
        let rows: Vec<StrideError> = (0..3)
            .map(|_| StrideError { error: figure(), change: figure(), size: 0.0, variation: figure() })
            .collect();
        let factors = [figure(), figure()];
        let n = if r.below(4) == 0 { r.below(4) } else { 2 };
        let most = if r.below(2) == 0 { usize::MAX } else { r.below(1 << 20) };
        let fields =
            vec![("U".to_string(), Growth::Unknown), ("p".to_string(), Growth::Factors(factors.to_vec()))];
        let made = ControlSettings::parse(&settings.to_string()).and_then(|s| Control::new(fields, s));
        if let Ok(mut control) = made {
            let known = match r.below(2) {
                0 => control.measure(&rows[..n]).is_ok(),
                _ => {
                    let measured = |s: &StrideError| Measured {
                        error: Some(s.error),
                        change: s.change,
                        variation: s.variation,
                        varies: true,
                    };
                    let fields = rows[..n].iter().map(measured).collect();
                    control.restore(&Controlled { fields, bad: r.below(9) }).is_ok()
                }
            };
            let (strides, error) = (control.strides(most), control.error());
            let estimate = control.estimate(strides);
            assert!(strides <= most, "{strides} of {most} strides");
            assert!(known || strides == 0, "a jump of which nothing is known");
            assert!(!error.is_nan() && !estimate.is_nan(), "{error} and {estimate}");
        }
        64
    });
}
