//! Sessions of a body at points under an obstacle.

use crate::calls::{Bench, Ended, Oddity, Owned, Tried, made, unless, unless_mut};
use crate::host::*;
use m4gn_mesh::NodeType;
use m4gn_samples::bodies as sample;
use serde_json::json;
use std::path::PathBuf;
use std::ptr::null;

/// Points of the obstacle.
const N_OBSTACLE: usize = 6;

/// Where the obstacle's points are after so many steps.
fn motion(step: i32) -> Vec<f64> {
    [0.0, 0.0, -0.05 * f64::from(step)].repeat(N_OBSTACLE)
}

impl Bench {
    /// A model file; each rank has one of the same name and content.
    fn body_model_file(&self) -> PathBuf {
        let path = self.folder.path().join("body.safetensors");
        if !path.exists() {
            body_model().write(&path).unwrap();
        }
        path
    }

    fn body_host(&self, odd: Option<Oddity>) -> Host {
        let body = sample::block([6, 2, 2], [3.0, 1.0, 1.0]);
        let obstacle = sample::octahedron([2.6, 0.5, 1.6], 0.5);
        // In turns along the beam, so that a rank's points are no single stretch of the numbering.
        let size = self.world.size();
        let ranks: Vec<i32> = (0..body.positions.len() as i32).map(|p| p % 7 % size).collect();
        let mut mesh = body.share(Some(&obstacle), &ranks, self.world.rank());
        if let (Some(share), Some(obstacle)) = (&mut mesh.body, &mut mesh.obstacle) {
            match odd {
                Some("type") => share.types[1] = NodeType::Wall,
                Some("element") => share.points[3] = 1 << 40,
                Some("inverted") => share.points[..8].rotate_left(4),
                Some("material") => share.material[0].poisson = f64::NAN,
                Some("position") => mesh.cell_centres[2][1] = f64::INFINITY,
                Some("global") => mesh.cell_global[0] = 1 << 40,
                Some("obstacle") => obstacle.positions[4][2] += 0.1,
                Some("triangle") => obstacle.triangles[2][1] = N_OBSTACLE as i32,
                Some("overlap") => obstacle.positions.iter_mut().for_each(|x| x[2] -= 0.5),
                Some("no obstacle") => mesh.obstacle = None,
                _ => (),
            }
        }
        let mut host = Host::new(mesh);
        match odd {
            Some("no types") => host.data.cell_type = null(),
            Some("elements") => host.data.n_elements = -1,
            Some("faces") => host.data.n_faces = 1,
            _ => (),
        }
        host
    }

    pub fn body_new(&self, odd: Option<Oddity>, panic: Option<u32>) -> (Ended, Owned<SessionHandle>) {
        let mut settings = json!({});
        if odd == Some("backend") {
            settings["backend"] = "torch".into();
        }
        self.session_of(&self.body_host(odd), self.body_model_file(), &settings, null(), odd, panic)
    }

    pub fn body_step(&self, odd: Option<Oddity>, panic: Option<u32>) -> Tried {
        let session = made(self.body_new(None, None))?;
        let n = self.body_host(None).mesh.cell_global.len();
        let step = |odd, panic| self.stepped(session.0, n, odd, panic);
        let (ended, again) = (step(odd, panic), step(None, None));
        Ok(self.then(ended, again))
    }

    /// The first step of a body at rest.
    fn stepped(&self, session: Session, n: usize, odd: Option<Oddity>, panic: Option<u32>) -> Ended {
        let mut displacement = vec![0.0; 3 * n];
        let mut obstacle = [motion(0), motion(1)].concat();
        match odd {
            Some("nan") => displacement[2] = f64::NAN,
            Some("obstacle nan") => obstacle[4] = f64::NAN,
            Some("infinite") => obstacle[3 * N_OBSTACLE + 17] = f64::INFINITY,
            Some("turned") => obstacle[3 * N_OBSTACLE] += 0.3,
            _ => (),
        }
        let mut end = displacement.clone();
        let cells = unless(odd == Some("no displacement"), displacement.as_ptr());
        let boundary = unless(odd == Some("no obstacle"), obstacle.as_ptr());
        let next = unless_mut(odd == Some("no place"), end.as_mut_ptr());
        // SAFETY: arrays of their lengths, or what the call refuses.
        self.made(panic, || unsafe { m4gn_session_step(session, &cells, &boundary, &next) })
    }
}
