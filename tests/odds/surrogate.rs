//! Sessions and segments.

use crate::calls::{Bench, Ended, Oddity, Owned, TESTS, Tried, c, made, unless, unless_mut, values};
use crate::host::*;
use serde_json::{Value, json};
use std::path::Path;
use std::ptr::null;

impl Bench {
    pub fn session_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> (Ended, Owned<SessionHandle>) {
        let host = self.host(odd);
        let labels = vec![0; host.mesh.n_cells()];
        let model = match odd {
            Some("model") => format!("{TESTS}/e2e/solid.safetensors"),
            _ => format!("{TESTS}/cabi/small.safetensors"),
        };
        let segments = match odd {
            Some("segments") => json!({ "count": 5 }),
            Some("modes") => json!({ "modes": 2 }),
            Some("overlap") => json!({ "overlap": 1 }),
            Some("iterations") => json!({ "iterations": 1 }),
            Some("tau") => json!({ "tau": -1.0 }),
            Some("size") => json!({ "size": 0.3 }),
            Some("method") => json!({ "method": "metis" }),
            Some("connected") => json!({ "connected": false }),
            Some("distance") => json!({ "distance_scale": 0.1 }),
            Some("obstacles") => json!({ "obstacles": ["wall"] }),
            Some("solver") => json!({ "modal_solver": "iterative" }),
            Some("operator") => json!({ "operator": "elastic" }),
            Some("components") => json!({ "cuont": 5 }),
            _ => json!({}),
        };
        let mut settings = json!({ "segments": segments });
        match odd {
            Some("precision") => settings["precision"] = "bf16".into(),
            Some("text") => settings["backend"] = "abacus".into(),
            // Each of these is valid where all ranks give it.
            Some("backend") => settings["backend"] = "torch:cpu".into(),
            Some("resolution") => settings["resolution"] = 0.3.into(),
            Some("solid") => settings["solid"] = json!({ "E": [1e6, 1e6], "schemes": ["Euler"] }),
            _ => (),
        }
        let cell_segment = unless(odd != Some("labels"), labels.as_ptr());
        self.session_of(&host, model, &settings, cell_segment, odd, panic)
    }

    /// A session on the host's mesh.
    pub fn session_of(
        &self,
        host: &Host,
        model: impl AsRef<Path>,
        settings: &Value,
        cell_segment: *const i32,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> (Ended, Owned<SessionHandle>) {
        let (model, settings) = (Owned(open_model(model), m4gn_model_free), options(settings));
        let mut session = Owned(none(), m4gn_session_free);
        let place = unless_mut(odd == Some("null"), &raw mut session.0);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        let of = if odd == Some("no model") { none() } else { model.0 };
        // SAFETY: arrays of their lengths, or the null pointers and labels that the call refuses.
        let ended = self.made(panic, || unsafe {
            m4gn_session_new(self.world.fortran(), mesh, of, given, cell_segment, place)
        });
        (ended, session)
    }

    /// A step of a session of U and p.
    fn flow_step(&self, session: Session, host: &Host, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let mut given = values(host);
        match odd {
            Some("nan") => given.u[0] = f64::NAN,
            Some("infinite") => given.faces[0] = f64::INFINITY,
            _ => (),
        }
        let mut after = values(host);
        let (mut cells, mut boundary, mut next) = (given.cells(), given.boundary(), after.next());
        match odd {
            Some("no cells") => cells[1] = null(),
            Some("no boundary") => boundary[0] = null(),
            Some("no place") => next[0] = none(),
            _ => (),
        }
        let cells = unless(odd == Some("null"), cells.as_ptr());
        let boundary = unless(odd == Some("no faces"), boundary.as_ptr());
        let next = unless(odd == Some("nowhere"), next.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe { m4gn_session_step(session, cells, boundary, next) })
    }

    pub fn session_step(&self, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let session = made(self.session_new(None, None))?;
        let host = self.host(None);
        let ended = self.flow_step(session.0, &host, odd, panic);
        let again = self.flow_step(session.0, &host, None, None);
        Ok(self.then(ended, again))
    }

    /// After a step: before one there is nothing that the ranks would have to bring together.
    pub fn session_outside(&self, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let session = made(self.session_new(None, None))?;
        let host = self.host(None);
        self.flow_step(session.0, &host, None, None);
        let (mut count, mut why) = (0, [0; 200]);
        let place = unless_mut(odd == Some("null"), &raw mut count);
        let size = if odd == Some("size") { -1 } else { 200 };
        // SAFETY: places of their lengths, or what the call refuses.
        let ended =
            self.made(panic, || unsafe { m4gn_session_outside(session.0, place, why.as_mut_ptr(), size) });
        let again = self.flow_step(session.0, &host, None, None);
        Ok(self.then(ended, again))
    }

    pub fn segments_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let host = self.host(odd);
        let labels = vec![0; host.mesh.n_cells()];
        let mut settings = json!({ "segments": { "count": 4, "modes": 3 }, "with_modes": true });
        match odd {
            Some("spec") => settings["segments"]["count"] = 5.into(),
            Some("solver") => settings["segments"]["modal_solver"] = "direct".into(),
            Some("modes") => settings["with_modes"] = false.into(),
            _ => (),
        }
        let settings = match odd {
            Some("json") => c("{\"segments\": ".into()),
            _ => options(&settings),
        };
        let cell_segment = unless(odd != Some("labels"), labels.as_ptr());
        let mut segments = Owned(none(), m4gn_segments_free);
        let place = unless_mut(odd == Some("null"), &raw mut segments.0);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_segments_new(self.world.fortran(), mesh, none(), given, cell_segment, place)
        })
    }

    pub fn segments_fit(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let host = self.host(odd);
        let labels: Vec<i32> = (0..host.mesh.n_cells()).map(|c| c as i32 % 4).collect();
        let count = if odd == Some("spec") { 5 } else { 4 };
        let settings = match odd {
            Some("json") => c("{\"segments\": ".into()),
            _ => options(&json!({ "segments": { "count": count, "modes": 3 } })),
        };
        let (mut fit, mut why) = (0, [0; 200]);
        let place = unless_mut(odd == Some("null"), &raw mut fit);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        let stored = unless(odd == Some("labels"), labels.as_ptr());
        let size = if odd == Some("size") { -1 } else { 200 };
        let (comm, why) = (self.world.fortran(), why.as_mut_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_segments_fit(comm, mesh, none(), given, stored, null(), place, why, size)
        })
    }
}
