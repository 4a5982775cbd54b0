//! A hybrid run: states as they are read, settings, and what a controller is told.

use crate::fuzzing::{Random, fuzz};
use crate::host::*;
use crate::{damage_header, place, root};
use m4gn_parallel::NO_MPI;
use m4gn_ride::control::{Control, ControlSettings, StrideError};
use m4gn_samples::mesh as sample;
use serde_json::{Value, json};
use std::ffi::CString;
use std::ptr::null;

/// The solver's time step, s; five are a stride.
const DT: f64 = 0.002;

/// A host whose fields are one number.
struct Run<'a> {
    host: &'a Host,
    ride: *mut RideHandle,
    index: i64,
}

impl Run<'_> {
    fn now(&self) -> RideStep {
        RideStep {
            time: DT * self.index as f64,
            delta_t: DT,
            end_time: f64::INFINITY,
            shown: 0.0,
            wall: 0.0,
            index: self.index,
            name: null(),
            correctors: -1,
            most_correctors: -1,
        }
    }

    /// So many steps of the solver, and what the ride says between them, until it refuses something.
    fn go_on(&mut self, steps: usize, mut answer: RideAnswer, r: &mut Random) {
        let mesh = &self.host.mesh;
        let mut solved = 0;
        for _ in 0..10 * steps {
            let value = if r.below(40) == 0 { r.real() } else { 0.1 * self.index as f64 };
            let cells = vec![value; 3 * mesh.n_cells()];
            let (mut u, mut p) = (cells.clone(), cells.clone());
            let faces = vec![value; 3 * mesh.boundary.len()];
            let fields = [field(c"U", 3, &cells, &faces), field(c"p", 1, &cells, &faces)];
            let out = [output(c"U", 3, &mut u), output(c"p", 1, &mut p)];
            let now = self.now();
            // SAFETY: a ride on this mesh, arrays of the lengths that mesh and components say.
            let status = unsafe {
                match answer.action {
                    0 => {
                        solved += 1;
                        if solved > steps {
                            return;
                        }
                        self.index += 1;
                        m4gn_ride_solved(self.ride, &self.now(), &mut answer)
                    }
                    1 => m4gn_ride_decide(self.ride, fields.as_ptr(), null(), 2, &mut answer),
                    2 => m4gn_ride_stride(self.ride, fields.as_ptr(), 2, out.as_ptr(), 2, &mut answer),
                    3 => {
                        self.index += answer.solver_steps;
                        m4gn_ride_advanced(self.ride, &self.now(), &mut answer)
                    }
                    _ => m4gn_ride_handed_back(self.ride, &now, null(), 0, fields.as_ptr(), 2, &mut answer),
                }
            };
            if status != 0 {
                return;
            }
        }
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
    let model = open_model(root().join("tests/cabi/small.safetensors"));
    let (_folder, path) = place("a.state");
    let name = CString::new(path.to_str().unwrap()).unwrap();
    let mut session = none();
    // SAFETY: arrays of the lengths that the counts say.
    unsafe {
        let made = m4gn_session_new(NO_MPI, &host.data, model, null(), null(), &mut session);
        m4gn_model_free(model);
        assert_eq!(made, 0, "{}", message());
    }
    let usual = |learns: bool| {
        let mut settings = json!({
            "mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "timeStart": 0.024,
            "control": { "tolerance": 1e9, "relTol": 1e9 }
        });
        if learns {
            settings["adapt"] =
                json!({ "mode": "during", "steps": 1, "stepsEach": 1, "heldBack": 0.4, "start": 0 });
        }
        settings
    };
    let begin = |settings: &Value| {
        let mut run = Run { host: &host, ride: none(), index: 0 };
        let settings = options(settings);
        // SAFETY: a session on this mesh.
        let status = unsafe {
            m4gn_ride_new(
                NO_MPI,
                &surrogates(session),
                &host.data,
                settings.as_ptr(),
                &run.now(),
                &mut run.ride,
            )
        };
        (status, run)
    };
    let good = [false, true].map(|learns| {
        let (made, mut run) = begin(&usual(learns));
        assert_eq!(made, 0, "{}", message());
        run.go_on(14, RideAnswer::default(), &mut Random::new(3));
        // SAFETY: a ride of ours, freed once.
        unsafe {
            assert_eq!(m4gn_ride_save(run.ride, name.as_ptr()), 0, "{}", message());
            m4gn_ride_free(run.ride);
        }
        (learns, run.index, std::fs::read(&path).unwrap())
    });
    fuzz("ride", |r| {
        let (learns, index, good) = r.pick(&good);
        let mut settings = usual(*learns);
        match r.below(6) {
            0 if *learns => {
                let keys = [
                    "window",
                    "maxFrames",
                    "steps",
                    "batch",
                    "learningRate",
                    "noise",
                    "heldBack",
                    "budget",
                    "start",
                ];
                settings["adapt"][*r.pick(&keys)] = match r.below(2) {
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
        let (made, mut run) = begin(&settings);
        if made == 0 {
            run.index = *index;
            let mut answer = RideAnswer::default();
            // SAFETY: a ride of ours, freed once.
            unsafe {
                m4gn_ride_load(run.ride, name.as_ptr(), &run.now(), &mut answer);
                run.go_on(8, answer, r);
                m4gn_ride_text(run.ride, 6);
            }
        }
        let text = message();
        assert!(!text.contains("internal error"), "{text}");
        // SAFETY: null, or freed once.
        unsafe { m4gn_ride_free(run.ride) };
        bytes.len()
    });
    // SAFETY: made above, and freed once.
    unsafe { m4gn_session_free(session) };
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
        let fields = vec![("U".to_string(), None), ("p".to_string(), Some(factors.to_vec()))];
        let made = ControlSettings::parse(&settings.to_string()).and_then(|s| Control::new(fields, s));
        if let Ok(mut control) = made {
            let known = match r.below(2) {
                0 => control.measure(&rows[..n]).is_ok(),
                _ => control.restore(&rows[..n], r.below(9)).is_ok(),
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
