//! Recordings.

use crate::calls::{Bench, Ended, Oddity, field, unless, unless_mut, values};
use crate::host::*;
use crate::timed;
use m4gn::RecorderField;
use serde_json::json;

impl Bench {
    pub fn recorder_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> (Ended, Handle) {
        let host = self.host(odd);
        let name = if odd == Some("path") { "b.h5" } else { "a.h5" };
        let path = self.folder.path().join(name);
        let dimensions = [0, 1, -1, 0, 0, 0, 0];
        let declared = |name: &'static std::ffi::CStr, components| RecorderField {
            name: name.as_ptr(),
            components,
            dimensions,
        };
        let fields = [declared(c"U", 3), declared(c"p", 1)];
        let mut settings = json!({ "path": path, "overwrite": true });
        match odd {
            Some("split") => settings["split"] = "test".into(),
            Some("overwrite") => settings["overwrite"] = false.into(),
            Some("json") => settings["provenance"] = json!([1]),
            _ => (),
        }
        let settings = options(&settings);
        let n_fields = if odd == Some("fields") { 1 } else { 2 };
        let mut recorder = none();
        let place = unless_mut(odd == Some("null"), &raw mut recorder);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        let ended = self.made(panic, || unsafe {
            m4gn_recorder_new(
                self.world.fortran(),
                mesh,
                given,
                fields.as_ptr(),
                n_fields,
                place,
            )
        });
        if odd.is_some() || panic.is_some() || ended.status != 0 {
            // SAFETY: null, or a recorder that is not used again.
            unsafe { m4gn_recorder_free(std::mem::replace(&mut recorder, none())) };
        }
        (ended, recorder)
    }

    pub fn recorder_append(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (made, recorder) = self.recorder_new(None, None);
        if made.status != 0 {
            return made;
        }
        let host = self.host(None);
        let append = |time: f64, odd: Option<Oddity>, panic| {
            let (mut u, p, b) = values(&host);
            if odd == Some("nan") {
                u[1] = f64::NAN;
            }
            let fields = [field(c"U", 3, &u, &b), field(c"p", 1, &p, &b)];
            let n = match odd {
                Some("missing") => 1,
                Some("count") => -1,
                _ => 2,
            };
            let time = if odd == Some("time") { time + 1.0 } else { time };
            // SAFETY: arrays of their lengths, or what the call refuses.
            self.made(panic, || unsafe {
                m4gn_recorder_append(recorder, time, fields.as_ptr(), n)
            })
        };
        let ended = append(0.5, odd, panic);
        append(2.5, None, None);
        // SAFETY: freed once.
        timed(|| unsafe { m4gn_recorder_free(recorder) });
        ended
    }

    pub fn recorder_finish(&self, panic: Option<u32>) -> Ended {
        let (made, recorder) = self.recorder_new(None, None);
        if made.status != 0 {
            return made;
        }
        let host = self.host(None);
        let (u, p, b) = values(&host);
        let fields = [field(c"U", 3, &u, &b), field(c"p", 1, &p, &b)];
        // SAFETY: arrays of their lengths; freed once.
        unsafe {
            m4gn_recorder_append(recorder, 0.0, fields.as_ptr(), 2);
            let ended = self.made(panic, || m4gn_recorder_finish(recorder));
            timed(|| m4gn_recorder_free(recorder));
            ended
        }
    }
}
