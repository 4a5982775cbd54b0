//! Exports: the state machine of a hybrid run.

use super::door;
use super::fields::{read_fields, read_outputs};
use super::linear::{self, ArrayData};
use super::own::{Own, SurrogateData};
use super::raw::{self, FieldData, FieldOut, MeshData};
use super::session::SessionHandle;
use m4gn_adapt as adapt;
use m4gn_linear::Field as Array;
use m4gn_mesh::parallel::Comm;
use m4gn_mesh::{Error, Mesh, Result};
use m4gn_ride::{
    Action, Advanced, Answer, Fitted, Given, Kind, Mode, Network, Ride, RideSettings, Step, Surrogate, Text,
    host_of,
};
use m4gn_step::{Field, FieldMut, Session};
use std::ffi::{CString, c_char, c_void};
use std::ops::{Deref, DerefMut};
use std::path::Path;

/// `m4gn_ride_step`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RideStep {
    pub time: f64,
    pub delta_t: f64,
    pub end_time: f64,
    pub shown: f64,
    pub wall: f64,
    pub index: i64,
    pub name: *const c_char,
    pub correctors: i32,
    pub most_correctors: i32,
}

/// `m4gn_ride_answer`
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
#[allow(missing_docs)]
pub struct RideAnswer {
    pub duration: f64,
    pub delta_t: f64,
    pub solver_steps: i64,
    pub since: i64,
    pub action: i32,
    pub surrogate: i32,
    pub strides: i32,
    pub last_but_one: i32,
    pub fields: i32,
    pub stepped: i32,
    pub arrays: i32,
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
    ride: Ride<'static>,
    comm: Comm,
    n_cells: usize,
    /// Boundary values of a component: one for each boundary face, or each point of a body's obstacle.
    n_boundary: usize,
    /// The cell of each boundary face.
    owners: Vec<i32>,
    /// Lengths of the state's arrays.
    arrays: Vec<usize>,
    /// Those of the ones that are inputs.
    inputs: Vec<usize>,
    /// What was taken last.
    text: CString,
    /// Set while a call runs: one that panicked leaves it, and the handle may only be freed.
    broken: bool,
}

impl RideHandle {
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
            let input = read(handle);
            let found = door::together(name, &comm, || input, |input| work(handle, input))?;
            put(found, answer)
        })
    }
}

fn put(found: Answer, answer: *mut RideAnswer) -> Result<i32> {
    let action = match found.action {
        Action::Solve => 0,
        Action::Decide => 1,
        Action::Stride => 2,
        Action::Advance => 3,
        Action::HandBack => 4,
    };
    // SAFETY: the host's struct, or null.
    *unsafe { raw::reference_mut("answer", answer)? } = RideAnswer {
        duration: found.duration,
        delta_t: found.delta_t,
        solver_steps: found.solver_steps,
        since: found.since,
        action,
        surrogate: found.surrogate as i32,
        strides: i32::try_from(found.strides).unwrap_or(i32::MAX),
        last_but_one: i32::from(found.last_but_one),
        fields: i32::from(found.fields),
        stepped: i32::from(found.stepped),
        arrays: i32::from(found.arrays),
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
        let given = raw::reference("step", given)?;
        (given, raw::optional_text("step.name", given.name)?)
    };
    let count = |n: i32| usize::try_from(n).ok();
    let correctors = count(given.correctors).zip(count(given.most_correctors));
    let step = Step {
        time: given.time,
        delta_t: given.delta_t,
        end_time: given.end_time,
        index: given.index,
        name: name.map_or_else(|| given.time.to_string(), String::from),
        shown: given.shown,
        correctors: correctors.map(|(made, most)| [made, most]),
        // Each rank has a clock of its own.
        wall: given.wall,
    };
    let same = format!("time {:?} {:?} {:?} {}", step.time, step.delta_t, step.end_time, step.index);
    Ok((step, same))
}

/// The fields of a call, and what boundary faces hold.
type Fields<'a> = (Vec<Field<'a>>, Vec<Option<&'a [i32]>>);

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn fields<'a>(
    handle: &RideHandle,
    given: *const FieldData,
    held: *const *const i32,
    n: i32,
) -> Result<Fields<'a>> {
    let (cells, boundary) = (handle.n_cells, handle.n_boundary);
    // SAFETY: passed on to the caller.
    unsafe {
        let fields = read_fields((given, n), cells, boundary)?;
        let mut marks = Vec::new();
        if !held.is_null() {
            for &mark in raw::slice("held", held, fields.len())? {
                marks.push(match mark.is_null() {
                    true => None,
                    false => Some(raw::slice("held", mark, boundary)?),
                });
            }
        }
        Ok((fields, marks))
    }
}

impl RideHandle {
    fn given<'a>(owners: &'a [i32], (fields, held): &'a Fields<'a>) -> Given<'a> {
        Given { fields, held, owners }
    }
}

/// Settings of the ride, and of what its network learns.
pub(super) fn settings(text: &str) -> Result<(RideSettings, Option<adapt::Settings>)> {
    let settings = RideSettings::parse(text)?;
    let entries = settings.adapt_entries()?;
    // What is off is checked as well.
    let learning = match settings.adapt {
        Some(_) => Some(adapt::Settings::parse(&entries.learning)?),
        None => None,
    };
    Ok((settings, learning.filter(|_| entries.wanted)))
}

/// `m4gn_ride_surrogates`
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(missing_docs)]
pub struct RideSurrogates {
    /// A [`SessionHandle`].
    pub session: *mut c_void,
    pub own: *const SurrogateData,
    pub arrays: *const ArrayData,
    pub n_arrays: i32,
}

/// What a rank's host gives for a ride.
struct Setup {
    settings: RideSettings,
    learning: Option<adapt::Settings>,
    start: Step,
    /// None of a dmd surrogate alone.
    mesh: Option<Mesh>,
    own: Option<Own>,
    arrays: Option<(Vec<Array>, Vec<Advanced>)>,
    /// What all ranks must be given alike.
    same: String,
}

impl Setup {
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    unsafe fn read(
        comm: &Comm,
        given: &RideSurrogates,
        mesh: *const MeshData,
        options: *const c_char,
        start: *const RideStep,
    ) -> Result<Self> {
        let bad = |text: &str| Err(Error::Input(format!("surrogates: {text}")));
        // SAFETY: passed on to the caller.
        unsafe {
            let (settings, learning) = settings(raw::options(options)?)?;
            let (start, mut same) = step(start)?;
            let network = !given.session.is_null() || !given.own.is_null();
            match (settings.has(Kind::Network), network) {
                (true, false) => {
                    return bad("the settings name network, and there is neither a session nor an own one");
                }
                (false, true) => {
                    return bad("there is a session or an own one, and the settings do not name network");
                }
                _ if !given.session.is_null() && !given.own.is_null() => {
                    return bad("expected a session or an own one, found both");
                }
                _ => {}
            }
            match (settings.has(Kind::Dmd), given.n_arrays > 0) {
                (true, false) => {
                    return bad("the settings name dmd, and there are no arrays of the state");
                }
                (false, true) => {
                    return bad("there are arrays of the state, and the settings do not name dmd");
                }
                _ => {}
            }
            let mesh = match network {
                true => Some(raw::mesh(raw::reference("mesh", mesh)?)?),
                false => None,
            };
            let mut own = None;
            if let (false, Some(mesh)) = (given.own.is_null(), &mesh) {
                let made = Own::new(given.own, comm.clone(), mesh.dim())?;
                if learning.is_some() {
                    return Err(Error::Input(format!("adapt: the surrogate {} does not learn", made.name())));
                }
                same += &format!("\n{}", made.shared());
                own = Some(made);
            }
            let mut arrays = None;
            if given.n_arrays > 0 {
                let layout = linear::layout(given.arrays, given.n_arrays)?;
                if let Some(mesh) = &mesh {
                    linear::check_rows(&layout.0, &layout.1, mesh.cell_global.len())?;
                }
                arrays = Some(layout);
            }
            // Ranks have threads, texts and clocks of their own; a session's model may be on another path.
            let alike = RideSettings {
                host: String::new(),
                setup_seconds: 0.0,
                adapt: None,
                model: if given.session.is_null() { settings.model.clone() } else { String::new() },
                ..settings.clone()
            };
            let learned = learning.clone().map(|learning| adapt::Settings { threads: None, ..learning });
            same += &format!("\n{alike:?}\n{learned:?}");
            Ok(Setup { settings, learning, start, mesh, own, arrays, same })
        }
    }
}

/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn new(
    comm: i32,
    place: Result<()>,
    surrogates: *const RideSurrogates,
    mesh: *const MeshData,
    options: *const c_char,
    start: *const RideStep,
) -> Result<RideHandle> {
    // SAFETY: passed on to the caller.
    let given = *unsafe { raw::reference("surrogates", surrogates)? };
    // SAFETY: passed on to the caller.
    let comm = match unsafe {
        raw::optional_reference("surrogates.session", given.session.cast::<SessionHandle>())?
    } {
        Some(handle) => handle.session.comm().clone(),
        None => Comm::from_fortran(comm)?,
    };
    let read = || {
        place?;
        // SAFETY: passed on to the caller.
        let mut setup = unsafe { Setup::read(&comm, &given, mesh, options, start)? };
        let same = std::mem::take(&mut setup.same);
        Ok((setup, same))
    };
    door::together("m4gn_ride_new", &comm, read, |setup| {
        let Setup { settings, mut learning, start, mesh, mut own, mut arrays, .. } = setup;
        let (mut lengths, mut inputs) = (Vec::new(), Vec::new());
        let mut rows = mesh.as_ref().map_or(0, |mesh| mesh.cell_global.len());
        let mut riding: Vec<Box<dyn Surrogate>> = Vec::new();
        for kind in &settings.surrogates {
            riding.push(match (kind, own.take(), &mesh) {
                (Kind::Network, Some(own), _) => Box::new(own),
                (Kind::Network, None, Some(mesh)) => {
                    // SAFETY: passed on to the caller.
                    let model = unsafe { raw::reference("session", given.session.cast::<SessionHandle>())? }
                        .model
                        .clone();
                    let learning = learning.take().map(|learning| (mesh.clone(), learning));
                    let network =
                        Network::new(Borrowed(given.session.cast()), model, settings.model.clone(), learning);
                    Box::new(comm.agree(network)?)
                }
                (Kind::Network, None, None) => {
                    return Err(Error::Internal("a network without a mesh".into()));
                }
                (Kind::Dmd, kept, _) => {
                    own = kept;
                    let (fields, advanced) = arrays.take().unwrap_or_default();
                    lengths = fields.iter().map(|f| f.len).collect();
                    inputs = fields.iter().filter(|f| f.input).map(|f| f.len).collect();
                    if mesh.is_none() {
                        let first = fields.iter().find(|f| f.measured());
                        rows = first.map_or(0, |f| f.len / f.components.max(1));
                    }
                    let observes = settings.mode == Mode::Observe;
                    let dmd = settings.dmd.clone().unwrap_or_default();
                    Box::new(Fitted::new(&comm, fields, advanced, dmd, observes, &start)?)
                }
            });
        }
        let global = match &mesh {
            Some(mesh) => mesh.cell_global.clone(),
            None => {
                let begin = comm.exclusive_scan_i64(rows as i64);
                (begin..begin + rows as i64).collect()
            }
        };
        Ok(RideHandle {
            ride: Ride::new(comm.clone(), riding, settings, global, start)?,
            comm: comm.clone(),
            n_cells: rows,
            n_boundary: mesh.as_ref().map_or(0, boundary_values),
            owners: mesh.iter().flat_map(|mesh| mesh.boundary.iter().map(|face| face.owner)).collect(),
            arrays: lengths,
            inputs,
            text: CString::default(),
            broken: false,
        })
    })
}

fn boundary_values(mesh: &Mesh) -> usize {
    match &mesh.obstacle {
        Some(obstacle) => obstacle.positions.len(),
        None => mesh.boundary.len(),
    }
}

exports! {
    /// Begins a ride.
    fn m4gn_ride_new(
        comm: i32,
        surrogates: *const RideSurrogates,
        mesh: *const MeshData,
        options: *const c_char,
        start: *const RideStep,
        ride: *mut *mut RideHandle,
    ) -> i32, or |status| status; {
        // SAFETY: the host's pointers, as the header says.
        unsafe {
            door::create(raw::reference_mut("ride", ride), |place| new(comm, place, surrogates, mesh, options, start))
        }
    }

    /// The arrays of the state after a step of the solver.
    fn m4gn_ride_record(ride: *mut RideHandle, arrays: *const *const f64, n_arrays: i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            let comm = handle.comm.clone();
            // SAFETY: the host's arrays, as the header says.
            let read = || Ok((unsafe { linear::read(arrays, n_arrays, &handle.arrays)? }, String::new()));
            door::together("m4gn_ride_record", &comm, read, |arrays| handle.ride.record(&arrays))?;
            Ok(0)
        })
    }

    /// What the inputs will be at the end of the next stride.
    fn m4gn_ride_inputs(ride: *mut RideHandle, arrays: *const *const f64, n_arrays: i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's arrays, as the header says.
        unsafe {
            let handle = raw::reference_mut("ride", ride)?;
            let inputs = linear::read(arrays, n_arrays, &handle.inputs)?;
            handle.ride.inputs(&inputs)?;
        }
        Ok(0)
    }

    /// The arrays of the state that was predicted, or of one before it.
    fn m4gn_ride_arrays(ride: *const RideHandle, before: f64, arrays: *const *mut f64, n_arrays: i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's arrays, as the header says.
        unsafe {
            let handle = raw::reference("ride", ride)?;
            handle.ride.arrays(before, &mut linear::places(arrays, n_arrays, &handle.arrays)?)?;
        }
        Ok(0)
    }

    /// Frees a ride; null is none.
    fn m4gn_ride_free(ride: *mut RideHandle) -> (), or |_| (); {
        if !ride.is_null() {
            // SAFETY: made by m4gn_ride_new and freed once.
            drop(unsafe { Box::from_raw(ride) });
        }
        Ok(())
    }

    /// The solver has made a step.
    fn m4gn_ride_solved(ride: *mut RideHandle, now: *const RideStep, answer: *mut RideAnswer) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's structs, or null.
        let (handle, now) = unsafe { (raw::reference_mut("ride", ride)?, step(now)?.0) };
        handle.guarded(|handle| put(handle.ride.solved(now)?, answer))
    }

    /// What follows a step of the solver.
    fn m4gn_ride_decide(
        ride: *mut RideHandle,
        given: *const FieldData,
        held: *const *const i32,
        n_fields: i32,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_decide",
            // SAFETY: the host's arrays, as the header says.
            |handle| Ok((unsafe { fields(handle, given, held, n_fields)? }, String::new())),
            |handle, found| handle.ride.decide(&RideHandle::given(&handle.owners, &found)),
            answer,
        )
    }

    /// A stride of a jump.
    fn m4gn_ride_stride(
        ride: *mut RideHandle,
        given: *const FieldData,
        n_fields: i32,
        out: *const FieldOut,
        n_out: i32,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        let mut places = Vec::new();
        let mut predicted: Vec<Vec<f64>> = Vec::new();
        let status = handle.together(
            "m4gn_ride_stride",
            |handle| {
                // SAFETY: the host's arrays, as the header says.
                let (found, outputs) = unsafe {
                    (
                        fields(handle, given, std::ptr::null(), n_fields)?,
                        read_outputs((out, n_out), handle.n_cells)?,
                    )
                };
                Ok(((found, outputs), String::new()))
            },
            |handle, (found, outputs)| {
                predicted = outputs.iter().map(|(shape, _)| vec![0.0; shape.len]).collect();
                let pairs = outputs.iter().zip(&mut predicted);
                let mut own: Vec<FieldMut> = pairs
                    .map(|((shape, _), cells)| FieldMut {
                        name: shape.name,
                        components: shape.components,
                        cells,
                    })
                    .collect();
                let answer = handle.ride.stride(&RideHandle::given(&handle.owners, &found), &mut own)?;
                if answer.action == Action::Advance {
                    places = outputs;
                }
                Ok(answer)
            },
            answer,
        )?;
        // The host may name the same arrays, and those that were read are no longer needed.
        for ((shape, cells), values) in places.into_iter().zip(&predicted) {
            // SAFETY: not null (checked in read_outputs), of this length by the header; no other reference lives.
            unsafe { raw::slice_mut(shape.name, cells, shape.len)? }.copy_from_slice(values);
        }
        Ok(status)
    }

    /// Time and fields have been advanced by a stride.
    fn m4gn_ride_advanced(ride: *mut RideHandle, now: *const RideStep, answer: *mut RideAnswer) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's structs, or null.
        let (handle, now) = unsafe { (raw::reference_mut("ride", ride)?, step(now)?.0) };
        handle.guarded(|handle| put(handle.ride.advanced(now)?, answer))
    }

    /// What other parts of the run report.
    fn m4gn_ride_reported(ride: *mut RideHandle, values: *const f64, n_values: i32) -> i32, or |s| s; {
        // SAFETY: a ride of ours and the host's values, as the header says.
        let (handle, values) = unsafe {
            let values = raw::slice("values", values, raw::count("n_values", n_values)?)?;
            (raw::reference_mut("ride", ride)?, values)
        };
        handle.guarded(|handle| handle.ride.reported(values).map(|()| 0))
    }

    /// Wall time of strides and of handing over.
    fn m4gn_ride_spent(ride: *mut RideHandle, surrogate: f64, hand_over: f64) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            handle.ride.spent(surrogate, hand_over);
            Ok(0)
        })
    }

    /// The state has been handed back.
    fn m4gn_ride_handed_back(
        ride: *mut RideHandle,
        now: *const RideStep,
        quantities: *const RideQuantity,
        n_quantities: i32,
        given: *const FieldData,
        n_fields: i32,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_handed_back",
            |handle| {
                // SAFETY: the host's arrays and structs, as the header says.
                unsafe {
                    let (now, same) = step(now)?;
                    let list = raw::slice("quantities", quantities, raw::count("n_quantities", n_quantities)?)?;
                    let told = list.iter().map(|q| Ok((raw::text("quantity", q.name)?.to_string(), q.value)));
                    let told: Vec<(String, f64)> = told.collect::<Result<_>>()?;
                    let found = fields(handle, given, std::ptr::null(), n_fields)?;
                    Ok(((now, told, found), same))
                }
            },
            |handle, (now, told, found)| {
                handle.ride.handed_back(now, &told, &RideHandle::given(&handle.owners, &found))
            },
            answer,
        )
    }

    /// Writes the state.
    fn m4gn_ride_save(ride: *mut RideHandle, path: *const c_char) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.guarded(|handle| {
            let comm = handle.comm.clone();
            let read = || {
                // SAFETY: the host's text, or null.
                let path = Path::new(unsafe { raw::text("path", path)? });
                Ok((path, door::file_name(path)))
            };
            door::together("m4gn_ride_save", &comm, read, |path| handle.ride.save(path))?;
            Ok(0)
        })
    }

    /// What the host keeps in a state for itself.
    fn m4gn_ride_host(path: *const c_char, text: *mut c_char, size: i32) -> i32, or |s| s; {
        // SAFETY: the host's text and place, as the header says.
        let (path, place) = unsafe {
            (raw::text("path", path)?, raw::slice_mut("text", text, raw::count("size", size)?)?)
        };
        raw::put_text(&host_of(Path::new(path))?, place);
        Ok(0)
    }

    /// Takes up a state.
    fn m4gn_ride_load(
        ride: *mut RideHandle,
        path: *const c_char,
        now: *const RideStep,
        answer: *mut RideAnswer,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        handle.together(
            "m4gn_ride_load",
            |_| {
                // SAFETY: the host's text and struct, or null.
                let (path, (now, same)) = unsafe { (Path::new(raw::text("path", path)?), step(now)?) };
                Ok(((path, now), format!("{same} {}", door::file_name(path))))
            },
            |handle, (path, now)| handle.ride.load(path, now),
            answer,
        )
    }

    /// Takes what there is to be said.
    fn m4gn_ride_text(ride: *mut RideHandle, kind: i32) -> *const c_char, or |_| std::ptr::null(); {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference_mut("ride", ride)? };
        let text = match kind {
            0 => handle.ride.take(Text::Log),
            1 => handle.ride.take(Text::Warning),
            2 => handle.ride.take(Text::Jumps),
            3 => handle.ride.take(Text::Strides),
            4 => handle.ride.take(Text::Errors),
            5 => handle.ride.take(Text::SegmentErrors),
            6 => handle.ride.end(),
            7 => handle.ride.difference(0).map_or_else(String::new, |(_, time)| time.into()),
            _ => return Err(Error::Input(format!("kind of text {kind}: expected 0 to 7"))),
        };
        let bytes: Vec<u8> = text.bytes().filter(|b| *b != 0).collect();
        handle.text = CString::new(bytes).unwrap_or_default();
        Ok(handle.text.as_ptr())
    }

    /// Where an observed surrogate is off.
    fn m4gn_ride_difference(
        ride: *const RideHandle,
        surrogate: i32,
        index: i32,
        cells: *mut f64,
    ) -> i32, or |s| s; {
        // SAFETY: a ride of ours, or null.
        let handle = unsafe { raw::reference("ride", ride)? };
        let fields = usize::try_from(surrogate).ok().and_then(|i| handle.ride.difference(i));
        let found = fields.and_then(|(fields, _)| fields.get(usize::try_from(index).ok()?));
        let values = found.ok_or_else(|| Error::Input(format!("no difference of field {index}: nothing was compared yet")))?;
        // SAFETY: the host's array, as the header says.
        unsafe { raw::slice_mut("cells", cells, values.len())? }.copy_from_slice(values);
        Ok(0)
    }
}
