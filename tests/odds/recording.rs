//! Recordings.

use crate::calls::{Bench, Ended, Oddity, Owned, Tried, made, unless, unless_mut, values};
use crate::host::*;
use serde_json::json;
use std::path::PathBuf;
use std::ptr::null;

impl Bench {
    pub fn recorder_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> (Ended, Owned<RecorderHandle>) {
        let host = self.host(odd);
        let name = if odd == Some("path") { "b.h5" } else { "a.h5" };
        let path = self.folder.path().join(name);
        let fields = [declared(c"U".as_ptr(), 3), declared(c"p".as_ptr(), 1)];
        let mut settings = json!({ "path": path, "overwrite": true });
        match odd {
            Some("split") => settings["split"] = "test".into(),
            Some("overwrite") => settings["overwrite"] = false.into(),
            Some("json") => settings["provenance"] = json!([1]),
            _ => (),
        }
        let settings = options(&settings);
        let n_fields = if odd == Some("fields") { 1 } else { 2 };
        let mut recorder = Owned(none(), m4gn_recorder_free);
        let place = unless_mut(odd == Some("null"), &raw mut recorder.0);
        let mesh = unless(odd == Some("no mesh"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        let ended = self.made(panic, || unsafe {
            m4gn_recorder_new(self.world.fortran(), mesh, given, fields.as_ptr(), n_fields, place)
        });
        (ended, recorder)
    }

    fn append(
        &self,
        recorder: &Owned<RecorderHandle>,
        time: f64,
        odd: Option<Oddity>,
        panic: Option<u32>,
    ) -> Ended {
        let mut flow = values(&self.host(None));
        if odd == Some("nan") {
            flow.u[1] = f64::NAN;
        }
        let (mut cells, mut boundary) = (flow.cells(), flow.boundary());
        match odd {
            Some("no cells") => cells[1] = null(),
            Some("no boundary") => boundary[0] = null(),
            _ => (),
        }
        let cells = unless(odd == Some("null"), cells.as_ptr());
        let boundary = unless(odd == Some("no faces"), boundary.as_ptr());
        let time = if odd == Some("time") { time + 1.0 } else { time };
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe { m4gn_recorder_append(recorder.0, time, cells, boundary) })
    }

    pub fn recorder_append(&self, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let recorder = made(self.recorder_new(None, None))?;
        let ended = self.append(&recorder, 0.5, odd, panic);
        let again = self.append(&recorder, 2.5, None, None);
        let finished = self.finished(recorder.0, None, None);
        Ok(self.then(self.then(ended, again), finished))
    }

    /// The handle is all that this call is given, and must be valid; the rest of what may go wrong is with the file.
    fn finished(&self, recorder: *mut RecorderHandle, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        // The first rank's folder is the one that is written to.
        let mut folder = self.folder.path().display().to_string().into_bytes();
        self.world.broadcast(&mut folder);
        let folder = PathBuf::from(String::from_utf8(folder).unwrap());
        match odd {
            Some("taken") => {
                let _ = std::fs::remove_file(folder.join("a.h5"));
                std::fs::create_dir(folder.join("a.h5")).unwrap();
            }
            Some("lost") => {
                for entry in std::fs::read_dir(&folder).unwrap() {
                    std::fs::remove_file(entry.unwrap().path()).unwrap();
                }
            }
            _ => (),
        }
        // SAFETY: a recorder of ours.
        let ended = self.made(panic, || unsafe { m4gn_recorder_finish(recorder) });
        self.world.barrier();
        if odd == Some("taken") {
            std::fs::remove_dir(folder.join("a.h5")).unwrap();
        }
        ended
    }

    pub fn recorder_finish(&self, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let recorder = made(self.recorder_new(None, None))?;
        made((self.append(&recorder, 0.0, None, None), ()))?;
        let mut ended = self.finished(recorder.0, odd, panic);
        // What is finished, or was given up, is not finished again: all ranks say so.
        let again = self.finished(recorder.0, None, None);
        let (low, high) = self.range(again.status);
        let (low_before, _) = self.range(ended.status);
        let refused = if low_before < 0 { high < 0 } else { low > 0 };
        if !refused {
            ended.usable = false;
            ended.message = format!("finished again it gives {low} to {high}: {}", again.message);
        }
        Ok(ended)
    }
}
