//! Adaptations.

use crate::calls::{Bench, Ended, Oddity, c, field, unless, unless_mut, values};
use crate::host::*;
use crate::timed;
use m4gn::AdaptReport;
use std::ffi::{CStr, CString};
use std::ptr::null;

/// A stride of the model is two of these, s.
const STEP: f64 = 0.005;

impl Bench {
    /// An adaptation of this session's model.
    pub fn adapt_made(
        &self,
        session: Handle,
        host: &Host,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> (Ended, Handle) {
        let steps = if odd == Some("steps") { 3 } else { 2 };
        let settings = match odd {
            Some("json") => c("{\"mode\": ".into()),
            Some("mode") => c("{\"mode\": \"always\"}".into()),
            _ => c(format!(
                "{{\"mode\": \"during\", \"steps\": {steps}, \"stepsEach\": 1, \"batch\": 1, \"maxFrames\": 40}}"
            )),
        };
        let mut adapt = none();
        let place = unless_mut(odd == Some("null"), &raw mut adapt);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no settings"), settings.as_ptr());
        // SAFETY: a session, and arrays of their lengths, or the null pointers that the call refuses.
        let ended = self.made(panic, || unsafe { m4gn_adapt_new(session, mesh, given, place) });
        (ended, adapt)
    }

    pub fn adapt_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (made, session) = self.session_new(None, None);
        if made.status != 0 {
            return made;
        }
        let (ended, adapt) = self.adapt_made(session, &self.host(odd), odd, panic);
        // SAFETY: null, or freed once.
        timed(|| unsafe {
            m4gn_adapt_free(adapt);
            m4gn_session_free(session);
        });
        ended
    }

    /// A call on an adaptation that has frames, and a state of it on disk.
    pub fn adapt_call(&self, call: &str, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (made, session) = self.session_new(None, None);
        if made.status != 0 {
            return made;
        }
        let host = self.host(None);
        let (made, adapt) = self.adapt_made(session, &host, None, None);
        if made.status != 0 {
            return made;
        }
        let run = |odd, panic| self.adapt_run((adapt, session), odd, panic);
        let file = |name: &'static str, odd, panic| self.adapt_file(name, (adapt, session), odd, panic);
        for i in 0..12 {
            self.adapt_frame(adapt, &host, STEP * f64::from(i), None, None);
        }
        let ended = match call {
            "adapt_frame" => self.adapt_frame(adapt, &host, STEP * 12.0, odd, panic),
            "adapt_run" => run(odd, panic),
            "adapt_load" => {
                file("adapt_save", None, None);
                file("adapt_load", odd, panic)
            }
            "adapt_save" => file("adapt_save", odd, panic),
            _ => file("adapt_write_model", odd, panic),
        };
        let again = run(None, None);
        // SAFETY: freed once.
        timed(|| unsafe {
            m4gn_adapt_free(adapt);
            m4gn_session_free(session);
        });
        self.then(ended, again)
    }

    fn adapt_frame(
        &self,
        adapt: Handle,
        host: &Host,
        time: f64,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let (mut u, p, b) = values(host);
        u.iter_mut()
            .enumerate()
            .for_each(|(i, u)| *u *= (30.0 * time + i as f64).cos());
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
        let time = if odd == Some("time") { time + 1.0 } else { time };
        let begins = i32::from(time == 0.0 || odd == Some("begins"));
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_adapt_frame(adapt, time, begins, fields.as_ptr(), n)
        })
    }

    fn adapt_run(
        &self,
        (adapt, session): (Handle, Handle),
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let mut report = AdaptReport::default();
        let mut note = [0; 200];
        let place = unless_mut(odd == Some("no report"), &raw mut report);
        let session = if odd == Some("no session") {
            none()
        } else {
            session
        };
        let strides = match odd {
            Some("strides") => 3,
            Some("negative") => -2,
            _ => 2,
        };
        let size = if odd == Some("size") { -1 } else { 200 };
        // SAFETY: places of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_adapt_run(adapt, session, strides, place, note.as_mut_ptr(), size)
        })
    }

    fn adapt_file(
        &self,
        call: &str,
        (adapt, session): (Handle, Handle),
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let name = match odd {
            Some("path") => "b",
            _ => "a",
        };
        let path: CString = c(self.folder.path().join(name).display().to_string());
        let path: &CStr = &path;
        let path = unless(odd == Some("null"), path.as_ptr());
        let session = if odd == Some("no session") {
            none()
        } else {
            session
        };
        // SAFETY: a C string or null, and objects of ours.
        self.made(panic, || unsafe {
            match call {
                "adapt_save" => m4gn_adapt_save(adapt, path),
                "adapt_load" => m4gn_adapt_load(adapt, session, path),
                _ => m4gn_adapt_write_model(adapt, path),
            }
        })
    }
}
