//! Exports: the state machine of a hybrid run.

use super::guard;
use super::host::{self, HostData, Setup};
use super::pointers;
use super::state;
use m4gn_base::{Error, Result};
use m4gn_parallel::Comm;
use m4gn_ride::{Action, Answer, Ride, Step, host_of};
use std::ffi::{CString, c_char};
use std::path::Path;

/// `m4gn_ride_step`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RideStep {
    pub time: f64,
    pub delta_t: f64,
    pub end_time: f64,
    pub output_time: f64,
    pub index: i64,
    pub name: *const c_char,
    pub correctors: i32,
    pub most_correctors: i32,
    pub within: f64,
}

/// `m4gn_ride_answer`
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)]
pub struct RideAnswer {
    pub duration: f64,
    pub delta_t: f64,
    pub solver_steps: i64,
    pub action: i32,
    pub surrogate: i32,
    pub strides: i32,
    pub last_but_one: i32,
    pub state: i32,
    pub whole: i32,
    pub stepped: i32,
}

/// `m4gn_ride_quantity`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RideQuantity {
    pub name: *const c_char,
    pub value: f64,
}

/// `m4gn_ride`
pub struct RideHandle {
    pub(super) ride: Ride<'static>,
    comm: Comm,
    /// What was taken last.
    pub(super) text: CString,
    /// For [`guard::changed`].
    broken: bool,
}

/// Where the host is, and its state there where it has handed it over.
type Now<'a> = (Step, Option<Vec<&'a [f64]>>);

impl RideHandle {
    /// A host's present time and state, and their text for the other ranks.
    ///
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn now<'a>(&self, now: *const RideStep, state: *const *const f64) -> Result<(Now<'a>, String)> {
        // SAFETY: passed on to the caller.
        unsafe {
            let (now, same) = step(now)?;
            Ok(((now, state::read(self.ride.layout(), state)?), same))
        }
    }

    fn guarded(&mut self, work: impl FnOnce(&mut Self) -> Result<()>) -> Result<i32> {
        guard::changed("ride", self, |h| &mut h.broken, work)
    }

    /// A collective call: each rank reads what its host gave, and all agree that they could and on what they were told alike.
    fn together<I>(
        &mut self,
        name: &str,
        read: impl FnOnce(&Self) -> Result<(I, String)>,
        work: impl FnOnce(&mut Self, I) -> Result<Answer>,
        answer: *mut RideAnswer,
    ) -> Result<i32> {
        self.guarded(|handle| {
            let comm = handle.comm.clone();
            // Before the work, which changes the ride.
            // SAFETY: the host's struct, or null.
            let input = unsafe { pointers::reference_mut("answer", answer) }.and_then(|_| read(handle));
            let found = guard::together(name, &comm, || input, |input| work(handle, input))?;
            put(found, answer)
        })
    }
}

fn put(found: Answer, answer: *mut RideAnswer) -> Result<()> {
    let action = match found.action {
        Action::Solve => 0,
        Action::Stride => 1,
        Action::Advance => 2,
        Action::HandBack => 3,
    };
    // SAFETY: the host's struct, or null.
    *unsafe { pointers::reference_mut("answer", answer)? } = RideAnswer {
        duration: found.duration,
        delta_t: found.delta_t,
        solver_steps: found.solver_steps,
        action,
        surrogate: found.surrogate as i32,
        strides: i32::try_from(found.strides).unwrap_or(i32::MAX),
        last_but_one: i32::from(found.last_but_one),
        state: i32::from(found.state),
        whole: i32::from(found.whole),
        stepped: i32::from(found.stepped),
    };
    Ok(())
}

/// What the host tells of a time, and its text for the other ranks.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn step(now: *const RideStep) -> Result<(Step, String)> {
    // SAFETY: passed on to the caller.
    let (now, name) = unsafe {
        let now = pointers::reference("step", now)?;
        (now, pointers::optional_text("step.name", now.name)?)
    };
    let count = |n: i32| usize::try_from(n).ok();
    let correctors = count(now.correctors).zip(count(now.most_correctors));
    let step = Step {
        time: now.time,
        delta_t: now.delta_t,
        end_time: now.end_time,
        index: now.index,
        name: name.map_or_else(|| now.time.to_string(), String::from),
        output_time: now.output_time,
        correctors: correctors.map(|(made, most)| [made, most]),
        within: if now.within > 0.0 { now.within } else { 0.0 },
    };
    let same = format!(
        "time {:?} {:?} {:?} {:?} {}",
        step.time, step.delta_t, step.end_time, step.within, step.index
    );
    Ok((step, same))
}

exports! {
    /// Begins a ride.
    fn m4gn_ride_new(
        comm: i32,
        host: *const HostData,
        options: *const c_char,
        start: *const RideStep,
        ride: *mut *mut RideHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            let (comm, place) = (host::ranks(comm, host), pointers::reference_mut("ride", ride));
            let read = |comm: &Comm| Setup::read(comm, host, options, start);
            guard::create("m4gn_ride_new", comm, place, read, |comm, setup| {
                let (ride, comm) = (setup.ride(comm)?, comm.clone());
                Ok(RideHandle { ride, comm, text: CString::default(), broken: false })
            })
        }
    }

    /// Whether the state after a step is needed.
    fn m4gn_ride_wants(ride: *const RideHandle, now: *const RideStep, wants: *mut i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's structs, or null.
        unsafe {
            let handle = pointers::reference("ride", ride)?;
            *pointers::reference_mut("wants", wants)? = i32::from(handle.ride.wants(&step(now)?.0));
        }
        Ok(0)
    }

    /// The solver has made a step.
    fn m4gn_ride_solved(
        ride: *mut RideHandle,
        now: *const RideStep,
        state: *const *const f64,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_solved",
            // SAFETY: the host's struct and arrays, as the header says.
            |handle| unsafe { handle.now(now, state) },
            |handle, (now, state)| handle.ride.solved(now, state.as_deref()),
            answer,
        )
    }

    /// A stride of a jump.
    fn m4gn_ride_stride(ride: *mut RideHandle, next: *const *mut f64, answer: *mut RideAnswer) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_stride",
            // SAFETY: the host's arrays, as the header says.
            |handle| Ok((unsafe { state::places(handle.ride.layout(), next, true)? }, String::new())),
            |handle, mut next| handle.ride.stride(&mut next),
            answer,
        )
    }

    /// Time and state have been advanced by a stride.
    fn m4gn_ride_advanced(
        ride: *mut RideHandle,
        now: *const RideStep,
        state: *const *const f64,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_advanced",
            // SAFETY: the host's struct and arrays, as the header says.
            |handle| unsafe { handle.now(now, state) },
            |handle, (now, state)| handle.ride.advanced(now, state.as_deref()),
            answer,
        )
    }

    /// The state some time before the present one of a jump.
    fn m4gn_ride_old_level(ride: *const RideHandle, before: f64, arrays: *const *mut f64) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's arrays, as the header says.
        unsafe {
            let handle = pointers::reference("ride", ride)?;
            handle.ride.old_level(before, &mut state::places(handle.ride.layout(), arrays, false)?)?;
        }
        Ok(0)
    }

    /// What other parts of the run report.
    fn m4gn_ride_reported(ride: *mut RideHandle, values: *const f64, n_values: i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's values, as the header says.
        let (handle, values) = unsafe {
            let values = pointers::slice("values", values, pointers::count("n_values", n_values)?)?;
            (pointers::reference_mut("ride", ride)?, values)
        };
        handle.guarded(|handle| handle.ride.reported(values))
    }

    /// Wall time of strides and of handing over.
    fn m4gn_ride_spent(ride: *mut RideHandle, surrogate: f64, hand_over: f64) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            handle.ride.spent(surrogate, hand_over);
            Ok(())
        })
    }

    /// The state has been handed back.
    fn m4gn_ride_handed_back(
        ride: *mut RideHandle,
        now: *const RideStep,
        state: *const *const f64,
        quantities: *const RideQuantity,
        n_quantities: i32,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_handed_back",
            |handle| {
                // SAFETY: the host's arrays and structs, as the header says.
                unsafe {
                    let (now, same) = handle.now(now, state)?;
                    let n = pointers::count("n_quantities", n_quantities)?;
                    let list = pointers::slice("quantities", quantities, n)?;
                    let list = list.iter().map(|q| Ok((pointers::text("quantity", q.name)?.to_string(), q.value)));
                    let list: Vec<(String, f64)> = list.collect::<Result<_>>()?;
                    Ok(((now, list), same))
                }
            },
            |handle, ((now, state), quantities)| handle.ride.handed_back(now, state.as_deref(), &quantities),
            answer,
        )
    }

    /// What the run is made under.
    fn m4gn_ride_conditions(ride: *mut RideHandle, conditions: *const c_char) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's text, or null.
        let (handle, text) = unsafe {
            (pointers::reference_mut("ride", ride)?, pointers::text("conditions", conditions)?)
        };
        handle.guarded(|handle| handle.ride.made_under(text))
    }

    /// Writes the state.
    fn m4gn_ride_save(ride: *mut RideHandle, path: *const c_char) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            let comm = handle.comm.clone();
            let read = || {
                // SAFETY: the host's text, or null.
                let path = Path::new(unsafe { pointers::text("path", path)? });
                Ok((path, guard::file_name(path)))
            };
            guard::together("m4gn_ride_save", &comm, read, |path| handle.ride.save(path))
        })
    }

    /// What the host keeps in a state for itself.
    fn m4gn_ride_host(path: *const c_char, text: *mut c_char, size: i32) -> i32, or |s| s; {
        // SAFETY: the host's text and place, as the header says.
        let (path, place) = unsafe {
            (pointers::text("path", path)?, pointers::slice_mut("text", text, pointers::count("size", size)?)?)
        };
        pointers::put_text(&host_of(Path::new(path))?, place);
        Ok(0)
    }

    /// Takes up a state.
    fn m4gn_ride_load(
        ride: *mut RideHandle,
        path: *const c_char,
        now: *const RideStep,
        state: *const *const f64,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_load",
            |handle| {
                // SAFETY: the host's text, struct and arrays, as the header says.
                let (path, ((now, state), same)) =
                    unsafe { (Path::new(pointers::text("path", path)?), handle.now(now, state)?) };
                let state = state.ok_or_else(|| Error::Input("state: expected that of the present time, found null".into()))?;
                Ok(((path, now, state), format!("{same} {}", guard::file_name(path))))
            },
            |handle, (path, now, state)| handle.ride.load(path, now, &state),
            answer,
        )
    }
}
