//! What a host brings along to a ride.

use super::pointers::{self, MeshData};
use super::ride::{self, RideStep};
use super::session::SessionHandle;
use super::state::{self, AheadFunction, ArrayData};
use super::user_surrogate::{SurrogateData, UserSurrogate};
use m4gn_base::{Error, Result};
use m4gn_mesh::Mesh;
use m4gn_model::Model;
use m4gn_parallel::Comm;
use m4gn_ride::registry::NETWORK;
use m4gn_ride::{DmdSettings, Host, Network, Ride, RideSettings, Step, Surrogate};
use m4gn_state::Layout;
use m4gn_step::Session;
use std::ffi::{c_char, c_void};
use std::ops::{Deref, DerefMut};
use std::sync::Arc;

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
pub(super) struct Setup {
    host: HostData,
    /// Of the host's session.
    model: Option<Arc<Model>>,
    settings: RideSettings,
    start: Step,
    mesh: Option<Mesh>,
    layout: Layout,
    own: Option<UserSurrogate>,
}

/// The host's session, if there is one.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
unsafe fn session<'a>(host: *const HostData) -> Result<Option<&'a SessionHandle>> {
    // SAFETY: passed on to the caller.
    unsafe {
        let session = pointers::optional_reference("host", host)?.map_or(std::ptr::null_mut(), |h| h.session);
        pointers::optional_reference("host.session", session.cast())
    }
}

/// The ranks of a ride: those of the session, so that a rank that cannot finish a call is seen wherever the others wait.
///
/// # Safety
/// Pointers must be what `m4gn.h` says.
pub(super) unsafe fn ranks(comm: i32, host: *const HostData) -> Result<Comm> {
    // SAFETY: passed on to the caller.
    match unsafe { session(host)? } {
        Some(handle) => Ok(handle.session.comm().clone()),
        None => Comm::from_fortran(comm),
    }
}

impl Setup {
    /// With what all ranks must have alike.
    ///
    /// # Safety
    /// Pointers must be what `m4gn.h` says.
    pub(super) unsafe fn read(
        comm: &Comm,
        host: *const HostData,
        options: *const c_char,
        start: *const RideStep,
    ) -> Result<(Self, String)> {
        let bad = |text: &str| Err(Error::Input(format!("host: {text}")));
        // SAFETY: passed on to the caller.
        unsafe {
            let model = session(host)?.map(|handle| handle.model.clone());
            let host = *pointers::reference("host", host)?;
            let settings = RideSettings::parse(pointers::options(options)?)?;
            let (start, mut same) = ride::step(start)?;
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
            Ok((Setup { host, model, settings, start, mesh, layout, own }, same))
        }
    }

    /// Collective.
    pub(super) fn ride(self, comm: &Comm) -> Result<Ride<'static>> {
        let Setup { host, model, settings, start, mesh, layout, own } = self;
        let network: Option<Box<dyn Surrogate>> = match (model, own) {
            (Some(model), _) => {
                let (session, source) = (Borrowed(host.session.cast()), settings.model.clone());
                Some(Box::new(comm.agree(Network::new(session, &model, source, &layout))?))
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
            ahead: host.ahead.map(|function| state::ahead(function, host.data)),
            global,
            owners: mesh.iter().flat_map(|mesh| mesh.boundary.iter().map(|face| face.owner)).collect(),
        };
        Ride::new(comm.clone(), host, settings, start)
    }
}
