//! Modes of matrices and of elastic bodies.

use crate::calls::{Bench, Ended, Oddity, Owned, unless, unless_mut};
use crate::host::*;
use m4gn_samples::mesh as sample;
use m4gn_samples::points::{Kind, block, part as body_part};
use serde_json::json;
use std::ptr::null;

impl Bench {
    /// A chain of springs, enough for PETSc.
    pub fn modes_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let (n, size, rank) = (900i64, i64::from(self.world.size()), i64::from(self.world.rank()));
        let (first, last) = (n * rank / size, n * (rank + 1) / size);
        let mut rows = Rows::band(first..last, n, 2.0, -1.0);
        match odd {
            Some("nan") => rows.value[3] = f64::NAN,
            Some("column") => rows.column[3] = n,
            _ => (),
        }
        let matrix = rows.data();
        let mut settings = json!({ "modes": 3 });
        match odd {
            Some("modes") => settings["modes"] = 4.into(),
            Some("block") => settings["block"] = 2.into(),
            Some("shift") => settings["shift"] = (-0.01).into(),
            Some("solver") => settings["modal_solver"] = "iterative".into(),
            _ => (),
        }
        let settings = options(&settings);
        let mut modes = Owned(none(), m4gn_modes_free);
        let place = unless_mut(odd == Some("null"), &raw mut modes.0);
        let stiffness = unless(odd == Some("no stiffness"), &raw const matrix);
        let mass = if odd == Some("mass") { &raw const matrix } else { null() };
        let given = unless(odd == Some("no options"), settings.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe {
            m4gn_modes_new(self.world.fortran(), stiffness, mass, given, null(), place)
        })
    }

    pub fn solid_modes_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let whole = block(Kind::ALL[0], [6, 2, 2], [1.0, 0.3, 0.3]);
        let ranks = sample::strips(whole.n_cells, self.world.size());
        let mut mesh = body_part(&whole, &ranks, self.world.rank());
        match odd {
            // The sum of it and 3 is no i32.
            Some("start") => mesh.face_start[1] = i32::MAX,
            Some("global") => mesh.point_global[0] = 1 << 20,
            Some("point") => mesh.points[2][1] = f64::NAN,
            Some("face point") => mesh.face_points[5] = 10_000,
            Some("turned") => mesh.face_points.swap(0, 1),
            _ => (),
        }
        let mut host = BodyHost::new(mesh);
        let (wrong, fixed) = (vec![f64::NAN; host.mesh.n_cells], [1 << 30]);
        let stiff = vec![0.5; host.mesh.n_cells];
        match odd {
            Some("faces") => host.data.n_faces = -1,
            Some("young") => host.data.young = wrong.as_ptr(),
            Some("no young") => host.data.young = null(),
            Some("poisson") => host.data.poisson = stiff.as_ptr(),
            Some("density") => host.data.density = wrong.as_ptr(),
            Some("free") => host.data.free_body = 1,
            Some("fixed") => (host.data.n_fixed, host.data.fixed_point) = (1, fixed.as_ptr()),
            _ => (),
        }
        let mut settings = json!({ "modes": 3 });
        match odd {
            Some("modes") => settings["modes"] = 4.into(),
            Some("solver") => settings["modal_solver"] = "iterative".into(),
            // For matrices of the host alone.
            Some("block") => settings["block"] = 3.into(),
            _ => (),
        }
        let settings = options(&settings);
        let mut modes = Owned(none(), m4gn_modes_free);
        let place = unless_mut(odd == Some("null"), &raw mut modes.0);
        let body = unless(odd == Some("no body"), &raw const host.data);
        let given = unless(odd == Some("no options"), settings.as_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe { m4gn_solid_modes_new(self.world.fortran(), body, given, place) })
    }
}
