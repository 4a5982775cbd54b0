//! Exports: the state machine of a hybrid run.

use super::guard;
use super::pointers::{self, MeshData};
use super::session::SessionHandle;
use super::state::{self, AheadFunction, ArrayData};
use super::user_surrogate::{SurrogateData, UserSurrogate};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_parallel::Comm;
use m4gn_ride::registry::NETWORK;
use m4gn_ride::{
    Action, Answer, DmdSettings, Host, Network, Ride, RideSettings, Step, Surrogate, Text, host_of,
};
use m4gn_state::Layout;
use m4gn_step::Session;
use std::ffi::{CString, c_char, c_void};
use std::ops::{Deref, DerefMut};
use std::path::Path;
use std::sync::Arc;

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

/// The host's session, which lives as long as the ride.
struct Borrowed(*mut SessionHandle);

impl Deref for Borrowed {
    type Target = Session;

    fn deref(&self) -> &Session {
        // SAFETY: the session lives as long as the ride, and no other call is under way, as the header says.
        unsafe { &(*self.0).session }
    }
}

impl DerefMut for Borrowed {
    fn deref_mut(&mut self) -> &mut Session {
        // SAFETY: as above.
        unsafe { &mut (*self.0).session }
    }
}

/// `m4gn_ride`
pub struct RideHandle {
    pub(super) ride: Ride<'static>,
    comm: Comm,
    /// What was taken last.
    text: CString,
    /// Set while a call runs: one that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

/// Where the host is, and its state there where it gave it.
type Told<'a> = (Step, Option<Vec<&'a [f64]>>);

impl RideHandle {
    /// What a host tells of a time, and its text for the other ranks.
    ///
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn told<'a>(&self, now: *const RideStep, state: *const *const f64) -> Result<(Told<'a>, String)> {
        // SAFETY: passed on to the caller.
        unsafe {
            let (now, same) = step(now)?;
            Ok(((now, state::read(self.ride.layout(), state)?), same))
        }
    }

    fn guarded<T>(&mut self, work: impl FnOnce(&mut Self) -> Result<T>) -> Result<T> {
        let result = match std::mem::replace(&mut self.broken, true) {
            true => Err(Error::Internal("the ride broke in an earlier call and can only be freed".into())),
            false => work(self),
        };
        self.broken = matches!(result, Err(Error::Internal(_)));
        result
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

fn put(found: Answer, answer: *mut RideAnswer) -> Result<i32> {
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
    Ok(0)
}

/// What the host tells of a time, and its text for the other ranks.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn step(given: *const RideStep) -> Result<(Step, String)> {
    // SAFETY: passed on to the caller.
    let (given, name) = unsafe {
        let given = pointers::reference("step", given)?;
        (given, pointers::optional_text("step.name", given.name)?)
    };
    let count = |n: i32| usize::try_from(n).ok();
    let correctors = count(given.correctors).zip(count(given.most_correctors));
    let step = Step {
        time: given.time,
        delta_t: given.delta_t,
        end_time: given.end_time,
        index: given.index,
        name: name.map_or_else(|| given.time.to_string(), String::from),
        output_time: given.output_time,
        correctors: correctors.map(|(made, most)| [made, most]),
        within: if given.within > 0.0 { given.within } else { 0.0 },
    };
    let same = format!(
        "time {:?} {:?} {:?} {:?} {}",
        step.time, step.delta_t, step.end_time, step.within, step.index
    );
    Ok((step, same))
}

/// `m4gn_host`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct HostData {
    /// A [`SessionHandle`].
    pub session: *mut c_void,
    pub own: *const SurrogateData,
    pub mesh: *const MeshData,
    pub arrays: *const ArrayData,
    pub n_arrays: i32,
    pub ahead: Option<AheadFunction>,
    pub data: *mut c_void,
}

/// What a rank's host gives for a ride.
struct Setup {
    settings: RideSettings,
    start: Step,
    mesh: Option<Mesh>,
    layout: Layout,
    own: Option<UserSurrogate>,
    /// What all ranks must be given alike.
    same: String,
}

impl Setup {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn read(
        comm: &Comm,
        host: &HostData,
        options: *const c_char,
        start: *const RideStep,
    ) -> Result<Self> {
        let bad = |text: &str| Err(Error::Input(format!("host: {text}")));
        // SAFETY: passed on to the caller.
        unsafe {
            let settings = RideSettings::parse(pointers::options(options)?)?;
            let (start, mut same) = step(start)?;
            let network = !host.session.is_null() || !host.own.is_null();
            match (settings.has(NETWORK), network) {
                (true, false) => {
                    return bad("the settings name network, and there is neither a session nor an own one");
                }
                (false, true) => {
                    return bad("there is a session or an own one, and the settings do not name network");
                }
                _ if !host.session.is_null() && !host.own.is_null() => {
                    return bad("expected a session or an own one, found both");
                }
                _ => {}
            }
            let layout = state::layout(host.arrays, host.n_arrays)?;
            let Some(rows) = layout.rows() else {
                return bad("arrays: expected at least one that is solved");
            };
            let mesh = match network {
                true => Some(pointers::mesh(pointers::reference("host.mesh", host.mesh)?)?),
                false => None,
            };
            if let Some(mesh) = mesh.as_ref().filter(|mesh| mesh.cell_global.len() != rows) {
                return Err(Error::Input(format!(
                    "host: arrays: the solved ones have {rows} items: expected those of the mesh's {} cells",
                    mesh.cell_global.len()
                )));
            }
            let mut own = None;
            if !host.own.is_null() {
                let made = UserSurrogate::new(host.own, comm.clone(), &layout)?;
                same += &format!("\n{}", made.shared());
                own = Some(made);
            }
            // Ranks have threads, texts and clocks of their own; a session's model may be on another path, and so may a rank's folder.
            let dmd = settings.dmd.clone().map(|dmd| DmdSettings { file: None, ..dmd });
            let alike = RideSettings {
                dmd,
                host: String::new(),
                setup_seconds: 0.0,
                decisions: None,
                states: None,
                model: if host.session.is_null() { settings.model.clone() } else { String::new() },
                ..settings.clone()
            };
            same += &format!("\n{alike:?}\n{}", layout.shared());
            Ok(Setup { settings, start, mesh, layout, own, same })
        }
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    comm: i32,
    place: Result<()>,
    host: *const HostData,
    options: *const c_char,
    start: *const RideStep,
) -> Result<RideHandle> {
    // SAFETY: passed on to the caller.
    let session = unsafe {
        let session = pointers::optional_reference("host", host)?.map_or(std::ptr::null_mut(), |h| h.session);
        pointers::optional_reference("host.session", session.cast::<SessionHandle>())?
    };
    // That of the session, so that a rank that cannot finish a call is seen wherever the others wait.
    let comm = match session {
        Some(handle) => handle.session.comm().clone(),
        None => Comm::from_fortran(comm)?,
    };
    let read = || {
        place?;
        // SAFETY: passed on to the caller.
        unsafe {
            let given = *pointers::reference("host", host)?;
            let mut setup = Setup::read(&comm, &given, options, start)?;
            let same = std::mem::take(&mut setup.same);
            Ok(((given, setup), same))
        }
    };
    guard::together("m4gn_ride_new", &comm, read, |(given, setup)| {
        let Setup { settings, start, mesh, layout, own, .. } = setup;
        let network: Option<Box<dyn Surrogate>> = match (session, own) {
            (Some(handle), _) => {
                let (model, source) = (handle.model.clone(), settings.model.clone());
                let network = Network::new(Borrowed(given.session.cast()), &model, source, &layout);
                Some(Box::new(comm.agree(network)?))
            }
            (None, Some(own)) => Some(Box::new(own)),
            (None, None) => None,
        };
        let global = match &mesh {
            Some(mesh) => mesh.cell_global.clone(),
            None => {
                let rows = layout.rows().unwrap_or(0) as i64;
                let begin = comm.exclusive_scan_i64(rows);
                (begin..begin + rows).collect()
            }
        };
        let host = Host {
            layout: Arc::new(layout),
            network,
            ahead: given.ahead.map(|function| state::ahead(function, given.data)),
            global,
            owners: mesh.iter().flat_map(|mesh| mesh.boundary.iter().map(|face| face.owner)).collect(),
        };
        let ride = Ride::new(comm.clone(), host, settings, start)?;
        Ok(RideHandle { ride, comm: comm.clone(), text: CString::default(), broken: false })
    })
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
            guard::create(pointers::reference_mut("ride", ride), |place| new(comm, place, host, options, start))
        }
    }

    /// Frees a ride; null is none.
    fn m4gn_ride_free(ride: *mut RideHandle) -> (), or |_| (); {
        if !ride.is_null() {
            // SAFETY: made by m4gn_ride_new and freed once.
            drop(unsafe { Box::from_raw(ride) });
        }
        Ok(())
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
            |handle| unsafe { handle.told(now, state) },
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
            |handle| Ok((unsafe { state::places(handle.ride.layout(), next)? }, String::new())),
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
            |handle| unsafe { handle.told(now, state) },
            |handle, (now, state)| handle.ride.advanced(now, state.as_deref()),
            answer,
        )
    }

    /// The state some time before the present one of a jump.
    fn m4gn_ride_old_level(ride: *const RideHandle, before: f64, arrays: *const *mut f64) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's arrays, as the header says.
        unsafe {
            let handle = pointers::reference("ride", ride)?;
            handle.ride.old_level(before, &mut state::places(handle.ride.layout(), arrays)?)?;
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
        handle.guarded(|handle| handle.ride.reported(values).map(|()| 0))
    }

    /// Wall time of strides and of handing over.
    fn m4gn_ride_spent(ride: *mut RideHandle, surrogate: f64, hand_over: f64) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            handle.ride.spent(surrogate, hand_over);
            Ok(0)
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
                    let (told, same) = handle.told(now, state)?;
                    let n = pointers::count("n_quantities", n_quantities)?;
                    let list = pointers::slice("quantities", quantities, n)?;
                    let list = list.iter().map(|q| Ok((pointers::text("quantity", q.name)?.to_string(), q.value)));
                    let list: Vec<(String, f64)> = list.collect::<Result<_>>()?;
                    Ok(((told, list), same))
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
        handle.guarded(|handle| handle.ride.made_under(text).map(|()| 0))
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
            guard::together("m4gn_ride_save", &comm, read, |path| handle.ride.save(path))?;
            Ok(0)
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
                    unsafe { (Path::new(pointers::text("path", path)?), handle.told(now, state)?) };
                let state = state.ok_or_else(|| Error::Input("state: expected that of the present time, found null".into()))?;
                Ok(((path, now, state), format!("{same} {}", guard::file_name(path))))
            },
            |handle, (path, now, state)| handle.ride.load(path, now, &state),
            answer,
        )
    }

    /// Takes what there is to be said.
    fn m4gn_ride_text(ride: *mut RideHandle, kind: i32) -> *const c_char, or |_| std::ptr::null(); {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference_mut("ride", ride)? };
        let text = match kind {
            0 => handle.ride.take(Text::Log),
            1 => handle.ride.take(Text::Warning),
            2 => handle.ride.take(Text::Jumps),
            3 => handle.ride.take(Text::Strides),
            4 => handle.ride.take(Text::Errors),
            5 => handle.ride.take(Text::SegmentErrors),
            6 => handle.ride.end(),
            7 => (0..handle.ride.layout().arrays().len())
                .find_map(|array| handle.ride.difference(0, array))
                .map_or_else(String::new, |(_, time)| time.into()),
            8 => handle.ride.take(Text::Modes),
            _ => return Err(Error::Input(format!("kind of text {kind}: expected 0 to 8"))),
        };
        let bytes: Vec<u8> = text.bytes().filter(|b| *b != 0).collect();
        handle.text = CString::new(bytes).unwrap_or_default();
        Ok(handle.text.as_ptr())
    }

    /// Rollout minus solver of an observed surrogate.
    fn m4gn_ride_difference(
        ride: *const RideHandle,
        surrogate: i32,
        array: i32,
        values: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { pointers::reference("ride", ride)? };
        let which = usize::try_from(surrogate).ok().zip(usize::try_from(array).ok());
        let found = which.and_then(|(surrogate, array)| handle.ride.difference(surrogate, array));
        let (found, _) = found.ok_or_else(|| Error::Input(format!("no difference of array {array}: nothing was compared yet")))?;
        // SAFETY: the host's array, as the header says.
        unsafe { pointers::slice_mut("values", values, found.len())? }.copy_from_slice(found);
        Ok(0)
    }
}
